"""The fast CPU renderer: numba kernels that render tiles of 16 x 16 px, and compute gradients.

It computes in the dtype of its image, float32 or float64. The kernels for float64 are compiled when
they are first used.

Work is counted in pair rows. A pair row is the part of one Gaussian on one row of one tile, that
is, on 16 pixels. The kernels compute a pair row as explicit lanes (gauss2svg.render.simd). This
takes a fifth of the time that code from LLVM's vectoriser takes, and half the time of loops over
whole tiles (docs/decisions/kernels.md).

Each thread handles a share of the tiles. The work on a tile writes only the tile's own pixels and
pairs, and the pairs of a Gaussian are always added up in the same order. So all results are the
same to the last bit for any number of threads.
"""

import os
import threading

# pyright: reportCallIssue=false
# Calls of the intrinsics of simd.py lack their first argument, typingctx, because numba adds it.
# pyright would report these calls as errors.
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
from gauss2svg.scene.falloff import cut_radius, drawn_radius, longer_axes

# Modes of the kernels. RENDER computes the image. SQUARED_ERROR computes the image and the moments
# of the gradient of its squared error. GIVEN_GRADIENT computes only the moments of a gradient,
# which is passed in the argument `image`. REMOVAL computes the image and the cost of removing each
# Gaussian.
RENDER, SQUARED_ERROR, GIVEN_GRADIENT, REMOVAL = range(4)


def tile_buffers(most_rows: int, dtype: Any, additive: bool) -> tuple[Any, ...]:
    """Return the buffers that walk_tiles takes as its arguments `alpha` to `columns`.

    most_rows: largest number of pair rows in a tile.

    alpha, transmittance, steep, logs  (most_rows * TILE_WIDTH,), see gauss2svg.render.kernels
    color, gradient, behind  (3, TILE_HEIGHT, TILE_WIDTH), see gauss2svg.render.kernels
    below      (3, TILE_HEIGHT, TILE_WIDTH) what lies below all Gaussians
    remaining  (TILE_HEIGHT, TILE_WIDTH) transmittance behind all Gaussians. It is 1 for additive
               blending
    inside     (TILE_WIDTH,) 1 for columns of the image, and 0 for columns beyond its right edge
    columns    (TILE_WIDTH,) float64: 0, 1, .., 15
    """
    alpha, transmittance, *powers = np.empty((4, most_rows * TILE_WIDTH), dtype)
    tiles = np.empty((4, 3, TILE_HEIGHT, TILE_WIDTH), dtype)
    remaining, inside = np.ones((TILE_HEIGHT, TILE_WIDTH), dtype), np.empty(TILE_WIDTH, dtype)
    columns = np.arange(TILE_WIDTH, dtype=np.float64)
    return (alpha, None if additive else transmittance, *powers, *tiles, remaining, inside, columns)


@njit(inline="always")
def _errors_of_whole_rows(
    mode, x0, y0, h, color, remaining, below, image, weight, out, gradient
):  # fmt: skip
    """Do the work of _errors_of_tile for a tile whose columns are all inside the image.

    Each row of such a tile is handled at once, as sixteen lanes.
    """
    squares = 0.0
    height, width = out.shape[1:]
    for channel in range(3):
        for y in range(TILE_HEIGHT):
            j = (channel * TILE_HEIGHT + y) * TILE_WIDTH
            if y >= h:
                store(gradient, j, splat(0.0, gradient))
                continue
            at = (channel * height + y0 + y) * width + x0
            if mode == GIVEN_GRADIENT:
                store(gradient, j, load(image, at))
                continue
            value = load(color, j) + load(remaining, y * TILE_WIDTH) * load(below, j)
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
    mode, x0, y0, h, w, color, remaining, below, image, weight, out, gradient
):  # fmt: skip
    """Write the tile's part of `out` or `gradient` or both, depending on the mode.

    GIVEN_GRADIENT copies the tile's part of `image` to `gradient`. The other modes write the pixels
    of the tile to `out`. SQUARED_ERROR and REMOVAL also write the errors of the pixels to
    `gradient`, and SQUARED_ERROR multiplies them by `weight`. Return the sum of the tile's squared
    errors.
    """
    if w == TILE_WIDTH:
        return _errors_of_whole_rows(
            mode, x0, y0, h, color, remaining, below, image, weight, out, gradient
        )
    squares = 0.0
    for channel in range(3):
        for y in range(TILE_HEIGHT):
            for x in range(TILE_WIDTH):
                if y >= h or x >= w:
                    gradient[channel, y, x] = 0.0
                    continue
                value = color[channel, y, x] + remaining[y, x] * below[channel, y, x]
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
    """Write the weights of a tile's pixels to `out`, and 0 for pixels outside the image."""
    for y in range(TILE_HEIGHT):
        for x in range(TILE_WIDTH):
            out[y, x] = weight[y0 + y, x0 + x] if y < h and x < w else 0.0


