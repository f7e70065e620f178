"""Colours that shapes share: a file's colours, which the fit steps, and inks, which are fixed.

Each colour of a file takes Adam steps. The gradient of the colour is the sum of the gradients of
the shapes that have it. Shapes may also change to another colour of the file. Both together regain
part of the PSNR that is lost when a file has only a palette of colours (docs/decisions/adam.md).

In a fit to inks, each shape is opaque and crisp and has one of a few fixed colours. The target is
the picture with each pixel in its nearest ink. If the target were the picture itself, the fit would
imitate the colours between the inks by halftones of shapes thinner than a pixel. New shapes are
placed where another ink would lower the error. At regular intervals, each shape changes to the ink
that gives the least error (docs/decisions/inks.md).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.core import Kernel
from gauss2svg.fit.state import COLOR, FIRST_DECAY, SECOND_DECAY, State
from gauss2svg.fit.target import Target
from gauss2svg.scene.falloff import RIM_WIDTH
from gauss2svg.svg.forms import LEAST_PLAIN_BETA
from gauss2svg.without_scipy import nearest_entry

# A shape may change its colour but not its exponent. So before the nearest pair of a colour and an
# exponent is searched, ln beta is multiplied by this factor. A pair with another exponent is then
# much farther away than pairs with another colour, because channels of colours are in 0..1.
_FIXED_FACTOR = 100.0

# Adam's learning rate of shared colours. All rates from 0.002 to 0.015 give the same PSNR to within
# 0.01 dB (docs/decisions/palette.md).
COLOR_RATE = 0.006
# A shape may change its colour or ink only if its mass, the sum of its squared weights over all
# pixels, is above this value (docs/decisions/palette.md).
LEAST_MASS = 1e-3


@dataclass
class SharedColors:
    """The k distinct pairs of a colour and an exponent in a state, and the pair of each shape.

    Each pair is called an entry.

    color   (k, 3) colours of the entries
    beta    (k,) ln beta of the entries, which never changes
    adam_m  (k, 3) Adam's first moments of the colours
    adam_v  (k, 3) Adam's second moments of the colours
    entry   (n,) index of each shape's entry
    age     number of Adam steps that the colours have taken
    bounds  (2,) least and largest value of a colour channel
    """

    color: NDArray[np.float64]
    beta: NDArray[np.float64]
    adam_m: NDArray[np.float64]
    adam_v: NDArray[np.float64]
    entry: NDArray[np.intp]
    age: int
    bounds: NDArray[np.float64]

    @classmethod
    def of(cls, state: State, bounds: NDArray[np.float64]) -> SharedColors:
        """Return the distinct pairs of a colour and an exponent in a state, with moments of 0."""
        keys = np.column_stack([state.color, state.raw_beta])
        shared, entry = np.unique(keys, axis=0, return_inverse=True)
        moments = np.zeros((len(shared), 3))
        return cls(
            shared[:, :3].copy(), shared[:, 3].copy(), moments, moments.copy(),
            entry.reshape(-1), 0, bounds,
        )  # fmt: skip

    def step(self, state: State, gradient: NDArray[np.float64], rate: float) -> None:
        """Take one Adam step of the colours, and write the new colours to the state's shapes.

        The gradient of a colour is the sum of the gradients of the shapes that have this colour.
        `gradient` (n, MOMENTS) has the gradients of the shapes' colours in its columns COLOR.
        COLOR_RATE is multiplied by `rate`. Arrays are replaced and not changed in place, so that a
        shallow copy of this object keeps its own colours.
        """
        columns, count = gradient[:, COLOR].T, len(self.color)
        summed = np.stack([np.bincount(self.entry, column, count) for column in columns], axis=1)
        self.age += 1
        self.adam_m = self.adam_m + (1 - FIRST_DECAY) * (summed - self.adam_m)
        self.adam_v = self.adam_v + (1 - SECOND_DECAY) * (summed**2 - self.adam_v)
        unbiased_m = self.adam_m / (1 - portable.power(FIRST_DECAY, self.age))
        unbiased_v = self.adam_v / (1 - portable.power(SECOND_DECAY, self.age))
        step = COLOR_RATE * rate * unbiased_m / (np.sqrt(unbiased_v) + 1e-12)
        self.color = np.clip(self.color - step, *self.bounds)
        self.assign(state, self.entry)

    def assign(self, state: State, entry: NDArray[Any]) -> None:
        """Assign entry[i] to each shape i, and give the shape the colour of that entry."""
        self.entry = entry
        state.color = self.color[entry]

    def current(self, state: State) -> NDArray[Any]:
        """Return the entry (n,) of each shape of the state."""
        return self.entry

    def nearest(self, color: NDArray[np.float64], state: State) -> NDArray[Any]:
        """Return for each shape the entry (n,) nearest to the colour (n, 3).

        Only entries with the same exponent as the shape are considered.
        """
        entries = np.column_stack([self.color, _FIXED_FACTOR * self.beta])
        targets = np.column_stack([color, _FIXED_FACTOR * state.raw_beta])
        distance, entry = nearest_entry(entries, targets)
        return np.where(distance < _FIXED_FACTOR * 0.1, entry, self.entry)


def best_colors(
    state: State, gradient: NDArray[np.float64], mass: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return for each shape the colour (n, 3) that would give the least error.

    gradient  (n, ...) has the gradients of the shapes' colours in the columns COLOR
    mass      (n,) is, for each shape, the sum of its squared weights over all pixels

    If the colour of a single shape changes by d, half the squared error changes by
    g d + mass d^2 / 2, where g is the gradient of the colour. So the best colour of a shape is
    color - g / mass. A shape of a mass up to LEAST_MASS keeps its colour.
    """
    change = gradient[:, COLOR] / np.maximum(mass, LEAST_MASS)[:, None]
    return state.color - np.where(mass[:, None] > LEAST_MASS, change, 0.0)


