"""A scene as the strokes of a pen plotter, in mm on paper.

Lines are drawn along their centrelines. Areas are drawn along their outlines, where the picture
has two colours beside them and no area above hides them. Tones are drawn by hatching: parallel
lines in up to three directions, of which a place has more the darker it is. A drawing has tones
only if they are asked for, a photo always.

    scene -> picture on the sheet, in cells of a third of the pen's width
        areas -> points along outlines that are seen    \
                                                          strokes of each pen -> order -> layers
        picture -> tone of each pen -> hatching, joined /

A scene in inks has a pen for each ink, any other a black one. The pen of an ink is darker than the
ink: where as much paper as possible is left between its strokes, both together have its colour.
"""

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.errors import several
from gauss2svg.pipeline.plot_lines import (
    ALIKE,
    WIDEST,
    Bools,
    Floats,
    Line,
    centrelines,
    color_of,
    fill,
    hatching,
    length_of,
    long_runs,
    ordered,
    points_along,
    runs_of,
    simplified,
)
from gauss2svg.render import render
from gauss2svg.scene import Area, Scene
from gauss2svg.scene.inks import ink_colors, ink_name, printed_colors
from gauss2svg.svg import Document, Plotter
from gauss2svg.svg.element import Element, number
from gauss2svg.svg.encode import document_svg, layer
from gauss2svg.without_scipy import nearest_entry


class Pen(NamedTuple):
    """A pen: its name, the colour #rrggbb of its strokes, and the strokes (n, 2) in mm."""

    name: str
    color: str
    strokes: list[Floats]


class Plot(NamedTuple):
    """The strokes of all pens on a sheet. As text: 1.7 m in 45 strokes, 0.6 m with the pen up, ..

    sheet      width and height in mm
    pen_width  width of strokes in mm
    """

    sheet: tuple[float, float]
    pen_width: float
    pens: list[Pen]
    document: Document

    @property
    def drawn_mm(self) -> float:
        """Length of all strokes."""
        return sum(length_of(stroke) for pen in self.pens for stroke in pen.strokes)

    @property
    def travel_mm(self) -> float:
        """Length of the ways between strokes. Each pen begins at the corner of the sheet."""
        return sum(
            float(portable.hypot(*(b[0] - a[-1])))
            for pen in self.pens
            for a, b in pairwise([np.zeros((1, 2)), *pen.strokes])
        )

    @property
    def lifts(self) -> int:
        """Number of strokes, after each of which the pen is lifted."""
        return sum(len(pen.strokes) for pen in self.pens)

    def __str__(self) -> str:
        drawn, travel = self.drawn_mm, self.travel_mm
        # The speeds in mm/s and the time in s of a lift are the defaults of AxiDraw's software.
        minutes = (drawn / 50 + travel / 151 + 0.25 * self.lifts) / 60
        return (
            f"{drawn / 1000:.1f} m in {several(self.lifts, 'stroke')}, "
            f"{travel / 1000:.1f} m with the pen up, in at least {math.ceil(minutes)} min"
        )

    @property
    def svg(self) -> str:
        """Text of an SVG in mm, with a layer for each pen."""
        layers = []
        for at, (name, color, strokes) in enumerate(self.pens, start=1):
            data = (" ".join(number(v, 2) for v in stroke.ravel()) for stroke in strokes)
            paths = [Element("path", d="M" + numbers) for numbers in data]
            label = f"{at} {name}: {several(len(paths), 'stroke')}"
            layers.append(layer(label, paths, id=f"pen-{at}", stroke=color))
        root = {
            "fill": "none", "stroke-width": number(self.pen_width, 3),
            "stroke-linecap": "round", "stroke-linejoin": "round",
        }  # fmt: skip
        sheet = Scene(*self.sheet)
        alt, size = self.document.alt or str(self), f"{self.sheet[0]:g}mm"
        named = dataclasses.replace(self.document, alt=alt, size=size)
        return document_svg(sheet, named, layers, root=root)


def plot_of(scene: Scene, report: Mapping[str, Any], plotter: Plotter, document: Document) -> Plot:
    """Return the scene of a run as strokes. Each ink of the run or of a sketch has a pen."""
    inks, paper, overprint = (report[key] for key in ("inks", "paper", "overprint"))
    if (sketch := report["sketch"] or "").count(",") > 1:
        paper, inks = sketch.split(",", 1)
    return plotted(scene, plotter, document, inks, paper, overprint)


