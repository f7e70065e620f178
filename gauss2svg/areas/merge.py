"""Fewer nodes: neighbouring segments become one where that costs little of what shows."""

from __future__ import annotations

import numpy as np

from gauss2svg.areas.curves import merge_pieces
from gauss2svg.areas.outlines import BEYOND, HIDDEN, Path, path_bytes
from gauss2svg.areas.refine import Drawing, Layer

SAMPLES = 2.5  # points for each px of a segment
# Nodes may move by this share of the distance by which outlines seem to be off.
NOISE_SHARE = 0.7
BYTES_OF_AREA, BYTES_OF_LINE = 20.0, 50.0  # of the tag of a layer
MOST_LAYERS = 300  # because a photo would have thousands


def merged(drawing: Drawing, unit: float, rate: float) -> list[Layer]:
    """Return the layers of a drawing with fewer nodes, given the squared error that a byte saves."""
    if not drawing.layers:
        return []
    drawing.draw()
    drawing.weigh()
    h, w, _ = drawing.shape
    noise = NOISE_SHARE**2 * drawing.noise + 1e-8
    layers = []
    for l, layer in enumerate(drawing.current()):
        contrast = (drawing.part(drawing.weight, l) ** 2).sum(axis=-1)
        contrast = np.maximum(contrast * (2 if layer.width else 1), HIDDEN)
        x, y, across, down = drawing.box[l]
        paths = []
        for path in layer.paths:
            points, start, weight = [], [0], []
            for p, is_curve in zip(path.segments, path.curved, strict=True):
                length = np.hypot(*np.diff(p, axis=0).T).sum()
                count = max(int(length * SAMPLES), 5)
                t = (np.arange(count) / count)[:, None]
                u = 1 - t
                if is_curve:
                    at = u**3 * p[0] + 3 * u * u * t * p[1] + 3 * u * t * t * p[2] + t**3 * p[3]
                else:
                    at = u * p[0] + t * p[3]
                points.append(at)
                weight.append(np.full(count, length / count))
                start.append(start[-1] + count)
            if not path.closed:
                points.append(path.segments[-1:, 3])
                weight.append(weight[-1][-1:])
            at, length = np.concatenate(points), np.concatenate(weight)
            column = np.clip(np.floor(at[:, 0]).astype(int) - x, 0, across - 1)
            row = np.clip(np.floor(at[:, 1]).astype(int) - y, 0, down - 1)
            beyond = (at < 0).any(axis=1) | (at > [w, h]).any(axis=1)
            value = np.where(beyond, BEYOND, contrast[row, column]) * length
            segment, curved = path.segments.copy(), path.curved.copy()
            count = merge_pieces(
                at, value, np.array(start), path.closed, segment, curved, True, unit, rate, noise
            )
            if path.closed and count == 2 and not curved[:2].any():
                continue
            paths.append(Path(segment[:count], curved[:count], path.closed))
        if paths:
            layers.append(layer.replace(paths))
    return layers


def without_cheap(drawing: Drawing, unit: float, rate: float) -> list[Layer]:
    """Return the layers that lower the squared error by at least `rate` for each of their bytes.

    At most MOST_LAYERS are kept, those that lower it most.
    """
    if not drawing.layers:
        return []
    error = drawing.draw() - drawing.pixels
    below = drawing.below.copy()
    drawing.weigh()
    layers = drawing.current()
    gains = np.zeros(len(layers))
    for l, layer in enumerate(layers):
        own, shows = error[drawing.slices(l)], drawing.part(drawing.visible, l)[..., None]
        without = own - (drawing.color_in_box(l) - drawing.part(below, l)) * shows
        size = BYTES_OF_LINE if layer.width else BYTES_OF_AREA
        size += sum(path_bytes(path, unit) for path in layer.paths)
        gains[l] = (without**2).sum() - (own**2).sum() - rate * size
    least = max(0.0, np.sort(gains)[-min(MOST_LAYERS, len(gains))])
    return [layer for layer, gain in zip(layers, gains, strict=True) if gain >= least]
