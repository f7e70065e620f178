"""Visits all tiles of a picture, for each of the renderer's four modes.

Tiles are dealt to the shares of the work in turn, every tile writes only its own pixels and its
own pairs, and pairs are added up Gaussian by Gaussian: the number of threads changes no bit of
any result.
"""

# pyright: reportCallIssue=false
# The intrinsics of simd.py take a typing context that numba passes by itself.

from typing import Any

import numpy as np
from numba import njit

from gauss2svg.render.kernels import backpropagate_tile, compose_tile, removal_tile
from gauss2svg.render.simd import load, splat, store, total
from gauss2svg.render.threads import kernel
from gauss2svg.render.tiles import TILE_HEIGHT, TILE_WIDTH

# What is computed: the image; also the moments of the gradient of its squared error; those of a
# given gradient; what removing each Gaussian would cost.
RENDER, SQUARED_ERROR, GIVEN_GRADIENT, REMOVAL = range(4)


def tile_buffers(most_rows: int, dtype: Any, additive: bool) -> tuple[Any, ...]:
    """Return working memory for a tile of up to most_rows pair rows: `alpha` to `columns`.

    alpha, transmittance, steep, logs  (most_rows * TILE_WIDTH,) see gauss2svg.render.kernels
    color, gradient, behind  (3, TILE_HEIGHT, TILE_WIDTH) as there
    remaining  (TILE_HEIGHT, TILE_WIDTH) transmittance behind all Gaussians; 1 on entry
    inside     (TILE_WIDTH,) 1 for columns of the image, 0 beyond its right edge
    columns    (TILE_WIDTH,) float64: 0, 1, ...
    """
    alpha, transmittance, *powers = np.empty((4, most_rows * TILE_WIDTH), dtype)
    tiles = np.empty((3, 3, TILE_HEIGHT, TILE_WIDTH), dtype)
    remaining, inside = np.ones((TILE_HEIGHT, TILE_WIDTH), dtype), np.empty(TILE_WIDTH, dtype)
    columns = np.arange(TILE_WIDTH, dtype=np.float64)
    return (alpha, None if additive else transmittance, *powers, *tiles, remaining, inside, columns)


@njit(inline="always")
def _errors_of_whole_rows(
    mode, x0, y0, h, color, remaining, background, image, weight, out, gradient
):  # fmt: skip
    """_errors_of_tile of a tile that no right edge cuts."""
    squares = 0.0
    height, width = out.shape[1:]
    for channel in range(3):
        ground = splat(background[channel], gradient)
        for y in range(TILE_HEIGHT):
            j = (channel * TILE_HEIGHT + y) * TILE_WIDTH
            if y >= h:
                store(gradient, j, splat(0.0, gradient))
                continue
            at = (channel * height + y0 + y) * width + x0
            if mode == GIVEN_GRADIENT:
                store(gradient, j, load(image, at))
                continue
            value = load(color, j) + load(remaining, y * TILE_WIDTH) * ground
            store(out, at, value)
            if mode in (SQUARED_ERROR, REMOVAL):
                error = value - load(image, at)
                squares += total(error * error)
                if mode == SQUARED_ERROR:
                    error = error * load(weight, (y0 + y) * width + x0)
                store(gradient, j, error)
    return squares


@njit(inline="always")
def _errors_of_tile(
    mode, x0, y0, h, w, color, remaining, background, image, weight, out, gradient
):  # fmt: skip
    """Write a tile to out and its pixels' gradient to gradient; returns its squared error."""
    if w == TILE_WIDTH:
        return _errors_of_whole_rows(
            mode, x0, y0, h, color, remaining, background, image, weight, out, gradient
        )
    squares = 0.0
    for channel in range(3):
        ground = background[channel]
        for y in range(TILE_HEIGHT):
            for x in range(TILE_WIDTH):
                if y >= h or x >= w:
                    gradient[channel, y, x] = 0.0
                    continue
                value = color[channel, y, x] + remaining[y, x] * ground
                if mode == GIVEN_GRADIENT:
                    gradient[channel, y, x] = image[channel, y0 + y, x0 + x]
                else:
                    out[channel, y0 + y, x0 + x] = value
                if mode in (SQUARED_ERROR, REMOVAL):
                    error = value - image[channel, y0 + y, x0 + x]
                    squares += error * error
                    if mode == SQUARED_ERROR:
                        error *= weight[y0 + y, x0 + x]
                    gradient[channel, y, x] = error
    return squares


