"""Lines: thin parts that become strokes along their middle, and the widths of those of few pixels.

A part becomes strokes if these are closer for their bytes than its outlines.

Pixels of lines that lie in two rows of pixels, or in two columns, tell only the product of a line's
width and its contrast: a line of 1 px between two rows has the same pixels as a line of 2 px with
half the contrast. So other parts of the picture decide: another line, an area of the same colour, a
line that has two grounds. Where nothing does, faint lines are 1 px wide.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from gauss2svg import portable
from gauss2svg.areas import arrays, outlines
from gauss2svg.areas.arrays import LEVEL, MARGIN, Bools, Box, Floats, Ints, dilated, parts_of
from gauss2svg.areas.centrelines import STEP, Chain, chains_of
from gauss2svg.areas.merge import rounded
from gauss2svg.areas.outlines import Path, Weights
from gauss2svg.areas.paint import LEAST_OPACITY, Paint, opacity_of
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.areas.regions import Regions
from gauss2svg.areas.thin import MOST_PARTS, PURE, SAME_COLOR, inside_of

WIDE = 3.2  # px; a disc of this radius fits into a wide part only where lines cross
WIDEST = 5.6  # px; the largest width of a line
MOST_OFF = 0.1  # px^2 by which a stroke may be off for each px of its length
SEEN = 0.12  # least share of a pixel in a part
LEAST_SHARE = 4.0  # px^2 of a part
EVEN = 3 * LEVEL  # largest difference of pixels of one colour
SAME_PEN = 5 * LEVEL  # largest difference of two colours of lines of a pen


class Line(NamedTuple):
    """A stroke of a region's paint."""

    region: int
    path: Path
    width: float


class Part(NamedTuple):
    """A connected thin part of the regions of one paint, in a box with a margin.

    names      regions
    share      (h, w) of the pixels
    thick      (h, w) where regions of this paint are thick
    box        rows and columns of the picture
    is_wide    whether some of it is too wide for a narrow part
    """

    names: list[int]
    share: Floats
    thick: Bools
    box: Box
    is_wide: bool

    @property
    def corner(self) -> Floats:
        """Left and top of the box, in px."""
        return np.array([self.box[1].start, self.box[0].start])


def take_lines(
    regions: Regions, weight_at: Weights, unit: float, rate: float, letter_ground: Ints,
    poll: Callable[[], None],
) -> list[Line]:  # fmt: skip
    """Return the lines of a picture, and give their shares to what lies beside or under them.

    letter_ground  (h, w) region below and beside letters, -1 elsewhere. It is no line there
    poll  function that is called for each part. An exception ends the search
    """
    parts = _thin_parts(regions, letter_ground)
    lines, gone = list[Line](), list[Part]()
    largest, is_gone = regions.largest, np.zeros(regions.labels.shape, bool)
    taken = np.full(is_gone.shape, -1)
    # If a wide part has lines, the narrow parts in it are these lines.
    parts.sort(key=lambda part: (not part.is_wide, -part.share.sum()))
    for part in parts[:MOST_PARTS]:
        name, own = part.names[0], part.share > 0.5
        if not part.is_wide and (taken[part.box][own] == name).any():
            continue
        poll()
        part, strokes = _chosen(regions.pixels, part, regions.paints[name], weight_at, unit, rate)
        if strokes:
            own = part.share > 0.5
            lines += [Line(name, *stroke) for stroke in strokes]
            gone.append(part)
            taken[part.box][own] = name
            is_gone[part.box] |= part.share > 0
    for part in gone:
        # The region that lies under a line is within 8 px of it.
        box = arrays.widened(part.box, 5, is_gone.shape)
        near = largest[box]
        is_left_out = is_gone[box] | np.isin(near, part.names)
        if not is_left_out.all():
            _, nearest = arrays.distance_to(~is_left_out)
            near = near[tuple(nearest)]
        ys, xs = arrays.pixels_of(part.share > 0, part.box)
        _release(regions, (ys, xs), part.names, near[ys - box[0].start, xs - box[1].start])
    return lines


