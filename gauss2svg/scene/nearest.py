"""The nearest of a few points, as scipy.spatial.KDTree finds it, without its import."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Pairs of a point and an entry up to which comparing them all takes less time than importing SciPy
# (docs/decisions/start.md).
_FEW = 4_000_000
_BAND = 65536  # pairs at a time, which stay in the processor's cache
_MOST_AXES = 7  # up to which a KDTree sums squares in their order


def nearest_entry(
    entries: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Distance (n,) from points (n, d) to the nearest of entries (k, d), and which one (n,) it is.

    Of several that are equally near it is the one that a KDTree finds first.
    """
    if entries.shape[1] > _MOST_AXES or len(entries) * len(points) > _FEW:
        return by_tree(entries, points)
    squares, found = np.empty(len(points)), np.empty(len(points), np.intp)
    step = max(1, _BAND // len(entries))
    for first in range(0, len(points), step):
        some = points[first : first + step]
        square = np.zeros((len(some), len(entries)))
        for axis, column in enumerate(entries.T):
            offset = some[:, axis, None] - column
            offset *= offset
            square += offset
        least = square.min(axis=1)
        if np.count_nonzero(square == least[:, None]) != len(some):
            return by_tree(entries, points)
        squares[first : first + step] = least
        found[first : first + step] = square.argmin(axis=1)
    return np.sqrt(squares), found


def by_tree(
    entries: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """nearest_entry by a KDTree, for many pairs, and where the order of its search decides."""
    from scipy.spatial import KDTree

    distance, entry = KDTree(entries).query(points)
    return np.asarray(distance, np.float64), np.asarray(entry, np.intp)
