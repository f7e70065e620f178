"""Small kinks of outlines, which are seen when a picture is enlarged, and their removal."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gauss2svg import portable
from gauss2svg.areas.curves import fitted_curve, sampled
from gauss2svg.areas.kernels import Floats
from gauss2svg.areas.outlines import Path
from gauss2svg.areas.refine import Drawing, Layer

TURN_RAD = np.radians(25)  # least turn of a kink
SHORT = 3.0  # px, longest segment beside a kink
SAMPLES = 24  # points of each segment to which the curve in place of a kink is fitted
NEAR = 3.0  # px around a kink in which errors are compared
STEPS = 8  # steps of refinement before errors are compared
BEND_RAD = np.radians(30)  # least fall of the sum of all turns without a kink
ALLOWED = 0.03  # squared error by which the picture may be worse without a kink


class Kink(NamedTuple):
    """A kink of a path: its segment, the curve (4, 2) in place of both beside it, and its place."""

    segment: int
    curve: Floats
    place: Floats


def without_kinks(drawing: Drawing) -> list[Layer]:
    """Return the layers of a drawing without needless kinks.

    A kink is a node at which an outline turns, beside a short curve. All of them are replaced by
    curves without a node and the outlines are refined. What is then as close stays so.
    """
    layers = drawing.current()
    kinks = [[kinks_of(path) for path in layer.paths] for layer in layers]
    if not any(map(any, kinks)):
        return layers
    before = ((drawing.draw() - drawing.pixels) ** 2).sum(axis=-1)
    trial = drawing.with_layers(_all_without(layers, kinks))
    trial.refine(STEPS, colors=False)
    after = ((trial.draw() - drawing.pixels) ** 2).sum(axis=-1)
    rise = drawing.focused(after - before)
    needless = [
        [[kink for kink in one if _sum_near(rise, kink.place) <= ALLOWED] for one in of_layer]
        for of_layer in kinks
    ]
    return _all_without(layers, needless)


def _all_without(layers: list[Layer], kinks: list[list[list[Kink]]]) -> list[Layer]:
    """Return layers without some kinks of their paths."""
    return [
        layer.replace([_without(*pair) for pair in zip(layer.paths, of_layer, strict=True)])
        for layer, of_layer in zip(layers, kinks, strict=True)
    ]


def kinks_of(path: Path) -> list[Kink]:
    """Return the kinks of a closed path, of which no two touch. An open path has none."""
    if not path.closed:
        return []
    segments, curved, count = path.segments, path.curved, len(path.curved)
    starts = np.where(curved[:, None], segments[:, 1], segments[:, 3]) - segments[:, 0]
    ends = segments[:, 3] - np.where(curved[:, None], segments[:, 2], segments[:, 0])
    turn = _turns(np.roll(ends, 1, axis=0), starts)
    length = portable.hypot(*(segments[:, 3] - segments[:, 0]).T)
    is_short = np.minimum(length, np.roll(length, 1)) <= SHORT
    kinks = list[Kink]()
    for k in np.flatnonzero((turn >= TURN_RAD) & is_short & (curved | np.roll(curved, 1))):
        if kinks and (k - kinks[-1].segment < 2 or (k + 1 == count and not kinks[0].segment)):
            continue
        if len(kinks) == count - 2:  # a path needs two segments
            break
        pair = [k - 1, k]
        points = sampled(segments[pair], curved[pair], np.full(2, SAMPLES))
        points = np.vstack([points, segments[k, 3]])
        curve = fitted_curve(points)
        new = sampled(curve[None], np.ones(1, bool), np.full(1, SAMPLES))
        bends = [
            _turns(steps[:-1], steps[1:]).sum()
            for line in (points, np.vstack([new, curve[3]]))
            for steps in [np.vstack([ends[k - 2], np.diff(line, axis=0), starts[(k + 1) % count]])]
        ]
        if bends[0] - bends[1] > BEND_RAD:
            kinks.append(Kink(int(k), curve, segments[k, 0]))
    return kinks


def _turns(u: Floats, v: Floats) -> Floats:
    """Return the angles (k,) between vectors (k, 2), in 0..pi."""
    return np.abs(portable.arctan2(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0], (u * v).sum(axis=1)))


def _without(path: Path, kinks: list[Kink]) -> Path:
    """Return a path with one curve for the two segments beside each of the kinks."""
    if not kinks:
        return path
    segments, curved = path.segments.copy(), path.curved.copy()
    at = np.array([kink.segment for kink in kinks])
    segments[at] = [kink.curve for kink in kinks]
    curved[at] = True
    left = np.ones(len(curved), bool)
    left[at - 1] = False
    return path._replace(segments=segments[left], curved=curved[left])


def _sum_near(values: Floats, place: Floats) -> float:
    """Return the sum of values (h, w) around a place."""
    x, y = place
    h, w = values.shape
    ys = slice(max(int(y - NEAR), 0), min(int(y + NEAR) + 1, h))
    xs = slice(max(int(x - NEAR), 0), min(int(x + NEAR) + 1, w))
    return float(values[ys, xs].sum())
