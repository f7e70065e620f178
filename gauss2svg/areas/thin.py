"""Thin parts: pixels that the regions around them do not explain, and parts that are lines.

Thin parts have few pixels of pure colour. So they take a colour that is pure elsewhere, if one
explains them, and they become strokes along their middle, if strokes are closer for their bytes
than outlines.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from gauss2svg import portable
from gauss2svg.areas.junctions import Chain, chains_of
from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.areas.letters import SAME_COLOR, UNEXPLAINED
from gauss2svg.areas.masks import Box, dilated, distance_to, parts_of, pixels_of, widened
from gauss2svg.areas.merge import rounded
from gauss2svg.areas.outlines import (
    Path,
    Weights,
    contours_of,
    first_path,
    fitted_path,
    lengths_of,
    resampled,
    turns_of,
    with_corners,
)
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.areas.regions import Palette, Shares

LEAST_PIXELS, LEAST_ERROR = 3, 0.02  # px and squared error of a part that gets its own colour
LEAST_GAIN = 1e-4  # squared error of a pixel by which a new colour must be better to be taken
MOST_COUNTED = 0.02  # a pixel's squared error counts at most this, because outliers do not decide
EXPLAINED = 0.6  # a colour must lower the error of a part to this share of it
ROUNDS = 3
PRICE_OF_COLOR = 1e-4  # squared error for each pixel by which a new colour must be better
# Photos have thousands of parts. The strongest parts, and the colours nearest to a part, decide.
MOST_PARTS, MOST_COLORS = 1000, 24
# Px. A disc of radius THICK fits into no narrow part. One of radius WIDE fits into a wide part only
# where lines cross.
THICK, WIDE = 2.4, 3.2
# Largest radius of a disc where lines cross, in their widths, and the largest area of a crossing,
# in squares of this radius
CROSSING, CROSSING_AREA = 0.85, 8.0
WIDEST = 5.6  # px; the largest width of a line
SEEN = 0.12  # least share of a pixel in a part
MARGIN = 3  # px of a part's box around it
UNDER = 8  # px around a line within which the region that lies under it is looked for
LEAST_LEFT = 0.02  # share of a pixel below which other regions do not take the share of a line
LEAST_SHARE, LEAST_LENGTH = 4.0, 2.5  # px^2 of a part, and length of a line in widths
# Px, share of a width, and px^2 divided by the length, by which equal widths differ
ALIKE_WIDTHS, ALIKE_SHARE, ALIKE_ENDS = 0.05, 0.02, 1.5
POINT_STEP = 0.6  # px between points of a centreline
TURN_RAD = np.radians(38)  # least turn at a corner of a centreline
ROUNDED = 5  # points before and after a corner of a centreline by which it has been rounded
COMPARED_STEPS = 6  # steps of refinement before a stroke and outlines of a part are compared
BYTES_OF_LINE, BYTES_OF_AREA = 12.0, 10.0  # size of tags, as far as parts do not share them
# Outlines may be closer than a stroke only because they follow the errors of antialiasing. So they
# must cost less by this factor. Wide parts, such as bars, are more often no lines.
LINE_PRIOR, WIDE_PRIOR = 2.0, 1.0
NO_LINE = 0.5  # squared error for a px of strokes above which these are not even refined
NOISE_OF_LINE = 0.008  # squared error for a px of a stroke, which antialiasing of few levels causes


class Line(NamedTuple):
    """A stroke of a region's paint."""

    region: int
    path: Path
    width: float


