"""A photo in memory, its header, and the conversion of samples of any type to float32."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError


@dataclass(frozen=True)
class Header:
    """The header of a photo.

    width, height  size in px, as stored
    has_alpha      whether the photo may have alpha
    reduced_bytes  memory (bytes) per pixel while the photo is decoded and reduced. None if all of
                   it is decoded first
    """

    width: int
    height: int
    has_alpha: bool
    reduced_bytes: int | None = None


@dataclass(frozen=True, eq=False)
class Photo:
    """A decoded photo.

    pixels  (height, width, 3) float32 sRGB in 0..1, not multiplied by alpha; 0 where alpha is 0
    full    width and height in px of the upright photo before any reduction
    notes   conversions made while loading, for the report
    dpi     px per inch across and down, by the resolution tag. None if the file has none
    alpha   (height, width) float32 in 0..1. None if every pixel is opaque
    """

    pixels: NDArray[np.float32]
    full: tuple[int, int]
    notes: tuple[str, ...] = ()
    dpi: tuple[float, float] | None = None
    alpha: NDArray[np.float32] | None = None

    @property
    def width(self) -> int:
        """Width in px."""
        return self.pixels.shape[1]

    @property
    def height(self) -> int:
        """Height in px."""
        return self.pixels.shape[0]


def unit(array: NDArray[Any], name: str) -> NDArray[np.float32]:
    """Return samples (h, w, channels), uint8, uint16, bool or floating point, as float32 in 0..1.

    Raise InputError for other types, and for the first sample outside of 0..1.
    """
    array = array.astype(array.dtype.newbyteorder("="), copy=False)
    if array.dtype == np.bool_:
        return array.astype(np.float32)
    if array.dtype in (np.uint8, np.uint16):
        return array.astype(np.float32) / np.float32(np.iinfo(array.dtype).max)
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(
            f"type of {name} must be uint8, uint16, bool or floating point; got {array.dtype}"
        )
    bad = ~((array >= 0) & (array <= 1))  # true for NaN as well
    if bad.any():
        y, x, c = (int(v) for v in np.argwhere(bad)[0])
        raise InputError(
            f"samples of {name} must be finite and in 0..1; got {array[y, x, c]} at row {y}, "
            f"column {x}, channel {c}. Try dividing by the largest value, or clipping"
        )
    return array.astype(np.float32)
