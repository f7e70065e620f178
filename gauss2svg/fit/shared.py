"""Colours that shapes share once they are those of a file: stepped as one, and exchanged.

What sharing costs, at 5000 shapes of the eight Kodak photos with 770 pairs of a colour and an
exponent, PSNR of the drawn SVG in dB; with every colour 33.06 is reached:

    colours as the palette had them                   32.87
    stepped by the sum of their shapes' gradients     32.90
    and shapes may change to another colour           32.92
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from gauss2svg.errors import InputError, whole_number
from gauss2svg.fit.adam import FIRST_DECAY, SECOND_DECAY
from gauss2svg.fit.blending import Blending
from gauss2svg.fit.state import COLOR, State
from gauss2svg.fit.target import Target
from gauss2svg.render.cpu import Splats

# Adam's step size; 0.002 to 0.015 end within 0.01 dB.
_RATE = 0.006
_APART = 100.0  # between exponents, beside colours in 0..1: none is exchanged for another
_LEAST_MASS = 1e-3  # px; shapes that show less keep their colour


class SharedColors:
    """The distinct pairs of a colour and an exponent in a state, and which one each shape has."""

    def __init__(self, state: State, blending: Blending) -> None:
        self._manner = blending
        keys = np.column_stack([state.color, state.raw_beta])
        shared, entry = np.unique(keys, axis=0, return_inverse=True)
        self._color, self._raw_beta = shared[:, :3].copy(), shared[:, 3]
        self.entry: NDArray[np.intp] = entry.reshape(-1)
        self._first, self._second = np.zeros_like(self._color), np.zeros_like(self._color)
        self._age = 0

    def copy(self) -> SharedColors:
        """The same, which steps of this one leave alone."""
        return SharedColors.from_state_dict(
            {name: np.copy(value) for name, value in self.state_dict().items()}, self._manner
        )

    def state_dict(self) -> dict[str, Any]:
        """What `recalled` needs, for a checkpoint."""
        return {
            "color": self._color,
            "raw_beta": self._raw_beta,
            "entry": self.entry,
            "first": self._first,
            "second": self._second,
            "age": self._age,
        }

    @classmethod
    def from_state_dict(cls, memory: dict[str, Any], blending: Blending) -> SharedColors:
        """Those that gave this memory; raises InputError for arrays that cannot be theirs."""
        count = len(memory["raw_beta"])
        for name in ("color", "raw_beta", "first", "second"):
            wide = (count,) if name == "raw_beta" else (count, 3)
            if memory[name].shape != wide or not np.isfinite(memory[name]).all():
                raise InputError(f"{name} of a checkpoint's shared colours is none; begin anew")
        entry = memory["entry"]
        known = entry.dtype == np.intp and entry.ndim == 1
        if not known or (entry < 0).any() or (entry >= count).any():
            raise InputError("entry of a checkpoint's shared colours is none; begin anew")
        whole_number("age", memory["age"], 0, 10**9)
        shared = cls(State.empty(), blending)
        shared._color, shared._raw_beta = memory["color"], memory["raw_beta"]
        shared.entry, shared._age = memory["entry"], int(memory["age"])
        shared._first, shared._second = memory["first"], memory["second"]
        return shared

    def step(self, state: State, gradient: NDArray[np.float64], rate: float) -> None:
        """One Adam step by the gradient (n, PARAMETERS), summed over each colour's shapes.

        rate is the share of the full step size; the colours go into state.color.
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
        self._color = np.clip(moved, self._manner.least_color, self._manner.most_color)
        self.wear(state, self.entry)

    def wear(self, state: State, entry: NDArray[np.intp]) -> None:
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
        """Shapes change to the shared colour that suits them best, if the picture gains by it.

        Overlapping ones that change together may overdo it: then only half of them do, or none.
        splats() are those of the state as it is.
        """
        before, moments = target.squares(splats())
        mass = target.removal_cost(splats())[1][:, 1]
        kept, wanted = self.entry, self.wanted(state, moments, mass)
        half = np.where(rng.random(len(kept)) < 0.5, wanted, kept)
        for entry in (wanted, half, kept):
            self.wear(state, entry)
            if entry is kept or target.squares(splats())[0] < before:
                break

    def wanted(
        self, state: State, gradient: NDArray[np.float64], mass: NDArray[np.float64]
    ) -> NDArray[np.intp]:
        """(n,) the entry of the same exponent that would leave each shape the least error.

        If all others stay: half the squared error of the picture changes by g d + mass d^2 / 2
        for a change d of a colour, with its gradient g, columns COLOR of gradient (n, ...), and
        mass (n,) the sum of the shape's squared weights; so the best is color - g / mass.
        """
        shown = np.maximum(mass, _LEAST_MASS)[:, None]
        best = np.where(mass[:, None] > _LEAST_MASS, gradient[:, COLOR] / shown, 0.0)
        entries = KDTree(np.column_stack([self._color, _APART * self._raw_beta]))
        wishes = np.column_stack([state.color - best, _APART * state.raw_beta])
        distance, entry = entries.query(wishes)
        return np.where(distance < _APART * 0.1, entry, self.entry)
