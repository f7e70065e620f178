"""Progress of a fit, by iterations or by the wall clock, whichever is further."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gauss2svg.fit import schedule

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
        growth = schedule.GROWTH_SHARE
        steps = (self._round_iterations or MOST_STEPS_A_ROUND) * (index + 1)
        if self._round_iterations is None and self.iterations is not None:
            steps = int(self.iterations * growth) * (index + 1) // self._rounds
        late = self._share_of_time(0.0) >= growth * (index + 1) / self._rounds
        return self.iteration >= steps or late or self.stopped

    @property
    def growth_is_late(self) -> bool:
        """Whether growth has used its share of the time."""
        return self._share_of_time(0.0) >= schedule.GROWTH_SHARE

    def growth_progress(self, index: int) -> float:
        """Progress in 0..GROWTH_SHARE at the end of round `index`."""
        return schedule.GROWTH_SHARE * min((index + 1) / self._rounds, 1.0)

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
        until = schedule.FULL_FROM
        steps, seconds = (
            self._from + (until - self._from) * share / reduced
            if share < reduced
            else 1 - (1 - until) * (1 - share) / (1 - reduced)
            for share, reduced in (
                (by_steps, schedule.REDUCED_STEPS),
                (by_time, schedule.REDUCED_TIME),
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