def add_thin_regions(
    pixels: Floats, cores: Ints, labels: Ints, shares: Shares, paints: list[Paint], palette: Palette
) -> None:
    """Give parts that nothing explains a colour. `shares` and `paints` are changed.

    The strongest part comes first, because its colour may explain the weaker ones.
    """
    regions = len(paints)
    for _ in range(ROUNDS):
        part, boxes = parts_of(shares.error > UNEXPLAINED)
        before = len(paints)
        power = ndimage.sum_labels(shares.error, part, np.arange(1, len(boxes) + 1))
        for q in np.argsort(-power, kind="stable")[:MOST_PARTS]:
            at = pixels_of(part[boxes[q]] == q + 1, boxes[q])
            old = shares.error[at]
            if len(old) < LEAST_PIXELS or old.sum() < LEAST_ERROR:
                continue
            paint, cost = _paint_of_part(pixels, labels, at, old, paints, palette)
            if cost > EXPLAINED * np.minimum(old, MOST_COUNTED).sum():
                continue
            name = len(paints)
            paints.append(paint)
            box = widened(boxes[q], 2, labels.shape)
            grown_part = dilated(part[box] == q + 1) & (cores[box] < 0)
            at = pixels_of(grown_part, box)
            label, share, error = palette.explain(pixels, labels, at, paint.color, name)
            better = (error < shares.error[at] - LEAST_GAIN) & (label == name).any(axis=1)
            at = at[0][better], at[1][better]
            shares.label[at], shares.share[at] = label[better], share[better]
            shares.error[at] = error[better]
        if len(paints) == before:
            break
    _share_paints(paints, regions)


