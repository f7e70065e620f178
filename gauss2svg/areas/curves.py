"""Curves through points: cubics by least squares, and neighbours that are merged into one.

A piece is a run of points that one segment draws, a straight line or a cubic. Its cost is the
weighted squared distance of the points from the segment, plus `rate` for each byte of its path data.
"""

from __future__ import annotations

import math

import numpy as np

from gauss2svg.areas.kernels import inner, kernel

ROUNDS = 6  # how often the places of points along a cubic are improved
BYTES_OF_CURVE, BYTES_OF_LINE = 5.5, 2.3  # signs and separators of a segment in path data


@inner
def _digits(value, unit):
    v = abs(round(value / unit))
    count = 1
    while v >= 10:
        v = v // 10
        count += 1
    return count


@inner
def _segment_bytes(p, is_curve, unit):
    """Return about how many bytes of relative path data a segment (4, 2) has."""
    if not is_curve:
        across, down = p[3, 0] - p[0, 0], p[3, 1] - p[0, 1]
        total = _digits(across, unit) + _digits(down, unit) + BYTES_OF_LINE
        is_even = round(across / unit) == 0 or round(down / unit) == 0
        return total - (1.3 if is_even else 0.0)
    total = BYTES_OF_CURVE
    for i in range(1, 4):
        total += _digits(p[i, 0] - p[0, 0], unit) + _digits(p[i, 1] - p[0, 1], unit)
    return total


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
        # A weak pull to the straight line makes the equations regular.
        a = c = 1e-7 * length
        b = 0.0
        rx = a * (2 * p[0, 0] + p[3, 0]) / 3
        ry = a * (2 * p[0, 1] + p[3, 1]) / 3
        sx = c * (p[0, 0] + 2 * p[3, 0]) / 3
        sy = c * (p[0, 1] + 2 * p[3, 1]) / 3
        for i in range(count):
            u = 1.0 - t[i]
            b0, b1, b2, b3 = u * u * u, 3 * u * u * t[i], 3 * u * t[i] * t[i], t[i] * t[i] * t[i]
            q = (first + i) % n
            g = weight[q] + 1e-5
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
            v, u = t[i], 1.0 - t[i]
            q = (first + i) % n
            b0, b1, b2, b3 = u * u * u, 3 * u * u * v, 3 * u * v * v, v * v * v
            x = b0 * p[0, 0] + b1 * p[1, 0] + b2 * p[2, 0] + b3 * p[3, 0] - points[q, 0]
            y = b0 * p[0, 1] + b1 * p[1, 1] + b2 * p[2, 1] + b3 * p[3, 1] - points[q, 1]
            d = x * x + y * y
            error += weight[q] * d * d / (d + noise)
            if round_ < ROUNDS - 1 and 0 < i < count - 1:
                dx = 3 * (
                    u * u * (p[1, 0] - p[0, 0])
                    + 2 * u * v * (p[2, 0] - p[1, 0])
                    + v * v * (p[3, 0] - p[2, 0])
                )
                dy = 3 * (
                    u * u * (p[1, 1] - p[0, 1])
                    + 2 * u * v * (p[2, 1] - p[1, 1])
                    + v * v * (p[3, 1] - p[2, 1])
                )
                square = dx * dx + dy * dy
                if square > 1e-9:
                    t[i] = min(max(v - (x * dx + y * dy) / square, 0.0), 1.0)
    return error


@inner
def _best(points, weight, first, last, unit, rate, noise, only_curves, p, t):
    """Write the cheaper of a line and a cubic for points first..last. Return its kind and costs."""
    n = len(points)
    error = _fit_cubic(points, weight, first, last, noise, p, t)
    size = _segment_bytes(p, True, unit)
    if only_curves:
        return True, error, size
    line = np.empty((4, 2))
    for c in range(2):
        line[0, c] = line[1, c] = points[first % n, c]
        line[2, c] = line[3, c] = points[last % n, c]
    line_error = _line_error(points, weight, first, last, noise)
    line_size = _segment_bytes(line, False, unit)
    if line_error + rate * line_size < error + rate * size:
        p[:] = line
        return False, line_error, line_size
    return True, error, size


