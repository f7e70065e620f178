"""A batch at growing numbers of photos, whose vectorisation is a stand-in.

    python benchmarks/batch_scale.py 10000 100000 1000000
    python benchmarks/batch_scale.py 100000 --cluster

For each number: a list of that many empty files and two workers, processes of the command or of a
Dask cluster, which answer for each at once, for its SVG, as empty, is there already; then the same
command again, of which the command skips all. All else is as it is for photos: the list, jobs,
marks, the table. Prints seconds, CPU seconds of all processes, the largest resident memory of the
command and of the scheduler, and how the memory of the command grows from a quarter of the run on.
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

_STAND_IN = """
import sys
if "gauss2svg.pool" in sys.orig_argv or "distributed.cli.dask_worker" in sys.orig_argv:
    from gauss2svg.batch import worker
    worker._write_svg = lambda spec, photo: {
        "width": 768, "height": 512, "gaussians": 5000, "psnr_svg": 32.125, "unreached": [],
        "svg_bytes": 0, "svgz_bytes": 0,
    }
"""
_POLL_S = 0.2


def start(folder: Path, *command: str) -> subprocess.Popen[bytes]:
    """Return a process of Python's with the stand-in, whose complaints are not shown."""
    (folder / "sitecustomize.py").write_text(_STAND_IN)
    path = os.pathsep.join([str(folder), *sys.path[1:]])
    return subprocess.Popen(
        [sys.executable, "-P", "-m", *command],
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": path, "DASK_LOGGING__DISTRIBUTED": "error"},
    )


def cpu_s(cluster: list[psutil.Process]) -> float:
    """CPU seconds so far of these processes, and of all that were waited for."""
    ended = resource.getrusage(resource.RUSAGE_CHILDREN)
    times = [process.cpu_times() for process in cluster]
    return ended.ru_utime + ended.ru_stime + sum(one.user + one.system for one in times)


def measured(folder: Path, command: list[str], cluster: list[psutil.Process]) -> list[str]:
    """Seconds of a command, CPU seconds of all processes, MB of it, and of the scheduler."""
    begun, used = time.perf_counter(), cpu_s(cluster)
    driver, held = start(folder, *command), [0]
    while driver.poll() is None:
        with suppress(psutil.NoSuchProcess):
            held.append(psutil.Process(driver.pid).memory_info().rss)
        time.sleep(_POLL_S)
    if driver.returncode:
        raise SystemExit(f"the command ended with status {driver.returncode}")
    seconds, used = time.perf_counter() - begun, cpu_s(cluster) - used
    grown = max(held) - max(held[: 1 + len(held) // 4])
    scheduler = f"{cluster[0].memory_info().rss / 1e6:.0f}" if cluster else ""
    return [
        f"{seconds:.1f}",
        f"{used:.1f}",
        f"{max(held) / 1e6:.0f}",
        f"{grown / 1e6:.0f}",
        scheduler,
    ]


def photos(count: int, folder: Path) -> Iterator[Path]:
    """Return the names of so many photos, a thousand in a folder."""
    for number in range(count):
        yield folder / f"{number // 1000:06}/{number % 1000:03}.jpg"


def scale(count: int, folder: Path, on_cluster: bool) -> None:
    """Print a row of each run."""
    with (folder / "list.txt").open("w") as stream:
        for photo in photos(count, folder / "photos"):
            stream.write(f"{photo}\n")
            svg = folder / "out" / photo.relative_to(photo.anchor).with_suffix(".svg")
            for path in (photo, svg):
                path.parent.mkdir(parents=True, exist_ok=True)
                path.touch()
    os.sync()  # or the first mark would wait for all of these
    where = folder / "scheduler.json"
    local = ("--no-dashboard", "--scheduler-file", str(where))
    scheduler = ("distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", *local)
    worker = ("distributed.cli.dask_worker", *local, "--nthreads", "1", "--no-nanny")
    local_worker = (*worker, "--local-directory", str(folder))
    commands = [scheduler, local_worker, local_worker] if on_cluster else []
    processes = [start(folder, *command) for command in commands]
    options = ["--workers", "2"]
    try:
        while on_cluster and (not where.exists() or not where.read_text()):
            time.sleep(_POLL_S)
        if on_cluster:
            options = ["--scheduler", json.loads(where.read_text())["address"]]
        cluster = [psutil.Process(process.pid) for process in processes]
        command = ["gauss2svg", "batch", str(folder / "list.txt"), "-o", str(folder / "out")]
        for run in ("first", "second"):
            row = measured(folder, [*command, *options, "--quiet"], cluster)
            print(f"| {count:,} | {run} | {' | '.join(row)} |", flush=True)
    finally:
        for process in reversed(processes):
            process.kill()
            process.wait()


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("counts", nargs="*", type=int, default=[10_000, 100_000, 1_000_000])
    parser.add_argument("--cluster", action="store_true", help="by two workers of a Dask cluster")
    names = ["photos", "run", "s", "CPU s", "MB", "of these after a quarter", "scheduler MB"]
    print(f"| {' | '.join(names)} |\n|{'---|' * len(names)}")
    given = parser.parse_args()
    for count in given.counts:
        with tempfile.TemporaryDirectory(prefix="gauss2svg-") as folder:
            scale(count, Path(folder), given.cluster)


if __name__ == "__main__":
    main()
