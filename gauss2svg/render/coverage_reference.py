"""Coverage of pixels by polygons, and its gradient, in plain NumPy.

These functions are slow and readable. Tests equate the kernels of gauss2svg/core/coverage.c
with them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene.areas import Outline

SAGITTA = 0.01  # largest distance in px of a curve from the edges of its polygon


def counts_of(outline: Outline) -> list[int]:
    """Return the numbers of edges by which the kernels draw the segments of an outline."""
    pairs = zip(outline.segments, outline.curved, strict=True)
    bends = ((np.hypot(*np.diff(p, 2, axis=0).T).max() if curved else 0) for p, curved in pairs)
    return [int(np.sqrt(0.75 / SAGITTA * bend)) + 1 for bend in bends]


def polygon_of(outline: Outline, counts: Sequence[int]) -> NDArray[np.float64]:
    """Return the vertices (n, 2) of a closed outline whose segments have so many edges."""
    parts = []
    for segment, is_curve, count in zip(outline.segments, outline.curved, counts, strict=True):
        weights, _ = _weights(np.arange(count) / count, is_curve)
        parts.append(weights @ segment)
    return np.concatenate(parts)


def winding(
    polygons: Iterable[NDArray[np.float64]], left: float, top: float, width: int, height: int
) -> NDArray[np.float64]:
    """Return the winding number (height, width) of polygons, averaged over each pixel of a box.

    It is the signed area of the part of the polygons that lies inside the pixel.
    """
    area = np.zeros((height, width))
    for polygon in polygons:
        for row in range(height):
            strip = _half(_half(polygon, 1, top + row, 1), 1, top + row + 1, -1)
            for column in range(width):
                part = _half(_half(strip, 0, left + column, 1), 0, left + column + 1, -1)
                x, y = (part - [left + column, top + row]).T
                area[row, column] += 0.5 * (x @ np.roll(y, -1) - y @ np.roll(x, -1))
    return area


def _half(polygon: NDArray[np.float64], axis: int, bound: float, side: int) -> NDArray[np.float64]:
    """Return the part of a polygon (n, 2) on one side of an upright or level line.

    side  1 for coordinates above the bound, and -1 for those below it

    This is a step of the algorithm of Sutherland and Hodgman. An edge that crosses the line gets a
    vertex there, and vertices on the other side are left out.
    """
    before = np.roll(polygon, 1, axis=0)
    depth, depth_before = (side * (p[:, axis] - bound) for p in (polygon, before))
    crosses = (depth >= 0) != (depth_before >= 0)
    share = depth_before / np.where(crosses, depth_before - depth, 1)
    crossing = before + share[:, None] * (polygon - before)
    vertices = np.stack([crossing, polygon], axis=1)
    return vertices[np.stack([crosses, depth >= 0], axis=1)]


def coverage_gradient(
    outline: Outline, left: float, top: float, width: int, height: int, samples: int = 4096
) -> NDArray[np.float64]:
    """Return the gradient (height, width, points, 2) of a closed outline's coverage.

    It has the derivative of the coverage of each pixel with respect to each point of the outline.
    If a piece (dx, dy) of the outline is moved by (u, v), the signed area beside it changes by
    u dy - v dx. A control point moves each piece by its weight there. So the derivative is the
    integral of the weight times (dy, -dx) over the pieces inside the pixel. The integral is a sum
    over `samples` pieces of each segment.
    """
    t = (np.arange(samples) + 0.5) / samples
    points = [(i, i) for i in range(len(outline.points))]
    index = dataclasses.replace(outline, points=points).segments[:, :, 0].astype(int)
    gradient = np.zeros((height, width, len(points), 2))
    for segment, is_curve, of_point in zip(outline.segments, outline.curved, index, strict=True):
        weights, slopes = _weights(t, is_curve)
        column, row = np.floor(weights @ segment - [left, top]).astype(int).T
        dx, dy = (slopes @ segment / samples).T
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        for point, weight in zip(of_point, weights.T, strict=True):
            moved = (weight * [dy, -dx]).T
            np.add.at(gradient, (row[inside], column[inside], point), moved[inside])
    polygon = polygon_of(outline, [256] * len(outline.curved))
    return gradient * np.sign(winding([polygon], left, top, width, height))[:, :, None, None]


def _weights(
    t: NDArray[np.float64], is_curve: bool
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the weights (n, 4) of a segment's control points at t, and their derivatives."""
    u, zero, one = 1 - t, np.zeros_like(t), np.ones_like(t)
    if not is_curve:
        return np.stack([u, zero, zero, t], axis=1), np.stack([-one, zero, zero, one], axis=1)
    weights = [u**3, 3 * u**2 * t, 3 * u * t**2, t**3]
    slopes = [-3 * u**2, 3 * u**2 - 6 * u * t, 6 * u * t - 3 * t**2, 3 * t**2]
    return np.stack(weights, axis=1), np.stack(slopes, axis=1)
