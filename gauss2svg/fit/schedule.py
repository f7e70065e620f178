"""When a fit does what: rounds of growth, reduced sizes, learning rates, and the progress of all.

Progress is by iterations or by the wall clock, whichever is further.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gauss2svg.errors import InputError, quoted

LARGEST_REDUCTION = 8
LARGEST_UNREDUCED = 640  # px of a side, of an enlarged target (docs/decisions/enlarged.md)


# Events of a fit. Progress is in 0..1 (docs/decisions/fit.md).
ROUNDS = 6  # rounds of growth; 4 to 20 end within 0.1 dB of each other
GROWTH_SHARE = 0.3  # progress by which all Gaussians have been added
DECAY_START = 0.75  # progress at which the learning rate begins to decay by a cosine
LAST_RATE = 0.02  # share of the learning rate that is left at the end
# Progress from which exponents and colours are those of the file. Earlier is worse.
QUANTIZED_FROM = 0.85
# Pixels for each Gaussian on a reduced target: a fifth fewer pixel-Gaussian pairs at no loss of
# PSNR.
PIXELS_PER_GAUSSIAN = 36
SMALLEST_SIDE = 32  # px of the shortest side of a reduced target in growth
# Progress from which few Gaussians are refined at full size (docs/decisions/few.md, also for the
# next five).
FULL_FROM = 0.55
HALF_FROM = 0.45  # progress up to which few Gaussians are refined at a quarter of the size
# Px of the shortest side of a reduced target in refinement. On smaller ones a step costs as much.
SMALLEST_REFINED_SIDE = 128
REDUCED_STEPS = 0.72  # share of the steps of refinement that reduced targets take
# Share of the time of refinement that they take where time ends the fit (docs/decisions/time.md).
REDUCED_TIME = 0.4
EXTENDED = 2  # ratio of the steps to a preset's, where most are on reduced targets
RELOCATE_FROM = 0.2  # progress from which Gaussians are relocated
RELOCATE_UNTIL = 0.75  # progress until which Gaussians are relocated
RELOCATE_EVERY = 10  # steps from one relocation to the next
# Share of a long fit's steps from one relocation to the next, so that it relocates no more often
# than a short one (docs/decisions/time.md).
RELOCATE_SHARE = 0.05


def totals(
    schedule: str, gaussians: int, iterations: int | None, per_round: int | None = None
) -> list[int]:
    """Ascending numbers of Gaussians after each round of a fit of `gaussians` (>= 0).

    exponential: the total doubles in each round; linear: equal parts; all-at-once: one round.
    With per_round >= 1, as in the paper, round i = 0, 1, .. adds min(2^i, per_round) if the
    schedule is exponential and per_round if it is linear.
    Without per_round there are at most as many rounds as iterations. Raises InputError for
    per_round with all-at-once.
    """
    if per_round is not None:
        if schedule == "all-at-once":
            raise InputError(
                "schedule must be exponential or linear if per_round is given; got "
                f"{quoted(schedule)}"
            )
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
    """The factor by which width and height are divided in a round of so many Gaussians."""
    factor = 1
    while (
        factor < LARGEST_REDUCTION
        and width * height / (4 * factor**2 * gaussians) >= PIXELS_PER_GAUSSIAN
        and min(width, height) / (2 * factor) >= SMALLEST_SIDE
    ):
        factor *= 2
    return factor


def refinement_reduction(done: float, gaussians: int, width: int, height: int) -> int:
    """The factor by which width and height are divided in refinement at progress `done` in 0..1.

    Each of full_from and half_from that is still ahead halves the picture once more, as long as
    each Gaussian keeps 36 pixels.
    """
    factor = 1
    for until in (FULL_FROM, HALF_FROM):
        pixels = width * height / (4 * factor**2 * max(gaussians, 1))
        fits = min(width, height) / (2 * factor) >= SMALLEST_REFINED_SIDE
        if done < until and pixels >= PIXELS_PER_GAUSSIAN and fits:
            factor *= 2
    return factor


def enlarged_reduction(done: float, width: int, height: int) -> int:
    """Return the factor by which a fit to an enlarged picture divides width and height.

    All but the last steps run at half the size where that is as large as most pictures.
    """
    is_large = max(width, height) > LARGEST_UNREDUCED
    return 2 if is_large and done < QUANTIZED_FROM else 1


def relocates(done: float, iteration: int, sparsely: bool = False) -> bool:
    """Whether Gaussians are relocated before this step, at progress `done` in 0..1.

    sparsely  no more often in a long fit than in a short one
    """
    every = RELOCATE_EVERY
    if sparsely and done > RELOCATE_FROM:
        every = max(every, int(RELOCATE_SHARE * iteration / done))
    return RELOCATE_FROM < done < RELOCATE_UNTIL and iteration % every == 0


def rate(done: float) -> float:
    """Learning rate at progress `done` in 0..1, as a share in 0.02..1 of the full one."""
    start = DECAY_START
    if done < start:
        return 1.0
    fall = 0.5 * (1 + math.cos(math.pi * (done - start) / (1 - start)))
    return max(LAST_RATE, fall)


# Steps of a round of growth at most, in a fit that only time limits. The rest of the time is better
# spent once all Gaussians exist (docs/decisions/time.md).
MOST_STEPS_A_ROUND = 30


class Clock:
    """Progress in 0..1: growth, in at most `rounds` rounds, is 0..GROWTH_SHARE, then refinement.

    iterations        of both stages, or None for as many as the time allows
    deadline          returns the end of the fit, in s of time.perf_counter(), or None
    round_iterations  of each round of growth; None: growth takes GROWTH_SHARE of the iterations
    stop              polled at every step; once it returns True the fit ends
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
        self._begun = time.perf_counter()
        self.begin_refinement(None, 0.0)

    @property
    def elapsed_s(self) -> float:
        """Wall-clock seconds since the start of the fit, without pauses."""
        return time.perf_counter() - self._begun - self._paused_s

    @property
    def stopped(self) -> bool:
        """Whether the caller has asked the fit to stop."""
        self._stopped = self._stopped or self._stop()
        return self._stopped

    def round_is_over(self, index: int) -> bool:
        """Whether round `index` (0, 1, ...) of growth has used its steps or its time."""
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
        """Progress in 0..GROWTH_SHARE at the end of round `index`."""
        return GROWTH_SHARE * min((index + 1) / self._rounds, 1.0)

    def begin_refinement(self, steps: int | None, progress: float, reduced: bool = False) -> None:
        """Begin refinement: `steps` iterations, or the time left, take `progress` to 1.

        reduced: whether the first ones run on reduced pictures, which then get more of them.
        """
        self._from, self._reduced = progress, reduced
        self._first_step, self._steps, self._since_s = self.iteration, steps, self.elapsed_s

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Stop the clock inside: the end of the fit is as much later."""
        begun = time.perf_counter()
        yield
        self._paused_s += time.perf_counter() - begun

    def refinement_progress(self) -> float:
        """Progress of the fit during refinement; 1 ends it."""
        if self.stopped:
            return 1.0
        by_steps = 0.0
        if self._steps is not None:
            by_steps = (self.iteration - self._first_step) / self._steps if self._steps else 1.0
        by_time = self._share_of_time(self._since_s)
        if not self._reduced:
            self.out_of_time = by_time > by_steps
            return self._from + (1 - self._from) * min(max(by_steps, by_time), 1.0)
        # Steps on reduced pictures are many, and take little of the time.
        until = FULL_FROM
        steps, seconds = (
            self._from + (until - self._from) * share / reduced
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
        """Share of the time between so many elapsed seconds and the deadline that is over."""
        deadline = self._deadline()
        if deadline is None:
            return 0.0
        whole = deadline - self._begun - since_s
        return (self.elapsed_s - since_s) / whole if whole > 0 else 1.0