def _thin_parts(regions: Regions, letter_ground: Ints) -> list[Part]:
    """Return the thin parts of regions that have one colour, narrow ones and wide ones.

    The ground between letters is no part, and neither is the transparent page, which no line draws.
    """
    classes: dict[Paint, list[int]] = {}
    for k, paint in enumerate(regions.paints):
        if not (paint.is_shaded or opacity_of(paint.color) < LEAST_OPACITY):
            classes.setdefault(paint, []).append(k)
    kind, parts = np.zeros(len(regions.paints) + 1, np.int32), list[Part]()  # the last is no region
    for k, names in enumerate(classes.values(), 1):
        kind[names] = k
    boxes = ndimage.find_objects(np.moveaxis(kind[regions.label], 2, 0), len(classes))
    for names, tight in zip(classes.values(), boxes, strict=True):
        if tight is None:
            continue
        box = arrays.widened(tight[1:], MARGIN, regions.labels.shape)
        share = regions.share_of(np.array(names), box)
        is_ground = np.isin(letter_ground[box], names)
        thick, found = _thick(share, 2.4), list[Part]()
        if thick.any():
            wide = _thick(share, WIDE) | is_ground
            found += [
                part
                for part in parts_between(share, wide, names, is_wide=True)
                if (thick[part.box] & (part.share > SEEN)).any()
            ]
        found += parts_between(share, thick | is_ground, names)
        parts += [part._replace(box=arrays.within(part.box, box)) for part in found]
    return parts


def parts_between(
    share: Floats, thick: Bools, names: Sequence[int] = (), is_wide: bool = False
) -> list[Part]:
    """Return the connected parts of the share (h, w) of regions that are not thick.

    Their boxes have margins of 3 px.
    """
    thin = np.where(thick, 0, share)
    label, boxes = parts_of(thin > SEEN)
    parts = []
    for q, tight in enumerate(boxes, 1):
        box = arrays.widened(tight, 3, share.shape)
        own = np.where(label[box] == q, thin[box], 0)
        # A sliver along a thick part is its rim.
        if own.sum() >= LEAST_SHARE and own[dilated(thick[box], 2)].sum() < 0.6 * own.sum():
            parts.append(Part([*names], own, thick[box], box, is_wide))
    return parts


def _thick(share: Floats, radius: float) -> Bools:
    """Return where discs of a radius lie within the share (h, w) of regions.

    If the radius is WIDE, discs where lines cross are left out.
    """
    side = np.arange(-int(radius), int(radius) + 1)
    disc, margin = portable.hypot(side, side[:, None]) < radius, len(side)
    solid = np.pad(share > 0.5, margin, mode="edge")
    opened: Any = ndimage.binary_opening(solid, disc)
    part, boxes = parts_of(opened)
    for q, box in enumerate(boxes if radius == WIDE else (), 1):
        wide = arrays.widened(box, 4, solid.shape)
        own = part[wide] == q
        inner: Any = ndimage.distance_transform_edt(np.pad(solid[wide], 1))
        inner = inner[1:-1, 1:-1]
        most, width = inner[own].max(), 2 * inner[dilated(own, 3) & ~own].max(initial=0) - 1
        # Larger discs are areas that meet.
        if most <= 0.85 * width + 0.5 and own.sum() <= 8 * most**2:
            opened[wide][own] = False
    return dilated(opened)[margin:-margin, margin:-margin]


def _chosen(
    pixels: Floats, part: Part, paint: Paint, weight_at: Weights, unit: float, rate: float
) -> tuple[Part, list[tuple[Path, float]]]:
    """Return what strokes draw of a part, and these strokes.

    Outlines draw the rest, where strokes are far off, or all if they are closer for their bytes.
    Then there are no strokes.
    """
    strokes = strokes_of(part, weight_at, unit, rate)
    values = pixels[part.box]
    around = dilated(part.share > SEEN, 2) & (part.share <= 0.02)
    if strokes:
        part, strokes = _without_bad(part, strokes)
    if not strokes:
        return part, []
    ground = np.median(values[around], axis=0) if around.any() else values.mean(axis=(0, 1))
    contrast = float(((paint.color - ground) ** 2).sum())
    length = sum(path.length for path, _ in strokes)

    def bytes_of(layers: list[Layer]) -> float:
        return sum(path.bytes(unit) for layer in layers for path in layer.paths)

    def fitted_and_cost(layers: list[Layer]) -> tuple[list[Layer], float]:
        """Return layers that are refined a little, in the box of the part, and their error."""
        drawing = _drawing(layers, part)
        drawing.refine(6, colors=False)
        error = (drawing.draw()[..., 0] - part.share)[~part.thick]
        layers = [
            layer.replace([path.moved(part.corner) for path in layer.paths])
            for layer in drawing.current()
        ]
        return layers, contrast * float((error**2).sum())

    # The tags have 12 and 10 bytes, as far as parts do not share them.
    as_lines = _layers(strokes)
    lines, cost = fitted_and_cost(as_lines)
    cost += rate * (12.0 + bytes_of(as_lines))
    # Wide ends may be round, which is decided when all lines are known.
    with_round = _error(list(map(rounded, lines)), part)
    cost -= contrast * max(_error(lines, part) - with_round, 0.0)
    noise = contrast * 0.008 * length  # antialiasing of few levels causes it
    cost = max(cost - noise, 0.0)
    if part.is_wide and cost > noise:
        return part, []
    contours = outlines.contours_of(part.share, part.box, pixels.shape)
    paths = [outlines.first_path(c, weight_at, unit, rate) for c in contours]
    as_areas = [Layer(0, paths)] if paths else []
    # Outlines may be closer only because they follow the errors of antialiasing. Wide parts, such
    # as bars, are more often no lines.
    factor, size_cost = 1.0 if part.is_wide else 2.0, rate * (10.0 + bytes_of(as_areas))
    if cost >= factor * size_cost and cost >= factor * (size_cost + fitted_and_cost(as_areas)[1]):
        return part, []
    return part, [(path, layer.width) for layer in lines for path in layer.paths]


