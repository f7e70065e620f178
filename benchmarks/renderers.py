"""Fidelity and speed of each renderer for each form of a file, and the file sizes.

    python benchmarks/renderers.py PHOTOS... [--counts 2000,10000] [-o FILE.md]
        [--renderers resvg cairo ...] [--presets]

The script prints Markdown, or writes it to FILE.md table by table; the default PHOTOS are two
pictures that scikit-image ships. The text above each table is the docstring of its function below.
The tables say where a renderer is not installed, is refused or failed. --renderers selects some:
Inkscape takes up to a minute for a large file of blurs. --presets adds the presets at 5000
Gaussians.
"""

from __future__ import annotations

import argparse
import dataclasses
import inspect
import math
import platform
import re
import statistics
import sys
import time
from collections.abc import Iterator
from contextlib import nullcontext
from functools import cache, partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from common import vectorized
from numpy.typing import NDArray
from skimage import data

from gauss2svg import RendererError, Result, __version__
from gauss2svg.compare.records import machine
from gauss2svg.measure import metrics
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.presets import PRESETS
from gauss2svg.raster import (
    DRAW_ROTATED_BLURS,
    RENDERERS,
    rasterize,
    refuse_unsupported,
    renderer_version,
)
from gauss2svg.render import render
from gauss2svg.svg.blur import BLUR, GRADIENT
from gauss2svg.svg.file import bytes_by_part, file_bytes

Pixels = NDArray[np.floating]
Row = dict[str, Any]  # heading to number, text, or a tuple of numbers
Fits = dict[tuple[str, int], dict[str, Result]]  # form and count to photo to fit

_FORMS = (GRADIENT, BLUR)
_OWN, _FAILED = "own gradients", "failed"
_RUNS = 3

say = partial(print, file=sys.stderr, flush=True)  # progress, apart from the tables


@cache
def version_of(name: str) -> str | None:
    """Name and version of a renderer, None if it is not installed."""
    try:
        return renderer_version(name)
    except RendererError:
        return None


def refusal(name: str, svg: str) -> str:
    """Why a renderer is not used for an SVG, or ""."""
    try:
        refuse_unsupported(svg, name)
    except RendererError:
        return "refused" if version_of(name) else "not installed"
    return "" if version_of(name) else "not installed"


def raster_of(name: str, svg: str, width: int, height: int) -> Pixels | None:
    """The SVG by a renderer; None, after a message, where it fails."""
    try:
        return rasterize(svg, width, height, name)
    except RendererError as error:
        say(f"  {name} failed: {error}")
        return None


def decibels(name: str, svg: str, *truths: Pixels) -> list[float | str]:
    """PSNR of an SVG by a renderer against pictures of one size, or why there is none."""
    height, width = truths[0].shape[:2]
    if reason := refusal(name, svg):
        return [reason] * len(truths)
    say(f"  {name}, {width}x{height}")
    raster = raster_of(name, svg, width, height)
    if raster is None:
        return [_FAILED] * len(truths)
    return [metrics.psnr(raster, truth) for truth in truths]


def model(result: Result, scale: float = 1) -> Pixels:
    """The scene at pixel centres, at `scale` times its size."""
    width, height = (round(side * scale) for side in (result.scene.width, result.scene.height))
    return np.clip(render(result.scene, width, height), 0, 1)


def mean(rows: list[Row]) -> Row:
    """Means of rows; of a column with texts, the first text."""
    columns = {heading: [row[heading] for row in rows] for heading in rows[0]}
    texts = {h: [v for v in column if isinstance(v, str)] for h, column in columns.items()}
    return {h: texts[h][0] if texts[h] else statistics.fmean(c) for h, c in columns.items()}


def numbers(result: Result) -> Row:
    """PSNR of a report, infinite for equal pictures, and bytes per Gaussian."""
    report = result.report
    found = {"to photo": report["psnr_svg"], "to model": report["psnr_roundtrip"]}
    row = {heading: math.inf if value is None else value for heading, value in found.items()}
    sizes = {"B": report["svg_bytes"], "B gzipped": report["svgz_bytes"]}
    sizes |= {f"B {part}": size for part, size in report.get("bytes_by_part", {}).items()}
    per_gaussian = {h: size / max(1, report["gaussians"]) for h, size in sizes.items()}
    return row | {"gradients": report["gradients"]} | per_gaussian


