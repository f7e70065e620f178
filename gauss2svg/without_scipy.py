"""Replace functions of SciPy by functions that return the same results.

These functions seldom need to import SciPy, and the import takes a third of a second
(docs/decisions/start.md).
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable

# Number of values that are smoothed at a time. It is small enough that the values stay in the
# processor's cache (docs/decisions/start.md).
_BAND_VALUES = 32768


def smoothed(
    plane: NDArray[np.floating], sigma: float, truncate: float = 4.0
) -> NDArray[np.floating]:
    """Return a plane (h, w), or planes (h, w, c), smoothed by a Gaussian window.

    The standard deviation of the window is sigma px, and its radius is `truncate` times sigma. The
    result is that of scipy.ndimage.gaussian_filter, but for the rounding of the weights. Columns
    are smoothed first, and then rows. Sums are computed in float64, in a fixed order.
    Beyond its border, the plane continues as its mirror image, so the outermost pixel comes twice.
    The result has the dtype of the plane.
    """
    weights = _weights(float(sigma), int(truncate * float(sigma) + 0.5))
    for _ in range(2):
        plane = np.swapaxes(_smoothed_down(np.ascontiguousarray(plane), weights), 0, 1)
    return np.ascontiguousarray(plane)


def _smoothed_down(plane: NDArray[np.floating], weights: tuple[float, ...]) -> NDArray[np.floating]:
    """Return a plane (h, w, ...) whose columns are smoothed. `weights` is half of the window."""
    smooth, radius = np.empty_like(plane), len(weights) - 1
    rows = mirrored(len(plane), radius)
    step = max(1, _BAND_VALUES // max(plane.shape[1], 1))
    for top in range(0, len(plane), step):
        lines = plane[rows[top : top + step + 2 * radius]].astype(np.float64)
        count = len(lines) - 2 * radius
        total = lines[radius : radius + count] * weights[0]
        pair = np.empty_like(total)
        for j in range(radius, 0, -1):
            np.add(lines[radius - j :][:count], lines[radius + j :][:count], out=pair)
            pair *= weights[j]
            total += pair
        smooth[top : top + count] = total
    return smooth


@lru_cache(maxsize=16)
def _weights(sigma: float, radius: int) -> tuple[float, ...]:
    """Return one half of a Gaussian window: the weights at 0, 1, 2 .. `radius` px from its centre.

    The other half is the mirror image. The sum of the weights of the whole window is 1.
    """
    x = np.arange(-radius, radius + 1)
    weights = portable.exp(-0.5 / (sigma * sigma) * x**2)
    return tuple(float(weight) for weight in (weights / weights.sum())[radius:])


def mirrored(length: int, radius: int) -> NDArray[np.intp]:
    """Return the indices that extend a line by its mirror image, by `radius` pixels at each end.

    The line has `length` pixels. For example, the indices are 1, 0, 0, 1, 2, 2, 1 if `length` is 3
    and `radius` is 2.
    """
    at = np.arange(-radius, length + radius) % (2 * length)
    return np.minimum(at, 2 * length - 1 - at)


# Each point is compared with each entry. If there are more such pairs than this, it is faster to
# import SciPy.
_MOST_COMPARED = 4_000_000


def nearest_entry(
    entries: NDArray[np.float64], points: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the distance (n,) from each point to the nearest entry, and that entry's index (n,).

    entries  coordinates (k, d)
    points   coordinates (n, d)

    The distances are exactly those of scipy.spatial.KDTree. If several entries are equally near,
    another one may be returned.
    """
    if len(entries) * len(points) > _MOST_COMPARED:
        from scipy.spatial import KDTree

        distance, entry = KDTree(entries).query(points)
        return np.asarray(distance), np.asarray(entry)
    squares, nearest = np.empty(len(points)), np.empty(len(points), np.intp)
    step = max(1, 65536 // len(entries))  # so few pairs stay in the processor's cache
    for first in range(0, len(points), step):
        band = points[first : first + step]
        square = np.zeros((len(band), len(entries)))
        for axis, column in enumerate(entries.T):
            square += np.square(band[:, axis, None] - column)
        squares[first : first + step] = square.min(axis=1)
        nearest[first : first + step] = square.argmin(axis=1)
    return np.sqrt(squares), nearest


def weighted_means(
    points: NDArray[np.float64],
    weight: NDArray[np.floating],
    entry: NDArray[np.intp],
    others: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the weighted mean (k, d) of the points (n, d) of each entry, for k-means.

    entry   index (n,) of each point's entry
    others  (k, d) rows that entries without points get
    """
    mass = np.bincount(entry, weight, len(others))[:, None]
    sums = np.stack([np.bincount(entry, weight * c, len(others)) for c in points.T], axis=1)
    return np.divide(sums, mass, out=others.copy(), where=mass > 0)
