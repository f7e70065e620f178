"""Nearest-neighbour search that equals scipy.spatial.KDTree, mostly without importing it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Pairs of a point and an entry. Comparing up to this number of pairs takes less time than importing
# SciPy (docs/decisions/start.md).
_MOST_COMPARED = 4_000_000
_BAND = 65536  # pairs compared at a time, which stay in the processor's cache


def nearest_entry(
    entries: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the distance (n,) from each point (n, d) to the nearest entry (k, d), and its index.

    If several entries are equally near, it is the one that a KDTree finds first.
    """
    squares, nearest = np.empty(len(points)), np.empty(len(points), np.intp)
    step = max(1, _BAND // len(entries))
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
