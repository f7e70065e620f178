"""A photo in memory, which loading gives and all else takes; samples of any type as float32."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError


@dataclass(frozen=True)
class Header:
    """What the header of a photo says.

    width, height  in px, as stored
    has_alpha      whether it may have alpha
    reduced_bytes  of memory for each pixel while it is decoded and reduced; None where all of it
                   is decoded first
    """

    width: int
    height: int
    has_alpha: bool
    reduced_bytes: int | None = None


@dataclass(frozen=True, eq=False)
class Photo:
    """A decoded photo.

    pixels  (height, width, 3) float32 sRGB in 0..1, straight alpha; 0 where alpha is 0
    notes   conversions made while loading, for the report
    dpi     px per inch across and down, by the resolution tag; None where the file has none
    alpha   (height, width) float32 in 0..1; None where every pixel is opaque
    full    width and height in px of the upright photo, of which pixels may be a reduction
    given_sample
            some of the pixels of one that was reduced, see sample
    """

    pixels: NDArray[np.float32]
    notes: tuple[str, ...] = ()
    dpi: tuple[float, float] | None = None
    alpha: NDArray[np.float32] | None = None
    full: tuple[int, int] = (0, 0)
    given_sample: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        if self.full == (0, 0):
            object.__setattr__(self, "full", (self.width, self.height))

    @classmethod
    def from_samples(
        cls, color: NDArray[np.float32], alpha: NDArray[np.float32] | None, **more: Any
    ) -> Photo:
        """A photo from color (h, w, 1 or 3) and alpha (h, w), which is dropped if it is all 1."""
        if color.shape[2] == 1:
            color = np.repeat(color, 3, axis=2)
        if alpha is not None and not (alpha < 1).any():
            alpha = None
        if alpha is not None:
            color = np.where(alpha[:, :, None] > 0, color, np.float32(0))
            alpha = np.ascontiguousarray(alpha)
        return cls(np.ascontiguousarray(color), alpha=alpha, **more)

    @property
    def sample(self) -> NDArray[np.float32]:
        """(h, w, channels) pixels of the photo, none a mean: all, or some of a reduced one.

        Perhaps before their profile, orientation and alpha are applied: whether a picture has few
        colours, and where they change.
        """
        return self.pixels if self.given_sample is None else self.given_sample

    @property
    def width(self) -> int:
        """Width in px."""
        return self.pixels.shape[1]

    @property
    def height(self) -> int:
        """Height in px."""
        return self.pixels.shape[0]


def unit(array: NDArray[Any], name: str, top: int = 0) -> NDArray[np.float32]:
    """Samples (h, w, channels), uint8, uint16, bool or floating point, as float32 in 0..1.

    top  row of the first in the picture that they are of
    Raises InputError for other types, and for the first sample outside of 0..1.
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
    bad = ~((array >= 0) & (array <= 1))  # NaN as well
    if bad.any():
        y, x, c = (int(v) for v in np.argwhere(bad)[0])
        raise InputError(
            f"samples of {name} must be finite and in 0..1; got {array[y, x, c]} at row {top + y}, "
            f"column {x}, channel {c}. Try dividing by the largest value, or clipping"
        )
    return array.astype(np.float32)
