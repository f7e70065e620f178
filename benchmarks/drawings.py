"""Drawings instead of photos: icons, logos, line art and text, with each falloff.

    python benchmarks/drawings.py [--counts 32,128,512,2000] [--only NAME,...]
        [--falloffs gaussian,adaptive] [--sheet FOLDER] [--json FILE]

The script prints one line per picture and count: for each falloff the PSNR of the rasterised SVG,
its error over flat areas (`gauss2svg.measure.metrics.flat_error`, levels of 255), its bytes plain
and gzipped, and the seconds. Below are vtracer's settings, if it is installed, and at the end the
means. FOLDER gets one sheet per picture: the 64 px square where the first falloff is worst, at
four times the size.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
from common import eight_bits, largest_square, vectorized
from drawn_pictures import own_pictures
from numpy.typing import NDArray
from paper.table import traced
from PIL import Image, ImageDraw, ImageFont
from skimage import data

from gauss2svg.compare.peers import PEERS
from gauss2svg.compare.records import finite
from gauss2svg.measure import metrics
from gauss2svg.photo.load import load_image
from gauss2svg.raster import rasterize
from gauss2svg.svg.file import file_bytes

Pixels = NDArray[np.float32]

_SHIPPED = ("logo", "coins", "horse", "text", "page")  # in scikit-image's wheel: no download
_COUNTS, _FALLOFFS = "32,128,512,2000", "gaussian,adaptive"
_CROP, _ZOOM, _LABEL = 64, 4, 16  # px of a sheet's square, its scale, px of text
_CHOOSING = 512  # Gaussians of the SVG whose error chooses the square
_COLUMNS = f"{'PSNR':>7}{'flat':>7}{'bytes':>8}{'gzipped':>8}{'s':>6}"


@dataclass(frozen=True)
class Row:
    """One SVG of one picture.

    tool    a falloff, or "vtracer" with its setting
    count   Gaussians requested, or vtracer's paths
    psnr    dB of the rasterised SVG against the picture
    flat    its error over flat areas, levels of 255
    """

    picture: str
    tool: str
    count: int
    width: int
    height: int
    psnr: float
    flat: float
    svg_bytes: int
    svgz_bytes: int
    seconds: float
    svg: str = field(repr=False)


def drawings() -> Iterator[tuple[str, Pixels]]:
    """Name and picture (h, w, 3) in 0..1, on 8 bits; transparent ones over white."""
    for name in _SHIPPED:
        yield name, load_image(getattr(data, name)()).pixels
    yield from own_pictures()


def fitted(name: str, pixels: Pixels, count: int, falloff: str) -> Row:
    """The picture with `count` Gaussians."""
    result = vectorized(pixels, gaussians=count, falloff=falloff)
    seconds = result.report["total_s"]
    return _row(name, falloff, count, pixels, result.svg, result.raster, seconds)


def peer_rows(name: str, pixels: Pixels) -> Iterator[Row]:
    """The picture by vtracer, with each of its settings."""
    for settings in PEERS["vtracer"].settings:
        svg, raster, seconds = traced(pixels, **settings)
        tool = " ".join(["vtracer", *settings.values()])
        yield _row(name, tool, svg.count("<path"), pixels, svg, raster, seconds)


def _row(
    name: str, tool: str, count: int, pixels: Pixels, svg: str, raster: Pixels, seconds: float
) -> Row:
    return Row(
        picture=name,
        tool=tool,
        count=count,
        width=pixels.shape[1],
        height=pixels.shape[0],
        psnr=metrics.psnr(raster, pixels),
        flat=metrics.flat_error(raster, pixels),
        svg_bytes=len(svg.encode()),
        svgz_bytes=len(file_bytes(svg, gzipped=True)),
        seconds=seconds,
        svg=svg,
    )


def _cells(row: Row) -> str:
    return (
        f"{row.psnr:>7.2f}{row.flat:>7.1f}{row.svg_bytes:>8}{row.svgz_bytes:>8}{row.seconds:>6.1f}"
    )


def _mean(rows: list[Row], value: Callable[[Row], float]) -> float:
    """Mean over the rows that have a value: not every picture has flat areas."""
    values = [v for v in map(value, rows) if not math.isnan(v)]
    return statistics.fmean(values) if values else math.nan


def print_summary(rows: list[Row], counts: list[int], falloffs: list[str]) -> None:
    """Print means over the pictures, and each falloff against the first."""
    first, *others = falloffs
    print(
        f"\nmeans{'':8}" + "".join(f"{f'PSNR {f}':>16}{f'flat {f}':>16}" for f in falloffs), end=""
    )
    print("".join(f"{f'{f} - {first}, dB':>26}{'bytes, gzipped ratio':>22}" for f in others))
    for count in counts:
        groups = {f: [r for r in rows if (r.tool, r.count) == (f, count)] for f in falloffs}
        line = f"{count:<13}"
        for group in groups.values():
            line += (
                f"{_mean(group, lambda r: r.psnr):>16.2f}{_mean(group, lambda r: r.flat):>16.1f}"
            )
        for other in others:
            pairs = list(zip(groups[other], groups[first], strict=True))
            gain = statistics.fmean(a.psnr - b.psnr for a, b in pairs)
            plain = statistics.geometric_mean(a.svg_bytes / b.svg_bytes for a, b in pairs)
            zipped = statistics.geometric_mean(a.svgz_bytes / b.svgz_bytes for a, b in pairs)
            line += f"{gain:>+26.2f}{f'{plain:.3f}, {zipped:.3f}':>22}"
        print(line)
    for tool in dict.fromkeys(row.tool for row in rows if row.tool not in falloffs):
        group = [row for row in rows if row.tool == tool]
        plain, zipped = (
            statistics.fmean(v)
            for v in zip(*((r.svg_bytes, r.svgz_bytes) for r in group), strict=True)
        )
        print(
            f"{tool:18} {_mean(group, lambda r: r.psnr):.2f} dB, flat "
            f"{_mean(group, lambda r: r.flat):.1f}, {plain:.0f} bytes, {zipped:.0f} gzipped"
        )


def sheet(pixels: Pixels, rows: list[Row], falloffs: list[str]) -> Image.Image:
    """The worst square of the picture and of each SVG, enlarged; one line per tool."""
    chooser = min(
        (row for row in rows if row.tool == falloffs[0]), key=lambda r: abs(r.count - _CHOOSING)
    )
    error = ((rasterize(chooser.svg, chooser.width, chooser.height) - pixels) ** 2).sum(axis=2)
    top, left = largest_square(error, _CROP)
    part = eight_bits(pixels[top : top + _CROP, left : left + _CROP])
    side = _CROP * _ZOOM
    original = part.resize((side, side), Image.Resampling.NEAREST)
    lines = [[row for row in rows if row.tool == falloff] for falloff in falloffs]
    lines.append([row for row in rows if row.tool not in falloffs])
    lines = [line for line in lines if line]
    width, height = 1 + max(map(len, lines)), len(lines)
    page = Image.new("RGB", (width * (side + 4), height * (side + 4 + _LABEL)), "#808080")
    font = ImageFont.load_default(11)
    for i, line in enumerate(lines):
        panels = [(f"{chooser.picture}, x {left}, y {top}", original)]
        for row in line:
            raster = rasterize(row.svg, row.width * _ZOOM, row.height * _ZOOM)
            y, x = top * _ZOOM, left * _ZOOM
            label = f"{row.tool} {row.count}: {row.psnr:.2f} dB, flat {row.flat:.1f}"
            panels.append((label, eight_bits(raster[y : y + side, x : x + side])))
        for j, (label, panel) in enumerate(panels):
            corner = (j * (side + 4) + 2, i * (side + 4 + _LABEL) + 2)
            ImageDraw.Draw(page).text(corner, label, "#ffffff", font)
            page.paste(panel, (corner[0], corner[1] + _LABEL))
    return page


def main() -> None:
    """Parse the command line, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--counts", default=_COUNTS)
    parser.add_argument("--only", help="names of pictures, between commas")
    parser.add_argument("--falloffs", default=_FALLOFFS)
    parser.add_argument("--sheet", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    counts = [int(count) for count in options.counts.split(",")]
    falloffs = options.falloffs.split(",")
    pictures = dict(drawings())
    names = options.only.split(",") if options.only else list(pictures)
    if unknown := [name for name in names if name not in pictures]:
        parser.error(f"--only must be of {', '.join(pictures)}; got {', '.join(unknown)}")
    has_vtracer = PEERS["vtracer"].version() is not None
    for falloff in falloffs:  # compile before any clock runs
        vectorized(pictures[names[0]], gaussians=10, iterations=2, falloff=falloff)
    print(f"{'':26}" + "".join(f" |{falloff:^{len(_COLUMNS)}}" for falloff in falloffs))
    print(f"{'picture':11}{'size':>9}{'count':>6}" + f" |{_COLUMNS}" * len(falloffs))
    rows: list[Row] = []
    for name in names:
        pixels = pictures[name]
        size = f"{pixels.shape[1]}x{pixels.shape[0]}"
        own: list[Row] = []
        for count in counts:
            line = [fitted(name, pixels, count, falloff) for falloff in falloffs]
            cells = "".join(f" |{_cells(row)}" for row in line)
            print(f"{name:11}{size:>9}{count:>6}{cells}", flush=True)
            own += line
        if has_vtracer:
            for row in peer_rows(name, pixels):
                print(f"  {row.tool:18}{row.count:>6} |{_cells(row)}", flush=True)
                own.append(row)
        else:
            print("  vtracer is not installed")
        if options.sheet:
            options.sheet.mkdir(parents=True, exist_ok=True)
            path = options.sheet / f"{name.replace(' ', '_')}.png"
            sheet(pixels, own, falloffs).save(path)
        rows += own
    if options.json:
        numbers = [{k: v for k, v in asdict(row).items() if k != "svg"} for row in rows]
        options.json.write_text(json.dumps(finite(numbers), indent=1, allow_nan=False) + "\n")
    print_summary(rows, counts, falloffs)


if __name__ == "__main__":
    main()
