"""Outlines of masks: contours at half share, their corners, and the lines and cubics through them.

A contour through linearly interpolated shares cuts corners of thin masks, breaks lines of one
pixel, and leaves out those between two rows, because no share of theirs reaches a half. So thin
masks have fields, functions finer than pixels, which are changed until what lies inside the contour
covers each pixel by its share.

Points are first cut into short pieces. A piece is a run of points that one segment draws, a
straight line or a cubic. Neighbouring pieces are merged into one while that lowers the cost: the
weighted squared distance of the points from the segment, and `rate` for each byte of path data
(gauss2svg/core/curves.c).
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage
from skimage.measure import find_contours

from gauss2svg import portable
from gauss2svg.areas.arrays import Bools, Box, Floats, Ints, parts_of
from gauss2svg.core import Kernel
from gauss2svg.without_scipy import smoothed

# Function from points (n, 2) to the weight of a squared distance of 1 px along 1 px of an outline
Weights = Callable[[Floats], Floats]
ARM = 5  # points before and after a corner between which it turns
ROUND = 1.2  # times the turn of a disc up to which a corner may be a part of one
FINE = 3  # samples of a field for each px
DOT_SEEN = 0.2  # least share of a dot in its pixels
LEAST_DOT, MOST_DOT = 0.5, 3.0  # px^2 of a dot, because smaller ones are noise

_segment_bytes = Kernel("segment_bytes", "int float64 bool float float64")
_fit_run = Kernel(
    "fit_run",
    "int float64 float64 float float64 int64 int float float float64 float64",
)


class Path(NamedTuple):
    """Segments (k, 4, 2) of a path, and whether each is curved. A line repeats its ends."""

    segments: Floats
    curved: Bools
    closed: bool = True

    @property
    def length(self) -> float:
        """The length in px of the polygons of control points."""
        return float(lengths_of(self.segments).sum())

    def moved(self, by: Floats) -> Path:
        """Return the path moved by a vector (2,)."""
        return self._replace(segments=self.segments + by)

    def bytes(self, unit: float) -> float:
        """Return about how many bytes of path data the path has."""
        # The first node and the end of a path have 7.
        return 7.0 + float(bytes_of(self.segments, self.curved, unit).sum())


def bytes_of(segments: Floats, curved: Bools, unit: float) -> Floats:
    """Return about how many bytes (k,) of relative path data segments (k, 4, 2) have."""
    size = np.empty(len(segments))
    _segment_bytes(len(segments), segments, curved, unit, size)
    return size


def lengths_of(segments: Floats) -> Floats:
    """Return the lengths (k,) in px of the polygons of control points (k, 4, 2)."""
    return portable.hypot(*np.diff(segments, axis=1).transpose(2, 0, 1)).sum(axis=1)


def angles_of(u: Floats, v: Floats) -> Floats:
    """Return the angles (k,) between vectors (k, 2), in 0..pi."""
    return np.abs(portable.arctan2(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], (u * v).sum(axis=1)))


def meeting_of(p: Floats, u: Floats, q: Floats, v: Floats) -> Floats | None:
    """Return where lines through p along u and q along v meet. None: they are nearly parallel."""
    det = u[1] * v[0] - u[0] * v[1]
    x, y = q - p
    return p + (y * v[0] - x * v[1]) / det * u if abs(det) > 0.15 else None


def weights_by(contrast: Floats, left: int, top: int, shape: tuple[int, ...]) -> Weights:
    """Return the function that gives points the contrast (h, w) of a box, whose corner is here.

    shape  rows and columns of the picture
    """
    h, w = contrast.shape

    def weight_at(points: Floats) -> Floats:
        x, y = np.floor(points).astype(np.int64).T
        beyond = (points < 0).any(axis=1) | (points > [shape[1], shape[0]]).any(axis=1)
        at = np.clip(y - top, 0, h - 1), np.clip(x - left, 0, w - 1)
        # Without a least weight, hidden outlines would have no shape, and would show at the next
        # step.
        return np.where(beyond, 0.003, np.maximum(contrast[at], 0.015))

    return weight_at


def contrast_of(pixels: Floats) -> Weights:
    """Return the weights of first outlines: squared differences of colours across an edge."""
    padded = np.pad(pixels, ((2, 2), (2, 2), (0, 0)), mode="edge")
    across = ((padded[2:-2, 4:] - padded[2:-2, :-4]) ** 2).sum(axis=-1)
    down = ((padded[4:, 2:-2] - padded[:-4, 2:-2]) ** 2).sum(axis=-1)
    return weights_by(np.maximum(across, down), 0, 0, pixels.shape)


def field_of(share: Floats) -> Floats:
    """Return a field (FINE h, FINE w) for the shares (h, w) of a mask."""
    h, w = share.shape
    field: Any = ndimage.zoom(
        share.astype(np.float32), FINE, order=3, mode="nearest", grid_mode=True
    )
    for _ in range(4):
        # Across a crisp edge, a field changes by 2 for each px.
        inside = np.clip((field - 0.5) * FINE + 0.5, 0, 1)
        error = share - inside.reshape(h, FINE, w, FINE).mean(axis=(1, 3))
        field += 0.7 * ndimage.zoom(error, FINE, order=1, mode="nearest", grid_mode=True)
        field = smoothed(field, 0.22 * FINE, truncate=3)
    return field


def contours_of(share: Floats, box: Box, shape: tuple[int, ...]) -> list[Floats]:
    """Return the closed contours (n, 2) of a mask at half share, in px of the picture.

    share  (h, w) in a box of a picture of this shape

    A mask that touches the border of the picture is continued beyond it, so that its contour
    leaves the picture. It is not where it seems to end in the last row or column of pixels.
    """
    # Masks of less than 10 px^2 may be slivers beside other areas.
    is_thin = (total := share.sum()) >= 10 and (
        np.count_nonzero(ndimage.minimum_filter(share, 3) > 0.98) < 0.3 * total
    )
    reach = 3 if is_thin else 1  # fields are uneven at their borders
    pad = [
        (reach * (side.start == 0), reach * (side.stop == most))
        for side, most in zip(box, shape, strict=False)
    ]
    corner = np.array([box[1].start - pad[1][0], box[0].start - pad[0][0]])
    padded, fine = np.pad(share, pad, mode="edge"), 1
    for k, margin in enumerate(pad[0] + pad[1]):
        if margin:
            # A view whose first rows are the margin
            turned = (padded if k < 2 else padded.T)[:: -1 if k % 2 else 1]
            turned[:margin, _ends_in(*turned[margin : margin + 2])] = 0
    if is_thin:
        padded, fine = field_of(padded), FINE
    contours = []
    for line in find_contours(np.pad(padded, 1), 0.5):
        points = (line[:-1, ::-1] - 0.5) / fine + corner
        x, y = points.T
        area = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
        if len(points) >= 4 and abs(area) >= 1:  # smaller ones are noise
            contours.append(points)
    # A dot may be a hole, which its outline runs round the other way.
    for dot in [*_dots_of(share), *(hole[::-1] for hole in _dots_of(1 - share))]:
        dot = dot + np.array([box[1].start, box[0].start])
        if not any(np.abs(c.mean(axis=0) - dot.mean(axis=0)).max() < 1 for c in contours):
            contours.append(dot)
    return contours


def _dots_of(share: Floats) -> list[Floats]:
    """Return circles (8, 2) as large as the dots of a mask (h, w), which are less than 3 px^2.

    Points and dots of small text may have less than half of each of their pixels.
    """
    dots = []
    part, boxes = parts_of(share > DOT_SEEN)
    for k, box in enumerate(boxes, 1):
        own = np.where(part[box] == k, share[box], 0)
        if LEAST_DOT <= (total := own.sum()) < MOST_DOT:
            middle = [
                np.average(places + 0.5, weights=own) + side.start
                for places, side in zip(np.indices(own.shape), box, strict=True)
            ]
            angle = np.arange(8) * math.pi / 4
            circle = np.stack([portable.cos(angle), portable.sin(angle)], axis=1)
            dots.append(middle[::-1] + math.sqrt(total / math.pi) * circle)
    return dots


def _ends_in(last: Floats, inner: Floats) -> Bools:
    """Return where a mask ends in the last row (n,) of the picture, whose next row is `inner`.

    A round that ends there has much less of the last row. An edge that leaves the picture has not.
    """
    labels: Any = ndimage.label(last > 0)
    part, names = labels[0], np.arange(labels[1] + 1)
    here, before = (ndimage.sum_labels(row, part, names) for row in (last, inner))
    return (here < 0.8 * before)[part] & (part > 0)


def resampled(points: Floats, step: float, closed: bool = True) -> Floats:
    """Return points about `step` px apart along a polyline (n, 2)."""
    line = np.vstack([points, points[:1]]) if closed else points
    place = np.concatenate([[0], np.cumsum(portable.hypot(*np.diff(line, axis=0).T))])
    count = max(round(place[-1] / step), 8 if closed else 2)
    at = np.linspace(0, place[-1], count + 1)[: count if closed else count + 1]
    return np.stack([np.interp(at, place, line[:, i]) for i in (0, 1)], axis=1)


def turns_of(points: Floats, least_rad: float, closed: bool = True) -> Ints:
    """Return the indices of the corners of a polyline (n, 2), whose points are evenly spaced.

    A corner turns by at least `least_rad` between the chords to the points ARM points before and
    after it, and by more than any other point that near.
    """
    n = len(points)
    if n < 4 * ARM:
        return np.arange(0)
    before, after = points - np.roll(points, ARM, axis=0), np.roll(points, -ARM, axis=0) - points
    turn = angles_of(before, after)
    if not closed:
        turn[:ARM] = turn[-ARM:] = 0
    around = np.stack([np.roll(turn, k) for k in range(-ARM, ARM + 1)])
    corners = np.flatnonzero((turn >= least_rad) & (turn == around.max(axis=0)))
    return corners[np.diff(corners, prepend=-n) > ARM // 2]


def first_path(points: Floats, weight_at: Weights, unit: float, rate: float) -> Path:
    """Return the first curves through a closed contour (n, 2)."""
    points = resampled(points, 0.5)
    # No pixel of a dot may have its colour, and both sides of a minus sign have one, so pixels do
    # not tell their contrast.
    if len(points) <= 12:
        weight_at = lambda points: np.ones(len(points))  # noqa: E731
    points, corners = with_corners(points, turns_of(points, np.radians(35)))
    return fitted_path(points, corners, weight_at, unit, rate, True)


def with_corners(
    points: Floats, corners: Ints, closed: bool = True, cut: int = 2
) -> tuple[Floats, Ints]:
    """Return a polyline (n, 2) whose corners are no longer rounded, and their indices in it.

    A corner is put where lines through the points on both sides meet, from `cut` to cut + 6 points
    away.

    cut  number of points before and after a corner by which it has been rounded
    """
    n = len(points)
    keep, moved = np.ones(n, bool), points.copy()
    gaps = np.diff(corners, append=corners[:1] + n)
    before, after = points[corners] - points[corners - ARM], points[(corners + ARM) % n]
    turn = angles_of(before, after - points[corners])
    # A corner that turns little more than a disc of this length does may be a part of one.
    is_round = closed & (turn < ROUND * 2 * math.pi * ARM / n)
    for i, corner in enumerate(corners):
        if is_round[i]:
            continue
        gap = [gaps[i - 1], gaps[i]]
        if not closed:
            gap = [min(gap[0], corner + cut), min(gap[1], n - 1 - corner + cut)]
        reach = [min(cut + 6, one - cut - 1) for one in gap]
        if min(reach) >= cut + 2:
            sides = [
                points[(corner + sign * np.arange(cut, most + 1)) % n]
                for sign, most in zip((-1, 1), reach, strict=True)
            ]
            p, q = (side.mean(axis=0) for side in sides)
            u, v = (
                portable.main_axis(side - middle)
                for side, middle in zip(sides, (p, q), strict=True)
            )
            meeting = meeting_of(p, u, q, v)
            if meeting is not None and portable.hypot(*(meeting - points[corner])) < 2:
                moved[corner] = meeting
        away = np.arange(1, cut)
        keep[(corner - away) % n] = keep[(corner + away) % n] = False
    keep[corners] = True
    if not closed:
        keep[[0, -1]] = True
    index = np.cumsum(keep) - 1
    return moved[keep], index[corners]


def fitted_path(
    points: Floats, corners: Ints, weight_at: Weights, unit: float, rate: float, closed: bool
) -> Path:
    """Return the curves through points (n, 2), with possible corners at these indices."""
    n = len(points)
    if not closed:
        ends = np.unique([0, *corners, n - 1])
    else:
        ends = np.append(corners, corners[0] + n) if len(corners) else np.array([0, n])
    # Pieces have about six points.
    starts = [
        np.linspace(a, b, max(round((b - a) / 6), 1), endpoint=False).astype(np.int64)
        for a, b in itertools.pairwise(ends)
    ]
    start = np.append(np.unique(np.concatenate(starts)), ends[-1])
    if closed and len(start) < 3:
        start = np.array([start[0], (start[0] + start[-1]) // 2, start[-1]])
    gap = portable.hypot(*np.diff(points, axis=0, append=points[:1]).T)
    if not closed:
        gap[-1] = 0.0
    weight = weight_at(points) * 0.5 * (gap + np.roll(gap, 1))
    return merged_path(points, weight, start, None, closed, unit, rate, 0.05**2)


class _Piece(NamedTuple):
    """A run of points, from its first to its last one, and the segment (4, 2) that draws it.

    error is the weighted squared error of the points, and size the bytes of the segment.
    """

    run: tuple[int, int]
    segment: Floats
    is_curve: bool
    error: float
    size: float


def _merge(
    pieces: list[_Piece], closed: bool, fitted: Callable[[int, int], _Piece], rate: float
) -> None:
    """Merge neighbouring pieces while that lowers the cost, and a path is left."""

    def cost(piece: _Piece) -> float:
        return piece.error + rate * piece.size

    def offer(k: int) -> tuple[float, _Piece]:
        """Return by how much the cost falls if a piece and the next are one, and that one."""
        one, other = pieces[k], pieces[(k + 1) % len(pieces)]
        if not closed and other is pieces[0]:
            return -math.inf, one
        merged = fitted(one.run[0], one.run[1] + other.run[1] - other.run[0])
        return cost(one) + cost(other) - cost(merged), merged

    least = 1 + closed
    if len(pieces) <= least:
        return
    gains, merged = map(list, zip(*map(offer, range(len(pieces))), strict=True))
    while len(pieces) > least and (gain := max(gains)) > 0:
        k = gains.index(gain)
        for values, value in ((pieces, merged[k]), (merged, merged[k]), (gains, gain)):
            values[k] = value
            if k + 1 == len(values):  # the last piece and the first one become the first one
                values[0] = values.pop()
            else:
                del values[k + 1]
        k %= len(pieces)
        for near in (k, (k - 1) % len(pieces)):
            gains[near], merged[near] = offer(near)


def _move_joins(pieces: list[_Piece], fitted: Callable[[int, int], _Piece]) -> None:
    """Move the smooth joins of the curves of a closed path while that lowers the error.

    Pieces are merged from where a contour happens to begin, so one curve of a disc can be much
    longer than the others, and farther off. This counts most if there are at most three curves
    (docs/decisions/areas.md).
    """
    for shift, k in itertools.product((8, 4, 2, 1), range(len(pieces))):
        j = (k + 1) % len(pieces)
        u, v = np.diff(pieces[k].segment[2:], axis=0), np.diff(pieces[j].segment[:2], axis=0)
        for by in (-shift, shift) if angles_of(u, v) < 0.2 else ():
            while True:
                (first, last), (begin, end) = pieces[k].run, pieces[j].run
                if min(last - first + by, end - begin - by) <= 1:
                    break
                before, after = fitted(first, last + by), fitted(begin + by, end)
                if before.error + after.error >= pieces[k].error + pieces[j].error:
                    break
                pieces[k], pieces[j] = before, after


def sampled(segments: Floats, curved: Bools, count: Ints) -> Floats:
    """Return points (n, 2) at equal steps along the segments (k, 4, 2) of a path.

    count  (k,) number of points of each segment. Its end is left out
    """
    owner = np.repeat(np.arange(len(count)), count)
    t = (np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)) / count[owner]
    u = 1 - t
    cubic = [u * u * u, 3 * u * u * t, 3 * u * t * t, t * t * t]
    basis = np.where(curved[owner], cubic, [u, np.zeros_like(t), 0 * t, t])
    return (basis.T[..., None] * segments[owner]).sum(axis=1)


def fitted_curve(points: Floats) -> Floats:
    """Return the cubic (4, 2) that is closest to a run of points (n, 2)."""
    n, segment = len(points), np.empty((4, 2))
    ends = np.array([0, n - 1])
    _fit_run(
        n, points, np.ones(n), 0.0, np.empty(2 * n + 2), ends, True, 1.0, 0.0, segment, np.empty(3)
    )
    return segment


def merged_path(
    points: Floats, weight: Floats, start: Ints, path: Path | None, closed: bool, unit: float,
    rate: float, noise: float,
) -> Path:  # fmt: skip
    """Merge neighbouring pieces while that lowers the cost. Return the path of those that are left.

    points, weight  (n, 2) points and (n,) weights, already multiplied by the length that a point
                    stands for
    start     (m + 1,) index of the first point of each piece, and of the last point of the last
              one. The last index of a closed path is start[0] + n
    path      path whose m segments are those of the pieces at the beginning, without error. None:
              they are fitted first
    unit      user unit of path data in px
    rate      squared error that a byte must save
    noise     mean squared distance in px by which points are off. Smaller distances cost little
    """
    run, segment, result = np.zeros(2, np.int64), np.empty((4, 2)), np.empty(3)
    places = np.empty(2 * len(points) + 2)

    def curve(first: int, last: int, only_curves: bool = True) -> _Piece:
        run[:] = first, last
        _fit_run(
            len(points), points, weight, noise, places, run, only_curves, unit, rate, segment,
            result,
        )  # fmt: skip
        is_curve, error, size = result.tolist()
        return _Piece((first, last), segment.copy(), bool(is_curve), error, size)

    line_or_curve = functools.partial(curve, only_curves=False)
    runs = itertools.pairwise(start.tolist())
    if path is None:
        pieces = [curve(*ends) for ends in runs]
    else:
        sizes = bytes_of(path.segments, np.ones(len(path.curved), bool), unit).tolist()
        old = zip(runs, path.segments, path.curved.tolist(), sizes, strict=True)
        pieces = [_Piece(ends, one, is_curve, 0.0, size) for ends, one, is_curve, size in old]
    # A smooth run becomes few curves only if lines do not compete while it is merged: two short
    # lines have fewer bytes than the curve that replaces them.
    _merge(pieces, closed, curve, rate)
    if closed and len(pieces) <= 3:
        _move_joins(pieces, curve)
    # Now straight lines may replace curves, and merge.
    for k, old in enumerate(pieces):
        new = line_or_curve(*old.run)
        if not new.is_curve and new.error + rate * new.size < old.error + rate * old.size:
            pieces[k] = new
        elif not old.is_curve:
            size = float(bytes_of(old.segment[None], np.zeros(1, bool), unit)[0])
            pieces[k] = old._replace(size=size)
    _merge(pieces, closed, line_or_curve, rate)
    segments = np.array([piece.segment for piece in pieces])
    curved = np.array([piece.is_curve for piece in pieces])
    # Neighbours share their nodes exactly.
    segments[1:, 0] = segments[:-1, 3]
    if closed:
        segments[0, 0] = segments[-1, 3]
    segments[~curved, 1], segments[~curved, 2] = segments[~curved, 0], segments[~curved, 3]
    return Path(segments, curved, closed)


def upright(point: Floats, line: Ints) -> Ints:
    """Return for each coordinate (2 n,) of points the index of the one to which it must be equal.

    The ends of an upright line (k, 4) have one x, and those of a level one have one y. A line is
    upright or level if the ratio of its sides is below .02 and it is less than .6 px off, or if it
    is longer than 1 px and less than .03 px off.
    """
    same = np.arange(point.size)
    first, last = (2 * line[:, [0, 3]].T[:, :, None] + [0, 1]).reshape(2, -1)
    size = np.abs(point[line[:, 3]] - point[line[:, 0]])
    large = size[:, ::-1]
    is_off = (size < np.minimum(0.02 * large, 0.6)) | ((size < 0.03) & (large > 1))
    for a, b in zip(first[is_off.ravel()], last[is_off.ravel()], strict=True):
        same[same == same[b]] = same[a]
    return same
