"""Which Gaussians reach which tiles, and on which pixel rows of them.

The canvas is cut into tiles TILE_WIDTH pixels wide (one vector register of
float32) and TILE_HEIGHT rows high. A "pair" is one Gaussian in one tile. Only
the rows that its ellipse reaches in the tile's column strip are visited, so
work is counted in pair rows of TILE_WIDTH pixels.

The kernels step from row to row of a pair in float32, by w22 = 1 / (sy sqrt(1 - rho^2)) in
whitened offsets (gauss2svg.render.kernels.whitened): over 8 rows that rounds them by up to
1e-6 w22. Shapes thinner than LEAST_STEPPED, far below any of a fit, are pairs of one row each,
which takes no step.
"""

from typing import NamedTuple

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

import gauss2svg.render.threads  # noqa: F401  (acts when it is imported)

TILE_WIDTH = 16  # 16 float32 fill one 512-bit register, two of 256 bits
TILE_BITS = 4
TILE_HEIGHT = 1 << TILE_BITS
LEAST_STEPPED = 1 / 64  # px, of the width sy sqrt(1 - rho^2) down a column


class Pairs(NamedTuple):
    """Gaussian-tile pairs, stored Gaussian by Gaussian and listed tile by tile.

    offset    (n + 1,) int64: the pairs of Gaussian i are offset[i]:offset[i + 1]
    gaussian  (p,) int32: the Gaussian of a pair
    rows      (p, 2) int32: first and one past the last image row of a pair
    start     (tiles + 1,) int64: the list of tile t is order[start[t]:start[t + 1]]
    order     (p,) int32: pairs tile by tile, front to back (last painted first)
    most_rows the largest sum of pair rows over the tiles
    """

    offset: NDArray[np.int64]
    gaussian: NDArray[np.int32]
    rows: NDArray[np.int32]
    start: NDArray[np.int64]
    order: NDArray[np.int32]
    most_rows: int


@njit(cache=True, inline="always")
def _strip_rows(mx, my, sx, sy, rho, radius, x0, x1, h):
    """Image rows whose pixel centres an ellipse reaches between columns x0 and x1.

    The ellipse is cut at Mahalanobis distance radius. At the offset u from the
    mean its rim lies at v = sy (rho u / sx +- k sqrt(radius^2 - u^2 / sx^2)) with
    k = sqrt(1 - rho^2). The upper rim is concave with its top v = sy radius at
    u = rho sx radius; the lower rim is its mirror image.
    """
    reach = sx * radius
    u0 = max(x0 + 0.5 - mx, -reach)
    u1 = min(x1 - 0.5 - mx, reach)
    if u0 > u1:
        return 0, 0
    k = sy * np.sqrt((1.0 - rho) * (1.0 + rho))
    slope = rho * sy / sx
    half0 = k * np.sqrt(max(radius * radius - (u0 / sx) ** 2, 0.0))
    half1 = k * np.sqrt(max(radius * radius - (u1 / sx) ** 2, 0.0))
    at = rho * reach
    high = sy * radius if u0 <= at <= u1 else max(slope * u0 + half0, slope * u1 + half1)
    low = -sy * radius if u0 <= -at <= u1 else min(slope * u0 - half0, slope * u1 - half1)
    # Pixel row y has its centre at y + 0.5. Clamped before the conversion to int.
    first = np.ceil(min(max(my + low - 0.5, 0.0), h))
    last = np.floor(min(max(my + high - 0.5, -1.0), h - 1.0))
    return int(first), int(last) + 1


@njit(cache=True, inline="always")
def _columns(mx, reach, w):
    """First and one past the last tile column between mx - reach and mx + reach."""
    if mx + reach < 0.0 or mx - reach > w:
        return 0, 0
    first = max(mx - reach, 0.0)
    last = min(mx + reach, w - 1.0)
    return int(first) // TILE_WIDTH, int(last) // TILE_WIDTH + 1


@njit(cache=True, inline="always")
def _pair_bits(sy, rho):
    """Binary logarithm of how many rows of a tile a pair may hold: see the module."""
    return 0 if sy * np.sqrt((1.0 - rho) * (1.0 + rho)) < LEAST_STEPPED else TILE_BITS


@njit(parallel=True, cache=True)
def find_pairs(mean, sigma, rho, radius, h, w):
    """Pairs of n shapes (float64), cut at Mahalanobis distances radius (n,), on h x w px."""
    n = mean.shape[0]
    columns = (w + TILE_WIDTH - 1) // TILE_WIDTH
    tiles = columns * ((h + TILE_HEIGHT - 1) // TILE_HEIGHT)
    offset = np.zeros(n + 1, np.int64)
    for i in prange(n):
        mx, my, sx, sy = mean[i, 0], mean[i, 1], sigma[i, 0], sigma[i, 1]
        first, last = _columns(mx, sx * radius[i], w)
        bits = _pair_bits(sy, rho[i])
        count = 0
        for column in range(first, last):
            x0 = column * TILE_WIDTH
            y0, y1 = _strip_rows(mx, my, sx, sy, rho[i], radius[i], x0, min(x0 + TILE_WIDTH, w), h)
            if y1 > y0:
                count += ((y1 - 1) >> bits) - (y0 >> bits) + 1
        offset[i + 1] = count
    for i in range(n):
        offset[i + 1] += offset[i]
    total = offset[n]
    gaussian = np.empty(total, np.int32)
    tile = np.empty(total, np.int32)
    rows = np.empty((total, 2), np.int32)
    for i in prange(n):
        mx, my, sx, sy = mean[i, 0], mean[i, 1], sigma[i, 0], sigma[i, 1]
        first, last = _columns(mx, sx * radius[i], w)
        bits = _pair_bits(sy, rho[i])
        at = offset[i]
        for column in range(first, last):
            x0 = column * TILE_WIDTH
            y0, y1 = _strip_rows(mx, my, sx, sy, rho[i], radius[i], x0, min(x0 + TILE_WIDTH, w), h)
            if y1 > y0:
                for part in range(y0 >> bits, ((y1 - 1) >> bits) + 1):
                    gaussian[at] = i
                    tile[at] = (part << bits >> TILE_BITS) * columns + column
                    rows[at, 0] = max(y0, part << bits)
                    rows[at, 1] = min(y1, (part + 1) << bits)
                    at += 1
    # In eight shares, each counted and filled in parallel, this was no faster.
    start = np.zeros(tiles + 1, np.int64)
    height = np.zeros(tiles, np.int64)
    for p in range(total):
        start[tile[p] + 1] += 1
        height[tile[p]] += rows[p, 1] - rows[p, 0]
    for t in range(tiles):
        start[t + 1] += start[t]
    order = np.empty(total, np.int32)
    fill = start[1:].copy()
    for p in range(total):  # ascending Gaussians fill each list from its back
        fill[tile[p]] -= 1
        order[fill[tile[p]]] = p
    return offset, gaussian, rows, start, order, height.max() if tiles > 0 else 0
