"""Make the README's picture: the SVG at three counts, and the photo.

python benchmarks/showcase.py examples/coffee.jpg examples/showcase.jpg
"""

from __future__ import annotations

import sys

import numpy as np
from common import eight_bits

from gauss2svg import vectorize
from gauss2svg.photo.load import WHITE, load_image

COUNTS = (200, 1000, 5000)
GAP_PX = 6


def main() -> None:
    """Write the rasterised SVGs and the photo as a two-by-two sheet."""
    source, target = sys.argv[1:]
    photo = load_image(source, matte=WHITE).pixels
    panels = []
    for count in COUNTS:
        result = vectorize(photo, gaussians=count)
        print(result)
        panels.append(result.raster)
    panels.append(photo)
    height, width, _ = photo.shape
    sheet = np.ones((2 * height + GAP_PX, 2 * width + GAP_PX, 3), np.float32)
    for k, panel in enumerate(panels):
        y, x = (k // 2) * (height + GAP_PX), (k % 2) * (width + GAP_PX)
        sheet[y : y + height, x : x + width] = panel
    eight_bits(sheet).save(target, quality=88)


if __name__ == "__main__":
    main()
