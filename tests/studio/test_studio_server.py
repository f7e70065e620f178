"""A real studio: fits, cancellations, deaths and ends."""

import gzip
import io
import json
import os
import shlex
import signal
import zipfile

import numpy as np
import pytest
from batches import PoolHere
from fastapi import FastAPI
from flat import vectorize
from pictures import ball
from PIL import Image
from studio_server import answer_of, running

from gauss2svg import check
from gauss2svg.cli.main import main
from gauss2svg.files import as_png
from gauss2svg.scene import Scene
from gauss2svg.studio import jobs
from gauss2svg.studio.service import create_app

pytestmark = pytest.mark.process
SHORT = '{"gaussians": 9, "iterations": 9}'
LONG = {"iterations": 10**8, "gaussians": 50}


@pytest.fixture(scope="module")
def server():
    with running("--jobs", "1") as found:
        yield found


@pytest.fixture(scope="module")
def png(photo) -> bytes:
    return as_png(photo[::2, ::2])


def test_the_service_and_the_command_write_the_same_bytes(server, png, tmp_path, monkeypatch):
    options = {"quality": "draft", "iterations": 40, "seed": 3, "markup": "minimal"}
    job = server.wait(server.submit(png, **options))
    direct = server.client.post(
        "/api/vectorize", data={"options": json.dumps(options)}, files={"photo": ("p.png", png)}
    )
    (tmp_path / "p.png").write_bytes(png)
    # The command that the page shows, as it would be typed.
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(job["command"])[1:]) == 0
    command = (tmp_path / "p.svg").read_bytes()
    assert server.get(f"/api/jobs/{job['id']}/picture.svg") == command
    assert direct.content == command
    assert float(direct.headers["X-Gauss2svg-psnr-svg"]) == job["report"]["psnr_svg"]


def test_files_beside_the_svg_are_those_of_the_commands_options(server, png, tmp_path, monkeypatch):
    (tmp_path / "p.png").write_bytes(png)
    monkeypatch.chdir(tmp_path)
    poster = server.wait(server.submit(png, gaussians=30, inks=3, size="90mm"))
    small = server.wait(server.submit(png, max_bytes=1000, markup="minimal"))
    words = shlex.split(poster["command"])[1:]
    main([*words, "--outline", "outline.svg", "--separations", "p-plate.svg"])
    main([*words, "--plot", "plot.svg"])
    main(["placeholder", "p.png", "-o", "placeholder.html"])
    for job, made, other in (
        (poster, ["outline.svg", "plates.zip"], "placeholder.html"),
        (small, ["placeholder.html"], "plates.zip"),
    ):
        home = f"/api/jobs/{job['id']}"
        files = json.loads(server.get(f"{home}/files"))
        assert {*made} <= {*files}
        assert other not in files
        for name in made:
            if name != "plates.zip":
                assert server.get(f"{home}/{name}") == (tmp_path / name).read_bytes()
    plot = server.get(f"/api/jobs/{poster['id']}/plot.svg")
    assert plot == (tmp_path / "plot.svg").read_bytes()
    plates = zipfile.ZipFile(io.BytesIO(server.get(f"/api/jobs/{poster['id']}/plates.zip")))
    written = {path.name: path.read_bytes() for path in tmp_path.glob("p-plate-*.svg")}
    assert {name: plates.read(name) for name in plates.namelist()} == written
    assert len(written) == 3


def test_every_file_of_a_job_is_what_it_says(server, png, photo, drawn_here):
    small = photo[::2, ::2]
    job = server.wait(server.submit(png, quality="draft", iterations=20))
    home = f"/api/jobs/{job['id']}"

    def pixels(path):
        return np.asarray(Image.open(io.BytesIO(server.get(f"{home}/{path}"))))

    whole = server.client.get(f"{home}/picture.svg")
    svg = whole.text
    assert whole.headers["content-security-policy"].endswith("sandbox")
    other = server.get(f"{home}/picture.svg?markup=minimal").decode()
    assert abs(check(small, other).report["psnr_svg"] - check(small, svg).report["psnr_svg"]) < 0.5
    packed = server.client.get(f"{home}/picture.svg?gzip=1&download=1")
    assert packed.headers["content-disposition"] == "attachment; filename*=UTF-8''p.svgz"
    assert gzip.decompress(packed.content).decode() == svg
    assert pixels("picture.png?width=300").shape[:2] == (300, 300)
    assert server.client.get(f"{home}/picture.png?width=100000").status_code == 422
    assert np.array_equal(pixels("photo.png"), np.round(small * 255))
    assert len(Scene.load(io.BytesIO(server.get(f"{home}/scene.npz")))) > 0
    form = {"of": job["id"], "options": json.dumps(job["options"])}
    again = server.client.post("/api/jobs", data=form, files={"x": b""}).json()
    server.wait(again)
    zipped = server.get(f"/api/zip?ids={job['id']},{again['id']},{job['id']}")
    archive = zipfile.ZipFile(io.BytesIO(zipped))
    assert archive.namelist() == ["p.svg", "p-2.svg"]
    assert {archive.read(name).decode() for name in archive.namelist()} == {svg}


