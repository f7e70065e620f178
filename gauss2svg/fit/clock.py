"""Progress of a fit, by iterations or by the wall clock, whichever is further."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gauss2svg.fit import schedule

# The clock of a fit that only time limits (docs/decisions/time.md).
# Steps of a round of growth at most. The rest of the time is better spent once all Gaussians
# exist.
MOST_STEPS_A_ROUND = 30


class Clock:
    """Progress in 0..1: growth, in at most `rounds` rounds, is 0..GROWTH_SHARE, then refinement.

    iterations        of both stages, or None for as many as the time allows
    deadline          in s of time.perf_counter(), or None; may be moved
    round_iterations  of each round of growth; None: growth takes GROWTH_SHARE of the iterations
    stop              polled at every step; once it returns True the fit ends
    """

    def __init__(
        self,
        iterations: int | None,
        rounds: int,
        deadline: float | None,
        round_iterations: int | None = None,
        stop: Callable[[], bool] | None = None,
    ) -> None:
        self.iterations = iterations
        self.deadline = deadline
        self.iteration = 0
        self._rounds = max(rounds, 1)
        self._round_iterations = round_iterations
        self._begun = self._stage_begun = time.perf_counter()
        self._stage_first = 0
        self._stage_steps: int | None = None
        self._from = 0.0
        self._reduced = False
        self.out_of_time = False
        self._stop = stop or (lambda: False)
        self._stopped = False

    @property
    def elapsed_s(self) -> float:
        """Wall-clock seconds since the start of the fit."""
        return time.perf_counter() - self._begun

    @property
    def stopped(self) -> bool:
        """Whether the caller has asked the fit to stop."""
        self._stopped = self._stopped or self._stop()
        return self._stopped

    def round_is_over(self, index: int) -> bool:
        """Whether round `index` (0, 1, ...) of growth has used its steps or its time."""
        growth, share = schedule.GROWTH_SHARE, (index + 1) / self._rounds
        steps = MOST_STEPS_A_ROUND * (index + 1)
        if self._round_iterations is not None:
            steps = self._round_iterations * (index + 1)
        elif self.iterations is not None:
            steps = int(self.iterations * growth) * (index + 1) // self._rounds
        late = self._time_share() >= growth * share
        return self.iteration >= steps or late or self.stopped

    @property
    def growth_is_late(self) -> bool:
        """Whether growth has used its share of the time."""
        return self._time_share() >= schedule.GROWTH_SHARE

    def growth_progress(self, index: int) -> float:
        """Progress in 0..GROWTH_SHARE at the end of round `index`."""
        return schedule.GROWTH_SHARE * min((index + 1) / self._rounds, 1.0)

    def begin_refinement(self, steps: int | None, progress: float, reduced: bool = False) -> None:
        """Begin refinement: `steps` iterations, or the time left, take `progress` to 1.

        reduced: whether the first ones run on reduced pictures, which then get more of them.
        """
        self._reduced = reduced
        self._stage_first, self._stage_steps = self.iteration, steps
        self._stage_begun, self._from = time.perf_counter(), progress

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Stop the clock inside: the end of the fit is as much later."""
        begun = time.perf_counter()
        yield
        taken = time.perf_counter() - begun
        self._begun, self._stage_begun = self._begun + taken, self._stage_begun + taken
        if self.deadline is not None:
            self.deadline += taken

    def refinement_progress(self) -> float:
        """Progress of the fit during refinement; 1 ends it."""
        if self.stopped:
            return 1.0
        by_steps = 0.0
        if self._stage_steps is not None:
            taken = self.iteration - self._stage_first
            by_steps = taken / self._stage_steps if self._stage_steps else 1.0
        by_time = 0.0
        if self.deadline is not None:
            now = time.perf_counter()
            left = self.deadline - self._stage_begun
            by_time = (now - self._stage_begun) / left if left > 0 else 1.0
        self.out_of_time = by_time > by_steps
        if not self._reduced:
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

    def _time_share(self) -> float:
        if self.deadline is None:
            return 0.0
        whole = self.deadline - self._begun
        return self.elapsed_s / whole if whole > 0 else 1.0


class Stopwatch:
    """Wall-clock and CPU seconds, of all threads, that its with statements have taken."""

    def __init__(self) -> None:
        self.wall_s = self.cpu_s = 0.0

    def __enter__(self) -> None:
        self._begun = time.perf_counter(), time.process_time()

    def __exit__(self, *_: object) -> None:
        self.wall_s += time.perf_counter() - self._begun[0]
        self.cpu_s += time.process_time() - self._begun[1]
