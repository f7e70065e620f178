"""Pictures in 3, 6 and 12 inks, beside vtracer's of the same inks and of as many bytes.

    python benchmarks/inks.py [--bytes 20000] [--counts 3,6,12] [--only NAME,...] [--kodak FOLDER]
        [--sheet FOLDER] [--json FILE]

vtracer gets the picture with the nearest ink at each pixel, so that it has the same colours, and
its paths are filled by the nearest ink again where it mixed them. Of a grid of its settings the
file counts whose PSNR is the highest among those of at most as many bytes. One line each: PSNR and
SSIM of the raster against the picture, those of the nearest inks, bytes, colours of the file and of
the raster away from edges, groups of one ink, seconds of CPU. FOLDER gets a sheet for each picture:
its inks at the picture's size and a square of it at three times that.
"""

from __future__ import annotations

import argparse
import json
import re
import time
from dataclasses import asdict, dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from common import eight_bits, largest_square, vectorized
from drawn_pictures import own_pictures
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import maximum_filter, minimum_filter
from skimage import data
from small import of_another_tool

from gauss2svg.files import as_png
from gauss2svg.measure.metrics import psnr, ssim
from gauss2svg.photo.alpha import shrunk
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.run import compile_kernels
from gauss2svg.raster import rasterize
from gauss2svg.scene.inks import ink_colors, inks_of
from gauss2svg.scene.nearest import nearest_entry

Pixels = NDArray[np.float32]

_SHIPPED, _DRAWN = ("coffee", "chelsea"), ("icon", "face", "buttons", "screenshot")
_KODAK = "kodim20.png"
_GRID = {
    "mode": ("spline", "polygon"),
    "filter_speckle": (1, 2, 4, 8, 16, 32, 64),
}
_SCALES = (1.0, 0.5)  # of the picture that vtracer gets
_FILL = re.compile(r'fill="(#[0-9A-Fa-f]{6})"')
_SQUARE, _ZOOM, _LABEL = 96, 3, 16  # px of a sheet's square, its scale, px of text


@dataclass(frozen=True)
class Row:
    """A picture in inks by one tool; file_colors and flat_colors are those of file and raster."""

    picture: str
    inks: int
    tool: str
    psnr: float
    ssim: float
    svg_bytes: int
    file_colors: int
    flat_colors: int
    groups: int
    seconds: float
    svg: str = field(repr=False)
    raster: Pixels = field(repr=False)


def pictures(kodak: Path | None) -> dict[str, Pixels]:
    """Name and picture (h, w, 3) in 0..1."""
    found = {name: load_image(getattr(data, name)()).pixels for name in _SHIPPED}
    if kodak is not None:
        found["kodim20"] = load_image(kodak / _KODAK).pixels
    drawn = dict(own_pictures())
    return found | {name: drawn[name] for name in _DRAWN}


def ours(name: str, picture: Pixels, inks: str, limit: int) -> Row:
    """The picture in these inks and at most so many bytes."""
    begun = time.process_time()
    result = vectorized(picture, inks=inks, max_bytes=limit, markup="minimal")
    raster, seconds = result.raster, time.process_time() - begun
    groups = 1 + int((np.diff(result.scene.color, axis=0) != 0).any(axis=1).sum())
    return _row(name, "gauss2svg", picture, inks, result.svg, raster, groups, seconds)


def traced(name: str, picture: Pixels, inks: str, limit: int) -> Row | None:
    """The best file that vtracer makes of these inks, of at most so many bytes."""
    import vtracer  # pyright: ignore[reportMissingImports]

    best, (height, width) = None, picture.shape[:2]
    for scale, *values in product(_SCALES, *_GRID.values()):
        png = as_png(in_inks(shrunk(picture, round(scale * height), round(scale * width)), inks))
        settings: Any = dict(zip(_GRID, values, strict=True))
        begun = time.process_time()
        svg = vtracer.convert_raw_image_to_svg(
            png, img_format="png", color_precision=8, layer_difference=0, path_precision=0,
            **settings,
        )  # fmt: skip
        seconds = time.process_time() - begun
        svg = _FILL.sub(lambda found: f'fill="{_nearest_name(found[1], inks)}"', svg)
        if len(svg.encode()) > limit:
            continue
        raster = of_another_tool(svg, picture)
        row = _row(name, "vtracer", picture, inks, svg, raster, svg.count("<path"), seconds)
        if best is None or row.psnr > best.psnr:
            best = row
    return best


def in_inks(picture: Pixels, inks: str) -> Pixels:
    """The picture with the nearest ink at each pixel."""
    colors = ink_colors(inks)
    entry = nearest_entry(colors, picture.reshape(-1, 3).astype(np.float64))[1]
    return colors[entry].reshape(picture.shape).astype(np.float32)


