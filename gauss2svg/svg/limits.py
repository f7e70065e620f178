"""What numbers a file may hold: renderers compute in float32, and some crash on large ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg.errors import SceneError
from gauss2svg.scene import Scene

# resvg panics from about 1e9 on; all six renderers draw numbers up to 1e8 within 2.1 levels of 255
# (docs/decisions/numbers.md).
LARGEST_NUMBER = 1e8
_SMALLEST_CANVAS = 0.01
# px. Cairo has 23 bits for whole pixels, and is 47 levels off at 1e7.
_FARTHEST = 8e6


def check_canvas(scene: Scene) -> None:
    """Raise SceneError for a canvas that is too small to be written."""
    if min(scene.width, scene.height) < _SMALLEST_CANVAS:
        raise SceneError(
            f"canvas must be at least {_SMALLEST_CANVAS} px a side in an SVG; got "
            f"{scene.width:g}x{scene.height:g} px. Try to scale the scene up"
        )


def writable(
    scene: Scene, radius: ArrayLike, precision: float, unit: ArrayLike = 1
) -> NDArray[np.bool_]:
    """(n,) whether each shape's numbers, in user units of `precision` px, fit into a file.

    radius  in sigmas, of the drawn discs, whose matrices are for circles of radius `unit`
    A shape whose numbers do not fit, or that reaches too far for renderers, can be left out where
    it lies entirely off the canvas. Raises SceneError for one that may be visible.
    """
    extent = np.asarray(radius)[..., None] * scene.sigma
    offset = np.abs(scene.mean)
    number = np.maximum(offset, extent / np.asarray(unit)[..., None]).max(axis=1) / precision
    farthest = (offset + extent).max(axis=1)
    canvas = np.array([scene.width, scene.height])
    beyond = np.maximum(-scene.mean, scene.mean - canvas)
    # All of a shape is drawn within 4 radii of its mean, because a blur fills up to 2.5 radii
    # around its disc; and a px for antialiasing.
    off = (beyond > 4.0 * extent + 1.0).any(axis=1)
    fits = (number <= LARGEST_NUMBER) & (farthest <= _FARTHEST)
    lost = ~fits & ~off
    if lost.any():
        i = int(lost.argmax())
        raise SceneError(
            f"Gaussian {i} must reach at most {_FARTHEST:g} px, with numbers up to "
            f"{LARGEST_NUMBER:g}; got {farthest[i]:.3g} px and {number[i]:.3g} at a precision of "
            f"{precision:g} px, for mean {scene.mean[i].tolist()} and sigma "
            f"{scene.sigma[i].tolist()} px. Try to clip its sigma, to scale the scene down, to "
            "drop the Gaussian, or a coarser precision"
        )
    return fits
