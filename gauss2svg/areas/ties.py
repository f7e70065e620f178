"""Ties: coordinates of points that follow from others while outlines are moved.

Smooth joins stay smooth, and level and upright lines stay so.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gauss2svg import portable
from gauss2svg.areas.kernels import Bools, Floats, Ints

SMOOTH_RAD = np.radians(12)  # largest turn at a join that is smooth
LEAST_ARM = 0.3  # px; shorter handles have no sure direction
MIRROR = 1.5  # largest ratio of the handles of a smooth join that become equally long
# A line becomes upright if the ratio of its sides is at most UPRIGHT, or if it is longer than 1 px
# and at most LEVEL px off.
UPRIGHT, LEVEL = 0.02, 0.03


class Ties(NamedTuple):
    """Coordinates, x and y of points in turns, that follow from others.

    same      (2 n,) for each coordinate, the one to which it is equal
    follower, node, master  (t,) coordinates: follower = of_node node + of_master master
    of_node, of_master  (t,)
    """

    same: Ints
    follower: Ints
    node: Ints
    master: Ints
    of_node: Floats
    of_master: Floats

    @classmethod
    def none(cls, count: int) -> Ties:
        """Return the ties of coordinates that are all free."""
        empty = np.zeros(0, np.int64)
        return cls(np.arange(count), empty, empty, empty, np.zeros(0), np.zeros(0))

    def kept(self, point: Floats) -> Floats:
        """Return points (n, 2) whose coordinates follow from the free ones of `point`."""
        value = point.ravel()[self.same]
        value[self.follower] = self.of_node * value[self.node] + self.of_master * value[self.master]
        return value.reshape(-1, 2)


def tied(
    point: Floats, segment: Ints, curved: Bools, path_start: Ints, closed: Bools
) -> tuple[Floats, Ties]:
    """Return the points (n, 2) of a drawing with ties, and the ties.

    The handles on both sides of a smooth join lie on a line through it. If they are about equally
    long, they mirror each other, which a file writes in fewer bytes. A handle beside a straight
    line lies in its direction. The ends of a nearly upright line have the same coordinate.
    """
    same = _upright(point, segment[~curved])
    before = np.arange(len(segment)) - 1
    before[path_start[:-1]] = np.where(closed, path_start[1:] - 1, -1)
    was_curved = curved[before]
    node = segment[:, 0]
    one = np.where(was_curved, segment[before, 2], segment[before, 0])
    other = np.where(curved, segment[:, 1], segment[:, 3])
    u, v = point[node] - point[one], point[other] - point[node]
    long_u, long_v = portable.hypot(*u.T), portable.hypot(*v.T)
    turn = np.abs(portable.arctan2(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], (u * v).sum(axis=1)))
    is_smooth = (turn <= SMOOTH_RAD) & (np.minimum(long_u, long_v) >= LEAST_ARM)
    at = np.flatnonzero(is_smooth & (before >= 0) & (was_curved | curved))
    node, one, other, u, v, long_u, long_v = (
        values[at] for values in (node, one, other, u, v, long_u, long_v)
    )
    # The handle of the longer arm leads, because its direction is more exact.
    both, leads = (was_curved & curved)[at], curved[at]
    leads &= ~both | (long_u >= long_v)
    master, follower = np.where(leads, [one, other], [other, one])
    ratio = np.where(leads, long_v / long_u, long_u / long_v)
    ratio[both & (ratio >= 1 / MIRROR) & (ratio <= MIRROR)] = 1.0
    # Two handles turn to their mean direction.
    way = u / long_u[:, None] + v / long_v[:, None]
    way *= (np.where(leads, -long_u, long_v) / portable.hypot(*way.T))[:, None]
    point = point.copy()
    point[master[both]] = (point[node] + way)[both]
    of_node = np.repeat(1.0 + ratio, 2)
    follower, node, master = (
        (2 * index[:, None] + [0, 1]).ravel() for index in (follower, node, master)
    )
    ties = Ties(same, follower, same[node], same[master], of_node, 1.0 - of_node)
    return ties.kept(point), ties


def _upright(point: Floats, line: Ints) -> Ints:
    """Return for each coordinate (2 n,) the one to which lines (k, 4) make it equal."""
    same = np.arange(point.size)

    def root(i: int) -> int:
        while same[i] != i:
            i = same[i]
        return i

    for first, last in line[:, [0, 3]]:
        size = np.abs(point[last] - point[first])
        for c in (0, 1):
            small, large = size[c], size[1 - c]
            if small < UPRIGHT * large or (small < LEVEL and large > 1):
                same[root(2 * last + c)] = root(2 * first + c)
    return np.array([root(i) for i in range(len(same))], np.int64)
