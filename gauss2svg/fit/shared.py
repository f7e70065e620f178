"""Colours that several shapes share, as those of a file: one Adam step for each, and reassignment.

Steps by the summed gradient of a colour's shapes, and shapes that may change to another colour,
win back part of what a palette costs: docs/decisions/adam.md.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, must_be, shown, whole_number
from gauss2svg.fit.adam import FIRST_DECAY, SECOND_DECAY
from gauss2svg.fit.blending import Blending
from gauss2svg.fit.state import COLOR, State
from gauss2svg.fit.target import Target
from gauss2svg.render.cpu import Splats
from gauss2svg.scene.nearest import nearest_entry

# Adam's learning rate; fits from 0.002 to 0.015 end within 0.01 dB.
_RATE = 0.006
_APART = 100.0  # distance of a unit of ln beta, beside colours in 0..1: exponents never change
_LEAST_MASS = 1e-3  # px; shapes that contribute less keep their colour


class SharedColors:
    """The distinct pairs of a colour and an exponent in a state, and which one each shape has."""

    def __init__(self, state: State, blending: Blending) -> None:
        self._blending = blending
        keys = np.column_stack([state.color, state.raw_beta])
        shared, entry = np.unique(keys, axis=0, return_inverse=True)
        self._color, self._raw_beta = shared[:, :3].copy(), shared[:, 3]
        self.entry: NDArray[np.intp] = entry.reshape(-1)
        self._first, self._second = np.zeros_like(self._color), np.zeros_like(self._color)
        self._age = 0

    def copy(self) -> SharedColors:
        """A copy that shares no array with this one."""
        return SharedColors.from_state_dict(
            {name: np.copy(value) for name, value in self.state_dict().items()}, self._blending
        )

    def state_dict(self) -> dict[str, Any]:
        """What `from_state_dict` needs, for a checkpoint."""
        return {
            "color": self._color,
            "raw_beta": self._raw_beta,
            "entry": self.entry,
            "first": self._first,
            "second": self._second,
            "age": self._age,
        }

    @classmethod
    def from_state_dict(cls, arrays: dict[str, Any], blending: Blending) -> SharedColors:
        """The colours of a state_dict(); raises InputError for arrays that cannot be theirs."""
        count = len(arrays["raw_beta"])
        for name in ("color", "raw_beta", "first", "second"):
            shape = (count,) if name == "raw_beta" else (count, 3)
            array = arrays[name]
            if array.shape != shape or not np.isfinite(array).all():
                raise _damaged(name, f"finite {shape}", f"an array {array.shape}")
        entry = arrays["entry"]
        is_index = entry.dtype == np.intp and entry.ndim == 1
        if not is_index or (entry < 0).any() or (entry >= count).any():
            raise _damaged("entry", f"indices under {count}", f"{entry.dtype} {entry.shape}")
        whole_number("age", arrays["age"], 0, 10**9)
        shared = cls(State.empty(), blending)
        shared._color, shared._raw_beta = arrays["color"], arrays["raw_beta"]
        shared.entry, shared._age = arrays["entry"], int(arrays["age"])
        shared._first, shared._second = arrays["first"], arrays["second"]
        return shared

    def step(self, state: State, gradient: NDArray[np.float64], rate: float) -> None:
        """One Adam step by the gradient (n, PARAMETERS), summed over each colour's shapes.

        rate is a factor of the learning rate; the new colours are written to state.color.
        """
        columns = gradient[:, COLOR].T
        count = len(self._color)
        summed = np.stack([np.bincount(self.entry, column, count) for column in columns], axis=1)
        self._age += 1
        self._first += (1 - FIRST_DECAY) * (summed - self._first)
        self._second += (1 - SECOND_DECAY) * (summed * summed - self._second)
        first = self._first / (1 - FIRST_DECAY**self._age)
        second = self._second / (1 - SECOND_DECAY**self._age)
        moved = self._color - _RATE * rate * first / (np.sqrt(second) + 1e-12)
        self._color = np.clip(moved, self._blending.least_color, self._blending.most_color)
        self.assign(state, self.entry)

    def assign(self, state: State, entry: NDArray[np.intp]) -> None:
        """Give every shape of the state the shared colour of its entry (n,)."""
        self.entry = entry
        state.color = self._color[entry]

    def exchange(
        self,
        state: State,
        splats: Callable[[], Splats],
        target: Target,
        rng: np.random.Generator,
    ) -> None:
        """Reassign shapes to the shared colour that suits them best, if that lowers the error.

        Overlapping shapes that change together may overshoot: then only half of them change, or
        none. splats() returns those of the state as it is.
        """
        before, moments = target.squares(splats())
        mass = target.removal_cost(splats())[1][:, 1]
        kept, wanted = self.entry, self.wanted(state, moments, mass)
        half = np.where(rng.random(len(kept)) < 0.5, wanted, kept)
        for entry in (wanted, half, kept):
            self.assign(state, entry)
            if entry is kept or target.squares(splats())[0] < before:
                break

    def wanted(
        self, state: State, gradient: NDArray[np.float64], mass: NDArray[np.float64]
    ) -> NDArray[np.intp]:
        """(n,) the entry of the same exponent that would give each shape the least error.

        With all others fixed, half the squared error of the picture changes by g d + mass d^2 / 2
        for a change d of a colour, where g is its gradient, columns COLOR of gradient (n, ...), and
        mass (n,) the sum of the shape's squared weights. So the best colour is color - g / mass.
        """
        divisor = np.maximum(mass, _LEAST_MASS)[:, None]
        best = np.where(mass[:, None] > _LEAST_MASS, gradient[:, COLOR] / divisor, 0.0)
        entries = np.column_stack([self._color, _APART * self._raw_beta])
        targets = np.column_stack([state.color - best, _APART * state.raw_beta])
        distance, entry = nearest_entry(entries, targets)
        return np.where(distance < _APART * 0.1, entry, self.entry)


def _damaged(name: str, needed: str, got: str) -> InputError:
    name = f"{name} of the checkpoint's shared colours"
    return InputError(must_be(name, needed, shown(got), "starting the fit again"))
