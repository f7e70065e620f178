"""Colours that shapes share: a file's colours, which are stepped, and inks, which are fixed.

Each colour of a file takes Adam steps by the summed gradient of its shapes, and shapes may change
to another colour. This wins back part of the PSNR that a palette costs (docs/decisions/adam.md).

In a fit to inks, shapes are opaque and crisp, each in one of a few fixed colours. The target is the
picture with the nearest ink at each pixel. If the target were the picture itself, shapes thinner
than a pixel would make halftones of colours between the inks. Shapes are placed where another ink
would lower the error, and repeatedly change to the ink of least error (docs/decisions/inks.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit import adam
from gauss2svg.fit.adam import Blending
from gauss2svg.fit.state import COLOR, State
from gauss2svg.fit.target import Target
from gauss2svg.scene.falloff import RIM_WIDTH
from gauss2svg.scene.scene import STEPPED
from gauss2svg.svg.forms import LEAST_PLAIN_BETA
from gauss2svg.without_scipy import nearest_entry

# Factor of ln beta in the distance between pairs of a colour and an exponent. Colours in 0..1 have
# the factor 1, so a shape never changes to a pair with another exponent.
_FIXED_DISTANCE = 100.0

# Adam's learning rate of shared colours. Rates of 0.002 to 0.015 change the PSNR by less than
# 0.01 dB (docs/decisions/palette.md).
COLOR_RATE = 0.006
# A shape may change its colour or ink if the sum of its squared weights in pixels is above this
# (docs/decisions/palette.md).
LEAST_MASS = 1e-3


@dataclass
class SharedColors:
    """The k distinct pairs of a colour and an exponent in a state, and the pair of each shape.

    In general, a pair combines the values of all shared parameters (Parameter.shared).

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
        """Take one Adam step of the colours, and write the new colours to the state's shapes.

        The gradient (n, STEPS) is summed over each entry's shapes. rate multiplies COLOR_RATE.
        Arrays are replaced, not changed in place, so that a shallow copy keeps its colours.
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
        """Set the entry (n,) of each shape, and write the colours of these entries to the state."""
        self.entry = entry
        state.color = self.color[entry]

    def current(self, state: State) -> NDArray[Any]:
        """Return the entry (n,) of each shape of the state."""
        return self.entry

    def best(
        self, state: State, gradient: NDArray[np.float64], mass: NDArray[np.float64]
    ) -> NDArray[Any]:
        """Return for each shape the entry (n,) of least error among those with its exponent.

        If only one shape's colour changes by d, half the squared error changes by
        g d + mass d^2 / 2. g is the shape's row of the columns COLOR of gradient (n, ...), and
        mass (n,) is the sum of its squared weights. So its best colour is color - g / mass.
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


# px, distance along the minor axis in which the rim of a shape in inks falls from 0.9 to 0.1. Files
# draw such shapes without a falloff, but the exponents set how far steps go.
_RIM_PX = 0.7
_MOST_BETA = 128.0
_NEIGHBOURS = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if down or right]
_BAND = 32_768  # pixels of a band; work on a pixel takes 300 bytes (docs/decisions/memory.md)


