"""Strokes of a plot: narrow parts of a scene as lines along their middle, hatching, and order."""

from collections.abc import Sequence
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
from gauss2svg.render.areas import coverage_of
from gauss2svg.scene import Area, Scene

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
WIDEST = 0.022  # width of the widest line, as a share of the picture's longer side
_SIDE = 800  # px along the longer side of the picture in which lines are found
# Largest width in px of lines of which this picture is larger by a factor, and largest length of
# all outlines in px
_THIN, _FINER, _MOST_LENGTH = 1.7, 3, 50_000
_FINE = 3  # cells along a side of a px in which lines are found
ALIKE = 10.5 / 255  # largest difference of two colours that a drawing does not tell apart


class Line(NamedTuple):
    """A line with its colour, the points (n, 2) along its middle, and its width, in cells."""

    color: Floats
    points: Floats
    width: float


def centrelines(scene: Scene, cells_per_px: float, size: Floats) -> tuple[list[Line], Bools]:
    """Return the lines of a scene, and two masks (2, h, w) of a picture of it.

    The masks say where parts that have lines are, and where their lines draw them. Lines are the
    narrow parts of what is seen of a colour, whether areas or lines of the scene draw it.
    size  columns and rows of cells
    """
    sides = np.array([scene.width, scene.height])
    longest = _SIDE * (_FINER if _is_thin(scene, _SIDE / sides.max()) else 1)
    scale, most = longest / sides.max(), longest * WIDEST
    width, height = np.maximum(np.round(sides * scale), 1).astype(int).tolist()
    seen = np.zeros((_FINE * height, _FINE * width), np.int32)  # areas by their colours, from 1 on
    colors = np.array([color_of(area) for area in scene.areas])
    for area, color in zip(scene.areas, colors, strict=True):
        if area.opacity > 0.5:
            is_alike = np.abs(colors - color).max(axis=1) <= ALIKE
            fill(seen, area.scaled(_FINE * scale, _FINE * scale), int(is_alike.argmax()) + 1)
    lines, thin = list[Line](), np.zeros((2, height, width), bool)
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
                points = np.clip(points_along(moved, size), 0, size)
                lines.append(Line(colors[k - 1], points, width_px * cells_per_px / scale))
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
    lines = [points_along(line, size) for line in segments]
    column, row = np.clip(np.concatenate(lines), 0, size - 1).astype(int).T
    depth = distance_to(~np.pad(solid, 1))[0][1:-1, 1:-1][row, column]
    # A fifth of the lines may be wider, where they cross, and a fifth thinner.
    thin, wide = np.percentile(depth, [20, 80])
    if wide > 2 * thin + 1 or (part.thick.any() and sum(map(length_of, lines)) <= 4 * most):
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
    at = np.concatenate([1e6 * k + lengths_of(line) for k, line in enumerate(lines)])
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


def fill(covered: NDArray[Any], area: Area, value: int) -> None:
    """Give the cells that an area covers a value."""
    points = np.concatenate([outline.points for outline in area.outlines])
    size, reach = covered.shape[::-1], 2 * area.width
    left, top = np.floor(np.clip(points.min(axis=0) - reach, 0, size)).astype(int).tolist()
    right, bottom = np.ceil(np.clip(points.max(axis=0) + reach, 0, size)).astype(int).tolist()
    share = coverage_of(area, left, top, right - left, bottom - top)
    covered[top:bottom, left:right][share > 0.5] = value


def color_of(area: Area) -> tuple[float, ...]:
    """Return the colour of an area, or the first one of its gradient."""
    return area.paint if isinstance(area.paint, tuple) else area.paint.colors[0]


def long_runs(flags: Bools, points: Floats, longest: float) -> Bools:
    """Return flags without their runs of at most `longest` cells, unless a run is all of them."""
    long = np.zeros_like(flags)
    for a, b in _ends_of_runs(flags):
        long[a:b] = length_of(points[a:b]) > longest or b - a == len(flags)
    return long


def points_along(segments: Floats, size: Floats) -> Floats:
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


def runs_of(points: Floats, shown: Bools, closed: bool) -> list[Floats]:
    """Return the runs of at least two points that are shown."""
    if closed and not shown.all():
        # A run may lie on both sides of the start of a closed outline.
        start = int(np.argmin(shown))
        points, shown = np.roll(points[:-1], -start, axis=0), np.roll(shown[:-1], -start)
    return [points[a:b] for a, b in _ends_of_runs(shown) if b - a > 1]


def simplified(points: Floats) -> Floats:
    """Return the points of a polyline that are needed to keep within a tenth of a cell of all."""
    return approximate_polygon(points, 0.1)


def hatching(tone: Floats, distance: float, pen: float, angle_deg: float) -> list[Floats]:
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
            runs = runs_of(points, tone[row, column] > levels[k % 2], closed=False)
            lines += [run[[0, -1]] for run in runs if len(run) > 2 * pen]
        strokes += _joined(ordered(lines), tone > levels[0], 2.5 * distance)
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


def ordered(strokes: Sequence[Floats]) -> list[Floats]:
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


def length_of(stroke: Floats) -> float:
    """Return the length of a polyline."""
    return float(lengths_of(stroke)[-1])


def lengths_of(stroke: Floats) -> Floats:
    """Return the length (n,) of a polyline up to each of its points."""
    return np.cumsum(portable.hypot(*np.diff(stroke, axis=0, prepend=stroke[:1]).T))
