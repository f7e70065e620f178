"""Fidelity and speed of each renderer for each form of a file, at three sizes.

    python benchmarks/renderers.py PICTURE... [--counts 2000,10000] [--renderers resvg cairo ...]

The script prints a line for each form, count and picture, and the means: PSNR in dB of the raster
against the model at the same size, at once, twice and half the size of the picture, and the seconds
of the first, median of three. The picture's own PSNR is of the file by resvg; with blurred shapes,
which resvg does not draw, by the first of Chromium, Firefox and Inkscape that is installed. What a
renderer refuses or fails to draw is "-", and the reason is on standard error. Renderers that are
not installed are named and left out.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
from itertools import product

import numpy as np
from common import command_line, head, line, pictures, vectorized

from gauss2svg import RendererError, Result
from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import DRAW_ROTATED_BLURS, RENDERERS, rasterize, renderer_version
from gauss2svg.render import render
from gauss2svg.svg.forms import BLUR, GRADIENT

SCALES = (1.0, 2.0, 0.5)


def installed(names: list[str]) -> dict[str, str]:
    """Return the versions of the renderers that are installed; print those that are not."""
    versions = {}
    for name in names:
        try:
            versions[name] = renderer_version(name)
        except RendererError as error:
            print(f"left out: {error}", file=sys.stderr)
    return versions


def measured(result: Result, name: str) -> list[float]:
    """Return PSNR in dB against the model at each scale, then the seconds at the first."""
    found, seconds = [], []
    for scale in (*SCALES, 1.0, 1.0):
        width, height = (round(scale * s) for s in (result.scene.width, result.scene.height))
        begun = time.perf_counter()
        try:
            raster = rasterize(result.svg, width, height, name)
        except RendererError as error:
            print(f"{name}: {error}", file=sys.stderr)
            return [math.nan] * (1 + len(SCALES))
        if scale == 1:
            seconds.append(time.perf_counter() - begun)
        found.append(psnr(raster, np.clip(render(result.scene, width, height), 0, 1)))
    return [*found[: len(SCALES)], statistics.median(seconds)]


def cells(values: np.ndarray) -> list[str]:
    """Return the cells of a line: PSNR and bytes a shape, then four numbers of each renderer."""
    texts = [f"{values[0]:.1f}", f"{values[1]:.0f}, {values[2]:.1f}"]
    for *decibels, seconds in values[3:].reshape(-1, 1 + len(SCALES)):
        text = f"{' / '.join(f'{db:.1f}' for db in decibels)}, {seconds:.2f} s"
        texts.append("-" if math.isnan(seconds) else text)
    return texts


def main() -> None:
    """Parse the command line, print the table."""
    parser = command_line(__doc__)
    parser.add_argument("pictures", nargs="+")
    parser.add_argument("--counts", default="2000,10000")
    parser.add_argument("--renderers", nargs="+", choices=RENDERERS, default=list(RENDERERS))
    given = parser.parse_args()
    versions = installed(given.renderers)
    by_form = {GRADIENT: "resvg"}
    if for_blurs := [name for name in DRAW_ROTATED_BLURS if name in versions]:
        by_form[BLUR] = for_blurs[0]
    shown = list(pictures(given.pictures))
    names = [f"{version}: 1x / 2x / 0.5x dB" for version in versions.values()]
    print(head(["form", "shapes", "picture", "dB", "bytes a shape, gzipped", *names]))
    for (form, renderer), count in product(by_form.items(), map(int, given.counts.split(","))):
        rows = []
        for picture in shown:
            result = vectorized(picture.pixels, form=form, gaussians=count, renderer=renderer)
            sizes = [result.report[key] / len(result.scene) for key in ("svg_bytes", "svgz_bytes")]
            row = [psnr(result.raster, picture.pixels), *sizes]
            row += [number for name in versions for number in measured(result, name)]
            rows.append(row)
            print(line([form, count, picture.name, *cells(np.array(row))]), flush=True)
        print(line([form, count, "mean", *cells(np.mean(rows, axis=0))]))


if __name__ == "__main__":
    main()
