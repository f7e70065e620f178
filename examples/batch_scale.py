"""Driver and scheduler of a batch at growing numbers of photos, whose vectorisation is a stand-in.

    python examples/batch_scale.py 10000 100000 1000000

For each number: a list of that many photos, a `dask scheduler` and two workers, which answer for a
photo at once; then the same command again, which skips all of them. All else is as it is for
photos: the list, its index, shards, records, the table. Prints seconds and the largest resident
memory of driver and scheduler.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

import psutil

_STAND_IN = '''
"""Loaded by workers: photos of a list that do not exist, answered for at once."""
from gauss2svg.batch import work
from gauss2svg.batch.records import PhotoRecord, all_versions
_VERSIONS = all_versions()

def stand_in(job, options, photo, begin):
    if photo.prior is not None:
        return PhotoRecord(**photo.prior.line(), skipped=True)
    begin()
    return PhotoRecord(
        input=photo.path, output=photo.output, options=job.identity, stamp="1 1",
        sha256="0" * 64, width=768, height=512, gaussians=5000, psnr_svg=32.125, bytes=150_000,
        seconds=1.5, versions=_VERSIONS,
    )

work.vectorize_photo = stand_in
'''
_POLL_S = 0.2


def start(*command: str) -> subprocess.Popen[bytes]:
    """A process of Python's, whose complaints are not shown."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", *command],
        stderr=subprocess.DEVNULL,
        env={**os.environ, "DASK_LOGGING__DISTRIBUTED": "error"},
    )


def measured(command: list[str], watched: psutil.Process) -> tuple[float, float, float]:
    """Seconds of a command, and the largest memory in MB of it and of a watched process."""
    begun = time.perf_counter()
    driver = start(*command)
    largest = [0, 0]
    while driver.poll() is None:
        for at, process in enumerate((psutil.Process(driver.pid), watched)):
            with suppress(psutil.NoSuchProcess):
                largest[at] = max(largest[at], process.memory_info().rss)
        time.sleep(_POLL_S)
    if driver.returncode:
        raise SystemExit(f"the command ended with status {driver.returncode}")
    return time.perf_counter() - begun, largest[0] / 1e6, largest[1] / 1e6


def scale(count: int, folder: Path) -> None:
    """Print a row of the first run and one of the second."""
    (folder / "preload.py").write_text(_STAND_IN)
    with (folder / "list.txt").open("w") as stream:
        for number in range(count):
            stream.write(f"/photos/{number // 1000:06}/{number % 1000:03}.jpg\n")
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
        watched = psutil.Process(scheduler.pid)
        command = ["gauss2svg", "batch", str(folder / "list.txt"), "-o", str(folder / "out")]
        command += ["--scheduler", address, "--quiet"]
        for run in ("first", "second"):
            seconds, driver, held = measured(command, watched)
            size = sum(p.stat().st_size for p in (folder / "out").rglob("*") if p.is_file())
            print(
                f"| {count:,} | {run} | {seconds:.1f} | {count / seconds:,.0f} | {driver:.0f} | "
                f"{held:.0f} | {size / 1e6:.0f} |",
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
    print("| photos | run | s | photos a second | driver MB | scheduler MB | records, tables MB |")
    print("|---|---|---|---|---|---|---|")
    for count in parser.parse_args().counts:
        with tempfile.TemporaryDirectory(prefix="gauss2svg-") as folder:
            scale(count, Path(folder))


if __name__ == "__main__":
    main()
