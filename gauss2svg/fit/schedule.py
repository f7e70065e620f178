"""The schedule of a fit: rounds of growth, reduced sizes, learning rates, and progress.

Progress is measured both by iterations and by the wall clock. The larger value counts.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

LARGEST_REDUCTION = 8  # largest factor by which growth divides width and height
# px, longest side up to which an enlarged target is never reduced (docs/decisions/enlarged.md).
LARGEST_UNREDUCED = 640

# Constants of a fit's schedule (docs/decisions/fit.md). Progress is in 0..1.
ROUNDS = 6  # number of rounds of growth. 4 to 20 rounds change the PSNR by less than 0.1 dB
GROWTH_SHARE = 0.3  # progress at which all Gaussians have been added
DECAY_START = 0.75  # progress at which the learning rate begins to decay by a cosine
LAST_RATE = 0.02  # share of the learning rate that is left at the end
# Progress at which exponents and colours become those of the file. A lower value is worse.
QUANTIZED_FROM = 0.85
# Fewest pixels per Gaussian on a reduced target. Reduced targets save a fifth of the pixel-Gaussian
# pairs at no loss of PSNR.
PIXELS_PER_GAUSSIAN = 36
SMALLEST_SIDE = 32  # px, shortest side that a reduced target may have in growth
# The constants down to EXTENDED are for few Gaussians, which are first refined on reduced targets
# (docs/decisions/few.md).
FULL_FROM = 0.55  # progress from which targets have their full size
HALF_FROM = 0.45  # progress from which targets have half the width and height (earlier: a fourth)
# px, shortest side that a reduced target may have in refinement. Steps on smaller targets take no
# less time.
SMALLEST_REFINED_SIDE = 128
REDUCED_STEPS = 0.72  # share of refinement's steps that are on reduced targets
# Share of refinement's time that steps on reduced targets take if a deadline ends the fit
# (docs/decisions/time.md).
REDUCED_TIME = 0.4
EXTENDED = 2  # factor by which a preset's steps are multiplied if most are on reduced targets
RELOCATE_FROM = 0.2  # progress at which relocation begins
RELOCATE_UNTIL = 0.75  # progress at which relocation ends
RELOCATE_EVERY = 10  # steps between relocations
# Least number of steps between two relocations of a long fit, as a share of its steps
# (docs/decisions/time.md).
RELOCATE_SHARE = 0.05


def totals(
    schedule: str, gaussians: int, iterations: int | None, per_round: int | None = None
) -> list[int]:
    """Return the number of Gaussians after each round, ascending to `gaussians` (>= 0).

    schedule   "exponential": the total doubles in each round; "linear": equal parts; "all-at-once":
               one round
    per_round  if given, >= 1: as in the paper, round i = 0, 1, .. adds min(2^i, per_round) if the
               schedule is exponential, and per_round if it is linear
    Without per_round there are at most ROUNDS rounds, and at most as many as iterations.
    """
    if per_round is not None:
        return _totals_by_round(schedule, gaussians, per_round)
    count = ROUNDS if iterations is None else min(ROUNDS, iterations)
    if schedule == "exponential":
        counts = [math.ceil(gaussians * 0.5 ** (count - 1 - r)) for r in range(count)]
    elif schedule == "linear":
        counts = [math.ceil(gaussians * (r + 1) / count) for r in range(count)]
    else:
        counts = [gaussians]
    return sorted(set(counts) - {0})


def _totals_by_round(schedule: str, gaussians: int, per_round: int) -> list[int]:
    counts, added = [], 1 if schedule == "exponential" else per_round
    while (counts[-1] if counts else 0) < gaussians:
        counts.append(min((counts[-1] if counts else 0) + min(added, per_round), gaussians))
        added *= 2
    return counts


def reduction(gaussians: int, width: int, height: int) -> int:
    """Return the divisor of a target's sides in a round that ends with `gaussians` Gaussians."""
    factor = 1
    while (
        factor < LARGEST_REDUCTION
        and width * height / (4 * factor**2 * gaussians) >= PIXELS_PER_GAUSSIAN
        and min(width, height) / (2 * factor) >= SMALLEST_SIDE
    ):
        factor *= 2
    return factor


def refinement_reduction(done: float, gaussians: int, width: int, height: int) -> int:
    """Return the divisor of a target's width and height in refinement at progress `done` in 0..1.

    It is 4 before HALF_FROM, 2 before FULL_FROM and then 1. It is less if a Gaussian would have
    fewer than PIXELS_PER_GAUSSIAN pixels, or the target a side below SMALLEST_REFINED_SIDE.
    """
    factor = 1
    for until in (FULL_FROM, HALF_FROM):
        pixels = width * height / (4 * factor**2 * max(gaussians, 1))
        fits = min(width, height) / (2 * factor) >= SMALLEST_REFINED_SIDE
        if done < until and pixels >= PIXELS_PER_GAUSSIAN and fits:
            factor *= 2
    return factor


def enlarged_reduction(done: float, width: int, height: int) -> int:
    """Return the divisor of a target's width and height in a fit to an enlarged picture.

    All but the last steps run at half the size if a side is longer than LARGEST_UNREDUCED.
    """
    is_large = max(width, height) > LARGEST_UNREDUCED
    return 2 if is_large and done < QUANTIZED_FROM else 1


