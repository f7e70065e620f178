"""Curves through points: cubics by least squares, and neighbours that are merged into one.

A piece is a run of points that one segment draws, a straight line or a cubic. Its cost is the
weighted squared distance of the points from the segment, and `rate` for each byte of path data.
"""

from __future__ import annotations

import math

import numpy as np

from gauss2svg.areas.kernels import inner, kernel
from gauss2svg.render.coverage import point_at

ROUNDS = 6  # how often the places of points along a cubic are improved
# A weak pull to the straight line, and a least weight of points, make the equations regular.
PULL, LEAST_WEIGHT = 1e-7, 1e-5
BYTES_OF_CURVE, BYTES_OF_LINE = 5.5, 2.3  # signs and separators of a segment in path data
BYTES_OF_UPRIGHT = 1.0  # signs and separators of a level or an upright line
BYTES_OF_PATH = 7.0  # the first node of a path, and its end


@inner
def _digits(value, unit):
    """Return the number of digits of a coordinate in user units."""
    return math.floor(math.log10(max(abs(round(value / unit)), 1))) + 1


@inner
def _segment_bytes(p, is_curve, unit):
    """Return about how many bytes of relative path data a segment (4, 2) has."""
    if not is_curve:
        across, down = p[3, 0] - p[0, 0], p[3, 1] - p[0, 1]
        total = _digits(across, unit) + _digits(down, unit) + BYTES_OF_LINE
        if round(across / unit) == 0 or round(down / unit) == 0:
            total += BYTES_OF_UPRIGHT - BYTES_OF_LINE
        return total
    total = BYTES_OF_CURVE
    for i in range(1, 4):
        total += _digits(p[i, 0] - p[0, 0], unit) + _digits(p[i, 1] - p[0, 1], unit)
    return total


@kernel
def path_bytes(segment, curved, unit):
    """Return about how many bytes of relative path data the segments (k, 4, 2) of a path have."""
    total = BYTES_OF_PATH
    for s in range(len(segment)):
        total += _segment_bytes(segment[s], curved[s], unit)
    return total


@kernel
def sample_path(segment, curved, count, points):
    """Write points (n, 2) at equal steps along the segments (k, 4, 2) of a path.

    count  (k,) number of points of each segment. Its end is left out
    """
    n = 0
    for s in range(len(segment)):
        for i in range(count[s]):
            x, y, _, _ = point_at(segment[s], curved[s], i / count[s])
            points[n, 0], points[n, 1] = x, y
            n += 1


@inner
def _line_error(points, weight, first, last, noise):
    """Return the weighted squared distance of points first..last from the line between them."""
    n = len(points)
    ax, ay = points[first % n]
    vx, vy = points[last % n, 0] - ax, points[last % n, 1] - ay
    square = vx * vx + vy * vy
    error = 0.0
    for i in range(first, last + 1):
        x, y = points[i % n, 0] - ax, points[i % n, 1] - ay
        t = min(max((x * vx + y * vy) / max(square, 1e-9), 0.0), 1.0)
        d = (x - t * vx) ** 2 + (y - t * vy) ** 2
        error += weight[i % n] * d * d / (d + noise)
    return error


