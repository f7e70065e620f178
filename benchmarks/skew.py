"""What a skewed falloff gains: PSNR of the rasterised SVG and bytes, without and with it.

    python benchmarks/skew.py FOLDER [--counts 256,512,1024,5000] [--bytes 2000,20000] [--tune psnr]
        [--scores] [--renderers resvg,cairo,librsvg,chromium,firefox,inkscape]

For each picture of the folder and each count, or each limit of bytes, one run with
`--falloff adaptive` and one with `--falloff skewed`, on one thread. --scores adds SSIMULACRA2 and
FLIP, --renderers the PSNR of each renderer's raster against the model.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import numpy as np

from gauss2svg import vectorize
from gauss2svg.fit.options import FitOptions
from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline.options import RunOptions
from gauss2svg.raster import rasterize
from gauss2svg.render import render

_SCORES = ("psnr_svg", "psnr_model", "psnr_roundtrip", "ssim_svg", "svg_bytes", "svgz_bytes")


def main() -> None:
    """Print a table row for each count and each limit."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pictures", default="*.png", help="pattern of names")
    parser.add_argument("--counts", default="256,512,1024,5000")
    parser.add_argument("--bytes", default="")
    parser.add_argument("--tune", default="psnr")
    parser.add_argument("--scores", action="store_true")
    parser.add_argument("--renderers", default="")
    given = parser.parse_args()
    renderers = tuple(name for name in given.renderers.split(",") if name)
    photos = sorted(given.folder.glob(given.pictures))
    goals = [{"gaussians": int(n)} for n in given.counts.split(",") if n]
    goals += [{"max_bytes": int(n)} for n in given.bytes.split(",") if n]
    names = (*_SCORES, *(("ssimulacra2_svg", "flip_svg") if given.scores else ()), "cpu_s")
    names += renderers
    print(f"| goal | falloff | {' | '.join(names)} |\n|{'---|' * (len(names) + 2)}")
    for goal in goals:
        for falloff in ("adaptive", "skewed"):
            rows = [
                run(photo, falloff, given.tune, given.scores, goal, names, renderers)
                for photo in photos
            ]
            columns = zip(*rows, strict=True)
            means = [means_of(name, c) for name, c in zip(names, columns, strict=True)]
            (kind, value), *_ = goal.items()
            print(f"| {kind} {value} | {falloff} | {' | '.join(means)} |", flush=True)


def run(photo, falloff, tune, scores, goal, names, renderers) -> list[float]:
    """The numbers of one run."""
    start = time.process_time()
    options = RunOptions(threads=1, scores=scores)
    fit = FitOptions(tune=tune, falloff=falloff)
    result = vectorize(photo, fit=fit, run=options, **goal)
    report = result.report
    report["cpu_s"] = time.process_time() - start
    if renderers:
        model = render(result.scene)
        height, width = model.shape[:2]
        report |= {n: psnr(rasterize(result.svg, width, height, n), model) for n in renderers}
    return [report[name] for name in names]


def means_of(name: str, values: tuple[float, ...]) -> str:
    """The mean; of bytes the geometric one."""
    if name.endswith("bytes"):
        return f"{math.exp(np.log(values).mean()):.0f}"
    digits = 4 if name.startswith(("ssim_", "flip")) else 2
    return f"{np.mean(values):.{digits}f}"


if __name__ == "__main__":
    main()
