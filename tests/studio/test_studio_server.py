"""A real studio: fits, cancellations, deaths and ends."""

import base64
import gzip
import io
import json
import os
import shlex
import signal
import subprocess
import sys
import time
import zipfile
from xml.etree import ElementTree

import numpy as np
import psutil
import pytest
from PIL import Image
from studio_server import running

from gauss2svg import check, vectorize
from gauss2svg.cli.main import main
from gauss2svg.files import as_png

pytestmark = pytest.mark.process
LONG = {"quality": "max", "iterations": 100_000, "gaussians": 3000}


@pytest.fixture(scope="module")
def server():
    with running("--jobs", "1") as found:
        yield found


@pytest.fixture(scope="module")
def png(photo) -> bytes:
    return as_png(photo)


def test_the_service_and_the_command_write_the_same_bytes(server, png, tmp_path, monkeypatch):
    options = {"quality": "draft", "iterations": 40, "seed": 3, "markup": "minimal"}
    job = server.wait(server.submit(png, **options))
    direct = server.client.post(
        "/api/vectorize", data={"options": json.dumps(options)}, files={"photo": ("p.png", png)}
    )
    (tmp_path / "p.png").write_bytes(png)
    # The lines that the page shows, as they would be typed.
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(job["lines"]["command"])[1:]) == 0
    exec(job["lines"]["python"].replace("p.svg", "q.svg"), {})
    command = (tmp_path / "p.svg").read_bytes()
    assert server.get(f"/api/jobs/{job['id']}/picture.svg") == command
    assert (tmp_path / "q.svg").read_bytes() == direct.content == command
    assert float(direct.headers["X-Gauss2svg-psnr-svg"]) == job["report"]["psnr_svg"]


def test_every_file_of_a_job_is_what_it_says(server, png, photo):
    job = server.wait(server.submit(png, quality="draft", iterations=20))
    home = f"/api/jobs/{job['id']}"
    get = lambda path: server.client.get(f"{home}/{path}")  # noqa: E731
    svg = get("picture.svg").text
    assert get("picture.svg").headers["content-security-policy"].endswith("sandbox")
    other = get("picture.svg?markup=minimal").text
    assert len(other) < len(svg)
    assert abs(check(photo, other).psnr - check(photo, svg).psnr) < 0.5
    packed = get("picture.svg?gzip=1&download=1")
    assert packed.headers["content-disposition"] == "attachment; filename*=UTF-8''p.svgz"
    assert gzip.decompress(packed.content).decode() == svg
    assert Image.open(io.BytesIO(get("picture.png?width=300").content)).size == (300, 300)
    assert get("picture.png?width=100000").status_code == 422
    shown = np.asarray(Image.open(io.BytesIO(get("photo.png").content)))
    assert np.array_equal(shown, np.round(photo * 255))
    assert Image.open(io.BytesIO(get("errors.png").content)).size == (128, 128)
    assert ElementTree.fromstring(get("outlines.svg").text).tag == "{http://www.w3.org/2000/svg}svg"
    kind, _, encoded = get("data-uri.txt").text.partition(",")
    assert (kind, base64.b64decode(encoded).decode()) == ("data:image/svg+xml;base64", svg)
    assert get("report.json").json()["width"] == 128
    assert get("scene.npz").content.startswith(b"PK")
    form = {"of": job["id"], "options": json.dumps(job["options"])}
    again = server.client.post("/api/jobs", data=form, files={"x": b""}).json()
    server.wait(again)
    zipped = server.get(f"/api/zip?ids={job['id']},{again['id']},{job['id']}")
    archive = zipfile.ZipFile(io.BytesIO(zipped))
    assert archive.namelist() == ["p.svg", "p-2.svg"]
    assert {archive.read(name).decode() for name in archive.namelist()} == {svg}


def test_stop_keeps_the_best_so_far(server, png):
    job = server.submit(png, **LONG)
    server.fitting(job)
    server.client.post(f"/api/jobs/{job['id']}/stop")
    found = server.wait(job)
    assert found["state"] == "stopped"
    assert found["report"]["stop_reason"] == "interrupted"
    assert found["report"]["gaussians"] > 0


