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

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg.kernel_cache import cached
from gauss2svg.scene import Scene, whitening_of
from gauss2svg.scene.falloff import cut_radius, profile

Floats = NDArray[np.float64]
_kernel = cached()
# If a Gaussian changes a colour channel of a sample by no more than this, the new total of that
# channel is not compared with the range.
_LEAST_CHECKED = 1e-3
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
_STEPS = 4096
_FALLOFF = profile(_RADIUS * np.sqrt(np.arange(_STEPS + 1) / _STEPS), 1.0)
_DRAWN = -1  # a Gaussian that has been drawn has this value in the array `worst`


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
    picture = total.copy()
    for i in range(len(scene)):
        _add(samples, i, picture, picture, picture)
    low, high = picture.min(axis=0).astype(np.float64), picture.max(axis=0).astype(np.float64)
    low = np.minimum(background, np.where(low < 0, 0.5 * low, low))
    high = np.maximum(background, np.where(high > 1, 0.5 * (1 + high), high))
    pattern = (scene.color < 0) @ [1, 2, 4]
    mass = np.abs(scene.color).max(axis=1) * scene.sigma.prod(axis=1)
    by_mass = np.argsort(-mass, kind="stable")
    lowest, highest = total.copy(), total.copy()
    order = _order_of(
        samples, picture, low - SPARE, high + SPARE, total, lowest, highest, pattern, by_mass
    )
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


@_kernel
def _order_of(samples, picture, low, high, total, lowest, highest, pattern, by_mass):
    """Return the indices of all Gaussians, in an order that keeps the totals near low..high.

    A total is the sum at a sample, in one channel, of the background and all Gaussians drawn so
    far. When a Gaussian is drawn, it is added to `total` (m, 3). `lowest` and `highest` (m, 3)
    store the lowest and the highest total that each sample has had.

    Where the image is outside of the range, a total may be as far outside as the image. The canvas
    folds the values of both (see phases_of), so the total causes no larger error than the image.

    The order is found in tours. A tour visits all patterns of signs, one after the other. At each
    pattern it tries those Gaussians of this pattern that are not drawn yet, in the order by_mass.
    It draws each one with which the totals stay in the range. If a tour draws no Gaussian, the
    Gaussian that exceeds the range least is drawn.
    """
    order = np.empty(by_mass.size, np.intp)
    waiting, done = by_mass, 0
    patterns = np.arange(8) ^ (np.arange(8) >> 1)  # a Gray code: each step changes only one sign
    # For each Gaussian, the index of the sample at which it exceeded the range the most when it was
    # last tried. The next trial begins at this sample.
    worst = np.zeros(by_mass.size, np.intp)
    while waiting.size:
        before = done
        for signs in patterns:
            for i in waiting[pattern[waiting] == signs]:
                excess, worst[i] = _excess(samples, i, total, picture, low, high, worst[i], _EQUAL)
                if excess < _EQUAL:
                    order[done] = i
                    done += 1
                    _add(samples, i, total, lowest, highest)
        if done == before:
            least = np.inf
            for i in waiting:
                excess, worst[i] = _excess(samples, i, total, picture, low, high, worst[i], least)
                if excess < least:
                    least, order[done] = excess, i
            _add(samples, order[done], total, lowest, highest)
            done += 1
        for i in order[before:done]:
            worst[i] = _DRAWN
        waiting = waiting[worst[waiting] != _DRAWN]
        # Each change of the pattern inverts channels of the canvas. The next tour visits the
        # patterns in reverse order. So it begins with the last pattern of this tour, and nothing is
        # inverted between the two tours.
        patterns = patterns[::-1].copy()
    return order