def unshared(result: Result) -> Result:
    """The same with a gradient of its own for each shape."""
    defined = re.compile(r"<radialGradient[^>]* id=\"(\w+)\".*?</radialGradient>")
    gradients = {found[1]: found[0] for found in defined.finditer(result.svg)}
    own: list[str] = []

    def renamed(fill: re.Match[str]) -> str:
        own.append(gradients[fill[1]].replace(f' id="{fill[1]}"', f' id="own{len(own)}"'))
        return f'fill="url(#own{len(own) - 1})"'

    shapes = re.sub(r"fill=\"url\(#(\w+)\)\"", renamed, defined.sub("", result.svg))
    svg = shapes.replace("</defs>", f"{''.join(own)}</defs>")
    sizes = {"svg_bytes": len(svg), "svgz_bytes": len(file_bytes(svg, gzipped=True))}
    more = {"gradients": len(own), "bytes_by_part": bytes_by_part(svg)}
    return dataclasses.replace(result, svg=svg, report=result.report | sizes | more)


def fidelity(fits: Fits, renderers: list[str]) -> list[Row]:
    """Fidelity: PSNR in dB of the rasterised SVG against the model at the photo's pixel centres.

    Each form has a fit of its own. "To photo" is of the file by resvg; with blurred shapes, by the
    first of Chromium, Firefox and Inkscape that is installed.
    """
    rows = []
    for (form, count), results in fits.items():
        say(f"fidelity: {form}, {count}")
        found = []
        for result in results.values():
            truth = model(result)
            row = {name: decibels(name, result.svg, truth)[0] for name in renderers}
            found.append({"to photo": numbers(result)["to photo"]} | row)
        for photo, row in zip((*results, "**mean**"), (*found, mean(found)), strict=True):
            rows.append({"form": form, "Gaussians": count, "photo": photo} | row)
    return rows


def zoom(fits: Fits, renderers: list[str]) -> list[Row]:
    """Zoom: PSNR in dB of rasters at 2x and 0.5x, first count, mean over photos.

    The model is sampled at the pixel centres of each size. At 0.5x these may miss a shape under a
    pixel, which the means of 2x2 px of the model at 1x include; the last column involves no
    renderer.
    """
    rows = []
    first = next(count for _, count in fits)
    zooming = [name for name in ("chromium", "firefox", "resvg") if name in renderers]
    for form, name in product(_FORMS, zooming):
        found: list[Row] = []
        for result in fits.get((form, first), {}).values():
            full, half, double = (model(result, scale) for scale in (1, 0.5, 2))
            area = np.mean([full[i::2, k::2] for i, k in product((0, 1), (0, 1))], axis=0)
            to_half, to_area = decibels(name, result.svg, half, area)
            row: Row = {"2x to model at 2x": decibels(name, result.svg, double)[0]}
            row |= {"0.5x to model at 0.5x": to_half, "0.5x to 2x2 means of model": to_area}
            found.append(row | {"model at 0.5x to 2x2 means": metrics.psnr(half, area)})
        rows += [{"form": form, "renderer": name} | mean(found)] if found else []
    return rows


def seconds(fits: dict[str, Result], renderers: list[str]) -> list[Row]:
    """Rendering time: median seconds of three runs / ratio to the gradient form's.

    The file is that of the first photo at the first count; bytes are per Gaussian, dB those of the
    fit's report. Chromium stays open and takes the mean of four positions; librsvg, Firefox and
    Inkscape start anew for each raster. "Own gradients" has a gradient of 8 stops for each shape.
    """
    rows: dict[str, Row] = {form: {"form": form} | numbers(fit) for form, fit in fits.items()}
    width, height = (fits[GRADIENT].report[side] for side in ("width", "height"))
    for name in renderers:
        say(f"seconds: {name}")
        reasons = {form: refusal(name, fit.svg) for form, fit in fits.items()}
        times: dict[str, list[float]] = {form: [] for form in fits if not reasons[form]}
        # Alternating, so that a disturbance hits all forms; a browser starts in the first round.
        for form, taken in list(times.items()) * (1 + _RUNS):
            begun = time.perf_counter()
            if not reasons[form] and raster_of(name, fits[form].svg, width, height) is None:
                reasons[form] = _FAILED
            taken.append(time.perf_counter() - begun)
        medians = {form: statistics.median(taken[1:]) for form, taken in times.items()}
        for form, reason in reasons.items():
            # A ratio needs the gradient form's time.
            alone = reasons[GRADIENT]
            rows[form][name] = reason or (medians[form], alone or medians[form] / medians[GRADIENT])
    return list(rows.values())


