"""Centrelines of thin parts: chains of pixels of a skeleton, moved to the middle of the part."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gauss2svg.areas.kernels import kernel

Floats = NDArray[np.float64]
SPUR = 3  # pixels; shorter branches are noise of the skeleton
STRAIGHT = -0.7  # largest cosine between two branches that go on as one line
ALIKE, ALIKE_SHARE = 0.25, 0.15  # px, and share of a width, by which widths of one line may differ
HALF, ACROSS = 3.0, 0.25  # px across a line in which its width is measured, and the step there


@kernel
def trace_chains(on, degree, chain, start, ends):
    """Trace the chains of a skeleton between its ends and junctions, and its loops.

    on      (h, w) skeleton, whose border is off. Pixels of chains are switched off
    degree  (h, w) number of neighbours
    chain   (n, 2) output: y and x of the pixels of all chains
    start   (m,) output: first pixel of each chain
    ends    (m,) output: 1 if a chain is a loop
    Return the number of chains and of pixels.
    """
    h, w = on.shape
    chains = pixels = 0
    dy = np.array([0, 1, 0, -1, 1, 1, -1, -1])
    dx = np.array([1, 0, -1, 0, 1, -1, -1, 1])
    for loops in range(2):
        for y0 in range(h):
            for x0 in range(w):
                if (
                    not on[y0, x0]
                    or (loops == 0 and degree[y0, x0] == 2)
                    or (loops == 1 and degree[y0, x0] != 2)
                ):
                    continue
                for first in range(8 if loops == 0 else 1):
                    v, u = y0 + dy[first], x0 + dx[first]
                    if loops == 0 and not (
                        on[v, u] and degree[v, u] == 2 and _linked(on, y0, x0, v, u)
                    ):
                        continue
                    start[chains] = pixels
                    chain[pixels, 0], chain[pixels, 1] = y0, x0
                    pixels += 1
                    y, x, py, px = y0, x0, y0, x0
                    if loops == 0:
                        y, x = v, u
                    else:
                        on[y, x] = False
                    closed = 0
                    while True:
                        if loops == 0 or not (y == y0 and x == x0):
                            chain[pixels, 0], chain[pixels, 1] = y, x
                            pixels += 1
                            if degree[y, x] != 2:
                                break
                            on[y, x] = False
                        found = False
                        for k in range(8):
                            v, u = y + dy[k], x + dx[k]
                            if (v == py and u == px) or not _linked2(degree, y, x, v, u):
                                continue
                            if on[v, u] and not (
                                loops == 0 and v == y0 and u == x0 and pixels - start[chains] < 3
                            ):
                                py, px, y, x = y, x, v, u
                                found = True
                                break
                        if not found:
                            closed = loops
                            break
                    if loops == 1:
                        chain[pixels, 0], chain[pixels, 1] = y0, x0
                        pixels += 1
                    ends[chains] = closed
                    chains += 1
    # Junctions beside junctions, without a chain between them, are left out.
    start[chains] = pixels
    return chains, pixels


@kernel
def _linked(on, y, x, v, u):
    return True


@kernel
def _linked2(degree, y, x, v, u):
    """Whether two pixels are neighbours: diagonal ones only without a common neighbour."""
    if degree[v, u] == 0:
        return False
    if y != v and x != u and (degree[y, u] > 0 or degree[v, x] > 0):
        return False
    return True


def _degrees(on):
    """Return the number of neighbours of each pixel: diagonal ones count without a common one."""
    p = np.pad(on, 1)
    n, s, w, e = p[:-2, 1:-1], p[2:, 1:-1], p[1:-1, :-2], p[1:-1, 2:]
    diagonal = [
        p[:-2, :-2] & ~n & ~w,
        p[:-2, 2:] & ~n & ~e,
        p[2:, :-2] & ~s & ~w,
        p[2:, 2:] & ~s & ~e,
    ]
    return np.where(on, sum(map(np.int64, (n, s, w, e, *diagonal))), 0)


def chains_of(skeleton, share: Floats) -> list[Floats]:
    """Return the centrelines (n, 2) of a skeleton as x, y of pixel centres.

    Short spurs are left out, and branches of about equal width that go straight on through a
    junction are joined. The first point of a loop is also its last one.
    """
    on = np.pad(np.asarray(skeleton, bool), 1)
    degree = _degrees(on)
    count = int(on.sum())
    chain, start = np.empty((6 * count + 16, 2), np.int64), np.empty(4 * count + 8, np.int64)
    ends = np.zeros(4 * count + 8, np.int64)
    chains, _ = trace_chains(on.copy(), degree, chain, start, ends)
    junction, _ = ndimage.label(degree > 2, np.ones((3, 3)))
    edges = [chain[start[i] : start[i + 1]] for i in range(chains)]
    at = [(int(junction[tuple(e[0])]), int(junction[tuple(e[-1])])) for e in edges]
    kept = [
        i for i, (e, (a, b)) in enumerate(zip(edges, at, strict=True))
        if len(e) > SPUR or bool(a) == bool(b) or len(edges) == 1
    ]  # fmt: skip
    branches: dict[int, list[tuple[int, int]]] = {}
    for i in kept:
        for side in (0, 1):
            if at[i][side]:
                branches.setdefault(at[i][side], []).append((i, side))

    wide = [width_along(e[:, ::-1] - 0.5, share, False) for e in edges]

    def is_alike(i: int, j: int) -> bool:
        return abs(wide[i] - wide[j]) < ALIKE + ALIKE_SHARE * min(wide[i], wide[j])

    def way(i: int, side: int) -> Floats:
        e = edges[i] if side == 0 else edges[i][::-1]
        v = np.subtract(e[min(6, len(e) - 1)], e[0]).astype(float)
        return v / max(np.hypot(*v), 1e-9)

    link: dict[tuple[int, int], tuple[int, int]] = {}
    for group in branches.values():
        ways = [way(*one) for one in group]
        pairs = sorted(
            (float(ways[a] @ ways[b]), group[a], group[b])
            for a in range(len(group)) for b in range(a + 1, len(group))
            if group[a][0] != group[b][0] and is_alike(group[a][0], group[b][0])
        )  # fmt: skip
        for cosine, a, b in pairs:
            if (len(group) == 2 or cosine < STRAIGHT) and a not in link and b not in link:
                link[a], link[b] = b, a
    lines, seen = [], set()
    for i in kept:
        if i in seen:
            continue
        side, walked = 0, {i}
        first = i
        while (first, side) in link and link[(first, side)][0] not in walked:
            first, side = link[(first, side)]
            side = 1 - side
            walked.add(first)
        line: list[NDArray[np.int64]] = []
        while True:
            seen.add(first)
            e = edges[first] if side == 0 else edges[first][::-1]
            line.append(e)
            following = link.get((first, 1 - side))
            if following is None or following[0] in seen:
                break
            first, side = following
        points = np.concatenate(line)
        points = points[np.concatenate([[True], (np.diff(points, axis=0) != 0).any(axis=1)])]
        if len(points) >= 2:
            lines.append(points[:, ::-1] - 0.5)
    return lines


def _across(points: Floats, closed: bool) -> Floats:
    """Return the unit normals (n, 2) of a polyline."""
    n = len(points)
    if closed:
        along = np.roll(points, -2, axis=0) - np.roll(points, 2, axis=0)
    else:
        index = np.arange(n)
        along = points[np.minimum(index + 2, n - 1)] - points[np.maximum(index - 2, 0)]
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
        normal = _across(points, closed)
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
    profile = _profile(points, share, _across(points, closed), places)
    middle = len(places) // 2
    for i in range(1, middle + 1):
        for side in (1, -1):
            at, before = middle + side * i, middle + side * (i - 1)
            profile[:, at] = np.minimum(profile[:, at], profile[:, before] + 0.02)
    return float(np.median(profile.sum(axis=1) * ACROSS))
