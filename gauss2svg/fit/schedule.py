"""The schedule of a fit: rounds of growth, reduced sizes, learning rates, and progress.

Progress is a number in 0..1. It is measured both by iterations and by the wall clock, and the
larger of the two values counts.
"""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

# Number of rounds of growth. Any number from 4 to 20 gives the same PSNR to within 0.1 dB
# (docs/decisions/fit.md).
ROUNDS = 6
GROWTH_SHARE = 0.3  # progress at which all Gaussians have been added (docs/decisions/fit.md)
# Progress at which the learning rate begins to fall along a cosine, and relocation ends
# (docs/decisions/fit.md).
DECAY_START = 0.75
FULL_FROM = 0.55  # progress from which targets have their full size (docs/decisions/few.md)
# Mean squared error (50 dB) up to which no step counts as diverged, and no Gaussian is relocated
# (docs/decisions/divergence.md).
NEGLIGIBLE = 1e-5


def doubled(gaussians: int, iterations: int) -> list[int]:
    """Return the number of Gaussians after each round, if each round doubles it.

    After the last round it is `gaussians`. There are at most ROUNDS rounds, and at most as many as
    iterations. If `gaussians` is 0, there are none.
    """
    halvings = range(min(ROUNDS, iterations))
    return sorted({math.ceil(gaussians * 0.5**k) for k in halvings} - {0})


def refinement_reduction(done: float, gaussians: int, width: int, height: int) -> int:
    """Return the number by which a target's width and height are divided in refinement.

    done: progress in 0..1.

    The number is at most 4 before a progress of 0.45, 2 until FULL_FROM, and 1 from FULL_FROM on.
    Steps on targets of less than 128 px a side would take no less time.
    """
    largest = 4 if done < 0.45 else 2 if done < FULL_FROM else 1
    return reduction(gaussians, width, height, largest, least_side=128)


def reduction(
    gaussians: int, width: int, height: int, largest: int = 8, least_side: int = 32
) -> int:
    """Return the divisor of a target's width and height, by default that of a round of growth.

    It is the largest one that leaves 36 pixels a Gaussian and a side of least_side px. Such targets
    save a fifth of the pixel-Gaussian pairs without a loss of PSNR.

    gaussians: number of Gaussians, in growth at the end of the round.
    """
    factor = 1
    while (
        factor < largest
        and width * height / (4 * factor**2 * max(gaussians, 1)) >= 36
        and min(width, height) / (2 * factor) >= least_side
    ):
        factor *= 2
    return factor


def relocates(done: float, iteration: int, rarely: bool = False) -> bool:
    """Return whether Gaussians are relocated before step `iteration`, at progress `done` in 0..1.

    rarely: whether the number of steps from one relocation to the next is at least a twentieth of
    the number of all steps, as long fits need it (docs/decisions/time.md).
    """
    every = max(10, int(0.05 * iteration / done)) if rarely and done > 0 else 10
    return 0.2 < done < DECAY_START and iteration % every == 0


def rate(done: float) -> float:
    """Return the factor in 0.02..1 by which the learning rate is multiplied.

    done: progress in 0..1.
    """
    from gauss2svg import portable  # imported here because --help does not load NumPy

    if done < DECAY_START:
        return 1.0
    return max(0.02, 0.5 * (1 + portable.cos(math.pi * (done - DECAY_START) / (1 - DECAY_START))))


