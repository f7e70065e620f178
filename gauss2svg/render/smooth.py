"""Gaussian smoothing of planes, to the last bit as scipy.ndimage.gaussian_filter.

That takes a third of a second to import (docs/decisions/start.md). A plane is smoothed along its
columns, then along its rows; each sum is in float64, from the rim of the window to its centre.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

# Values of a band, whose sums stay in the processor's cache (docs/decisions/start.md).
_BAND = 32768


def smoothed(
    plane: NDArray[np.floating], sigma: float, truncate: float = 4.0
) -> NDArray[np.floating]:
    """A plane (h, w) under a Gaussian window of sigma px, cut at `truncate` sigma; of its dtype.

    Beyond its rim the plane is mirrored, with the outermost pixel twice.
    """
    weights = _weights(float(sigma), int(truncate * float(sigma) + 0.5))
    plane = np.asarray(plane)
    down = np.empty_like(plane, order="C")
    height, width = plane.shape
    radius = len(weights) - 1
    rows, columns = _mirrored(height, radius), _mirrored(width, radius)
    step = max(1, _BAND // max(width, 1))
    for top in range(0, height, step):
        count = min(step, height - top)
        lines = plane[rows[top : top + count + 2 * radius]].astype(np.float64)
        down[top : top + count] = _summed(
            weights, lambda j, lines=lines, count=count: lines[radius + j : radius + j + count]
        )
    across = np.empty_like(down)
    for top in range(0, height, step):
        lines = down[top : top + step].astype(np.float64)[:, columns]
        across[top : top + step] = _summed(
            weights, lambda j, lines=lines: lines[:, radius + j : radius + j + width]
        )
    return across


def _summed(
    weights: tuple[float, ...], shifted: Callable[[int], NDArray[np.float64]]
) -> NDArray[np.float64]:
    """The weighted sum of an array and its shifts by j, weights[0] for j = 0."""
    total = shifted(0) * weights[0]
    pair = np.empty_like(total)
    for j in range(len(weights) - 1, 0, -1):
        np.add(shifted(-j), shifted(j), out=pair)
        pair *= weights[j]
        total += pair
    return total


@lru_cache(maxsize=16)
def _weights(sigma: float, radius: int) -> tuple[float, ...]:
    """Weights of the pixel itself and of those to either side, 1 in all."""
    x = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 / (sigma * sigma) * x**2)
    return tuple(float(weight) for weight in (weights / weights.sum())[radius:])


def _mirrored(length: int, radius: int) -> NDArray[np.intp]:
    """Indices of a line with so many pixels more at either end."""
    at = np.arange(-radius, length + radius) % (2 * length)
    return np.minimum(at, 2 * length - 1 - at)