@kernel
def walk_tiles(
    mode, first_tile, end_tile, shape, opacity_color, background, ground, image, weight,
    gaussian, rows, start, order, alpha, transmittance, steep, logs, color, gradient, behind, below,
    remaining, inside, columns, pair_out, out, loss,
):  # fmt: skip
    """Do the work of a mode for the tiles from first_tile on and before end_tile.

    The results are written to pair_out, out and loss.

    mode    one of the modes of this module
    weight  (h, w) weights of the pixels. SQUARED_ERROR multiplies the gradient by them. REMOVAL
            multiplies the terms of costs and masses by them. Other modes do not read them
    ground  (3, h, w) picture below the Gaussians. None if the colour `background` is below them
    gaussian, rows, start, order  fields of gauss2svg.render.tiles.Pairs
    alpha .. columns  buffers from tile_buffers
    pair_out  output for each pair: its moments, or its cost of removal and its mass
    out     (3, h, w) output: the image
    loss    (tiles,) output: the sum of squared errors in each tile

    background, image, weight, pair_out and out are all float32 or all float64.
    """
    height, width = out.shape[1:]
    tile_columns = (width + TILE_WIDTH - 1) // TILE_WIDTH
    for channel in range(3):
        for y in range(TILE_HEIGHT):
            for x in range(TILE_WIDTH):
                below[channel, y, x] = background[channel]
    for tile in range(first_tile, end_tile):
        x0 = (tile % tile_columns) * TILE_WIDTH
        y0 = (tile // tile_columns) * TILE_HEIGHT
        h = min(TILE_HEIGHT, height - y0)
        w = min(TILE_WIDTH, width - x0)
        for x in range(TILE_WIDTH):
            inside[x] = 1.0 if x < w else 0.0
        if ground is not None:
            for channel in range(3):
                for y in range(h):
                    for x in range(w):
                        below[channel, y, x] = ground[channel, y0 + y, x0 + x]
        first, end = start[tile], start[tile + 1]
        filled = compose_tile(
            order, first, end, x0, y0, columns, inside, shape, opacity_color, gaussian, rows,
            alpha, transmittance, steep, logs, color, remaining,
        )  # fmt: skip
        loss[tile] = _errors_of_tile(
            mode, x0, y0, h, w, color, remaining, below, image, weight, out, gradient
        )
        if mode in (SQUARED_ERROR, GIVEN_GRADIENT):
            for y in range(TILE_HEIGHT):
                for x in range(TILE_WIDTH):
                    behind[0, y, x] = (
                        gradient[0, y, x] * below[0, y, x]
                        + gradient[1, y, x] * below[1, y, x]
                        + gradient[2, y, x] * below[2, y, x]
                    )
            backpropagate_tile(
                order, first, end, x0, y0, columns, shape, opacity_color, gaussian, rows,
                alpha, transmittance, steep, logs, filled, gradient, behind, pair_out,
            )  # fmt: skip
        elif mode == REMOVAL:
            for channel in range(3):
                for y in range(TILE_HEIGHT):
                    for x in range(TILE_WIDTH):
                        behind[channel, y, x] = below[channel, y, x]
            # The buffer color[0] is free by now, so it takes the weights.
            _weights_of_tile(x0, y0, h, w, weight, color[0])
            removal_tile(
                order, first, end, y0, opacity_color, gaussian, rows,
                alpha, transmittance, filled, gradient, color[0], behind, pair_out,
            )  # fmt: skip


@kernel
def add_pairs(share, shares, offset, pair_values, totals):
    """Add up the values of each Gaussian's pairs, for one share of the Gaussians.

    offset       (n + 1,) Gaussian i has the pairs offset[i]:offset[i + 1]
    pair_values  (p, m) values of the pairs
    totals       (n, m) float64 output: the sums. It must be 0 on entry
    """
    n = offset.size - 1
    for i in range(n * share // shares, n * (share + 1) // shares):
        for p in range(offset[i], offset[i + 1]):
            for k in range(pair_values.shape[1]):
                totals[i, k] += pair_values[p, k]


# A fit holds this lock from its start to its end, so that fits run one after the other. If they ran
# at the same time, they would only compete for the cores of the machine.
kernel_lock = threading.RLock()


def _free_kernel_lock() -> None:
    """In a forked process, release the lock if another thread of the parent held it."""
    # `acquire` succeeds if the lock is free, or if the thread that forked holds it. Otherwise
    # the lock belongs to a thread that the child does not have, so the child resets the lock.
    if kernel_lock.acquire(blocking=False):
        kernel_lock.release()
    else:
        kernel_lock._at_fork_reinit()  # pyright: ignore[reportAttributeAccessIssue] (as in logging)


if hasattr(os, "register_at_fork"):
    # The child of a fork has only the thread that forked, but locks that other threads held stay
    # locked. The fork does not wait for kernel_lock, because a fit may take minutes. Instead the
    # child releases it. The fork does wait for numba's lock, because a compilation takes only
    # seconds and must not leave LLVM in an unfinished state.
    os.register_at_fork(
        before=global_compiler_lock.acquire,
        after_in_parent=global_compiler_lock.release,
        after_in_child=global_compiler_lock.release,
    )
    os.register_at_fork(after_in_child=_free_kernel_lock)

# Work is divided into fewer shares, and so done by fewer threads, if a share would otherwise have
# less than this number of pair rows. The first number is for the work of walk_tiles, and the second
# for that of add_pairs.
_LEAST_SHARE, _LEAST_ADDED = 16384, 65536

Real = TypeVar("Real", bound=np.floating)  # np.float32 or np.float64


class Splats(NamedTuple):
    """Arrays of n Gaussians as the kernels read them: float64, bottom first.

    mean, sigma, rho, radius  (n, 2), (n, 2), (n,) and (n,): the ellipses outside which the shapes
                   are 0. find_pairs lists the tiles that these ellipses reach
    shape          (n, 11) mean x, y, whitening w11, w21, w22, beta, radius^2, o11, o21, o22 and
                   max_share. The last four are only for plain ellipses that cover shares of
                   pixels, and are 0 for other shapes. Such an ellipse covers at most the share
                   max_share of any pixel. It covers nothing of a pixel if, at the pixel's centre,
                   (o11 z1, o21 z1 + o22 z2) is outside the unit disc
    opacity_color  (n, 4) opacity, r, g, b
    background     (3,)
    additive       whether blending is additive. If it is, opacities and exponents are not read
    ground         (3, h, w) picture below the Gaussians, of the size of the image. None if the
                   background is below them
    """

    mean: NDArray[np.float64]
    sigma: NDArray[np.float64]
    rho: NDArray[np.float64]
    radius: NDArray[np.float64]
    shape: NDArray[np.float64]
    opacity_color: NDArray[np.float64]
    background: NDArray[np.float64]
    additive: bool = False
    ground: NDArray[np.floating] | None = None

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

    whitening (n, 3) is what gauss2svg.scene.whitening_of returns. is_plain (n,) marks the plain
    ellipses, which cover shares of pixels. If it is None, there are no plain ellipses.
    """
    cut = radius = cut_radius(beta)
    outer = np.zeros((len(mean), 4))
    if is_plain is not None and is_plain.any():
        radius = drawn_radius(beta, is_plain)
        longer, max_share = longer_axes(whitening, radius)
        w11, w21, w22 = longer.T
        l11, l22 = 1 / w11, 1 / w22
        l21 = -w21 * l11 * l22
        sy = np.hypot(l21, l22)
        sigma = np.where(is_plain[:, None], np.column_stack([l11, sy]), sigma)
        rho, cut = np.where(is_plain, l21 / sy, rho), np.where(is_plain, 1.0, cut)
        # o11, o21, o22 map z to coordinates in which the enlarged ellipse is the unit disc.
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


def splats_of(scene: Scene, scale: tuple[float, float] = (1.0, 1.0)) -> Splats:
    """Return the splats of a scene that is scaled along x and y.

    scale  factors along x and y. The scaled shapes may leave the domain of scenes, which
           Scene.scaled does not allow
    """
    # The arrays of a scene are read-only. They are copied, because numba would compile the kernels
    # again for read-only arrays.
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
        is_plain=scene.drawn == PLAIN,
    )


def _visit(
    mode: int,
    splats: Splats,
    image: NDArray[Real],
    pair_width: int,
    weight: NDArray[Real] | None = None,
) -> tuple[NDArray[Real], float, NDArray[np.float64], int]:
    """Run the kernels in a mode.

    Return four things: the image, the sum of its squared errors, an array (n, pair_width), and the
    number of pair rows. The kernels write pair_width numbers for each pair. Row i of the array is
    the sum of these numbers over all pairs of Gaussian i.
    """
    if image.ndim != 3 or image.shape[0] != 3 or image.dtype not in (np.float32, np.float64):
        raise InputError(
            f"image must be float32 or float64 (3, height, width); got {image.dtype} {image.shape}"
        )
    # numba would compile the kernels again for arrays that are read-only or not contiguous. So such
    # arrays are copied.
    image = np.require(image, requirements=["C", "W"])
    if weight is None:
        is_read = mode in (SQUARED_ERROR, REMOVAL)
        weight = np.ones(image.shape[1:] if is_read else (1, 1), image.dtype)
    weight = np.require(weight, image.dtype, ["C", "W"])
    pairs = find_pairs(splats.mean, splats.sigma, splats.rho, splats.radius, *image.shape[1:])
    tiles, work = len(pairs.work) - 1, pairs.work
    out, loss = np.empty_like(image), np.zeros(tiles)
    pair_out = np.empty((len(pairs.gaussian), pair_width), image.dtype)
    row_count = int(work[-1] - TILE_HEIGHT * tiles)
    totals = np.zeros((len(splats.mean), pair_width))
    background, ground = splats.background.astype(image.dtype), splats.ground
    if ground is not None:
        ground = np.require(ground, image.dtype, ["C", "W"])

    def walk_share(share: int, shares: int) -> None:
        # A share is consecutive tiles, because neighbouring tiles write to the same lines of the
        # cache. Two cores that did so would wait for each other (docs/decisions/kernels.md).
        bounds = np.arange(share, share + 2) * work[-1] / shares
        first, end = np.searchsorted(work, bounds).tolist()
        walk_tiles(
            mode, first, end, splats.shape, splats.opacity_color, background, ground, image, weight,
            pairs.gaussian, pairs.rows, pairs.start, pairs.order,
            *tile_buffers(pairs.most_rows, image.dtype, splats.additive),
            pair_out, out, loss,
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
    # This array is never read or written, so the operating system gives it no memory.
    blank = np.zeros((3, height, width), dtype)
    return _visit(RENDER, splats, blank, 1)[0]


def squared_error(
    splats: Splats,
    target: NDArray[Real],
    weight: NDArray[Real] | None = None,
) -> tuple[NDArray[Real], float, NDArray[np.float64], int]:
    """Return the rendered image, its squared error, moments (n, MOMENTS) and number of pair rows.

    target  (3, h, w) float32 or float64, which is the dtype of the whole computation
    weight  (h, w) > 0, or None for 1 everywhere

    The squared error is the unweighted sum over all values. The moments, which
    gauss2svg.render.kernels defines, are those of the gradient of
    L = 1/2 sum weight (rendered - target)^2. The forward and the backward pass of a tile follow
    each other, so that each tile is visited only once.
    """
    return _visit(SQUARED_ERROR, splats, target, MOMENTS, weight)


def moments_of_gradient(splats: Splats, gradient: NDArray[Real]) -> NDArray[np.float64]:
    """Return the moments (n, MOMENTS) that belong to the gradient dL/dpixel (3, h, w)."""
    return _visit(GIVEN_GRADIENT, splats, gradient, MOMENTS)[2]


def removal_cost(
    splats: Splats, target: NDArray[Real], weight: NDArray[Real] | None = None
) -> tuple[NDArray[Real], NDArray[np.float64]]:
    """Return the image, and an array (n, 2) with the removal cost and the mass of each Gaussian.

    The removal cost is the change of sum weight (rendered - target)^2 if only this Gaussian is
    removed, so that the shapes behind it become visible. The cost is negative if the image matches
    the target better without the Gaussian. The mass is sum weight w^2 with w as in
    gauss2svg.render.kernels.

    weight  (h, w) > 0, or None for 1 everywhere
    """
    image, _, cost, _ = _visit(REMOVAL, splats, target, 2, weight)
    return image, cost
