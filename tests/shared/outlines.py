"""Outlines of straight lines, and the points of a cubic."""

import numpy as np

from gauss2svg.scene.areas import Outline


def polygon(*points: tuple[float, float]) -> Outline:
    """Return a closed outline of straight lines."""
    return Outline(points, (False,) * len(points))


def polyline(*points: tuple[float, float]) -> Outline:
    """Return an open outline of straight lines."""
    return Outline(points, (False,) * (len(points) - 1), closed=False)


def box(left: float, top: float, right: float, bottom: float) -> Outline:
    """Return the outline of a rectangle."""
    return polygon((left, top), (right, top), (right, bottom), (left, bottom))


def cubic(p, count: int):
    """Return `count` points along the cubic with the control points p (4, 2)."""
    t = np.linspace(0, 1, count)[:, None]
    u = 1 - t
    return u**3 * p[0] + 3 * u * u * t * p[1] + 3 * u * t * t * p[2] + t**3 * p[3]
