"""Colours that several shapes share, as in a file.

Each colour takes Adam steps by the summed gradient of its shapes, and shapes may change to another
colour. Both win back part of what a palette costs (docs/decisions/adam.md).
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

# Distance of a unit of ln beta beside colours in 0..1, so large that exponents never change.
_FIXED_DISTANCE = 100.0

# Adam's learning rate of colours. 0.002 to 0.015 end within 0.01 dB (docs/decisions/palette.md).
COLOR_RATE = 0.006
LEAST_MASS = 1e-3  # px, mass below which a shape keeps its colour (docs/decisions/palette.md)


@dataclass
class SharedColors:
    """The k distinct pairs of a colour and an exponent in a state, and the pair of each shape.

    In general these are combinations of all shared parameters (Parameter.shared).

    color   (k, 3) colours
    fixed   (k, m) raw values of the other shared parameters, which never change
    adam_m  (k, 3) Adam's first moments of the colours
    adam_v  (k, 3) Adam's second moments
    entry   (n,) index of each shape's pair
    age     number of steps taken
    bounds  least and largest value of each channel
    """

    color: NDArray[np.float64]
    fixed: NDArray[np.float64]
    adam_m: NDArray[np.float64]
    adam_v: NDArray[np.float64]
    entry: NDArray[np.intp]
    age: int
    bounds: tuple[float, float]

    @classmethod
    def of(cls, state: State, blending: Blending) -> SharedColors:
        """Return the shared colours of a state."""
        keys = np.column_stack([state.color, _fixed_values(state)])
        shared, entry = np.unique(keys, axis=0, return_inverse=True)
        moments = np.zeros((len(shared), 3))
        return cls(
            shared[:, :3].copy(), shared[:, 3:].copy(), moments, moments.copy(),
            entry.reshape(-1), 0, (blending.least_color, blending.most_color),
        )  # fmt: skip

    def step(self, state: State, gradient: NDArray[np.float64], rate: float) -> None:
        """Take one Adam step by the gradient (n, STEPS), summed over each entry's shapes.

        rate is a factor of the learning rate. The new colours are written to the state. No array is
        changed in place, so that a shallow copy keeps its colours.
        """
        columns, count = gradient[:, COLOR].T, len(self.color)
        summed = np.stack([np.bincount(self.entry, column, count) for column in columns], axis=1)
        first_decay, second_decay = adam.FIRST_DECAY, adam.SECOND_DECAY
        self.age += 1
        self.adam_m = self.adam_m + (1 - first_decay) * (summed - self.adam_m)
        self.adam_v = self.adam_v + (1 - second_decay) * (summed**2 - self.adam_v)
        unbiased_m = self.adam_m / (1 - first_decay**self.age)
        unbiased_v = self.adam_v / (1 - second_decay**self.age)
        step = COLOR_RATE * rate * unbiased_m / (np.sqrt(unbiased_v) + 1e-12)
        self.color = np.clip(self.color - step, *self.bounds)
        self.assign(state, self.entry)

    def assign(self, state: State, entry: NDArray[Any]) -> None:
        """Give every shape of the state the colour of its entry (n,)."""
        self.entry = entry
        state.color = self.color[entry]

    def current(self, state: State) -> NDArray[Any]:
        """Return the entry (n,) of each shape of the state."""
        return self.entry

    def best(
        self, state: State, gradient: NDArray[np.float64], mass: NDArray[np.float64]
    ) -> NDArray[Any]:
        """Return the entries (n,) that would give each shape the least error at its own exponent.

        If a colour alone changes by d, half the squared error changes by g d + mass d^2 / 2. g is
        its gradient, columns COLOR of gradient (n, ...), and mass (n,) is the sum of the shape's
        squared weights. So the best colour is color - g / mass.
        """
        divisor = np.maximum(mass, LEAST_MASS)[:, None]
        change = np.where(mass[:, None] > LEAST_MASS, gradient[:, COLOR] / divisor, 0.0)
        entries = np.hstack([self.color, _FIXED_DISTANCE * self.fixed])
        targets = np.hstack([state.color - change, _FIXED_DISTANCE * _fixed_values(state)])
        distance, entry = nearest_entry(entries, targets)
        return np.where(distance < _FIXED_DISTANCE * 0.1, entry, self.entry)


def _fixed_values(state: State) -> NDArray[np.float64]:
    """Return the raw values (n, m) of the shared parameters other than the colour."""
    raw = [raw.name for parameter, raw in STEPPED if parameter.shared and raw.name != "color"]
    return np.column_stack([getattr(state, name) for name in raw])
