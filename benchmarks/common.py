"""What several scripts share: pictures by their names, tables, files of other tools."""

from __future__ import annotations

import argparse
import io
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import maximum_filter, uniform_filter
from skimage import data

from gauss2svg import Result
from gauss2svg.photo.load import load_image
from gauss2svg.photo.pixels import over
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.vectorize import vectorize_by
from gauss2svg.raster import rasterize

Pixels = NDArray[np.floating]

ROOT = Path(__file__).resolve().parents[1]
PICTURES, COFFEE = ROOT / "benchmarks/pictures", ROOT / "examples/coffee.jpg"
SIDE = 256  # px of a picture that an SVG is rasterised to
_SHIPPED = ("logo", "coins", "horse", "text", "page")  # in the wheel of scikit-image: no download
_OWN = ("icon", "face", "line-art", "buttons", "screenshot")
_SETS = {
    "drawings": [*_SHIPPED, *(PICTURES / f"{name}.png" for name in _OWN)],
    "faces": [PICTURES / "smile.png", PICTURES / "bear.png"],
    "sources": sorted(PICTURES.glob("*.svg")),
}


@dataclass(frozen=True)
class Picture:
    """A picture (h, w, 3) in 0..1, and the SVG that it is of, if it is of one."""

    name: str
    pixels: Pixels = field(repr=False)
    source: str | None = field(default=None, repr=False)

    def enlarged(self, up: int) -> Pixels:
        """Return the SVG as a picture that is `up` times as large."""
        assert self.source is not None
        height, width = (up * side for side in self.pixels.shape[:2])
        return rasterize(self.source, width, height)


def pictures(names: list[str]) -> Iterator[Picture]:
    """Yield pictures by the names of sets, of scikit-image's pictures, or of files."""
    for name in [one for given in names for one in _SETS.get(given, [given])]:
        path = Path(name)
        if path.suffix == ".svg":
            source = path.read_text()
            yield Picture(path.stem, rasterize(source, SIDE, SIDE), source)
        else:
            pixels = over(load_image(path).pixels) if path.suffix else shipped(str(name))
            yield Picture(path.stem, pixels)


def shipped(name: str) -> Pixels:
    """Return a picture of scikit-image over white, in 0..1."""
    return over(load_image(getattr(data, name)()).pixels)


def to_width(pixels: Pixels, width: int) -> Pixels:
    """Return an image in 0..1 at another width in px."""
    height = round(width * pixels.shape[0] / pixels.shape[1])
    return resized(pixels, height, width, Image.Resampling.LANCZOS)


def coffee(width: int) -> Pixels:
    """Return the example photo at a width in px."""
    return to_width(load_image(COFFEE).pixels, width)


def vectorized(source: Any, **options: Any) -> Result:
    """Return the result of a picture with options by their names."""
    return vectorize_by(Options.from_flat(options), source)


def drawn(svg: str, height: int, width: int) -> Pixels:
    """Return the raster of any tool's SVG, which is stretched if it has no viewBox."""
    if "viewBox" not in svg:
        sized = r'viewBox="0 0 \1 \2" preserveAspectRatio="none"'
        svg = re.sub(r'width="([\d.]+)" height="([\d.]+)"', sized, svg, count=1)
    return rasterize(svg, width, height)


def eight_bits(pixels: Pixels) -> Image.Image:
    """Return an image of 8 bits a channel of pixels (h, w, c), clipped to 0..1."""
    return Image.fromarray(np.round(np.clip(pixels, 0, 1) * 255).astype(np.uint8))


def resized(pixels: Pixels, height: int, width: int, how: Image.Resampling) -> Pixels:
    """Return an image (h, w, c) in 0..1 at another size, on 8 bits."""
    return np.asarray(eight_bits(pixels).resize((width, height), how), np.float32) / 255


def encoded(picture: Pixels | Image.Image, kind: str, **options: Any) -> bytes:
    """Return the file that Pillow makes of a picture, by its name of the format."""
    stream = io.BytesIO()
    image = picture if isinstance(picture, Image.Image) else eight_bits(picture)
    image.save(stream, kind, **options)
    return stream.getvalue()


