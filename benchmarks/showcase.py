"""Make the README's picture: a photo as few and as many shapes, and a part of each at 4x.

python benchmarks/showcase.py examples/coffee.jpg examples/showcase.jpg
"""

from __future__ import annotations

import io
import sys

import matplotlib.pyplot as plt
from panels import enlarged, tiles
from PIL import Image

from gauss2svg import vectorize
from gauss2svg.photo.load import WHITE, load_image
from gauss2svg.raster import rasterize

COUNTS = (200, 5000)
ZOOM = 4
_LEFT, _TOP = 0.47, 0.5  # of the part, in shares of the sides
_DPI = 180


def main() -> None:
    """Write the rasterised SVGs and the photo above a part of each."""
    source, target = sys.argv[1:]
    photo = load_image(source, matte=WHITE).pixels
    height, width, _ = photo.shape
    y, x = round(_TOP * ZOOM * height), round(_LEFT * ZOOM * width)
    part = slice(y, y + height), slice(x, x + width)
    whole, near, titles = [], [], []
    for count in COUNTS:
        result = vectorize(photo, gaussians=count)
        print(result)
        report = result.report
        whole.append(result.raster)
        near.append(rasterize(result.svg, ZOOM * width, ZOOM * height)[part])
        titles.append(
            f"{len(result.scene)} shapes, {report['svg_bytes'] / 1000:.0f} kB "
            f"({report['svgz_bytes'] / 1000:.0f} gzipped)"
        )
    near.append(enlarged(photo, ZOOM, Image.Resampling.NEAREST)[part])
    titles = [*titles, "the photo", *[f"{ZOOM} times as large"] * len(near)]
    figure = tiles([*whole, photo, *near], titles, columns=len(near))
    for axis in figure.axes:
        axis.title.set_fontsize(9)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=_DPI)
    plt.close(figure)
    with Image.open(stream) as image:
        image.convert("RGB").save(target, quality=85)


if __name__ == "__main__":
    main()
