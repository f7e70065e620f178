"""Drawings for printers and plotters: a plate for each ink, and outlines that pens draw.

A plate shows where one ink is printed. For example, a scene has yellow ellipses, blue ellipses over
them, and yellow ellipses on top. These are three groups in two inks. The yellow plate has both
yellow groups in black, and between them the blue group in white.

An outline is a stroke along the contour at which the falloff of a shape is 1/2. If there are pens,
strokes are cut at the edges of the page, and each stroke is drawn by the pen whose colour is
nearest:

    <g inkscape:label="1 #c0322c" stroke="#c0322c"> <ellipse cx="90" cy="40" rx="8" ry="3"/>
      <path d="M0 12.5A31 20 15 0 1 22.1 0"/> .. </g>
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.errors import quoted, refusal
from gauss2svg.options import Field
from gauss2svg.scene import Area, Scene
from gauss2svg.scene.falloff import covered_radius, half_radius
from gauss2svg.scene.inks import MOST_INKS, ink_colors, ink_name, inks_of, inks_of_scene
from gauss2svg.svg import Document
from gauss2svg.svg.areas import area_elements, box_centers, in_units, with_areas
from gauss2svg.svg.element import Element, check_view, hex_color, number, writable
from gauss2svg.svg.encode import (
    Drawing,
    clipped_layers,
    counted,
    layer,
    layers_by_level,
    round_layers,
    sides_of,
)
from gauss2svg.svg.minimal_shapes import color_levels, colors_together, overlaps, projections
from gauss2svg.without_scipy import nearest_entry

Floats = NDArray[np.float64]
STROKE_WIDTHS = 0.01, 100.0  # the range of a stroke's width in px
# The number of decimals of lengths and of degrees. Lengths are in px, or in mm if there are pens.
STROKE_DECIMALS = 2
AREA_UNIT = 10.0**-STROKE_DECIMALS  # unit of the outlines of areas, in px
MOST_PENS = MOST_INKS
# An arc is written in pieces of at most this angle. If a piece were longer, the rounding of the
# coordinates of its ends would move its centre.
_PIECE_RAD = 0.5 * math.pi
# Two ellipses count as apart if the gap between them is at least this, in px. It is more than 0,
# because edges are antialiased.
_MARGIN = 1.0


def encode_outlines(
    scene: Scene, document: Document, stroke_width: float, pens: int | None
) -> Drawing:
    """Return the drawing of gauss2svg.svg.write.outline_svg, with the same arguments and errors."""
    check_view(scene)
    stroke_width = Field("stroke_width", float, *STROKE_WIDTHS).checked(stroke_width)
    width = number(stroke_width, STROKE_DECIMALS)
    if pens is None:
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
    if scene.areas:
        got = f"{len(scene.areas)} areas, which are not cut at the edges of the page"
        raise refusal("a scene with pens", "without areas", got, "outlines without pens")
    count = Field("pens", int, 1, MOST_PENS).checked(pens)
    document.check_without_layers("pens", "whose layers are no rounds", "outlines without pens")
    mm_per_px = document.mm_each(scene.width)
    on_paper = scene.scaled(mm_per_px)
    layers, strokes = [], 0
    strokes_by_pen = pen_strokes(on_paper, count, float(width) * mm_per_px)
    for at, (pen, inside) in enumerate(strokes_by_pen, start=1):
        label, strokes = f"{at} {pen}: {len(inside)} strokes", strokes + len(inside)
        layers.append(layer(label, inside, id=f"pen-{at}", stroke=pen))
    root = {"fill": "none", "stroke-width": number(float(width) * mm_per_px, STROKE_DECIMALS + 1)}
    view = sides_of(on_paper)
    return Drawing(view, strokes, [], layers, root=root, size=f"{view[0]}mm")


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


def pen_strokes(scene: Scene, count: int, stroke_width: float) -> list[tuple[str, list[Element]]]:
    """Return up to `count` pens, each with its colour #rrggbb and its strokes.

    The pens are in the order from the lightest to the darkest colour. Their colours are chosen by
    gauss2svg.scene.inks.inks_of from the colours of the shapes. The strokes of a pen are those of
    `outlines`, cut at the sides of the page, in the order from bottom to top.
    """
    drawn = outlines(scene)
    if not drawn:
        return []
    color = scene.color[[i for i, _ in drawn]]
    distinct = len(np.unique(np.round(color * 255), axis=0))
    if distinct == 1:
        pens = hex_color(np.round(color[0] * 255).astype(int), short=False)
    else:
        # inks_of compares neighbouring pixels, so its result depends on the order of the colours.
        # They are sorted here, so that it does not depend on the order of the shapes.
        sorted_by_color = color[np.lexsort(color.T)][None].astype(np.float32)
        pens = inks_of(sorted_by_color, min(count, distinct))
    entry = nearest_entry(ink_colors(pens), color)[1]
    pens = pens.split(",")
    strokes: list[list[Element]] = [[] for _ in pens]
    matrices = scene.factor * half_radius(scene.beta)[:, None, None]
    for (i, ellipse), pen in zip(drawn, entry.tolist(), strict=True):
        bare, margin = ellipse.replace(stroke=None), 0.5 * stroke_width
        strokes[pen] += _on_page(bare, matrices[i], scene.mean[i], scene, margin)
    return [(pen, inside) for pen, inside in zip(pens, strokes, strict=True) if inside]


def _on_page(
    ellipse: Element, matrix: Floats, center: Floats, scene: Scene, margin: float
) -> list[Element]:
    """Return the part of an ellipse that is on the page, as an element. Return [] if there is none.

    The part ends at a distance of `margin` from the sides of the page. This is half of the width of
    the stroke, so that no ink is beside the page.

    The points of the ellipse are center + matrix (cos t, sin t). It crosses a line x = k where
    m11 cos t + m12 sin t = k - center_x. The solutions of this equation are

    t = atan2(m12, m11) +- acos((k - center_x) / hypot(m11, m12)).
    """
    last = np.array([scene.width, scene.height]) - margin
    crossings: list[float] = []
    for (along, across), at, end in zip(matrix, center, last, strict=True):
        reach, middle = portable.hypot(along, across), portable.arctan2(across, along)
        for edge in (margin, end):
            if abs(edge - at) < reach:
                half = portable.arccos((edge - at) / reach)
                crossings += [(middle - half) % (2 * math.pi), (middle + half) % (2 * math.pi)]
    ends = np.sort(crossings) if crossings else np.zeros(1)
    ends = np.append(ends, ends[0] + 2 * math.pi)
    middles = _points(0.5 * (ends[1:] + ends[:-1]), matrix, center)
    inside: NDArray[np.bool_] = np.all((middles >= margin) & (middles <= last), axis=1)
    if inside.all():
        return [ellipse]
    turn = ellipse.attributes.get("transform", "rotate(0").removeprefix("rotate(").split()[0]
    arc, data = f"A{ellipse.attributes['rx']} {ellipse.attributes['ry']} {turn} 0 1", ""
    for k in np.roll(np.arange(len(inside)), -1)[np.roll(inside, -1)]:
        pieces = math.ceil((ends[k + 1] - ends[k]) / _PIECE_RAD)
        angles = np.linspace(ends[k], ends[k + 1], pieces + 1)
        places = np.clip(_points(angles, matrix, center), margin, last)
        texts = [" ".join(number(v, STROKE_DECIMALS) for v in place) for place in places]
        data += f"M{texts[0]}" + "".join(f"{arc} {text}" for text in texts[1:])
    return [Element("path", d=data)] if data else []


def _points(t: Floats, matrix: Floats, center: Floats) -> Floats:
    return center + portable.product(np.stack([portable.cos(t), portable.sin(t)], axis=1), matrix.T)


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


def plate_of(scene: Scene, ink: str) -> Scene:
    """Return the plate of an ink #rrggbb: black where the ink is visible, and white elsewhere.

    Shapes of this ink are black, and shapes of other inks are white. Shapes that change nothing on
    the plate are left out. Raise InputError for an ink that the scene does not have.
    """
    names = [ink_name(one) for one in inks_of_scene(scene)]
    if ink not in names:
        raise refusal("ink", f"one of {', '.join(names)}", quoted(ink))
    levels = np.array(list(bytes.fromhex(ink[1:])))

    def is_ink(color: Any) -> NDArray[np.bool_]:
        return (color_levels(np.asarray(color), 6) == levels).all(axis=-1)

    printed = is_ink(scene.color)
    ground = not scene.transparent and bool(is_ink(scene.background))
    areas = [dataclasses.replace(a, paint=(float(not is_ink(a.paint)),) * 3) for a in scene.areas]
    shows = printed != ground
    # `shows` marks the shapes whose colour on the plate differs from the background of the plate. A
    # shape that is not marked is needed only if it covers a part of a marked shape.
    ellipses, needed = projections(*_ellipses(scene)), shows.copy()
    for _, upper in overlaps(*ellipses, shows, _MARGIN, np.flatnonzero(shows)):
        needed[upper] = True
    black = np.where(printed, 0.0, 1.0)[:, None]
    plate = scene.replace(
        color=np.broadcast_to(black, (len(scene), 3)),
        areas=areas,
        background=np.zeros(3) if ground else np.ones(3),
        transparent=False,
    )
    return plate.select(needed)


def _ellipses(scene: Scene) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the centres (n, 2) of the ellipses that are drawn, and their Cholesky factors (n, 3).

    Both are in px. The factors are l11 l21 l22.
    """
    factor = scene.factor * covered_radius(scene.beta)[:, None, None]
    return scene.mean, np.stack([factor[:, 0, 0], factor[:, 1, 0], factor[:, 1, 1]], axis=1)
