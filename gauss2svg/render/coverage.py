"""Exact coverage of pixels by areas and lines.

A curve is replaced by a polygon, and a line by the polygons of its stroke. The edges of polygons
are then added up row by row. An edge changes the coverage of the pixels that it crosses by a part
of its height, and of all pixels to the right of these by its whole height. The running sum along a
row is the winding number, averaged over each pixel. Its absolute value, at most 1, is the coverage.
So a hole is an outline that runs the other way. `coverage_reference` computes the same by clipping
polygons.

Where outlines or strokes overlap themselves, a pixel that each part covers in part counts both. So
a stroke is too dark in a few pixels where it crosses itself, or turns within its width.
"""

from __future__ import annotations

import math

from gauss2svg.render.tiles import tile_kernel

SAGITTA = 0.01  # largest distance in px of a curve from the edges of its polygon
MITER_LIMIT = 4.0  # largest ratio of a mitre to the width of its line (the default of SVG)
LEAST_GAP = 0.01  # width in px below which a gap between two segments of a stroke needs no join
STEEPEST = 1e30  # edges with a larger ratio of x to y count as horizontal, so that none overflows


@tile_kernel
def add_edge(sums, ax, ay, bx, by):
    """Add the edge from (ax, ay) to (bx, by) to the differences of the winding number.

    sums  (h, w + 2) changes of the winding number along each row, averaged over each pixel
    """
    h, w = float(sums.shape[0]), float(sums.shape[1] - 2)
    # This is false for horizontal edges, and for coordinates that are not numbers.
    if not abs(bx - ax) < STEEPEST * abs(by - ay):
        return
    turn = 1.0
    if ay > by:
        turn, ax, ay, bx, by = -1.0, bx, by, ax, ay
    if by <= 0.0 or ay >= h:
        return
    slope = (bx - ax) / (by - ay)
    x = ax
    if ay < 0.0:
        x -= ay * slope
        ay = 0.0
    by = min(by, h)
    for y in range(int(ay), math.ceil(by)):
        height = min(y + 1.0, by) - max(float(y), ay)
        next_x = x + slope * height
        delta = height * turn
        low, high = min(x, next_x), max(x, next_x)
        x = next_x
        left, right = min(max(low, 0.0), w), min(max(high, 0.0), w)
        if right - left < high - low:
            # What lies left of the box changes all of the row, and what lies right of it nothing.
            per_px = delta / (high - low)
            sums[y, 0] += per_px * max(min(high, 0.0) - low, 0.0)
            delta = per_px * (right - left)
        first, last = int(left), math.ceil(right)
        if last <= first + 1:
            share = 0.5 * (left + right) - first
            sums[y, first] += delta * (1.0 - share)
            sums[y, first + 1] += delta * share
        else:
            # The covered part of each pixel that a row's edge crosses is a trapezium. Its area, as
            # a function of the column, has the constant second difference `step`.
            step = 1.0 / (right - left)
            into = 1.0 - (left - first)
            start = 0.5 * step * into * into
            beyond = right - last + 1.0
            end = 0.5 * step * beyond * beyond
            sums[y, first] += delta * start
            if last == first + 2:
                sums[y, first + 1] += delta * (1.0 - start - end)
            else:
                second = step * (1.0 + into - 0.5) - start
                sums[y, first + 1] += delta * second
                for column in range(first + 2, last - 1):
                    sums[y, column] += delta * step
                before = start + second + (last - first - 3) * step
                sums[y, last - 1] += delta * (1.0 - before - end)
            sums[y, last] += delta * end


@tile_kernel
def edge_count(segment, is_curve, half):
    """Return the number of edges by which a segment (4, 2) is drawn.

    half  half the width of its stroke, or 0 for the segment itself

    The distance of a curve B from n edges is at most max |B''| / (8 n^2), and B'' is at most six
    times the second differences of the control points. The outer side of a stroke bends like its
    curve, but is longer by the factor 1 + half / radius, with the radius |B'|^2 / |B''|.
    """
    if not is_curve:
        return 1
    length = bend = before_x = before_y = 0.0
    for i in range(3):
        across = segment[i + 1, 0] - segment[i, 0]
        down = segment[i + 1, 1] - segment[i, 1]
        length += math.sqrt(across * across + down * down)
        if i > 0:
            x, y = across - before_x, down - before_y
            bend = max(bend, math.sqrt(x * x + y * y))
        before_x, before_y = across, down
    if length == 0.0:
        return 1
    turn = bend / length
    return int(math.sqrt(0.75 / SAGITTA * (bend + 6.0 * half * turn * turn))) + 1


