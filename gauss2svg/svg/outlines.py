"""Shapes as bare ellipses, for plotters: the contour of half height as a stroke.

With pens the strokes end at the page, and each is drawn by the pen whose colour is nearest:

    <g inkscape:label="1 #c0322c" stroke="#c0322c"> <ellipse cx="90" cy="40" rx="8" ry="3"/>
      <path d="M0 12.5A31 20 15 0 1 22.1 0"/> .. </g>
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import half_radius
from gauss2svg.scene.inks import MOST_INKS, ink_colors, inks_of
from gauss2svg.scene.nearest import nearest_entry
from gauss2svg.svg.element import Element, hex_color, number, writable
from gauss2svg.svg.encode import Drawn

OUTLINE_WIDTH = 0.5  # px
STROKE_WIDTHS = 0.01, 100.0
STROKE_DECIMALS = 2  # of px, and of degrees
MOST_PENS = MOST_INKS
# A piece of an arc; of longer ones rounded ends would move the centre.
_PIECE_RAD = 0.5 * math.pi


def outlines(scene: Scene) -> list[Drawn]:
    """An <ellipse> for each shape of a scene, in its order, with the colour as its stroke.

    Shapes whose extent or opacity is written as 0 are left out, as are those off the canvas whose
    numbers are too large (gauss2svg.svg.element.writable).
    """
    axes, angle_rad = scene.ellipse_axes
    radii = axes * half_radius(scene.beta)[:, None]
    levels = np.round(scene.color * 255).astype(int)
    center = scene.mean
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


@dataclass(frozen=True)
class Pen:
    """A pen: its colour as #rrggbb, and the strokes that it draws, those below first."""

    color: str
    strokes: tuple[Element, ...]


def pen_strokes(scene: Scene, count: int) -> list[Pen]:
    """At most `count` pens, lightest first, with what `outlines` draws as far as it is on the page.

    Their colours are those of gauss2svg.scene.inks.inks_of for the colours of the shapes.
    """
    drawn = outlines(scene)
    if not drawn:
        return []
    index = [one.shape for one in drawn]
    color = scene.color[index]
    distinct = len(np.unique(np.round(color * 255), axis=0))
    if distinct == 1:
        pens = hex_color(np.round(color[0] * 255).astype(int), short=False)
    else:
        # Sorted, as the choice looks at neighbours: the painter's order must not decide.
        sorted_by_color = color[np.lexsort(color.T)][None].astype(np.float32)
        pens = inks_of(sorted_by_color, min(count, distinct))
    entry = nearest_entry(ink_colors(pens), color)[1]
    strokes: list[list[Element]] = [[] for _ in pens.split(",")]
    matrices = scene.factor[index] * half_radius(scene.beta[index])[:, None, None]
    centers = scene.mean[index]
    for one, pen, matrix, center in zip(drawn, entry.tolist(), matrices, centers, strict=True):
        element = _on_page(one.element.without("stroke"), matrix, center, scene)
        if element is not None:
            strokes[pen].append(element)
    found = zip(pens.split(","), strokes, strict=True)
    return [Pen(name, tuple(of_it)) for name, of_it in found if of_it]


def _on_page(
    ellipse: Element, matrix: NDArray[np.float64], center: NDArray[np.float64], scene: Scene
) -> Element | None:
    """The part on the page of the ellipse center + matrix (cos t, sin t); None where none is."""
    spans = _spans(matrix, center, (scene.width, scene.height))
    if spans is None:
        return ellipse
    if not spans:
        return None
    attributes = ellipse.attributes
    turn = attributes.get("transform", "rotate(0").removeprefix("rotate(").split()[0]
    arc = f"A{attributes['rx']} {attributes['ry']} {turn} 0 1"
    data = ""
    for begin, end in spans:
        pieces = math.ceil((end - begin) / _PIECE_RAD)
        angles = np.linspace(begin, end, pieces + 1)
        ends = center + np.stack([np.cos(angles), np.sin(angles)], axis=1) @ matrix.T
        ends = np.clip(ends, 0, [scene.width, scene.height])
        texts = [" ".join(number(v, STROKE_DECIMALS) for v in point) for point in ends]
        data += f"M{texts[0]}" + "".join(f"{arc} {text}" for text in texts[1:])
    return Element("path", {"d": data})


def _spans(
    matrix: NDArray[np.float64], center: NDArray[np.float64], page: tuple[float, float]
) -> list[tuple[float, float]] | None:
    """Intervals of t in which center + matrix (cos t, sin t) is on the page; None for all of it.

    It crosses a side x = k where m11 cos t + m12 sin t = k - x, at atan2(m12, m11) +- acos(..).
    """
    crossings: list[float] = []
    for (along, across), at, side in zip(matrix, center, page, strict=True):
        reach = math.hypot(along, across)
        for wall in (0.0, side):
            if abs(wall - at) < reach:
                middle, half = math.atan2(across, along), math.acos((wall - at) / reach)
                crossings += [(middle - half) % (2 * math.pi), (middle + half) % (2 * math.pi)]
    ends = np.sort(crossings) if crossings else np.zeros(1)
    ends = np.append(ends, ends[0] + 2 * math.pi)
    middles = 0.5 * (ends[1:] + ends[:-1])
    at = center + np.stack([np.cos(middles), np.sin(middles)], axis=1) @ matrix.T
    inside: NDArray[np.bool_] = np.all((at >= 0) & (at <= np.array(page)), axis=1)
    if inside.all():
        return None
    # Begin after a part that is off the page, so that none wraps round.
    first = int(np.flatnonzero(~inside)[0]) + 1
    spans: list[tuple[float, float]] = []
    for k in range(len(inside)):
        at_k = (first + k) % len(inside)
        if not inside[at_k]:
            continue
        begin, end = float(ends[at_k]), float(ends[at_k + 1])
        if spans and abs((spans[-1][1] - begin) % (2 * math.pi)) < 1e-12:
            spans[-1] = spans[-1][0], spans[-1][1] + end - begin
        else:
            spans.append((begin, end))
    return spans
