"""Where to look: the part of a picture that is worst, and one that is as most of it is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SIDE = 74  # px: at 3x five stand side by side on a laptop, and more than one on a phone
_SAME = 1e-12  # mean squared errors that differ by less are those of sums in another order


class Crop(NamedTuple):
    """A part of a picture: its left upper corner and its size, in px, and its PSNR in dB."""

    x: int
    y: int
    width: int
    height: int
    psnr: float


def worst_and_typical(
    image: NDArray[np.floating], other: NDArray[np.floating], side: int = SIDE
) -> tuple[Crop, Crop]:
    """Of all windows of side x side px: that of the largest mean squared error, and a median one.

    image, other  (h, w, c) in 0..1; a window is no larger than they are
    Typical is the window whose error is nearest to the median of all windows' errors; of several,
    the one nearest to the centre.
    """
    height, width = image.shape[:2]
    down, across = min(side, height), min(side, width)
    squared = np.subtract(image, other, dtype=np.float64) ** 2
    means = _window_means(squared.mean(axis=2), down, across)
    worst = np.unravel_index(np.argmax(means), means.shape)
    off = np.abs(means - np.median(means))
    rows, columns = np.nonzero(off <= off.min() + _SAME)
    middle = (np.array(means.shape) - 1) / 2
    nearest = np.argmin((rows - middle[0]) ** 2 + (columns - middle[1]) ** 2)
    typical = (rows[nearest], columns[nearest])

    def crop(corner: tuple[np.intp, ...]) -> Crop:
        y, x = map(int, corner)
        error = squared[y : y + down, x : x + across].mean()  # what is equal is so exactly
        return Crop(x, y, across, down, float(-10 * np.log10(error)) if error else np.inf)

    return crop(worst), crop(typical)


def _window_means(values: NDArray[np.float64], down: int, across: int) -> NDArray[np.float64]:
    """Mean of every window of down x across px, by its left upper corner."""
    summed = np.pad(values, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    inside = summed[down:, across:] - summed[:-down, across:]
    inside = inside - summed[down:, :-across] + summed[:-down, :-across]
    return inside / (down * across)
