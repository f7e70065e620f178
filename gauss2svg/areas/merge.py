"""Fewer nodes and layers, where that costs little of what shows, and the ends of lines."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from gauss2svg import portable
from gauss2svg.areas.curves import merge_pieces, sampled
from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.areas.outlines import Path, Weights, lengths_of, weights_by
from gauss2svg.areas.refine import Drawing, Layer

SAMPLES, LEAST_SAMPLES = 2.5, 5  # points for each px of a segment, and at least for a segment
# Nodes may move by this share of the distance by which outlines seem to be off.
NOISE_SHARE = 0.4
LEAST_NOISE = 1e-8  # px^2, so that no division is by 0
BYTES_OF_AREA, BYTES_OF_LINE = 20.0, 50.0  # size of the tag of a layer
MOST_LAYERS = 2000  # because a photo would have thousands
# A round end covers as much as a butt end that is longer by this share of the width: pi / 8.
ROUND_LENGTH = 0.39
BYTES_OF_ROUND = 44.0  # size of the attributes that make ends and joins round
NEAR_END = 1.5  # px beyond the width in which the errors of an end are counted


def merged(drawing: Drawing, unit: float, rate: float) -> list[Layer]:
    """Return the layers of a drawing with fewer nodes.

    unit  user unit of path data in px
    rate  squared error that a byte must save
    """
    if not drawing.layers:
        return []
    drawing.draw()
    drawing.weigh()
    noise = NOISE_SHARE**2 * drawing.noise + LEAST_NOISE
    layers = []
    for index, layer in enumerate(drawing.current()):
        contrast = (drawing.part(drawing.weight, index) ** 2).sum(axis=-1)
        contrast = drawing.focused(contrast, index)
        if layer.is_line:
            contrast *= 2  # it has two sides
        left, top = drawing.box[index, :2]
        weight_at = weights_by(contrast, left, top, drawing.shape)
        paths = [_merged_path(path, weight_at, unit, rate, noise) for path in layer.paths]
        # Two lines to a point and back draw nothing.
        paths = [p for p in paths if not p.closed or len(p.curved) > 2 or p.curved.any()]
        if paths:
            layers.append(layer.replace(paths))
    return layers


def _merged_path(path: Path, weight_at: Weights, unit: float, rate: float, noise: float) -> Path:
    """Return a path with fewer nodes. `noise` is the mean squared distance by which it is off."""
    length = lengths_of(path.segments)
    count = np.maximum((length * SAMPLES).astype(np.int64), LEAST_SAMPLES)
    start = np.append(0, np.cumsum(count))
    points = sampled(path.segments, path.curved, count)
    step = np.repeat(length / count, count)
    if not path.closed:
        points, step = np.vstack([points, path.segments[-1, 3]]), np.append(step, step[-1])
    segments, curved = merge_pieces(
        points, weight_at(points) * step, start, path.closed, path.segments, path.curved, True,
        unit, rate, noise,
    )  # fmt: skip
    return Path(segments, curved, path.closed)


def without_cheap(drawing: Drawing, unit: float, rate: float) -> list[Layer]:
    """Return the layers and lines that lower the squared error by `rate` for each of their bytes.

    At most MOST_LAYERS are kept, those that lower it most.
    """
    if not drawing.layers:
        return []
    error = drawing.draw() - drawing.pixels
    cover = drawing.cover.copy()
    drawing.weigh()
    layers, gains = list[Layer](), list[float]()
    for index, layer in enumerate(drawing.current()):
        own, weight = error[drawing.slices(index)], drawing.part(drawing.weight, index)
        without = own - weight * drawing.part(cover, index)[..., None]
        saved = drawing.focused((without**2 - own**2).sum(axis=-1), index)
        if layer.is_line:
            near = (_sum_around(saved, path, drawing.box[index, :2]) for path in layer.paths)
            pairs = zip(layer.paths, near, strict=True)
            layer = layer.replace([path for path, sum_ in pairs if sum_ > rate * path.bytes(unit)])
        size = BYTES_OF_LINE if layer.is_line else BYTES_OF_AREA
        size += sum(path.bytes(unit) for path in layer.paths)
        layers.append(layer)
        gains.append(float(saved.sum()) - rate * size if layer.paths else -math.inf)
    least = max(0.0, np.sort(gains)[-min(MOST_LAYERS, len(gains))])
    return [layer for layer, gain in zip(layers, gains, strict=True) if gain >= least]


def _sum_around(values: Floats, path: Path, corner: Ints) -> float:
    """Return the sum of values (h, w) in the box of a path. `corner` is their left and top."""
    points = path.segments.reshape(-1, 2) - corner
    left, top = np.maximum(np.floor(points.min(axis=0)).astype(int) - 1, 0)
    right, bottom = np.maximum(np.ceil(points.max(axis=0)).astype(int) + 1, 0)
    return float(values[top:bottom, left:right].sum())


def with_caps(drawing: Drawing, rate: float) -> list[Layer]:
    """Return the layers of a drawing, with round ends for the lines to which these are closer."""
    layers = drawing.current()
    others = [rounded(layer) for layer in layers]
    if all(a is b for a, b in zip(layers, others, strict=True)):
        return layers
    before = ((drawing.draw() - drawing.pixels) ** 2).sum(axis=-1)
    after = ((drawing.with_layers(others).draw() - drawing.pixels) ** 2).sum(axis=-1)
    saved, chosen = drawing.focused(before - after), list[Layer]()
    for layer, other in zip(layers, others, strict=True):
        if other is layer:
            chosen.append(layer)
            continue
        gains = np.array([_gain(saved, path, layer.width) for path in layer.paths])
        is_round = gains > 0
        if not is_round.all():
            is_round &= gains[is_round].sum() > rate * (BYTES_OF_ROUND + BYTES_OF_LINE)
        elif gains.sum() <= rate * BYTES_OF_ROUND:
            is_round[:] = False
        if not is_round.any() or is_round.all():
            chosen.append(other if is_round.any() else layer)
        else:
            for one, kept in ((layer, ~is_round), (other, is_round)):
                chosen.append(one.replace([one.paths[k] for k in np.flatnonzero(kept)]))
    return chosen


def _gain(gain: Floats, path: Path, width: float) -> float:
    """Return by how much the squared error (h, w) falls near the ends of a line."""
    return 0.0 if path.closed else float(gain[_near_ends(path, width, gain.shape)].sum())


def rounded(layer: Layer) -> Layer:
    """Return a line with round ends, or the layer itself if it has no ends."""
    if layer.width == 0 or layer.cap or all(path.closed for path in layer.paths):
        return layer
    paths = [
        path if path.closed else _shortened(path, ROUND_LENGTH * layer.width)
        for path in layer.paths
    ]
    return dataclasses.replace(layer, paths=paths, cap=1)


def _shortened(path: Path, by: float) -> Path:
    """Return an open path whose ends are `by` px further in, if it is long enough."""
    segments = path.segments.copy()
    for p, is_curve in ((segments[0], path.curved[0]), (segments[-1, ::-1], path.curved[-1])):
        way = p[1 if is_curve else 3] - p[0]
        if portable.hypot(*way) < 1e-6:
            way = p[3] - p[0]
        length = portable.hypot(*(p[3] - p[0]))
        if length > 2 * by:
            p[0] += way / portable.hypot(*way) * by
            if not is_curve:
                p[1] = p[0]
    return path._replace(segments=segments)


def _near_ends(path: Path, width: float, shape: tuple[int, ...]) -> Bools:
    """Return the pixels (h, w) near the ends of a line."""
    mask = np.zeros(shape, bool)
    reach = width + NEAR_END
    for x, y in path.segments[0, 0], path.segments[-1, 3]:
        low = np.maximum(np.floor([y - reach, x - reach]).astype(int), 0)
        high = np.maximum(np.ceil([y + reach, x + reach]).astype(int), 0)
        mask[low[0] : high[0], low[1] : high[1]] = True
    return mask
