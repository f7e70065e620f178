"""What the first rounds of one file show: PSNR by the number of shapes that have arrived.

    python benchmarks/prefixes.py PHOTO... [--gaussians 10000]

Each photo is fitted once, by `--tune psnr`, on one thread. A file has its rounds in painter's
order, coarse to fine, so what has arrived of it is the scene of the first rounds. A line for each
round has the means over the photos: shapes, and PSNR in dB of those alone by resvg.
"""

from __future__ import annotations

import argparse
import statistics
from pathlib import Path

import numpy as np
from PIL import Image

from gauss2svg import vectorize
from gauss2svg.fit.options import FitOptions
from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline.options import RunOptions
from gauss2svg.raster import rasterize
from gauss2svg.svg.write import write_svg


def main() -> None:
    """Print a table row for each round."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("photos", nargs="+", type=Path)
    parser.add_argument("--gaussians", type=int, default=10_000)
    given = parser.parse_args()
    found: dict[int, list[tuple[int, float]]] = {}
    for path in given.photos:
        photo = np.asarray(Image.open(path).convert("RGB"), np.float32) / 255
        scene = vectorize(
            path,
            gaussians=given.gaussians,
            fit=FitOptions(tune="psnr"),
            run=RunOptions(threads=1),
        ).scene
        for last in range(int(scene.round_index[-1]) + 1):
            first = scene.select(scene.round_index <= last)
            raster = rasterize(write_svg(first), photo.shape[1], photo.shape[0])
            found.setdefault(last, []).append((len(first), psnr(raster, photo)))
    print("| rounds | shapes | PSNR, dB |\n|---|---|---|")
    for last, rows in found.items():
        shapes, db = (statistics.fmean(column) for column in zip(*rows, strict=True))
        print(f"| {last + 1} | {shapes:.0f} | {db:.2f} |")


if __name__ == "__main__":
    main()
