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
    contours_of,
    first_path,
    fitted_path,
    path_bytes,
    resampled,
)
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.regions import FAR, LEVEL, Palette, Shares, grown, widened
from gauss2svg.areas.refine import Drawing, Layer

Floats = NDArray[np.float64]
UNEXPLAINED = 0.0015  # squared error of a pixel that is not explained
LEAST_PIXELS, LEAST_ERROR = 3, 0.02  # of a part that gets a colour of its own
MOST_COUNTED = 0.02  # a pixel's squared error counts at most this, because outliers do not decide
EXPLAINED = 0.6  # a colour must lower the error of a part to this share of it
ROUNDS = 3
PRICE_OF_COLOR = 1e-4  # squared error for each pixel by which a new colour must be better
THICK = 2.4  # px; a disc of this radius fits into no thin part
WIDEST = 3.6  # px; the largest width of a line
SEEN = 0.12  # least share of a pixel in a part
LEAST_SHARE, LEAST_LENGTH = 4.0, 2.5  # px^2 of a line, and its length in widths
ALIKE_WIDTHS = 0.15  # px, and a twentieth of the width: lines of one colour become equally wide
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
        for q in np.argsort(-power):
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
    known = {id(p): p for p in paints if not p.is_shaded}

    def cost(color: Floats) -> float:
        error = palette.explain(pixels, labels, ys, xs, FAR, FAR, -1.0, color, name)[2]
        return float(np.minimum(error, MOST_COUNTED).sum())

    colors = values[order[0]], np.median(values[some], axis=0), np.median(values[more], axis=0)
    tried = [(cost(c) + PRICE_OF_COLOR * len(ys), Paint(c)) for c in colors]
    tried += [(cost(p.color), p) for p in known.values()]
    best, paint = min(tried, key=lambda one: one[0])
    return paint, best


def _share_paints(paints: list[Paint], regions: int, near: float = 6 * LEVEL) -> None:
    """Let thin regions have the paint of an earlier region of nearly their colour."""
    for k in range(regions, len(paints)):
        for paint in paints[:k]:
            if not paint.is_shaded and np.abs(paint.color - paints[k].color).max() <= near:
                paints[k] = paint
                break


def _strokes(share: Floats, left: int, top: int, widest: float, thick, weight_at, unit, rate):
    """Return the paths and widths of strokes along a thin part, or none if it is no line.

    share  (h, w) of the part; thick (height, width) where the same colour is thick
    """
    seen = share[share > 0.05]
    level = min(0.35, 0.4 * float(np.percentile(seen, 85))) if len(seen) else 1.0
    chains = chains_of(skeletonize(share > level), share)
    length = sum(np.hypot(*np.diff(chain, axis=0).T).sum() + 0.7 for chain in chains)
    width = share.sum() / max(length, 1e-9)
    if width > widest or length < max(LEAST_SHARE, LEAST_LENGTH * width):
        return []
    strokes = []
    for chain in chains:
        is_loop = len(chain) > 6 and bool((chain[0] == chain[-1]).all())
        points = centred(chain[:-1] if is_loop else chain, share, is_loop)
        wide = width_along(points, share, is_loop)
        if wide >= 1.2 * widest:
            continue
        points = points + [left, top]
        if not is_loop:
            points = _extended(points, thick)
        points = resampled(points, 0.6, is_loop)
        corners = _turns_of(points, is_loop)
        path = fitted_path(points, corners, weight_at, unit, rate, is_loop)
        strokes.append((path, wide))
    return strokes


def _extended(points: Floats, thick) -> Floats:
    """Return a polyline whose ends reach to the end of the share, or under a thick part."""
    points = points.copy()
    h, w = thick.shape
    for end, inner in ((0, min(3, len(points) - 1)), (-1, max(len(points) - 4, 0))):
        way = points[end] - points[inner]
        way = way / max(np.hypot(*way), 1e-9)
        x, y = points[end] + 2 * way
        is_thick = thick[int(np.clip(y, 0, h - 1)), int(np.clip(x, 0, w - 1))]
        points[end] = points[end] + (2.0 if is_thick else 0.4) * way
    return points


def _turns_of(points: Floats, closed: bool, arm: int = 5, least: float = np.radians(38)):
    """Return the indices of corners of a polyline whose points are about .6 px apart."""
    n = len(points)
    if n <= 2 * arm + 1:
        return np.arange(0)
    before, after = points - np.roll(points, arm, axis=0), np.roll(points, -arm, axis=0) - points
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    turn = np.abs(np.arctan2(cross, (before * after).sum(axis=1)))
    if not closed:
        turn[:arm] = turn[-arm:] = 0
    around = np.stack([np.roll(turn, k) for k in range(-arm, arm + 1)])
    corners = np.flatnonzero((turn >= least) & (turn == around.max(axis=0)))
    return corners[np.diff(corners, prepend=-n) > arm]


