"""The studio under load: waits, CPU, frames, many clients, memory, cancellations.

    python benchmarks/studio_load.py [PHOTO ...] [--fits 200] [--repeats 10] [--quality balanced]

starts `gauss2svg studio` and prints a line for each. Without photos: scikit-image's coffee, and the
same at 12 megapixels.
"""

from __future__ import annotations

import argparse
import concurrent.futures
import json
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

import httpx
import psutil
from common import encoded
from PIL import Image
from skimage import data

_CLIENTS = 20
_SMALL = {"quality": "draft", "iterations": 20}
_LONG = {"quality": "max", "gaussians": 3000, "iterations": 100_000}


@contextmanager
def studio() -> Iterator[tuple[httpx.Client, psutil.Process]]:
    """A warm server: a client with its token, and its process."""
    words = ["-P", "-m", "gauss2svg", "studio", "--no-browser", "--port", "0"]
    process = subprocess.Popen([sys.executable, *words], stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        address = None
        while address is None:
            address = re.search(r"(http://\S+)/\?token=(\S+)", process.stderr.readline())
        bearer = {"Authorization": f"Bearer {address[2]}"}
        with httpx.Client(base_url=address[1], headers=bearer, timeout=600) as client:
            vectorized(client, photo_bytes(Image.fromarray(data.coffee())), _SMALL)
            yield client, psutil.Process(process.pid)
    finally:
        process.terminate()
        process.wait()


def photo_bytes(photo: Image.Image) -> bytes:
    return encoded(photo, "JPEG", quality=95)


def submitted(client: httpx.Client, photo: bytes, options: Any) -> str:
    form = {"options": json.dumps(options)}
    answer = client.post("/api/jobs", data=form, files={"photo": ("photo.jpg", photo)})
    answer.raise_for_status()
    return answer.json()["id"]


def vectorized(client: httpx.Client, photo: bytes, options: Any) -> httpx.Response:
    form = {"options": json.dumps(options)}
    return client.post("/api/vectorize", data=form, files={"photo": ("photo.jpg", photo)})


def watched(client: httpx.Client, photo: bytes, options: Any) -> dict[str, Any]:
    """Seconds from the POST to the first frame and to the SVG, frames a second, the report."""
    begun = time.perf_counter()
    job = submitted(client, photo, options)
    first, frames, began, ended, report = 0.0, 0, 0.0, 0.0, None
    with client.stream("GET", f"/api/jobs/{job}/events") as stream:
        for line in stream.iter_lines():
            if not line.startswith("data: "):
                continue
            state = json.loads(line.removeprefix("data: "))
            now = state["progress"] or {}
            if now.get("frame", 0) > frames:
                frames, ended = now["frame"], time.perf_counter()
                if not first:
                    client.get(f"/api/jobs/{job}/frame").raise_for_status()
                    first, began = time.perf_counter() - begun, time.perf_counter()
            report = state["report"]
    client.get(f"/api/jobs/{job}/picture.svg").raise_for_status()
    whole = time.perf_counter() - begun
    client.delete(f"/api/jobs/{job}")
    assert report is not None
    rate = (frames - 1) / max(ended - began, 1e-9)
    return {"first": first, "svg": whole, "rate": rate, "frames": frames, **report}


def command_fit(photo: bytes, options: Any) -> dict[str, Any]:
    """The report of the command."""
    with tempfile.TemporaryDirectory() as folder:
        path, report = Path(folder, "photo.jpg"), Path(folder, "report.json")
        path.write_bytes(photo)
        words = [w for name, value in options.items() for w in (f"--{name}", str(value))]
        command = [sys.executable, "-P", "-m", "gauss2svg", str(path), "--quiet", *words]
        begun = time.perf_counter()
        subprocess.run([*command, "--report", str(report)], check=True, cwd=folder)
        return {**json.loads(report.read_bytes()), "wall": time.perf_counter() - begun}


def waits(client: httpx.Client, name: str, photo: bytes, repeats: int, options: Any) -> None:
    runs, commands = [], []
    for _ in range(repeats):  # in turn, so that both meet the same load of the machine
        runs.append(watched(client, photo, options))
        commands.append(command_fit(photo, options))

    def of(found: list[dict[str, Any]], key: str) -> float:
        return median(one[key] for one in found)

    ratio = median(a["fit_cpu_s"] / b["fit_cpu_s"] for a, b in zip(runs, commands, strict=True))
    print(
        f"{name}, medians of {repeats}: first frame {of(runs, 'first'):.2f} s, SVG "
        f"{of(runs, 'svg'):.2f} s (command {of(commands, 'wall'):.2f} s); CPU of the fit "
        f"{of(runs, 'fit_cpu_s'):.2f} s, {ratio:.3f} of the command's; {of(runs, 'frames'):.0f} "
        f"frames, {of(runs, 'rate'):.1f} a second",
        flush=True,
    )


def crowd(client: httpx.Client, photo: bytes) -> None:
    begun = time.perf_counter()

    def one(number: int) -> bool:
        text = vectorized(client, photo, {**_SMALL, "title": f"Client {number}"}).text
        return f"<title>Client {number}</title>" in text and "</svg>" in text

    with concurrent.futures.ThreadPoolExecutor(_CLIENTS) as threads:
        answers = list(threads.map(one, range(_CLIENTS)))
    print(
        f"{_CLIENTS} clients at once: {sum(answers)} got their SVG, in "
        f"{time.perf_counter() - begun:.1f} s",
        flush=True,
    )


def memory(client: httpx.Client, server: psutil.Process, photo: bytes, fits: int) -> None:
    for number in range(fits + 1):
        vectorized(client, photo, {**_SMALL, "seed": number}).raise_for_status()
        if number in (10, fits // 2, fits):
            held = [process.memory_info().rss / 1e6 for process in (server, *server.children())]
            print(
                f"after {number} fits: server {held[0]:.0f} MB, workers "
                f"{', '.join(f'{one:.0f}' for one in held[1:])} MB",
                flush=True,
            )


def cancellations(client: httpx.Client, server: psutil.Process, photo: bytes, repeats: int) -> None:
    """Seconds from the request until the worker's CPU clock stands still, in steps of 10 ms."""
    taken = []
    for _ in range(repeats):
        job = submitted(client, photo, _LONG)
        client.get(f"/api/jobs/{job}/frame")
        time.sleep(0.3)
        (worker, *_) = server.children()
        begun = last = time.perf_counter()
        client.delete(f"/api/jobs/{job}")
        spent = -1.0
        try:
            while time.perf_counter() - last < 0.15:
                now = sum(worker.cpu_times()[:2])
                if now != spent:
                    spent, last = now, time.perf_counter()
                time.sleep(0.005)
        except psutil.NoSuchProcess:
            last = time.perf_counter()
        taken.append(last - begun)
    print(f"cancel: core free after {median(taken):.3f} s, at most {max(taken):.3f} s", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("photos", nargs="*", type=Path)
    parser.add_argument("--fits", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=10)
    parser.add_argument("--quality", default="balanced")
    given = parser.parse_args()
    coffee = Image.fromarray(data.coffee())
    photos = {path.name: path.read_bytes() for path in given.photos} or {
        "coffee": photo_bytes(coffee),
        "coffee, 12 megapixels": photo_bytes(coffee.resize((4242, 2828))),
    }
    small = photo_bytes(coffee.resize((150, 100)))
    with studio() as (client, server):
        for name, photo in photos.items():
            waits(client, name, photo, given.repeats, {"quality": given.quality})
        crowd(client, small)
        cancellations(client, server, next(iter(photos.values())), given.repeats)
        memory(client, server, small, given.fits)


if __name__ == "__main__":
    main()
