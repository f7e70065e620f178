"""The fast CPU renderer: numba kernels over 16 x 16 tiles, forward and backward.

It computes in float32 or in float64, whichever dtype the image passed to it has; the kernels are
compiled for float64 when it is first used.

Cost is counted in pair rows: one Gaussian on one row of one tile, 16 pixels. Rows of explicit
lanes (gauss2svg.render.simd) take a fifth of the time of loops left to LLVM's vectoriser, and
half of whole tiles: docs/decisions/kernels.md.

Tiles are dealt to the shares of the work in turn, every tile writes only its own pixels and its
own pairs, and pairs are added up Gaussian by Gaussian: the number of threads changes no bit of
any result.
"""

import os
import threading

# pyright: reportCallIssue=false
# The intrinsics of simd.py take a typing context that numba passes by itself.
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numba import njit
from numba.core.compiler_lock import global_compiler_lock
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.render.kernels import MOMENTS, backpropagate_tile, compose_tile, removal_tile
from gauss2svg.render.simd import load, splat, store, total
from gauss2svg.render.threads import in_shares, kernel
from gauss2svg.render.tiles import TILE_HEIGHT, TILE_WIDTH, find_pairs
from gauss2svg.scene import ADD, PLAIN, Scene, whitening_of
from gauss2svg.scene.falloff import covered_radius, cut_radius, longer_axes

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


# A whole fit holds this lock. Fits that run at the same time would share the threads of one
# machine, and none would be the faster for it.
kernel_lock = threading.RLock()


def _free_kernel_lock() -> None:
    """Free the lock, in a process that was forked, from threads that do not exist there."""
    if kernel_lock.acquire(blocking=False):  # nobody has it, or the thread that forked
        kernel_lock.release()
    else:
        kernel_lock._at_fork_reinit()  # pyright: ignore[reportAttributeAccessIssue] (as in logging)


if hasattr(os, "register_at_fork"):
    # Threads do not survive a fork, but what they hold stays held. A fit may take minutes, so its
    # lock is freed in the child; a compilation takes seconds and is awaited, as LLVM has state.
    os.register_at_fork(
        before=global_compiler_lock.acquire,
        after_in_parent=global_compiler_lock.release,
        after_in_child=global_compiler_lock.release,
    )
    os.register_at_fork(after_in_child=_free_kernel_lock)

# Pair rows that take about as long as waking up a thread, of all kernels and of add_pairs.
_LEAST_SHARE, _LEAST_ADDED = 4096, 65536

Real = TypeVar("Real", bound=np.floating)  # np.float32 or np.float64


class Splats(NamedTuple):
    """What the kernels read of n Gaussians, bottom first; all float64.

    mean (n, 2), sigma (n, 2), rho (n,), radius (n,) of the cut: for the tiles
    shape (n, 11): mean x, y, whitening w11, w21, w22, beta, radius^2, and for plain ellipses, which
    cover shares of pixels, o11, o21, o22: (o11 z1, o21 z1 + o22 z2) lies in the unit disc where
    they do; and the largest share. 0 for others
    opacity_color (n, 4): opacity, r, g, b
    background (3,)
    additive: whether they are blended additively; opacities and exponents are not read then
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
        """(n,) opacities in 0..1."""
        return self.opacity_color[:, 0]

    @property
    def beta(self) -> NDArray[np.float64]:
        """(n,) exponents of the falloff."""
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
    plain: NDArray[np.bool_] | None = None,
) -> Splats:
    """What the kernels read of n Gaussians with these parameters, as in a scene.

    whitening (n, 3) as of gauss2svg.scene.whitening_of; plain (n,) are ellipses that cover shares
    of pixels, None for none.
    """
    radius = cut = cut_radius(beta)
    outer = np.zeros((len(mean), 4))
    if plain is not None and plain.any():
        radius = np.where(plain, covered_radius(beta), radius)
        longer, most = longer_axes(whitening, radius)
        w11, w21, w22 = longer.T
        l11, l22 = 1 / w11, 1 / w22
        l21 = -w21 * l11 * l22
        sy = np.hypot(l21, l22)
        sigma = np.where(plain[:, None], np.column_stack([l11, sy]), sigma)
        rho, cut = np.where(plain, l21 / sy, rho), np.where(plain, 1.0, cut)
        # From z to the coordinates in which the outer ellipse is the unit disc.
        v11, v21, v22 = whitening.T
        factors = np.column_stack([w11 / v11, (w21 - v21 * w22 / v22) / v11, w22 / v22, most])
        outer = np.where(plain[:, None], factors, 0.0)
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
    """What the kernels read of a scene, scaled along x and y.

    The same as for scene.scaled(*scale), but the scaled shapes may leave the domain of scenes.
    covering: plain ellipses cover shares of pixels, as renderers draw them, and have no falloff.
    """
    # Copies: numba would compile the kernels once more for a scene's read-only arrays.
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
        plain=scene.drawn == PLAIN if covering else None,
    )


def _visit(
    mode: int,
    splats: Splats,
    image: NDArray[Real],
    pair_width: int,
    weight: NDArray[Real] | None = None,
) -> tuple[NDArray[Real], float, NDArray[np.float64], int]:
    """Image, sum of squared errors, (n, pair_width) sums over each Gaussian's pairs, pair rows."""
    if image.ndim != 3 or image.shape[0] != 3 or image.dtype not in (np.float32, np.float64):
        raise InputError(
            f"image must be float32 or float64 (3, height, width); got {image.dtype} {image.shape}"
        )
    # One numba type for all callers: read-only arrays would be compiled for once more.
    image = np.require(image, requirements=["C", "W"])
    if weight is None:
        read = mode in (SQUARED_ERROR, REMOVAL)
        weight = np.ones(image.shape[1:] if read else (1, 1), image.dtype)
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
    """(3, height, width) image of the Gaussians, one sample at each pixel centre.

    dtype is np.float32 or np.float64; InputError for another.
    """
    blank = np.zeros((3, height, width), dtype)  # never read: takes address space, no memory
    return _visit(RENDER, splats, blank, 1)[0]


def squared_error(
    splats: Splats, target: NDArray[Real], weight: NDArray[Real] | None = None
) -> tuple[NDArray[Real], float, NDArray[np.float64], int]:
    """Image, sum of squared errors, gradient as moments (n, MOMENTS), and pair rows.

    target is (3, h, w), weight (h, w) > 0 or None for 1; all is computed in target's dtype,
    float32 or float64. The sum is not weighted. The moments (gauss2svg.render.kernels) belong to
    L = 1/2 sum weight (rendered - target)^2; forward and backward share one visit of a tile.
    """
    return _visit(SQUARED_ERROR, splats, target, MOMENTS, weight)


def moments_of_gradient(splats: Splats, gradient: NDArray[Real]) -> NDArray[np.float64]:
    """Moments (n, MOMENTS) of any loss from its gradient (3, h, w) with respect to the image."""
    return _visit(GIVEN_GRADIENT, splats, gradient, MOMENTS)[2]


def removal_cost(
    splats: Splats, target: NDArray[Real], weight: NDArray[Real] | None = None
) -> tuple[NDArray[Real], NDArray[np.float64]]:
    """Image, and (n, 2): what removing each Gaussian would cost, and its mass, sum weight w^2.

    The cost is the change of sum weight (rendered - target)^2 as what lies behind shows through,
    weight (h, w) > 0 or None for 1; it is negative where the image would match better.
    """
    image, _, cost, _ = _visit(REMOVAL, splats, target, 2, weight)
    return image, cost