def relocates(done: float, iteration: int, rarely: bool = False) -> bool:
    """Return whether Gaussians are relocated before this step, at progress `done` in 0..1.

    rarely  whether at least RELOCATE_SHARE of the steps lie between relocations
    """
    every = RELOCATE_EVERY
    if rarely and done > RELOCATE_FROM:
        every = max(every, int(RELOCATE_SHARE * iteration / done))
    return RELOCATE_FROM < done < RELOCATE_UNTIL and iteration % every == 0


def rate(done: float) -> float:
    """Return the factor (LAST_RATE..1) of the learning rate at progress `done` in 0..1."""
    start = DECAY_START
    if done < start:
        return 1.0
    fall = 0.5 * (1 + math.cos(math.pi * (done - start) / (1 - start)))
    return max(LAST_RATE, fall)


# Largest number of steps in a round of growth if only time limits the fit. The rest of the time is
# better spent once all Gaussians exist (docs/decisions/time.md).
MOST_STEPS_A_ROUND = 30


class Clock:
    """A clock of progress in 0..1. Growth takes it to GROWTH_SHARE, and refinement to 1.

    iterations        number of steps in both stages, or None for as many as the time allows
    rounds            largest number of rounds of growth
    deadline          returns the end of the fit in s of time.perf_counter(), or None
    round_iterations  number of steps in each round; None: rounds share GROWTH_SHARE of iterations
    stop              polled at every step; the fit ends once it returns True
    """

    def __init__(
        self,
        iterations: int | None,
        rounds: int,
        deadline: Callable[[], float | None] = lambda: None,
        round_iterations: int | None = None,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self.iterations = iterations
        self.iteration = 0
        self.out_of_time = False
        self._rounds, self._round_iterations = max(rounds, 1), round_iterations
        self._deadline, self._paused_s = deadline, 0.0
        self._stop, self._stopped = stop, False
        self._started_s = time.perf_counter()
        self.begin_refinement(None, 0.0)

    @property
    def elapsed_s(self) -> float:
        """Wall-clock seconds since the start of the fit, without pauses since begin_refinement."""
        return time.perf_counter() - self._started_s - self._paused_s

    @property
    def stopped(self) -> bool:
        """Whether the caller has asked the fit to stop."""
        self._stopped = self._stopped or self._stop()
        return self._stopped

    def round_is_over(self, index: int) -> bool:
        """Return whether round `index` (0, 1, ...) of growth has used its steps or its time."""
        growth = GROWTH_SHARE
        steps = (self._round_iterations or MOST_STEPS_A_ROUND) * (index + 1)
        if self._round_iterations is None and self.iterations is not None:
            steps = int(self.iterations * growth) * (index + 1) // self._rounds
        late = self._share_of_time(0.0) >= growth * (index + 1) / self._rounds
        return self.iteration >= steps or late or self.stopped

    @property
    def growth_is_late(self) -> bool:
        """Whether growth has used its share of the time."""
        return self._share_of_time(0.0) >= GROWTH_SHARE

    def growth_progress(self, index: int) -> float:
        """Return the progress in 0..GROWTH_SHARE at the end of round `index`."""
        return GROWTH_SHARE * min((index + 1) / self._rounds, 1.0)

    def begin_refinement(self, steps: int | None, progress: float, reduced: bool = False) -> None:
        """Begin refinement at `progress`. It ends after `steps` iterations or at the deadline.

        reduced: whether its first steps, which are the majority, run on reduced pictures.
        """
        self._start, self._reduced = progress, reduced
        self._paused_s = 0.0  # earlier pauses no longer delay the end
        self._first_step, self._steps, self._start_s = self.iteration, steps, self.elapsed_s

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Stop the clock during the `with` block, which delays the end of the fit."""
        started_s = time.perf_counter()
        yield
        self._paused_s += time.perf_counter() - started_s

    def refinement_progress(self) -> float:
        """Return the progress during refinement, 1 at its end. Update `out_of_time`."""
        if self.stopped:
            return 1.0
        by_steps = 0.0
        if self._steps is not None:
            by_steps = (self.iteration - self._first_step) / self._steps if self._steps else 1.0
        by_time = self._share_of_time(self._start_s)
        if not self._reduced:
            self.out_of_time = by_time > by_steps
            return self._start + (1 - self._start) * min(max(by_steps, by_time), 1.0)
        # REDUCED_STEPS of the steps run on reduced pictures, in REDUCED_TIME of the time.
        until = FULL_FROM
        steps, seconds = (
            self._start + (until - self._start) * share / reduced
            if share < reduced
            else 1 - (1 - until) * (1 - share) / (1 - reduced)
            for share, reduced in (
                (by_steps, REDUCED_STEPS),
                (by_time, REDUCED_TIME),
            )
        )
        self.out_of_time = seconds > steps
        return min(max(steps, seconds), 1.0)

    def _share_of_time(self, since_s: float) -> float:
        """Return the elapsed share of the time from `since_s` (s of this clock) to the deadline."""
        deadline = self._deadline()
        if deadline is None:
            return 0.0
        whole = deadline - self._started_s - since_s
        return (self.elapsed_s - since_s) / whole if whole > 0 else 1.0
