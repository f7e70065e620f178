"""Centrelines: branches of the skeleton of a thin part, moved to its middle, and their widths."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from gauss2svg import portable
from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.areas.masks import parts_of

HALF, ACROSS = 4.0, 0.25  # px across a line in which its middle is looked for, and the step there
RISE = 0.02  # rise of the share away from the middle of a line that is no other line beside it
MOST_MOVE = 0.7  # px by which a point moves to the middle at once
SMOOTHINGS = 2


_AROUND = [(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)]  # y and x


def _neighbors(on: set[tuple[int, int]], y: int, x: int) -> list[tuple[int, int]]:
    """Return the neighbours of a pixel of a skeleton: diagonal ones without a common neighbour."""
    return [
        (y + v, x + u)
        for v, u in _AROUND
        if (y + v, x + u) in on
        and (v == 0 or u == 0 or ((y + v, x) not in on and (y, x + u) not in on))
    ]


def _traced(skeleton: Bools) -> tuple[list[list[tuple[int, int]]], Bools]:
    """Return the branches of a skeleton between its ends and junctions, its loops, and junctions.

    Branches are pixels (y, x). A loop ends where it starts. Neighbouring junctions have no branch
    between them. Junctions are the pixels (h, w) that have more than two neighbours.
    """
    pixels = list(zip(*(at.tolist() for at in np.nonzero(skeleton)), strict=True))
    on = set(pixels)
    beside = {pixel: _neighbors(on, *pixel) for pixel in pixels}
    left = {pixel for pixel in pixels if len(beside[pixel]) == 2}
    junction = np.zeros(skeleton.shape, bool)
    for pixel in pixels:
        junction[pixel] = len(beside[pixel]) > 2
    branches = list[list[tuple[int, int]]]()
    # First come branches, which begin at ends and junctions, then loops.
    for start in [p for p in pixels if p not in left] + pixels:
        is_loop = len(beside[start]) == 2
        for first in beside[start]:
            if first not in left or (is_loop and start not in left):
                continue
            branch = [start, first]
            while branch[-1] in left:
                left.remove(branch[-1])
                if branch[-1] == start:
                    break
                branch.append(next(p for p in beside[branch[-1]] if p != branch[-2]))
            branches.append(branch)
    return branches, junction


def branches_of(skeleton: Bools) -> tuple[list[Floats], list[list[int]], Ints]:
    """Return the branches (n, 2) of a skeleton, the junctions at their ends, and all junctions.

    Branches are x, y of pixel centres. A loop without a junction ends where it starts. Junctions
    have labels (h, w) from 1 on. The end of a branch that is at none has 0.
    """
    traced, is_junction = _traced(skeleton)
    junction, _ = parts_of(is_junction)
    branches = [np.array(branch)[:, ::-1] + 0.5 for branch in traced]
    ends = [[int(junction[branch[k]]) for k in (0, -1)] for branch in traced]
    return branches, ends, junction


def _normals(points: Floats, closed: bool) -> Floats:
    """Return the unit normals (n, 2) of a polyline."""
    index = np.arange(len(points))
    if closed:
        along = points[(index + 2) % len(points)] - points[index - 2]
    else:
        along = points[np.minimum(index + 2, len(points) - 1)] - points[np.maximum(index - 2, 0)]
    along = along / np.maximum(portable.hypot(*along.T), 1e-9)[:, None]
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
        middle = portable.product(profile, places) / np.maximum(profile.sum(axis=1), 1e-6)
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
