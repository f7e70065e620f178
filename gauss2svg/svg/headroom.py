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
from gauss2svg.scene import Scene, whitening_of
from gauss2svg.scene.falloff import cut_radius, profile

Floats = NDArray[np.float64]
_kernel = cached()
# A smaller contribution to a colour channel of a sample needs no room there.
_LEAST_ADDED = 1e-3
# Equal values of a colour channel: the rounding of float32 is smaller. Those of a sample and of the
# image, which it may have wherever the canvas ends, may differ more.
_EQUAL, _EQUAL_IN_IMAGE = 1e-4, 1e-3
# Share of a channel that is spared at either end, so that fewer Gaussians wait for each other.
SPARE = 0.02
_RADIUS = float(cut_radius(1.0))
_STEPS = 4096  # of the falloff by squared radius
_FALLOFF = profile(_RADIUS * np.sqrt(np.arange(_STEPS + 1) / _STEPS), 1.0)
_DRAWN = -1


# Grid on which partial sums are sampled (docs/decisions/svg.md).
FINEST = 4.0  # most samples for each px, each way
SIDE = 1536  # most samples of a side
# Samples that all Gaussians together may touch, without means. A coarser grid is enough for wider
# Gaussians.
TOUCHED = 3e7


class Samples(NamedTuple):
    """Positions of samples, and the Gaussians in the same units, those of the grid.

    place      (m, 2) x, y
    start      (rows + 1,) of each row's samples
    mean       (n, 2)
    whitening  (n, 3) w11, w21, w22
    reach      (n, 2) from the mean, in x and y
    color      (n, 3)
    """

    place: NDArray[np.float32]
    start: NDArray[np.intp]
    mean: Floats
    whitening: Floats
    reach: Floats
    color: Floats


def phases_of(scene: Scene) -> tuple[list[NDArray[np.intp]], Floats, Floats]:
    """Return an additive scene's phases in drawing order, and the range (3,) of each channel.

    A phase is the indices of Gaussians of the same signs, and each Gaussian is in one. The canvas
    must hold the lowest and the highest value of a channel: they include the image and all partial
    sums between and within phases, except values of a sample that equal its image.

    Values of the image outside fold: v above the highest h becomes 2 h - v. Values above 1 are
    clipped in the end, so that 2 h - v >= 1 is enough; likewise below 0.
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
    """Return the samples of an additive scene; they depend only on the scene."""
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
    """All Gaussians, each once, in the order in which to draw them on a canvas of low..high.

    They are added to total (m, 3) one by one; lowest and highest (m, 3) follow it. A sample may
    also reach its own value of the image: wherever the canvas folds, the final error is then no
    larger than that of the image. Tours through the patterns draw what has room, in the order
    by_mass; where nothing has, the one that lacks least is drawn.
    """
    order = np.empty(by_mass.size, np.intp)
    waiting, done = by_mass, 0
    patterns = np.arange(8) ^ (np.arange(8) >> 1)  # signs: each step changes one
    seen = np.zeros(by_mass.size, np.intp)  # a sample where each Gaussian lacked room last
    while waiting.size:
        before = done
        for signs in patterns:
            for i in waiting[pattern[waiting] == signs]:
                lack, seen[i] = _lacking(samples, i, total, picture, low, high, seen[i], _EQUAL)
                if lack < _EQUAL:
                    order[done] = i
                    done += 1
                    _add(samples, i, total, lowest, highest)
        if done == before:
            least = np.inf
            for i in waiting:
                lack, seen[i] = _lacking(samples, i, total, picture, low, high, seen[i], least)
                if lack < least:
                    least, order[done] = lack, i
            _add(samples, order[done], total, lowest, highest)
            done += 1
        for i in order[before:done]:
            seen[i] = _DRAWN
        waiting = waiting[seen[waiting] != _DRAWN]
        # Back through the patterns: the first of a tour is the last of the one before.
        patterns = patterns[::-1].copy()
    return order


@_kernel
def _lacking(samples, i, total, picture, low, high, seen, enough):
    """How far beyond low..high the i-th Gaussian would lead, and at which sample.

    What lacks `enough` will do, beginning with the sample `seen`.
    """
    most, worst = _beyond(samples, i, seen, total, picture, low, high), seen
    for row in range(*_rows(samples, i)):
        if most >= enough:
            break
        for at in range(*_of_row(samples, i, row)):
            lack = _beyond(samples, i, at, total, picture, low, high)
            if lack > most:
                most, worst = lack, at
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
        for at in range(*_of_row(samples, i, row)):
            alpha = _alpha(samples, i, at)
            for c in range(3):
                after = np.float32(total[at, c] + alpha * samples.color[i, c])
                total[at, c] = after
                lowest[at, c] = min(lowest[at, c], after)
                highest[at, c] = max(highest[at, c], after)


@_kernel
def _rows(samples, i):
    """First and last of the rows that the i-th Gaussian may reach."""
    y, reach, rows = samples.mean[i, 1], samples.reach[i, 1], float(samples.start.size - 1)
    first, last = max(0.0, min(rows, y - reach)), max(0.0, min(rows, y + reach))
    return int(np.floor(first)), int(np.ceil(last))


@_kernel
def _of_row(samples, i, row):
    """First and last of a row's samples, which are sorted, that the i-th Gaussian may reach."""
    mean, reach, whitening = samples.mean, samples.reach, samples.whitening
    w11, w21, w22 = whitening[i, 0], whitening[i, 1], whitening[i, 2]
    # Samples lie anywhere in their row: the interval is that of its edge nearest to the mean, and
    # as much wider as the ridge on which rows peak moves within half a row.
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
    """The falloff of the i-th Gaussian at a sample, by linear interpolation."""
    mean, whitening, place = samples.mean, samples.whitening, samples.place
    u, v = place[at, 0] - mean[i, 0], place[at, 1] - mean[i, 1]
    across, along = whitening[i, 0] * u, whitening[i, 1] * u + whitening[i, 2] * v
    step = (across * across + along * along) * (_STEPS / _RADIUS**2)
    if step >= _STEPS:
        return 0.0
    k = int(step)
    return _FALLOFF[k] + (step - k) * (_FALLOFF[k + 1] - _FALLOFF[k])
