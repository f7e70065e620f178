"""Pixels of a PNG that a renderer wrote."""

import io

import numpy as np
from numpy.typing import NDArray
from PIL.PngImagePlugin import PngImageFile


def from_png(png: bytes) -> NDArray[np.float32]:
    """Unpremultiplied RGBA (h, w, 4) float32 in 0..1."""
    # Not by Image.open, whose size limits are for untrusted images: this size was requested.
    with PngImageFile(io.BytesIO(png)) as picture:
        pixels = np.array(picture.convert("RGBA"), np.float32)
    pixels /= 255
    return pixels
