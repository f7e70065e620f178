"""Guard against divergence: a fit rolls back to its best state and continues in smaller steps.

Detailed photos do not need it; smooth images and those of few pixels do, where a single step can
undo nearly all progress. docs/decisions/divergence.md has the measurements.
"""

from __future__ import annotations

import math

from gauss2svg.fit.shared import SharedColors
from gauss2svg.fit.state import State

# Mean squared error under which a fit cannot diverge: 50 dB.
NEGLIGIBLE = 1e-5
# Mean squared error that no step can improve: 120 dB, at which no pixel of a million is off by half
# a level. Adam would take full steps all the same.
EXACT = 1e-12


# Divergence, and the steps after it (docs/decisions/divergence.md).
# After a rollback steps begin small, at lowered times ceiling of those that diverged, and grow to
# the ceiling, so one bad step among many good ones costs little.
DIVERGED = 2.0  # ratio of a loss to the least since the last change, above which it has diverged
STALLED = 1.5  # ratio of a loss to the least of all, above which it has stalled
STALLED_STEPS = 25  # steps for which a loss may have stalled before it counts as diverged
# Ratio of a stage's last loss to its least, above which the stage returns to its best state.
WORSE_AT_END = 1.2
CEILING = 0.5  # share of a diverged rate to which the rate grows again
CEILING_AGAIN = 0.1  # that share if the loss diverges again within AGAIN steps
AGAIN = 3  # accepted steps below which a divergence counts as a repeated one
LOWERED = 0.5  # share of the ceiling at which steps begin after a rollback
GROWTH = 1.1  # ratio of a step's rate to the one before, up to the ceiling
GENTLE = 0.25  # share of the ceiling at which a finished fit continues


class DivergenceGuard:
    """The best state of a fit so far, and how far its learning rate has been lowered.

    `reset` belongs to changes of the problem (another size or number of Gaussians, shared colours),
    `relocated` to changes of the state alone. learning_rate is that of FitOptions; rate is the
    share of it that is in use, least the loss of the best state.
    """

    def __init__(self, learning_rate: float = 1.0) -> None:
        self._usual = min(1 / learning_rate, 1.0)
        self.rate = self._ceiling = 1.0
        self.rollbacks = 0
        self._state: State | None = None  # the best one, and its shared colours
        self._shared: SharedColors | None = None
        self.least = self._recent = math.inf
        self._since = 0  # steps since the best state
        self._accepted = 0  # steps since the last rollback

    def reset(self) -> None:
        """Forget the best state, for later losses are not comparable; steps may grow again."""
        self._ceiling = max(self._ceiling, min(self._ceiling / CEILING, self._usual))
        self._state = self._shared = None
        self.least, self._recent, self._since = math.inf, math.inf, 0

    def begin_gently(self) -> None:
        """Continue with small steps that grow: full ones undo a drawing that is nearly exact."""
        self.rate = min(self.rate, GENTLE * self._ceiling)

    def relocated(self) -> None:
        """Allow a larger loss after a relocation."""
        self._recent = math.inf

    def accepts(self, loss: float, error: float, state: State, shared: SharedColors | None) -> bool:
        """Whether a state of this loss and mean squared error is sound; keeps the best one."""
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
            self.least, self._since = loss, 0
            self._state, self._shared = state.copy(), None if shared is None else shared.copy()
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

    def roll_back(self) -> tuple[State, SharedColors | None] | None:
        """The best state, from which to continue in smaller steps; None if there is none."""
        self.rollbacks += 1
        again = self._accepted < AGAIN
        share = CEILING_AGAIN if again and self.rollbacks > 1 else CEILING
        # Steps far above the usual ones go half of the way back to those, in decades.
        self._ceiling = min(self.rate * share, math.sqrt(self.rate * self._usual))
        self._accepted = 0
        self.rate = self._ceiling * LOWERED
        self._recent, self._since = math.inf, 0
        return self.best()

    def best(self) -> tuple[State, SharedColors | None] | None:
        """A copy of the best state and its shared colours."""
        if self._state is None:
            return None
        return self._state.copy(), None if self._shared is None else self._shared.copy()