@inner
def _fit_cubic(points, weight, first, last, noise, p, t):
    """Write the cubic (4, 2) between points first and last, and return its weighted error.

    t  buffer for the place of each point along the curve
    """
    n, count = len(points), last - first + 1
    t[0] = 0.0
    for i in range(1, count):
        a, b = (first + i - 1) % n, (first + i) % n
        t[i] = t[i - 1] + math.hypot(points[b, 0] - points[a, 0], points[b, 1] - points[a, 1])
    length = t[count - 1]
    for c in range(2):
        p[0, c], p[3, c] = points[first % n, c], points[last % n, c]
        p[1, c], p[2, c] = p[0, c], p[3, c]
    if length < 1e-6:
        return 0.0
    for i in range(count):
        t[i] /= length
    error = 0.0
    for round_ in range(ROUNDS):
        a = c = PULL * length
        b = 0.0
        rx = a * (2 * p[0, 0] + p[3, 0]) / 3
        ry = a * (2 * p[0, 1] + p[3, 1]) / 3
        sx = c * (p[0, 0] + 2 * p[3, 0]) / 3
        sy = c * (p[0, 1] + 2 * p[3, 1]) / 3
        for i in range(count):
            u = 1.0 - t[i]
            b0, b1, b2, b3 = u * u * u, 3 * u * u * t[i], 3 * u * t[i] * t[i], t[i] * t[i] * t[i]
            q = (first + i) % n
            g = weight[q] + LEAST_WEIGHT
            dx = points[q, 0] - b0 * p[0, 0] - b3 * p[3, 0]
            dy = points[q, 1] - b0 * p[0, 1] - b3 * p[3, 1]
            a += g * b1 * b1
            b += g * b1 * b2
            c += g * b2 * b2
            rx += g * b1 * dx
            ry += g * b1 * dy
            sx += g * b2 * dx
            sy += g * b2 * dy
        det = max(a * c - b * b, 1e-14)
        p[1, 0], p[1, 1] = (c * rx - b * sx) / det, (c * ry - b * sy) / det
        p[2, 0], p[2, 1] = (a * sx - b * rx) / det, (a * sy - b * ry) / det
        error = 0.0
        for i in range(count):
            x, y, dx, dy = point_at(p, True, t[i])
            q = (first + i) % n
            x, y = x - points[q, 0], y - points[q, 1]
            d = x * x + y * y
            error += weight[q] * d * d / (d + noise)
            square = dx * dx + dy * dy
            if round_ < ROUNDS - 1 and 0 < i < count - 1 and square > 1e-9:
                t[i] = min(max(t[i] - (x * dx + y * dy) / square, 0.0), 1.0)
    return error


@inner
def _straighten(p):
    """Make a segment (4, 2) the straight line between its ends."""
    for c in range(2):
        p[1, c], p[2, c] = p[0, c], p[3, c]


@inner
def _best(points, weight, first, last, unit, rate, noise, only_curves, p, t):
    """Write the cheaper of a line and a cubic for points first..last. Return its kind and costs."""
    error = _fit_cubic(points, weight, first, last, noise, p, t)
    size = _segment_bytes(p, True, unit)
    if only_curves:
        return True, error, size
    line_error = _line_error(points, weight, first, last, noise)
    line_size = _segment_bytes(p, False, unit)
    if line_error + rate * line_size < error + rate * size:
        _straighten(p)
        return False, line_error, line_size
    return True, error, size


# Joins that turn by less than SMOOTH_RAD are moved by this number of points at once.
SHIFTS, SMOOTH_RAD = (8, 4, 2, 1), 0.2
FEW = 3  # curves of a closed path, whose places then count most (docs/decisions/areas.md)


@inner
def _move_joins(
    points, weight, start, steps, following, first, left, unit, noise, segment, error, size, trial,
    t,
):  # fmt: skip
    """Move the smooth joins of the curves of a closed path while that lowers the error.

    Pieces are merged from where a contour happens to begin, so one curve of a disc can be much
    longer than the others, and farther off.
    """
    for shift in SHIFTS:
        i = first
        for _ in range(left):
            j = following[i]
            ux, uy = segment[i, 3, 0] - segment[i, 2, 0], segment[i, 3, 1] - segment[i, 2, 1]
            vx, vy = segment[j, 1, 0] - segment[j, 0, 0], segment[j, 1, 1] - segment[j, 0, 1]
            turn = math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)
            for by in (-shift, shift):
                while abs(turn) < SMOOTH_RAD and min(steps[i] + by, steps[j] - by) > 1:
                    middle, end = start[i] + steps[i] + by, start[i] + steps[i] + steps[j]
                    new_error = _fit_cubic(points, weight, start[i], middle, noise, trial[0], t)
                    rest = _fit_cubic(points, weight, middle, end, noise, trial[1], t)
                    if new_error + rest >= error[i] + error[j]:
                        break
                    segment[i] = trial[0]
                    segment[j] = trial[1]
                    error[i], size[i] = new_error, _segment_bytes(segment[i], True, unit)
                    error[j], size[j] = rest, _segment_bytes(segment[j], True, unit)
                    steps[i] += by
                    steps[j] -= by
                    start[j] += by
            i = j