def _paint_of_part(
    pixels: Floats, labels: Ints, at: tuple[Ints, Ints], error: Floats, paints: list[Paint],
    palette: Palette,
) -> tuple[Paint, float]:  # fmt: skip
    """Return the paint that explains the pixels of a part best, and its cost.

    error  (n,) squared error of the pixels without it
    """
    values = pixels[at][np.argsort(-error, kind="stable")]
    count = len(error)

    def cost(color: Floats) -> float:
        error = palette.explain(pixels, labels, at, color, len(paints))[2]
        return float(np.minimum(error, MOST_COUNTED).sum())

    # The pixels that are explained worst may have the pure colour.
    shares = (values[:n] for n in (1, max(3, count // 20), max(3, count // 8)))
    colors = [np.median(some, axis=0) for some in shares]
    known = list(dict.fromkeys(paint for paint in paints if not paint.is_shaded))
    known.sort(key=lambda paint: np.abs(paint.color - colors[0]).max())
    tried = [(Paint(c), cost(c) + PRICE_OF_COLOR * count) for c in colors]
    tried += [(paint, cost(paint.color)) for paint in known[:MOST_COLORS]]
    return min(tried, key=lambda one: one[1])


def _share_paints(paints: list[Paint], regions: int) -> None:
    """Let thin regions have the paint of an earlier region of nearly their colour."""
    colors = np.array([paint.color for paint in paints])
    colors[[paint.is_shaded for paint in paints]] = np.inf
    for k in range(regions, len(paints)):
        alike = np.abs(colors[:k] - colors[k]).max(axis=1, initial=0) <= SAME_COLOR
        if alike.any():
            paints[k] = paints[int(alike.argmax())]
            colors[k] = paints[k].color


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
    pixels: Floats, shares: Shares, paints: list[Paint], weight_at: Weights, unit: float,
    rate: float, letter_ground: Ints, poll: Callable[[], None],
) -> list[Line]:  # fmt: skip
    """Return the lines of a picture, and give their shares to what lies beside or under them.

    letter_ground  (h, w) region below and beside letters, -1 elsewhere. It is no line there
    poll  function that is called for each part. An exception ends the search
    """
    parts = thin_parts(shares, paints, letter_ground)
    lines, gone = list[Line](), list[Part]()
    largest, is_gone = shares.largest, np.zeros(pixels.shape[:2], bool)
    taken = np.full(is_gone.shape, -1)
    # If a wide part has lines, the narrow parts in it are these lines.
    parts.sort(key=lambda part: (not part.is_wide, -part.share.sum()))
    for part in parts[:MOST_PARTS]:
        name, own = part.names[0], part.share > 0.5
        if not part.is_wide and (taken[part.box][own] == name).any():
            continue
        poll()
        strokes = _chosen(pixels, part, paints[name], weight_at, unit, rate)
        if strokes:
            lines += [Line(name, *stroke) for stroke in strokes]
            gone.append(part)
            taken[part.box][own] = name
    for part in gone:
        is_gone[part.box] |= part.share > 0
    for part in gone:
        box = widened(part.box, UNDER - MARGIN, is_gone.shape)
        near = largest[box]
        is_left_out = is_gone[box] | np.isin(near, part.names)
        if not is_left_out.all():
            _, nearest = distance_to(~is_left_out)
            near = near[tuple(nearest)]
        ys, xs = pixels_of(part.share > 0, part.box)
        _release(shares, (ys, xs), part.names, near[ys - box[0].start, xs - box[1].start])
    return lines


def thin_parts(shares: Shares, paints: list[Paint], letter_ground: Ints) -> list[Part]:
    """Return the thin parts of regions that have one colour, narrow ones and wide ones.

    The ground between letters is no part.
    """
    classes: dict[Paint, list[int]] = {}
    for k, paint in enumerate(paints):
        if not paint.is_shaded:
            classes.setdefault(paint, []).append(k)
    parts = []
    for names in classes.values():
        share = shares.of(np.array(names))
        is_ground = np.isin(letter_ground, names)
        thick = _thick(share, THICK)
        if thick.any():
            wide = _thick(share, WIDE) | is_ground
            parts += [
                part
                for part in parts_between(share, wide, names, is_wide=True)
                if (thick[part.box] & (part.share > SEEN)).any()
            ]
        parts += parts_between(share, thick | is_ground, names)
    return parts


def parts_between(
    share: Floats, thick: Bools, names: Sequence[int] = (), is_wide: bool = False
) -> list[Part]:
    """Return the connected parts of the share (h, w) of regions that are not thick."""
    thin = np.where(thick, 0, share)
    label, boxes = parts_of(thin > SEEN)
    parts = []
    for q, tight in enumerate(boxes, 1):
        box = widened(tight, MARGIN, share.shape)
        own = np.where(label[box] == q, thin[box], 0)
        if own.sum() >= LEAST_SHARE:
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
    if radius == WIDE:
        opened = _without_crossings(solid, opened)
    return dilated(opened)[margin:-margin, margin:-margin]


def _without_crossings(solid: Bools, thick: Bools) -> Bools:
    """Return the thick parts (h, w) of a mask without those in which lines of it cross."""
    part, boxes = parts_of(thick)
    if not boxes:
        return thick
    thick = thick.copy()
    for q, box in enumerate(boxes, 1):
        wide = widened(box, 4, solid.shape)
        own = part[wide] == q
        radius: Any = ndimage.distance_transform_edt(np.pad(solid[wide], 1))
        radius = radius[1:-1, 1:-1]
        most = radius[own].max()
        around = dilated(own, 3) & ~own
        width = 2 * radius[around].max(initial=0) - 1
        if most <= CROSSING * width + 0.5 and own.sum() <= CROSSING_AREA * most**2:
            thick[wide][own] = False
    return thick


def _chosen(
    pixels: Floats, part: Part, paint: Paint, weight_at: Weights, unit: float, rate: float
) -> list[tuple[Path, float]]:
    """Return the strokes of a part, or none if its outlines are closer for their bytes."""
    strokes = strokes_of(part, weight_at, unit, rate)
    if not strokes:
        return []
    values = pixels[part.box]
    around = dilated(part.share > SEEN, 2) & (part.share <= 0.02)
    ground = np.median(values[around], axis=0) if around.any() else values.mean(axis=(0, 1))
    contrast = float(((paint.color - ground) ** 2).sum())
    widths = dict.fromkeys(width for _, width in strokes)
    as_lines = [Layer(0, [path for path, w in strokes if w == width], width) for width in widths]
    length = float(sum(lengths_of(path.segments).sum() for path, _ in strokes))
    if _error(as_lines, part) > NO_LINE * length:
        return []
    contours = contours_of(part.share, part.box, pixels.shape)
    as_areas = [Layer(0, [first_path(c, weight_at, unit, rate) for c in contours])] * bool(contours)

    def fitted_and_cost(layers: list[Layer], tag: float) -> tuple[Drawing, float]:
        drawing, error = _fitted(layers, part)
        size = tag + sum(path.bytes(unit) for layer in layers for path in layer.paths)
        return drawing, contrast * error + rate * size

    lines, cost = fitted_and_cost(as_lines, BYTES_OF_LINE)
    # Wide ends may be round, which is decided when all lines are known.
    butt, with_round = (
        _error([one.replace([p.moved(part.corner) for p in one.paths]) for one in layers], part)
        for layers in (lines.current(), list(map(rounded, lines.current())))
    )
    cost -= contrast * max(butt - with_round, 0.0)
    noise = contrast * NOISE_OF_LINE * length
    cost = max(cost - noise, 0.0)
    if part.is_wide and cost > noise:
        return []
    prior = WIDE_PRIOR if part.is_wide else LINE_PRIOR
    if cost >= prior * fitted_and_cost(as_areas, BYTES_OF_AREA)[1]:
        return []
    return [
        (path.moved(part.corner), layer.width) for layer in lines.current() for path in layer.paths
    ]


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
    if width > widest or length < max(LEAST_SHARE, LEAST_LENGTH * width):
        return []
    strokes = []
    for chain, points in zip(chains, lines, strict=True):
        if chain.width >= 1.2 * widest:
            continue
        points = resampled(points, POINT_STEP, chain.closed) + part.corner
        corners = turns_of(points, TURN_RAD, chain.closed)
        points, corners = with_corners(points, corners, chain.closed, ROUNDED)
        path = fitted_path(points, corners, weight_at, unit, rate, chain.closed)
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


def _fitted(layers: list[Layer], part: Part) -> tuple[Drawing, float]:
    """Return a drawing of a part's share, refined a little, and its squared error."""
    drawing = _drawing(layers, part)
    drawing.refine(COMPARED_STEPS, colors=False)
    error = (drawing.draw()[..., 0] - part.share)[~part.thick]
    return drawing, float((error**2).sum())


def _error(layers: list[Layer], part: Part) -> float:
    """Return the squared error of layers as they are."""
    drawing = _drawing(layers, part)
    return float(((drawing.draw() - drawing.pixels) ** 2).sum())


def _release(shares: Shares, at: tuple[Ints, Ints], names: list[int], under: Ints) -> None:
    """Give the shares of regions at pixels (n,) to the others there, or to those `under` them."""
    label, share = shares.label[at], shares.share[at]
    own = np.isin(label, names)
    share[own], label[own] = 0, -1
    total = share.sum(axis=1)
    none = total < LEAST_LEFT
    share /= np.maximum(total, 1e-6)[:, None]
    label[none], share[none] = -1, 0
    label[none, 0], share[none, 0] = under[none], 1
    shares.label[at], shares.share[at] = label, share


def grouped(lines: list[Line], paints: list[Paint]) -> list[Layer]:
    """Return a layer for lines of one colour and nearly one width, with their mean width.

    The width of a shorter line is less exact.
    """
    layers = list[Layer]()
    known: dict[Paint, list[tuple[float, Layer]]] = {}  # layers with the length of their lines
    sized = [(float(lengths_of(line.path.segments).sum()), line) for line in lines]
    for length, line in sorted(sized, key=lambda one: -one[0]):
        alike = known.setdefault(paints[line.region], [])
        for k, (total, layer) in enumerate(alike):
            most = ALIKE_WIDTHS + ALIKE_SHARE * layer.width + ALIKE_ENDS / max(length, 1.0)
            if abs(line.width - layer.width) < most:
                layer.paths.append(line.path)
                layer.width += (line.width - layer.width) * length / (total + length)
                alike[k] = total + length, layer
                break
        else:
            layers.append(Layer(line.region, [line.path], line.width))
            alike.append((length, layers[-1]))
    return layers
