"""Inks, which are fixed colours of shapes, and colours by linear equations.

In a fit to inks, each shape is opaque and crisp and has one of a few fixed colours. The target is
the picture with each pixel in its nearest ink. If the target were the picture itself, the fit would
imitate the colours between the inks by halftones of shapes thinner than a pixel. New shapes are
placed where another ink would lower the error. At regular intervals, each shape changes to the ink
that gives the least error (docs/decisions/inks.md).
"""

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.core import Floats, Kernel, Reals
from gauss2svg.fit.state import COLOR, State
from gauss2svg.fit.target import Target
from gauss2svg.scene.falloff import RIM_WIDTH
from gauss2svg.svg.forms import LEAST_PLAIN_BETA
from gauss2svg.without_scipy import nearest_entry


def best_colors(state: State, gradient: Floats, mass: Floats) -> Floats:
    """Return for each shape the colour (n, 3) that would give the least error.

    gradient  (n, ...) has the gradients of the shapes' colours in the columns COLOR
    mass      (n,) is, for each shape, the sum of its squared weights over all pixels

    If the colour of a single shape changes by d, half the squared error changes by
    g d + mass d^2 / 2, where g is the gradient of the colour. So the best colour of a shape is
    color - g / mass. A shape of a mass up to 1e-3 keeps its colour.
    """
    change = gradient[:, COLOR] / np.maximum(mass, 1e-3)[:, None]
    return state.color - np.where(mass[:, None] > 1e-3, change, 0.0)


@dataclass(frozen=True)
class InkColors:
    """The k inks of a fit.

    color  (k, 3) their colours, sRGB in 0..1
    """

    color: Floats

    def background(self, target: Target) -> Floats:
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
        # Bands of rows, because the work takes 300 bytes per pixel (docs/decisions/memory.md).
        step = max(1, 32_768 // pixels.shape[1])
        for top in range(0, len(pixels), step):
            color = pixels[top : top + step, :, :3].astype(np.float64)
            height, width = color.shape[:2]
            beside = around[top : top + height + 2]
            entry = beside[1:-1, 1:-1]
            own = self.color[entry]
            nearest, least = own.copy(), np.square(own - color).sum(axis=2)
            for down, right in itertools.product(range(3), range(3)):
                other = beside[down : down + height, right : right + width]
                y, x = np.nonzero(other != entry)
                toward = self.color[other[y, x]] - own[y, x]
                along = ((color[y, x] - own[y, x]) * toward).sum(axis=1)
                share = np.clip(along / np.square(toward).sum(axis=1), 0, 1)
                between = own[y, x] + share[:, None] * toward
                square = np.square(between - color[y, x]).sum(axis=1)
                closer = square < least[y, x]
                y, x = y[closer], x[closer]
                nearest[y, x], least[y, x] = between[closer], square[closer]
            picture[top : top + height, :, :3] = nearest
        return picture

    def _entries(self, color: Reals) -> NDArray[np.uint8]:
        """Return for each colour (h, w, 3) the index (h, w) of the nearest ink."""
        flat = color.reshape(-1, 3).astype(np.float64)
        return nearest_entry(self.color, flat)[1].reshape(color.shape[:2]).astype(np.uint8)

    def nearest(self, color: Floats) -> Floats:
        """Return for each colour (n, 3) the nearest ink (n, 3)."""
        return self.color[nearest_entry(self.color, color)[1]]

    def reducible(self, target: Target, rendered: Reals) -> Reals:
        """Return a picture: the target minus the part of the error that other inks can reduce.

        New shapes are placed where this picture, and not the render, differs from the target.

        Let p be the target at a pixel, r the render, and q the ink closest to p. Then the target
        minus the picture has the direction of q - r and the length sqrt(|p - r|^2 - |p - q|^2). If
        r is closer to p than q is, the length is 0.
        """
        planar = target.planar
        least, toward = np.full(planar.shape[1:], np.inf, np.float32), np.zeros_like(planar)
        for ink in np.tile(self.color, len(planar) // 3).astype(planar.dtype)[:, :, None, None]:
            square = np.square(planar - ink).sum(axis=0)
            closer = square < least
            np.copyto(least, square, where=closer)
            np.copyto(toward, ink - rendered, where=closer)
        excess = np.square(planar - rendered).sum(axis=0) - least
        length = np.sqrt(np.square(toward).sum(axis=0))
        return planar - toward * (np.sqrt(np.maximum(excess, 0)) / np.maximum(length, 1e-6))

    @staticmethod
    def crisp_raw_betas(factor: Floats) -> Floats:
        """Return ln beta (n,) of shapes whose rims are to be about 0.7 px wide.

        factor: Cholesky factors (n, 3) of the shapes, in px.

        The falloff drops from 0.9 to 0.1 over this distance along the minor axis. It cannot be
        seen, because such shapes are drawn without a falloff. But the exponent decides how large
        their steps are (docs/decisions/inks.md).
        """
        l11, l21, l22 = factor.T
        axis_sum, axis_difference = portable.hypot(l11 + l22, l21), portable.hypot(l11 - l22, l21)
        minor = np.maximum(0.5 * (axis_sum - axis_difference), 1e-9)
        return portable.log(np.clip(RIM_WIDTH / 0.7 * minor, LEAST_PLAIN_BETA, 128.0))


_sweep_colors = Kernel("sweep_colors", "int float64 float64 float64 int64 float float64")


def solved_colors(products: Floats, sums: Floats, levels: int) -> Floats:
    """Return colours (k, 3) that approximately solve the normal equations products @ colors = sums.

    The colours lie in 0..1 and are multiples of 1 / levels. The equations are first solved without
    these conditions. If a colour is then outside 0..1, 20 sweeps over all colours solve for one
    colour after the other, and clip it to 0..1. At the end, 3 sweeps do the same and also round
    each colour. Each colour is solved for the rounded values of the others, so it makes up for
    their rounding errors.
    """
    if not len(sums):
        return np.zeros((0, 3))
    diagonal = np.maximum(np.diag(products), 1e-9)
    # The equations can thus be solved even if some shapes are nearly hidden.
    damped = products + 1e-6 * np.diag(diagonal + diagonal.max())
    color = portable.solve(damped, sums)
    bounded = 0 if (color >= 0).all() and (color <= 1).all() else 20
    color = np.minimum(np.maximum(color, 0), 1)
    order = np.argsort(-diagonal, kind="stable")
    arrays = np.ascontiguousarray(products), np.ascontiguousarray(sums), diagonal, order
    for sweep in range(bounded + 3):
        _sweep_colors(len(sums), *arrays, 0.0 if sweep < bounded else float(levels), color)
    return color
