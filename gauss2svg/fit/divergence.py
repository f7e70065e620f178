"""A guard against divergence, which rolls a fit back to its best state.

The fit then continues in smaller steps. Detailed photos do not need it. Smooth images and images
of few pixels do, because a single step can undo nearly all progress. Constants are from
docs/decisions/divergence.md.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Generic, TypeVar

NEGLIGIBLE = 1e-5  # mean squared error under which a fit cannot diverge: 50 dB
# Ratio of a loss to the least since the last change, relocation or rollback, above which it has
# diverged.
DIVERGED = 2.0
STALLED = 1.5  # ratio of a loss to the least one, above which it has stalled
STALLED_STEPS = 25  # steps since the least loss after which a stalled loss has diverged
# Ratio of a stage's last loss to its least, above which the stage returns to its best state.
WORSE_AT_END = 1.2
CEILING = 0.5  # share of a diverged rate to which the rate grows again
CEILING_AGAIN = 0.1  # this share if the loss diverges again within AGAIN steps
AGAIN = 3  # number of accepted steps below which a divergence is a repeated one
# Share of the ceiling at which steps begin after a rollback. They grow to the ceiling, so one bad
# step among many good ones costs little.
LOWERED = 0.5
GROWTH = 1.1  # ratio of a step's rate to that of the step before, up to the ceiling
GENTLE = 0.25  # share of the ceiling at which a finished fit continues

_State = TypeVar("_State")


class DivergenceGuard(Generic[_State]):
    """A fit's best state since the last change of its problem, and the share of its learning rate.

    learning_rate  FitOptions.learning_rate
    rate           share of learning_rate that is in use
    rollbacks      number of rollbacks
    best           state of least loss; None before the first step
    least          its loss
    """

    def __init__(self, learning_rate: float = 1.0) -> None:
        self._usual = min(1 / learning_rate, 1.0)  # rate of the default learning rate
        self.rate = self._ceiling = 1.0
        self.rollbacks = 0
        self._accepted = 0  # steps since the last rollback
        self.reset()

    def reset(self) -> None:
        """Forget the best state, because the problem has changed, and let steps grow again."""
        self._ceiling = max(self._ceiling, min(self._ceiling / CEILING, self._usual))
        self.best: _State | None = None
        self.least = self._recent_least = math.inf
        self._steps_since_best = 0

    def begin_gently(self) -> None:
        """Continue with small steps that grow. Full ones undo a drawing that is nearly exact."""
        self.rate = min(self.rate, GENTLE * self._ceiling)

    def relocated(self) -> None:
        """Allow a larger loss after a relocation."""
        self._recent_least = math.inf

    def accepts(self, loss: float, error: float, backup: Callable[[], _State]) -> bool:
        """Return whether a state of this loss and mean squared error is sound; back up the best.

        backup  returns a copy of the state
        """
        if not math.isfinite(loss):
            return False
        self._steps_since_best += 1
        self._accepted += 1
        stalled = loss > STALLED * self.least and self._steps_since_best > STALLED_STEPS
        if error > NEGLIGIBLE and (loss > DIVERGED * self._recent_least or stalled):
            return False
        self._recent_least = min(self._recent_least, loss)
        self.rate = min(self.rate * GROWTH, self._ceiling)
        if loss < self.least:
            self.best, self.least, self._steps_since_best = backup(), loss, 0
        return True

    def ends_worse(self, loss: float, tolerant: bool) -> bool:
        """Return whether a stage that ends at this loss should return to its best state.

        tolerant: whether it should only if the loss is a fifth larger than the best one.
        Such a loss counts as another rollback if steps were too large before.
        """
        diverged = not loss <= WORSE_AT_END * self.least
        if diverged and (self._usual < 1 or self.rollbacks > 0):
            self.roll_back()
        if tolerant:
            return diverged
        return not loss <= self.least * (1 + 1e-6)  # sums in another order are rounded otherwise

    def roll_back(self) -> None:
        """Count a rollback, and lower the rate and its ceiling."""
        self.rollbacks += 1
        again = self._accepted < AGAIN
        share = CEILING_AGAIN if again and self.rollbacks > 1 else CEILING
        # A rate far above the usual one goes back half of the way, on a logarithmic scale.
        self._ceiling = min(self.rate * share, math.sqrt(self.rate * self._usual))
        self._accepted = 0
        self.rate = self._ceiling * LOWERED
        self._recent_least, self._steps_since_best = math.inf, 0
