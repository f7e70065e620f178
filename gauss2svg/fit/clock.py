"""How much of a fit is over: by iterations or by the wall clock, whichever is further."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from gauss2svg.errors import number_within, whole_number
from gauss2svg.fit.schedule import GROWTH_SHARE

# Where only time is limited, a round of growth takes no more steps than this: what is left
# is better spent where all Gaussians are there.
_MOST_STEPS_A_ROUND = 30
_MOST_STEPS = 10**9


class Clock:
    """Two stages: growth, in at most `rounds` rounds, is 0..GROWTH_SHARE; refinement the rest.

    iterations  of both stages, or None for as many as the time allows
    deadline    as time.perf_counter() counts, in s, or None; may be moved
    round_iterations  of each round of growth; None: growth has GROWTH_SHARE of all
    stop        asked at every question; once it is True all is over
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
        self.out_of_time = False
        self._stop = stop or (lambda: False)
        self._stopped = False

    @property
    def elapsed_s(self) -> float:
        """Wall-clock seconds since the beginning."""
        return time.perf_counter() - self._begun

    @property
    def stopped(self) -> bool:
        """Whether whoever runs the fit wants it to end."""
        self._stopped = self._stopped or self._stop()
        return self._stopped

    def round_is_over(self, index: int) -> bool:
        """Whether round `index` (0, 1, ...) of growth has had its steps or its time."""
        share = (index + 1) / self._rounds
        steps = _MOST_STEPS_A_ROUND * (index + 1)
        if self._round_iterations is not None:
            steps = self._round_iterations * (index + 1)
        elif self.iterations is not None:
            steps = int(self.iterations * GROWTH_SHARE) * (index + 1) // self._rounds
        late = self._time_share() >= GROWTH_SHARE * share
        return self.iteration >= steps or late or self.stopped

    @property
    def growth_is_late(self) -> bool:
        """Whether growth has had all its time."""
        return self._time_share() >= GROWTH_SHARE

    def growing(self, index: int) -> float:
        """Share done, in 0..GROWTH_SHARE, at the end of round `index`."""
        return GROWTH_SHARE * min((index + 1) / self._rounds, 1.0)

    def refine(self, steps: int | None, done: float) -> None:
        """From here on `steps` iterations, or the time left, take `done` to 1."""
        self._stage_first, self._stage_steps = self.iteration, steps
        self._stage_begun, self._from = time.perf_counter(), done

    def refining(self) -> float:
        """Share done, in `done`..1; 1 ends the fit."""
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
        return self._from + (1 - self._from) * min(max(by_steps, by_time), 1.0)

    def state_dict(self) -> dict[str, Any]:
        """What `load_state_dict` needs; a deadline is not part of it."""
        return {
            "iteration": self.iteration,
            "stage_first": self._stage_first,
            "stage_steps": self._stage_steps,
            "from": self._from,
            "elapsed_s": self.elapsed_s,
        }

    def load_state_dict(self, memory: dict[str, Any]) -> None:
        """Go on as a clock does that gave this memory; InputError for one that none can give."""
        most = _MOST_STEPS if self.iterations is None else self.iterations
        self.iteration = whole_number("iteration", memory["iteration"], 0, most)
        self._from = number_within("from", memory["from"], 0, 1)
        self._stage_first = whole_number("stage_first", memory["stage_first"], 0, self.iteration)
        steps = memory["stage_steps"]
        self._stage_steps = None if steps is None else whole_number("stage_steps", steps, 0, most)
        self._begun = time.perf_counter() - number_within("elapsed", memory["elapsed_s"], 0, 1e9)

    def _time_share(self) -> float:
        if self.deadline is None:
            return 0.0
        whole = self.deadline - self._begun
        return self.elapsed_s / whole if whole > 0 else 1.0
