"""Minimal markup in SVG renderers: masks beside gradients, by the number of shapes.

    python benchmarks/minimal.py [--counts 20 300 5000] [--sizes 1000 3000 20000]
                               [--renderers resvg librsvg chromium firefox]

First random soft opaque shapes of 768 x 512 px, as many as in --counts, in numbers of 0.04 px:
bytes, PSNR in dB of the raster against the model, and seconds to draw, without those of a file
without shapes. Then fits of Gaussians to a photo in files of about --sizes, on a grid of
a 64th of the longer side (1 px from 10 kB on) in colours of three digits (six): PSNR against the
rounded scene that the file draws, and against the photo.
"""

from __future__ import annotations

import argparse
import time
from unittest.mock import patch

import numpy as np
from skimage import data

from gauss2svg import FitOptions, RendererError, RunOptions, Scene, vectorize
from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize, renderer_version
from gauss2svg.render import render
from gauss2svg.svg import minimal_shapes
from gauss2svg.svg.minimal import minimal_rounded, minimal_svg

_WIDTH, _HEIGHT = 768, 512
_UNIT = 0.04
_FORMS = {"masks": 10**9, "gradients": -1}  # most_masked
_SIDE = 192  # px of the fits
_EMPTY, _BYTES_A_SHAPE, _FINE_FROM = 430, 63, 10_000


def random_scene(count: int) -> Scene:
    """Soft opaque shapes that cover the canvas about as often, whatever their number."""
    rng = np.random.default_rng(0)
    sigma = np.exp(rng.normal(np.log(0.45 * np.sqrt(_WIDTH * _HEIGHT / max(count, 1))), 0.5))
    sizes = sigma * np.exp(rng.normal(0, 0.5, (count, 2)))
    return Scene(
        _WIDTH, _HEIGHT, rng.random((count, 2)) * [_WIDTH, _HEIGHT], np.clip(sizes, 1, 200),
        rng.uniform(-0.8, 0.8, count), rng.random((count, 3)), np.ones(count), rng.random(3),
    )  # fmt: skip


def seconds(svg: str, renderer: str) -> float:
    """To draw it, the better of two."""
    times = []
    for _ in range(2):
        begun = time.perf_counter()
        rasterize(svg, _WIDTH, _HEIGHT, renderer)
        times.append(time.perf_counter() - begun)
    return min(times)


def forms(counts: list[int], renderers: list[str]) -> None:
    """Print the first table."""
    print(f"| shapes, form | bytes | {' | '.join(f'{r}, dB | s' for r in renderers)} |")
    print("|---" * (2 + 2 * len(renderers)) + "|")
    empty = {name: seconds(minimal_svg(Scene(_WIDTH, _HEIGHT), _UNIT), name) for name in renderers}
    for count in counts:
        scene = random_scene(count)
        model = render(scene, _WIDTH, _HEIGHT)
        for form, most in _FORMS.items():
            with patch.object(minimal_shapes, "MOST_MASKED", most):
                svg = minimal_svg(scene, _UNIT, 6)
            cells = [f"{count}, {form}", f"{len(svg):,}"]
            for name in renderers:
                drawn = rasterize(svg, _WIDTH, _HEIGHT, name)
                took = seconds(svg, name) - empty[name]
                cells += [f"{psnr(drawn, model):.1f}", f"{took:.2f}"]
            print(f"| {' | '.join(cells)} |", flush=True)


def sizes(limits: list[int], renderers: list[str]) -> None:
    """Print the second table."""
    photo = np.asarray(data.coffee(), np.float32) / 255
    print(
        "\n| bytes | shapes | " + " | ".join(f"{name}: model, photo" for name in renderers) + " |"
    )
    print("|---" * (2 + len(renderers)) + "|")
    for limit in limits:
        count = max(1, round((limit - _EMPTY) / _BYTES_A_SHAPE))
        found = vectorize(
            photo, quality="draft", gaussians=count, fit=FitOptions(falloff="gaussian"),
            run=RunOptions(max_size=_SIDE),
        )  # fmt: skip
        unit, digits = (1.0, 6) if limit >= _FINE_FROM else (600 / 64, 3)
        svg = minimal_svg(found.scene, unit, digits)
        model = render(minimal_rounded(found.scene, unit, digits))
        cells = [f"{len(svg):,}", str(len(found.scene))]
        for name in renderers:
            drawn = rasterize(svg, 600, 400, name)
            cells.append(f"{psnr(drawn, model):.1f}, {psnr(drawn, photo):.2f}")
        print(f"| {' | '.join(cells)} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--counts", type=int, nargs="*", default=[20, 300, 5000])
    parser.add_argument("--sizes", type=int, nargs="*", default=[1000, 3000, 20_000])
    parser.add_argument(
        "--renderers", nargs="+", default=["resvg", "librsvg", "chromium", "firefox"]
    )
    args = parser.parse_args()
    installed = []
    for name in args.renderers:
        try:
            renderer_version(name)
            installed.append(name)
        except RendererError as missing:
            print(f"left out: {missing}")
    forms(args.counts, installed)
    sizes(args.sizes, installed)


if __name__ == "__main__":
    main()
