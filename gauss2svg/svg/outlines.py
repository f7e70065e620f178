"""Shapes as bare ellipses, for plotters: the contour of half height as a stroke."""

from __future__ import annotations

import math

import numpy as np

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import half_radius
from gauss2svg.svg.element import Element, hex_color, number
from gauss2svg.svg.encode import Drawn
from gauss2svg.svg.limits import writable
from gauss2svg.svg.snap import half_centers

OUTLINE_WIDTH = 0.5  # px
STROKE_WIDTHS = 0.01, 100.0
STROKE_DECIMALS = 2  # of px, and of degrees


def outlines(scene: Scene) -> list[Drawn]:
    """An <ellipse> for each shape of a scene, in its order, with the colour as its stroke.

    Shapes whose extent or opacity is written as 0 are left out, as are those off the canvas whose
    numbers are too large (gauss2svg.svg.limits.writable).
    """
    axes, angle_rad = scene.ellipse_axes
    radii = axes * half_radius(scene.beta)[:, None]
    levels = np.round(scene.color * 255).astype(int)
    center = scene.mean + half_centers(scene)
    drawn = []
    for i in np.flatnonzero(writable(scene, half_radius(scene.beta), 1.0)).tolist():
        rx, ry = (number(v, STROKE_DECIMALS) for v in radii[i])
        # A fainter shape is hardly visible.
        if "0" in (rx, ry) or scene.opacity[i] < 0.005:
            continue
        x, y = (number(v, STROKE_DECIMALS) for v in center[i])
        angle = number(math.degrees(angle_rad[i]), STROKE_DECIMALS)
        turned = {} if angle == "0" or rx == ry else {"transform": f"rotate({angle} {x} {y})"}
        attributes = {"cx": x, "cy": y, "rx": rx, "ry": ry, "stroke": hex_color(levels[i])}
        drawn.append(Drawn(i, Element("ellipse", {**attributes, **turned})))
    return drawn