def webps(picture: Pixels, limit: int) -> Iterator[Pixels]:
    """Yield what WebP thumbnails of at most `limit` bytes show at the size of the picture."""
    height, width = picture.shape[:2]
    sides = (16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512, 768)
    for side, quality in product(sides, (1, 5, 10, 20, 40, 60, 80)):
        rows, columns = (max(1, round(n * side / max(height, width))) for n in (height, width))
        small = resized(picture, rows, columns, Image.Resampling.BOX)
        file = encoded(small, "WEBP", quality=quality, method=6)
        if len(file) <= limit:
            pixels = np.asarray(Image.open(io.BytesIO(file)).convert("RGB"), np.float32) / 255
            yield resized(pixels, height, width, Image.Resampling.BICUBIC)


def vtracer_files(picture: Pixels) -> Iterator[str]:
    """Yield the SVG of vtracer by each of 324 settings, of the picture at full and half size."""
    import vtracer  # pyright: ignore[reportMissingImports]

    shared = product(("color", "binary"), (1, 4, 10), (5, 8), (8, 16, 32, 64), (0, 2))
    curves = {"none": [{}], "polygon": [{}], "spline": [
        {"corner_threshold": corner, "length_threshold": length}
        for corner, length in product((45, 90), (3.5, 8))
    ]}  # fmt: skip
    height, width = picture.shape[:2]
    sizes = ((height, width), (height // 2, width // 2))
    pngs = [encoded(resized(picture, *size, Image.Resampling.BOX), "PNG") for size in sizes]
    for colormode, speckle, bits, difference, decimals in shared:
        if colormode == "binary" and (bits, difference) != (5, 8):
            continue  # two colours have neither
        for png, (mode, variants) in product(pngs, curves.items()):
            for more in variants:
                yield vtracer.convert_raw_image_to_svg(
                    png, img_format="png", mode=mode, colormode=colormode, filter_speckle=speckle,
                    color_precision=bits, layer_difference=difference, path_precision=decimals,
                    **more,
                )  # fmt: skip


def largest_square(values: Pixels, side: int) -> tuple[slice, slice]:
    """Return rows and columns of the square of `side` px with the largest sum of values (h, w)."""
    height, width = values.shape
    half = side // 2  # the window around [y, x] begins at y - half, x - half
    inside = uniform_filter(values, side)[
        half : height - side + half + 1, half : width - side + half + 1
    ]
    top, left = map(int, np.unravel_index(np.argmax(inside), inside.shape))
    return slice(top, top + side), slice(left, left + side)


def command_line(text: str | None) -> argparse.ArgumentParser:
    """Return the parser of a script's command line, whose help is the text of its module."""
    return argparse.ArgumentParser(description=text, formatter_class=argparse.RawTextHelpFormatter)


def line(cells: Any) -> str:
    """Return a line of a Markdown table."""
    return f"| {' | '.join(map(str, cells))} |"


def head(names: list[str]) -> str:
    """Return the first two lines of a Markdown table."""
    return f"{line(names)}\n|{'---|' * len(names)}"


def flat_error(image: Pixels, reference: Pixels) -> float:
    """Return the mean error of the worst thousandth of the flat pixels, in levels of 255.

    A pixel is flat if the reference has no step of 0.02 or more within 4 px of it. A pixel's error
    is the error of its worst channel. Return NaN if no pixel is flat.

    This error shows streaks across paper or a flat colour, which hardly change the mean squared
    error (docs/decisions/metrics.md). It grows with the contrast, the length and the number of the
    streaks.
    """
    steep = np.zeros(reference.shape[:2], bool)
    for axis in (0, 1):  # the pixels on both sides of a steep step are marked
        steps = np.abs(np.diff(reference, axis=axis)).max(axis=2, initial=0) >= 0.02
        lead = (slice(None),) * axis
        steep[(*lead, slice(1, None))] |= steps
        steep[(*lead, slice(-1))] |= steps
    flat = np.logical_not(maximum_filter(steep, size=9))
    errors = np.abs(np.subtract(image[flat], reference[flat], dtype=np.float64)).max(axis=1)
    if not errors.size:
        return math.nan
    worst = math.ceil(errors.size / 1000)
    return float(np.partition(errors, -worst)[-worst:].mean()) * 255
