"""Fidelity of crisp rims in SVG renderers: gradients, and plain ellipses beside them.

    python benchmarks/rims.py [--only gradients plain fits] [--renderers resvg cairo ...]

Shapes of several exponents, sigmas and aspects are written as SVG and rasterised by the renderers
that are named, by default all that are installed. A rim is 2.18 sigma_minor / beta px wide at 1x;
across it the falloff goes from 0.9 to 0.1. The tables:

    gradients  rasters at 1x, 2x and 4x against the model at pixel centres, over pixels on the rim
               and beside it: PSNR in dB, then the largest error in levels of 255. Sets of shapes
               (exponent, rim, aspect) that a file has as plain ellipses at 1x are left out, and
               `sets` counts the others. The 8 stops of the gradients alone give 51 to 57 dB:
               values near that are no fault of the renderer. From 0.7 px on a circle is no larger
               than its gradient, and its own edge cuts into the rim at 1x.
    plain      the same shapes forced to a gradient and to a plain ellipse at 1x, exponents from
               3 on: squared error in 1/1000 px per px of rim, at full contrast, against the
               mean of the model over each pixel (m:) and the model at its centre (c:). At the
               end of a row are the exponents whose shapes a file has as plain ellipses.
    fits       fitted pictures of 1000 shapes, of which `plain` are plain ellipses: PSNR in dB of
               rasters at 1x, 2x and 4x against the model of the quantised scene.
"""

from __future__ import annotations

import argparse
import math
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce
from itertools import product
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation
from scipy.special import ellipe
from skimage import data

from gauss2svg import FitOptions, RendererError, Scene, SvgFormat, quantize, write_svg
from gauss2svg.fit.fit import fit
from gauss2svg.fit.options import FitConfig
from gauss2svg.measure import metrics
from gauss2svg.photo.load import load_image
from gauss2svg.raster import RENDERERS, rasterize, renderer_version
from gauss2svg.render import render
from gauss2svg.scene.falloff import BETA_CLASSES, RIM_WIDTH, cut_radius
from gauss2svg.svg.plain_ellipse import is_plain

Pixels = NDArray[np.floating]

_RIMS = 0.25, 0.35, 0.5, 0.7, 1.0, 2.0, 4.0  # px
_PLAIN_RIMS, _PLAIN_BETAS = _RIMS[1:6], BETA_CLASSES[2:]
_ASPECTS = 1, 4
_SCALES = 1, 2, 4
_TURN = math.radians(30)
_LEAST_SIGMA, _MOST_SIGMA = 0.35, 150.0
_INK, _PAPER = np.array([32, 48, 96]) / 255, np.array([240, 240, 224]) / 255
_OPACITIES = 1.0, 0.5
_MARGIN = 3  # px around a shape
_LENGTH = 300  # px: least rim of a set, if 24 shapes have it
_FINE = 8  # samples along each side of a pixel, for its mean
_EXACT = SvgFormat(stops=8, precision=0.001, opacity_decimals=6)
_WRITTEN = SvgFormat(stops=8, precision=0.01)
_GAUSSIANS = 1000


@dataclass(frozen=True)
class Row:
    """A set of shapes of one exponent, rim and aspect, side by side on a canvas of their own.

    length  of all rims in px, each weighted by its squared opacity
    """

    rim: float
    aspect: int
    scene: Scene
    length: float
    plain: bool


