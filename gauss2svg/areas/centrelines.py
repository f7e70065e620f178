"""Centrelines of thin parts: chains of pixels of a skeleton, moved to the middle of the part."""

from __future__ import annotations

import itertools

import numpy as np
from scipy import ndimage

from gauss2svg.areas.kernels import Bools, Floats, inner, kernel
from gauss2svg.areas.masks import parts_of

SPUR = 3  # pixels; shorter branches are noise of the skeleton
STRAIGHT = -0.7  # largest cosine between two branches that go on as one line
ARM = 6  # pixels from a junction by which the direction of a branch is measured
ALIKE, ALIKE_SHARE = 0.25, 0.15  # px, and share of a width, by which widths of one line may differ
HALF, ACROSS = 3.0, 0.25  # px across a line in which its width is measured, and the step there

End = tuple[int, int]  # index of a branch, and 0 for its first pixel or 1 for its last one


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


def chains_of(skeleton: Bools, share: Floats) -> list[Floats]:
    """Return the centrelines (n, 2) of a skeleton as x, y of pixel centres.

    Short spurs are left out, and branches of about equal width that go straight on through a
    junction are joined. The first point of a loop is also its last one.
    """
    on = np.pad(skeleton.astype(np.uint8), 1)
    degree, size = np.zeros_like(on), int(on.sum())
    pixels, start = np.empty((6 * size + 16, 2), np.int64), np.empty(4 * size + 8, np.int64)
    count = trace_branches(on, degree, np.zeros_like(on), pixels, start)
    junction, _ = parts_of(degree > 2)
    branches: list[Floats] = []
    junctions: dict[int, list[End]] = {}
    for a, b in itertools.pairwise(start[: count + 1]):
        at = [int(junction[tuple(pixels[end])]) for end in (a, b - 1)]
        if b - a > SPUR or bool(at[0]) == bool(at[1]) or count == 1:
            for side in (0, 1):
                if at[side]:
                    junctions.setdefault(at[side], []).append((len(branches), side))
            branches.append(pixels[a:b, ::-1] - 0.5)
    link = _links(branches, list(junctions.values()), share)
    lines: list[Floats] = []
    used: set[int] = set()
    for i in range(len(branches)):
        if i in used:
            continue
        end, walked = (i, 0), {i}  # goes back to the beginning of the line
        while end in link and link[end][0] not in walked:
            before, side = link[end]
            end = before, 1 - side
            walked.add(before)
        line, following = list[Floats](), end
        while following is not None and following[0] not in used:
            index, side = following
            used.add(index)
            line.append(branches[index][:: -1 if side else 1])
            following = link.get((index, 1 - side))
        points = np.concatenate(line)
        is_new = np.append(True, (np.diff(points, axis=0) != 0).any(axis=1))
        lines.append(points[is_new])
    return lines


def _links(branches: list[Floats], junctions: list[list[End]], share: Floats) -> dict[End, End]:
    """Return the ends of branches that go on as one line, each with the other.

    junctions  ends of branches that meet
    """
    width = [width_along(branch, share, False) for branch in branches]
    link: dict[End, End] = {}
    for ends in junctions:
        ways = []
        for i, side in ends:
            branch = branches[i][:: -1 if side else 1]
            way = branch[min(ARM, len(branch) - 1)] - branch[0]
            ways.append(way / max(np.hypot(*way), 1e-9))
        pairs = []
        for (a, way), (b, other) in itertools.combinations(zip(ends, ways, strict=True), 2):
            most = ALIKE + ALIKE_SHARE * min(width[a[0]], width[b[0]])
            if a[0] != b[0] and abs(width[a[0]] - width[b[0]]) < most:
                pairs.append((float(way @ other), a, b))
        for cosine, a, b in sorted(pairs):
            if (len(ends) == 2 or cosine < STRAIGHT) and a not in link and b not in link:
                link[a], link[b] = b, a
    return link


def _normals(points: Floats, closed: bool) -> Floats:
    """Return the unit normals (n, 2) of a polyline."""
    index = np.arange(len(points))
    if closed:
        along = points[(index + 2) % len(points)] - points[index - 2]
    else:
        along = points[np.minimum(index + 2, len(points) - 1)] - points[np.maximum(index - 2, 0)]
    along = along / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    return np.stack([-along[:, 1], along[:, 0]], axis=1)


def _profile(points: Floats, share: Floats, normal: Floats, places: Floats) -> Floats:
    """Return the share (n, k) at places across a polyline, in px from it."""
    at = points[:, None] + places[None, :, None] * normal[:, None]
    padded = np.pad(share, 4)
    return ndimage.map_coordinates(padded, [at[..., 1] + 3.5, at[..., 0] + 3.5], order=1)


def centred(points: Floats, share: Floats, closed: bool) -> Floats:
    """Return the points of a polyline moved to the middle of a part, and smoothed."""
    places = np.linspace(-2, 2, 17)
    for _ in range(2):
        normal = _normals(points, closed)
        profile = _profile(points, share, normal, places)
        middle = (profile @ places) / np.maximum(profile.sum(axis=1), 1e-6)
        points = points + np.clip(middle, -0.7, 0.7)[:, None] * normal
        for _ in range(2 if len(points) > 4 else 0):
            before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
            smooth = 0.25 * before + 0.5 * points + 0.25 * after
            if not closed:
                smooth[0], smooth[-1] = points[0], points[-1]
            points = smooth
    return points


def width_along(points: Floats, share: Floats, closed: bool) -> float:
    """Return the width of a line: the median share across it, of the hump in the middle alone."""
    places = np.arange(-HALF, HALF + 0.01, ACROSS)
    profile = _profile(points, share, _normals(points, closed), places)
    middle = len(places) // 2
    for i in range(1, middle + 1):
        for side in (1, -1):
            at, before = middle + side * i, middle + side * (i - 1)
            profile[:, at] = np.minimum(profile[:, at], profile[:, before] + 0.02)
    return float(np.median(profile.sum(axis=1) * ACROSS))
