"""Ties: parameters of outlines that follow from others while outlines are moved.

Smooth joins stay smooth, and level and upright lines stay so.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
SMOOTH_RAD = np.radians(12)  # largest turn at a join that is smooth
MIRROR = 1.5  # largest ratio of the handles of a smooth join that become equally long
UPRIGHT = 0.02  # largest ratio of the sides of a line that becomes upright


@dataclass
class Ties:
    """Parameters that follow from others.

    same    (2 n,) for each coordinate of n points, the coordinate to which it is equal
    handle, node, master  (t,) handle = node + ratio (node - master), which are indices of points
    ratio   (t,)
    """

    same: NDArray[np.int64]
    handle: NDArray[np.int64]
    node: NDArray[np.int64]
    master: NDArray[np.int64]
    ratio: Floats


def tied(point: Floats, segment, curved, path_start, closed) -> Ties:
    """Return the ties of a drawing.

    The handles on both sides of a smooth join lie on a line through it. If they are about equally
    long, they mirror each other, which a file writes in fewer bytes. A handle beside a straight line
    lies in its direction. The ends of a nearly upright line have the same coordinate.
    """
    same = np.arange(point.size)

    def root(i: int) -> int:
        while same[i] != i:
            i = same[i]
        return i

    handle, node, master, ratio = [], [], [], []
    used = set()
    for p in range(len(closed)):
        a, b = path_start[p], path_start[p + 1]
        for s in range(a, b):
            if not curved[s]:
                first, last = segment[s, 0], segment[s, 3]
                across, down = np.abs(point[last] - point[first])
                for c, (small, large) in enumerate(((across, down), (down, across))):
                    if small < UPRIGHT * large or (small < 0.03 and large > 1):
                        same[root(2 * last + c)] = root(2 * first + c)
        for s in range(a, b):
            before = s - 1 if s > a else (b - 1 if closed[p] else -1)
            if before < 0:
                continue
            at = segment[s, 0]
            one, other = (
                segment[before, 2 if curved[before] else 0],
                segment[s, 1 if curved[s] else 3],
            )
            if not (curved[before] or curved[s]):
                continue
            u, v = point[at] - point[one], point[other] - point[at]
            long_u, long_v = np.hypot(*u), np.hypot(*v)
            if min(long_u, long_v) < 0.3:
                continue
            turn = abs(np.arctan2(u[0] * v[1] - u[1] * v[0], u @ v))
            if turn > SMOOTH_RAD:
                continue
            # The handle of the longer arm leads, because its direction is more exact.
            leads = one if (not curved[before] or (curved[s] and long_u >= long_v)) else other
            follows = other if leads == one else one
            if follows in used or (leads in used and curved[before] and curved[s]):
                continue
            r = long_v / long_u if leads == one else long_u / long_v
            if curved[before] and curved[s]:
                if 1 / MIRROR <= r <= MIRROR:
                    r = 1.0
                # Both handles turn to their mean direction.
                way = u / long_u + v / long_v
                way /= np.hypot(*way)
                size = long_u if leads == one else long_v
                point[leads] = point[at] + (-size if leads == one else size) * way
            used |= {follows}
            handle.append(follows)
            node.append(at)
            master.append(leads)
            ratio.append(r)
    same = np.array([root(i) for i in range(len(same))], np.int64)
    columns = (np.array(values, np.int64) for values in (handle, node, master))
    return Ties(same, *columns, np.array(ratio, np.float64))
