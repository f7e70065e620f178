"""Shapes as bare ellipses: the contour of half height, as numbers for a stroke."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import half_radius
from gauss2svg.svg.encode import hex_color, number, writable

OUTLINE_WIDTH = 0.5  # px
STROKE_WIDTHS = 0.01, 100.0
STROKE_DECIMALS = 2  # of px, and of degrees
_LEAST_OPACITY = 0.005  # a fainter shape is hardly visible


@dataclass(frozen=True)
class Stroke:
    """One ellipse as text: its shape's index and round, centre and radii in px, rotation, colour.

    rotation is a transform, "" where there is none.
    """

    index: int
    round: int
    center: tuple[str, str]
    radii: tuple[str, str]
    rotation: str
    color: str


def stroked(scene: Scene) -> list[Stroke]:
    """The strokes of a scene in its order.

    Shapes whose extent or opacity is written as 0 are left out, as are those off the canvas whose
    numbers are too large (gauss2svg.svg.encode.writable).
    """
    axes, angle_rad = scene.ellipse_axes
    radii = axes * half_radius(scene.beta)[:, None]
    levels = np.round(scene.color * 255).astype(int)
    strokes = []
    for i in np.flatnonzero(writable(scene, half_radius(scene.beta), 1.0)).tolist():
        rx, ry = (number(v, STROKE_DECIMALS) for v in radii[i])
        if "0" in (rx, ry) or scene.opacity[i] < _LEAST_OPACITY:
            continue
        x, y = (number(v, STROKE_DECIMALS) for v in scene.mean[i])
        angle = number(math.degrees(angle_rad[i]), STROKE_DECIMALS)
        strokes.append(
            Stroke(
                index=i,
                round=int(scene.round_index[i]),
                center=(x, y),
                radii=(rx, ry),
                rotation="" if angle == "0" or rx == ry else f"rotate({angle} {x} {y})",
                color=hex_color(levels[i]),
            )
        )
    return strokes
