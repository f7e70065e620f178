"""A fit in inks: opaque crisp shapes, each of one of a few colours, which never change.

The target is the picture with the nearest ink at each pixel: of the picture itself, with colours
between the inks, shapes thinner than a pixel would make halftones. Shapes are placed where another
ink would lower the error, and change to the ink of least error again and again
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

# px in which the profile's rim would fall from 0.9 to 0.1, across the minor axis. Fits cover
# pixels: it sets the exponent, and by it how far a step goes.
_RIM = 0.7
_MOST_BETA = 128.0
_AROUND = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if down or right]
_LEAST_MASS = 1e-3  # px; shapes that contribute less keep their ink
_BAND = 32_768  # pixels at a time, which take some 300 bytes each (docs/decisions/memory.md)


@dataclass(frozen=True)
class Inks:
    """The inks of a fit: color (k, 3) sRGB in 0..1."""

    color: NDArray[np.float64]

    def background(self, target: Target) -> NDArray[np.float64]:
        """(3,) the ink that is nearest to most pixels of a target."""
        entry = self._entries(np.moveaxis(target.source_color, 0, -1))
        if target.visible is not None:
            entry = entry[target.visible]
        return self.color[np.bincount(entry.ravel(), minlength=len(self.color)).argmax()]

    def drawn(self, pixels: NDArray[np.float32]) -> NDArray[np.float32]:
        """The picture (h, w, 3) or (h, w, 4) with the nearest ink q at each pixel.

        Beside a pixel of another ink c it has the colour between q and c that is nearest to the
        picture's, as antialiased edges have.
        """
        found = pixels.copy()
        around = np.pad(self._entries(pixels[:, :, :3]), 1, mode="edge")
        for rows in _bands(*pixels.shape[:2]):
            beside = around[rows.start : rows.stop + 2]
            found[rows, :, :3] = self._between(pixels[rows, :, :3].astype(np.float64), beside)
        return found

    def _between(
        self, color: NDArray[np.float64], around: NDArray[np.uint8]
    ) -> NDArray[np.float64]:
        """What is drawn of colours (h, w, 3); around (h + 2, w + 2) has their inks, and a rim."""
        height, width = color.shape[:2]
        entry = around[1:-1, 1:-1]
        own = self.color[entry]
        found, least = own.copy(), np.square(own - color).sum(axis=2)
        for down, right in _AROUND:
            beside = around[1 + down : 1 + down + height, 1 + right : 1 + right + width]
            y, x = np.nonzero(beside != entry)
            step = self.color[beside[y, x]] - own[y, x]
            along = ((color[y, x] - own[y, x]) * step).sum(axis=1) / np.square(step).sum(axis=1)
            between = own[y, x] + np.clip(along, 0, 1)[:, None] * step
            square = np.square(between - color[y, x]).sum(axis=1)
            closer = square < least[y, x]
            y, x = y[closer], x[closer]
            found[y, x], least[y, x] = between[closer], square[closer]
        return found

    def _entries(self, color: NDArray[np.floating]) -> NDArray[np.uint8]:
        """(h, w) which ink is nearest to each of colours (h, w, 3)."""
        height, width = color.shape[:2]
        found = np.empty((height, width), np.uint8)
        for rows in _bands(height, width):
            flat = color[rows].reshape(-1, 3).astype(np.float64)
            found[rows] = nearest_entry(self.color, flat)[1].reshape(-1, width)
        return found

    def nearest(self, color: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) the ink that is nearest to each of colours (n, 3)."""
        return self.color[nearest_entry(self.color, color)[1]]

    def reducible(self, target: Target, rendered: NDArray[np.floating]) -> NDArray[np.floating]:
        """A picture from which the target differs as far as another ink would be closer to it.

        target p, rendered r and the closest ink q: its difference from p has the direction of
        q - r and the length sqrt(|p - r|^2 - |p - q|^2).
        """
        found = np.empty_like(target.planar)
        for rows in _bands(target.height, target.width):
            planar, now = target.planar[:, rows], rendered[:, rows]
            found[:, rows] = planar - self._toward(planar, now)
        return found

    def _toward(
        self, planar: NDArray[np.floating], rendered: NDArray[np.floating]
    ) -> NDArray[np.floating]:
        """The difference of `reducible`, of planar and rendered (3, h, w) or (6, h, w)."""
        views = len(planar) // 3
        least = np.full(planar.shape[1:], np.inf, np.float32)
        toward = np.zeros_like(planar)
        for ink in np.tile(self.color, views).astype(planar.dtype):
            square = np.square(planar - ink[:, None, None]).sum(axis=0)
            closer = square < least
            np.copyto(least, square, where=closer)
            np.copyto(toward, ink[:, None, None] - rendered, where=closer)
        left = np.square(planar - rendered).sum(axis=0) - least
        length = np.sqrt(np.square(toward).sum(axis=0))
        return toward * (np.sqrt(np.maximum(left, 0)) / np.maximum(length, 1e-6))

    def kept(self, state: State) -> NDArray[Any]:
        """(n, 3) the ink of each shape of the state."""
        return state.color

    def wanted(
        self, state: State, gradient: NDArray[np.float64], mass: NDArray[np.float64]
    ) -> NDArray[Any]:
        """(n, 3) the ink that would give each shape the least error, as in gauss2svg.fit.shared."""
        best = state.color - gradient[:, COLOR] / np.maximum(mass, _LEAST_MASS)[:, None]
        return np.where(mass[:, None] > _LEAST_MASS, self.nearest(best), state.color)

    def assign(self, state: State, entry: NDArray[Any]) -> None:
        """Give every shape of the state its ink (n, 3)."""
        state.color = entry

    @staticmethod
    def crisp(factor: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) ln of the exponents of crisp rims, for shapes of Cholesky factors (n, 3) px."""
        l11, l21, l22 = factor.T
        far, near = np.hypot(l11 + l22, l21), np.hypot(l11 - l22, l21)
        minor = np.maximum(0.5 * (far - near), 1e-9)
        return np.log(np.clip(RIM_WIDTH / _RIM * minor, LEAST_PLAIN_BETA, _MOST_BETA))


def _bands(height: int, width: int) -> Iterator[slice]:
    """Rows of a picture, about _BAND of its pixels at a time."""
    step = max(1, _BAND // width)
    for first in range(0, height, step):
        yield slice(first, min(first + step, height))
