"""Areas of a film: those that its frames share stay as they are, to the last digit.

The areas of each frame are found anew, because things move, turn, appear and hide each other. An
area of the frame before takes the place of the new one that it matches best, if the picture then
has hardly more error. So what does not move has the same numbers in each frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from gauss2svg.scene.areas import Area

FAR = 1.0  # px; mean distance of nodes from the other outlines, of areas that may be the same
SAME = 0.06  # largest difference of a channel between the colours of such areas
# Kept areas may raise the squared error by this share and this value, which is seen nowhere.
MOST_SHARE, MOST_RISE = 0.1, 0.15


def kept(
    areas: tuple[Area, ...],
    before: tuple[Area, ...],
    error_of: Callable[[tuple[Area, ...]], float],
) -> tuple[Area, ...]:
    """Return areas of which those that have not changed are areas of the frame before.

    error_of  function that returns the squared error of areas
    """
    left, same = list(before), dict[int, Area]()
    for k, area in enumerate(areas):
        alike = [(_distance(one, area), n) for n, one in enumerate(left) if _is_alike(one, area)]
        distance, nearest = min(alike, default=(math.inf, 0))
        if distance <= FAR:
            same[k] = left.pop(nearest)
    most = (1 + MOST_SHARE) * error_of(areas) + MOST_RISE
    if error_of(tried := _with(areas, same)) <= most:
        return tried
    for k, old in same.items():
        if error_of(tried := _with(areas, {k: old})) <= most:
            areas = tried
    return areas


def _with(areas: tuple[Area, ...], others: dict[int, Area]) -> tuple[Area, ...]:
    return tuple(others.get(k, area) for k, area in enumerate(areas))


def _is_alike(one: Area, other: Area) -> bool:
    """Return whether two areas have the same kind, opacity and about the same paint."""
    means = [
        np.atleast_2d(a.paint if isinstance(a.paint, tuple) else a.paint.colors).mean(axis=0)
        for a in (one, other)
    ]
    same_kind = one.is_line == other.is_line and type(one.paint) is type(other.paint)
    return same_kind and bool(np.abs(means[0] - means[1]).max() <= SAME)


def _distance(one: Area, other: Area) -> float:
    """Return the mean distance in px of points along outlines from the other outlines."""
    a, b = _points(one), _points(other)
    return float(0.5 * (KDTree(b).query(a)[0].mean() + KDTree(a).query(b)[0].mean()))


PARTS = np.linspace(0, 1, 9)[:-1, None, None]  # places along each segment


def _points(area: Area) -> NDArray[np.float64]:
    """Return points (n, 2) along all outlines of an area."""
    p = np.concatenate([outline.segments for outline in area.outlines])[None]
    t, s = PARTS, 1 - PARTS
    weights = s * s * s, 3 * s * s * t, 3 * s * t * t, t * t * t
    points = np.stack([w * p[:, :, k] for k, w in enumerate(weights)]).sum(axis=0)
    return points.reshape(-1, 2)
