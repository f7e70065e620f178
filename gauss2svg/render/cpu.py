"""The fast CPU renderer: numba kernels over 16 x 16 tiles, forward and backward.

It computes in the dtype of its image, float32 or float64. The kernels for float64 are compiled on
first use.

Cost is counted in pair rows: one Gaussian on one row of one tile, 16 pixels. The kernels compute a
row as explicit lanes (gauss2svg.render.simd). This takes a fifth of the time of LLVM's vectoriser,
and half the time of loops over whole tiles (docs/decisions/kernels.md).

Each thread takes a share of the tiles. A tile writes only its own pixels and pairs, and pairs are
added up Gaussian by Gaussian, so the number of threads changes no bit of any result.
"""

import os
import threading

# pyright: reportCallIssue=false
# numba itself passes typingctx, the first argument of the intrinsics of simd.py.
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba import njit
from numba.core.compiler_lock import global_compiler_lock
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.render.kernels import MOMENTS, backpropagate_tile, compose_tile, removal_tile
from gauss2svg.render.simd import load, splat, store, total
from gauss2svg.render.tiles import TILE_HEIGHT, TILE_WIDTH, find_pairs, in_shares, kernel
from gauss2svg.scene import ADD, PLAIN, Scene, whitening_of
from gauss2svg.scene.falloff import covered_radius, cut_radius, longer_axes

# Modes of the kernels. RENDER computes the image. SQUARED_ERROR computes the image and the moments
# of the gradient of its squared error. GIVEN_GRADIENT computes only the moments of a gradient that
# is passed as `image`. REMOVAL computes the image and the cost of removing each Gaussian.
RENDER, SQUARED_ERROR, GIVEN_GRADIENT, REMOVAL = range(4)


def tile_buffers(most_rows: int, dtype: Any, additive: bool) -> tuple[Any, ...]:
    """Return walk_tiles' buffers, `alpha` to `columns`, for tiles of up to most_rows pair rows.

    alpha, transmittance, steep, logs  (most_rows * TILE_WIDTH,) see gauss2svg.render.kernels
    color, gradient, behind  (3, TILE_HEIGHT, TILE_WIDTH) see gauss2svg.render.kernels
    remaining  (TILE_HEIGHT, TILE_WIDTH) transmittance behind all Gaussians; 1 in additive blending
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
    """Do what _errors_of_tile does, for a tile that the image's right edge does not cut."""
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
            if mode == SQUARED_ERROR or mode == REMOVAL:
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
    """Write `out` and `gradient` of a tile as `mode` needs them. Return its squared error."""
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
                if mode == SQUARED_ERROR or mode == REMOVAL:
                    error = value - image[channel, y0 + y, x0 + x]
                    squares += error * error
                    if mode == SQUARED_ERROR:
                        error *= weight[y0 + y, x0 + x]
                    gradient[channel, y, x] = error
    return squares


@njit(inline="always")
def _weights_of_tile(x0, y0, h, w, weight, out):
    """Write the weights of a tile's pixels to `out`, 0 outside the image."""
    for y in range(TILE_HEIGHT):
        for x in range(TILE_WIDTH):
            out[y, x] = weight[y0 + y, x0 + x] if y < h and x < w else 0.0


