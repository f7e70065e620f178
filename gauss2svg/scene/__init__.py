"""The model: a canvas, a background and an ordered list of Gaussians with their falloff."""

from gauss2svg.scene.scene import (
    ADD,
    BLENDS,
    LEAST_CANVAS,
    LEAST_SIGMA,
    MOST_CANVAS,
    MOST_MEAN,
    MOST_SIGMA,
    MOST_SIGNED,
    OVER,
    RHO_LIMIT,
    Scene,
    narrowing_of,
    peaks_of,
    whitening_of,
)

__all__ = [
    "ADD",
    "BLENDS",
    "LEAST_CANVAS",
    "LEAST_SIGMA",
    "MOST_CANVAS",
    "MOST_MEAN",
    "MOST_SIGMA",
    "MOST_SIGNED",
    "OVER",
    "RHO_LIMIT",
    "Scene",
    "narrowing_of",
    "peaks_of",
    "whitening_of",
]
