"""The fast CPU renderer: numba kernels over 16 x 16 tiles, forward and backward.

It computes in float32 or in float64, whichever the image that it is handed has; the
kernels are compiled for float64 when first asked for it.

Cost is counted in pair rows: one Gaussian on one row of one tile, 16 pixels.
Measured on two cores of an AMD EPYC with 512-bit registers, 5000 Gaussians on a
768x512 photo, forward and backward of the squared error:

    whole tiles, loops left to LLVM's vectoriser    29 ms, 20 M pixel pairs
    rows only, loops left to the vectoriser         70 ms, 15 M (not vectorised)
    rows only, explicit lanes (simd.py)             15 ms, 15 M   <- this file

Tiles are dealt to the workers round robin, every tile writes only its own pixels
and its own pairs, and pairs are summed Gaussian by Gaussian: the number of
threads changes no bit of any result.
"""

import threading
from typing import NamedTuple, TypeVar

import numpy as np
from numba import get_num_threads, njit, prange
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.falloff import cut_radius
from gauss2svg.render.kernels import (
    MOMENTS,
    backpropagate_tile,
    compose_tile,
    removal_tile,
)
from gauss2svg.render.tiles import TILE_HEIGHT, TILE_WIDTH, Pairs, find_pairs
from gauss2svg.scene import Scene

# numba's fallback threading layer aborts the process if two Python threads are in a
# parallel kernel at once; whoever calls one holds this lock.
kernel_lock = threading.RLock()

Real = TypeVar("Real", bound=np.floating)  # np.float32 or np.float64

_RENDER, _SQUARED_ERROR, _GIVEN_GRADIENT, _REMOVAL = range(4)


class Splats(NamedTuple):
    """What the kernels read of n Gaussians, bottom first; all float64.

    mean (n, 2), sigma (n, 2), rho (n,), radius (n,) of the cut: for the tiles
    shape (n, 7): mean x, y, whitening w11, w21, w22, beta and radius^2
    paint (n, 4): opacity, r, g, b
    background (3,)
    """

    mean: NDArray[np.float64]
    sigma: NDArray[np.float64]
    rho: NDArray[np.float64]
    radius: NDArray[np.float64]
    shape: NDArray[np.float64]
    paint: NDArray[np.float64]
    background: NDArray[np.float64]


def splats_of(scene: Scene) -> Splats:
    """The kernels' view of a scene."""
    radius = cut_radius(scene.betas)
    # Copies: numba compiles everything once more for read-only arrays.
    return Splats(
        scene.mean.copy(),
        scene.sigma.copy(),
        scene.rho.copy(),
        radius,
        np.column_stack([scene.mean, scene.whitening, scene.betas, radius**2]),
        np.concatenate([scene.opacity[:, None], scene.color], axis=1),
        scene.background.copy(),
    )