@kernel
def walk_tiles(
    mode, share, shares, shape, opacity_color, background, image, weight,
    gaussian, rows, start, order, alpha, transmittance, steep, logs, color, gradient, behind,
    remaining, inside, columns, pair_out, out, loss,
):  # fmt: skip
    """Blend one share of the tiles, front to back, in a mode. Write to pair_out, out and loss.

    background, image, weight, pair_out and out are all float32 or all float64.
    weight (h, w) scales the gradient of SQUARED_ERROR and the costs of REMOVAL. Other modes do not
    read it. `gaussian` to `order` are fields of gauss2svg.render.tiles.Pairs, and `alpha` to
    `columns` come from tile_buffers.
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
        if mode == SQUARED_ERROR or mode == GIVEN_GRADIENT:
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
            _weights_of_tile(x0, y0, h, w, weight, color[0])  # buffer color[0] is free by now
            removal_tile(
                order, first, end, y0, opacity_color, gaussian, rows,
                alpha, transmittance, filled, gradient, color[0], behind, pair_out,
            )  # fmt: skip


@kernel
def add_pairs(share, shares, offset, pair_values, totals):
    """Add pair_values (p, m) of a share of the Gaussians to their totals (n, m), float64.

    offset (n + 1,): Gaussian i has the pairs offset[i]:offset[i + 1].
    """
    n = offset.size - 1
    for i in range(n * share // shares, n * (share + 1) // shares):
        for p in range(offset[i], offset[i + 1]):
            for k in range(pair_values.shape[1]):
                totals[i, k] += pair_values[p, k]


# A fit holds this lock from its start to its end. Fits at the same time would share the threads of
# one machine, and none would be faster.
kernel_lock = threading.RLock()


def _free_kernel_lock() -> None:
    """In a forked process, release the lock if another thread of the parent holds it."""
    if kernel_lock.acquire(blocking=False):  # the lock is free, or held by the forking thread
        kernel_lock.release()
    else:
        kernel_lock._at_fork_reinit()  # pyright: ignore[reportAttributeAccessIssue] (as in logging)


if hasattr(os, "register_at_fork"):
    # Threads do not survive a fork, but the locks that they hold stay held. A fit may take minutes,
    # so the child releases the lock of fits. A compilation takes seconds and changes the state of
    # LLVM, so the fork waits for its end.
    os.register_at_fork(
        before=global_compiler_lock.acquire,
        after_in_parent=global_compiler_lock.release,
        after_in_child=global_compiler_lock.release,
    )
    os.register_at_fork(after_in_child=_free_kernel_lock)

# Smallest share, in pair rows, that is worth waking a thread for, in walk_tiles and in add_pairs.
_LEAST_SHARE, _LEAST_ADDED = 4096, 65536

Real = TypeVar("Real", bound=np.floating)  # np.float32 or np.float64


class Splats(NamedTuple):
    """Arrays of n Gaussians as the kernels read them: float64, bottom first.

    mean (n, 2), sigma (n, 2), rho (n,), radius (n,)  ellipses, for which find_pairs lists tiles
    shape          (n, 11) mean x, y, whitening w11, w21, w22, beta, radius^2, o11, o21, o22 and the
                   largest share. The last four are 0 unless the shape is a plain ellipse that
                   covers shares of pixels. Such an ellipse covers at most the largest share of a
                   pixel, and nothing where (o11 z1, o21 z1 + o22 z2) is outside the unit disc.
    opacity_color  (n, 4) opacity, r, g, b
    background     (3,)
    additive       whether blending is additive. Opacities and exponents are then not read
    """

    mean: NDArray[np.float64]
    sigma: NDArray[np.float64]
    rho: NDArray[np.float64]
    radius: NDArray[np.float64]
    shape: NDArray[np.float64]
    opacity_color: NDArray[np.float64]
    background: NDArray[np.float64]
    additive: bool = False

    @property
    def opacity(self) -> NDArray[np.float64]:
        """Opacities (n,) in 0..1."""
        return self.opacity_color[:, 0]

    @property
    def beta(self) -> NDArray[np.float64]:
        """Exponents (n,) of the falloff."""
        return self.shape[:, 5]


def splats_from(
    mean: NDArray[np.float64],
    sigma: NDArray[np.float64],
    rho: NDArray[np.float64],
    whitening: NDArray[np.float64],
    *,
    color: NDArray[np.float64],
    opacity: NDArray[np.float64],
    beta: NDArray[np.float64],
    background: NDArray[np.float64],
    additive: bool = False,
    is_plain: NDArray[np.bool_] | None = None,
) -> Splats:
    """Return the splats of n Gaussians from the arrays of a scene's parameters.

    whitening (n, 3) is that of gauss2svg.scene.whitening_of. is_plain (n,) marks plain ellipses,
    which cover shares of pixels. None marks no shape.
    """
    radius = cut = cut_radius(beta)
    outer = np.zeros((len(mean), 4))
    if is_plain is not None and is_plain.any():
        radius = np.where(is_plain, covered_radius(beta), radius)
        longer, max_share = longer_axes(whitening, radius)
        w11, w21, w22 = longer.T
        l11, l22 = 1 / w11, 1 / w22
        l21 = -w21 * l11 * l22
        sy = np.hypot(l21, l22)
        sigma = np.where(is_plain[:, None], np.column_stack([l11, sy]), sigma)
        rho, cut = np.where(is_plain, l21 / sy, rho), np.where(is_plain, 1.0, cut)
        # o11, o21, o22 map z to coordinates in which the longer ellipse is the unit disc.
        v11, v21, v22 = whitening.T
        factors = np.column_stack([w11 / v11, (w21 - v21 * w22 / v22) / v11, w22 / v22, max_share])
        outer = np.where(is_plain[:, None], factors, 0.0)
    return Splats(
        mean,
        sigma,
        rho,
        cut,
        np.column_stack([mean, whitening, beta, radius * radius, outer]),
        np.column_stack([opacity, color]),
        background,
        additive,
    )


def splats_of(
    scene: Scene, scale: tuple[float, float] = (1.0, 1.0), covering: bool = False
) -> Splats:
    """Return the splats of a scene that is scaled along x and y.

    Unlike in scene.scaled(*scale), the scaled shapes may leave the domain of scenes.
    covering: see gauss2svg.render.render.
    """
    # Arrays are copied, because numba would compile the kernels again for read-only arrays.
    sigma = scene.sigma * scale
    return splats_from(
        scene.mean * scale,
        sigma,
        scene.rho.copy(),
        whitening_of(sigma, scene.rho),
        color=scene.color,
        opacity=scene.opacity,
        beta=scene.beta,
        background=scene.background.copy(),
        additive=scene.blend == ADD,
        is_plain=scene.drawn == PLAIN if covering else None,
    )


def _visit(
    mode: int,
    splats: Splats,
    image: NDArray[Real],
    pair_width: int,
    weight: NDArray[Real] | None = None,
) -> tuple[NDArray[Real], float, NDArray[np.float64], int]:
    """Run the kernels. Return image, squared error, sums (n, pair_width) by Gaussian, pair rows."""
    if image.ndim != 3 or image.shape[0] != 3 or image.dtype not in (np.float32, np.float64):
        raise InputError(
            f"image must be float32 or float64 (3, height, width); got {image.dtype} {image.shape}"
        )
    # numba would compile the kernels again for arrays that are read-only or not contiguous.
    image = np.require(image, requirements=["C", "W"])
    if weight is None:
        is_read = mode in (SQUARED_ERROR, REMOVAL)
        weight = np.ones(image.shape[1:] if is_read else (1, 1), image.dtype)
    weight = np.require(weight, image.dtype, ["C", "W"])
    pairs = find_pairs(splats.mean, splats.sigma, splats.rho, splats.radius, *image.shape[1:])
    row_count = int((pairs.rows[:, 1] - pairs.rows[:, 0]).sum())
    out = np.empty_like(image)
    pair_out = np.empty((len(pairs.gaussian), pair_width), image.dtype)
    loss = np.zeros(len(pairs.start) - 1)
    totals = np.zeros((len(splats.mean), pair_width))
    background = splats.background.astype(image.dtype)

    def walk_share(share: int, shares: int) -> None:
        walk_tiles(
            mode, share, shares, splats.shape, splats.opacity_color, background, image, weight,
            pairs.gaussian, pairs.rows, pairs.start, pairs.order,
            *tile_buffers(pairs.most_rows, image.dtype, splats.additive), pair_out, out, loss,
        )  # fmt: skip

    def add_share(share: int, shares: int) -> None:
        add_pairs(share, shares, pairs.offset, pair_out, totals)

    in_shares(walk_share, row_count // _LEAST_SHARE)
    if mode != RENDER:
        in_shares(add_share, row_count // _LEAST_ADDED)
    return out, float(loss.sum()), totals, row_count


def render_planar(
    splats: Splats, height: int, width: int, dtype: type[Real] = np.float32
) -> NDArray[Real]:
    """Return the image (3, height, width) of the Gaussians, sampled at pixel centres.

    Raise InputError unless dtype is np.float32 or np.float64.
    """
    blank = np.zeros((3, height, width), dtype)  # never read, so it takes no memory
    return _visit(RENDER, splats, blank, 1)[0]


def squared_error(
    splats: Splats, target: NDArray[Real], weight: NDArray[Real] | None = None
) -> tuple[NDArray[Real], float, NDArray[np.float64], int]:
    """Return the image, its sum of squared errors, moments (n, MOMENTS), and number of pair rows.

    target  (3, h, w) float32 or float64, the dtype of the whole computation
    weight  (h, w) > 0, or None for 1
    The sum is not weighted. The moments (gauss2svg.render.kernels) belong to the gradient of
    L = 1/2 sum weight (rendered - target)^2. Each tile is visited once, for both passes.
    """
    return _visit(SQUARED_ERROR, splats, target, MOMENTS, weight)


def moments_of_gradient(splats: Splats, gradient: NDArray[Real]) -> NDArray[np.float64]:
    """Return the moments (n, MOMENTS) that follow from `gradient`, dL/dpixel (3, h, w)."""
    return _visit(GIVEN_GRADIENT, splats, gradient, MOMENTS)[2]


def removal_cost(
    splats: Splats, target: NDArray[Real], weight: NDArray[Real] | None = None
) -> tuple[NDArray[Real], NDArray[np.float64]]:
    """Return the image, and each Gaussian's cost of removal and mass (n, 2).

    The cost is the change of sum weight (rendered - target)^2 if the Gaussian is removed, so that
    shapes behind it show. It is negative if the image then matches better. The mass is sum
    weight w^2 with w as in gauss2svg.render.kernels; weight is (h, w) > 0, or None for 1.
    """
    image, _, cost, _ = _visit(REMOVAL, splats, target, 2, weight)
    return image, cost
