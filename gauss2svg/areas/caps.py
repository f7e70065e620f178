"""Ends of lines: butt or round, whichever is closer to the picture."""

from __future__ import annotations

import dataclasses

import numpy as np

from gauss2svg.areas.kernels import Bools, Floats
from gauss2svg.areas.merge import BYTES_OF_LINE
from gauss2svg.areas.outlines import Path
from gauss2svg.areas.refine import Drawing, Layer

# A round end covers as much as a butt end that is longer by this share of the width: pi / 8.
ROUND_LENGTH = 0.39
BYTES_OF_ROUND = 44.0  # size of the attributes that make ends and joins round
NEAR = 1.5  # px beyond the width in which the errors of an end are counted


def with_caps(drawing: Drawing, rate: float) -> list[Layer]:
    """Return the layers of a drawing, with round ends for the lines to which these are closer."""
    layers = drawing.current()
    others = [rounded(layer) for layer in layers]
    if all(a is b for a, b in zip(layers, others, strict=True)):
        return layers
    before = ((drawing.draw() - drawing.pixels) ** 2).sum(axis=-1)
    after = ((drawing.with_layers(others).draw() - drawing.pixels) ** 2).sum(axis=-1)
    chosen = list[Layer]()
    for layer, other in zip(layers, others, strict=True):
        if other is layer:
            chosen.append(layer)
            continue
        gains = np.array([_gain(before - after, path, layer.width) for path in layer.paths])
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
        if np.hypot(*way) < 1e-6:
            way = p[3] - p[0]
        length = np.hypot(*(p[3] - p[0]))
        if length > 2 * by:
            p[0] += way / np.hypot(*way) * by
            if not is_curve:
                p[1] = p[0]
    return path._replace(segments=segments)


def _near_ends(path: Path, width: float, shape: tuple[int, ...]) -> Bools:
    """Return the pixels (h, w) near the ends of a line."""
    mask = np.zeros(shape, bool)
    reach = width + NEAR
    for x, y in path.segments[0, 0], path.segments[-1, 3]:
        low = np.maximum(np.floor([y - reach, x - reach]).astype(int), 0)
        high = np.maximum(np.ceil([y + reach, x + reach]).astype(int), 0)
        mask[low[0] : high[0], low[1] : high[1]] = True
    return mask