def _layers(strokes: list[tuple[Path, float]]) -> list[Layer]:
    """Return a layer for each width of strokes."""
    widths = dict.fromkeys(w for _, w in strokes)
    return [Layer(0, [path for path, one in strokes if one == w], w) for w in widths]


def _without_bad(
    part: Part, strokes: list[tuple[Path, float]]
) -> tuple[Part, list[tuple[Path, float]]]:
    """Return a part and its strokes without those that are far off, and without their pixels."""
    h, w = part.share.shape
    nearest, place = np.zeros((h, w), np.int32), np.zeros((h, w), bool)
    for k, (path, _) in enumerate(strokes):
        count = np.ceil(2 * outlines.lengths_of(path.segments)).astype(np.int64)
        points = outlines.sampled(path.segments, path.curved, np.maximum(count, 1))
        x, y = np.clip((points - part.corner).T, 0, np.array([[w - 1], [h - 1]])).astype(int)
        nearest[y, x], place[y, x] = k, True
    nearest = nearest[tuple(arrays.distance_to(place)[1])]
    drawing = _drawing(_layers(strokes), part)
    error = ((drawing.draw() - drawing.pixels) ** 2)[..., 0]
    error = np.bincount(nearest.ravel(), error.ravel(), len(strokes))
    good = error <= MOST_OFF * np.array([path.length for path, _ in strokes])
    share = np.where(good[nearest], part.share, 0)
    return part._replace(share=share), [strokes[k] for k in np.flatnonzero(good)]


def strokes_of(
    part: Part, weight_at: Weights, unit: float, rate: float, widest: float = WIDEST
) -> list[tuple[Path, float]]:
    """Return the paths and widths in px of strokes along a thin part, or none if it is no line."""
    seen = part.share[part.share > 0.05]
    level = min(0.35, 0.4 * float(np.percentile(seen, 85)))
    chains = chains_of(part.share > level, part.share)
    lines = [chain.points if chain.closed else _extended(chain, part) for chain in chains]
    length = sum(portable.hypot(*np.diff(points, axis=0).T).sum() for points in lines)
    width = part.share.sum() / max(length, 1e-9)
    if width > widest or length < max(LEAST_SHARE, 2.5 * width):
        return []
    strokes = []
    for chain, points in zip(chains, lines, strict=True):
        if chain.width >= 1.2 * widest:
            continue
        points = outlines.resampled(points, STEP, chain.closed) + part.corner
        corners = outlines.turns_of(points, np.radians(38), chain.closed)
        points, corners = outlines.with_corners(points, corners, chain.closed, cut=5)
        path = outlines.fitted_path(points, corners, weight_at, unit, rate, chain.closed)
        strokes.append((path, chain.width))
    return strokes


