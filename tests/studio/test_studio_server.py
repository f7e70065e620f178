"""A real studio: fits, cancellations, deaths and ends."""

import base64
import concurrent.futures
import gzip
import io
import itertools
import json
import os
import shlex
import signal
import socket
import subprocess
import sys
import time
import zipfile
from xml.etree import ElementTree

import numpy as np
import psutil
import pytest
from PIL import Image
from skimage import data
from studio_server import running

from gauss2svg import check, vectorize
from gauss2svg.cli.main import main
from gauss2svg.files import as_png
from gauss2svg.pipeline.options import Options

pytestmark = pytest.mark.process
LONG = {"quality": "max", "iterations": 100_000, "gaussians": 3000}


@pytest.fixture(scope="module")
def server():
    with running("--jobs", "1") as found:
        yield found


@pytest.fixture(scope="module")
def png(photo) -> bytes:
    return as_png(photo)


@pytest.mark.parametrize("packed", [False, True])
def test_the_service_and_the_command_write_the_same_bytes(
    server, png, tmp_path, packed, monkeypatch
):
    options = {"quality": "draft", "iterations": 40, "seed": 3, "markup": "minimal", "gzip": packed}
    job = server.wait(server.submit(png, **options))
    with server.client.stream("GET", f"/api/jobs/{job['id']}/picture.svg") as stream:
        served = b"".join(stream.iter_raw())
    direct = server.client.post(
        "/api/vectorize", data={"options": json.dumps(options)}, files={"photo": ("p.png", png)}
    )
    (tmp_path / "p.png").write_bytes(png)
    # The lines that the page shows, as they would be typed.
    monkeypatch.chdir(tmp_path)
    assert main(shlex.split(job["lines"]["command"])[1:]) == 0
    suffix = "svgz" if packed else "svg"
    command = (tmp_path / f"p.{suffix}").read_bytes()
    exec(job["lines"]["python"].replace("p.svg", "q.svg"), {})
    assert served == command == (tmp_path / f"q.{suffix}").read_bytes()
    assert direct.content == (gzip.decompress(command) if packed else command)
    assert float(direct.headers["X-Gauss2svg-psnr-svg"]) == job["report"]["psnr_svg"]


def test_events_show_rounds_and_frames_until_the_end(server):
    job = server.submit("coffee.png", quality="draft")
    with server.client.stream("GET", f"/api/jobs/{job['id']}/events") as stream:
        seen = [
            json.loads(line.removeprefix("data: "))
            for line in stream.iter_lines()
            if line.startswith("data: ")
        ]
    assert [s["state"] for s in seen][-1] == "done"
    assert seen[-1]["report"]["psnr_svg"] > 20
    assert {s["name"] for s in seen} == {"coffee.png"}
    steps = [s["progress"] for s in seen if (s["progress"] or {}).get("iteration")]
    assert len(steps) >= 3
    assert all(a["iteration"] <= b["iteration"] for a, b in itertools.pairwise(steps))
    assert steps[-1]["frame"] > steps[0]["frame"] >= 1
    frame = server.client.get(f"/api/jobs/{job['id']}/frame")
    image = np.asarray(Image.open(io.BytesIO(frame.content)).resize((600, 400)), np.float64)
    assert np.abs(image - data.coffee()).mean() < 16


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
    assert gzip.decompress(packed.content).decode() == svg
    for path, name in {
        "picture.svg?gzip=1&download=1": "p.svgz",
        "picture.svg?markup=minimal&download=1": "p-minimal.svg",
        "picture.png?width=30&download=1": "p-30.png",
    }.items():
        assert get(path).headers["content-disposition"] == f"attachment; filename*=UTF-8''{name}"
    assert Image.open(io.BytesIO(get("picture.png?width=300").content)).size == (300, 300)
    assert get("picture.png?width=100000").status_code == 422
    shown = np.asarray(Image.open(io.BytesIO(get("photo.png").content)))
    assert np.array_equal(shown, np.round(photo * 255))
    assert Image.open(io.BytesIO(get("errors.png").content)).size == (128, 128)
    assert ElementTree.fromstring(get("outlines.svg").text).tag == "{http://www.w3.org/2000/svg}svg"
    kind, _, encoded = get("data-uri.txt").text.partition(",")
    assert (kind, base64.b64decode(encoded).decode()) == ("data:image/svg+xml;base64", svg)
    report = get("report.json").json()
    assert report["width"] == 128
    assert report["max_memory"] < psutil.virtual_memory().total  # its share
    assert get("scene.npz").content.startswith(b"PK")
    again = server.client.post(
        "/api/jobs", data={"of": job["id"], "options": json.dumps(job["options"])}, files={"x": b""}
    ).json()
    server.wait(again)
    assert server.client.get(f"/api/jobs/{again['id']}/picture.svg").text == svg
    zipped = server.client.get(f"/api/zip?ids={job['id']},{again['id']},{job['id']}")
    archive = zipfile.ZipFile(io.BytesIO(zipped.content))
    assert archive.namelist() == ["p.svg", "p-2.svg"]
    assert archive.read("p.svg").decode() == svg


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