class Clock:
    """A clock of the progress of a fit in 0..1.

    Growth takes the progress from 0 to GROWTH_SHARE, and refinement takes it to 1.

    iterations        number of steps in growth and refinement together
    rounds            largest number of rounds of growth
    deadline          function that returns the time in s of time.perf_counter() at which the fit
                      must end. It is infinite if no time limits the fit
    round_iterations  number of steps in each round. If it is None, the rounds share the first
                      GROWTH_SHARE of the iterations equally
    stop              function that is called at every step. The fit ends when it returns True, and
                      it must return True from then on
    """

    def __init__(
        self,
        iterations: int,
        rounds: int,
        deadline: Callable[[], float] = lambda: math.inf,
        round_iterations: int | None = None,
        stop: Callable[[], bool] = lambda: False,
    ) -> None:
        self.iterations, self.iteration, self.out_of_time = iterations, 0, False
        self._rounds, self._round_iterations = max(rounds, 1), round_iterations
        self._deadline, self.stopped = deadline, stop
        self._started_s, self._paused_s = time.perf_counter(), 0.0
        self.begin_refinement(iterations, 0.0)

    @property
    def elapsed_s(self) -> float:
        """Wall-clock seconds since the start of the fit, without the latest `paused` blocks.

        The latest blocks are those since begin_refinement was last called. The time of earlier
        blocks is included.
        """
        return time.perf_counter() - self._started_s - self._paused_s

    def round_is_over(self, index: int) -> bool:
        """Return whether round `index` (0, 1, ...) of growth has used up its steps or its time."""
        steps = int(self.iterations * GROWTH_SHARE) * (index + 1) // self._rounds
        if self._round_iterations is not None:
            steps = self._round_iterations * (index + 1)
        late = self.share_of_time() >= GROWTH_SHARE * (index + 1) / self._rounds
        return self.iteration >= steps or late or self.stopped()

    def growth_progress(self, index: int) -> float:
        """Return the progress in 0..GROWTH_SHARE at the end of round `index` of growth."""
        return GROWTH_SHARE * min((index + 1) / self._rounds, 1.0)

    def begin_refinement(self, steps: int, progress: float, reduced: bool = False) -> None:
        """Begin refinement at `progress`. It ends after `steps` iterations or at the deadline.

        reduced: whether refinement begins on smaller copies of the picture, and takes most of its
        steps on them.
        """
        self._start, self._reduced = progress, reduced
        # From now on, elapsed_s includes the pauses so far. If it did not, refinement would end
        # after the deadline.
        self._paused_s = 0.0
        self._first_step, self._steps, self._start_s = self.iteration, steps, self.elapsed_s

    @contextmanager
    def paused(self) -> Iterator[None]:
        """Stop the clock during the `with` block.

        So the block takes no time from the present refinement. When a later refinement begins, the
        clock is set forward by the time of the block.
        """
        started_s = time.perf_counter()
        yield
        self._paused_s += time.perf_counter() - started_s

    def refinement_progress(self) -> float:
        """Return the progress during refinement, which is 1 at its end.

        Also set `out_of_time` to whether progress measured by time is larger than progress measured
        by iterations.
        """
        if self.stopped():
            return 1.0
        by_steps = (self.iteration - self._first_step) / self._steps if self._steps > 0 else 1.0
        by_time = self.share_of_time(self._start_s)
        if not self._reduced:
            self.out_of_time = by_time > by_steps
            return self._start + (1 - self._start) * min(max(by_steps, by_time), 1.0)
        # 72 % of the steps run on reduced pictures. They take 40 % of the time
        # (docs/decisions/few.md, docs/decisions/time.md).
        steps, seconds = (
            self._start + (FULL_FROM - self._start) * share / reduced
            if share < reduced
            else 1 - (1 - FULL_FROM) * (1 - share) / (1 - reduced)
            for share, reduced in ((by_steps, 0.72), (by_time, 0.4))
        )
        self.out_of_time = seconds > steps
        return min(max(steps, seconds), 1.0)

    def share_of_time(self, since_s: float = 0.0) -> float:
        """Return which share of the time from `since_s` to the deadline has passed.

        `since_s` is an earlier value of `elapsed_s`. If there is no deadline, the share is 0.
        """
        whole = self._deadline() - self._started_s - since_s
        return (self.elapsed_s - since_s) / whole if whole > 0 else 1.0


class DivergenceGuard:
    """A guard that keeps a fit's best state, and lowers the learning rate if the fit diverges.

    A fit has diverged if its loss is not finite, or is twice the least loss since the latest of
    three events: a reset, a relocation, or a rollback (docs/decisions/divergence.md).

    learning_rate  FitOptions.learning_rate
    rate           factor, at most 1, by which learning_rate is multiplied at present
    rollbacks      number of rollbacks so far
    best           copy of the state with the least loss since the last reset. It is None until a
                   step after the reset has been accepted
    least          loss of the state `best`
    """

    def __init__(self, learning_rate: float = 1.0) -> None:
        # With this rate, steps are as large as with the default learning_rate.
        self._default_rate = min(1 / learning_rate, 1.0)
        self.rate = self._ceiling = 1.0
        self.rollbacks = 0
        self.reset()

    def reset(self) -> None:
        """Forget the best state, because the problem has changed. Double the ceiling of the rate.

        But the ceiling never rises above the rate that gives steps of the same size as the default
        learning_rate gives.
        """
        self._ceiling = max(self._ceiling, min(self._ceiling * 2, self._default_rate))
        self.best: Any = None
        self.least = self._recent_least = math.inf

    def begin_gently(self) -> None:
        """Lower the rate to at most a quarter of its ceiling.

        The drawing is nearly exact already, so full steps would spoil it. The next steps raise the
        rate again.
        """
        self.rate = min(self.rate, 0.25 * self._ceiling)

    def allow_rise(self) -> None:
        """Forget the recent least loss, because a relocation may raise the loss for a while."""
        self._recent_least = math.inf

    def observe(self, loss: float, error: float, backup: Callable[[], Any]) -> bool:
        """Take note of the loss and mean squared error of a step, and return whether it is sound.

        A step is not sound if the fit has diverged. If the step is sound, raise the rate. If its
        loss is also the least so far, keep the copy of the state that backup() returns.
        """
        if not math.isfinite(loss) or (error > NEGLIGIBLE and loss > 2 * self._recent_least):
            return False
        self._recent_least = min(self._recent_least, loss)
        self.rate = min(self.rate * 1.1, self._ceiling)
        if loss < self.least:
            self.best, self.least = backup(), loss
        return True

    def roll_back(self) -> None:
        """Count a rollback, and lower the rate and its ceiling.

        From half of the ceiling the rate grows to it, so one bad step among many good ones costs
        little. A rate above the default rate falls to it.
        """
        self.rollbacks += 1
        is_large = self.rate > self._default_rate
        self._ceiling = self._default_rate if is_large else self.rate / 2
        self.rate = self._ceiling / 2
        self._recent_least = math.inf