def rows_of(beta: float, rims: tuple[float, ...]) -> Iterator[Row]:
    """Every rim and aspect of an exponent."""
    axes = np.array([[math.cos(_TURN), -math.sin(_TURN)], [math.sin(_TURN), math.cos(_TURN)]])
    for aspect, rim in product(_ASPECTS, rims):
        minor = rim * beta / RIM_WIDTH
        if minor < _LEAST_SIGMA or minor * aspect > _MOST_SIGMA:
            continue
        covariance = axes @ np.diag([(minor * aspect) ** 2, minor**2]) @ axes.T
        sigma = np.sqrt(np.diag(covariance))
        half = np.ceil(sigma * cut_radius(beta) + _MARGIN)
        perimeter = math.sqrt(2) * 4 * minor * aspect * ellipe(1 - aspect**-2)
        count = 2 * math.ceil(np.clip(_LENGTH / perimeter, 2, 24) / 2)
        place = np.stack([np.arange(count) * 2 + 1, np.ones(count)], axis=1) * half
        opacity = np.resize(_OPACITIES, count)
        scene = Scene(
            width=2 * half[0] * count,
            height=2 * half[1],
            mean=place + np.random.default_rng(0).uniform(-0.5, 0.5, (count, 2)),
            sigma=np.tile(sigma, (count, 1)),
            rho=np.full(count, covariance[0, 1] / sigma.prod()),
            color=np.tile(_INK, (count, 1)),
            opacity=opacity,
            background=_PAPER,
            beta=np.full(count, beta),
        )
        length = perimeter * float(np.square(opacity).sum())
        yield Row(rim, aspect, scene, length, bool(is_plain(scene).all()))


def sheet_of(rows: list[Row]) -> Scene:
    """All rows, one under the other, on one canvas."""
    scenes = [row.scene for row in rows]
    tops = np.cumsum([0.0, *(s.height for s in scenes)])
    moved = [s.replace(mean=s.mean + [0, top]) for s, top in zip(scenes, tops, strict=False)]
    width = max(s.width for s in scenes)
    return reduce(Scene.concatenate, moved).replace(width=width, height=tops[-1])


def bands(rows: list[Row], pixels: Pixels, scale: int = 1) -> Iterator[tuple[Row, Pixels]]:
    """Each row, and its part of a rasterised sheet."""
    ends = np.cumsum([round(row.scene.height) for row in rows]) * scale
    return zip(rows, np.split(pixels, ends[:-1]), strict=True)


def installed() -> list[str]:
    """Names of the renderers; prints those that are missing."""
    missing = []
    for name in RENDERERS:
        try:
            renderer_version(name)
        except RendererError:
            missing.append(name)
    if missing:
        print(f"skipped, not installed: {', '.join(missing)}")
    return [name for name in RENDERERS if name not in missing]


def raster_of(name: str, svg: str, scene: Scene, scale: int) -> Pixels:
    """The SVG of a scene by a renderer, at `scale` times its size."""
    return rasterize(svg, round(scene.width) * scale, round(scene.height) * scale, name)


def model(scene: Scene, scale: int = 1) -> Pixels:
    """The scene at pixel centres, at `scale` times its size."""
    return render(scene, round(scene.width) * scale, round(scene.height) * scale, np.float64)


def print_head(labels: str, renderers: list[str], columns: list[str], end: str = "") -> None:
    """The names of renderers, and under each the same columns."""
    line = "".join(columns)
    print(" " * len(labels) + "".join(f" |{name:^{len(line)}}" for name in renderers))
    print(labels + f" |{line}" * len(renderers) + end)


def print_gradients(renderers: list[str]) -> None:
    """Print the errors of shapes that a file has as gradients."""
    errors: defaultdict[tuple[object, ...], list[Pixels]] = defaultdict(list)
    plain: defaultdict[float, list[bool]] = defaultdict(list)
    for beta in BETA_CLASSES:
        for row in rows_of(beta, _RIMS):
            plain[row.rim].append(row.plain)
        rows = [row for row in rows_of(beta, _RIMS) if not row.plain]
        scene = sheet_of(rows)
        bare = scene.replace(opacity=np.ones(len(scene)))
        svg = write_svg(scene, _EXACT)
        for scale in _SCALES:
            share = ((_PAPER - model(bare, scale)) / (_PAPER - _INK))[:, :, :1]
            near = binary_dilation((share > 0.01) & (share < 0.99), np.ones((3, 3, 1)))
            truth = np.where(near, model(scene, scale), np.nan)
            for name in renderers:
                for row, off in bands(rows, raster_of(name, svg, scene, scale) - truth, scale):
                    errors[name, scale, row.rim].append(off[~np.isnan(off)])
    print("\nGradients against the model at pixel centres, near the rim: dB, largest error\n")
    print_head(f"{'rim':5}{'sets':>10}", renderers, [f"{scale:>8}x" for scale in _SCALES])
    for rim in _RIMS:
        line = f"{rim:<5g}{f'{plain[rim].count(False)} of {len(plain[rim])}':>10}"
        for name in renderers:
            line += " |"
            for scale in _SCALES:
                off = np.concatenate(errors[name, scale, rim])
                decibels = -10 * math.log10(np.mean(np.square(off)))
                line += f"{decibels:>6.1f}{np.abs(off).max() * metrics.LEVELS:>3.0f}"
        print(line)


