"""Headroom: the order in which Gaussians are added to a canvas that holds a limited range.

A canvas holds values from low to high, at least those of the background and of the image. Say that
at one place the background is .5 and the image .7, the sum with +.3, +.4 and -.5:

    total   room that +.3, +.4, -.5 lack    drawn
    .5      .1, .2, .5                      +.3: none has room, and it lacks least
    .8          .5, .2                      -.5
    .3          0                           +.4: .7 is the image, for which there is room

In that order the canvas must hold .3 to .8. In another it would have to hold .5 to 1.2, and all
that is drawn on it would be rounded more coarsely.

The room of a Gaussian is looked for at samples: pixels of a grid, and the means of all Gaussians,
because thin ones peak between pixels. They are sorted by the row of the grid that they lie in, and
by x within it. Kernels walk the samples of a Gaussian and store nothing per Gaussian, so that
memory is that of the samples.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg.kernel_cache import cached
from gauss2svg.scene import Scene, narrowing_of, whitening_of
from gauss2svg.scene.falloff import cut_radius, profile

_kernel = cached()
# A smaller contribution to a colour channel of a sample needs no room there.
_LEAST_ADDED = 1e-3
# Equal values of a colour channel: the rounding of float32 is smaller.
_EQUAL = 1e-4
_RADIUS = float(cut_radius(1.0))
_TABLE = 4096  # steps of the falloff by squared radius
_STEPS_EACH = _TABLE / _RADIUS**2
_NOWHERE = -1


# Grid on which partial sums are sampled (docs/decisions/svg.md).
FINEST = 4.0  # most samples for each px, each way
SIDE = 1536  # most samples of a side
# Samples that all Gaussians together may touch, without means. A coarser grid is enough for wider
# Gaussians.
TOUCHED = 3e7


class Samples(NamedTuple):
    """Positions of samples, and the Gaussians in the same units, those of the grid.

    place    (m, 2) x, y
    start    (rows + 1,) of each row's samples
    shape    (n, 9) mean x, y, whitening w11, w21, w22, reach in x and y, d x / d y of the ridge on
             which rows peak, and the half width of a row through the mean
    color    (n, 3)
    falloff  by the squared radius, from 0 to the cut
    """

    place: NDArray[np.float32]
    start: NDArray[np.intp]
    shape: NDArray[np.float64]
    color: NDArray[np.float64]
    falloff: NDArray[np.float64]


def samples_of(scene: Scene) -> Samples:
    """Samples of an additive scene; they depend only on the scene."""
    canvas = np.array([scene.width, scene.height])
    sides = np.minimum(2 * _RADIUS * scene.sigma, canvas)
    touched = max(1.0, float(sides.prod(axis=1).sum()))
    coarse = float(np.sqrt(TOUCHED / touched))
    factor = min(FINEST, SIDE / canvas.max(), coarse)
    size = np.maximum(1, np.ceil(factor * canvas)).astype(int)
    mean, sigma = scene.mean * (size / canvas), scene.sigma * (size / canvas)
    y, x = np.mgrid[: size[1], : size[0]] + 0.5
    grid = np.stack([x, y], axis=-1).reshape(-1, 2)
    means = mean[((mean >= 0) & (mean < size)).all(axis=1)]
    # Two sorted runs, which a stable sort only merges.
    keys = [size[0] * np.floor(part[:, 1]) + part[:, 0] for part in (grid, means)]
    means, keys[1] = means[np.argsort(keys[1])], np.sort(keys[1])
    order = np.argsort(np.concatenate(keys), kind="stable")
    place = np.concatenate([grid, means])[order].astype(np.float32)
    start = np.searchsorted(np.concatenate(keys)[order], size[0] * np.arange(size[1] + 1))
    shape = np.column_stack(
        [
            mean, whitening_of(sigma, scene.rho), _RADIUS * sigma,
            scene.rho * sigma[:, 0] / sigma[:, 1],
            _RADIUS * narrowing_of(scene.rho) * sigma[:, 0],
        ]
    )  # fmt: skip
    falloff = profile(_RADIUS * np.sqrt(np.arange(_TABLE + 1) / _TABLE), 1.0)
    return Samples(
        place, start.astype(np.intp), shape, scene.color.copy(),
        np.ascontiguousarray(falloff, np.float64),
    )  # fmt: skip


def range_of(
    samples: Samples, background: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]:
    """The image (m, 3), and the lowest and highest value (3,) that a canvas must hold to show it.

    Values outside fold: v above the highest h becomes 2 h - v. Values above 1 are clipped in the
    end, so that 2 h - v >= 1 is enough; likewise below 0.
    """
    picture = np.tile(background.astype(np.float32), (len(samples.place), 1))
    add_all(samples, np.arange(len(samples.color)), picture, picture, picture)
    least, most = picture.min(axis=0).astype(np.float64), picture.max(axis=0).astype(np.float64)
    low = np.minimum(background, np.where(least < 0, 0.5 * least, least))
    high = np.maximum(background, np.where(most > 1, 0.5 * (1 + most), most))
    return picture, low, high


@_kernel
def add_all(samples, order, total, lowest, highest):
    """Add Gaussians one by one to total (m, 3); lowest and highest (m, 3) follow it."""
    for i in order:
        _add(samples, i, total, lowest, highest)


@_kernel
def order_of(samples, picture, low, high, background, pattern, patterns, by_mass):
    """All Gaussians, each once, in the order in which to draw them on a canvas of low..high.

    A sample may also reach its own value of the image: wherever the canvas folds, the final error
    is then no larger than that of the image. Tours through the patterns draw what has room, in the
    order by_mass; where nothing has, the one that lacks least is drawn.
    """
    count = by_mass.size
    total = np.empty_like(picture)
    total[:] = background
    order = np.empty(count, np.intp)
    waiting = by_mass.copy()
    # Where each Gaussian lacked room last, and a lower bound of how much it lacks.
    seen, lacks = np.full(count, _NOWHERE), np.zeros(count)
    done = 0
    backwards = False
    while done < count:
        before = done
        for k in range(patterns.size):
            signs = patterns[patterns.size - 1 - k if backwards else k]
            left = 0
            for i in waiting:
                fits = False
                if pattern[i] == signs:
                    lacks[i], seen[i] = _lacking(
                        samples, i, total, picture, low, high, seen[i], True
                    )
                    fits = lacks[i] <= _EQUAL
                if fits:
                    _add(samples, i, total, total, total)
                    order[done] = i
                    done += 1
                else:
                    waiting[left] = i
                    left += 1
            waiting = waiting[:left]
        # Back through the patterns: the first of a tour is the last of the one before.
        backwards = not backwards
        if done == before:  # the canvas is as it was when each lack was found
            i = _least(samples, waiting, total, picture, low, high, seen, lacks)
            _add(samples, i, total, total, total)
            order[done] = i
            done += 1
            waiting = waiting[waiting != i]
    return order


@_kernel
def _least(samples, waiting, total, picture, low, high, seen, lacks):
    """The waiting Gaussian that lacks least; lower bounds in lacks are made exact on the way.

    All samples of a Gaussian are walked for the few whose bound is below the least exact lack.
    """
    exact = np.zeros(lacks.size, np.bool_)
    while True:
        i = waiting[np.argmin(lacks[waiting])]
        if exact[i]:
            return i
        lacks[i], seen[i] = _lacking(samples, i, total, picture, low, high, seen[i], False)
        exact[i] = True


@_kernel
def _lacking(samples, i, total, picture, low, high, seen, any_will_do):
    """How far beyond low..high the i-th Gaussian would lead, and at which sample.

    With any_will_do it is that of the first sample found to lack room, beginning with `seen`.
    """
    if any_will_do and seen != _NOWHERE:
        lack = _beyond(samples, i, seen, total, picture, low, high)
        if lack > _EQUAL:
            return lack, seen
    most, worst = 0.0, seen
    for row in range(*_rows(samples, i)):
        first, last = _interval(samples, i, row)
        for at in range(first, last):
            lack = _beyond(samples, i, at, total, picture, low, high)
            if lack > most:
                most, worst = lack, at
        if any_will_do and most > _EQUAL:
            break
    return most, worst


@_kernel
def _beyond(samples, i, at, total, picture, low, high):
    """How far beyond low..high the i-th Gaussian would lead a sample; at most 0 where not."""
    alpha = _alpha(samples, i, at)
    most = 0.0
    for c in range(3):
        added = alpha * samples.color[i, c]
        if added > _LEAST_ADDED:
            most = max(most, total[at, c] + added - max(high[c], picture[at, c]))
        elif added < -_LEAST_ADDED:
            most = max(most, min(low[c], picture[at, c]) - total[at, c] - added)
    return most


@_kernel
def _add(samples, i, total, lowest, highest):
    for row in range(*_rows(samples, i)):
        first, last = _interval(samples, i, row)
        for at in range(first, last):
            alpha = _alpha(samples, i, at)
            for c in range(3):
                after = np.float32(total[at, c] + alpha * samples.color[i, c])
                total[at, c] = after
                lowest[at, c] = min(lowest[at, c], after)
                highest[at, c] = max(highest[at, c], after)


@_kernel
def _rows(samples, i):
    shape = samples.shape
    rows = samples.start.size - 1
    first = np.floor(min(max(shape[i, 1] - shape[i, 6], 0.0), float(rows)))
    last = np.ceil(min(max(shape[i, 1] + shape[i, 6], 0.0), float(rows)))
    return int(first), int(last)


@_kernel
def _interval(samples, i, row):
    """First and last of a row's samples that the i-th Gaussian may reach."""
    shape = samples.shape
    # Samples lie anywhere in their row: the interval is that of its edge nearest to the mean, and
    # as much wider as the ridge moves within half a row.
    v = row + 0.5 - shape[i, 1]
    near = min(1.0, max(0.0, abs(v) - 0.5) / shape[i, 6])
    middle = shape[i, 0] + shape[i, 7] * v
    half = shape[i, 8] * np.sqrt(1 - near * near) + 0.5 * abs(shape[i, 7])
    left = max(middle - half, shape[i, 0] - shape[i, 5])
    right = min(middle + half, shape[i, 0] + shape[i, 5])
    first = _left_of(samples, row, left)
    return first, max(first, _left_of(samples, row, right))


@_kernel
def _left_of(samples, row, x):
    """The first of a row's samples, all sorted, that does not lie left of x."""
    low, high = samples.start[row], samples.start[row + 1]
    return low + np.searchsorted(samples.place[low:high, 0], x)


@_kernel
def _alpha(samples, i, at):
    """The falloff of the i-th Gaussian at a sample, by linear interpolation."""
    shape, falloff = samples.shape, samples.falloff
    u, v = samples.place[at, 0] - shape[i, 0], samples.place[at, 1] - shape[i, 1]
    across, along = shape[i, 2] * u, shape[i, 3] * u + shape[i, 4] * v
    step = (across * across + along * along) * _STEPS_EACH
    if step >= _TABLE:
        return 0.0
    k = int(step)
    return falloff[k] + (step - k) * (falloff[k + 1] - falloff[k])
