"""What several scripts do with pictures: runs by options, 8 bits, files, the worst square."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import uniform_filter

from gauss2svg import Result
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.vectorize import vectorize_by


def vectorized(source: Any, **options: Any) -> Result:
    """The photo with options by name."""
    return vectorize_by(Options.from_flat(options), source)


def eight_bits(pixels: NDArray[np.floating]) -> Image.Image:
    """An image (h, w, c), clipped to 0..1, with 8 bits a channel."""
    return Image.fromarray(np.round(np.clip(pixels, 0, 1) * 255).astype(np.uint8))


def encoded(picture: NDArray[np.floating] | Image.Image, kind: str, **options: Any) -> bytes:
    """The file that Pillow makes of a picture, by its name of the format."""
    stream = io.BytesIO()
    image = picture if isinstance(picture, Image.Image) else eight_bits(picture)
    image.save(stream, kind, **options)
    return stream.getvalue()


def largest_square(values: NDArray[np.floating], side: int) -> tuple[int, int]:
    """Top and left of the square of `side` px with the largest sum of values (h, w)."""
    height, width = values.shape
    half = side // 2  # the window around [y, x] begins at y - half, x - half
    inside = uniform_filter(values, side)[
        half : height - side + half + 1, half : width - side + half + 1
    ]
    top, left = np.unravel_index(np.argmax(inside), inside.shape)
    return int(top), int(left)
