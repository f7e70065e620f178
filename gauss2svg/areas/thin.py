"""Thin parts: pixels that the regions around them do not explain, and parts that are lines.

Thin parts have few pixels of pure colour. So they take a colour that is pure elsewhere, if one
explains them, and they become strokes along their middle, if strokes are closer for their bytes
than outlines.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from skimage.morphology import skeletonize

from gauss2svg.areas.centrelines import centred, chains_of, width_along
from gauss2svg.areas.outlines import (
    Path,
    Weights,
    contours_of,
    first_path,
    fitted_path,
    resampled,
    turns_of,
)  # fmt: skip
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.areas.regions import FAR, LEVEL, Palette, Shares, widened

Floats = NDArray[np.float64]
UNEXPLAINED = 0.0015  # squared error of a pixel that is not explained
LEAST_PIXELS, LEAST_ERROR = 3, 0.02  # of a part that gets a colour of its own
MOST_COUNTED = 0.02  # a pixel's squared error counts at most this, because outliers do not decide
EXPLAINED = 0.6  # a colour must lower the error of a part to this share of it
ROUNDS = 3
PRICE_OF_COLOR = 1e-4  # squared error for each pixel by which a new colour must be better
# Photos have thousands of parts. The strongest parts, and the colours nearest to a part, decide.
MOST_PARTS, MOST_COLORS = 200, 24
SAME_COLOR = 6 * LEVEL  # largest difference of a thin part's colour from one that it takes
THICK = 2.4  # px; a disc of this radius fits into no thin part
WIDEST = 3.6  # px; the largest width of a line
SEEN = 0.12  # least share of a pixel in a part
MARGIN = 3  # px of a part's box around it
LEAST_SHARE, LEAST_LENGTH = 4.0, 2.5  # px^2 of a line, and its length in widths
ALIKE_WIDTHS = 0.15  # px, and a twentieth of the width: lines of one colour become equally wide
POINT_STEP = 0.6  # px between points of a centreline
TURN_RAD = np.radians(38)  # least turn at a corner of a centreline
COMPARED_STEPS = 6  # of the refinement by which a stroke and outlines of one part are compared
BYTES_OF_LINE, BYTES_OF_AREA = 12.0, 10.0  # of tags, as far as a part does not share them
# Outlines may be closer than a stroke only because they follow the errors of antialiasing. So they
# must cost less by this factor.
LINE_PRIOR = 1.1
_BLOCK = np.ones((3, 3), bool)


class Line(NamedTuple):
    """A stroke of a region's paint."""

    region: int
    path: Path
    width: float


def add_thin_regions(
    pixels, cores, labels, shares: Shares, paints: list[Paint], palette: Palette
) -> list[int]:
    """Give parts that nothing explains a colour. Change `shares` and `paints`; return new labels.

    The strongest part comes first, because its colour may explain the weaker ones.
    """
    new: list[int] = []
    regions = len(paints)
    for _ in range(ROUNDS):
        part, count = ndimage.label(shares.error > UNEXPLAINED, _BLOCK)
        if not count:
            break
        boxes = ndimage.find_objects(part)
        power = ndimage.sum_labels(shares.error, part, np.arange(1, count + 1))
        added = False
        for q in np.argsort(-power)[:MOST_PARTS]:
            ys, xs = np.nonzero(part[boxes[q]] == q + 1)
            ys, xs = ys + boxes[q][0].start, xs + boxes[q][1].start
            before = shares.error[ys, xs]
            if len(ys) < LEAST_PIXELS or before.sum() < LEAST_ERROR:
                continue
            paint, cost = _paint_of_part(
                pixels, labels, ys, xs, before, paints, palette, len(paints)
            )
            if cost > EXPLAINED * np.minimum(before, MOST_COUNTED).sum():
                continue
            name = len(paints)
            paints.append(paint)
            new.append(name)
            added = True
            box = widened(boxes[q], 2, labels.shape)
            grown_part = ndimage.binary_dilation(part[box] == q + 1, _BLOCK) & (cores[box] < 0)
            ys, xs = np.nonzero(grown_part)
            ys, xs = ys + box[0].start, xs + box[1].start
            label, share, error = palette.explain(
                pixels, labels, ys, xs, FAR, FAR, -1.0, paint.color, name
            )
            better = (error < shares.error[ys, xs] - 1e-4) & (label == name).any(axis=1)
            at = ys[better], xs[better]
            shares.label[at], shares.share[at] = label[better], share[better]
            shares.error[at] = error[better]
        if not added:
            break
    _share_paints(paints, regions)
    return new


