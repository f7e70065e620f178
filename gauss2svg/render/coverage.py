"""Exact coverage of pixels by areas and lines.

A curve is replaced by a polygon, and a line by the polygons of its stroke. The edges of polygons
are then added up row by row. An edge changes the coverage of the pixels that it crosses by a part
of its height, and of all pixels to the right of these by its whole height. The running sum along a
row is the winding number, averaged over each pixel. Its absolute value, at most 1, is the coverage.
So a hole is an outline that runs the other way. `coverage_reference` computes the same by clipping
polygons.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gauss2svg.render.tiles import tile_kernel
from gauss2svg.scene.areas import Area, Outline

CHORD = 1.5  # mean length of a polygon's edges on a curve, in px
LEAST_EDGES = 3  # smallest number of edges on a curve
MITER_LIMIT = 4.0  # largest ratio of a mitre to the width of its line (the default of SVG)
ROUND_STEP_RAD = 0.3  # largest turn between two edges of a round join or cap
# Corners that turn by less than this are joined by a bevel, which differs by nothing visible.
LEAST_TURN_RAD = 0.02


@tile_kernel
def add_edge(sums, ax, ay, bx, by):
    """Add the edge from (ax, ay) to (bx, by) to the differences of the winding number.

    sums  (h, w + 2) changes of the winding number along each row, averaged over each pixel
    """
    h, w = sums.shape[0], sums.shape[1] - 2
    if ay == by:
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
    for y in range(int(ay), min(h, int(math.ceil(by)))):
        height = min(y + 1.0, by) - max(float(y), ay)
        next_x = x + slope * height
        delta = height * turn
        # What lies left of the box changes all of the row, and what lies right of it nothing.
        left = min(max(min(x, next_x), 0.0), float(w))
        right = min(max(max(x, next_x), 0.0), float(w))
        first, last = int(left), int(math.ceil(right))
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
        x = next_x


@tile_kernel
def edge_count(segment, is_curve):
    """Return the number of edges by which a segment (4, 2) is drawn."""
    if not is_curve:
        return 1
    length = 0.0
    for i in range(3):
        across = segment[i + 1, 0] - segment[i, 0]
        down = segment[i + 1, 1] - segment[i, 1]
        length += math.sqrt(across * across + down * down)
    return int(length / CHORD) + LEAST_EDGES


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
    if length < 1e-12:
        return 1.0, 0.0
    return x / length, y / length


@tile_kernel
def add_outline(sums, segments, curved, x0, y0):
    """Add the edges of closed outlines to `sums`, whose upper left corner is at (x0, y0)."""
    for s in range(len(segments)):
        count = edge_count(segments[s], curved[s])
        px, py = segments[s, 0, 0] - x0, segments[s, 0, 1] - y0
        for i in range(1, count + 1):
            x, y, _, _ = point_at(segments[s], curved[s], i / count)
            add_edge(sums, px, py, x - x0, y - y0)
            px, py = x - x0, y - y0


@tile_kernel
def _add_fan(sums, x, y, from_x, from_y, to_x, to_y, radius):
    """Add the sector around (x, y) between two unit directions, on the shorter way.

    The sector runs from the first direction to the second one and back through its centre.
    """
    turn = math.atan2(from_x * to_y - from_y * to_x, from_x * to_x + from_y * to_y)
    count = int(abs(turn) / ROUND_STEP_RAD) + 1
    px, py = x + radius * from_x, y + radius * from_y
    sign = 1.0 if turn > 0 else -1.0
    # All parts of a stroke turn the same way, so that none is a hole in another.
    if sign > 0:
        add_edge(sums, x, y, px, py)
    else:
        add_edge(sums, px, py, x, y)
    for i in range(1, count + 1):
        cos, sin = math.cos(turn * i / count), math.sin(turn * i / count)
        qx = x + radius * (from_x * cos - from_y * sin)
        qy = y + radius * (from_x * sin + from_y * cos)
        if sign > 0:
            add_edge(sums, px, py, qx, qy)
        else:
            add_edge(sums, qx, qy, px, py)
        px, py = qx, qy
    if sign > 0:
        add_edge(sums, px, py, x, y)
    else:
        add_edge(sums, x, y, px, py)


@tile_kernel
def _add_join(sums, x, y, ux, uy, vx, vy, half, is_round):
    """Add what a join at (x, y) adds on its outer side, between the directions u and v.

    Without it, the strokes of two segments that meet at a corner leave a notch there.
    """
    turn = math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)
    if abs(turn) < LEAST_TURN_RAD:
        return
    side = -half if turn > 0 else half  # the outer side is on the right of a turn to the left
    ax, ay, bx, by = -uy, ux, -vy, vx  # left normals
    if is_round:
        sign = 1.0 if side > 0 else -1.0
        _add_fan(sums, x, y, sign * ax, sign * ay, sign * bx, sign * by, half)
        return
    px, py, qx, qy = x + side * ax, y + side * ay, x + side * bx, y + side * by
    cos_half = math.cos(0.5 * turn)
    mx, my = 0.5 * (px + qx), 0.5 * (py + qy)
    if cos_half * MITER_LIMIT >= 1.0:
        # The mitre lies at half / cos(turn / 2) from the node, along the bisector of the normals.
        wx, wy = ax + bx, ay + by
        length = math.sqrt(wx * wx + wy * wy)
        reach = side / cos_half / max(length, 1e-12)
        mx, my = x + reach * wx, y + reach * wy
    if turn > 0:
        add_edge(sums, x, y, px, py)
        add_edge(sums, px, py, mx, my)
        add_edge(sums, mx, my, qx, qy)
        add_edge(sums, qx, qy, x, y)
    else:
        add_edge(sums, px, py, x, y)
        add_edge(sums, mx, my, px, py)
        add_edge(sums, qx, qy, mx, my)
        add_edge(sums, x, y, qx, qy)


@tile_kernel
def _add_quad(sums, px, py, ux, uy, qx, qy, vx, vy, half):
    """Add the part of a stroke from p to q, whose unit tangents there are u and v."""
    ax, ay, bx, by = px - half * uy, py + half * ux, qx - half * vy, qy + half * vx
    cx, cy, dx, dy = qx + half * vy, qy - half * vx, px + half * uy, py - half * ux
    add_edge(sums, dx, dy, cx, cy)
    add_edge(sums, cx, cy, bx, by)
    add_edge(sums, bx, by, ax, ay)
    add_edge(sums, ax, ay, dx, dy)


@tile_kernel
def add_stroke(sums, segments, curved, is_closed, width, cap, x0, y0):
    """Add the stroke along one outline to `sums`, whose upper left corner is at (x0, y0).

    cap  index into CAPS of the ends. Joins are round if it is that of "round", else mitred
    """
    half, count = 0.5 * width, len(segments)
    is_round = cap == 1
    for s in range(count):
        edges = edge_count(segments[s], curved[s])
        px, py, _, _ = point_at(segments[s], curved[s], 0.0)
        ux, uy = direction_at(segments[s], curved[s], 0.0)
        if s > 0 or is_closed:
            before = s - 1 if s > 0 else count - 1
            wx, wy = direction_at(segments[before], curved[before], 1.0)
            _add_join(sums, px - x0, py - y0, wx, wy, ux, uy, half, is_round)
        elif cap == 1:
            _add_fan(sums, px - x0, py - y0, -uy, ux, -ux, -uy, half)
            _add_fan(sums, px - x0, py - y0, -ux, -uy, uy, -ux, half)
        elif cap == 2:
            qx, qy = px - half * ux - x0, py - half * uy - y0
            _add_quad(sums, qx, qy, ux, uy, px - x0, py - y0, ux, uy, half)
        for i in range(1, edges + 1):
            qx, qy, _, _ = point_at(segments[s], curved[s], i / edges)
            vx, vy = direction_at(segments[s], curved[s], i / edges)
            _add_quad(sums, px - x0, py - y0, ux, uy, qx - x0, qy - y0, vx, vy, half)
            px, py, ux, uy = qx, qy, vx, vy
        if s == count - 1 and not is_closed:
            if cap == 1:
                _add_fan(sums, px - x0, py - y0, uy, -ux, ux, uy, half)
                _add_fan(sums, px - x0, py - y0, ux, uy, -uy, ux, half)
            elif cap == 2:
                qx, qy = px + half * ux - x0, py + half * uy - y0
                _add_quad(sums, px - x0, py - y0, ux, uy, qx, qy, ux, uy, half)
