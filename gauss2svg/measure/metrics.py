"""Image metrics. All images are (h, w, channels) float in 0..1.

A run measures some of them always, and scikit-image and SciPy's packages are slow to import
(docs/decisions/start.md). So this module has its own SSIM, its own conversion to CIELAB and its own
box filter.
"""

import math
from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.errors import refusal
from gauss2svg.photo.pixels import BACKDROPS, has_alpha, linear_light, over, psnr_of
from gauss2svg.without_scipy import mirrored, smoothed

LEAST_SIDE_FOR_SSIM = 11  # px, side of SSIM's Gaussian window
_BAND = 256  # number of rows of windows for which SSIM is computed at a time


def _differences(
    image: NDArray[np.floating], other: NDArray[np.floating]
) -> Iterator[NDArray[np.float64]]:
    """Yield the difference (w * channels,) of each row. A row at a time takes little memory.

    Raise InputError unless the two images have the same shape.
    """
    if image.shape != other.shape or image.ndim != 3:
        got = f"{image.shape} and {other.shape}"
        raise refusal("two images", "of one shape (h, w, channels)", got)
    for row, other_row in zip(image, other, strict=True):
        yield np.subtract(row, other_row, dtype=np.float64).ravel()


def psnr(
    image: NDArray[np.floating],
    other: NDArray[np.floating],
    weight: NDArray[np.floating] | None = None,
) -> float:
    """Return the peak signal-to-noise ratio in dB: -10 log10(mean squared error).

    The mean is over pixels and channels. The ratio is infinite for equal images.

    weight  (h, w) weight of each pixel. None: all weights are 1. If the images are stacks of views,
            each view has these weights
    """
    if weight is not None:
        squares = np.square(np.subtract(image, other, dtype=np.float64)).mean(axis=2)
        return psnr_of(float(np.average(squares, weights=np.resize(weight, squares.shape))))
    squares = (float(np.square(row).sum()) for row in _differences(image, other))
    return psnr_of(math.fsum(squares) / image.size)


def ssim(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Return the structural similarity (SSIM) in -1..1, averaged over the channels.

    A channel's SSIM is the mean of

        (2 m_a m_b + C1) (2 s_ab + C2) / ((m_a^2 + m_b^2 + C1) (s_aa + s_bb + C2))

    over all windows that lie inside the image. m_a and m_b are the means of the two images in a
    window, s_aa and s_bb are their variances, and s_ab is their covariance. A window weights its
    pixels by a Gaussian with a sigma of 1.5 px. C1 = .01^2 and C2 = .03^2. An image needs at least
    LEAST_SIDE_FOR_SSIM px a side, so that a window fits.

    Source: Wang, Bovik, Sheikh and Simoncelli, "Image quality assessment", 2004. scikit-image gives
    the same numbers.
    """
    channels = image.shape[2]
    # SSIM is computed in float32, the type of photos and rasters. float64 takes twice the memory.
    planes = ((image[:, :, c], other[:, :, c]) for c in range(channels))
    return math.fsum(_similarity(a, b) for a, b in planes) / channels


def _similarity(plane: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Return the mean SSIM of two planes (h, w) over Gaussian windows, as scikit-image has it."""
    rim = LEAST_SIDE_FOR_SSIM // 2
    rows, total = plane.shape[0] - 2 * rim, 0.0
    assert rows > 0
    # SSIM is computed in bands to save memory. Whole planes of float32 would take 60 bytes a pixel.
    for top in range(0, rows, _BAND):
        x, y = (
            np.ascontiguousarray(each[top : top + _BAND + 2 * rim], np.float32)
            for each in (plane, other)
        )
        mean_x, mean_y, xx, yy, xy = (
            smoothed(each, 1.5, 3.5) for each in (x, y, x * x, y * y, x * y)
        )
        c1, c2 = 0.01**2, 0.03**2
        a1, a2 = 2 * mean_x * mean_y + c1, 2 * (xy - mean_x * mean_y) + c2
        b1 = mean_x**2 + mean_y**2 + c1
        b2 = (xx - mean_x * mean_x) + (yy - mean_y * mean_y) + c2
        inside = ((a1 * a2) / (b1 * b2))[rim:-rim, rim:-rim]
        total += len(inside) * float(inside.mean(dtype=np.float64))
    return total / rows


def largest_error(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Return the largest absolute difference at any pixel in any channel, in levels of 255."""
    return max(float(np.abs(row).max()) for row in _differences(image, other)) * 255


def bias(image: NDArray[np.floating], other: NDArray[np.floating]) -> float:
    """Return the mean of image - other over all pixels and channels, in levels of 255."""
    total = math.fsum(float(row.sum()) for row in _differences(image, other))
    return total / image.size * 255


WINDOW = 9  # px, side of the box over which errors are averaged (docs/decisions/metrics.md)
# XYZ of linear sRGB light (IEC 61966-2-1). Each row is divided by its sum, which is the XYZ of the
# white point D65, so that a and b of grey are 0.
_XYZ = np.array(
    [[0.412453, 0.357580, 0.180423], [0.212671, 0.715160, 0.072169], [0.019334, 0.119193, 0.950227]]
)


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
    height, width = photo.shape[:2]
    rows, step, radius = mirrored(height, WINDOW // 2), 128, WINDOW // 2
    found = []
    for level in BACKDROPS[: 1 + has_alpha(photo)]:
        errors = np.empty((height, width), np.float32)
        for top in range(0, height, step):  # bands of rows, to save memory
            band = rows[top : top + step + 2 * radius]
            difference = chroma(over(image[band], level)) - chroma(over(photo[band], level))
            a, b = box_mean(np.moveaxis(difference, 2, 0), WINDOW)[:, radius : len(band) - radius]
            errors[top : top + step] = portable.hypot(a, b)
        y, x = divmod(int(errors.argmax()), width)
        found.append(HueError(float(errors[y, x]), x, y, float(np.percentile(errors, 99.9))))
    return max(found)


def chroma(rgb: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return a and b of CIELAB (..., 2) of sRGB colours (..., 3) in 0..1. The white point is D65.

    scikit-image's `rgb2lab` gives the same numbers to within 0.1.
    """
    table = _light()
    levels = np.round(rgb * np.float32(len(table) - 1)).astype(np.int32)
    to_xyz = (_XYZ / _XYZ.sum(axis=1, keepdims=True)).astype(np.float32)
    xyz = portable.product(np.take(table, levels, mode="clip"), to_xyz.T)
    x, y, z = np.moveaxis(
        np.where(xyz > 0.008856, portable.cbrt(xyz), 7.787 * xyz + 16 / 116), -1, 0
    )
    return np.stack([500 * (x - y), 200 * (y - z)], axis=-1)


@cache
def _light() -> NDArray[np.float32]:
    """Return the linear light of sRGB values at even steps from 0 to 1.

    There are 16 steps between two neighbours of the 256 levels. The levels themselves are in the
    table, so that pictures of 8 bits are converted exactly.
    """
    return linear_light(np.linspace(0, 1, 255 * 16 + 1)).astype(np.float32)


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