# Width in px of the rim of a shape in a fit to inks: the distance along the minor axis over which
# the falloff drops from 0.9 to 0.1. The exponent of a shape is computed from this width. The width
# cannot be seen, because such shapes are drawn without a falloff. But it decides how large the
# steps of a shape are, because they depend on the exponent.
_RIM_PX = 0.7
# Approximate number of pixels in a band of rows. Pictures are handled band by band, because the
# work takes 300 bytes of memory per pixel (docs/decisions/memory.md).
_BAND_PIXELS = 32_768


@dataclass(frozen=True)
class InkColors:
    """The k inks of a fit.

    color  (k, 3) their colours, sRGB in 0..1
    """

    color: NDArray[np.float64]

    def background(self, target: Target) -> NDArray[np.float64]:
        """Return the commonest ink (3,) of the target.

        Each visible pixel is counted for the ink that is nearest to its colour.
        """
        entry = self._entries(np.moveaxis(target.source_color, 0, -1))
        if target.visible is not None:
            entry = entry[target.visible]
        return self.color[np.bincount(entry.ravel(), minlength=len(self.color)).argmax()]

    def inked(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the picture (h, w, 3) or (h, w, 4) with each pixel in its nearest ink q.

        If the nearest ink of a neighbouring pixel is another ink c, the pixel instead gets the
        mixture of q and c that is nearest to its colour in the picture. So edges stay antialiased.
        """
        picture = pixels.copy()
        around = np.pad(self._entries(pixels[:, :, :3]), 1, mode="edge")
        for rows in _bands(*pixels.shape[:2]):
            color, beside = (
                pixels[rows, :, :3].astype(np.float64),
                around[rows.start : rows.stop + 2],
            )
            height, width = color.shape[:2]
            entry = beside[1:-1, 1:-1]
            own = self.color[entry]
            nearest, least = own.copy(), np.square(own - color).sum(axis=2)
            for down, right in itertools.product(range(3), range(3)):
                other = beside[down : down + height, right : right + width]
                y, x = np.nonzero(other != entry)
                step = self.color[other[y, x]] - own[y, x]
                along = ((color[y, x] - own[y, x]) * step).sum(axis=1) / np.square(step).sum(axis=1)
                between = own[y, x] + np.clip(along, 0, 1)[:, None] * step
                square = np.square(between - color[y, x]).sum(axis=1)
                closer = square < least[y, x]
                y, x = y[closer], x[closer]
                nearest[y, x], least[y, x] = between[closer], square[closer]
            picture[rows, :, :3] = nearest
        return picture

    def _entries(self, color: NDArray[np.floating]) -> NDArray[np.uint8]:
        """Return for each colour (h, w, 3) the index (h, w) of the nearest ink."""
        height, width = color.shape[:2]
        entries = np.empty((height, width), np.uint8)
        for rows in _bands(height, width):
            flat = color[rows].reshape(-1, 3).astype(np.float64)
            entries[rows] = nearest_entry(self.color, flat)[1].reshape(-1, width)
        return entries

    def nearest(
        self, color: NDArray[np.float64], _state: State | None = None
    ) -> NDArray[np.float64]:
        """Return for each colour (n, 3) the nearest ink (n, 3)."""
        return self.color[nearest_entry(self.color, color)[1]]

    def reducible(self, target: Target, rendered: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return a picture: the target minus the part of the error that other inks can reduce.

        New shapes are placed where this picture, and not the render, differs from the target.

        Let p be the target at a pixel, r the render, and q the ink closest to p. Then the target
        minus the picture has the direction of q - r and the length sqrt(|p - r|^2 - |p - q|^2). If
        r is closer to p than q is, the length is 0.
        """
        picture = np.empty_like(target.planar)
        views = len(picture) // 3
        for rows in _bands(target.height, target.width):
            planar, shown = target.planar[:, rows], rendered[:, rows]
            least = np.full(planar.shape[1:], np.inf, np.float32)
            toward = np.zeros_like(planar)
            for ink in np.tile(self.color, views).astype(planar.dtype):
                square = np.square(planar - ink[:, None, None]).sum(axis=0)
                closer = square < least
                np.copyto(least, square, where=closer)
                np.copyto(toward, ink[:, None, None] - shown, where=closer)
            excess = np.square(planar - shown).sum(axis=0) - least
            length = np.sqrt(np.square(toward).sum(axis=0))
            reducible = toward * (np.sqrt(np.maximum(excess, 0)) / np.maximum(length, 1e-6))
            picture[:, rows] = planar - reducible
        return picture

    def current(self, state: State) -> NDArray[Any]:
        """Return the ink (n, 3) of each shape of the state."""
        return state.color

    def assign(self, state: State, entry: NDArray[Any]) -> None:
        """Set the ink of each shape i of the state to entry[i]. `entry` is (n, 3)."""
        state.color = entry

    @staticmethod
    def crisp_raw_betas(factor: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ln beta (n,) of shapes whose rims are to be about _RIM_PX wide.

        factor: Cholesky factors (n, 3) of the shapes, in px.
        """
        l11, l21, l22 = factor.T
        axis_sum, axis_difference = portable.hypot(l11 + l22, l21), portable.hypot(l11 - l22, l21)
        minor = np.maximum(0.5 * (axis_sum - axis_difference), 1e-9)
        return portable.log(np.clip(RIM_WIDTH / _RIM_PX * minor, LEAST_PLAIN_BETA, 128.0))


def _bands(height: int, width: int) -> Iterator[slice]:
    """Yield slices of a picture's rows, with about _BAND_PIXELS pixels each."""
    step = max(1, _BAND_PIXELS // width)
    for first in range(0, height, step):
        yield slice(first, min(first + step, height))


# Constants of solved_colors (docs/decisions/small.md). A sweep solves for one colour after another.
BOUNDED_SWEEPS = 20  # number of sweeps that clip colours to 0..1 but do not round them
ROUNDED_SWEEPS = 3  # number of further sweeps, which both clip and round the colours


_sweep_colors = Kernel("sweep_colors", "int float64 float64 float64 int64 float float64")


def solved_colors(
    products: NDArray[np.float64], sums: NDArray[np.float64], levels: int
) -> NDArray[np.float64]:
    """Return colours (k, 3) that approximately solve the normal equations products @ colors = sums.

    The colours lie in 0..1 and are multiples of 1 / levels. The equations are first solved without
    these conditions. If a colour is then outside 0..1, BOUNDED_SWEEPS sweeps over all colours solve
    for one colour after the other, and clip it to 0..1. At the end, ROUNDED_SWEEPS sweeps do the
    same and also round each colour. Each colour is solved for the rounded values of the others, so
    it makes up for their rounding errors.
    """
    if not len(sums):
        return np.zeros((0, 3))
    diagonal = np.maximum(np.diag(products), 1e-9)
    # The equations can thus be solved even if some shapes are nearly hidden.
    damped = products + 1e-6 * np.diag(diagonal + diagonal.max())
    color = portable.solve(damped, sums)
    bounded = 0 if (color >= 0).all() and (color <= 1).all() else BOUNDED_SWEEPS
    color = np.minimum(np.maximum(color, 0), 1)
    order = np.argsort(-diagonal, kind="stable")
    arrays = np.ascontiguousarray(products), np.ascontiguousarray(sums), diagonal, order
    for sweep in range(bounded + ROUNDED_SWEEPS):
        _sweep_colors(len(sums), *arrays, 0.0 if sweep < bounded else float(levels), color)
    return color
