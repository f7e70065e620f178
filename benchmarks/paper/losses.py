"""Figure 5: the same fit with four losses."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from common import largest_square

from gauss2svg.measure import metrics

from .engine import EXPONENTIAL, LOSSES, PRODUCT, fit
from .photos import Pixels
from .settings import Settings

CROP = 0.25  # of the shorter side


@dataclass(frozen=True)
class LossScore:
    """PSNR in dB and SSIM of the model's image with one loss."""

    photo: str
    loss: str
    psnr: float
    ssim: float
    seconds: float


def compared(
    photos: dict[str, Pixels], settings: Settings
) -> tuple[list[LossScore], dict[tuple[str, str], Pixels]]:
    """Scores of every photo and loss, and the images by photo and loss."""
    scores, images = [], {}
    for name, pixels in photos.items():
        for loss in LOSSES:
            trace = fit(
                pixels, PRODUCT, EXPONENTIAL, settings.loss_gaussians, settings.rounds,
                settings.loss_iterations, loss=loss,
            )  # fmt: skip
            similar = metrics.ssim(trace.image, pixels)
            scores.append(LossScore(name, loss, trace.psnr, similar, trace.seconds))
            images[name, loss] = trace.image
    return scores, images


def means(scores: Sequence[LossScore]) -> dict[str, tuple[float, float]]:
    """Mean PSNR in dB and mean SSIM over the photos, by loss."""
    return {
        loss: (
            statistics.fmean(s.psnr for s in scores if s.loss == loss),
            statistics.fmean(s.ssim for s in scores if s.loss == loss),
        )
        for loss in LOSSES
    }


def most_different_square(images: Sequence[Pixels]) -> tuple[slice, slice]:
    """Rows and columns of the square where the images differ most from each other."""
    height, width = images[0].shape[:2]
    side = max(4, round(CROP * min(height, width)))
    apart = np.var(np.stack(images), axis=0).sum(axis=2)
    top, left = largest_square(apart, side)
    return slice(top, top + side), slice(left, left + side)
