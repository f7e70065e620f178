"""The order in which Gaussians are added to a canvas that holds a limited range of values.

The range includes at least the background and the image. An example: at one place the
background is .5, and the image is .7, which is .5 + .3 + .4 - .5. The range is .5 to .7:

    total   excess of +.3, +.4, -.5    drawn
    .5      .1, .2, .5                 +.3: all exceed the range, +.3 by the least
    .8          .5, .2                 -.5
    .3          0                      +.4: the total is then the image

In this order the canvas must hold .3 to .8. In another order it would have to hold .5 to 1.2, and
would round everything on it more coarsely.

Totals are checked at samples: the pixels of a grid, and the means of all Gaussians, because thin
ones peak between pixels. Samples are sorted by the row of the grid in which they lie, then by x.
Kernels walk the samples of a Gaussian and store nothing for each Gaussian, so memory depends on the
number of samples alone.
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
# Smaller contributions to a colour channel at a sample are not checked.
_LEAST_CHECKED = 1e-3
# Largest difference at which two values of a colour channel count as equal, above the rounding of
# float32. The second compares a sum with the image at one sample, where both may exceed the range.
_EQUAL, _EQUAL_IN_IMAGE = 1e-4, 1e-3
# Colour by which either end of the range is extended, so that fewer Gaussians have to wait.
SPARE = 0.02
_RADIUS = float(cut_radius(1.0))
_STEPS = 4096  # number of steps of squared radius in the table of the falloff
_FALLOFF = profile(_RADIUS * np.sqrt(np.arange(_STEPS + 1) / _STEPS), 1.0)
_DRAWN = -1  # marks a drawn Gaussian in the array `worst`


# Grid on which partial sums are sampled (docs/decisions/svg.md).
FINEST = 4.0  # largest number of samples per px, in x and in y
SIDE = 1536  # largest number of samples along a side
# Largest number of grid samples that Gaussians touch, summed over all Gaussians. A coarser grid
# keeps the number below, and is exact enough for wide Gaussians.
TOUCHED = 3e7


class Samples(NamedTuple):
    """Positions of m samples, and the n Gaussians. The unit is a cell of the grid.

    place      (m, 2) x and y of the samples
    start      (rows + 1,) index of each row's first sample, and m
    mean       (n, 2)
    whitening  (n, 3) w11, w21, w22
    reach      (n, 2) largest distance from the mean in x and y
    color      (n, 3)
    """

    place: NDArray[np.float32]
    start: NDArray[np.intp]
    mean: Floats
    whitening: Floats
    reach: Floats
    color: Floats


def phases_of(scene: Scene) -> tuple[list[NDArray[np.intp]], Floats, Floats]:
    """Return an additive scene's phases in drawing order, and both ends (3,) of channels' ranges.

    A phase has the indices of Gaussians with the same signs, and each Gaussian is in one phase. The
    canvas must hold the range, which includes the image and the partial sums after each Gaussian.
    The range leaves out sums that go no farther than the image at their sample.

    Values of the image outside of the range fold: a value v above the highest h becomes 2 h - v.
    Values above 1 are clipped in the end, so 2 h - v >= 1 is enough. The same holds below 0.
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
    """Return the samples of an additive scene. They depend only on the scene."""
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
    """Return the indices of all Gaussians, in the order in which to draw them within low..high.

    Add each Gaussian to `total` (m, 3), and update `lowest` and `highest` (m, 3). A sum may leave
    the range as far as the image does at its sample: the sum then folds like the image, and the
    final error is no larger than the image's.
    Tours through the patterns draw each Gaussian that stays in the range, in the order by_mass. If
    a tour draws none, the Gaussian that exceeds the range least is drawn.
    """
    order = np.empty(by_mass.size, np.intp)
    waiting, done = by_mass, 0
    patterns = np.arange(8) ^ (np.arange(8) >> 1)  # Gray code: each step changes one sign
    worst = np.zeros(by_mass.size, np.intp)  # sample at which each Gaussian last exceeded the range
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
        # The next tour goes backwards, so that it begins with the last pattern of this tour.
        patterns = patterns[::-1].copy()
    return order


@_kernel
def _excess(samples, i, total, picture, low, high, first, enough):
    """Return by how much the i-th Gaussian would exceed low..high, and at which sample.

    The search begins at the sample `first`, and ends early once the excess is at least `enough`.
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
    """Return by how much the i-th Gaussian would exceed low..high at a sample, 0 if not at all."""
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
    """Return the first row that the i-th Gaussian may reach, and one past the last."""
    y, reach, rows = samples.mean[i, 1], samples.reach[i, 1], float(samples.start.size - 1)
    first, last = max(0.0, min(rows, y - reach)), max(0.0, min(rows, y + reach))
    return int(np.floor(first)), int(np.ceil(last))


@_kernel
def _of_row(samples, i, row):
    """Return the first sample of a row that the i-th Gaussian may reach, and one past the last."""
    mean, reach, whitening = samples.mean, samples.reach, samples.whitening
    w11, w21, w22 = whitening[i, 0], whitening[i, 1], whitening[i, 2]
    # Samples lie anywhere in their row. So the interval is taken at the row's edge nearest to the
    # mean. It is widened, because the Gaussian's ridge shifts within half a row.
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
    """Return the falloff of the i-th Gaussian at a sample, by linear interpolation in a table."""
    mean, whitening, place = samples.mean, samples.whitening, samples.place
    u, v = place[at, 0] - mean[i, 0], place[at, 1] - mean[i, 1]
    across, along = whitening[i, 0] * u, whitening[i, 1] * u + whitening[i, 2] * v
    step = (across * across + along * along) * (_STEPS / _RADIUS**2)
    if step >= _STEPS:
        return 0.0
    k = int(step)
    return _FALLOFF[k] + (step - k) * (_FALLOFF[k + 1] - _FALLOFF[k])