@pytest.mark.parametrize("way", ["delete", "reader", "connection"])
def test_a_fit_that_nobody_wants_frees_its_core(server, png, way):
    if way == "connection":
        client = socket.create_connection(_address(server))
        body = _multipart(png, LONG)
        head = (
            f"POST /api/vectorize HTTP/1.1\r\nHost: {_host(server)}\r\n"
            f"Authorization: Bearer {server.token}\r\nContent-Length: {len(body)}\r\n"
            "Content-Type: multipart/form-data; boundary=x\r\n\r\n"
        )
        client.sendall(head.encode() + body)
        (worker,) = server.workers()
        before = sum(worker.cpu_times()[:2])
        while sum(worker.cpu_times()[:2]) - before < 0.3:
            time.sleep(0.01)
        client.close()
        assert idle_after(worker, 0.5)
        return
    job = server.submit(png, **LONG)
    server.fitting(job)
    (worker,) = server.workers()
    if way == "delete":
        server.client.delete(f"/api/jobs/{job['id']}")
        assert idle_after(worker, 0.3)
        assert server.client.get(f"/api/jobs/{job['id']}").status_code == 404
    else:
        with server.client.stream("GET", f"/api/jobs/{job['id']}/events") as stream:
            next(stream.iter_lines())
        assert idle_after(worker, 0.7)
        assert server.state(job)["state"] == "canceled"


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


def test_twenty_clients_at_once_lose_nothing(server, photo):
    png = as_png(photo[:40, :40])

    def one(seed: int):
        files = {"photo": ("p.png", png)}
        options = {"quality": "draft", "iterations": 5, "seed": seed}
        return server.client.post(
            "/api/vectorize", data={"options": json.dumps(options)}, files=files, timeout=300
        )

    with concurrent.futures.ThreadPoolExecutor(20) as threads:
        answers = list(threads.map(one, range(20)))
    assert [answer.status_code for answer in answers] == [200] * 20
    flat = Options.from_flat({"quality": "draft", "iterations": 5, "seed": 7})
    expected = vectorize(Image.open(io.BytesIO(png)), flat.goal, fit=flat.fit).svg
    assert answers[7].text == expected


def test_a_reader_that_never_reads_stops_no_fit_and_is_told_its_end_at_last(server, png):
    job = server.submit(png, quality="draft", iterations=2000, gaussians=100)
    with socket.socket() as reader:
        reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        reader.connect(_address(server))
        reader.sendall(
            f"GET /api/jobs/{job['id']}/events HTTP/1.1\r\nHost: {_host(server)}\r\n"
            f"Authorization: Bearer {server.token}\r\nConnection: close\r\n\r\n".encode()
        )
        assert server.wait(job)["state"] == "done"
        reader.settimeout(20)
        told = b"".join(iter(lambda: reader.recv(4096), b""))
    assert told.startswith(b"HTTP/1.1 200")
    assert b'"state":"done"' in told.split(b"event: state")[-1]


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


def _address(server) -> tuple[str, int]:
    return "127.0.0.1", server.client.base_url.port


def _host(server) -> str:
    return f"127.0.0.1:{server.client.base_url.port}"


def _multipart(png: bytes, options: dict) -> bytes:
    head = '--x\r\nContent-Disposition: form-data; name="{}"{}\r\n\r\n'
    return (
        head.format("options", "").encode() + json.dumps(options).encode() + b"\r\n"
        + head.format("photo", '; filename="p.png"').encode() + png + b"\r\n--x--\r\n"
    )  # fmt: skip
