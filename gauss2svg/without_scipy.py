"""Functions whose results equal SciPy's in every bit, and which seldom import SciPy.

SciPy's packages take a third of a second to import (docs/decisions/start.md).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

# Number of values that are smoothed at a time. They stay in the cache (docs/decisions/start.md).
_BAND_VALUES = 32768


def smoothed(
    plane: NDArray[np.floating], sigma: float, truncate: float = 4.0
) -> NDArray[np.floating]:
    """Return a plane (h, w) smoothed by a Gaussian window of sigma px, cut at `truncate` sigma.

    The result equals scipy.ndimage.gaussian_filter. Columns are smoothed first, then rows. Sums are
    in float64 and have SciPy's order. The plane is mirrored beyond its rim, with the outermost
    pixel twice. Its dtype is kept.
    """
    weights = _weights(float(sigma), int(truncate * float(sigma) + 0.5))
    plane = np.asarray(plane)
    down = np.empty_like(plane, order="C")
    height, width = plane.shape
    radius = len(weights) - 1
    rows, columns = _mirrored(height, radius), _mirrored(width, radius)
    step = max(1, _BAND_VALUES // max(width, 1))
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
    """Return the sum of shifted(0) * weights[0] and all (shifted(-j) + shifted(j)) * weights[j]."""
    total = shifted(0) * weights[0]
    pair = np.empty_like(total)
    for j in range(len(weights) - 1, 0, -1):
        np.add(shifted(-j), shifted(j), out=pair)
        pair *= weights[j]
        total += pair
    return total


@lru_cache(maxsize=16)
def _weights(sigma: float, radius: int) -> tuple[float, ...]:
    """Return the weights of the centre and of one side. Those of both sides and it sum to 1."""
    x = np.arange(-radius, radius + 1)
    weights = np.exp(-0.5 / (sigma * sigma) * x**2)
    return tuple(float(weight) for weight in (weights / weights.sum())[radius:])


def _mirrored(length: int, radius: int) -> NDArray[np.intp]:
    """Return the indices that extend a line by `radius` mirrored pixels at either end."""
    at = np.arange(-radius, length + radius) % (2 * length)
    return np.minimum(at, 2 * length - 1 - at)


# Number of (point, entry) pairs above which importing SciPy is faster than comparing all pairs.
_MOST_COMPARED = 4_000_000
_BAND_PAIRS = 65536  # pairs compared at a time, which stay in the processor's cache


def nearest_entry(
    entries: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the distance (n,) from each point (n, d) to the nearest entry (k, d), and its index.

    The result equals that of scipy.spatial.KDTree, also if several entries are equally near.
    """
    squares, nearest = np.empty(len(points)), np.empty(len(points), np.intp)
    step = max(1, _BAND_PAIRS // len(entries))
    for first in range(0, len(points), step):
        band = points[first : first + step]
        square = np.zeros((len(band), len(entries)))
        for axis, column in enumerate(entries.T):
            square += np.square(band[:, axis, None] - column)
        least = square.min(axis=1)
        tied = np.count_nonzero(square == least[:, None]) != len(band)
        if tied or len(entries) * len(points) > _MOST_COMPARED:
            from scipy.spatial import KDTree

            distance, entry = KDTree(entries).query(points)
            return np.asarray(distance), np.asarray(entry)
        squares[first : first + step] = least
        nearest[first : first + step] = square.argmin(axis=1)
    return np.sqrt(squares), nearest
