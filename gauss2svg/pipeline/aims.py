"""Targets that the rasterised SVG must score: PSNR or SSIMULACRA2."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.measure import metrics
from gauss2svg.measure.scores import ssimulacra2
from gauss2svg.photo.alpha import views
from gauss2svg.pipeline.options import Goal

_LEAST_LEFT = 0.05  # share of a candidate's error that remains after any correction for size


@dataclass(frozen=True)
class Aim:
    """A target, and how closely a search meets it; all but name and unit in units of the score.

    name        of the option, and the stop reason once it is reached
    value       the target
    tolerance   under the target that still counts as reached
    over        over the target that a correction aims at
    too_little  under the target from which Gaussians are added
    too_good    over the target from which Gaussians are removed
    slope       gained per doubling, until it is measured
    slopes      least and most that is plausible
    unit        of the score, after a number
    """

    name: str
    value: float
    tolerance: float
    over: float
    too_little: float
    too_good: float
    slope: float
    slopes: tuple[float, float]
    unit: str

    @property
    def is_psnr(self) -> bool:
        """Whether the score is PSNR, else it is SSIMULACRA2."""
        return self.name == "target_psnr"

    def score(self, raster: NDArray[np.float32], photo: NDArray[np.float32]) -> float:
        """Score of a raster against a photo of its shape; the worse over white and black."""
        pairs = zip(views(raster), views(photo), strict=True)
        if not self.is_psnr:
            return min(ssimulacra2(*pair) for pair in pairs)
        return _decibels(max(metrics.mean_squared_error(*pair) for pair in pairs))

    def with_detail(self, score: float, detail: float) -> float:
        """The score against the reference of a file whose score at the size of the fit is known."""
        if not self.is_psnr:
            return score + detail
        error = 10 ** (-score / 10)
        # A negative detail from another candidate may exceed the error.
        return _decibels(max(error + detail, error * _LEAST_LEFT))

    def detail(self, at_photo: float, at_fit: float) -> float:
        """What measuring one file against the reference adds: squared error, or score."""
        if not self.is_psnr:
            return at_photo - at_fit
        return 10 ** (-at_photo / 10) - 10 ** (-at_fit / 10)

    def reached(self, score: float) -> bool:
        """Whether a score counts as reached."""
        return score >= self.value - self.tolerance


def aim_of(goal: Goal) -> Aim | None:
    """The target of a goal; docs/decisions/numbers.md has the tolerances."""
    if goal.target_psnr is not None:
        return Aim("target_psnr", goal.target_psnr, 0.05, 0.12, 0.02, 0.35, 3.0, (1.5, 12.0), " dB")
    if goal.target_ssimulacra2 is not None:
        return Aim(
            "target_ssimulacra2", goal.target_ssimulacra2, 0.3, 0.8, 0.2, 2.5, 18.0, (4.0, 60.0), ""
        )
    return None


def _decibels(error: float) -> float:
    return -10 * math.log10(error) if error > 0 else math.inf
