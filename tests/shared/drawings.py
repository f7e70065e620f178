"""Drawings of flat colours, as logos and icons have them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gauss2svg.photo.pixels import shrunk


def badge(side: int, times: int = 4) -> NDArray[np.float32]:
    """A disc, a bar and a ring of flat colours, as many times larger than `side` px."""
    y, x = (np.mgrid[: side * times, : side * times] + 0.5) / times * (64 / side)
    picture = np.full((*x.shape, 3), 0.95, np.float32)
    picture[np.hypot(x - 24, y - 26) < 17] = 0.1, 0.3, 0.7
    picture[(np.abs(x - y - 20) < 4) & (x + y < 100)] = 0.9, 0.2, 0.1
    picture[np.abs(np.hypot(x - 44, y - 44) - 11) < 3] = 0.1, 0.6, 0.3
    return picture


def antialiased_badge(side: int) -> NDArray[np.float32]:
    """That drawing at `side` px, whose edges are antialiased."""
    return shrunk(badge(side), side, side)


def smile(side: int) -> NDArray[np.float32]:
    """A face of flat colours at `side` px, antialiased."""
    y, x = np.mgrid[: side * 4, : side * 4] * (32 / side)
    r = np.hypot(x - 64, y - 64)
    picture = np.ones((*r.shape, 3), np.float32)
    picture[r < 54] = 0.2, 0.15, 0.05
    picture[r < 50] = 1.0, 0.8, 0.2
    for eye in (45, 83):
        picture[np.hypot(x - eye, 0.7 * (y - 50)) < 6] = 0.2, 0.15, 0.05
    mouth = (np.abs(np.hypot(x - 64, y - 66) - 30) < 3) & (y > 74)
    picture[mouth] = 0.7, 0.1, 0.1
    return shrunk(picture, side, side)