def print_plain(renderers: list[str]) -> None:
    """Print the errors of gradients and of plain ellipses."""
    sums: defaultdict[tuple[object, ...], float] = defaultdict(float)
    plain: defaultdict[tuple[object, ...], list[str]] = defaultdict(list)
    contrast = float(np.sum(np.square(_INK - _PAPER)))
    offsets = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    for beta in _PLAIN_BETAS:
        rows = list(rows_of(beta, _PLAIN_RIMS))
        scene = sheet_of(rows)
        fine = (model(scene.replace(mean=scene.mean + s)) for s in product(offsets, offsets))
        truths = {"means": sum(fine) / _FINE**2, "centres": model(scene)}
        for row in rows:
            sums[row.aspect, row.rim] += row.length * contrast / 1000
            plain[row.aspect, row.rim] += [f"{beta:g}"] if row.plain else []
        for way, forced in (("grad", np.zeros), ("plain", np.ones)):
            decision = forced(len(scene), bool)
            with patch("gauss2svg.svg.encode.is_plain", return_value=decision):
                svg = write_svg(scene, _EXACT)
            for name in renderers:
                raster = raster_of(name, svg, scene, 1)
                for against, truth in truths.items():
                    for row, squares in bands(rows, np.square(raster - truth)):
                        sums[name, against, way, row.aspect, row.rim] += float(squares.sum())
    print("\nGradient and plain ellipse: squared error in 1/1000 px per px of rim, at 1x\n")
    kinds = list(product(("means", "centres"), ("grad", "plain")))
    columns = [f"{against[0]}:{way}".rjust(9) for against, way in kinds]
    print_head(f"{'aspect':6}{'rim':>5}", renderers, columns, " | plain in a file")
    for place in product(_ASPECTS, _PLAIN_RIMS):
        line = f"{place[0]:>6}{place[1]:>5g}"
        for name in renderers:
            line += " |" + "".join(f"{sums[name, *k, *place] / sums[place]:>9.1f}" for k in kinds)
        print(f"{line} | {', '.join(plain[place]) or '-'}")


def print_fits(renderers: list[str]) -> None:
    """Print the PSNR of fitted pictures by each renderer."""
    print(f"\nFits of {_GAUSSIANS} shapes against the model of the quantised scene, dB\n")
    labels = f"{'picture':10}{'falloff':9}{'plain':>6}"
    print_head(labels, renderers, [f"{scale:>6}x" for scale in _SCALES])
    kinds = FitOptions(falloff="gaussian"), FitOptions(falloff="adaptive")
    for picture, kind in product(("logo", "astronaut"), kinds):
        pixels = load_image(getattr(data, picture)()).pixels
        fitted = fit(pixels, FitConfig(gaussians=_GAUSSIANS, fit=kind)).scene
        scene, svg = quantize(fitted), write_svg(fitted, _WRITTEN)
        line = f"{picture:10}{kind.falloff:9}{is_plain(scene).sum():>6}"
        models = [(scale, model(scene, scale)) for scale in _SCALES]
        for name in renderers:
            found = (metrics.psnr(raster_of(name, svg, scene, k), truth) for k, truth in models)
            line += " |" + "".join(f"{value:>7.1f}" for value in found)
        print(line, flush=True)


_TABLES = {"gradients": print_gradients, "plain": print_plain, "fits": print_fits}


def main() -> None:
    """Parse the command line, print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", nargs="+", choices=_TABLES, default=list(_TABLES))
    parser.add_argument("--renderers", nargs="+", choices=RENDERERS)
    arguments = parser.parse_args()
    renderers = arguments.renderers or installed()
    for name in arguments.only:
        _TABLES[name](renderers)


if __name__ == "__main__":
    main()
