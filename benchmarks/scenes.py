"""How many Gaussians adapt to the image, from a flat picture to a photo.

    python benchmarks/scenes.py [--quality balanced] [--sheet SHEET.png]

The script prints a table; SHEET.png shows each picture above its rasterised SVG.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from common import eight_bits
from numpy.typing import NDArray
from PIL import Image
from skimage import data

from gauss2svg import vectorize
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.presets import PRESETS

_SIZE = 256  # px, of the synthetic pictures
_DARK, _LIGHT = np.array([0.10, 0.20, 0.50]), np.array([0.95, 0.75, 0.30])


def pictures() -> Iterator[tuple[str, NDArray[np.float32]]]:
    """Name and picture (h, w, 3) in 0..1, on 8 bits."""
    y, x = np.mgrid[:_SIZE, :_SIZE] / (_SIZE - 1)
    radius = np.minimum(np.hypot(x - 0.5, y - 0.5) / 0.5, 1)
    for name, share in (("flat", 0 * x), ("linear ramp", x), ("radial ramp", radius)):
        mixed = _DARK + (_LIGHT - _DARK) * share[:, :, None]
        yield name, (np.round(mixed * 255) / 255).astype(np.float32)
    for name in ("checkerboard", "logo", "coins", "astronaut"):
        yield name, load_image(getattr(data, name)()).pixels


def main() -> None:
    """Parse the command line, print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quality", choices=PRESETS, default="balanced")
    parser.add_argument("--sheet", type=Path)
    options = parser.parse_args()
    head = f"{'picture':13}{'size':>10}{'Gaussians':>10}{'bytes':>10}{'gzipped':>9}"
    print(head + f"{'PSNR':>8}{'SSIM':>7}{'colours':>8}{'s':>6}  ended by")
    columns = []
    for name, pixels in pictures():
        result = vectorize(pixels, quality=options.quality)
        r = result.report
        psnr = "equal" if r["psnr_svg"] is None else f"{r['psnr_svg']:.2f}"
        print(
            f"{name:13}{r['width']:>5}x{r['height']:<4}{r['gaussians']:>10}{r['svg_bytes']:>10}"
            f"{r['svgz_bytes']:>9}{psnr:>8}{r['ssim_svg']:>7.3f}{r['colors']:>8}"
            f"{r['total_s']:>6.1f}  {r['stop_reason']}",
            flush=True,
        )
        columns.append([_thumbnail(pixels), _thumbnail(result.raster)])
    if options.sheet:
        sheet = np.concatenate([np.concatenate(pair, axis=0) for pair in columns], axis=1)
        Image.fromarray(sheet).save(options.sheet)


def _thumbnail(pixels: NDArray[np.float32]) -> NDArray[np.uint8]:
    return np.asarray(eight_bits(pixels).resize((_SIZE, _SIZE), Image.Resampling.LANCZOS))


if __name__ == "__main__":
    main()
