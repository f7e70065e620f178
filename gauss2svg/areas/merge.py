"""Fewer nodes: neighbouring segments become one where that costs little of what shows."""

from __future__ import annotations

import math

import numpy as np

from gauss2svg.areas.curves import merge_pieces, sample_path
from gauss2svg.areas.kernels import Floats, Ints
from gauss2svg.areas.outlines import Path, Weights, lengths_of, weights_by
from gauss2svg.areas.refine import Drawing, Layer

SAMPLES, LEAST_SAMPLES = 2.5, 5  # points for each px of a segment, and at least for a segment
# Nodes may move by this share of the distance by which outlines seem to be off.
NOISE_SHARE = 0.4
LEAST_NOISE = 1e-8  # px^2, so that no division is by 0
BYTES_OF_AREA, BYTES_OF_LINE = 20.0, 50.0  # size of the tag of a layer
MOST_LAYERS = 2000  # because a photo would have thousands


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
    points = np.empty((start[-1], 2))
    sample_path(path.segments, path.curved, count, points)
    step = np.repeat(length / count, count)
    if not path.closed:
        points, step = np.vstack([points, path.segments[-1, 3]]), np.append(step, step[-1])
    segment, curved = path.segments.copy(), path.curved.copy()
    left = merge_pieces(
        points, weight_at(points) * step, start, path.closed, segment, curved, True, unit, rate,
        noise,
    )  # fmt: skip
    return Path(segment[:left], curved[:left], path.closed)


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
        saved = (without**2 - own**2).sum(axis=-1)
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