@njit(parallel=True, cache=True)
def _walk_tiles(mode, workers, shape, paint, background, image, weight, pairs, pair_out, out, loss):
    """Visit every tile in one of the four modes; see the functions below.

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
        column = np.empty(TILE_WIDTH, real)
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
            squares = 0.0
            g[:] = 0.0
            for channel in range(3):
                ground = real(background[channel])
                for y in range(h):
                    for x in range(w):
                        value = acc[channel, y, x] + left[y, x] * ground
                        if mode == _GIVEN_GRADIENT:
                            g[channel, y, x] = image[channel, y0 + y, x0 + x]
                        else:
                            out[channel, y0 + y, x0 + x] = value
                        if mode in (_SQUARED_ERROR, _REMOVAL):
                            e = value - image[channel, y0 + y, x0 + x]
                            squares += e * e
                            if mode == _SQUARED_ERROR:
                                e *= weight[y0 + y, x0 + x]
                            g[channel, y, x] = e
            loss[tile] = squares
            if mode in (_SQUARED_ERROR, _GIVEN_GRADIENT):
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
            elif mode == _REMOVAL:
                for channel in range(3):
                    behind[channel] = real(background[channel])
                removal_tile(
                    listed, y0, paint, gaussian, rows, alpha, trans, filled, g, behind, pair_out
                )


@njit(parallel=True, cache=True)
def _sum_pairs(offset, pair_values):
    """(n, m) float64 sums of the pairs of each Gaussian."""
    n = offset.shape[0] - 1
    m = pair_values.shape[1]
    sums = np.zeros((n, m))
    for i in prange(n):
        for p in range(offset[i], offset[i + 1]):
            for k in range(m):
                sums[i, k] += pair_values[p, k]
    return sums


def _visit(
    mode: int,
    splats: Splats,
    image: NDArray[Real],
    pair_width: int,
    weight: NDArray[Real] | None = None,
) -> tuple[NDArray[Real], float, NDArray[np.float64], int]:
    if image.ndim != 3 or image.shape[0] != 3 or image.dtype not in (np.float32, np.float64):
        raise InputError(
            f"image is {image.dtype} {image.shape}; needed is float32 or float64 (3, height, width)"
        )
    _, height, width = image.shape
    # One numba type for all callers: read-only arrays would be compiled for once more.
    image = np.require(image, requirements=["C", "W"])
    if weight is None:
        weight = np.ones((1, 1) if mode != _SQUARED_ERROR else (height, width), image.dtype)
    weight = np.require(weight, image.dtype, ["C", "W"])
    with kernel_lock:
        return _visit_locked(mode, splats, image, weight, pair_width)


def _visit_locked(
    mode: int,
    splats: Splats,
    image: NDArray[Real],
    weight: NDArray[Real],
    pair_width: int,
) -> tuple[NDArray[Real], float, NDArray[np.float64], int]:
    _, height, width = image.shape
    pairs = Pairs(*find_pairs(splats.mean, splats.sigma, splats.rho, splats.radius, height, width))
    out = np.empty_like(image)
    pair_out = np.empty((len(pairs.gaussian), pair_width), image.dtype)
    loss = np.zeros(len(pairs.start) - 1)
    _walk_tiles(
        mode, get_num_threads(), splats.shape, splats.paint, splats.background,
        image, weight, pairs, pair_out, out, loss,
    )  # fmt: skip
    row_count = int((pairs.rows[:, 1] - pairs.rows[:, 0]).sum())
    return out, float(loss.sum()), _sum_pairs(pairs.offset, pair_out), row_count


def render_planar(
    splats: Splats, height: int, width: int, dtype: type[Real] = np.float32
) -> NDArray[Real]:
    """(3, height, width) image of the Gaussians, one sample at each pixel centre.

    dtype is np.float32 or np.float64; InputError for another.
    """
    blank = np.broadcast_to(np.zeros((), dtype), (3, height, width))
    return _visit(_RENDER, splats, blank, 1)[0]


def squared_error(
    splats: Splats, target: NDArray[Real], weight: NDArray[Real] | None = None
) -> tuple[NDArray[Real], float, NDArray[np.float64], int]:
    """Image, sum of squared errors, gradient as moments (n, MOMENTS), and pair rows.

    target is (3, h, w), weight (h, w) > 0 or None for 1; target's dtype, float32 or float64,
    is what is computed in. The sum is not weighted. The moments (gauss2svg.render.kernels)
    belong to L = 1/2 sum weight (rendered - target)^2; forward and backward share one visit
    of a tile.
    """
    return _visit(_SQUARED_ERROR, splats, target, MOMENTS, weight)


def moments_of_gradient(splats: Splats, gradient: NDArray[Real]) -> NDArray[np.float64]:
    """Moments (n, MOMENTS) of any loss from its gradient (3, h, w) with respect to the image."""
    return _visit(_GIVEN_GRADIENT, splats, gradient, MOMENTS)[2]


def removal_cost(
    splats: Splats, target: NDArray[Real]
) -> tuple[NDArray[Real], NDArray[np.float64]]:
    """Image, and (n, 2): what taking each Gaussian away costs, and the sum of its w^2.

    The cost is the change of the summed squared error against target (3, h, w), with
    what lies behind showing through; negative where the picture would gain.
    """
    image, _, cost, _ = _visit(_REMOVAL, splats, target, 2)
    return image, cost
