"""A fit in inks: opaque crisp shapes, each in one of a few fixed colours.

The target is the picture with the nearest ink at each pixel. With the picture itself, whose colours
lie between the inks, shapes thinner than a pixel would make halftones. Shapes are placed where
another ink would lower the error, and repeatedly change to the ink of least error
(docs/decisions/inks.md).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.state import COLOR, State
from gauss2svg.fit.target import Target
from gauss2svg.scene.falloff import RIM_WIDTH
from gauss2svg.scene.nearest import nearest_entry
from gauss2svg.svg.plain_ellipse import LEAST_PLAIN_BETA

# px over which a rim with a falloff would fall from 0.9 to 0.1 across the minor axis. Shapes of
# inks cover pixels instead, but their exponents set how far steps go.
_RIM_PX = 0.7
_MOST_BETA = 128.0
_NEIGHBOURS = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if down or right]
_LEAST_MASS = 1e-3  # px, mass below which a shape keeps its ink
_BAND = 32_768  # pixels at a time, of some 300 bytes each (docs/decisions/memory.md)


@dataclass(frozen=True)
class Inks:
    """The inks of a fit, color (k, 3) sRGB in 0..1."""

    color: NDArray[np.float64]

    def background(self, target: Target) -> NDArray[np.float64]:
        """Return the ink (3,) that is nearest to most visible pixels of a target."""
        entry = self._entries(np.moveaxis(target.source_color, 0, -1))
        if target.visible is not None:
            entry = entry[target.visible]
        return self.color[np.bincount(entry.ravel(), minlength=len(self.color)).argmax()]

    def inked(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the picture (h, w, 3) or (h, w, 4) with the nearest ink q at each pixel.

        A pixel beside one of another ink c has the colour between q and c that is nearest to the
        picture's, as in antialiased edges.
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
        """Return `inked` of colours (h, w, 3). around (h + 2, w + 2) has their inks, and a rim."""
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
        """Return the index (h, w) of the ink that is nearest to each of colours (h, w, 3)."""
        height, width = color.shape[:2]
        entries = np.empty((height, width), np.uint8)
        for rows in _bands(height, width):
            flat = color[rows].reshape(-1, 3).astype(np.float64)
            entries[rows] = nearest_entry(self.color, flat)[1].reshape(-1, width)
        return entries

    def nearest(self, color: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the ink (n, 3) that is nearest to each of colours (n, 3)."""
        return self.color[nearest_entry(self.color, color)[1]]

    def reducible(self, target: Target, rendered: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return a picture whose error against the target is the error that inks can reduce.

        For a target p, a render r and the closest ink q, the target minus the picture has the
        direction of q - r and the length sqrt(|p - r|^2 - |p - q|^2).
        """
        picture = np.empty_like(target.planar)
        for rows in _bands(target.height, target.width):
            planar = target.planar[:, rows]
            picture[:, rows] = planar - self._reducible_error(planar, rendered[:, rows])
        return picture

    def _reducible_error(
        self, planar: NDArray[np.floating], rendered: NDArray[np.floating]
    ) -> NDArray[np.floating]:
        """Return the difference of `reducible` for planar and rendered (3, h, w) or (6, h, w)."""
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
        best = state.color - gradient[:, COLOR] / np.maximum(mass, _LEAST_MASS)[:, None]
        return np.where(mass[:, None] > _LEAST_MASS, self.nearest(best), state.color)

    def assign(self, state: State, entry: NDArray[Any]) -> None:
        """Give every shape of the state its ink (n, 3)."""
        state.color = entry

    @staticmethod
    def crisp(factor: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return ln (n,) of the exponents of crisp rims, for Cholesky factors (n, 3) in px."""
        l11, l21, l22 = factor.T
        axis_sum, axis_difference = np.hypot(l11 + l22, l21), np.hypot(l11 - l22, l21)
        minor = np.maximum(0.5 * (axis_sum - axis_difference), 1e-9)
        return np.log(np.clip(RIM_WIDTH / _RIM_PX * minor, LEAST_PLAIN_BETA, _MOST_BETA))


def _bands(height: int, width: int) -> Iterator[slice]:
    """Yield slices of a picture's rows, with about _BAND pixels each."""
    step = max(1, _BAND // width)
    for first in range(0, height, step):
        yield slice(first, min(first + step, height))
