"""Find the order in which Gaussians are added to a canvas that can hold a limited range of values.

The range includes at least the background and the image. For example, at one place the background
is .5, and Gaussians add .3, .4 and -.5. So the image is .7 there, and the range is .5 to .7. The
excess of a Gaussian is how far the total would be outside of the range if it were drawn next:

    total   excess of +.3, +.4, -.5    drawn next
    .5      .1, .2, .5                 +.3, because all exceed the range, and +.3 by the least
    .8          .5, .2                 -.5, because its excess is less than that of +.4
    .3          0                      +.4, and then the total is the image

In this order the canvas must hold the totals .3 to .8. In another order the totals would be .5 to
1.2. On such a canvas all values would be rounded more coarsely.

Totals are checked at samples. These are the centres of the cells of a grid, and the means of all
Gaussians, because a thin Gaussian may peak between two centres. Samples are sorted by the row of
the grid in which they lie, and then by x. Kernels visit the samples that a Gaussian reaches, and
store nothing for each Gaussian. So the memory depends only on the number of samples.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg.core import Kernel
from gauss2svg.scene import Scene, whitening_of
from gauss2svg.scene.falloff import cut_radius, profile

Floats = NDArray[np.float64]
# An excess of less than _EQUAL over the range may be due to the rounding of float32, so it is
# ignored. The range is extended so that it contains the partial sums, but not for a partial sum
# that exceeds the image at the same sample by less than _EQUAL_IN_IMAGE.
_EQUAL, _EQUAL_IN_IMAGE = 1e-4, 1e-3
# While the order of the Gaussians is chosen, the range of each colour channel is extended at both
# ends by this much. More Gaussians then stay within the range, so fewer are put off until later.
SPARE = 0.02
_RADIUS = float(cut_radius(1.0))
# The falloff is stored in a table with this many steps. From one step to the next, the squared
# radius grows by the same amount.
_STEPS = 4096  # STEPS of gauss2svg/core/headroom.c
_FALLOFF = profile(_RADIUS * np.sqrt(np.arange(_STEPS + 1) / _STEPS), 1.0)
_DRAWN = -1  # a Gaussian that has been drawn has this value in the array `worst`
_ANY = 1e300  # larger than the excess of any Gaussian


# The next three numbers limit the grid on which partial sums are sampled (docs/decisions/svg.md).
FINEST = 4.0  # largest number of samples per px, along x and along y
SIDE = 1536  # largest number of samples along a side of the grid
# Largest number of pairs of a Gaussian and a sample that the Gaussian may reach. If Gaussians are
# wide, a fine grid would have more such pairs, so the grid is made coarser. A coarser grid is exact
# enough for wide Gaussians.
TOUCHED = 3e7


class Samples(NamedTuple):
    """The positions of m samples, and n Gaussians. The unit of length is a cell of the grid.

    place      (m, 2) x and y of the samples
    start      (rows + 1,) index of the first sample of each row. The last number is m
    mean       (n, 2) means of the Gaussians
    whitening  (n, 3) w11, w21 and w22 of their whitening matrices
    reach      (n, 2) how far the Gaussians reach from their means, in x and in y
    color      (n, 3) their colours
    """

    place: NDArray[np.float32]
    start: NDArray[np.intp]
    mean: Floats
    whitening: Floats
    reach: Floats
    color: Floats


def phases_of(scene: Scene) -> tuple[list[NDArray[np.intp]], Floats, Floats]:
    """Return the phases of an additive scene, and the range of values that its canvas must hold.

    A phase has the indices of Gaussians whose colours have the same signs. The phases are in the
    order in which they are drawn, and each Gaussian is in one phase.

    The range is given by the lowest values (3,) and the highest values (3,) of the channels. It
    contains the background, and all values of the image that are in 0..1. It also contains the
    partial sums, which are the sums after each Gaussian. A partial sum may be outside of the range
    only where the image is at least as far outside.

    If a value v of the image is above the highest value h, the canvas shows 2 h - v. This is called
    folding. Folding does no harm if 2 h - v is at least 1, because v and 2 h - v are then both
    clipped to 1 in the end. So h need only be halfway between 1 and the largest v of the image. In
    the same way, if the smallest v is below 0, the lowest value of the range need only be halfway
    between 0 and this v.
    """
    samples, background = _samples_of(scene), scene.background
    total = np.tile(background.astype(np.float32), (len(samples.place), 1))
    lowest, highest, picture = total.copy(), total.copy(), total.copy()
    worst, every = np.zeros(len(scene), np.intp), np.arange(len(scene))
    fields = len(samples.start) - 1, _RADIUS, samples.place, samples.start, _FALLOFF, *samples[2:]
    free = np.full(3, np.inf)
    _draw_gaussians(
        *fields, picture, -free, free, len(every), every, _ANY, worst, picture, picture,
        picture,
    )  # fmt: skip
    low, high = picture.min(axis=0).astype(np.float64), picture.max(axis=0).astype(np.float64)
    low = np.minimum(background, np.where(low < 0, 0.5 * low, low))
    high = np.maximum(background, np.where(high > 1, 0.5 * (1 + high), high))
    pattern = (scene.color < 0) @ [1, 2, 4]
    mass = np.abs(scene.color).max(axis=1) * scene.sigma.prod(axis=1)
    by_mass = np.argsort(-mass, kind="stable")
    worst[:] = 0

    def draw(indices: NDArray[np.intp], enough: float) -> int:
        return _draw_gaussians(
            *fields,
            picture,
            low - SPARE,
            high + SPARE,
            len(indices),
            indices,
            enough,
            worst,
            total,
            lowest,
            highest,
        )

    order = _order_of(draw, worst, pattern, by_mass)
    lowest[lowest > picture - _EQUAL_IN_IMAGE] = np.inf
    highest[highest < picture + _EQUAL_IN_IMAGE] = -np.inf
    low, high = np.minimum(low, lowest.min(axis=0)), np.maximum(high, highest.max(axis=0))
    return np.split(order, np.flatnonzero(np.diff(pattern[order])) + 1), low, high


def _samples_of(scene: Scene) -> Samples:
    """Return the samples at which the sums of an additive scene are checked."""
    canvas = np.array([scene.width, scene.height])
    touched = float(np.minimum(2 * _RADIUS * scene.sigma, canvas).prod(axis=1).sum())
    factor = min(FINEST, SIDE / canvas.max(), np.sqrt(TOUCHED / max(1.0, touched)))
    size = np.maximum(1, np.ceil(factor * canvas)).astype(int)
    mean, sigma = scene.mean * (size / canvas), scene.sigma * (size / canvas)
    y, x = np.mgrid[: size[1], : size[0]] + 0.5
    within = ((mean >= 0) & (mean < size)).all(axis=1)
    place = np.concatenate([np.stack([x, y], axis=-1).reshape(-1, 2), mean[within]])
    key = size[0] * np.floor(place[:, 1]) + place[:, 0]
    order = np.argsort(key, kind="stable")
    start = np.searchsorted(key[order], size[0] * np.arange(size[1] + 1))
    place = place[order].astype(np.float32)
    whitening = whitening_of(sigma, scene.rho)
    return Samples(place, start, mean, whitening, _RADIUS * sigma, scene.color.copy())


_draw_gaussians = Kernel(
    "draw_gaussians",
    "int float float32 int64 float64 float64 float64 float64 float64 float32 float64 float64 int"
    " int64 float int64 float32 float32 float32",
)


def _order_of(
    draw: Callable[[NDArray[np.intp], float], int], worst: NDArray[np.intp],
    pattern: NDArray[np.intp], by_mass: NDArray[np.intp],
) -> NDArray[np.intp]:  # fmt: skip
    """Return the indices of all Gaussians, in an order that keeps the totals near low..high.

    draw(indices, enough)  draws the Gaussians whose excess is below `enough`, one after the other.
                           If `enough` is infinite, it draws none, and returns the one with the
                           least excess
    worst    (n,) _DRAWN for the Gaussians that `draw` has drawn
    pattern  (n,) signs of their colours

    The order is found in tours. A tour visits all patterns of signs, one after the other. At each
    pattern it tries those Gaussians of this pattern that are not drawn yet, in the order by_mass.
    It draws each one with which the totals stay in the range. If a tour draws no Gaussian, the
    Gaussian that exceeds the range least is drawn.
    """
    order, waiting = [by_mass[:0]], by_mass
    patterns = np.arange(8) ^ (np.arange(8) >> 1)  # a Gray code: each step changes only one sign
    while waiting.size:
        before = len(order)
        for signs in patterns:
            tried = waiting[pattern[waiting] == signs]
            if draw(tried, _EQUAL):
                order.append(tried[worst[tried] == _DRAWN])
        if len(order) == before:
            order.append(np.array([draw(waiting, np.inf)]))
            draw(order[-1], _ANY)
        waiting = waiting[worst[waiting] != _DRAWN]
        # Each change of the pattern inverts channels of the canvas. The next tour visits the
        # patterns in reverse order. So it begins with the last pattern of this tour, and nothing is
        # inverted between the two tours.
        patterns = patterns[::-1]
    return np.concatenate(order)