@dataclass(frozen=True)
class Inks:
    """The inks of a fit. color (k, 3) is sRGB in 0..1."""

    color: NDArray[np.float64]

    def background(self, target: Target) -> NDArray[np.float64]:
        """Return the ink (3,) that is the nearest ink at more visible pixels than any other."""
        entry = self._entries(np.moveaxis(target.source_color, 0, -1))
        if target.visible is not None:
            entry = entry[target.visible]
        return self.color[np.bincount(entry.ravel(), minlength=len(self.color)).argmax()]

    def inked(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the picture (h, w, 3) or (h, w, 4) with the nearest ink q at each pixel.

        If the ink of a neighbouring pixel is another ink c, the pixel gets the colour between q and
        c that is nearest to its colour in the picture, as in antialiased edges.
        """
        picture = pixels.copy()
        around = np.pad(self._entries(pixels[:, :, :3]), 1, mode="edge")
        for rows in _bands(*pixels.shape[:2]):
            beside = around[rows.start : rows.stop + 2]
            picture[rows, :, :3] = self._between(pixels[rows, :, :3].astype(np.float64), beside)
        return picture

    def _between(
        self, color: NDArray[np.float64], around: NDArray[np.uint8]
    ) -> NDArray[np.float64]:
        """Return `inked` of colours (h, w, 3), from the indices (h + 2, w + 2) of their inks."""
        height, width = color.shape[:2]
        entry = around[1:-1, 1:-1]
        own = self.color[entry]
        nearest, least = own.copy(), np.square(own - color).sum(axis=2)
        for down, right in _NEIGHBOURS:
            beside = around[1 + down : 1 + down + height, 1 + right : 1 + right + width]
            y, x = np.nonzero(beside != entry)
            step = self.color[beside[y, x]] - own[y, x]
            along = ((color[y, x] - own[y, x]) * step).sum(axis=1) / np.square(step).sum(axis=1)
            between = own[y, x] + np.clip(along, 0, 1)[:, None] * step
            square = np.square(between - color[y, x]).sum(axis=1)
            closer = square < least[y, x]
            y, x = y[closer], x[closer]
            nearest[y, x], least[y, x] = between[closer], square[closer]
        return nearest

    def _entries(self, color: NDArray[np.floating]) -> NDArray[np.uint8]:
        """Return the index (h, w) of the nearest ink for each colour (h, w, 3)."""
        height, width = color.shape[:2]
        entries = np.empty((height, width), np.uint8)
        for rows in _bands(height, width):
            flat = color[rows].reshape(-1, 3).astype(np.float64)
            entries[rows] = nearest_entry(self.color, flat)[1].reshape(-1, width)
        return entries

    def nearest(self, color: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the nearest ink (n, 3) for each colour (n, 3)."""
        return self.color[nearest_entry(self.color, color)[1]]

    def reducible(self, target: Target, rendered: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return a picture that differs from the target by the error that inks can reduce.

        At a pixel with target p, render r and the ink q closest to p, the target minus the picture
        has the direction of q - r and the length sqrt(|p - r|^2 - |p - q|^2).
        """
        picture = np.empty_like(target.planar)
        for rows in _bands(target.height, target.width):
            planar = target.planar[:, rows]
            picture[:, rows] = planar - self._reducible_error(planar, rendered[:, rows])
        return picture

    def _reducible_error(
        self, planar: NDArray[np.floating], rendered: NDArray[np.floating]
    ) -> NDArray[np.floating]:
        """Return planar minus the picture of `reducible`, from planar and render (3 or 6, h, w)."""
        views = len(planar) // 3
        least = np.full(planar.shape[1:], np.inf, np.float32)
        toward = np.zeros_like(planar)
        for ink in np.tile(self.color, views).astype(planar.dtype):
            square = np.square(planar - ink[:, None, None]).sum(axis=0)
            closer = square < least
            np.copyto(least, square, where=closer)
            np.copyto(toward, ink[:, None, None] - rendered, where=closer)
        excess = np.square(planar - rendered).sum(axis=0) - least
        length = np.sqrt(np.square(toward).sum(axis=0))
        return toward * (np.sqrt(np.maximum(excess, 0)) / np.maximum(length, 1e-6))

    def current(self, state: State) -> NDArray[Any]:
        """Return the ink (n, 3) of each shape of the state."""
        return state.color

    def best(
        self, state: State, gradient: NDArray[np.float64], mass: NDArray[np.float64]
    ) -> NDArray[Any]:
        """Return the ink (n, 3) that would give each shape the least error (see SharedColors)."""
        best = state.color - gradient[:, COLOR] / np.maximum(mass, LEAST_MASS)[:, None]
        return np.where(mass[:, None] > LEAST_MASS, self.nearest(best), state.color)

    def assign(self, state: State, entry: NDArray[Any]) -> None:
        """Write an ink (n, 3) to each shape of the state."""
        state.color = entry

    @staticmethod
    def crisp_raw_betas(factor: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the ln beta (n,) for rims of about _RIM_PX, from Cholesky factors (n, 3) in px."""
        l11, l21, l22 = factor.T
        axis_sum, axis_difference = np.hypot(l11 + l22, l21), np.hypot(l11 - l22, l21)
        minor = np.maximum(0.5 * (axis_sum - axis_difference), 1e-9)
        return np.log(np.clip(RIM_WIDTH / _RIM_PX * minor, LEAST_PLAIN_BETA, _MOST_BETA))


def _bands(height: int, width: int) -> Iterator[slice]:
    """Yield slices of a picture's rows, with about _BAND pixels each."""
    step = max(1, _BAND // width)
    for first in range(0, height, step):
        yield slice(first, min(first + step, height))


# Constants of solved_colors (docs/decisions/small.md).
BOUNDED_SWEEPS = 20  # sweeps that solve for the colours one by one within 0..1
ROUNDED_SWEEPS = 3  # last sweeps, which also round the colours one by one
DAMPING = 1e-6  # share of the diagonal, and of its maximum, that is added for nearly hidden shapes


def solved_colors(
    products: NDArray[np.float64], sums: NDArray[np.float64], levels: int
) -> NDArray[np.float64]:
    """Return colours (k, 3) in 0..1, multiples of 1 / levels, that nearly solve normal equations.

    The equations are products @ colors = sums. They are first solved without bounds, then colour by
    colour within bounds. In the end the colours are rounded one by one. A colour that is rounded
    later makes up for earlier rounding errors.
    """
    diagonal = np.maximum(np.diag(products), 1e-9)
    damped = products + DAMPING * np.diag(diagonal + diagonal.max())
    color = np.linalg.solve(damped, sums)
    bounded = 0 if (color >= 0).all() and (color <= 1).all() else BOUNDED_SWEEPS
    color = np.minimum(np.maximum(color, 0), 1)
    order = np.argsort(-diagonal)
    for sweep in range(bounded + ROUNDED_SWEEPS):
        for k in order:
            best = color[k] + (sums[k] - products[k] @ color) / diagonal[k]
            if sweep >= bounded:
                best = np.rint(best * levels) / levels
            color[k] = np.minimum(np.maximum(best, 0), 1)
    return color
