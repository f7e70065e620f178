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
from scipy.ndimage import find_objects
from skimage.measure import approximate_polygon

from gauss2svg import portable
from gauss2svg.areas.arrays import dilated, distance_to, widened
from gauss2svg.areas.find import RATE, UNIT
from gauss2svg.areas.lines import Part, parts_between, strokes_of
from gauss2svg.areas.outlines import sampled
from gauss2svg.errors import several
from gauss2svg.render import render
from gauss2svg.render.areas import coverage_of
from gauss2svg.scene import Area, Scene
from gauss2svg.scene.inks import ink_colors, ink_name, printed_colors
from gauss2svg.svg import Document, Plotter
from gauss2svg.svg.element import Element, number
from gauss2svg.svg.encode import document_svg, layer
from gauss2svg.without_scipy import nearest_entry

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
_WIDEST = 0.022  # width of the widest line, as a share of the picture's longer side
_SIDE = 800  # px along the longer side of the picture in which lines are found
# Largest width in px of lines of which this picture is larger by a factor, and largest length of
# all outlines in px
_THIN, _FINER, _MOST_LENGTH = 1.7, 3, 50_000
_FINE = 3  # cells along a side of a px in which lines are found
_ALIKE = 10.5 / 255  # largest difference of two colours that a drawing does not tell apart


class Pen(NamedTuple):
    """A pen: its name, the colour #rrggbb of its strokes, and the strokes (n, 2) in mm."""

    name: str
    color: str
    strokes: list[Floats]


