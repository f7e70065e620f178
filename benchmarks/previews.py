"""What a page may show before a photo has come: bytes in the page and PSNR, means of the photos.

python benchmarks/previews.py PHOTO...

A mean colour, blurhash (pip install blurhash), and as data URIs WebP thumbnails and placeholders of
gauss2svg. What has pixels is enlarged by bicubic interpolation, an SVG drawn at the photo's size.
"""

from __future__ import annotations

import argparse
import base64
import io
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
from common import eight_bits, encoded
from numpy.typing import NDArray
from PIL import Image

from gauss2svg import placeholder
from gauss2svg.measure.metrics import psnr
from gauss2svg.photo.alpha import over, shrunk
from gauss2svg.photo.load import load_image
from gauss2svg.raster import rasterize

try:
    blurhash = import_module("blurhash")
except ModuleNotFoundError as error:
    raise SystemExit("previews.py needs blurhash. Try pip install blurhash") from error

Row = tuple[str, int, NDArray[np.float32]]  # name, bytes in the page, picture (h, w, 3)


def previews(photo: NDArray[np.float32]) -> Iterator[Row]:
    """The previews of a photo (h, w, 3)."""
    height, width = photo.shape[:2]

    def enlarged(small: Image.Image) -> NDArray[np.float32]:
        large = small.convert("RGB").resize((width, height), Image.Resampling.BICUBIC)
        return np.asarray(large, np.float32) / np.float32(255)

    def thumbnail(longest: int) -> Image.Image:
        scale = longest / max(height, width)
        return eight_bits(shrunk(photo, round(height * scale) or 1, round(width * scale) or 1))

    yield "mean colour", 3, np.broadcast_to(photo.mean((0, 1)), photo.shape)
    small = np.asarray(thumbnail(64))
    for across, down in ((4, 3), (6, 5)):
        text = blurhash.encode(small, across, down)
        shown = np.clip(blurhash.decode(text, 96, 64), 0, 255).astype(np.uint8)
        yield f"blurhash, {across}x{down}", len(text), enlarged(Image.fromarray(shown))
    for longest in (8, 16, 24, 32):
        file = encoded(thumbnail(longest), "WEBP", quality=50, method=6)
        uri = b"data:image/webp;base64," + base64.b64encode(file)
        yield f"WebP of {longest} px", len(uri), enlarged(Image.open(io.BytesIO(file)))
    for limit in (500, 1000):
        made = placeholder(photo, limit, bytes_of="data_uri")
        yield f"gauss2svg, {limit}", len(made.data_uri), rasterize(made.svg, width, height)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("photos", nargs="+", type=Path)
    rows: dict[str, list[tuple[int, float]]] = {}
    for path in parser.parse_args().photos:
        photo = over(load_image(path).pixels)
        for name, size, shown in previews(photo):
            rows.setdefault(name, []).append((size, psnr(shown, photo)))
    print("| preview | bytes in the page | PSNR, dB |")
    print("|---|---|---|")
    for name, measured in rows.items():
        size, decibels = np.mean(measured, axis=0)
        print(f"| {name} | {size:.0f} | {decibels:.2f} |")


if __name__ == "__main__":
    main()
