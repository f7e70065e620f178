"""Gaussian smoothing of planes, equal to scipy.ndimage.gaussian_filter in every bit.

That function takes a third of a second to import (docs/decisions/start.md). A plane is smoothed
along its columns, then along its rows. Sums are in float64 and have SciPy's order.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

_BAND = 32768  # values of a band, which stay in the processor's cache (docs/decisions/start.md)


def smoothed(
    plane: NDArray[np.floating], sigma: float, truncate: float = 4.0
) -> NDArray[np.floating]:
    """Return a plane (h, w) smoothed by a Gaussian window of sigma px, cut at `truncate` sigma.

    The plane is mirrored beyond its rim, with the outermost pixel twice. Its dtype is kept.
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
    """Return the weighted sum of an array and its shifts by -j and j, with weights[j]."""
    total = shifted(0) * weights[0]
    pair = np.empty_like(total)
    for j in range(len(weights) - 1, 0, -1):
        np.add(shifted(-j), shifted(j), out=pair)
        pair *= weights[j]
        total += pair
    return total


@lru_cache(maxsize=16)
def _weights(sigma: float, radius: int) -> tuple[float, ...]:
    """Return the weights of the pixel itself and of those on one side; both sides add up to 1."""
    x = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 / (sigma * sigma) * x**2)
    return tuple(float(weight) for weight in (weights / weights.sum())[radius:])


def _mirrored(length: int, radius: int) -> NDArray[np.intp]:
    """Return the indices of a line that is mirrored by `radius` pixels at either end."""
    at = np.arange(-radius, length + radius) % (2 * length)
    return np.minimum(at, 2 * length - 1 - at)
