"""Colours that several shapes share, as in a file: one Adam step for each, and exchanges.

Steps by the summed gradient of a colour's shapes, and shapes that may change to another colour,
win back part of what a palette costs: docs/decisions/adam.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit import adam
from gauss2svg.fit.adam import Blending
from gauss2svg.fit.state import COLOR, State
from gauss2svg.scene.nearest import nearest_entry
from gauss2svg.scene.parameters import STEPPED

# Distance of a unit of ln beta, beside colours in 0..1: what is held never changes.
_APART = 100.0


# Steps and exchanges of what shapes share.
# Adam's learning rate of colours. 0.002 to 0.015 end within 0.01 dB (docs/decisions/palette.md).
COLOR_RATE = 0.006
LEAST_MASS = 1e-3  # mass in px below which a shape keeps its colour (docs/decisions/palette.md)


@dataclass
class SharedColors:
    """The distinct pairs of a colour and an exponent in a state, and which one each shape has.

    More exactly the distinct values of all that shapes share by a gradient (Parameter.shared).

    color  (k, 3) and Adam's moments of it, adam_m and adam_v (k, 3)
    held   (k, m) raw values of the other shared parameters, which never change
    entry  (n,) index of each shape's
    age    steps taken
    bounds  least and largest value of each channel
    """

    color: NDArray[np.float64]
    held: NDArray[np.float64]
    adam_m: NDArray[np.float64]
    adam_v: NDArray[np.float64]
    entry: NDArray[np.intp]
    age: int
    bounds: tuple[float, float]

    @classmethod
    def of(cls, state: State, blending: Blending) -> SharedColors:
        """The shared colours of a state."""
        keys = np.column_stack([state.color, _held(state)])
        shared, entry = np.unique(keys, axis=0, return_inverse=True)
        moments = np.zeros((len(shared), 3))
        return cls(
            shared[:, :3].copy(), shared[:, 3:].copy(), moments, moments.copy(),
            entry.reshape(-1), 0, (blending.least_color, blending.most_color),
        )  # fmt: skip

    def step(self, state: State, gradient: NDArray[np.float64], rate: float) -> None:
        """One Adam step by the gradient (n, STEPS), summed over each entry's shapes.

        rate is a factor of the learning rate; the new values are written to the state. No array is
        changed in place, so that a shallow copy keeps the colours of before.
        """
        columns, count = gradient[:, COLOR].T, len(self.color)
        summed = np.stack([np.bincount(self.entry, column, count) for column in columns], axis=1)
        first_decay, second_decay = adam.FIRST_DECAY, adam.SECOND_DECAY
        self.age += 1
        self.adam_m = self.adam_m + (1 - first_decay) * (summed - self.adam_m)
        self.adam_v = self.adam_v + (1 - second_decay) * (summed**2 - self.adam_v)
        first = self.adam_m / (1 - first_decay**self.age)
        second = self.adam_v / (1 - second_decay**self.age)
        step = COLOR_RATE * rate * first / (np.sqrt(second) + 1e-12)
        self.color = np.clip(self.color - step, *self.bounds)
        self.assign(state, self.entry)

    def assign(self, state: State, entry: NDArray[Any]) -> None:
        """Give every shape of the state the colour of its entry (n,)."""
        self.entry = entry
        state.color = self.color[entry]

    def kept(self, state: State) -> NDArray[Any]:
        """(n,) the entry of each shape of the state."""
        return self.entry

    def wanted(
        self, state: State, gradient: NDArray[np.float64], mass: NDArray[np.float64]
    ) -> NDArray[Any]:
        """(n,) the entry of the same exponent that would give each shape the least error.

        With all others fixed, half the squared error of the picture changes by g d + mass d^2 / 2
        for a change d of a colour, where g is its gradient, columns COLOR of gradient (n, ...), and
        mass (n,) the sum of the shape's squared weights. So the best colour is color - g / mass.
        """
        divisor = np.maximum(mass, LEAST_MASS)[:, None]
        best = np.where(mass[:, None] > LEAST_MASS, gradient[:, COLOR] / divisor, 0.0)
        entries = np.hstack([self.color, _APART * self.held])
        targets = np.hstack([state.color - best, _APART * _held(state)])
        distance, entry = nearest_entry(entries, targets)
        return np.where(distance < _APART * 0.1, entry, self.entry)


def _held(state: State) -> NDArray[np.float64]:
    """(n, m) raw values of the shared parameters besides the colour."""
    raw = [raw.name for parameter, raw in STEPPED if parameter.shared and raw.name != "color"]
    return np.column_stack([getattr(state, name) for name in raw])
