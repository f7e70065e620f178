"""Fewer nodes and layers, where that costs little of what shows, and the ends of lines."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gauss2svg import portable
from gauss2svg.areas import outlines
from gauss2svg.areas.arrays import Floats
from gauss2svg.areas.outlines import Path, Weights
from gauss2svg.areas.refine import Drawing, Layer

# Sizes of tags and attributes in bytes: of a layer, and of ends and joins that are round
BYTES_OF_AREA, BYTES_OF_LINE, BYTES_OF_ROUND = 20.0, 50.0, 44.0
BEND_RAD = np.radians(30)  # least fall of the sum of all turns without a kink
SHORT_PX = 3.0  # most length of the shorter segment beside a kink
CUSP_RAD, NO_CUSP_RAD = np.radians(160), np.radians(140)  # turns at a node that became a cusp
MOST_RISE = 0.03  # largest rise of the squared error around a kink that is left out


def merged(drawing: Drawing, unit: float, rate: float) -> list[Layer]:
    """Return the layers of a drawing with fewer nodes.

    unit  user unit of path data in px
    rate  squared error that a byte must save
    """
    if not drawing.layers:
        return []
    drawing.draw()
    drawing.weigh()
    # Nodes may move by .4 of the distance by which outlines seem to be off.
    noise = 0.4**2 * drawing.noise + 1e-8
    layers = []
    for index, layer in enumerate(drawing.current()):
        contrast = (drawing.part(drawing.weight, index) ** 2).sum(axis=-1)
        contrast = drawing.focused(contrast, drawing.slices(index))
        if layer.is_line:
            contrast *= 2  # it has two sides
        left, top = drawing.box[index, :2]
        weight_at = outlines.weights_by(contrast, left, top, drawing.shape)
        paths = [_merged_path(path, weight_at, unit, rate, noise) for path in layer.paths]
        # Two lines to a point and back draw nothing.
        paths = [p for p in paths if not p.closed or len(p.curved) > 2 or p.curved.any()]
        if paths:
            layers.append(layer.replace(paths))
    return layers


def _merged_path(path: Path, weight_at: Weights, unit: float, rate: float, noise: float) -> Path:
    """Return a path with fewer nodes. `noise` is the mean squared distance by which it is off."""
    length = outlines.lengths_of(path.segments)
    count = np.maximum((length * 2.5).astype(np.int64), 5)  # points along each segment
    start = np.append(0, np.cumsum(count))
    points = outlines.sampled(path.segments, path.curved, count)
    step = np.repeat(length / count, count)
    if not path.closed:
        points, step = np.vstack([points, path.segments[-1, 3]]), np.append(step, step[-1])
    weight = weight_at(points) * step
    return outlines.merged_path(points, weight, start, path, path.closed, unit, rate, noise)


def without_cheap(drawing: Drawing, unit: float, rate: float) -> list[Layer]:
    """Return the layers and lines that lower the squared error by `rate` for each of their bytes.

    At most 2000 are kept, those that lower it most, because a photo would have thousands.
    """
    if not drawing.layers:
        return []
    error = drawing.draw() - drawing.pixels
    cover = drawing.cover.copy()
    drawing.weigh()
    layers, gains = list[Layer](), list[float]()
    for index, layer in enumerate(drawing.current()):
        box, weight = drawing.slices(index), drawing.part(drawing.weight, index)
        own = error[box]
        without = own - weight * drawing.part(cover, index)[..., None]
        saved = drawing.focused((without**2 - own**2).sum(axis=-1), box)
        size = BYTES_OF_AREA
        if layer.is_line:
            size, corner = BYTES_OF_LINE, drawing.box[index, :2]
            sums = [
                float(saved[_around(path.segments.reshape(-1, 2) - corner, 1)].sum())
                for path in layer.paths
            ]
            pairs = zip(layer.paths, sums, strict=True)
            layer = layer.replace([path for path, sum_ in pairs if sum_ > rate * path.bytes(unit)])
        size += sum(path.bytes(unit) for path in layer.paths)
        layers.append(layer)
        gains.append(float(saved.sum()) - rate * size if layer.paths else -math.inf)
    least = max(0.0, np.sort(gains)[-min(2000, len(gains))])
    return [layer for layer, gain in zip(layers, gains, strict=True) if gain >= least]


def _around(points: Floats, by: float) -> tuple[slice, slice]:
    """Return the rows and columns of an image that are at most `by` px around points (n, 2)."""
    left, top = np.maximum(np.floor(points.min(axis=0) - by).astype(int), 0)
    right, bottom = np.maximum(np.ceil(points.max(axis=0) + by).astype(int), 0)
    return slice(top, bottom), slice(left, right)


def with_caps(drawing: Drawing, rate: float) -> list[Layer]:
    """Return the layers of a drawing, with round ends for the lines to which these are closer.

    The corners of such a line are round too. No line gets square ends, because butt ends that are
    farther out cover the same pixels.
    """
    layers = drawing.current()
    others = [rounded(layer) for layer in layers]
    saved = drawing.focused(_errors(drawing) - _errors(drawing.with_layers(others)))

    def gain_of(path: Path, width: float) -> float:
        """Return by how much the squared error falls near the ends and corners of a line."""
        near = np.zeros(saved.shape, bool)
        for place in () if path.closed else [*path.segments[:, :1], path.segments[-1:, 3]]:
            near[_around(place, width + 1.5)] = True
        return float(saved[near].sum())

    chosen = list[Layer]()
    for layer, other in zip(layers, others, strict=True):
        if other is layer:
            chosen.append(layer)
            continue
        gains = np.array([gain_of(path, layer.width) for path in layer.paths])
        is_round = gains > 0
        if gains[is_round].sum() <= rate * (BYTES_OF_ROUND + BYTES_OF_LINE * (not is_round.all())):
            is_round[:] = False
        for one, kept in ((layer, ~is_round), (other, is_round)):
            if kept.any():
                chosen.append(one.replace([one.paths[k] for k in np.flatnonzero(kept)]))
    return chosen


def rounded(layer: Layer) -> Layer:
    """Return a line with round ends, or the layer itself if it has no ends.

    A round end covers as much as a butt end that is longer by pi / 8 of the width.
    """
    if layer.width == 0 or layer.cap or all(path.closed for path in layer.paths):
        return layer
    paths = [path if path.closed else _shortened(path, 0.39 * layer.width) for path in layer.paths]
    return dataclasses.replace(layer, paths=paths, cap=1)


def _shortened(path: Path, by: float) -> Path:
    """Return an open path whose ends are `by` px further in, if it is long enough."""
    segments = path.segments.copy()
    for p, is_curve in ((segments[0], path.curved[0]), (segments[-1, ::-1], path.curved[-1])):
        way = p[1 if is_curve else 3] - p[0]
        if portable.hypot(*way) < 1e-6:
            way = p[3] - p[0]
        if portable.hypot(*(p[3] - p[0])) > 2 * by:
            p[0] += way / portable.hypot(*way) * by
            if not is_curve:
                p[1] = p[0]
    return path._replace(segments=segments)


def without_cusps(layers: list[Layer], earlier: list[Layer]) -> list[Layer] | None:
    """Return layers in which paths that got cusps are as they were before they were refined.

    At a cusp, an outline turns back. Small letters have them as spikes, where their first outlines
    cross themselves. Return None if no path got one.
    """
    result, has_cusps = list[Layer](), False
    for layer, old_layer in zip(layers, earlier, strict=True):
        paths = []
        for path, old in zip(layer.paths, old_layer.paths, strict=True):
            turns, old_turns = (outlines.angles_of(*_ways(one)) for one in (path, old))
            is_cusped = path.closed and ((turns > CUSP_RAD) & (old_turns < NO_CUSP_RAD)).any()
            has_cusps |= bool(is_cusped)
            paths.append(old if is_cusped else path)
        result.append(layer.replace(paths))
    return result if has_cusps else None


def _ways(path: Path) -> tuple[Floats, Floats]:
    """Return the directions (k, 2) in which a closed path reaches its nodes and leaves them."""
    segments, curved = path.segments, path.curved[:, None]
    starts = np.where(curved, segments[:, 1], segments[:, 3]) - segments[:, 0]
    ends = segments[:, 3] - np.where(curved, segments[:, 2], segments[:, 0])
    return np.roll(ends, 1, axis=0), starts


class Kink(NamedTuple):
    """A kink of a path: its segment, the curve (4, 2) in place of both beside it, and its place."""

    segment: int
    curve: Floats
    place: Floats


def without_kinks(drawing: Drawing) -> list[Layer]:
    """Return the layers of a drawing without needless kinks.

    A kink is a node beside a short curve, without which an outline turns less. All of them are
    replaced by curves without a node and the outlines are refined. What is then as close stays so.
    """
    layers = drawing.current()
    kinks = [[kinks_of(path) for path in layer.paths] for layer in layers]
    if not any(map(any, kinks)):
        return layers

    def without(is_needless: Callable[[Kink], bool]) -> list[Layer]:
        return [
            layer.replace(
                [_without(*one, is_needless) for one in zip(layer.paths, own, strict=True)]
            )
            for layer, own in zip(layers, kinks, strict=True)
        ]

    before = _errors(drawing)
    trial = drawing.with_layers(without(lambda kink: True))
    trial.refine(8, colors=False)
    rise = drawing.focused(_errors(trial) - before)
    return without(lambda kink: float(rise[_around(kink.place[None], 3)].sum()) <= MOST_RISE)


def _errors(drawing: Drawing) -> Floats:
    """Return the squared errors (h, w) of a drawing as it is now."""
    return ((drawing.draw() - drawing.pixels) ** 2).sum(axis=-1)


def kinks_of(path: Path) -> list[Kink]:
    """Return the kinks of a closed path, of which no two touch. An open path has none."""
    if not path.closed:
        return []
    segments, curved, count = path.segments, path.curved, len(path.curved)
    ends, starts = _ways(path)
    length = portable.hypot(*(segments[:, 3] - segments[:, 0]).T)
    is_short = np.minimum(length, np.roll(length, 1)) <= SHORT_PX
    found = list[tuple[float, Kink]]()
    for k in np.flatnonzero(is_short & (curved | np.roll(curved, 1))):
        pair = [k - 1, k]
        points = outlines.sampled(segments[pair], curved[pair], np.full(2, 24))
        points = np.vstack([points, segments[k, 3]])
        curve = outlines.fitted_curve(points)
        new = outlines.sampled(curve[None], np.ones(1, bool), np.full(1, 24))
        new = np.vstack([new, curve[3]])
        around = ends[k - 1], starts[(k + 1) % count]
        bend = _bend(points, *around) - _bend(new, *around)
        if bend > BEND_RAD:
            found.append((bend, Kink(int(k), curve, segments[k, 0])))
    kinks, beside = list[Kink](), set[int]()
    for _, kink in sorted(found, key=lambda one: -one[0])[: count - 2]:  # a path needs two segments
        if kink.segment not in beside:
            kinks.append(kink)
            beside |= {(kink.segment + step) % count for step in (-1, 0, 1)}
    return kinks


def _bend(points: Floats, before: Floats, after: Floats) -> float:
    """Return the sum of the turns along points (n, 2) from one direction (2,) to another one."""
    steps = np.vstack([before, np.diff(points, axis=0), after])
    return float(outlines.angles_of(steps[:-1], steps[1:]).sum())


def _without(path: Path, kinks: list[Kink], is_needless: Callable[[Kink], bool]) -> Path:
    """Return a path with one curve for the two segments beside each of the needless kinks."""
    if not (kinks := list(filter(is_needless, kinks))):
        return path
    segments, curved = path.segments.copy(), path.curved.copy()
    at = np.array([kink.segment for kink in kinks])
    segments[at] = [kink.curve for kink in kinks]
    curved[at] = True
    left = np.ones(len(curved), bool)
    left[at - 1] = False
    return path._replace(segments=segments[left], curved=curved[left])
