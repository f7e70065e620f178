"""The crops of an SVG that pages enlarge: the worst one and a typical one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SIDE = 74  # px: at 3x, five crops fit side by side on a laptop and more than one on a phone
_SAME = 1e-12  # mean squared errors that differ by less are equal up to rounding


class Crop(NamedTuple):
    """A part of an image: its top left corner and size in px, and its PSNR in dB."""

    x: int
    y: int
    width: int
    height: int
    psnr: float


def worst_and_typical(
    image: NDArray[np.floating], other: NDArray[np.floating], side: int = SIDE
) -> tuple[Crop, Crop]:
    """The window with the largest mean squared error, and a typical one.

    image, other  (h, w, c) in 0..1
    side          of a window, in px; less where an image is smaller
    The typical window is the one whose error is closest to the median of all windows' errors; of
    several, the one closest to the centre.
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
        error = squared[y : y + down, x : x + across].mean()  # exactly 0 for equal pixels
        return Crop(x, y, across, down, float(-10 * np.log10(error)) if error else np.inf)

    return crop(worst), crop(typical)


def _window_means(values: NDArray[np.float64], down: int, across: int) -> NDArray[np.float64]:
    """Mean of every window of down x across px, by its top left corner."""
    integral = np.pad(values, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    inside = integral[down:, across:] - integral[:-down, across:]
    inside = inside - integral[down:, :-across] + integral[:-down, :-across]
    return inside / (down * across)
