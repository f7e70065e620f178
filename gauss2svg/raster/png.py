"""PNG that a renderer made, as pixels."""

import io

import numpy as np
from numpy.typing import NDArray
from PIL.PngImagePlugin import PngImageFile


def from_png(png: bytes) -> NDArray[np.float32]:
    """Pixels (h, w, 4) float32 RGBA in 0..1, alpha not multiplied in."""
    # Not by Image.open: the size was asked for, and its limits are for what is not trusted.
    with PngImageFile(io.BytesIO(png)) as picture:
        pixels = np.array(picture.convert("RGBA"), np.float32)
    pixels /= 255
    return pixels