@kernel
def merge_pieces(points, weight, start, closed, segment, curved, is_fitted, unit, rate, noise):
    """Merge neighbouring pieces while that lowers the cost, and return how many are left.

    points, weight  (n, 2) points and (n,) weights, already multiplied by the length that a point
                    stands for
    start     (m + 1,) index of the first point of each piece, and of the last point of the last
              one. The last index of a closed path is start[0] + n
    segment, curved  (m, 4, 2) and (m,) segments of the pieces. Those that are left come first
    is_fitted  whether the segments are those of the pieces at the beginning, without error. If
              not, they are fitted first
    unit      user unit of path data in px
    rate      squared error that a byte must save
    noise     mean squared distance in px by which points are off. Smaller distances cost little
    """
    count = len(start) - 1
    steps, following = np.empty(count, np.int64), np.empty(count, np.int64)
    error, size, gain = np.zeros(count), np.zeros(count), np.zeros(count)
    pair, pair_curved = np.empty((count, 4, 2)), np.empty(count, np.bool_)
    pair_error, pair_size = np.empty(count), np.empty(count)
    trial = np.empty((2, 4, 2))
    t, p = np.empty(2 * len(points) + 2), np.empty((4, 2))
    for i in range(count):
        steps[i], following[i] = start[i + 1] - start[i], i + 1
    following[count - 1] = 0 if closed else -1
    first, left, least = 0, count, 2 if closed else 1
    # A smooth run becomes few curves only if lines do not compete while it is merged: two short
    # lines have fewer bytes than the curve that replaces them.
    for stage in range(2):
        i = first
        for _ in range(left):
            if stage == 0 and is_fitted:
                size[i] = _segment_bytes(segment[i], True, unit)
            else:
                end = start[i] + steps[i]
                kind, new_error, new_size = _best(
                    points, weight, start[i], end, unit, rate, noise, stage == 0, p, t
                )
                if stage == 0 or (
                    not kind and new_error + rate * new_size < error[i] + rate * size[i]
                ):
                    segment[i] = p
                    curved[i], error[i], size[i] = kind, new_error, new_size
                elif not curved[i]:
                    size[i] = _segment_bytes(segment[i], False, unit)
            gain[i] = np.nan
            i = following[i]
        while left > least:
            best, at = 0.0, -1
            i = first
            for _ in range(left if closed else left - 1):
                j = following[i]
                if gain[i] != gain[i]:
                    end = start[i] + steps[i] + steps[j]
                    pair_curved[i], pair_error[i], pair_size[i] = _best(
                        points, weight, start[i], end, unit, rate, noise, stage == 0, pair[i], t
                    )
                    cost = pair_error[i] - error[i] - error[j]
                    gain[i] = rate * (size[i] + size[j] - pair_size[i]) - cost
                if gain[i] > best:
                    best, at = gain[i], i
                i = j
            if at < 0:
                break
            j = following[at]
            segment[at] = pair[at]
            curved[at], error[at], size[at] = pair_curved[at], pair_error[at], pair_size[at]
            steps[at] += steps[j]
            following[at] = following[j]
            if j == first:
                first = at
            left -= 1
            gain[at] = np.nan
            i = first
            for _ in range(left):  # the piece before `at` has another pair now
                if following[i] == at:
                    gain[i] = np.nan
                i = following[i]
        if stage == 0 and closed and left <= FEW:
            _move_joins(
                points, weight, start, steps, following, first, left, unit, noise, segment, error,
                size, trial, t,
            )  # fmt: skip
    # Neighbours share their nodes exactly.
    i = first
    for k in range(left):
        pair[k] = segment[i]
        pair_curved[k] = curved[i]
        i = following[i]
    for k in range(left):
        segment[k] = pair[k]
        curved[k] = pair_curved[k]
    for k in range(left):
        if k > 0 or closed:
            for c in range(2):
                segment[k, 0, c] = segment[k - 1 if k > 0 else left - 1, 3, c]
        if not curved[k]:
            _straighten(segment[k])
    return left
