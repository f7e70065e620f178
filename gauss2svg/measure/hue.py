"""The local error of hue, which tells whether a small part of a picture has lost its colour.

A run measures it always, and scikit-image and SciPy's packages are slow to import
(docs/decisions/start.md). So this module has its own conversion to CIELAB and its own box filter.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.measure.metrics import check_shapes
from gauss2svg.photo.pixels import BACKDROPS, has_alpha, linear_light, over
from gauss2svg.without_scipy import mirrored

WINDOW = 9  # px, side of the box over which errors are averaged (docs/decisions/metrics.md)
PERCENTILE = 99.9  # percentile of the errors that is reported beside the largest one
# Number of steps between two neighbours of the 256 levels in the table of linear light. The levels
# themselves are in the table, so that pictures of 8 bits are converted exactly.
_STEPS = 16
_BAND = 128  # number of rows whose errors are computed at a time, to save memory
# XYZ of linear sRGB light (IEC 61966-2-1). Each row is divided by its sum, which is the XYZ of the
# white point D65, so that a and b of grey are 0.
_XYZ = np.array(
    [
        [0.412453, 0.357580, 0.180423],
        [0.212671, 0.715160, 0.072169],
        [0.019334, 0.119193, 0.950227],
    ]
)
_XYZ = (_XYZ / _XYZ.sum(axis=1, keepdims=True)).astype(np.float32)


class HueError(NamedTuple):
    """The local error of hue of an image, in units of a and b of CIELAB.

    worst       largest error
    x, y        px, place of the largest error
    percentile  99.9th percentile of the errors of all pixels
    """

    worst: float
    x: int
    y: int
    percentile: float


def local_hue_error(image: NDArray[np.float32], photo: NDArray[np.float32]) -> HueError:
    """Return the local error of hue of an image against its photo.

    Both are (h, w, 3) or (h, w, 4) in 0..1. At each pixel, the differences of a and b of CIELAB are
    averaged over WINDOW x WINDOW px. The error is the length of the two means. So noise, and edges
    that are a pixel off, hardly count, but a small part that has lost its colour does. If the
    photo has alpha, the errors are measured over white and over black, and the worse ones count.
    """
    check_shapes(image, photo)
    return max(_over(image, photo, level) for level in BACKDROPS[: 1 + has_alpha(photo)])


def _over(image: NDArray[np.float32], photo: NDArray[np.float32], level: float) -> HueError:
    """Return the local error of hue of two pictures over a grey level."""
    height, width = photo.shape[:2]
    errors, radius = np.empty((height, width), np.float32), WINDOW // 2
    rows = mirrored(height, radius)
    for top in range(0, height, _BAND):
        band = rows[top : top + _BAND + 2 * radius]
        difference = chroma(over(image[band], level)) - chroma(over(photo[band], level))
        a, b = box_mean(np.moveaxis(difference, 2, 0), WINDOW)[:, radius : len(band) - radius]
        errors[top : top + _BAND] = portable.hypot(a, b)
    y, x = divmod(int(errors.argmax()), width)
    worst = float(errors[y, x])
    return HueError(worst, x, y, float(np.percentile(errors, PERCENTILE, overwrite_input=True)))


def chroma(rgb: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return a and b of CIELAB (..., 2) of sRGB colours (..., 3) in 0..1. The white point is D65.

    scikit-image's `rgb2lab` gives the same numbers to within 0.1.
    """
    table = _light()
    levels = np.round(rgb * np.float32(len(table) - 1)).astype(np.int32)
    xyz = portable.product(np.take(table, levels, mode="clip"), _XYZ.T)
    x, y, z = np.moveaxis(
        np.where(xyz > 0.008856, portable.cbrt(xyz), 7.787 * xyz + 16 / 116), -1, 0
    )
    return np.stack([500 * (x - y), 200 * (y - z)], axis=-1)


@cache
def _light() -> NDArray[np.float32]:
    """Return the linear light of sRGB values at even steps from 0 to 1."""
    return linear_light(np.linspace(0, 1, 255 * _STEPS + 1)).astype(np.float32)


def box_mean(planes: NDArray[np.floating], window: int) -> NDArray[np.floating]:
    """Return the mean of each plane (..., h, w) over the window x window px around each pixel.

    `window` is odd. Beyond its border, a plane continues as its mirror image, as in
    scipy.ndimage.uniform_filter. Sums are computed in float64, and the result has the dtype of the
    planes.
    """
    means = planes
    for axis in (-2, -1):
        # One more value before the first window makes each sum a difference of two running sums.
        at = mirrored(planes.shape[axis], window // 2 + 1)[:-1]
        total = np.moveaxis(means.take(at, axis).cumsum(axis, dtype=np.float64), axis, 0)
        means = np.moveaxis((total[window:] - total[:-window]) / window, 0, axis)
    return means.astype(planes.dtype)
