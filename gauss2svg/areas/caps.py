"""Ends of lines: butt or round, whichever is closer to the picture."""

from __future__ import annotations

import dataclasses

import numpy as np

from gauss2svg.areas.kernels import Bools
from gauss2svg.areas.outlines import Path
from gauss2svg.areas.refine import Drawing, Layer

# A round end covers as much as a butt end that is longer by this share of the width: pi / 8.
ROUND_LENGTH = 0.39
BYTES_OF_ROUND = 44.0  # size of the attributes that make ends and joins round
NEAR = 1.5  # px beyond the width in which the errors of an end are counted


def with_caps(drawing: Drawing, rate: float) -> list[Layer]:
    """Return the layers of a drawing, with round ends for the lines to which these are closer."""
    layers = drawing.current()
    rounded = [_rounded(layer) for layer in layers]
    if all(a is b for a, b in zip(layers, rounded, strict=True)):
        return layers
    before = ((drawing.draw() - drawing.pixels) ** 2).sum(axis=-1)
    after = ((drawing.with_layers(rounded).draw() - drawing.pixels) ** 2).sum(axis=-1)
    chosen = []
    for layer, other in zip(layers, rounded, strict=True):
        gain = 0.0
        if other is not layer:
            at = _near_ends(layer, drawing.shape)
            gain = float((before - after)[at].sum()) - rate * BYTES_OF_ROUND
        chosen.append(other if gain > 0 else layer)
    return chosen


def _rounded(layer: Layer) -> Layer:
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


def _near_ends(layer: Layer, shape: tuple[int, ...]) -> Bools:
    """Return the pixels (h, w) near the ends of a line."""
    mask = np.zeros(shape[:2], bool)
    reach = layer.width + NEAR
    for path in layer.paths:
        for x, y in () if path.closed else (path.segments[0, 0], path.segments[-1, 3]):
            low = np.maximum(np.floor([y - reach, x - reach]).astype(int), 0)
            high = np.maximum(np.ceil([y + reach, x + reach]).astype(int), 0)
            mask[low[0] : high[0], low[1] : high[1]] = True
    return mask
