"""What an error at a pixel counts: the weight map of the squared error.

Tuned for perception, w = (1 + min(v, m) / c^2)^-g with v the local variance of luma and m a
hundred times its median, from .025 to .04: an error hides in texture and shows on smooth areas, as
in visual masking (Daly, "The Visible Differences Predictor", 1993), but the crisp edges of
drawings, where half of the picture is flat, still count. Tuned for PSNR, w = 1 but up to
1 + flat on flat areas, where a streak of two levels is visible that the squared error alone hardly
counts. docs/decisions/perceptual.md has what each gains.
"""

from __future__ import annotations

from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.options import PSNR
from gauss2svg.photo.smooth import smoothed

# Contrast masking and flat areas, by the module's formulas (docs/decisions/perceptual.md).
CONTRAST = 0.03  # c: standard deviation of luma, in 0..1, from which an error is masked
EXPONENT = 0.5  # g: how fast the weight falls with the variance
TIMES_MEDIAN = 100.0  # multiple of the median variance above which nothing is masked further
LEAST_BOUND = 0.025  # lower bound of that variance
MOST_BOUND = 0.04  # upper bound of that variance
WINDOW = 2.0  # sigma in px of the window of the variance
FLAT = 8.0  # weight of a flat area, to which others are 1 (docs/decisions/metrics.md)
FLAT_GRADIENT = 0.02  # gradient of luma for each px below which an area is flat: 5 levels of 255
FLAT_REACH = 4.0  # sigma in px of the window in which the gradient is averaged


def pixel_weight(views: list[NDArray[np.floating]], tune: str) -> NDArray[np.floating]:
    """(h, w) weights > 0 of a picture, given over each of its backdrops as (3, h, w) in 0..1."""
    lumas = [view.mean(axis=0) for view in views]
    if tune == PSNR:
        energy = reduce(add, map(_gradient_energy, lumas)) / len(lumas)
        flatness = np.exp(-smoothed(energy, FLAT_REACH) / FLAT_GRADIENT**2)
        weight = 1 + FLAT * flatness
    else:
        variance = reduce(add, map(_local_variance, lumas)) / len(lumas)
        most = TIMES_MEDIAN * np.median(variance)
        most = np.clip(most, LEAST_BOUND, MOST_BOUND)
        weight = (1 + np.minimum(variance, most) / CONTRAST**2) ** -EXPONENT
        weight /= weight.mean()
    return weight.astype(views[0].dtype)


def slopes(luma: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Derivatives (h, w) of the smoothed luma (h, w) along x and y."""
    luma = smoothed(luma, 1.0)
    height, width = len(luma), len(luma[0])
    gy = np.gradient(luma, axis=0) if height > 1 else np.zeros_like(luma)
    gx = np.gradient(luma, axis=1) if width > 1 else np.zeros_like(luma)
    return gx, gy


def _gradient_energy(luma: NDArray[np.floating]) -> NDArray[np.floating]:
    gx, gy = slopes(luma)
    return gx * gx + gy * gy


def _local_variance(luma: NDArray[np.floating]) -> NDArray[np.floating]:
    mean = smoothed(luma, WINDOW)
    return np.maximum(smoothed(luma * luma, WINDOW) - mean * mean, 0)