def plotted(
    scene: Scene,
    plotter: Plotter,
    document: Document,
    inks: str | None = None,
    paper: str | None = None,
    overprint: int | None = None,
) -> Plot:
    """Return a scene as strokes, as large as the sheet and its margins allow.

    document   title and description of the file
    inks       colours such as "#c0322c,#000000", each of which has a pen. None for one black pen
    paper      as in printed_colors, as is `overprint`. What has its colour is not drawn
    A named sheet is turned as the picture is.
    """
    width, height = plotter.sides(scene.width > scene.height)
    room = plotter.room(width, height)
    mm_per_px = min(room[0] / scene.width, room[1] / scene.height)
    sides = np.array([scene.width, scene.height]) * mm_per_px
    # A stroke is 3 cells wide, unless the picture would have more than ten million cells.
    cell = max(plotter.pen_width / 3, float(np.sqrt(sides.prod() / 1e7)))
    columns, rows = size = np.maximum(np.round(sides / cell), 1).astype(int)
    pen_cells, scale = plotter.pen_width / cell, mm_per_px / cell
    picture = np.clip(render(scene, columns, rows), 0, 1)
    colors, tones = _colors_and_tones(inks, paper, overprint)
    strokes: list[list[Floats]] = [[] for _ in tones.T]
    lines, thin = centrelines(scene, scale, size)
    down, across = np.arange(rows) * thin.shape[1], np.arange(columns) * thin.shape[2]
    in_part, in_line = thin[:, (down // rows)[:, None], across // columns]
    found = [(line.color, simplified(line.points)) for line in lines]
    areas = [area.scaled(scale, scale) for area in scene.areas]
    found += _outlines(areas, picture, in_part, in_line, lines, pen_cells, 0.5 * scale)
    for k, (color, stroke) in enumerate(found):
        tone_of_pens = tones[int(_nearest(colors, color))]
        if not tone_of_pens.any() and k >= len(lines):
            # The outline of an area without a pen is drawn by the pen of what is around it.
            beside = stroke[:, None] + pen_cells * np.array([[-1, 0], [1, 0], [0, -1], [0, 1]])
            x, y = np.clip(np.floor(beside), 0, size - 1).astype(int).transpose(2, 0, 1)
            tone_of_pens = tones[_nearest(colors, picture[y, x])].sum((0, 1))
        if tone_of_pens.any():
            strokes[int(tone_of_pens.argmax())].append(stroke)
    if plotter.hatch is not None or len(scene) >= sum(area.nodes for area in scene.areas):
        distance = plotter.hatch or 2 * plotter.pen_width
        nearest = _nearest(colors, picture)
        for one, tone_of_colors in zip(strokes, tones.T, strict=True):
            tone = tone_of_colors[nearest]
            if inks is None:
                tone = 1 - portable.product(picture, (0.2126, 0.7152, 0.0722))
            tone = np.where(in_part, 0, tone)
            one += hatching(tone, distance / cell, pen_cells, plotter.hatch_angle)
    corner = 0.5 * (np.array([width, height]) - sides)
    pens = [
        Pen(ink_name(ink), _pen_color(ink), in_order)
        for ink, one in zip(_pen_inks(inks), strokes, strict=True)
        if (in_order := ordered([corner + cell * stroke for stroke in one]))
    ]
    return Plot((width, height), plotter.pen_width, pens, document)


def _pen_inks(inks: str | None) -> Floats:
    """Return the inks (n, 3) of the pens, the lightest first."""
    colors = np.zeros((1, 3)) if inks is None else ink_colors(inks)
    return colors[np.argsort(-colors.sum(axis=1), kind="stable")]


def _colors_and_tones(
    inks: str | None, paper: str | None, overprint: int | None
) -> tuple[Floats, Floats]:
    """Return the colours (m, 3) of a picture, and the tone (m, n) of each pen in each of them.

    A tone is the share of the paper that strokes cover, where it has this colour. An ink has the
    largest tone at which a pen can give its colour, that of a pen without white in it.
    """
    pens = _pen_inks(inks)
    if inks is None:
        return pens, np.ones((1, 1))
    tone = 1 - pens.min(axis=1)  # an ink with less than .1 is not drawn on white paper
    printed = printed_colors(",".join(map(ink_name, pens)), paper, overprint)
    strengths = np.array([*printed.values()])
    return ink_colors(",".join(printed)), strengths * np.where(tone < 0.1, 0.0, tone)


def _pen_color(ink: Floats) -> str:
    """Return the colour #rrggbb that gives an ink where white is beside it."""
    color = 1 - (1 - ink) / max(1 - ink.min(), 1 / 255)
    return ink_name(color)


def _nearest(colors: Floats, picture: NDArray[np.floating]) -> NDArray[np.intp]:
    """Return the index (..) of the nearest colour to each colour (.., 3) of a picture."""
    points = np.asarray(picture.reshape(-1, 3), np.float64)
    return nearest_entry(colors, points)[1].reshape(picture.shape[:-1])


def _outlines(
    areas: Sequence[Area], picture: NDArray[np.floating], in_part: Bools, in_line: Bools,
    lines: list[Line], pen: float, margin: float,
) -> Iterator[tuple[Floats, Floats]]:  # fmt: skip
    """Yield the colour and the points (n, 2) of each part of outlines that is seen, in cells.

    picture  (rows, columns, 3) what the areas draw. Outlines are seen where its colour changes
    in_part  (rows, columns) whether a cell is in a part that has lines. Only long outlines are
             drawn there, as those around a wide end of a line
    in_line  (rows, columns) whether a cell is in a line, which is drawn along its middle. Outlines
             only cross lines, or lead to where lines end
    pen      width of a stroke in cells. What lies nearer than half of it to a stroke above is drawn
             already
    margin   outlines are left out at this distance from the edge, where the picture ends and not
             the area
    """
    from scipy.spatial import KDTree  # imported here because it is slow to import

    size, covered = np.array(in_line.shape[::-1]), np.zeros_like(in_line)
    ends = np.concatenate([line.points[[0, -1]] for line in lines] or [np.zeros((2, 2))])
    reach = 1.5 * np.repeat([line.width for line in lines] or [0.0], 2)
    tree, nib = KDTree(ends), np.array([(x, y) for x in (-1, 0, 1) for y in (-1, 0, 1)])
    for area in reversed(areas):
        drawn = list[Floats]()
        for outline in area.outlines:
            points = points_along(outline.segments, size)
            inside = ((points >= margin) & (points <= size - margin)).all(axis=1)
            column, row = np.clip(points, 0, size - 1).astype(int).T
            longest = 2 * WIDEST * size.max()
            lined = in_line[row, column]
            apart = in_part[row, column] & ~lined
            lined |= apart & ~long_runs(apart, points, longest)
            hidden = long_runs(lined, points, longest)
            unseen = ~_differs(picture, points, 0.5 * area.width + 2)
            hidden |= (covered[row, column] | long_runs(unseen, points, 2 * pen)) & ~lined
            shown = inside & ~hidden
            drawn.append(points[shown])
            for stroke in runs_of(points, shown, outline.closed):
                if length_of(stroke) > 2 * pen or len(stroke) >= len(points) - 1:  # others are dots
                    away, nearest = tree.query(stroke[[0, -1]])
                    is_near = (away <= reach[nearest]) & (stroke[0] != stroke[-1]).any()
                    first, last = np.where(is_near[:, None], ends[nearest], stroke[[0, -1]])
                    stroke = np.concatenate([[first], stroke, [last]])
                    yield np.array(color_of(area)), simplified(stroke)
        nibs = np.concatenate(drawn)[:, None] + pen / 3 * nib
        x, y = np.clip(nibs, 0, size - 1).astype(int).transpose(2, 0, 1)
        covered[y, x] = True
        if area.opacity > 0.95:
            fill(covered, area, True)


def _differs(picture: NDArray[np.floating], points: Floats, reach: float) -> Bools:
    """Return whether the picture has different colours at each of some points (n, 2) of a polyline.

    It is compared with the colours at this distance in cells on both sides of the polyline.
    """
    way = np.gradient(points, axis=0)
    across = way[:, ::-1] * [1, -1] / np.maximum(portable.hypot(*way.T), 1e-9)[:, None]
    places = points + reach * across * np.array([-1, 0, 1])[:, None, None]
    x, y = np.clip(places, 0, np.array(picture.shape[1::-1]) - 1).astype(int).transpose(2, 0, 1)
    return np.ptp(picture[y, x], axis=0).max(axis=-1) > ALIKE