def presets(photos: dict[str, Pixels], count: int | None = None) -> list[Row]:
    """Presets: the gradient form, dB by resvg, mean over photos; bytes are per Gaussian."""
    rows = []
    for quality in PRESETS:
        say(f"preset {quality}")
        fits = [vectorized(p, quality=quality, gaussians=count) for p in photos.values()]
        counted = [{"Gaussians": len(fit.scene)} | numbers(fit) for fit in fits]
        rows.append({"quality": quality} | mean(counted))
    return rows


def cell(value: Any) -> str:
    """A cell of a table: fractions with three digits."""
    if isinstance(value, tuple):
        return " / ".join(map(cell, value))
    if isinstance(value, float) and math.isfinite(value):
        return f"{value:#.3g}".rstrip(".") if abs(value) < 999.5 else f"{value:.0f}"
    return "equal" if value == math.inf else str(value)


def markdown(rows: list[Row]) -> str:
    """Rows as a table."""
    lines = [list(rows[0]), ["---"] * len(rows[0]), *([cell(v) for v in r.values()] for r in rows)]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def load(picture: Path | str) -> Pixels:
    """A photo by its path or its name in scikit-image, cropped to even sides for 2x2 means."""
    pixels = load_image(picture if isinstance(picture, Path) else getattr(data, picture)()).pixels
    return pixels[: pixels.shape[0] // 2 * 2, : pixels.shape[1] // 2 * 2]


def tables(options: argparse.Namespace) -> Iterator[str]:
    """The photos, the versions and the machine, then each table with its description."""
    pictures = options.photos or ("astronaut", "coffee")
    photos = {Path(picture).stem: load(picture) for picture in pictures}
    counts, renderers = [int(count) for count in options.counts.split(",")], options.renderers
    for_blurs = next((n for n in DRAW_ROTATED_BLURS if n in renderers and version_of(n)), None)
    here = machine()
    versions = ", ".join(version_of(name) or f"{name} not installed" for name in renderers)
    yield f"# Renderers\n\n{', '.join(photos)} by gauss2svg {__version__} and {versions}; Python"
    yield f"{platform.python_version()}, {here['cpu']}, {here['cores']} cores, {here['platform']}."
    if for_blurs is None:
        yield "\nNo installed renderer supports rotated blurs: the gradient form alone."

    def fits_of(form: str, count: int) -> dict[str, Result]:
        say(f"fits: {form}, {count}")
        known: dict[str, Row] = {GRADIENT: {}, _OWN: {"palette": 0, "stops": 8}}
        options = known.get(form, {"form": form, "renderer": for_blurs}) | {"gaussians": count}
        return {photo: vectorized(pixels, **options) for photo, pixels in photos.items()}

    forms = _FORMS if for_blurs else (GRADIENT,)
    fits: Fits = {key: fits_of(*key) for key in product(forms, counts)}
    first = {form: next(iter(fits[form, counts[0]].values())) for form in forms}
    first[_OWN] = unshared(next(iter(fits_of(_OWN, counts[0]).values())))
    yield f"\n{inspect.getdoc(fidelity)}\n\n{markdown(fidelity(fits, renderers))}"
    yield f"{inspect.getdoc(zoom)}\n\n{markdown(zoom(fits, renderers))}"
    yield f"{inspect.getdoc(seconds)}\n\n{markdown(seconds(first, renderers))}"
    yield f"{inspect.getdoc(presets)}\n\n{markdown(presets(photos))}"
    if options.presets:
        yield f"The presets with 5000 Gaussians each.\n\n{markdown(presets(photos, 5000))}"


def main() -> None:
    """Parse the command line, print or write the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("photos", nargs="*", type=Path, metavar="PHOTOS")
    parser.add_argument("--counts", default="2000,10000")
    parser.add_argument("--renderers", nargs="+", choices=RENDERERS, default=list(RENDERERS))
    parser.add_argument("--presets", action="store_true")
    parser.add_argument("-o", "--output", type=Path)
    options = parser.parse_args()
    with options.output.open("w") if options.output else nullcontext(sys.stdout) as out:
        for text in tables(options):
            print(text, file=out, flush=True)


if __name__ == "__main__":
    main()