def idle_after(worker, seconds: float) -> bool:
    """Whether a worker uses no CPU so long after now, or is gone."""
    time.sleep(seconds)
    try:
        before = sum(worker.cpu_times()[:2])
        time.sleep(0.3)
        return sum(worker.cpu_times()[:2]) - before <= 0.02
    except psutil.NoSuchProcess:
        return True


def test_a_fit_that_nobody_wants_frees_its_core(server, png):
    for way in ("delete", "reader"):
        job = server.submit(png, **LONG)
        server.fitting(job)
        (worker,) = server.workers()
        if way == "delete":
            server.client.delete(f"/api/jobs/{job['id']}")
            assert server.client.get(f"/api/jobs/{job['id']}").status_code == 404
        else:
            with server.client.stream("GET", f"/api/jobs/{job['id']}/events") as stream:
                next(stream.iter_lines())
            assert server.wait(job)["state"] == "canceled"
        assert idle_after(worker, 0.7)


def test_a_killed_worker_costs_its_own_fit_and_says_so(server, png):
    doomed = server.submit(png, **LONG)
    other = server.submit(png, quality="draft", iterations=10)
    server.fitting(doomed)
    (worker,) = server.workers()
    worker.kill()
    found = server.wait(doomed)
    assert found["state"] == "failed"
    assert "SIGKILL" in found["error"]
    assert server.wait(other)["state"] == "done"


def test_a_photo_that_breaks_while_it_is_decoded_fails_in_a_line_with_its_name(server, png):
    job = server.submit(png[: len(png) // 2])
    found = server.wait(job)
    assert found["state"] == "failed"
    assert "p.png must be a complete image" in found["error"]
    assert str(server.scratch) not in found["error"]


def test_it_is_mounted_in_another_application_and_leaves_nothing(png, tmp_path):
    (tmp_path / "scratch").mkdir()
    (tmp_path / "p.png").write_bytes(png)
    script = """
import asyncio, httpx, fastapi, gauss2svg
application = fastapi.FastAPI()
application.mount("/studio", gauss2svg.studio.app)

async def main():
    transport = httpx.ASGITransport(application)
    async with httpx.AsyncClient(transport=transport, base_url="http://any", timeout=99) as client:
        assert (await client.get("/studio/")).status_code == 200
        assert (await client.get("/studio/static/studio.css")).status_code == 200
        form = {"options": '{"quality": "draft"}'}
        files = {"photo": open("p.png", "rb")}
        print((await client.post("/studio/api/vectorize", data=form, files=files)).text)
        # A fit that would take minutes ends with the program.
        form = {"options": '{"gaussians": 3000, "iterations": 100000}'}
        files = {"photo": open("p.png", "rb")}
        job = (await client.post("/studio/api/jobs", data=form, files=files)).json()["id"]
        await client.get(f"/studio/api/jobs/{job}/frame")

asyncio.run(main())
"""
    done = subprocess.run(
        [sys.executable, "-P", "-c", script], capture_output=True, text=True, check=True,
        timeout=200, cwd=tmp_path, env={**os.environ, "TMPDIR": str(tmp_path / "scratch")},
    )  # fmt: skip
    assert done.stdout.strip() == vectorize(tmp_path / "p.png", quality="draft").svg.strip()
    assert not done.stderr
    assert not list((tmp_path / "scratch").iterdir())


@pytest.mark.parametrize(("number", "busy"), [(signal.SIGINT, True), (signal.SIGTERM, False)])
def test_a_signal_ends_it_cleanly_with_nothing_left(png, number, busy):
    with running("--jobs", "1") as server:
        if busy:
            job = server.submit(png, **LONG)
            server.fitting(job)
            stream = server.client.stream("GET", f"/api/jobs/{job['id']}/events")
            stream.__enter__()
            assert list(server.scratch.iterdir())
        workers = server.workers()
        server.process.send_signal(number)
        assert server.process.wait(10) == 0
        assert server.process.stderr.read() == ""
        assert not list(server.scratch.iterdir())
        assert not any(worker.is_running() for worker in workers)


def test_workers_outlive_a_killed_server_by_no_moment(png):
    with running("--jobs", "1") as server:
        server.fitting(server.submit(png, **LONG))
        (worker,) = server.workers()
        server.process.kill()
        worker.wait(5)
