"""What keeps a fit from running away: it goes back to its best state with smaller steps.

Photos of many details do not need it: at the usual rates, on Kodak 04, 13 and 20 with 300, 1000
and 3000 shapes, the squared error never grew by more than 1.6 times over the least since the last
change, save for one sum of 18 fits (2.4 times, once). Smooth pictures and those of few pixels do,
where a step can undo nearly all that was reached. `python examples/stability.py` prints what fits
reach by the size of their steps; the README has the table.
"""

from __future__ import annotations

import math
from typing import Any

from gauss2svg.errors import number_within, whole_number
from gauss2svg.fit.blending import Blending
from gauss2svg.fit.shared import SharedColors
from gauss2svg.fit.state import State

# A loss that is so many times the least since the last change has run away; so has one that
# is so many times the least of all after so many steps that brought nothing better, and one
# that is so many times the least when a stage ends.
_RUN_AWAY = 2.0
_LOST, _LOST_STEPS = 1.5, 25
_LEFT_BEHIND = 1.2
_ROUNDING = 1 + 1e-6  # of a loss that is summed in another order
# Mean squared error under which nothing does: 50 dB.
_NEGLIGIBLE = 1e-5
# After going back steps begin at a quarter of those that ran away and grow to half of them: one
# bad step among many good ones, such as the first of shapes that overlap, costs little then.
# Where the next few steps run away as well, they become a tenth.
_CEILING, _LOWERED, _GROWTH = 0.5, 0.5, 1.1
_AGAIN, _CEILING_AGAIN = 3, 0.1


class DivergenceGuard:
    """The best state of a fit so far, and how much smaller its steps have become.

    A change of the problem (another picture, another number of Gaussians, colours that are
    shared) begins anew; a relocation is a change of the state alone. learning_rate is what steps
    are asked to be, as a multiple of the usual ones, rate what they are, as a share of that.
    """

    def __init__(self, learning_rate: float = 1.0) -> None:
        self._usual = min(1 / learning_rate, 1.0)
        self.rate = self._ceiling = 1.0
        self.rollbacks = 0
        self._best: tuple[State, SharedColors | None] | None = None
        self._least = self._recent = math.inf
        self._since = 0  # steps since the best state
        self._accepted = 0  # since going back

    def begin(self) -> None:
        """Forget the best state: losses to come are not comparable, and steps may be larger."""
        self._ceiling = max(self._ceiling, min(self._ceiling / _CEILING, self._usual))
        self._best, self._least, self._recent, self._since = None, math.inf, math.inf, 0

    def moved(self) -> None:
        """Gaussians were relocated: the next loss may be larger."""
        self._recent = math.inf

    def accepts(self, loss: float, error: float, state: State, shared: SharedColors | None) -> bool:
        """Whether to go on from a state of this loss and mean squared error; keeps it if best."""
        if not math.isfinite(loss):
            return False
        self._since += 1
        self._accepted += 1
        is_lost = loss > _LOST * self._least and self._since > _LOST_STEPS
        if error > _NEGLIGIBLE and (loss > _RUN_AWAY * self._recent or is_lost):
            return False
        self._recent = min(self._recent, loss)
        self.rate = min(self.rate * _GROWTH, self._ceiling)
        if loss < self._least:
            self._least, self._since = loss, 0
            self._best = state.copy(), None if shared is None else shared.copy()
        return True

    def is_worse(self, loss: float, far: bool) -> bool:
        """Whether a stage should not end at this loss, but at its best state; far: by a fifth.

        Where steps were too large before, it is one more time that the fit ran away.
        """
        left_behind = not loss <= _LEFT_BEHIND * self._least
        if left_behind and (self._usual < 1 or self.rollbacks > 0):
            self.back()
        return left_behind if far else not loss <= self._least * _ROUNDING

    def back(self) -> tuple[State, SharedColors | None] | None:
        """The best state, from which to go on in smaller steps; None where none was good."""
        self.rollbacks += 1
        again = self._accepted < _AGAIN
        self._ceiling = self.rate * (_CEILING_AGAIN if again and self.rollbacks > 1 else _CEILING)
        self._accepted = 0
        self.rate = self._ceiling * _LOWERED
        self._recent, self._since = math.inf, 0
        return self.best()

    def best(self) -> tuple[State, SharedColors | None] | None:
        """A copy of the best state, with the colours that it shares."""
        if self._best is None:
            return None
        state, shared = self._best
        return state.copy(), None if shared is None else shared.copy()

    def state_dict(self) -> dict[str, Any]:
        """What `load_state_dict` needs."""
        state, shared = self._best or (None, None)
        return {
            "rate": self.rate,
            "ceiling": self._ceiling,
            "rollbacks": self.rollbacks,
            "least": self._least,
            "recent": self._recent,
            "since": self._since,
            "accepted": self._accepted,
            "state": None if state is None else state.state_dict(),
            "shared": None if shared is None else shared.state_dict(),
        }

    def load_state_dict(self, memory: dict[str, Any], blending: Blending) -> None:
        """Become as one was that gave this memory; raises InputError for what none can give."""
        self.rate = number_within("rate", memory["rate"], 0, 1)
        self.rollbacks = whole_number("rollbacks", memory["rollbacks"], 0, 10**9)
        self._ceiling = number_within("ceiling", memory["ceiling"], 0, 1)
        self._least = number_within("least", memory["least"], -math.inf, math.inf)
        self._recent = number_within("recent", memory["recent"], -math.inf, math.inf)
        self._since = whole_number("since", memory["since"], 0, 10**9)
        self._accepted = whole_number("accepted", memory["accepted"], 0, 10**9)
        self._best = None
        if memory["state"] is not None:
            shared = memory["shared"]
            self._best = (
                State.from_state_dict(memory["state"]),
                None if shared is None else SharedColors.from_state_dict(shared, blending),
            )

    @property
    def least(self) -> float:
        """Loss of the best state; infinite where there is none."""
        return self._least
