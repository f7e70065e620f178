"""Curves through points: neighbouring pieces of a path are merged into one while that is cheaper.

A piece is a run of points that one segment draws, a straight line or a cubic. Its cost is the
weighted squared distance of the points from the segment, and `rate` for each byte of path data
(gauss2svg/core/curves.c).
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gauss2svg import portable
from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.core import Kernel

BYTES_OF_PATH = 7.0  # the first node of a path, and its end
# Joins that turn by less than SMOOTH_RAD are moved by this number of points at once.
SHIFTS, SMOOTH_RAD = (8, 4, 2, 1), 0.2
FEW = 3  # curves of a closed path, whose places then count most (docs/decisions/areas.md)

_segment_bytes = Kernel("segment_bytes", "int float64 bool float float64")
_fit_runs = Kernel(
    "fit_runs",
    "int float64 float64 float float64 int int64 int64 int float float float64 bool float64"
    " float64",
)


def bytes_of(segments: Floats, curved: Bools, unit: float) -> Floats:
    """Return about how many bytes (k,) of relative path data segments (k, 4, 2) have."""
    size = np.empty(len(segments))
    _segment_bytes(len(segments), segments, curved, unit, size)
    return size


def path_bytes(segments: Floats, curved: Bools, unit: float) -> float:
    """Return about how many bytes of relative path data the segments (k, 4, 2) of a path have."""
    return BYTES_OF_PATH + float(bytes_of(segments, curved, unit).sum())


def sampled(segments: Floats, curved: Bools, count: Ints) -> Floats:
    """Return points (n, 2) at equal steps along the segments (k, 4, 2) of a path.

    count  (k,) number of points of each segment. Its end is left out
    """
    owner = np.repeat(np.arange(len(count)), count)
    t = (np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)) / count[owner]
    u, is_curve = 1 - t, curved[owner]
    cubic = [u * u * u, 3 * u * u * t, 3 * u * t * t, t * t * t]
    basis = np.where(is_curve, cubic, [u, np.zeros_like(t), 0 * t, t])
    return (basis.T[..., None] * segments[owner]).sum(axis=1)


def fitted_curve(points: Floats) -> Floats:
    """Return the cubic (4, 2) that is closest to a run of points (n, 2)."""
    n = len(points)
    segment, curved, error, size = np.empty((1, 4, 2)), np.empty(1, bool), *np.empty((2, 1))
    ends = np.array([0]), np.array([n - 1])
    _fit_runs(
        n, points, np.ones(n), 0.0, np.empty(2 * n + 2), 1, *ends, True, 1.0, 0.0, segment, curved,
        error, size,
    )  # fmt: skip
    return segment[0]


class _Fit(NamedTuple):
    """A segment (4, 2), the weighted squared error of the points of a piece, and its bytes."""

    segment: Floats
    is_curve: bool
    error: float
    size: float


@dataclass
class _Piece:
    """A piece of a path: points first..last, its segment, and its neighbours."""

    first: int
    last: int
    fit: _Fit
    index: int
    before: _Piece | None = None
    after: _Piece | None = None
    # What replaces this piece and the next one. A merge of either makes it out of date.
    pair: _Fit | None = None


def merge_pieces(
    points: Floats, weight: Floats, start: Ints, closed: bool, segments: Floats, curved: Bools,
    is_fitted: bool, unit: float, rate: float, noise: float,
) -> tuple[Floats, Bools]:  # fmt: skip
    """Merge neighbouring pieces while that lowers the cost. Return the segments that are left.

    points, weight  (n, 2) points and (n,) weights, already multiplied by the length that a point
                    stands for
    start     (m + 1,) index of the first point of each piece, and of the last point of the last
              one. The last index of a closed path is start[0] + n
    segments, curved  (m, 4, 2) and (m,) segments of the pieces
    is_fitted  whether the segments are those of the pieces at the beginning, without error. If
              not, they are fitted first
    unit      user unit of path data in px
    rate      squared error that a byte must save
    noise     mean squared distance in px by which points are off. Smaller distances cost little
    """
    first, last = np.zeros((2, 1), np.int64)
    fitted_segment, fitted_curved = np.empty((1, 4, 2)), np.empty(1, bool)
    error, size = np.empty((2, 1))
    places = np.empty(2 * len(points) + 2)
    fit_curve, fit_any = (
        _fit_runs.prepared(
            len(points), points, weight, noise, places, 1, first, last, only_curves, unit, rate,
            fitted_segment, fitted_curved, error, size,
        )
        for only_curves in (True, False)
    )  # fmt: skip

    def fitted(run: tuple[int, int], only_curves: bool) -> _Fit:
        first[0], last[0] = run
        (fit_curve if only_curves else fit_any)()
        return _Fit(fitted_segment[0].copy(), fitted_curved.item(), error.item(), size.item())

    def cost(fit: _Fit) -> float:
        return fit.error + rate * fit.size

    runs = list(itertools.pairwise(start.tolist()))
    # A smooth run becomes few curves only if lines do not compete while it is merged: two short
    # lines have fewer bytes than the curve that replaces them.
    if is_fitted:
        sizes = bytes_of(segments, np.ones(len(segments), bool), unit).tolist()
        fits = map(_Fit, segments, curved.tolist(), [0.0] * len(sizes), sizes)
    else:
        fits = [fitted(run, True) for run in runs]
    pieces = [_Piece(*run, fit, k) for k, (run, fit) in enumerate(zip(runs, fits, strict=True))]
    for one, two in itertools.pairwise(pieces):
        one.after, two.before = two, one
    if closed:
        pieces[-1].after, pieces[0].before = pieces[0], pieces[-1]
    least = 2 if closed else 1
    pieces = _merged(pieces, least, lambda run: fitted(run, True), cost)
    if closed and len(pieces) <= FEW:
        _move_joins(pieces, lambda run: fitted(run, True))
    # Now straight lines may replace curves, and merge.
    for piece in pieces:
        fit = fitted((piece.first, piece.last), False)
        if not fit.is_curve and cost(fit) < cost(piece.fit):
            piece.fit = fit
        elif not piece.fit.is_curve:
            size = bytes_of(piece.fit.segment[None], np.zeros(1, bool), unit)
            piece.fit = piece.fit._replace(size=float(size[0]))
    pieces = _merged(pieces, least, lambda run: fitted(run, False), cost)
    segments = np.array([piece.fit.segment for piece in pieces])
    curved = np.array([piece.fit.is_curve for piece in pieces])
    # Neighbours share their nodes exactly.
    segments[1:, 0] = segments[:-1, 3]
    if closed:
        segments[0, 0] = segments[-1, 3]
    segments[~curved, 1], segments[~curved, 2] = segments[~curved, 0], segments[~curved, 3]
    return segments, curved


_Fitted = Callable[[tuple[int, int]], _Fit]


def _merged(
    pieces: list[_Piece], least: int, fitted: _Fitted, cost: Callable[[_Fit], float]
) -> list[_Piece]:
    """Return the pieces that are left, at least `least`, once no merge of two lowers the cost."""
    if len(pieces) <= least:
        return pieces
    heap: list[tuple[float, int, int, _Fit]] = []
    numbers = itertools.count()  # so that fits are not compared

    def offer(one: _Piece) -> None:
        """Fit a piece together with the next one, if there is one."""
        if one.after is not None:
            two = one.after
            one.pair = fitted((one.first, one.last + two.last - two.first))
            gain = cost(one.fit) + cost(two.fit) - cost(one.pair)
            if gain > 0:
                heapq.heappush(heap, (-gain, one.index, next(numbers), one.pair))

    for piece in pieces:
        offer(piece)
    by_index, first = {piece.index: piece for piece in pieces}, pieces[0]
    while heap and len(by_index) > least:
        _, index, _, fit = heapq.heappop(heap)
        piece = by_index.get(index)
        if piece is None or piece.pair is not fit or piece.after is None:
            continue
        removed = piece.after
        first = piece if removed is first else first
        piece.fit, piece.last = fit, piece.last + removed.last - removed.first
        piece.after = removed.after
        if removed.after is not None:
            removed.after.before = piece
        del by_index[removed.index]
        offer(piece)
        if piece.before is not None:
            offer(piece.before)
    left = [first]
    while len(left) < len(by_index):
        left.append(left[-1].after or first)
    return left


def _move_joins(pieces: list[_Piece], fitted: _Fitted) -> None:
    """Move the smooth joins of the curves of a closed path while that lowers the error.

    Pieces are merged from where a contour happens to begin, so one curve of a disc can be much
    longer than the others, and farther off.
    """
    for shift in SHIFTS:
        for one, two in zip(pieces, [*pieces[1:], pieces[0]], strict=True):
            u = one.fit.segment[3] - one.fit.segment[2]
            v = two.fit.segment[1] - two.fit.segment[0]
            turn = portable.arctan2(u[0] * v[1] - u[1] * v[0], portable.dot(u, v))
            for by in (-shift, shift) if abs(turn) < SMOOTH_RAD else ():
                while min(one.last - one.first + by, two.last - two.first - by) > 1:
                    middle = one.last + by
                    end = middle - by + two.last - two.first
                    before, after = fitted((one.first, middle)), fitted((middle, end))
                    if before.error + after.error >= one.fit.error + two.fit.error:
                        break
                    one.fit, one.last = before, middle
                    two.fit, two.first = after, two.first + by