@njit(inline="always")
def _weights_of_tile(x0, y0, h, w, weight, out):
    """Write a tile's weights to out, 0 outside the image."""
    for y in range(TILE_HEIGHT):
        for x in range(TILE_WIDTH):
            out[y, x] = weight[y0 + y, x0 + x] if y < h and x < w else 0.0


@kernel
def walk_tiles(
    mode, share, shares, shape, opacity_color, background, image, weight,
    gaussian, rows, start, order, alpha, transmittance, steep, logs, color, gradient, behind,
    remaining, inside, columns, pair_out, out, loss,
):  # fmt: skip
    """Alpha-composite one share of the tiles, front to back, in one of the four modes.

    background, image, weight, pair_out and out are all float32 or all float64.
    weight (h, w) scales the squared error's gradient and removal costs, and is read for these.
    gaussian to order are those of gauss2svg.render.tiles.Pairs, alpha to columns tile_buffers.
    """
    height, width = out.shape[1:]
    tile_columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
    for tile in range(share, start.size - 1, shares):
        x0 = (tile % tile_columns) * TILE_WIDTH
        y0 = (tile // tile_columns) * TILE_HEIGHT
        h = min(TILE_HEIGHT, height - y0)
        w = min(TILE_WIDTH, width - x0)
        for x in range(TILE_WIDTH):
            inside[x] = 1.0 if x < w else 0.0
        first, end = start[tile], start[tile + 1]
        filled = compose_tile(
            order, first, end, x0, y0, columns, inside, shape, opacity_color, gaussian, rows,
            alpha, transmittance, steep, logs, color, remaining,
        )  # fmt: skip
        loss[tile] = _errors_of_tile(
            mode, x0, y0, h, w, color, remaining, background, image, weight, out, gradient
        )
        if mode in (SQUARED_ERROR, GIVEN_GRADIENT):
            for y in range(TILE_HEIGHT):
                for x in range(TILE_WIDTH):
                    behind[0, y, x] = (
                        gradient[0, y, x] * background[0]
                        + gradient[1, y, x] * background[1]
                        + gradient[2, y, x] * background[2]
                    )
            backpropagate_tile(
                order, first, end, x0, y0, columns, shape, opacity_color, gaussian, rows,
                alpha, transmittance, steep, logs, filled, gradient, behind, pair_out,
            )  # fmt: skip
        elif mode == REMOVAL:
            for channel in range(3):
                for y in range(TILE_HEIGHT):
                    for x in range(TILE_WIDTH):
                        behind[channel, y, x] = background[channel]
            _weights_of_tile(x0, y0, h, w, weight, color[0])  # the colours have been read
            removal_tile(
                order, first, end, y0, opacity_color, gaussian, rows,
                alpha, transmittance, filled, gradient, color[0], behind, pair_out,
            )  # fmt: skip


@kernel
def add_pairs(share, shares, offset, pair_values, totals):
    """Add the values (p, m) of each Gaussian's pairs to totals (n, m), float64.

    offset (n + 1,): the pairs of Gaussian i are offset[i]:offset[i + 1].
    """
    n = offset.size - 1
    for i in range(n * share // shares, n * (share + 1) // shares):
        for p in range(offset[i], offset[i + 1]):
            for k in range(pair_values.shape[1]):
                totals[i, k] += pair_values[p, k]