class _Line(NamedTuple):
    """A line with its colour, the points (n, 2) along its middle, and its width, in cells."""

    color: Floats
    points: Floats
    width: float


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
        return sum(_length(stroke) for pen in self.pens for stroke in pen.strokes)

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
    lines, thin = _centrelines(scene, scale, size)
    down, across = np.arange(rows) * thin.shape[1], np.arange(columns) * thin.shape[2]
    in_part, in_line = thin[:, (down // rows)[:, None], across // columns]
    found = [(line.color, _simplified(line.points)) for line in lines]
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
            one += _hatching(tone, distance / cell, pen_cells, plotter.hatch_angle)
    corner = 0.5 * (np.array([width, height]) - sides)
    pens = [
        Pen(ink_name(ink), _pen_color(ink), in_order)
        for ink, one in zip(_pen_inks(inks), strokes, strict=True)
        if (in_order := _in_order([corner + cell * stroke for stroke in one]))
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
    lines: list[_Line], pen: float, margin: float,
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
            points = _points_along(outline.segments, size)
            inside = ((points >= margin) & (points <= size - margin)).all(axis=1)
            column, row = np.clip(points, 0, size - 1).astype(int).T
            longest = 2 * _WIDEST * size.max()
            lined = in_line[row, column]
            apart = in_part[row, column] & ~lined
            lined |= apart & ~_long_runs(apart, points, longest)
            hidden = _long_runs(lined, points, longest)
            unseen = ~_differs(picture, points, 0.5 * area.width + 2)
            hidden |= (covered[row, column] | _long_runs(unseen, points, 2 * pen)) & ~lined
            shown = inside & ~hidden
            drawn.append(points[shown])
            for stroke in _runs(points, shown, outline.closed):
                if _length(stroke) > 2 * pen or len(stroke) >= len(points) - 1:  # others are dots
                    away, nearest = tree.query(stroke[[0, -1]])
                    is_near = (away <= reach[nearest]) & (stroke[0] != stroke[-1]).any()
                    first, last = np.where(is_near[:, None], ends[nearest], stroke[[0, -1]])
                    stroke = np.concatenate([[first], stroke, [last]])
                    yield np.array(_color(area)), _simplified(stroke)
        nibs = np.concatenate(drawn)[:, None] + pen / 3 * nib
        x, y = np.clip(nibs, 0, size - 1).astype(int).transpose(2, 0, 1)
        covered[y, x] = True
        if area.opacity > 0.95:
            _cover(covered, area, True)


def _differs(picture: NDArray[np.floating], points: Floats, reach: float) -> Bools:
    """Return whether the picture has different colours at each of some points (n, 2) of a polyline.

    It is compared with the colours at this distance in cells on both sides of the polyline.
    """
    way = np.gradient(points, axis=0)
    across = way[:, ::-1] * [1, -1] / np.maximum(portable.hypot(*way.T), 1e-9)[:, None]
    places = points + reach * across * np.array([-1, 0, 1])[:, None, None]
    x, y = np.clip(places, 0, np.array(picture.shape[1::-1]) - 1).astype(int).transpose(2, 0, 1)
    return np.ptp(picture[y, x], axis=0).max(axis=-1) > _ALIKE


def _color(area: Area) -> tuple[float, ...]:
    return area.paint if isinstance(area.paint, tuple) else area.paint.colors[0]


def _centrelines(scene: Scene, cells_per_px: float, size: Floats) -> tuple[list[_Line], Bools]:
    """Return the lines of a scene, and two masks (2, h, w) of a picture of it.

    The masks say where parts that have lines are, and where their lines draw them. Lines are the
    narrow parts of what is seen of a colour, whether areas or lines of the scene draw it.
    size  columns and rows of cells
    """
    sides = np.array([scene.width, scene.height])
    longest = _SIDE * (_FINER if _is_thin(scene, _SIDE / sides.max()) else 1)
    scale, most = longest / sides.max(), longest * _WIDEST
    width, height = np.maximum(np.round(sides * scale), 1).astype(int).tolist()
    seen = np.zeros((_FINE * height, _FINE * width), np.int32)  # areas by their colours, from 1 on
    colors = np.array([_color(area) for area in scene.areas])
    for area, color in zip(scene.areas, colors, strict=True):
        if area.opacity > 0.5:
            is_alike = np.abs(colors - color).max(axis=1) <= _ALIKE
            _cover(seen, area.scaled(_FINE * scale, _FINE * scale), int(is_alike.argmax()) + 1)
    lines, thin = list[_Line](), np.zeros((2, height, width), bool)
    for k, fine in enumerate(find_objects(seen), 1):
        if fine is None:
            continue
        down, across = (slice(side.start // _FINE, -(-side.stop // _FINE)) for side in fine)
        top, left = widened((down, across), 4, thin.shape[1:])
        corner = np.array([left.start, top.start])
        near = seen[_FINE * top.start : _FINE * top.stop, _FINE * left.start : _FINE * left.stop]
        cells = (near == k).reshape(top.stop - top.start, _FINE, left.stop - left.start, _FINE)
        share = cells.mean(axis=(1, 3))
        for part in parts_between(share, _wide(share > 0.5, 0.7 * most)):
            found, drawn = _lines_of(part, most)
            for segments, width_px in found:
                moved = (segments + part.corner + corner) * cells_per_px / scale
                points = np.clip(_points_along(moved, size), 0, size)
                lines.append(_Line(colors[k - 1], points, width_px * cells_per_px / scale))
            thin[:, top, left][(..., *part.box)] |= drawn
    return lines, thin


def _is_thin(scene: Scene, px: float) -> bool:
    """Return whether half of the outlines of a scene, by their length, are around thin parts.

    Small loops of such lines would be filled. The width of an area is taken as that of a bar, twice
    its size divided by the length of its outlines. Very many lines would take minutes.

    px  px of the usual picture for each of the scene
    """
    widths, lengths = [0.0], [0.0]
    for area in scene.areas:
        nodes = [outline.nodes for outline in area.outlines]
        steps = [np.roll(one, -1, axis=0) - one for one in nodes]
        length = sum(float(portable.hypot(*step.T).sum()) for step in steps)
        pairs = zip(nodes, steps, strict=True)
        twice = sum(float((n[:, 0] * s[:, 1] - n[:, 1] * s[:, 0]).sum()) for n, s in pairs)
        widths.append(px * (area.width or abs(twice) / max(length, 1e-9)))
        lengths.append(px * length)
    thin = np.array(lengths)[np.array(widths) < _THIN].sum()
    return bool(sum(lengths) <= _MOST_LENGTH and thin > 0.5 * sum(lengths))


def _lines_of(part: Part, most: float) -> tuple[list[tuple[Floats, float]], Bools]:
    """Return the segments (k, 4, 2) and widths of a part's lines, and two masks (2, h, w).

    The masks say where the part is, and where its lines draw it. There are no lines if the part is
    not about as wide along all of them, unlike wedges and crescents, or is a corner of a wide part.
    """
    strokes = strokes_of(part, lambda p: np.full(len(p), 0.003), UNIT, RATE, most)
    solid = part.share > 0.5
    drawn = np.zeros((2, *solid.shape), bool)
    if not strokes:
        return [], drawn
    size = np.array(solid.shape[::-1])
    segments = [path.segments - part.corner for path, _ in strokes]
    lines = [_points_along(line, size) for line in segments]
    column, row = np.clip(np.concatenate(lines), 0, size - 1).astype(int).T
    depth = distance_to(~np.pad(solid, 1))[0][1:-1, 1:-1][row, column]
    # A fifth of the lines may be wider, where they cross, and a fifth thinner.
    thin, wide = np.percentile(depth, [20, 80])
    if wide > 2 * thin + 1 or (part.thick.any() and sum(map(_length, lines)) <= 4 * most):
        return [], drawn
    widths = np.array([width for _, width in strokes])
    reach = np.zeros(solid.shape)
    reach[row, column] = np.repeat(widths, list(map(len, lines))) + 1
    distance, (y, x) = distance_to(reach > 0)
    drawn[0] = dilated(solid, 2)
    drawn[1] = drawn[0] & (distance <= reach[y, x])
    return list(zip(_connected(segments, lines, widths), widths, strict=True)), drawn


def _connected(segments: list[Floats], lines: list[Floats], widths: Floats) -> list[Floats]:
    """Return the segments of lines, with those that lead their ends to other lines they touch.

    lines  points (n, 2) along each
    """
    from scipy.spatial import KDTree  # imported here because it is slow to import

    points, width_at = np.concatenate(lines), np.repeat(widths, [*map(len, lines)])
    # Places on different lines are far from each other along them.
    at = np.concatenate([1e6 * k + _lengths(line) for k, line in enumerate(lines)])
    tree, last, connected = KDTree(points), -1, list[Floats]()
    for path, line, width in zip(segments, lines, widths, strict=True):
        ways, first, last = list[Floats](), last + 1, last + len(line)
        for end in (first, last):
            near = np.array(tree.query_ball_point(points[end], 0.5 * (width + widths.max())), int)
            away = portable.hypot(*(points[near] - points[end]).T)
            is_beside = np.abs(at[near] - at[end]) <= 3 * width
            away[is_beside | (away > 0.5 * (width + width_at[near]))] = np.inf
            target = near[away.argmin()] if away.min() < np.inf else end
            ways.append(np.linspace(points[end], points[target], 4)[None])
        connected.append(np.concatenate([ways[0][:, ::-1], path, ways[1]]))
    return connected


def _wide(mask: Bools, radius: float) -> Bools:
    """Return where a mask is wide enough for a disc of a radius, and the cells beside that."""
    depth = distance_to(~np.pad(mask, 1, mode="edge"))[0]
    if depth.max() <= radius:
        return np.zeros_like(mask)
    return (distance_to(depth > radius)[0] <= radius + 1)[1:-1, 1:-1]


def _long_runs(flags: Bools, points: Floats, longest: float) -> Bools:
    """Return flags without their runs of at most `longest` cells, unless a run is all of them."""
    long = np.zeros_like(flags)
    for a, b in _ends_of_runs(flags):
        long[a:b] = _length(points[a:b]) > longest or b - a == len(flags)
    return long


def _cover(covered: NDArray[Any], area: Area, value: int) -> None:
    """Give the cells that an area covers a value."""
    points = np.concatenate([outline.points for outline in area.outlines])
    size, reach = covered.shape[::-1], 2 * area.width
    left, top = np.floor(np.clip(points.min(axis=0) - reach, 0, size)).astype(int).tolist()
    right, bottom = np.ceil(np.clip(points.max(axis=0) + reach, 0, size)).astype(int).tolist()
    share = coverage_of(area, left, top, right - left, bottom - top)
    covered[top:bottom, left:right][share > 0.5] = value


def _points_along(segments: Floats, size: Floats) -> Floats:
    """Return points (n, 2) along segments (k, 4, 2), at most a cell apart within the picture.

    size  its columns and rows
    """
    near = ((segments.min(axis=1) <= size) & (segments.max(axis=1) >= 0)).all(axis=1)
    length = portable.hypot(*np.diff(segments, axis=1).transpose(2, 0, 1)).sum(axis=1)
    # A cubic curve moves by up to three times its length for a step of its parameter. Segments that
    # are much longer than any picture have fewer points.
    count = np.where(near, np.clip(np.ceil(3 * length), 1, 1e5), 1).astype(int)
    points = sampled(segments, np.ones(len(segments), bool), count)
    return np.concatenate([points, segments[-1:, 3]])


def _ends_of_runs(flags: Bools) -> list[list[int]]:
    """Return the index of the first flag of each run that is set, and that after its last one."""
    ends = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return ends.reshape(-1, 2).tolist()


def _runs(points: Floats, shown: Bools, closed: bool) -> list[Floats]:
    """Return the runs of at least two points that are shown."""
    if closed and not shown.all():
        # A run may lie on both sides of the start of a closed outline.
        start = int(np.argmin(shown))
        points, shown = np.roll(points[:-1], -start, axis=0), np.roll(shown[:-1], -start)
    return [points[a:b] for a, b in _ends_of_runs(shown) if b - a > 1]


def _simplified(points: Floats) -> Floats:
    """Return the points of a polyline that are needed to keep within a tenth of a cell of all."""
    return approximate_polygon(points, 0.1)


def _hatching(tone: Floats, distance: float, pen: float, angle_deg: float) -> list[Floats]:
    """Return strokes whose density around each cell is about proportional to its tone.

    Where the tone is 1, there are all lines of all directions. The lines of a direction are drawn
    where the tone exceeds what those before it cover. Ends of neighbouring lines are joined where
    it is dark between them, so that the pen stays down.
    """
    share, strokes = min(pen / distance, 1.0), list[Floats]()
    covered = 1 - portable.power(1 - share, np.arange(4))
    rows, columns = tone.shape
    for turn, before in enumerate(covered[:-1]):  # three directions, from light to dark tones
        angle = np.radians(angle_deg + 60 * turn)
        along = np.array([portable.cos(angle), portable.sin(angle)])
        across = np.array([-along[1], along[0]])
        # Every second line is drawn from a lighter tone on. With more such steps there were more
        # tones, but a face had fewer details.
        levels = (before + (1 - before) * share * np.array([0.25, 0.75])) / covered[-1]
        corners = np.array([[0, 0], [columns, 0], [0, rows], [columns, rows]])
        first, last = portable.product(corners, along), portable.product(corners, across)
        t = np.arange(first.min(), first.max())[:, None]
        lines = list[Floats]()
        for k in range(int(np.ceil(last.min() / distance)), int(last.max() / distance) + 1):
            points = t * along + k * distance * across
            points = points[((points >= 0) & (points < [columns, rows])).all(axis=1)]
            column, row = points.astype(int).T
            runs = _runs(points, tone[row, column] > levels[k % 2], closed=False)
            lines += [run[[0, -1]] for run in runs if len(run) > 2 * pen]
        strokes += _joined(_in_order(lines), tone > levels[0], 2.5 * distance)
    return strokes


def _joined(strokes: Sequence[Floats], dark: Bools, most: float) -> list[Floats]:
    """Join strokes to the next ones that begin at most `most` cells away, across dark cells."""
    joined = list[Floats]()
    for stroke in strokes:
        if joined and portable.hypot(*(stroke[0] - joined[-1][-1])) <= most:
            way = np.linspace(joined[-1][-1], stroke[0], 12).astype(int)
            if dark[way[:, 1], way[:, 0]].all():
                joined[-1] = np.concatenate([joined[-1], stroke])
                continue
        joined.append(stroke)
    return joined


def _in_order(strokes: Sequence[Floats]) -> list[Floats]:
    """Return strokes so that each begins at the nearest end of those that are left, from (0, 0) on.

    Strokes are reversed where this is nearer.
    """
    from scipy.spatial import KDTree  # imported here because it is slow to import

    left, in_order = np.ones(len(strokes), bool), list[Floats]()
    at, tree, index = np.zeros(2), None, np.zeros(0, int)
    while len(in_order) < len(strokes):
        if tree is None or 2 * left[index].sum() < len(index):
            index = np.flatnonzero(left)
            tree = KDTree(np.concatenate([strokes[k][[0, -1]] for k in index.tolist()]))
        count, found = 4, np.zeros(0, int)
        while not len(found):
            ends: Any = tree.query(at, min(count, 2 * len(index)))[1]
            found, count = ends[left[index[ends // 2]]], 4 * count
        k = int(index[found[0] // 2])
        in_order.append(strokes[k][:: -1 if found[0] % 2 else 1])
        left[k], at = False, in_order[-1][-1]
    return in_order


def _length(stroke: Floats) -> float:
    return float(_lengths(stroke)[-1])


def _lengths(stroke: Floats) -> Floats:
    """Return the length (n,) of a polyline up to each of its points."""
    return np.cumsum(portable.hypot(*np.diff(stroke, axis=0, prepend=stroke[:1]).T))