@tile_kernel
def point_at(segment, is_curve, t):
    """Return the point and the derivative (x, y, x', y') of a segment (4, 2) at t in 0..1."""
    u = 1.0 - t
    ax, ay = segment[0, 0], segment[0, 1]
    dx, dy = segment[3, 0], segment[3, 1]
    if not is_curve:
        return u * ax + t * dx, u * ay + t * dy, dx - ax, dy - ay
    bx, by, cx, cy = segment[1, 0], segment[1, 1], segment[2, 0], segment[2, 1]
    k0, k1, k2, k3 = u * u * u, 3.0 * u * u * t, 3.0 * u * t * t, t * t * t
    x, y = k0 * ax + k1 * bx + k2 * cx + k3 * dx, k0 * ay + k1 * by + k2 * cy + k3 * dy
    j0, j1, j2 = 3.0 * u * u, 6.0 * u * t, 3.0 * t * t
    along_x = j0 * (bx - ax) + j1 * (cx - bx) + j2 * (dx - cx)
    along_y = j0 * (by - ay) + j1 * (cy - by) + j2 * (dy - cy)
    return x, y, along_x, along_y


@tile_kernel
def direction_at(segment, is_curve, t):
    """Return the unit tangent (x, y) of a segment (4, 2) at t in 0..1.

    Where a handle lies on its node, the derivative is 0. A point a little further on then gives the
    tangent. A segment without extent has the tangent (1, 0).
    """
    _, _, x, y = point_at(segment, is_curve, t)
    length = math.sqrt(x * x + y * y)
    if length < 1e-9:
        _, _, x, y = point_at(segment, is_curve, t + (1e-3 if t < 0.5 else -1e-3))
        length = math.sqrt(x * x + y * y)
    if length == 0.0:
        return 1.0, 0.0
    return x / length, y / length


@tile_kernel
def add_outline(sums, segments, curved, x0, y0):
    """Add the edges of closed outlines to `sums`, whose upper left corner is at (x0, y0)."""
    for s in range(len(segments)):
        count = edge_count(segments[s], curved[s], 0.0)
        px, py = segments[s, 0, 0] - x0, segments[s, 0, 1] - y0
        for i in range(1, count + 1):
            x, y, _, _ = point_at(segments[s], curved[s], i / count)
            add_edge(sums, px, py, x - x0, y - y0)
            px, py = x - x0, y - y0


@tile_kernel
def _add_fan(sums, x, y, from_x, from_y, to_x, to_y, radius, hub_x, hub_y):
    """Add an arc around (x, y) between two unit directions, on the shorter way, and its hub.

    The polygon runs from the hub to the arc, along it, and back. All parts of a stroke turn the
    same way, so that none is a hole in another.
    """
    turn = math.atan2(from_x * to_y - from_y * to_x, from_x * to_x + from_y * to_y)
    if turn < 0.0:
        turn, from_x, from_y = -turn, to_x, to_y
    count = int(turn * math.sqrt(radius / (8.0 * SAGITTA))) + 1
    px, py = hub_x, hub_y
    for i in range(count + 1):
        cos, sin = math.cos(turn * i / count), math.sin(turn * i / count)
        qx = x + radius * (from_x * cos - from_y * sin)
        qy = y + radius * (from_x * sin + from_y * cos)
        add_edge(sums, px, py, qx, qy)
        px, py = qx, qy
    add_edge(sums, px, py, hub_x, hub_y)


@tile_kernel
def _beside(segment, is_curve, t, offset):
    """Return the point (x, y) `offset` px to the left of a segment (4, 2) at t in 0..1."""
    x, y, _, _ = point_at(segment, is_curve, t)
    ux, uy = direction_at(segment, is_curve, t)
    return x - offset * uy, y + offset * ux


@tile_kernel
def _add_cap(sums, x, y, ux, uy, half, cap):
    """Add the cap of a stroke that ends at (x, y) in the direction u.

    cap  index into CAPS
    """
    if cap == 1:
        _add_fan(sums, x, y, uy, -ux, ux, uy, half, x, y)
        _add_fan(sums, x, y, ux, uy, -uy, ux, half, x, y)
    elif cap == 2:
        nx, ny = half * uy, -half * ux
        end_x, end_y = x + half * ux, y + half * uy
        add_edge(sums, x - nx, y - ny, x + nx, y + ny)
        add_edge(sums, x + nx, y + ny, end_x + nx, end_y + ny)
        add_edge(sums, end_x + nx, end_y + ny, end_x - nx, end_y - ny)
        add_edge(sums, end_x - nx, end_y - ny, x - nx, y - ny)


