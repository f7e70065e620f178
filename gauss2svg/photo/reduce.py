"""Reducing a photo while it is decoded, by the area average of `alpha.shrunk`.

Rows come from the top, some at a time, and only what a row of the result needs is kept.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.photo.alpha import AVERAGED, straight
from gauss2svg.photo.photo import unit

Size = tuple[int, int]  # width and height in px
# Of a photo of that width and height, as stored; or the longest side in px.
SizeNeeded = Callable[[int, int], Size] | int
# JPEGs are decoded at least so many times as large: libjpeg's own reduced decoding leaves out high
# frequencies, which is no area average (docs/decisions/photo.md).
DRAFT = 3


def reduced_size(needed: SizeNeeded | None, width: int, height: int) -> Size | None:
    """The size to which a photo of that size is reduced; None where no side shrinks."""
    if needed is None:
        return None
    if callable(needed):
        across, down = needed(width, height)
    else:
        scale = needed / max(width, height)
        across, down = (max(1, round(side * scale)) for side in (width, height))
    if across < 1 or down < 1:
        raise InputError(f"size needed of a photo must be at least 1x1 px; got {across}x{down} px")
    size = min(across, width), min(down, height)
    return None if size == (width, height) else size


def decoded_size(photo: Size, needed: Size) -> Size:
    """The size at which to decode a photo that is then to be `shrunk(.., sharp=True)`.

    That needed where an average is as good, else that of the photo.
    """
    return needed if AVERAGED * max(needed) <= max(photo) else photo


class Reduced:
    """The area average of rows that are added from the top, color weighted by alpha.

    stored  width and height in px of the photo
    size    of the result
    scale   by which the rows are smaller than stored; a pixel may count in two of the result

    A pixel of the result has the same whole pixels of the photo as in Pillow's box filter, and is
    black where alpha is 0.
    """

    def __init__(self, stored: Size, size: Size, scale: int = 1) -> None:
        self._across, self._down = (
            _ranges(*pair) / scale for pair in zip(stored, size, strict=True)
        )
        self._size = size
        self._pixels: Any = None  # the result
        self._count = 0  # its rows so far
        self._sum: Any = 0  # of what there is of the next one
        self._top = 0
        self._has_alpha = False
        self._sample: Any = None
        self._samples = 0  # rows of the sample so far

    def add(self, color: NDArray[Any], alpha: NDArray[np.float32] | None) -> None:
        """Add rows (rows, width, 1 or 3), float32 in 0..1 or uint8.

        alpha  (rows, width) float32 in 0..1, if they have it
        """
        top = np.iinfo(np.uint8).max if color.dtype == np.uint8 else 1
        stored = color
        if alpha is not None:
            self._has_alpha = True
            color = np.dstack([color * alpha[:, :, None], alpha * np.float32(top)])
        bottom = self._top + len(color)
        if self._pixels is None:
            self._pixels = np.empty((*self._size[::-1], color.shape[2]), np.float32)
            self._sample = np.empty((*self._size[::-1], stored.shape[2]), stored.dtype)
        for begin in np.floor(self._down[0, self._samples :]).astype(int):
            if begin >= bottom:
                break
            columns = np.floor(self._across[0]).astype(int)
            self._sample[self._samples] = stored[begin - self._top, columns]
            self._samples += 1
        for begin, end in self._down.T[self._count :]:
            if begin >= bottom:
                break
            self._sum += _sum(color, max(begin - self._top, 0), min(end, bottom) - self._top)
            if end > bottom:
                break
            sums = _sums_at(self._sum, self._across)
            lengths = (self._across[1] - self._across[0]) * ((end - begin) * top)
            self._pixels[self._count] = (sums[1] - sums[0]) / lengths[:, None]
            self._count, self._sum = self._count + 1, 0
        self._top = bottom

    @property
    def sample(self) -> NDArray[np.float32]:
        """(h, w, channels) the pixel of the photo at the first corner of each of the result."""
        return unit(self._sample, "photo")

    def result(self) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
        """Color (h, w, 1 or 3) and alpha (h, w), None if no row had it."""
        pixels = np.clip(self._pixels, 0, 1, out=self._pixels)
        if not self._has_alpha:
            return pixels, None
        whole = straight(pixels[:, :, :-1], pixels[:, :, -1])
        return whole[:, :, :-1], whole[:, :, -1]


def rows_at_once(width: int, channels: int) -> int:
    """Number of rows that are converted at once."""
    return max(1, (1 << 20) // (width * channels))


def _ranges(length: int, count: int) -> NDArray[np.float64]:
    """(2, count): the first pixel of each of the result, and that after the last.

    As in Pillow's ImagingResample, to the rounding: whether a pixel whose middle is just between
    two belongs to the one or the other.
    """
    scale = length / count
    middle = (np.arange(count) + 0.5) * scale
    begins, ends = (np.trunc(middle + half + 0.5) for half in (-0.5 * scale, 0.5 * scale))
    begins += (begins - middle + 0.5) * (1 / scale) <= -0.5
    ends -= (ends - 1 - middle + 0.5) * (1 / scale) > 0.5
    return np.stack([begins, np.minimum(ends, length)])


def _sum(rows: NDArray[Any], begin: float, end: float) -> NDArray[np.floating]:
    """Sum of rows between two places, which may lie within one."""
    first, last = math.ceil(begin), math.floor(end)
    if first > last:
        return (end - begin) * rows[last]
    total = rows[first:last].sum(axis=0, dtype=np.float32)
    if first > begin:
        total += np.float32(first - begin) * rows[first - 1]
    if end > last:
        total += np.float32(end - last) * rows[last]
    return total


def _sums_at(values: NDArray[np.floating], places: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums of values (n, channels) up to places, which may lie within one."""
    sums = np.concatenate([np.zeros((1, values.shape[1])), values.cumsum(axis=0, dtype=float)])
    before = np.minimum(np.floor(places), len(values) - 1).astype(np.intp)
    return sums[before] + (places - before)[..., None] * (sums[before + 1] - sums[before])
