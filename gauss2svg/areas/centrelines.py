"""Centrelines: branches of the skeleton of a thin part, moved to its middle, and their widths."""

from __future__ import annotations

import itertools

import numpy as np
from scipy import ndimage

from gauss2svg.areas.kernels import Bools, Floats, Ints, inner, kernel
from gauss2svg.areas.masks import parts_of

HALF, ACROSS = 4.0, 0.25  # px across a line in which its middle is looked for, and the step there
RISE = 0.02  # rise of the share away from the middle of a line that is no other line beside it
MOST_MOVE = 0.7  # px by which a point moves to the middle at once
SMOOTHINGS = 2


@inner
def _are_linked(on, y, x, v, u):
    """Whether two pixels are neighbours: diagonal ones only without a common neighbour."""
    return on[v, u] > 0 and (y == v or x == u or (on[y, u] == 0 and on[v, x] == 0))


@kernel
def trace_branches(on, degree, is_left, branch, start):
    """Trace the branches of a skeleton between its ends and junctions, and its loops.

    on      (h, w) 1 for pixels of the skeleton, whose border is 0
    degree  (h, w) zeros. Changed to the number of neighbours of pixels of the skeleton
    is_left  (h, w) zeros. Changed to 1 for pixels of loops and branches, and back to 0
    branch  (n, 2) output: y and x of the pixels of all branches. A loop ends where it starts
    start   (m,) output: first pixel of each branch, and the number of pixels
    Return the number of branches. Neighbouring junctions have none between them.
    """
    h, w = on.shape
    down, across = (0, 1, 0, -1, 1, 1, -1, -1), (1, 0, -1, 0, 1, -1, -1, 1)
    for y in range(1, h - 1):
        for x in range(1, w - 1):
            if on[y, x]:
                for k in range(8):
                    degree[y, x] += _are_linked(on, y, x, y + down[k], x + across[k])
                is_left[y, x] = degree[y, x] == 2
    count = pixels = 0
    for is_loop in (False, True):
        for y0 in range(1, h - 1):
            for x0 in range(1, w - 1):
                if not (is_left[y0, x0] if is_loop else on[y0, x0] and degree[y0, x0] != 2):
                    continue
                for first in range(8):
                    y, x, before_y, before_x = y0 + down[first], x0 + across[first], y0, x0
                    if not (is_left[y, x] and _are_linked(on, y0, x0, y, x)):
                        continue
                    start[count] = pixels
                    count += 1
                    branch[pixels, 0], branch[pixels, 1] = y0, x0
                    pixels += 1
                    while True:
                        branch[pixels, 0], branch[pixels, 1] = y, x
                        pixels += 1
                        is_left[y, x] = 0
                        if degree[y, x] != 2 or (y == y0 and x == x0):
                            break
                        v, u = y, x
                        for k in range(8):
                            v, u = y + down[k], x + across[k]
                            if _are_linked(on, y, x, v, u) and (v != before_y or u != before_x):
                                break
                        before_y, before_x, y, x = y, x, v, u
    start[count] = pixels
    return count


def branches_of(skeleton: Bools) -> tuple[list[Floats], list[list[int]], Ints]:
    """Return the branches (n, 2) of a skeleton, the junctions at their ends, and all junctions.

    Branches are x, y of pixel centres. A loop without a junction ends where it starts. Junctions
    have labels (h, w) from 1 on. The end of a branch that is at none has 0.
    """
    on = np.pad(skeleton.astype(np.uint8), 1)
    degree, size = np.zeros_like(on), int(on.sum())
    pixels, start = np.empty((6 * size + 16, 2), np.int64), np.empty(4 * size + 8, np.int64)
    count = trace_branches(on, degree, np.zeros_like(on), pixels, start)
    junction, _ = parts_of(degree > 2)
    branches, ends = [], []
    for a, b in itertools.pairwise(start[: count + 1]):
        branches.append(pixels[a:b, ::-1] - 0.5)
        ends.append([int(junction[tuple(pixels[at])]) for at in (a, b - 1)])
    return branches, ends, junction[1:-1, 1:-1]


def _normals(points: Floats, closed: bool) -> Floats:
    """Return the unit normals (n, 2) of a polyline."""
    index = np.arange(len(points))
    if closed:
        along = points[(index + 2) % len(points)] - points[index - 2]
    else:
        along = points[np.minimum(index + 2, len(points) - 1)] - points[np.maximum(index - 2, 0)]
    along = along / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    return np.stack([-along[:, 1], along[:, 0]], axis=1)


def _profile(points: Floats, share: Floats, closed: bool) -> tuple[Floats, Floats, Floats]:
    """Return the normals (n, 2) of a polyline, and the shares (n, k) at places (k,) across it.

    The share never rises away from the polyline, so that lines beside it do not count.
    """
    normal, places = _normals(points, closed), np.arange(-HALF, HALF + 0.01, ACROSS)
    at = points[:, None] + places[None, :, None] * normal[:, None]
    padded = np.pad(share, 5)
    profile = ndimage.map_coordinates(padded, [at[..., 1] + 4.5, at[..., 0] + 4.5], order=1)
    middle = len(places) // 2
    for i in range(1, middle + 1):
        for side in (1, -1):
            at, before = middle + side * i, middle + side * (i - 1)
            profile[:, at] = np.minimum(profile[:, at], profile[:, before] + RISE)
    return normal, places, profile


def centred(points: Floats, share: Floats, closed: bool, reach: float) -> Floats:
    """Return the points of a polyline moved to the middle of a part, and smoothed.

    reach  px across the polyline in which the part is
    """
    for _ in range(2):
        normal, places, profile = _profile(points, share, closed)
        profile = np.where(np.abs(places) <= reach, profile, 0)
        middle = (profile @ places) / np.maximum(profile.sum(axis=1), 1e-6)
        points = points + np.clip(middle, -MOST_MOVE, MOST_MOVE)[:, None] * normal
        for _ in range(SMOOTHINGS if len(points) > 4 else 0):
            before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
            smooth = 0.25 * before + 0.5 * points + 0.25 * after
            if not closed:
                smooth[0], smooth[-1] = points[0], points[-1]
            points = smooth
    return points


def widths_along(points: Floats, share: Floats, closed: bool) -> Floats:
    """Return the width (n,) of a line at each point of its centreline: the share across it."""
    return _profile(points, share, closed)[2].sum(axis=1) * ACROSS