def test_the_first_frame_of_a_drawing_has_its_areas(server):
    job = server.submit(as_png(ball(96)), max_bytes=6000)
    with server.client.stream("GET", f"/api/jobs/{job['id']}/events") as stream:
        lines = [line[6:] for line in stream.iter_lines() if line.startswith("data: ")]
    states = (json.loads(line)["progress"] or {} for line in lines)
    frames = [now for now in states if "gaussians" in now]
    assert (frames[0]["gaussians"], frames[0]["areas"] > "") == (0, True)
    assert server.state(job)["report"]["area_count"] == int(frames[-1]["areas"].split()[0])


def test_a_fit_is_stopped_with_a_result_and_one_that_nobody_wants_frees_its_place(server, png):
    (folder,) = server.scratch.glob("gauss2svg-studio-*")
    for way in ("stop", "delete", "reader"):
        before = set(folder.iterdir())
        job = server.submit(png, **LONG)
        server.fitting(job)
        address = f"/api/jobs/{job['id']}"
        if way == "stop":
            server.client.post(f"{address}/stop")
            assert server.wait(job)["report"]["stop_reason"] == "interrupted"
        elif way == "delete":
            waiting = server.submit(png, **LONG)
            assert server.state(waiting)["state"] == "queued"
            assert server.state(job)["state"] == "running"
            for one in (waiting, job):
                server.client.delete(f"/api/jobs/{one['id']}")
        else:
            with server.client.stream("GET", f"{address}/events") as stream:
                next(stream.iter_lines())
        # One fit runs at a time: the next would wait for minutes.
        assert server.wait(server.submit(png, quality="draft", iterations=10))["state"] == "done"
        assert server.client.get(address).status_code == (200 if way == "stop" else 404)
        # What is forgotten leaves no file.
        assert len(set(folder.iterdir()) - before) == (2 if way == "stop" else 1)


def test_a_killed_worker_or_a_broken_photo_costs_its_own_fit_and_says_so(server, png):
    doomed, broken = server.submit(png, **LONG), server.submit(png[: len(png) // 2])
    other = server.submit(png, quality="draft", iterations=10)
    server.fitting(doomed)
    (worker,) = server.workers()
    worker.kill()
    killed = "SIGKILL" if os.name == "posix" else "status 15"
    assert killed in server.wait(doomed)["error"]
    error = server.wait(broken)["error"]
    assert "p.png must be a complete image" in error
    assert str(server.scratch) not in error
    assert server.wait(other)["state"] == "done"


def test_it_is_mounted_in_another_application(png, monkeypatch):
    monkeypatch.setattr(jobs, "Pool", PoolHere)
    application = FastAPI()
    application.mount("/studio", create_app())
    given = {"data": {"options": SHORT}, "files": {"photo": ("p.png", png)}}
    svg = answer_of(application, "POST", "/studio/api/vectorize", **given).text
    assert svg.strip() == vectorize(io.BytesIO(png), **json.loads(SHORT)).svg.strip()


@pytest.mark.posix
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_cleanly_with_nothing_left(png, number):
    with running("--jobs", "1") as server:
        job = server.submit(png, **LONG)
        server.fitting(job)
        server.client.stream("GET", f"/api/jobs/{job['id']}/events").__enter__()
        assert list(server.scratch.iterdir())
        workers = server.workers()
        server.process.send_signal(number)
        assert server.process.wait(60) == 0
        assert server.process.stderr.read() == ""
        assert not list(server.scratch.iterdir())
        assert not any(worker.is_running() for worker in workers)