def _extended(chain: Chain, part: Part) -> Floats:
    """Return a polyline whose free ends reach to the end of the share, or under a thick part."""
    points = chain.points
    h, w = part.thick.shape
    for is_free in chain.is_free:
        points = points[::-1]  # so that the end in question is the last one, and then the other
        if not is_free:
            continue
        arm = min(2 + round(chain.width), len(points) - 1)
        way = points[-1] - points[-1 - arm]
        way = way / max(portable.hypot(*way), 1e-9)
        ahead = np.arange(0.0, chain.width + 2.5, 0.25)
        across = chain.width * np.array([-0.25, 0.0, 0.25])
        at = points[-1] + ahead[:, None, None] * way + across[:, None] * (way[1], -way[0])
        share = ndimage.map_coordinates(part.share, [at[..., 1] - 0.5, at[..., 0] - 0.5], order=1)
        share = np.minimum.accumulate(share.mean(axis=1) / max(share[0].mean(), 1e-6))
        x, y = points[-1] + 2 * way
        is_thick = part.thick[int(np.clip(y, 0, h - 1)), int(np.clip(x, 0, w - 1))]
        reach = 2.0 if is_thick else float(share.sum() * 0.25 - 0.125)
        points = np.vstack([points, points[-1] + max(reach, 0.1) * way])
    return points


def _drawing(layers: list[Layer], part: Part) -> Drawing:
    """Return a drawing of a part's share.

    Where the same colour is thick, what the layers draw does not matter.
    """
    moved = [layer.replace([p.moved(-part.corner) for p in layer.paths]) for layer in layers]
    target = part.share[..., None].astype(np.float32)
    drawing = Drawing(target, Paint(np.zeros(1)), [Paint(np.ones(1))], moved, False)
    drawing.pixels = np.where(part.thick[..., None], drawing.draw(), target)
    return drawing


def _error(layers: list[Layer], part: Part) -> float:
    """Return the squared error of layers as they are."""
    drawing = _drawing(layers, part)
    return float(((drawing.draw() - drawing.pixels) ** 2).sum())


def _release(regions: Regions, at: tuple[Ints, Ints], names: list[int], under: Ints) -> None:
    """Give the shares of regions at pixels (n,) to the others there, or to those `under` them."""
    label, share = regions.label[at], regions.share[at]
    own = np.isin(label, names)
    share[own], label[own] = 0, -1
    total = share.sum(axis=1)
    none = total < 0.02  # others do not take all of a pixel if they had so little of it
    share /= np.maximum(total, 1e-6)[:, None]
    label[none], share[none] = -1, 0
    label[none, 0], share[none, 0] = under[none], 1
    regions.label[at], regions.share[at] = label, share


def grouped(lines: list[Line], paints: list[Paint]) -> list[Layer]:
    """Return a layer for lines of one colour and nearly one width, with their mean width.

    The width of a shorter line is less exact.
    """
    layers = list[Layer]()
    known: dict[Paint, list[tuple[float, Layer]]] = {}  # layers with the length of their lines
    for line in sorted(lines, key=lambda line: -line.path.length):
        length = line.path.length
        alike = known.setdefault(paints[line.region], [])
        for k, (total, layer) in enumerate(alike):
            most = 0.05 + 0.02 * layer.width + 1.5 / max(length, 1.0)
            if abs(line.width - layer.width) < most:
                layer.paths.append(line.path)
                layer.width += (line.width - layer.width) * length / (total + length)
                alike[k] = total + length, layer
                break
        else:
            layers.append(Layer(line.region, [line.path], line.width))
            alike.append((length, layers[-1]))
    return layers


class Piece(NamedTuple):
    """A level or upright segment of a line in at most two rows, or columns, of pixels.

    line    index of the line
    length  in px
    share   share of it that its stronger row has
    ground  (c,) colour beside it
    total   (c,) sum of the contrasts of its rows
    """

    line: int
    length: float
    share: float
    ground: Floats
    total: Floats

    @property
    def color(self) -> Floats:
        """The colour (c,) that the line has if it is 1 px wide."""
        return self.ground + self.total


def with_sure_widths(regions: Regions, lines: list[Line]) -> list[Line]:
    """Return lines, of which those in two rows of pixels have their likely colours and widths.

    New colours are added to the paints of the regions.
    """
    paints = regions.paints
    pieces, sure = list[Piece](), list[Line]()
    for k, line in enumerate(lines):
        own, length = _pieces_of(regions.pixels, k, line.path), line.path.length
        if sum(piece.length for piece in own) >= 0.8 * length:
            pieces += own
        elif line.width > 1.4 and length >= 16:
            sure.append(line)  # it has pixels of its colour
    inside = np.unique(inside_of(regions.cores, PURE))
    pure = [paints[k].color for k in inside[inside >= 0]]
    pure += [paints[line.region].color for line in sure]
    pens = list[list[Piece]]()  # pieces that have one colour if they are 1 px wide
    for piece in pieces:
        # If it has the colour of an area, it may be wider than 1 px, and stays.
        line = lines[piece.line]
        color = paints[line.region].color
        is_other = np.abs(color - piece.color).max() > SAME_COLOR
        if line.width > 1 and is_other and _is_in(color, pure):
            continue
        near = (pen for pen in pens if np.abs(piece.color - pen[0].color).max() <= SAME_PEN)
        if (pen := next(near, None)) is None:
            pens.append(pen := [])
        pen.append(piece)
    result = lines.copy()
    for pen in pens:
        alike = next((line for line in sure if _draws(line, paints[line.region].color, pen)), None)
        if alike is not None:
            region, width = alike.region, alike.width
        elif _is_thin(pen, pure):
            color = np.average([one.color for one in pen], 0, [one.length for one in pen])
            region, width = _region_of(color, paints), 1.0
        else:
            continue
        for one in pen:
            result[one.line] = Line(region, lines[one.line].path, width)
    return result


