"""The order in which Gaussians are added on a canvas that holds a limited range of values.

On such a canvas each Gaussian is added to a channel or subtracted from it, until the channel is
inverted. Gaussians are therefore drawn in phases of one pattern of signs, and patterns follow each
other in the order of a Gray code, so that one channel is inverted at a time. Additive blending is
commutative: a Gaussian is drawn once the canvas has room for it, and until then waits for a later
tour through the patterns. Where all wait for each other, the one that lacks least room is drawn.

Room is checked between the pixels as well (gauss2svg.svg.additive.headroom), so that a file can be
drawn at any size. Values that are clipped in the end may fold on the canvas, which allows a larger
scale (docs/decisions/svg.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import Scene
from gauss2svg.svg.additive.headroom import add_all, order_of, range_of, samples_of

_EQUAL = 1e-3
_GRAY = np.array([k ^ (k >> 1) for k in range(8)])


# The order of additive Gaussians (docs/decisions/svg.md).
# Share of a channel that is spared at either end, so that fewer Gaussians wait for each other.
SPARE = 0.02


@dataclass(frozen=True)
class Phase:
    """Gaussians drawn one after the other: the channels they subtract from, and their indices."""

    takes: tuple[bool, bool, bool]
    index: NDArray[np.intp]


def phases_of(
    scene: Scene,
) -> tuple[tuple[Phase, ...], NDArray[np.float64], NDArray[np.float64]]:
    """Phases of an additive scene in drawing order, and lowest and highest value (3,) of a channel.

    Each Gaussian is in one phase. The canvas must hold these values: they include the image
    (gauss2svg.svg.additive.headroom.range_of) and all partial sums between and within phases,
    except values of a sample that equal its image.
    """
    samples = samples_of(scene)
    picture, low, high = range_of(samples, scene.background)
    pattern = (scene.color < 0) @ [1, 2, 4]
    mass = np.abs(scene.color).max(axis=1) * scene.sigma.prod(axis=1)
    by_mass = np.argsort(-mass, kind="stable")
    order = order_of(
        samples, picture, low - SPARE, high + SPARE, scene.background.copy(),
        pattern, _GRAY, by_mass,
    )  # fmt: skip
    ends = np.flatnonzero(np.diff(pattern[order])) + 1
    phases = tuple(
        _phase(int(pattern[index[0]]), index) for index in np.split(order, ends) if index.size
    )
    lowest = np.tile(scene.background.astype(np.float32), (len(samples.place), 1))
    total, highest = lowest.copy(), lowest.copy()
    for phase in phases:
        add_all(samples, phase.index, total, lowest, highest)
    lowest[lowest > picture - _EQUAL] = np.inf
    highest[highest < picture + _EQUAL] = -np.inf
    low, high = np.minimum(low, lowest.min(axis=0)), np.maximum(high, highest.max(axis=0))
    return phases, low, high


def _phase(signs: int, index: NDArray[np.intp]) -> Phase:
    return Phase((bool(signs & 1), bool(signs & 2), bool(signs & 4)), index)
