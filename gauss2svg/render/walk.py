"""Walks over all tiles of a picture, in parallel, for each of the kernels' four jobs.

Tiles are dealt to the workers round robin, every tile writes only its own pixels and its own
pairs, and pairs are summed Gaussian by Gaussian: the number of threads changes no bit of any
result.
"""

import numpy as np
from numba import njit, prange

from gauss2svg.render.kernels import backpropagate_tile, compose_tile, removal_tile
from gauss2svg.render.sums import backpropagate_sum_tile, removal_sum_tile, sum_tile
from gauss2svg.render.tiles import TILE_HEIGHT, TILE_WIDTH

# What is made of the tiles: a picture; also the moments of its squared error's gradient; those
# of a given gradient; what taking each Gaussian away would cost.
RENDER, SQUARED_ERROR, GIVEN_GRADIENT, REMOVAL = range(4)


@njit(inline="always")
def _errors_of_tile(mode, x0, y0, h, w, acc, left, background, image, weight, out, g):
    """Put a tile into out and its gradient by the pixels into g; returns its squared error."""
    real = out.dtype.type
    squares = 0.0
    g[:] = 0.0
    for channel in range(3):
        ground = real(background[channel])
        for y in range(h):
            for x in range(w):
                value = acc[channel, y, x] + left[y, x] * ground
                if mode == GIVEN_GRADIENT:
                    g[channel, y, x] = image[channel, y0 + y, x0 + x]
                else:
                    out[channel, y0 + y, x0 + x] = value
                if mode in (SQUARED_ERROR, REMOVAL):
                    e = value - image[channel, y0 + y, x0 + x]
                    squares += e * e
                    if mode == SQUARED_ERROR:
                        e *= weight[y0 + y, x0 + x]
                    g[channel, y, x] = e
    return squares


@njit(parallel=True, cache=True)
def walk_tiles(mode, workers, shape, paint, background, image, weight, pairs, pair_out, out, loss):
    """Compose every tile, front to back, for one of the four jobs.

    All of image, weight, pair_out and out are of one type, float32 or float64.
    weight (h, w) scales the gradient of the squared error, and is read for nothing else.
    """
    _, gaussian, rows, start, order, most_rows = pairs
    height, width = out.shape[1:]
    columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
    tiles = columns * ((height + TILE_HEIGHT - 1) // TILE_HEIGHT)
    for worker in prange(workers):
        real = out.dtype.type
        alpha = np.empty(most_rows * TILE_WIDTH, real)
        trans = np.empty(most_rows * TILE_WIDTH, real)
        steep = np.empty(most_rows * TILE_WIDTH, real)
        logs = np.empty(most_rows * TILE_WIDTH, real)
        acc = np.empty((3, TILE_HEIGHT, TILE_WIDTH), real)
        g = np.empty((3, TILE_HEIGHT, TILE_WIDTH), real)
        behind = np.empty((3, TILE_HEIGHT, TILE_WIDTH), real)
        left = np.empty((TILE_HEIGHT, TILE_WIDTH), real)
        inside = np.empty(TILE_WIDTH, real)
        column = np.empty(TILE_WIDTH, np.float64)
        for x in range(TILE_WIDTH):
            column[x] = x
        for tile in range(worker, tiles, workers):
            x0 = (tile % columns) * TILE_WIDTH
            y0 = (tile // columns) * TILE_HEIGHT
            h = min(TILE_HEIGHT, height - y0)
            w = min(TILE_WIDTH, width - x0)
            for x in range(TILE_WIDTH):
                inside[x] = 1.0 if x < w else 0.0
            listed = order[start[tile] : start[tile + 1]]
            filled = compose_tile(
                listed, x0, y0, column, inside, shape, paint, gaussian, rows,
                alpha, trans, steep, logs, acc, left,
            )  # fmt: skip
            squares = _errors_of_tile(
                mode, x0, y0, h, w, acc, left, background, image, weight, out, g
            )
            loss[tile] = squares
            if mode in (SQUARED_ERROR, GIVEN_GRADIENT):
                for y in range(TILE_HEIGHT):
                    for x in range(TILE_WIDTH):
                        behind[0, y, x] = (
                            g[0, y, x] * real(background[0])
                            + g[1, y, x] * real(background[1])
                            + g[2, y, x] * real(background[2])
                        )
                backpropagate_tile(
                    listed, x0, y0, column, shape, paint, gaussian, rows,
                    alpha, trans, steep, logs, filled, g, behind[0], pair_out,
                )  # fmt: skip
            elif mode == REMOVAL:
                for channel in range(3):
                    behind[channel] = real(background[channel])
                removal_tile(
                    listed, y0, paint, gaussian, rows, alpha, trans, filled, g, behind, pair_out
                )


@njit(parallel=True, cache=True)
def sum_tiles(mode, workers, shape, paint, background, image, weight, pairs, pair_out, out, loss):
    """The same for Gaussians that are summed; paint's opacities are not read."""
    _, gaussian, rows, start, order, most_rows = pairs
    height, width = out.shape[1:]
    columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
    tiles = columns * ((height + TILE_HEIGHT - 1) // TILE_HEIGHT)
    for worker in prange(workers):
        real = out.dtype.type
        alpha = np.empty(most_rows * TILE_WIDTH, real)
        acc = np.empty((3, TILE_HEIGHT, TILE_WIDTH), real)
        g = np.empty((3, TILE_HEIGHT, TILE_WIDTH), real)
        left = np.ones((TILE_HEIGHT, TILE_WIDTH), real)  # the background is never covered
        inside = np.empty(TILE_WIDTH, real)
        column = np.empty(TILE_WIDTH, np.float64)
        for x in range(TILE_WIDTH):
            column[x] = x
        for tile in range(worker, tiles, workers):
            x0 = (tile % columns) * TILE_WIDTH
            y0 = (tile // columns) * TILE_HEIGHT
            h = min(TILE_HEIGHT, height - y0)
            w = min(TILE_WIDTH, width - x0)
            for x in range(TILE_WIDTH):
                inside[x] = 1.0 if x < w else 0.0
            listed = order[start[tile] : start[tile + 1]]
            sum_tile(listed, x0, y0, column, inside, shape, paint, gaussian, rows, alpha, acc)
            loss[tile] = _errors_of_tile(
                mode, x0, y0, h, w, acc, left, background, image, weight, out, g
            )
            if mode in (SQUARED_ERROR, GIVEN_GRADIENT):
                backpropagate_sum_tile(
                    listed, x0, y0, column, shape, paint, gaussian, rows, alpha, g, pair_out
                )
            elif mode == REMOVAL:
                removal_sum_tile(listed, y0, paint, gaussian, rows, alpha, g, pair_out)


@njit(parallel=True, cache=True)
def sum_pairs(offset, pair_values):
    """(n, m) float64 sums of the pairs of each Gaussian."""
    n = offset.shape[0] - 1
    m = pair_values.shape[1]
    sums = np.zeros((n, m))
    for i in prange(n):
        for p in range(offset[i], offset[i + 1]):
            for k in range(m):
                sums[i, k] += pair_values[p, k]
    return sums