def _nearest_name(color: str, inks: str) -> str:
    entry = nearest_entry(ink_colors(inks), ink_colors(color))[1]
    return inks.split(",")[int(entry[0])]


def _row(
    name: str,
    tool: str,
    picture: Pixels,
    inks: str,
    svg: str,
    raster: Pixels,
    groups: int,
    seconds: float,
) -> Row:
    return Row(
        picture=name,
        inks=inks.count(",") + 1,
        tool=tool,
        psnr=psnr(raster, picture),
        ssim=ssim(raster, picture),
        svg_bytes=len(svg.encode()),
        file_colors=len(set(re.findall(r"#[0-9A-Fa-f]{3,6}\b", svg))),
        flat_colors=_flat_colors(raster),
        groups=groups,
        seconds=seconds,
        svg=svg,
        raster=raster,
    )


def _flat_colors(raster: Pixels) -> int:
    """Colours of the pixels that are as their eight neighbours."""
    levels = np.round(raster * 255).astype(np.uint8)
    size = (3, 3, 1)
    flat = (maximum_filter(levels, size) == minimum_filter(levels, size)).all(axis=2)
    return len(np.unique(levels[flat], axis=0))


def sheet(picture: Pixels, rows: list[Row]) -> Image.Image:
    """A line of each number of inks: the picture, ours, vtracer's, and a square of each at 3x."""
    height, width = picture.shape[:2]
    side = _SQUARE * _ZOOM
    font = ImageFont.load_default(11)
    counts = sorted({row.inks for row in rows})
    tall = max(height, side) + _LABEL
    page = Image.new("RGB", (3 * (width + side + 8), len(counts) * (tall + 4)), "#808080")
    error = np.square(rows[0].raster - picture).sum(axis=2)
    top, left = largest_square(error, _SQUARE)
    near = eight_bits(picture[top : top + _SQUARE, left : left + _SQUARE])
    near = near.resize((side, side), Image.Resampling.BICUBIC)
    for line, count in enumerate(counts):
        panels = [("the picture", eight_bits(picture), near)]
        for row in (row for row in rows if row.inks == count):
            label = f"{row.tool}, {count} inks: {row.psnr:.2f} dB, {row.svg_bytes} bytes"
            if row.tool == "gauss2svg":
                large = rasterize(row.svg, width * _ZOOM, height * _ZOOM)
            else:
                blank = np.zeros((height * _ZOOM, width * _ZOOM, 3), np.float32)
                large = of_another_tool(row.svg, blank)
            y, x = top * _ZOOM, left * _ZOOM
            square = eight_bits(large[y : y + side, x : x + side])
            panels.append((label, eight_bits(row.raster), square))
        for column, (label, whole, square) in enumerate(panels):
            x, y = column * (width + side + 8), line * (tall + 4)
            ImageDraw.Draw(page).text((x + 2, y + 1), label, "#ffffff", font)
            page.paste(whole, (x, y + _LABEL))
            page.paste(square, (x + width + 4, y + _LABEL))
    return page


def main() -> None:
    """Parse the command line, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--bytes", type=int, default=20_000)
    parser.add_argument("--counts", default="3,6,12")
    parser.add_argument("--only")
    parser.add_argument("--kodak", type=Path)
    parser.add_argument("--sheet", type=Path)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    found = pictures(options.kodak)
    names = options.only.split(",") if options.only else list(found)
    compile_kernels()
    print(
        f"{'picture':11}{'inks':>5} {'tool':10}{'dB':>7}{'SSIM':>7}{'nearest dB':>11}{'bytes':>7}"
        f"{'in file':>8}{'in raster':>10}{'groups':>7}{'s':>6}"
    )
    every: list[Row] = []
    for name in names:
        picture, rows = found[name], list[Row]()
        for count in map(int, options.counts.split(",")):
            inks = inks_of(picture, count)
            nearest = psnr(in_inks(picture, inks), picture)
            for tool in (ours, traced):
                row = tool(name, picture, inks, options.bytes)
                if row is None:
                    print(f"{name:11}{count:>5} {'vtracer':10} no file is so small")
                    continue
                rows.append(row)
                print(
                    f"{name:11}{count:>5} {row.tool:10}{row.psnr:>7.2f}{row.ssim:>7.3f}"
                    f"{nearest:>11.2f}{row.svg_bytes:>7}{row.file_colors:>8}{row.flat_colors:>10}"
                    f"{row.groups:>7}{row.seconds:>6.1f}",
                    flush=True,
                )
        if options.sheet:
            options.sheet.mkdir(parents=True, exist_ok=True)
            sheet(picture, rows).save(options.sheet / f"{name}.png")
        every += rows
    if options.json:
        numbers = [
            {k: v for k, v in asdict(row).items() if k not in ("svg", "raster")} for row in every
        ]
        options.json.write_text(json.dumps(numbers, indent=1) + "\n")


if __name__ == "__main__":
    main()
