"""Photos a second of a batch on this machine, against a loop of the command and one process.

    python benchmarks/batch_speed.py --photos 400 --side 256

The photos are crops of those that ship with scikit-image. Prints wall-clock and CPU seconds of all
processes of each way. The last column is the share of the workers' wall-clock time that was spent
on photos, by the table of the batch: the rest is the engine's, start and end included. Its work on
a worker's core while a photo is fitted counts as spent on it.
"""

from __future__ import annotations

import argparse
import csv
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from PIL import Image
from skimage import data

from gauss2svg.batch.stores import TABLE

_PHOTOS = ("astronaut", "brick", "camera", "cat", "coffee", "coins", "grass", "gravel", "rocket")
_ONE_PROCESS = """
import sys
from pathlib import Path
from gauss2svg import Goal, RunOptions, vectorize
for path in sorted(Path(sys.argv[1]).iterdir()):
    result = vectorize(path, Goal(quality=sys.argv[3]), run=RunOptions(threads=1))
    Path(sys.argv[2], path.stem + ".svg").write_text(result.svg)
"""


def save_crops(folder: Path, count: int, side: int) -> None:
    """So many different crops of side px, always the same."""
    rng = np.random.default_rng(0)
    for number in range(count):
        picture = getattr(data, _PHOTOS[number % len(_PHOTOS)])()
        y, x = (rng.integers(0, size - side + 1) for size in picture.shape[:2])
        Image.fromarray(picture[y : y + side, x : x + side]).save(folder / f"{number:04}.png")


def timed(*commands: list[str]) -> tuple[float, float]:
    """Wall-clock and CPU seconds of commands of Python's, one after the other."""
    before, begun = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    for command in commands:
        subprocess.run([sys.executable, "-P", *command], check=True, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - begun, cpu


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--photos", type=int, default=400)
    parser.add_argument("--side", type=int, default=256)
    parser.add_argument("--quality", default="draft")
    parser.add_argument("--loop", type=int, default=20, help="photos of the loop of the command")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="gauss2svg-") as name:
        root = Path(name)
        photos, loop = root / "photos", root / "loop"
        photos.mkdir()
        loop.mkdir()
        save_crops(photos, given.photos, given.side)
        quality = ["--quality", given.quality]
        base = ["-m", "gauss2svg"]
        first = sorted(photos.iterdir())[: given.loop]
        timed([*base, str(first[0]), "-o", str(loop / "warm.svg"), *quality])
        single = [
            [*base, str(path), "-o", str(loop / f"{path.stem}.svg"), *quality, "--threads", "1"]
            for path in first
        ]
        ways = {"loop of the command": (len(first), single)}
        (root / "one").mkdir()
        one = ["-c", _ONE_PROCESS, str(photos), str(root / "one"), given.quality]
        ways["one process"] = (given.photos, [one])
        for workers in (1, 2):
            batch = [*base, "batch", str(photos), "-o", str(root / f"out{workers}"), *quality]
            batch += ["--workers", str(workers), "--threads", "1", "--quiet"]
            ways[f"batch, workers: {workers}"] = (given.photos, [batch])
            ways[f"the same again: {workers}"] = (given.photos, [batch])
        print("| way | photos | s | photos a second | CPU s a photo | on photos |")
        print("|---|---|---|---|---|---|")
        for way, (count, commands) in ways.items():
            wall, cpu = timed(*commands)
            rate = f"{count / wall:.2f} | {cpu / count:.3f}"
            share = ""
            if way.startswith("batch"):
                workers = int(way[-1])
                with (root / f"out{workers}" / TABLE).open(newline="") as table:
                    spent = sum(float(row["total_s"]) for row in csv.DictReader(table))
                share = f"{spent / wall / workers:.1%}"
            print(f"| {way} | {count} | {wall:.1f} | {rate} | {share} |", flush=True)
        for path in photos.iterdir():
            texts = {
                (root / out / f"{path.stem}.svg").read_bytes() for out in ("out1", "out2", "one")
            }
            assert len(texts) == 1, path
    print(f"\n{given.side} px, {given.quality}, {os.cpu_count()} cores; all outputs are the same")


if __name__ == "__main__":
    main()
