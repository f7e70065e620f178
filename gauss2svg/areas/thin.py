"""Thin parts: pixels that the regions around them do not explain, and parts that are lines.

Thin parts have few pixels of pure colour. So they take a colour that is pure elsewhere, if one
explains them, and they become strokes along their middle, if strokes are closer for their bytes
than outlines.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage
from skimage.morphology import skeletonize

from gauss2svg.areas.centrelines import centred, chains_of, width_along
from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.areas.masks import LEVEL, Box, dilated, distance_to, parts_of, pixels_of, widened
from gauss2svg.areas.outlines import (
    Path,
    Weights,
    contours_of,
    first_path,
    fitted_path,
    resampled,
    turns_of,
)
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.areas.regions import FAR, Palette, Shares

UNEXPLAINED = 0.0015  # squared error of a pixel that is not explained
LEAST_PIXELS, LEAST_ERROR = 3, 0.02  # px and squared error of a part that gets its own colour
LEAST_GAIN = 1e-4  # squared error of a pixel by which a new colour must be better to be taken
MOST_COUNTED = 0.02  # a pixel's squared error counts at most this, because outliers do not decide
EXPLAINED = 0.6  # a colour must lower the error of a part to this share of it
ROUNDS = 3
PRICE_OF_COLOR = 1e-4  # squared error for each pixel by which a new colour must be better
# Photos have thousands of parts. The strongest parts, and the colours nearest to a part, decide.
MOST_PARTS, MOST_COLORS = 1000, 24
SAME_COLOR = 6 * LEVEL  # largest difference of a thin part's colour from one that it takes
THICK = 2.4  # px; a disc of this radius fits into no thin part
WIDEST = 3.6  # px; the largest width of a line
SEEN = 0.12  # least share of a pixel in a part
MARGIN = 3  # px of a part's box around it
UNDER = 8  # px around a line within which the region that lies under it is looked for
LEAST_LEFT = 0.02  # share of a pixel below which other regions do not take the share of a line
LEAST_SHARE, LEAST_LENGTH = 4.0, 2.5  # px^2 of a part, and length of a line in widths
ALIKE_WIDTHS, ALIKE_SHARE = 0.15, 0.05  # px, and share of a width, by which equal widths differ
POINT_STEP = 0.6  # px between points of a centreline
TURN_RAD = np.radians(38)  # least turn at a corner of a centreline
COMPARED_STEPS = 6  # steps of refinement before a stroke and outlines of a part are compared
BYTES_OF_LINE, BYTES_OF_AREA = 12.0, 10.0  # size of tags, as far as parts do not share them
# Outlines may be closer than a stroke only because they follow the errors of antialiasing. So they
# must cost less by this factor.
LINE_PRIOR = 2.0


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
        for q in np.argsort(-power)[:MOST_PARTS]:
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
            label, share, error = palette.explain(
                pixels, labels, at, FAR, FAR, -1.0, paint.color, name
            )
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
    values = pixels[at][np.argsort(-error)]
    count = len(error)

    def cost(color: Floats) -> float:
        error = palette.explain(pixels, labels, at, FAR, FAR, -1.0, color, len(paints))[2]
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
    for k in range(regions, len(paints)):
        for paint in paints[:k]:
            if not paint.is_shaded and np.abs(paint.color - paints[k].color).max() <= SAME_COLOR:
                paints[k] = paint
                break


class Part(NamedTuple):
    """A connected thin part of the regions of one paint, in a box with a margin.

    names      regions
    share      (h, w) of the pixels
    thick      (h, w) where regions of this paint are thick
    box        rows and columns of the picture
    """

    names: list[int]
    share: Floats
    thick: Bools
    box: Box

    @property
    def corner(self) -> Floats:
        """Left and top of the box, in px."""
        return np.array([self.box[1].start, self.box[0].start])


def take_lines(
    pixels: Floats, shares: Shares, paints: list[Paint], weight_at: Weights, unit: float,
    rate: float, letter_ground: Ints,
) -> list[Line]:  # fmt: skip
    """Return the lines of a picture, and give their shares to what lies beside or under them.

    letter_ground  (h, w) region below and beside letters, -1 elsewhere. It is no line there
    """
    parts = thin_parts(shares, paints, letter_ground)
    lines, gone = list[Line](), list[Part]()
    for part in sorted(parts, key=lambda part: -part.share.sum())[:MOST_PARTS]:
        strokes = _chosen(pixels, part, paints[part.names[0]], weight_at, unit, rate)
        if strokes:
            lines += [Line(part.names[0], *stroke) for stroke in strokes]
            gone.append(part)
    largest, is_gone = shares.largest, np.zeros(pixels.shape[:2], bool)
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
    """Return the thin parts of regions that have one colour.

    The ground between letters is no part.
    """
    disc = np.hypot(*np.mgrid[-2:3, -2:3]) < THICK
    classes: dict[Paint, list[int]] = {}
    for k, paint in enumerate(paints):
        if not paint.is_shaded:
            classes.setdefault(paint, []).append(k)
    parts = []
    for names in classes.values():
        share = shares.of(np.array(names))
        opened: Any = ndimage.binary_opening(np.pad(share > 0.5, 3, mode="edge"), disc)[3:-3, 3:-3]
        thick = dilated(opened)
        thin = np.where(thick | np.isin(letter_ground, names), 0, share)
        label, boxes = parts_of(thin > SEEN)
        for q, tight in enumerate(boxes, 1):
            box = widened(tight, MARGIN, share.shape)
            own = np.where(label[box] == q, thin[box], 0)
            if own.sum() >= LEAST_SHARE:
                parts.append(Part(names, own, thick[box], box))
    return parts


def _chosen(
    pixels: Floats, part: Part, paint: Paint, weight_at: Weights, unit: float, rate: float
) -> list[tuple[Path, float]]:
    """Return the strokes of a part, or none if its outlines are closer for their bytes."""
    strokes = _strokes(part, weight_at, unit, rate)
    if not strokes:
        return []
    values = pixels[part.box]
    around = dilated(part.share > SEEN, 2) & (part.share <= 0.02)
    ground = np.median(values[around], axis=0) if around.any() else values.mean(axis=(0, 1))
    contrast = float(((paint.color - ground) ** 2).sum())
    widths = dict.fromkeys(width for _, width in strokes)
    as_lines = [Layer(0, [path for path, w in strokes if w == width], width) for width in widths]
    contours = contours_of(part.share, part.box, pixels.shape)
    outlines = [first_path(contour, weight_at, unit, rate) for contour in contours]
    as_areas = [Layer(0, outlines)] if outlines else []

    def fitted_and_cost(layers: list[Layer], tag: float) -> tuple[Drawing, float]:
        drawing, error = _fitted(layers, part)
        size = tag + sum(path.bytes(unit) for layer in layers for path in layer.paths)
        return drawing, contrast * error + rate * size

    lines, cost = fitted_and_cost(as_lines, BYTES_OF_LINE)
    if cost >= LINE_PRIOR * fitted_and_cost(as_areas, BYTES_OF_AREA)[1]:
        return []
    return [
        (path.moved(part.corner), layer.width) for layer in lines.current() for path in layer.paths
    ]


def _strokes(part: Part, weight_at: Weights, unit: float, rate: float) -> list[tuple[Path, float]]:
    """Return the paths and widths of strokes along a thin part, or none if it is no line."""
    seen = part.share[part.share > 0.05]
    level = min(0.35, 0.4 * float(np.percentile(seen, 85)))
    chains = chains_of(skeletonize(part.share > level), part.share)
    length = sum(np.hypot(*np.diff(chain, axis=0).T).sum() + 0.7 for chain in chains)
    width = part.share.sum() / max(length, 1e-9)
    if width > WIDEST or length < max(LEAST_SHARE, LEAST_LENGTH * width):
        return []
    strokes = []
    for chain in chains:
        is_loop = len(chain) > 6 and bool((chain[0] == chain[-1]).all())
        points = centred(chain[:-1] if is_loop else chain, part.share, is_loop)
        wide = width_along(points, part.share, is_loop)
        if wide >= 1.2 * WIDEST:
            continue
        if not is_loop:
            points = _extended(points, part.thick)
        points = resampled(points, POINT_STEP, is_loop) + part.corner
        corners = turns_of(points, TURN_RAD, is_loop)
        strokes.append((fitted_path(points, corners, weight_at, unit, rate, is_loop), wide))
    return strokes


def _extended(points: Floats, thick: Bools) -> Floats:
    """Return a polyline whose ends reach to the end of the share, or under a thick part."""
    points = points.copy()
    h, w = thick.shape
    for end, inner in ((0, min(3, len(points) - 1)), (-1, max(len(points) - 4, 0))):
        way = points[end] - points[inner]
        way = way / max(np.hypot(*way), 1e-9)
        x, y = points[end] + 2 * way
        is_thick = thick[int(np.clip(y, 0, h - 1)), int(np.clip(x, 0, w - 1))]
        points[end] += (2.0 if is_thick else 0.4) * way
    return points


def _fitted(layers: list[Layer], part: Part) -> tuple[Drawing, float]:
    """Return a drawing of a part's share, refined a little, and its squared error.

    Where the same colour is thick, what the layers draw does not matter.
    """
    moved = [layer.replace([p.moved(-part.corner) for p in layer.paths]) for layer in layers]
    target, is_open = part.share[..., None].astype(np.float32), ~part.thick[..., None]
    drawing = Drawing(target, Paint(np.zeros(1)), [Paint(np.ones(1))], moved, False)
    drawing.pixels = np.where(is_open, target, drawing.draw())
    drawing.refine(COMPARED_STEPS, colors=False)
    return drawing, float(((drawing.draw() - target)[is_open] ** 2).sum())


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
    """Return a layer for lines of one colour and nearly one width, with their mean width."""
    groups: list[list[Line]] = []
    for line in sorted(lines, key=lambda line: -len(line.path.curved)):
        for group in groups:
            mean = _mean_width(group)
            is_same = paints[group[0].region] is paints[line.region]
            if is_same and abs(line.width - mean) < ALIKE_WIDTHS + ALIKE_SHARE * mean:
                group.append(line)
                break
        else:
            groups.append([line])
    return [
        Layer(group[0].region, [line.path for line in group], _mean_width(group))
        for group in groups
    ]


def _mean_width(lines: list[Line]) -> float:
    """Return the mean width of lines, weighted by their numbers of segments."""
    sizes = [len(line.path.curved) for line in lines]
    return float(np.average([line.width for line in lines], weights=sizes))