@kernel
def merge_pieces(points, weight, start, closed, segment, curved, is_fitted, unit, rate, noise):
    """Merge neighbouring pieces while that lowers the cost, and return how many are left.

    points, weight  (n, 2) points and (n,) weights, already multiplied by the length that a point
                    stands for
    start     (m + 1,) index of the first point of each piece, and of the last point of the last
              one. Indices of a closed path may exceed n. Changed to those of the pieces left
    segment, curved  (m, 4, 2) and (m,) segments of the pieces. Changed
    is_fitted  whether the segments are those of the pieces at the beginning, without error. If
              not, they are fitted first
    unit      user unit of path data in px
    rate      squared error that a byte must save
    """
    n, count = len(points), len(start) - 1
    error, size = np.zeros(count), np.zeros(count)
    t = np.empty(2 * n + 2)
    merged, is_curve = np.empty((count, 4, 2)), np.empty(count, np.bool_)
    merged_error, merged_size = np.empty(count), np.empty(count)
    gain = np.empty(count)
    p = np.empty((4, 2))
    for i in range(count):
        if is_fitted:
            error[i], size[i] = 0.0, _segment_bytes(segment[i], True, unit)
        else:
            curved[i], error[i], size[i] = _best(
                points, weight, start[i], start[i + 1], unit, rate, noise, True, segment[i], t
            )
    least = 2 if closed else 1
    # A smooth run becomes few curves only if lines do not compete while it is merged: two short
    # lines have fewer bytes than the curve that replaces them.
    for only_curves in (True, False):
        if not only_curves:
            for i in range(count):
                kind, line_error, line_size = _best(
                    points, weight, start[i], start[i + 1], unit, rate, noise, False, p, t
                )
                if not kind and line_error + rate * line_size < error[i] + rate * size[i]:
                    segment[i], curved[i], error[i], size[i] = p, False, line_error, line_size
                elif not curved[i]:
                    size[i] = _segment_bytes(segment[i], False, unit)
        gain[:] = np.nan
        while count > least:
            pairs = count if closed and count > 2 else count - 1
            best, at = 0.0, -1
            for i in range(pairs):
                if gain[i] != gain[i]:
                    j = (i + 1) % count
                    end = start[j + 1] + (n if j == 0 and i > 0 else 0)
                    is_curve[i], merged_error[i], merged_size[i] = _best(
                        points, weight, start[i], end, unit, rate, noise, only_curves, merged[i], t
                    )
                    cost = merged_error[i] - error[i] - error[j]
                    gain[i] = rate * (size[i] + size[j] - merged_size[i]) - cost
                if gain[i] > best:
                    best, at = gain[i], i
            if at < 0:
                break
            i, j = at, (at + 1) % count
            segment[i], curved[i] = merged[i], is_curve[i]
            error[i], size[i] = merged_error[i], merged_size[i]
            if j == 0:  # the first piece becomes part of the last one
                for k in range(count - 1):
                    start[k] = start[k + 1]
                    segment[k], curved[k] = segment[k + 1], curved[k + 1]
                    error[k], size[k] = error[k + 1], size[k + 1]
                    gain[k], is_curve[k] = gain[k + 1], is_curve[k + 1]
                    merged[k], merged_error[k], merged_size[k] = (
                        merged[k + 1],
                        merged_error[k + 1],
                        merged_size[k + 1],
                    )
                start[count - 1] = start[0] + n
                i -= 1
            else:
                for k in range(j, count - 1):
                    start[k] = start[k + 1]
                    segment[k], curved[k] = segment[k + 1], curved[k + 1]
                    error[k], size[k] = error[k + 1], size[k + 1]
                    gain[k], is_curve[k] = gain[k + 1], is_curve[k + 1]
                    merged[k], merged_error[k], merged_size[k] = (
                        merged[k + 1],
                        merged_error[k + 1],
                        merged_size[k + 1],
                    )
                start[count - 1] = start[count]
            count -= 1
            gain[i] = np.nan
            gain[(i - 1) % count] = np.nan
            # The pair of the last and the first piece depends on both ends.
            if count <= 2 or i == count - 1 or i == 0:
                gain[count - 1] = np.nan
    # Neighbours share their nodes exactly.
    for i in range(count):
        if i > 0:
            segment[i, 0] = segment[i - 1, 3]
        elif closed:
            segment[0, 0] = segment[count - 1, 3]
        if not curved[i]:
            segment[i, 1], segment[i, 2] = segment[i, 0], segment[i, 3]
    return count