@tile_kernel
def _inner_cuts(segments, curved, s, after, half):
    """Return where the inner sides of a stroke meet if segment `after` follows segment s.

    The result is a left and a right value of t for the end of s, and the same for the start of
    `after`. They are found by Newton's method. Between these values, the segments do not overlap.
    If the sides do not meet within half of each segment, the values are 1, 1, 0 and 0.
    """
    ux, uy = direction_at(segments[s], curved[s], 1.0)
    vx, vy = direction_at(segments[after], curved[after], 0.0)
    is_left = ux * vy > uy * vx
    inner = half if is_left else -half
    a, b = 1.0, 0.0
    for _ in range(6):
        px, py = _beside(segments[s], curved[s], a, inner)
        qx, qy = _beside(segments[after], curved[after], b, inner)
        x, y = qx - px, qy - py
        if abs(x) + abs(y) < 1e-6:
            return (a, 1.0, b, 0.0) if is_left else (1.0, a, 0.0, b)
        jx, jy = _beside(segments[s], curved[s], a - 1e-4, inner)
        kx, ky = _beside(segments[after], curved[after], b + 1e-4, inner)
        jx, jy, kx, ky = 1e4 * (px - jx), 1e4 * (py - jy), 1e4 * (kx - qx), 1e4 * (ky - qy)
        determinant = jx * ky - jy * kx
        a += (x * ky - y * kx) / determinant
        b += (x * jy - y * jx) / determinant
        if not (0.5 <= a <= 1.0 and 0.0 <= b <= 0.5):
            break
    return 1.0, 1.0, 0.0, 0.0


@tile_kernel
def _add_join(sums, x, y, ux, uy, vx, vy, half, hub_x, hub_y, is_round):
    """Add what lies on the outer side between two segments, of directions u and v, at (x, y).

    hub_x, hub_y  the point at which the polygons of both segments end
    """
    turn = math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)
    if abs(turn) * half < LEAST_GAP:
        return
    if turn < 0.0:
        ux, uy, vx, vy = -vx, -vy, -ux, -uy
    # Now the stroke comes along u, turns to the left, and leaves along v.
    if is_round:
        _add_fan(sums, x, y, uy, -ux, vy, -vx, half, hub_x, hub_y)
        return
    px, py, qx, qy = x + half * uy, y - half * ux, x + half * vy, y - half * vx
    add_edge(sums, hub_x, hub_y, px, py)
    if math.cos(0.5 * turn) * MITER_LIMIT >= 1.0:
        reach = half * math.tan(0.5 * abs(turn))
        add_edge(sums, px, py, px + reach * ux, py + reach * uy)
        px, py = px + reach * ux, py + reach * uy
    add_edge(sums, px, py, qx, qy)
    add_edge(sums, qx, qy, hub_x, hub_y)


@tile_kernel
def add_stroke(sums, segments, curved, is_closed, width, cap, x0, y0):
    """Add the stroke along one outline to `sums`, whose upper left corner is at (x0, y0).

    segments  (k, 4, 2), each with an extent
    cap       index into CAPS of the ends. Joins are round if it is that of "round", else mitred
    """
    half, count = 0.5 * width, len(segments)
    before = count - 1
    left, right, next_left, next_right = 1.0, 1.0, 0.0, 0.0
    if is_closed:
        left, right, next_left, next_right = _inner_cuts(segments, curved, before, 0, half)
    for s in range(count):
        segment, is_curve = segments[s], curved[s]
        x, y, _, _ = point_at(segment, is_curve, 0.0)
        ux, uy = direction_at(segment, is_curve, 0.0)
        if s > 0 or is_closed:
            wx, wy = direction_at(segments[before], curved[before], 1.0)
            hub_x, hub_y = x, y
            if left < 1.0:
                hub_x, hub_y = _beside(segments[before], curved[before], left, half)
            elif right < 1.0:
                hub_x, hub_y = _beside(segments[before], curved[before], right, -half)
            _add_join(sums, x - x0, y - y0, wx, wy, ux, uy, half, hub_x - x0, hub_y - y0, cap == 1)
        else:
            _add_cap(sums, x - x0, y - y0, -ux, -uy, half, cap)
        # The polygon of the segment goes along its right side and back along its left side.
        first_left, first_right = next_left, next_right
        left = right = 1.0
        is_end = s == count - 1 and not is_closed
        if not is_end:
            left, right, next_left, next_right = _inner_cuts(
                segments, curved, s, (s + 1) % count, half
            )
        edges = edge_count(segment, is_curve, half)
        lx, ly = _beside(segment, is_curve, first_left, half)
        rx, ry = _beside(segment, is_curve, first_right, -half)
        add_edge(sums, lx - x0, ly - y0, rx - x0, ry - y0)
        for i in range(1, edges + 1):
            t = i / edges
            px, py = _beside(segment, is_curve, min(max(t, first_left), left), half)
            qx, qy = _beside(segment, is_curve, min(max(t, first_right), right), -half)
            add_edge(sums, rx - x0, ry - y0, qx - x0, qy - y0)
            add_edge(sums, px - x0, py - y0, lx - x0, ly - y0)
            lx, ly, rx, ry = px, py, qx, qy
        add_edge(sums, rx - x0, ry - y0, lx - x0, ly - y0)
        if is_end:
            x, y, _, _ = point_at(segment, is_curve, 1.0)
            ux, uy = direction_at(segment, is_curve, 1.0)
            _add_cap(sums, x - x0, y - y0, ux, uy, half, cap)
        before = s