@_kernel
def _excess(samples, i, total, picture, low, high, first, enough):
    """Return the largest excess of the i-th Gaussian at any sample, and the index of that sample.

    The search begins at the sample with the index `first`. It ends early if it finds an excess of
    at least `enough`.
    """
    most, worst = _excess_at(samples, i, first, total, picture, low, high), first
    for row in range(*_rows(samples, i)):
        if most >= enough:
            break
        for at in range(*_of_row(samples, i, row)):
            excess = _excess_at(samples, i, at, total, picture, low, high)
            if excess > most:
                most, worst = excess, at
    return most, worst


@_kernel
def _excess_at(samples, i, at, total, picture, low, high):
    """Return how far the i-th Gaussian would push a total out of low..high at sample `at`, or 0.

    If the image is outside of low..high at this sample, the total may be as far outside.
    """
    alpha = _alpha(samples, i, at)
    most = 0.0
    for c in range(3):
        added = alpha * samples.color[i, c]
        if added > _LEAST_CHECKED:
            most = max(most, total[at, c] + added - max(high[c], picture[at, c]))
        elif added < -_LEAST_CHECKED:
            most = max(most, min(low[c], picture[at, c]) - total[at, c] - added)
    return most


@_kernel
def _add(samples, i, total, lowest, highest):
    for row in range(*_rows(samples, i)):
        for at in range(*_of_row(samples, i, row)):
            alpha = _alpha(samples, i, at)
            for c in range(3):
                after = np.float32(total[at, c] + alpha * samples.color[i, c])
                total[at, c] = after
                lowest[at, c] = min(lowest[at, c], after)
                highest[at, c] = max(highest[at, c], after)


@_kernel
def _rows(samples, i):
    """Return the first row that the i-th Gaussian may reach, and the row after the last one."""
    y, reach, rows = samples.mean[i, 1], samples.reach[i, 1], float(samples.start.size - 1)
    first, last = max(0.0, min(rows, y - reach)), max(0.0, min(rows, y + reach))
    return int(np.floor(first)), int(np.ceil(last))


@_kernel
def _of_row(samples, i, row):
    """Return the range of the samples that the i-th Gaussian may reach in a row.

    The first result is the index of the first such sample. The second result is one more than the
    index of the last such sample.
    """
    mean, reach, whitening = samples.mean, samples.reach, samples.whitening
    w11, w21, w22 = whitening[i, 0], whitening[i, 1], whitening[i, 2]
    # The interval left..right must contain the Gaussian at every height in the row. Within the row,
    # the Gaussian is widest at the height nearest to the mean, so the interval has at least this
    # width. A tilted Gaussian also has its centre at a different x at each height. So the interval
    # is widened at each end by the distance in x between the centre at the middle of the row and
    # the centre at an edge of the row.
    across, v = w11 * w11 + w21 * w21, row + 0.5 - mean[i, 1]
    ridge, near = -w21 * w22 / across, min(1.0, max(0.0, abs(v) - 0.5) / reach[i, 1])
    half = _RADIUS * np.sqrt((1 - near * near) / across) + 0.5 * abs(ridge)
    left = mean[i, 0] + max(ridge * v - half, -reach[i, 0])
    right = mean[i, 0] + min(ridge * v + half, reach[i, 0])
    begin, end = samples.start[row], samples.start[row + 1]
    first = np.searchsorted(samples.place[begin:end, 0], left)
    last = np.searchsorted(samples.place[begin:end, 0], right)
    return begin + first, begin + max(first, last)


@_kernel
def _alpha(samples, i, at):
    """Return the falloff of the i-th Gaussian at the sample `at`.

    The falloff is interpolated linearly in a table.
    """
    mean, whitening, place = samples.mean, samples.whitening, samples.place
    u, v = place[at, 0] - mean[i, 0], place[at, 1] - mean[i, 1]
    across, along = whitening[i, 0] * u, whitening[i, 1] * u + whitening[i, 2] * v
    step = (across * across + along * along) * (_STEPS / _RADIUS**2)
    if step >= _STEPS:
        return 0.0
    k = int(step)
    return _FALLOFF[k] + (step - k) * (_FALLOFF[k + 1] - _FALLOFF[k])
