"""The model: a canvas, a background and an ordered list of Gaussians with their falloff."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gauss2svg.scene.parameters import (
        BLURRED,
        LEAST_SIGMA,
        MOST_MEAN,
        MOST_SIGMA,
        MOST_SIGNED,
        PLAIN,
        RHO_LIMIT,
        SOFT,
    )
    from gauss2svg.scene.scene import (
        LEAST_CANVAS,
        MOST_CANVAS,
        Scene,
        narrowing_of,
        peaks_of,
        whitening_of,
    )

OVER, ADD = "over", "add"
BLENDS = (OVER, ADD)

__all__ = [
    "ADD",
    "BLENDS",
    "BLURRED",
    "LEAST_CANVAS",
    "LEAST_SIGMA",
    "MOST_CANVAS",
    "MOST_MEAN",
    "MOST_SIGMA",
    "MOST_SIGNED",
    "OVER",
    "PLAIN",
    "RHO_LIMIT",
    "SOFT",
    "Scene",
    "narrowing_of",
    "peaks_of",
    "whitening_of",
]


def __getattr__(name: str) -> Any:
    # Scenes load on first use, with NumPy: options need the names of blends alone.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gauss2svg.scene import parameters, scene

    return getattr(parameters if hasattr(parameters, name) else scene, name)