def take_lines(pixels, shares: Shares, paints, weight_at, unit, rate) -> list[Line]:
    """Return the lines of a picture, and give their shares to what lies beside or under them."""
    h, w, _ = pixels.shape
    lines = []
    disc = np.hypot(*np.mgrid[-2:3, -2:3]) < THICK
    classes: dict[int, list[int]] = {}
    for k, paint in enumerate(paints):
        if not paint.is_shaded:
            classes.setdefault(id(paint), []).append(k)
    gone = []
    for names in classes.values():
        share = shares.of(np.array(names))
        if share.sum() < 6:
            continue
        opened = ndimage.binary_opening(np.pad(share > 0.5, 3, mode="edge"), disc)[3:-3, 3:-3]
        thick = ndimage.binary_dilation(opened, _BLOCK)
        thin = np.where(thick, 0, share)
        parts, _ = ndimage.label(thin > SEEN, _BLOCK)
        for q, box in enumerate(ndimage.find_objects(parts)):
            part = np.where(parts[box] == q + 1, thin[box], 0)
            if part.sum() < LEAST_SHARE:
                continue
            left, top = box[1].start, box[0].start
            strokes = _chosen(
                pixels, part, left, top, WIDEST, thick, paints[names[0]], weight_at, unit, rate
            )
            if not strokes:
                continue
            lines += [Line(names[0], *stroke) for stroke in strokes]
            ys, xs = np.nonzero(part > 0)
            gone.append((ys + top, xs + left, names))
    is_gone = np.zeros((h, w), bool)
    for ys, xs, _ in gone:
        is_gone[ys, xs] = True
    largest = shares.largest
    for ys, xs, names in gone:
        others = is_gone | np.isin(largest, names)
        _release(shares, ys, xs, names, _nearest(largest, others, ys, xs))
    return lines


STEPS = 6  # of the refinement by which a stroke and outlines of one part are compared


def _chosen(pixels, part, left, top, widest, thick, paint, weight_at, unit, rate):
    """Return the strokes of a part, or none if its outlines are closer for their bytes."""
    strokes = _strokes(part, left, top, widest, thick, weight_at, unit, rate)
    if not strokes:
        return []
    h, w = part.shape
    seen = ndimage.binary_dilation(part > SEEN, _BLOCK, iterations=2)
    values = pixels[top : top + h, left : left + w]
    around = (part <= 0.02) & seen
    ground = np.median(values[around], axis=0) if around.any() else values.mean(axis=(0, 1))
    contrast = ((paint.color - ground) ** 2).sum()
    outlines = [
        first_path(c, weight_at, unit, rate) for c in contours_of(part, left, top, thick.shape)
    ]
    groups = {width: [path for path, other in strokes if other == width] for _, width in strokes}
    as_lines = [Layer(0, paths, width) for width, paths in groups.items()]
    as_areas = [Layer(0, [path]) for path in outlines]
    is_open = ~thick[top : top + h, left : left + w]
    costs = []
    for layers, more in ((as_lines, BYTES_OF_LINE), (as_areas, BYTES_OF_AREA)):
        drawing, error = _fitted(layers, part, is_open, left, top)
        size = sum(path_bytes(path, unit) for layer in layers for path in layer.paths) + more
        costs.append((contrast * error + rate * size, drawing))
    (line_cost, drawing), (area_cost, _) = costs
    if line_cost >= LINE_PRIOR * area_cost:
        return []
    offset = np.array([left - MARGIN, top - MARGIN])
    return [
        (path._replace(segments=path.segments + offset), layer.width)
        for layer in drawing.current()
        for path in layer.paths
    ]


MARGIN = 3
# Outlines may be closer than a stroke only because they follow the errors of antialiasing. So they
# must cost less by this factor.
LINE_PRIOR = 1.5
BYTES_OF_LINE, BYTES_OF_AREA = 12.0, 10.0  # of tags, as far as a part does not share them


def _fitted(layers: list[Layer], part: Floats, is_open, left: int, top: int):
    """Return a drawing of a part's share with these layers, and its squared error where it is open.

    Where the same colour is thick, what the layers draw does not matter.
    """
    offset = np.array([left - MARGIN, top - MARGIN])
    moved = [
        Layer(
            0, [path._replace(segments=path.segments - offset) for path in layer.paths], layer.width
        )
        for layer in layers
    ]
    target, mask = np.pad(part, MARGIN)[..., None], np.pad(is_open, MARGIN, constant_values=True)
    drawing = Drawing(target, Paint(np.zeros(1)), [Paint(np.ones(1))], moved, False)
    first = drawing.draw()
    drawing.pixels = np.where(mask[..., None], target, first)
    drawing.refine(STEPS, colors=False)
    return drawing, float((((drawing.draw() - target)[..., 0] ** 2)[mask]).sum())


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
