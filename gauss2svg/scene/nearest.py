"""The nearest of a few points, as scipy.spatial.KDTree finds it, without its import."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Pairs of a point and an entry up to which comparing them all takes less time than importing SciPy
# (docs/decisions/start.md).
_FEW = 4_000_000
_BAND = 65536  # pairs at a time, which stay in the processor's cache


def nearest_entry(
    entries: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the distance (n,) from points (n, d) to the nearest of entries (k, d), and its index.

    Of several that are equally near it is the one that a KDTree finds first.
    """
    squares, found = np.empty(len(points)), np.empty(len(points), np.intp)
    step = max(1, _BAND // len(entries))
    for first in range(0, len(points), step):
        some = points[first : first + step]
        square = np.zeros((len(some), len(entries)))
        for axis, column in enumerate(entries.T):
            square += np.square(some[:, axis, None] - column)
        least = square.min(axis=1)
        tied = np.count_nonzero(square == least[:, None]) != len(some)
        if tied or len(entries) * len(points) > _FEW:
            from scipy.spatial import KDTree

            distance, entry = KDTree(entries).query(points)
            return np.asarray(distance), np.asarray(entry)
        squares[first : first + step] = least
        found[first : first + step] = square.argmin(axis=1)
    return np.sqrt(squares), found
