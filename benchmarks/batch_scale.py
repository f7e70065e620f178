"""Driver and scheduler of a batch at growing numbers of photos, whose vectorisation is a stand-in.

    python benchmarks/batch_scale.py 10000 100000 1000000

For each number: a list of that many empty files, a `dask scheduler` and two workers, which answer
for each at once, for its SVG, as empty, is there already; then the same command again, of which the
driver skips all. With `--touched` a third one follows, after every file was given another date:
workers read them all and skip them by their bytes. All else is as it is for photos: the list, its
index, shards, records, the table. Prints seconds, CPU seconds of all processes, and the largest
resident memory of driver and scheduler.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil

from gauss2svg.batch.stores import STATE

_STAND_IN = '''
"""Loaded by workers: in place of vectorising a photo and writing its SVG."""
from gauss2svg.batch import worker

def stand_in(spec, options, photo):
    return {
        "width": 768, "height": 512, "gaussians": 5000, "psnr_svg": 32.125, "unreached": [],
        "bytes": 0,
    }

worker._vectorized = stand_in
'''
_POLL_S = 0.2


def start(*command: str) -> subprocess.Popen[bytes]:
    """A process of Python's, whose complaints are not shown."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", *command],
        stderr=subprocess.DEVNULL,
        env={**os.environ, "DASK_LOGGING__DISTRIBUTED": "error"},
    )


def cpu_s(cluster: list[psutil.Process]) -> float:
    """CPU seconds so far of these processes, and of all that were waited for."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    times = [process.cpu_times() for process in cluster]
    return ended.ru_utime + ended.ru_stime + sum(one.user + one.system for one in times)


def measured(
    command: list[str], cluster: list[psutil.Process]
) -> tuple[float, float, float, float]:
    """Seconds of a command, CPU seconds of all processes, largest MB of it and of the scheduler."""
    begun, used = time.perf_counter(), cpu_s(cluster)
    driver = start(*command)
    largest = [0, 0]
    while driver.poll() is None:
        for at, process in enumerate((psutil.Process(driver.pid), cluster[0])):
            with suppress(psutil.NoSuchProcess):
                largest[at] = max(largest[at], process.memory_info().rss)
        time.sleep(_POLL_S)
    if driver.returncode:
        raise SystemExit(f"the command ended with status {driver.returncode}")
    seconds = time.perf_counter() - begun
    return seconds, cpu_s(cluster) - used, largest[0] / 1e6, largest[1] / 1e6


def photos(count: int, folder: Path) -> Iterator[Path]:
    """The names of so many photos, a thousand in a folder."""
    for number in range(count):
        yield folder / f"{number // 1000:06}/{number % 1000:03}.jpg"


def scale(count: int, folder: Path, runs: list[str]) -> None:
    """Print a row of each run."""
    (folder / "preload.py").write_text(_STAND_IN)
    with (folder / "list.txt").open("w") as stream:
        for photo in photos(count, folder / "photos"):
            stream.write(f"{photo}\n")
            svg = folder / "out" / photo.relative_to(photo.anchor).with_suffix(".svg")
            for path in (photo, svg):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.touch()
    os.sync()  # or the first record would wait for all of these
    where = folder / "scheduler.json"
    local = ("--no-dashboard", "--scheduler-file", str(where))
    scheduler = start(
        "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *local
    )
    workers = [
        start(
            "distributed.cli.dask_worker", *local, "--nthreads", "1", "--no-nanny",
            "--preload", str(folder / "preload.py"), "--local-directory", str(folder),
        )
        for _ in range(2)
    ]  # fmt: skip
    try:
        while not where.exists() or not where.read_text():
            time.sleep(_POLL_S)
        address = json.loads(where.read_text())["address"]
        cluster = [psutil.Process(process.pid) for process in (scheduler, *workers)]
        command = ["gauss2svg", "batch", str(folder / "list.txt"), "-o", str(folder / "out")]
        command += ["--scheduler", address, "--quiet"]
        for run in runs:
            if run == "touched":
                for photo in photos(count, folder / "photos"):
                    os.utime(photo, ns=(1, 1))
            seconds, used, driver, held = measured(command, cluster)
            kept = (folder / "out" / STATE).rglob("*")
            size = sum(path.stat().st_size for path in kept if path.is_file())
            print(
                f"| {count:,} | {run} | {seconds:.1f} | {used:.1f} | {count / seconds:,.0f} | "
                f"{driver:.0f} | {held:.0f} | {size / 1e6:.0f} |",
                flush=True,
            )
    finally:
        for process in (*workers, scheduler):
            process.kill()
            process.wait()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("counts", nargs="*", type=int, default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--touched", action="store_true", help="also a run in which workers read")
    names = ["photos", "run", "s", "CPU s", "photos a second", "driver MB"]
    names += ["scheduler MB", "records, tables MB"]
    print(f"| {' | '.join(names)} |\n|{'---|' * len(names)}")
    given = parser.parse_args()
    runs = ["first", "second", *(["touched"] if given.touched else [])]
    for count in given.counts:
        with tempfile.TemporaryDirectory(prefix="gauss2svg-") as folder:
            scale(count, Path(folder), runs)


if __name__ == "__main__":
    main()
