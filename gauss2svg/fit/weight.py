"""What an error at a pixel counts: the weight map of the squared error.

Tuned for perception, w = (1 + min(v, m) / c^2)^-g with v the local variance of luma and m a
hundred times its median, from .025 to .04: an error hides in texture and shows on smooth areas, as
in visual masking (Daly, "The Visible Differences Predictor", 1993), but the crisp edges of
drawings, where half of the picture is flat, still count. Tuned for PSNR, w = 1 but up to
1 + flat on flat areas, where a streak of two levels is visible that the squared error alone hardly
counts. docs/decisions/perceptual.md has what each gains.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.options import PSNR
from gauss2svg.photo.smooth import smoothed


@dataclass(frozen=True)
class WeightTuning:
    """Contrast masking and flat areas, by the module's formulas (docs/decisions/perceptual.md).

    contrast       c, standard deviation of luma in 0..1 from which an error is masked
    exponent       g, how fast it fades
    times_median   of the variance, from which nothing is masked further
    least_bound    that variance at least
    most_bound     that variance at most
    window         px, sigma of the window of the variance
    flat           weight of a flat area beside 1 (docs/decisions/metrics.md)
    flat_gradient  of luma a px, under which an area is flat: 5 levels of 255
    flat_reach     px, sigma of the window in which the gradient is averaged
    """

    contrast: float = 0.03
    exponent: float = 0.5
    times_median: float = 100.0
    least_bound: float = 0.025
    most_bound: float = 0.04
    window: float = 2.0
    flat: float = 8.0
    flat_gradient: float = 0.02
    flat_reach: float = 4.0


TUNING = WeightTuning()


def pixel_weight(views: list[NDArray[np.floating]], tune: str) -> NDArray[np.floating]:
    """(h, w) weights > 0 of a picture, given over each of its backdrops as (3, h, w) in 0..1."""
    lumas = [view.mean(axis=0) for view in views]
    if tune == PSNR:
        energy = reduce(add, map(_gradient_energy, lumas)) / len(lumas)
        flatness = np.exp(-smoothed(energy, TUNING.flat_reach) / TUNING.flat_gradient**2)
        weight = 1 + TUNING.flat * flatness
    else:
        variance = reduce(add, map(_local_variance, lumas)) / len(lumas)
        most = TUNING.times_median * np.median(variance)
        most = np.clip(most, TUNING.least_bound, TUNING.most_bound)
        weight = (1 + np.minimum(variance, most) / TUNING.contrast**2) ** -TUNING.exponent
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
    mean = smoothed(luma, TUNING.window)
    return np.maximum(smoothed(luma * luma, TUNING.window) - mean * mean, 0)