def _paint_of_part(pixels, labels, ys, xs, before, paints, palette, name):
    """Return the paint that explains a part best, and its cost."""
    values = pixels[ys, xs]
    order = np.argsort(-before)
    some, more = order[: max(3, len(ys) // 20)], order[: max(3, len(ys) // 8)]
    known = list({id(p): p for p in paints if not p.is_shaded}.values())

    def cost(color: Floats) -> float:
        error = palette.explain(pixels, labels, ys, xs, FAR, FAR, -1.0, color, name)[2]
        return float(np.minimum(error, MOST_COUNTED).sum())

    colors = values[order[0]], np.median(values[some], axis=0), np.median(values[more], axis=0)
    tried = [(cost(c) + PRICE_OF_COLOR * len(ys), Paint(c)) for c in colors]
    known.sort(key=lambda p: np.abs(p.color - colors[0]).max())
    tried += [(cost(p.color), p) for p in known[:MOST_COLORS]]
    best, paint = min(tried, key=lambda one: one[0])
    return paint, best


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
    left, top  of the box, in px
    """

    names: list[int]
    share: Floats
    thick: NDArray[np.bool_]
    left: int
    top: int


def take_lines(
    pixels: Floats,
    shares: Shares,
    paints: list[Paint],
    weight_at: Weights,
    unit: float,
    rate: float,
) -> list[Line]:
    """Return the lines of a picture, and give their shares to what lies beside or under them."""
    parts = thin_parts(shares, paints)
    lines, gone = list[Line](), list[Part]()
    for part in sorted(parts, key=lambda part: -part.share.sum())[:MOST_PARTS]:
        strokes = _chosen(pixels, part, paints[part.names[0]], weight_at, unit, rate)
        if strokes:
            lines += [Line(part.names[0], *stroke) for stroke in strokes]
            gone.append(part)
    largest, is_gone = shares.largest, np.zeros(pixels.shape[:2], bool)
    places = []
    for part in gone:
        ys, xs = np.nonzero(part.share)
        places.append((ys + part.top, xs + part.left))
        is_gone[places[-1]] = True
    for part, (ys, xs) in zip(gone, places, strict=True):
        left_out = is_gone | np.isin(largest, part.names)
        _release(shares, ys, xs, part.names, _nearest(largest, left_out, ys, xs))
    return lines


def thin_parts(shares: Shares, paints: list[Paint]) -> list[Part]:
    """Return the thin parts of regions that have one colour."""
    disc = np.hypot(*np.mgrid[-2:3, -2:3]) < THICK
    classes: dict[int, list[int]] = {}
    for k, paint in enumerate(paints):
        if not paint.is_shaded:
            classes.setdefault(id(paint), []).append(k)
    parts = []
    for names in classes.values():
        share = shares.of(np.array(names))
        opened = ndimage.binary_opening(np.pad(share > 0.5, 3, mode="edge"), disc)[3:-3, 3:-3]
        thick = ndimage.binary_dilation(opened, _BLOCK)
        thin = np.where(thick, 0, share)
        label, _ = ndimage.label(thin > SEEN, _BLOCK)
        for q, found in enumerate(ndimage.find_objects(label)):
            box = widened(found, MARGIN, share.shape)
            own = np.where(label[box] == q + 1, thin[box], 0)
            if own.sum() >= LEAST_SHARE:
                parts.append(Part(names, own, thick[box], box[1].start, box[0].start))
    return parts


def _chosen(
    pixels: Floats, part: Part, paint: Paint, weight_at: Weights, unit: float, rate: float
) -> list[tuple[Path, float]]:
    """Return the strokes of a part, or none if its outlines are closer for their bytes."""
    strokes = _strokes(part, weight_at, unit, rate)
    if not strokes:
        return []
    h, w = part.share.shape
    values = pixels[part.top : part.top + h, part.left : part.left + w]
    around = ndimage.binary_dilation(part.share > SEEN, _BLOCK, iterations=2)
    around &= part.share <= 0.02
    ground = np.median(values[around], axis=0) if around.any() else values.mean(axis=(0, 1))
    contrast = float(((paint.color - ground) ** 2).sum())
    widths = dict.fromkeys(width for _, width in strokes)
    as_lines = [Layer(0, [path for path, w in strokes if w == width], width) for width in widths]
    contours = contours_of(part.share, part.left, part.top, pixels.shape[:2])
    as_areas = [Layer(0, [first_path(c, weight_at, unit, rate)]) for c in contours]
    line, line_error = _fitted(as_lines, part)
    _, area_error = _fitted(as_areas, part)
    line_cost, area_cost = (
        contrast * error + rate * (more + sum(p.bytes(unit) for one in layers for p in one.paths))
        for layers, error, more in (
            (as_lines, line_error, BYTES_OF_LINE), (as_areas, area_error, BYTES_OF_AREA)
        )
    )  # fmt: skip
    if line_cost >= LINE_PRIOR * area_cost:
        return []
    offset = np.array([part.left, part.top])
    return [
        (path._replace(segments=path.segments + offset), layer.width)
        for layer in line.current()
        for path in layer.paths
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
        points = resampled(points, POINT_STEP, is_loop) + [part.left, part.top]
        corners = turns_of(points, TURN_RAD, is_loop)
        strokes.append((fitted_path(points, corners, weight_at, unit, rate, is_loop), wide))
    return strokes


def _extended(points: Floats, thick: NDArray[np.bool_]) -> Floats:
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
    offset = np.array([part.left, part.top])
    moved = [
        layer.replace([path._replace(segments=path.segments - offset) for path in layer.paths])
        for layer in layers
    ]
    target, is_open = part.share[..., None].astype(np.float32), ~part.thick[..., None]
    drawing = Drawing(target, Paint(np.zeros(1)), [Paint(np.ones(1))], moved, False)
    drawing.pixels = np.where(is_open, target, drawing.draw())
    drawing.refine(COMPARED_STEPS, colors=False)
    return drawing, float(((drawing.draw() - target)[is_open] ** 2).sum())


def _nearest(labels, is_left_out, ys, xs):
    """Return the labels (n,) of the pixels nearest to these that are not left out."""
    box = widened((slice(ys.min(), ys.max() + 1), slice(xs.min(), xs.max() + 1)), 8, labels.shape)
    if is_left_out[box].all():
        return labels[ys, xs]
    rows, columns = ndimage.distance_transform_edt(
        is_left_out[box], return_distances=False, return_indices=True
    )
    at = ys - box[0].start, xs - box[1].start
    return labels[box][rows[at], columns[at]]


def _release(shares: Shares, ys, xs, names, under) -> None:
    """Give the shares of regions at pixels to the others there, or to those that lie under them."""
    label, share = shares.label[ys, xs], shares.share[ys, xs]
    own = np.isin(label, names)
    share[own], label[own] = 0, -1
    total = share.sum(axis=1)
    none = total < 0.02
    share /= np.maximum(total, 1e-6)[:, None]
    label[none], share[none] = -1, 0
    label[none, 0], share[none, 0] = under[none], 1
    shares.label[ys, xs], shares.share[ys, xs] = label, share


def grouped(lines: list[Line], paints, is_opaque) -> list[Layer]:
    """Return a layer for lines of one colour and nearly one width, with their mean width."""
    groups: list[tuple[int, list[Path], float, int]] = []
    for region, path, width in sorted(lines, key=lambda line: -len(line.path.curved)):
        for i, (other, paths, mean, weight) in enumerate(groups):
            is_same = paints[other] is paints[region]
            if is_same and abs(width - mean) < ALIKE_WIDTHS + 0.05 * mean:
                size = len(path.curved)
                mean = (mean * weight + width * size) / (weight + size)
                groups[i] = other, [*paths, path], mean, weight + size
                break
        else:
            groups.append((region, [path], width, len(path.curved)))
    return [Layer(k, paths, mean, is_opaque=bool(is_opaque[k])) for k, paths, mean, _ in groups]