def _pieces_of(pixels: Floats, index: int, path: Path) -> list[Piece]:
    """Return the segments of a line that are in at most two rows, or columns, on one ground.

    They are at least 4 px long, at most 1.5 px across, and end 1 px before ends, which may bend.
    """
    pieces = []
    for points in path.segments:
        low, high = points.min(axis=0), points.max(axis=0)
        axis = int(high[1] - low[1] > high[0] - low[0])
        first, last = round(low[axis] + 1), round(high[axis] - 1)
        top = int(np.floor((low + high)[1 - axis] / 2 - 0.5)) - 2
        picture = pixels if axis == 0 else pixels.swapaxes(0, 1)
        length, across = (high - low)[axis], (high - low)[1 - axis]
        if across > 1.5 or length < 4 or top < 0 or top + 6 > len(picture):
            continue
        rows = picture[top : top + 6, max(first, 0) : last].astype(np.float64)
        ground = np.median(rows[0], axis=0)
        has_ground = np.abs(rows[[0, -1]] - ground).max(axis=(0, 2)) <= EVEN
        if not has_ground.any():
            continue
        off = np.median(rows[:, has_ground], axis=1) - ground
        is_even = np.abs(rows - ground - off[:, None]).max(axis=(0, 2)) <= EVEN
        total = off.sum(axis=0)
        share = portable.product(off, total) / max(portable.dot(total, total), 1e-9)
        if (
            is_even.mean() >= 0.4
            and np.abs(np.sort(share)[:-2]).max() <= 0.04  # the other rows are empty
            and np.abs(off - share[:, None] * total).max() <= EVEN
        ):
            pieces.append(Piece(index, length, share.max(), ground, total))
    return pieces


def _draws(line: Line, color: Floats, pen: list[Piece]) -> bool:
    """Return whether the width and the colour of a line explain all pieces of a pen."""
    off = [line.width * (color - one.ground) - one.total for one in pen]
    return bool(np.abs(off).max() <= SAME_PEN)


def _is_in(color: Floats, others: list[Floats]) -> bool:
    """Return whether a colour is nearly one of some others."""
    return any(np.abs(color - one).max() <= SAME_COLOR for one in others)


def _is_thin(pen: list[Piece], pure: list[Floats]) -> bool:
    """Return whether the lines of a pen are 1 px wide.

    pure  colours of areas and wide lines
    """
    color = np.mean([one.color for one in pen], axis=0)
    over_black, over_white = color[:3], color[-3:]
    lowest = min(over_black.min(), (over_white - over_black).min())
    # A colour may leave its range a little, because it was rounded.
    is_color = lowest >= -1.5 * LEVEL and over_white.max() <= 1 + 1.5 * LEVEL
    if not is_color or sum(one.length for one in pen) < 16:
        return False
    has_two_grounds = np.abs([one.ground - pen[0].ground for one in pen]).max() > SAME_COLOR
    strongest = max(pen, key=lambda one: one.share)
    # A line of 2 px has equal rows. Without such evidence, faint lines are thin.
    is_faint = 0.5 * np.abs(strongest.total).max() <= 0.3
    is_known = _is_in(color, [*pure, 0 * color, 0 * color + 1])
    return bool(has_two_grounds or strongest.share > 0.55 or is_faint or is_known)


def _region_of(color: Floats, paints: list[Paint]) -> int:
    """Return the name of a region of nearly this colour. If there is none, add its paint."""
    color = np.clip(color, 0, 1)
    off = [np.inf if one.is_shaded else np.abs(one.color - color).max() for one in paints]
    if min(off) > SAME_COLOR:
        off.append(0.0)
        paints.append(Paint(color))
    return int(np.argmin(off))
