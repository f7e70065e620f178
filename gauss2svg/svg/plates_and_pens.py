"""Drawings for printers: a plate for each ink, and outlines of shapes.

A plate shows where one ink is printed. For example, a scene has yellow ellipses, blue ellipses over
them, and yellow ellipses on top. These are three groups in two inks. The yellow plate has both
yellow groups in black, and between them the blue group in white.

An outline is a stroke along the contour at which the falloff of a shape is 1/2.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import quoted, refusal
from gauss2svg.options import Field
from gauss2svg.scene import Area, Scene
from gauss2svg.scene.falloff import covered_radius, half_radius
from gauss2svg.scene.inks import ink_name, inks_of_scene
from gauss2svg.svg import Document
from gauss2svg.svg.areas import area_elements, box_centers, in_units, with_areas
from gauss2svg.svg.element import Element, check_view, hex_color, number, writable
from gauss2svg.svg.encode import (
    Drawing,
    clipped_layers,
    counted,
    layers_by_level,
    round_layers,
    sides_of,
)
from gauss2svg.svg.minimal_shapes import color_levels, colors_together, overlaps, projections

Floats = NDArray[np.float64]
STROKE_WIDTHS = 0.01, 100.0  # the range of a stroke's width in px
# The number of decimals of lengths in px and of degrees.
STROKE_DECIMALS = 2
AREA_UNIT = 10.0**-STROKE_DECIMALS  # unit of the outlines of areas, in px
# Two ellipses count as apart if the gap between them is at least this, in px. It is more than 0,
# because edges are antialiased.
_MARGIN = 1.0


def encode_outlines(scene: Scene, document: Document, stroke_width: float) -> Drawing:
    """Return the drawing of gauss2svg.svg.write.outline_svg, with the same arguments and errors."""
    check_view(scene)
    stroke_width = Field("stroke_width", float, *STROKE_WIDTHS).checked(stroke_width)
    width = number(stroke_width, STROKE_DECIMALS)
    lines, kept = in_units(outlined(scene.areas, stroke_width), AREA_UNIT, STROKE_DECIMALS)
    scene, areas = with_areas(scene, kept), area_elements(lines, STROKE_DECIMALS)
    shapes, root = outlines(scene), {"fill": "none", "stroke-width": width}
    scale = f"scale({number(AREA_UNIT, 2)})"
    lower, rounds = layers_by_level(areas.paths, shapes, scene, transform=scale)
    index = [i for i, _ in shapes]
    sheet = document.style([k for k, _ in rounds])
    half = (half_radius(scene.beta)[:, None] * scene.sigma)[index] + 0.5 * float(width)
    mean, reach = box_centers(areas.boxes)
    mean = np.vstack([AREA_UNIT * mean, scene.mean[index]])
    half = np.vstack([AREA_UNIT * reach, half])
    body = clipped_layers([*lower, *round_layers(rounds)], scene, mean, half)
    counts = counted(scene.areas)
    return Drawing(sides_of(scene), len(shapes), [], body, sheet, root, areas=counts)


def outlined(areas: Iterable[Area], stroke_width: float) -> list[Area]:
    """Return outlines of areas, and lines, as strokes in the first colour of their paint."""
    lines = []
    for area in areas:
        color = area.paint if isinstance(area.paint, tuple) else area.paint.colors[0]
        look = {"paint": color, "opacity": float(area.opacity >= 0.005), "width": stroke_width}
        lines.append(dataclasses.replace(area, **look, cap="butt"))
    return lines


def outlines(scene: Scene) -> list[tuple[int, Element]]:
    """Return for each shape its index and an <ellipse> whose stroke has the colour of the shape.

    A shape is left out if its extent or opacity would be written as 0. It is also left out if it is
    off the canvas and its numbers are too large (gauss2svg.svg.element.writable).
    """
    radius = half_radius(scene.beta)
    axes, angle_rad = scene.ellipse_axes
    radii, angles = axes * radius[:, None], np.degrees(angle_rad)
    levels = np.round(scene.color * 255).astype(int)
    drawn = []
    # A shape is left out if its opacity is under 0.005, because two decimals round this to 0.
    for i in np.flatnonzero(writable(scene, radius, 1.0) & (scene.opacity >= 0.005)).tolist():
        numbers = *radii[i], *scene.mean[i], angles[i]
        rx, ry, x, y, angle = (number(v, STROKE_DECIMALS) for v in numbers)
        if "0" in (rx, ry):
            continue
        turn = None if angle == "0" or rx == ry else f"rotate({angle} {x} {y})"
        stroke = hex_color(levels[i])
        ellipse = Element("ellipse", cx=x, cy=y, rx=rx, ry=ry, stroke=stroke, transform=turn)
        drawn.append((i, ellipse))
    return drawn


def grouped_by_ink(scene: Scene) -> Scene:
    """Return the scene with shapes of the same ink moved together.

    A shape is moved only if this does not change the picture. Each run of shapes of the same ink
    becomes a round. Raise InputError if the scene is not in inks.
    """
    inks_of_scene(scene)
    mean, factor = _ellipses(scene)
    keys = np.stack([mean[:, 0], mean[:, 1], scene.beta])
    order = colors_together(mean, factor, color_levels(scene.color, 6), keys, _MARGIN)
    scene = scene.replace(round_index=None, level=None).select(order)
    changes = (np.diff(color_levels(scene.color, 6), axis=0) != 0).any(axis=1)
    index = np.concatenate([[0], np.cumsum(changes)])[: len(scene)]
    return scene.replace(round_index=index)


def plate_of(scene: Scene, tones: Mapping[str, float]) -> Scene:
    """Return the plate of an ink: black where the ink is visible, and white elsewhere.

    tones  strength of the ink in 0..1 in each colour #rrggbb. It is 0 in all others. A strength
           between 0 and 1 is grey

    Shapes that change nothing on the plate are left out. Raise InputError if the scene has none of
    the colours that have a strength.
    """
    names = [ink_name(one) for one in inks_of_scene(scene)]
    printing = [color for color, tone in tones.items() if tone]
    if not set(printing) & set(names):
        raise refusal("ink", f"one of {', '.join(names)}", quoted(", ".join(printing)))

    def grey(color: Any) -> float:
        return 1.0 - tones.get(ink_name(np.asarray(color)), 0.0)

    colors, entry = np.unique(scene.color, axis=0, return_inverse=True)
    greys = np.array([grey(color) for color in colors])[entry.reshape(-1)]
    ground = 1.0 if scene.transparent else grey(scene.background)
    areas = [dataclasses.replace(a, paint=(grey(a.paint),) * 3) for a in scene.areas]
    # `shows` marks the shapes whose colour on the plate differs from what may be below them. A
    # shape that is not marked is needed only if it covers a part of a marked shape.
    shows = (greys != ground) | bool(areas)
    ellipses, needed = projections(*_ellipses(scene)), shows.copy()
    for _, upper in overlaps(*ellipses, shows, _MARGIN, np.flatnonzero(shows)):
        needed[upper] = True
    plate = scene.replace(
        color=np.repeat(greys[:, None], 3, axis=1),
        areas=areas,
        background=np.full(3, ground),
        transparent=False,
    )
    return plate.select(needed)


def _ellipses(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centres (n, 2) of the ellipses that are drawn, and their Cholesky factors (n, 3).

    Both are in px. The factors are l11 l21 l22.
    """
    factor = scene.factor * covered_radius(scene.beta)[:, None, None]
    return scene.mean, np.stack([factor[:, 0, 0], factor[:, 1, 0], factor[:, 1, 1]], axis=1)
