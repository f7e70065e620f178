"""A guard against divergence, which rolls a fit back to its best state.

From there the fit continues in smaller steps. Detailed photos do not need it. Smooth images and
those of few pixels do, because a single step can undo nearly all progress
(docs/decisions/divergence.md, also for the constants).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Generic, TypeVar

NEGLIGIBLE = 1e-5  # mean squared error under which a fit cannot diverge: 50 dB
DIVERGED = 2.0  # ratio of a loss to the least since the last change, above which it has diverged
STALLED = 1.5  # ratio of a loss to the least of all, above which it has stalled
STALLED_STEPS = 25  # steps for which a loss may have stalled before it counts as diverged
# Ratio of a stage's last loss to its least, above which the stage returns to its best state.
WORSE_AT_END = 1.2
CEILING = 0.5  # share of a diverged rate to which the rate grows again
CEILING_AGAIN = 0.1  # that share if the loss diverges again within AGAIN steps
AGAIN = 3  # accepted steps below which a divergence counts as a repeated one
# Share of the ceiling at which steps begin after a rollback. They grow to the ceiling, so one bad
# step among many good ones costs little.
LOWERED = 0.5
GROWTH = 1.1  # ratio of a step's rate to the one before, up to the ceiling
GENTLE = 0.25  # share of the ceiling at which a finished fit continues

_State = TypeVar("_State")


class DivergenceGuard(Generic[_State]):
    """The best state of a fit since the last change of its problem, and the share of its rate.

    learning_rate  of FitOptions
    rate           the share of it that is in use
    best           the state of least loss, None before the first step
    least          its loss
    """

    def __init__(self, learning_rate: float = 1.0) -> None:
        self._usual = min(1 / learning_rate, 1.0)
        self.rate = self._ceiling = 1.0
        self.rollbacks = 0
        self._accepted = 0  # steps since the last rollback
        self.reset()

    def reset(self) -> None:
        """Forget the best state, for later losses are not comparable; steps may grow again."""
        self._ceiling = max(self._ceiling, min(self._ceiling / CEILING, self._usual))
        self.best: _State | None = None
        self.least = self._recent = math.inf
        self._since = 0  # steps since the best state

    def begin_gently(self) -> None:
        """Continue with small steps that grow: full ones undo a drawing that is nearly exact."""
        self.rate = min(self.rate, GENTLE * self._ceiling)

    def relocated(self) -> None:
        """Allow a larger loss after a relocation."""
        self._recent = math.inf

    def accepts(self, loss: float, error: float, copied: Callable[[], _State]) -> bool:
        """Whether a state of this loss and mean squared error is sound; keeps a copy of the best.

        copied  returns a copy of the state
        """
        if not math.isfinite(loss):
            return False
        self._since += 1
        self._accepted += 1
        stalled = loss > STALLED * self.least and self._since > STALLED_STEPS
        if error > NEGLIGIBLE and (loss > DIVERGED * self._recent or stalled):
            return False
        self._recent = min(self._recent, loss)
        self.rate = min(self.rate * GROWTH, self._ceiling)
        if loss < self.least:
            self.best, self.least, self._since = copied(), loss, 0
        return True

    def ends_worse(self, loss: float, tolerant: bool) -> bool:
        """Whether a stage that ends at this loss should return to its best state.

        tolerant: only where the loss is a fifth larger. Where steps were too large before, that
        counts as another rollback.
        """
        diverged = not loss <= WORSE_AT_END * self.least
        if diverged and (self._usual < 1 or self.rollbacks > 0):
            self.roll_back()
        if tolerant:
            return diverged
        return not loss <= self.least * (1 + 1e-6)  # rounding of a sum in another order

    def roll_back(self) -> None:
        """Count a rollback, and lower the rate and its ceiling."""
        self.rollbacks += 1
        again = self._accepted < AGAIN
        share = CEILING_AGAIN if again and self.rollbacks > 1 else CEILING
        # Steps far above the usual ones go half of the way back to those, in decades.
        self._ceiling = min(self.rate * share, math.sqrt(self.rate * self._usual))
        self._accepted = 0
        self.rate = self._ceiling * LOWERED
        self._recent, self._since = math.inf, 0
