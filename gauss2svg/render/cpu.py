"""The fast CPU renderer: kernels that render tiles of 16 x 16 px, and compute gradients.

It computes in the dtype of its image, float32 or float64. gauss2svg/core/gaussians.h has the
formulas.

The canvas is cut into tiles, which are TILE_WIDTH pixels wide and TILE_HEIGHT rows high. A "pair"
is one Gaussian in one tile. Kernels visit only those rows of the tile that the Gaussian's ellipse
reaches. So work is counted in pair rows, which have TILE_WIDTH pixels each. The kernels compute a
pair row as one vector of 16 lanes (gauss2svg/core/lanes.h).

Kernels go from one row of a pair to the next by adding w22 = 1 / (sy sqrt(1 - rho^2)) to the
whitened offsets (`across` of gauss2svg/core/gaussians.h).
Over 8 rows, rounding changes the offsets by up to 1e-6 w22, which is too much for very thin shapes.
So shapes thinner than 1/64 px are split into pairs of one row each, which need no such addition.
The shapes of a fit are far wider.

Kernels compute in one thread. ctypes releases Python's global lock, so ordinary Python threads can
run them at the same time. Each thread handles a share of the tiles. The work on a tile writes only
the tile's own pixels and pairs, and the pairs of a Gaussian are always added up in the same order.
So all results are the same to the last bit for any number of threads.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg import portable
from gauss2svg.core import Kernel
from gauss2svg.errors import refusal
from gauss2svg.scene import ADD, PLAIN, Scene, falloff, whitening_of

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# The OpenMP library of torch reads this variable when it is loaded. With PASSIVE, its idle threads
# sleep. By default they would wait busily, on cores that a kernel could use. If the user has set
# the variable, its value is kept.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

# Width of a tile in px. 16 numbers of float32 fill one register of 512 bits, or two of 256 bits.
TILE_WIDTH = 16
TILE_HEIGHT = 16
# Number of cores that this process may use.
CORES = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
threads = CORES  # threads that in_shares uses. Only Run changes it, under the lock of the kernels

# Modes of the kernels. RENDER computes the image. SQUARED_ERROR computes the image and the moments
# of the gradient of its squared error. GIVEN_GRADIENT computes only the moments of a gradient,
# which is passed in the argument `image`. REMOVAL computes the image and the cost of removing each
# Gaussian.
RENDER, SQUARED_ERROR, GIVEN_GRADIENT, REMOVAL = range(4)
MOMENTS = 10  # numbers of each pair from which the gradients follow

_list_pairs = Kernel("list_pairs", "int int int float64 int64 int64 int64 int32 int32 int32")
_walk_tiles = Kernel(
    "walk_tiles",
    "int int int int int int float64 float64 real real real real int32 int32 int64 int32 real int"
    " real real float64",
)
_add_pairs = Kernel("add_pairs", "int int int int64 real float64")

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
    # The child of a fork has only the thread that forked, but a lock that another thread held stays
    # locked. A fork does not wait for kernel_lock, because a fit may take minutes.
    os.register_at_fork(after_in_child=_free_kernel_lock)

Real = TypeVar("Real", bound=np.floating)  # np.float32 or np.float64


class Splats(NamedTuple):
    """Arrays of n Gaussians as the kernels read them: float64, bottom first.

    ellipse        (n, 6) mean x, y, sigma x, y, rho and radius of the ellipses outside which the
                   shapes are 0. find_pairs lists the tiles that these ellipses reach
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

    ellipse: NDArray[np.float64]
    shape: NDArray[np.float64]
    opacity_color: NDArray[np.float64]
    background: NDArray[np.float64]
    additive: bool = False
    ground: NDArray[np.floating] | None = None


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
    cut = radius = falloff.cut_radius(beta)
    outer = np.zeros((len(mean), 4))
    if is_plain is not None and is_plain.any():
        radius = falloff.drawn_radius(beta, is_plain)
        longer, max_share = falloff.longer_axes(whitening, radius)
        w11, w21, w22 = longer.T
        l11, l22 = 1 / w11, 1 / w22
        l21 = -w21 * l11 * l22
        sy = portable.hypot(l21, l22)
        sigma = np.where(is_plain[:, None], np.column_stack([l11, sy]), sigma)
        rho, cut = np.where(is_plain, l21 / sy, rho), np.where(is_plain, 1.0, cut)
        # o11, o21, o22 map z to coordinates in which the enlarged ellipse is the unit disc.
        v11, v21, v22 = whitening.T
        factors = np.column_stack([w11 / v11, (w21 - v21 * w22 / v22) / v11, w22 / v22, max_share])
        outer = np.where(is_plain[:, None], factors, 0.0)
    return Splats(
        np.column_stack([mean, sigma, rho, cut]),
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
    sigma = scene.sigma * scale
    return splats_from(
        scene.mean * scale,
        sigma,
        scene.rho,
        whitening_of(sigma, scene.rho),
        color=scene.color,
        opacity=scene.opacity,
        beta=scene.beta,
        background=scene.background,
        additive=scene.blend == ADD,
        is_plain=scene.drawn == PLAIN,
    )


def in_shares(work: Callable[[int, int], object], max_shares: int) -> None:
    """Divide `work` into shares, do them at the same time in several threads, and wait for all.

    work(share, shares) is called for share = 0, ..., shares - 1. The number of shares is `threads`,
    but at most max_shares. The calling thread does the first share, so if there is only one share,
    no other thread is needed.
    """
    shares = max(1, min(threads, max_shares))
    if shares == 1:
        work(0, 1)
        return
    # The threads end with the call. Starting them takes a tenth of a millisecond.
    with ThreadPoolExecutor(shares - 1, "gauss2svg-kernel") as pool:
        others = [pool.submit(work, share, shares) for share in range(1, shares)]
        work(0, shares)
    for other in others:
        other.result()


def find_pairs(
    ellipse: NDArray[np.float64], height: int, width: int
) -> tuple[NDArray[np.int64 | np.int32], ...]:
    """Return the p pairs of n Gaussians and the tiles of a canvas of height x width px.

    ellipse: (n, 6) mean x, y and sigma x, y in px, rho, and the Mahalanobis distance at which each
    Gaussian is cut off.

    A pair is the part of one Gaussian on consecutive rows of one tile. The pairs are stored
    Gaussian by Gaussian. Six arrays are returned:

    offset    (n + 1,) int64: Gaussian i has the pairs offset[i]:offset[i + 1]
    gaussian  (p,) int32: index of the Gaussian of each pair
    rows      (p, 2) int32: first image row of each pair, and the row after its last row
    start     (tiles + 1,) int64: the pairs of tile t are order[start[t]:start[t + 1]]
    order     (p,) int32: indices of pairs, tile by tile. Within a tile they are listed from front
              to back: the topmost Gaussian is first
    count     (tiles,) int64: number of pair rows in each tile
    """
    count, tiles = len(ellipse), -(-width // TILE_WIDTH) * -(-height // TILE_HEIGHT)
    offset = np.zeros(count + 1, np.int64)
    tile_rows, tile_pairs = np.zeros(tiles, np.int64), np.zeros(tiles, np.int64)
    own = count, height, width, ellipse, offset, tile_rows
    _list_pairs(*own, tile_pairs, None, None, None)
    start = np.concatenate([[0], np.cumsum(tile_pairs)])
    gaussian, order = np.empty((2, offset[-1]), np.int32)
    rows = np.empty((offset[-1], 2), np.int32)
    _list_pairs(*own, start[1:].copy(), gaussian, rows, order)
    return offset, gaussian, rows, start, order, tile_rows


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
        needed = "float32 or float64 (3, height, width)"
        raise refusal("image", needed, f"{image.dtype} {image.shape}")
    image = np.ascontiguousarray(image)
    if weight is None:
        is_read = mode in (SQUARED_ERROR, REMOVAL)
        weight = np.ones(image.shape[1:] if is_read else (1, 1), image.dtype)
    weight = np.ascontiguousarray(weight, image.dtype)
    pairs = find_pairs(splats.ellipse, *image.shape[1:])
    offset, gaussian, rows, start, order, count = pairs
    # The work on the tiles before each. A tile counts as TILE_HEIGHT more rows than it has, for the
    # pixels of the image.
    work = np.concatenate([[0], np.cumsum(count + TILE_HEIGHT)])
    out, loss = np.empty_like(image), np.zeros(len(count))
    pair_out = np.empty((len(gaussian), pair_width), image.dtype)
    totals, row_count = np.empty((len(splats.ellipse), pair_width)), int(count.sum())
    background, ground = splats.background.astype(image.dtype), splats.ground
    if ground is not None:
        ground = np.ascontiguousarray(ground, image.dtype)
    capacity = int(count.max(initial=0)) * TILE_WIDTH

    def walk_share(share: int, shares: int) -> None:
        # A share is consecutive tiles, because neighbouring tiles write to the same lines of the
        # cache. Two cores that did so would wait for each other (docs/decisions/kernels.md).
        bounds = np.arange(share, share + 2) * work[-1] / shares
        first, end = np.searchsorted(work, bounds).tolist()
        buffers = np.empty(4 * capacity + 16, image.dtype)
        _walk_tiles(
            splats.additive, mode, first, end, *image.shape[1:], splats.shape,
            splats.opacity_color, background, ground, image, weight, gaussian, rows, start, order,
            buffers, capacity, pair_out, out, loss,
        )  # fmt: skip

    def add_share(share: int, shares: int) -> None:
        first, end = (len(totals) * k // shares for k in (share, share + 1))
        _add_pairs(first, end, pair_width, offset, pair_out, totals)

    # A thread pays for 16384 pair rows that are walked, or 65536 that are added.
    in_shares(walk_share, row_count // 16384)
    if mode != RENDER:
        in_shares(add_share, row_count // 65536)
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
    splats: Splats, target: NDArray[Real], weight: NDArray[Real] | None = None
) -> tuple[NDArray[Real], float, NDArray[np.float64], int]:
    """Return the rendered image, its squared error, moments (n, MOMENTS) and number of pair rows.

    target  (3, h, w) float32 or float64, which is the dtype of the whole computation
    weight  (h, w) > 0, or None for 1 everywhere

    The squared error is the unweighted sum over all values. The moments, which
    gauss2svg/core/gaussians.h defines, are those of the gradient of
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
    gauss2svg/core/gaussians.h.

    weight  (h, w) > 0, or None for 1 everywhere
    """
    image, _, cost, _ = _visit(REMOVAL, splats, target, 2, weight)
    return image, cost


def color_weights(scene: Scene, height: int, width: int) -> tuple[csr_array, NDArray[np.float64]]:
    """Return the weights W (n + 1, h w) of the colours in the pixels, and W W^T (n + 1, n + 1).

    A picture depends linearly on the colours. With alpha compositing a pixel is sum_k w_k c_k,
    where w_k is alpha_k times the transmittance of all shapes above shape k, and k = 0 is the
    background.

    The first row is that of the background. W is sparse, because only few shapes are visible in
    each pixel, and weights of at most 1e-9 are left out. A plain ellipse (scene.drawn) has no
    falloff: its alpha is its opacity times the share of the pixel that it covers.
    """
    # This import takes a third of a second, and few runs need it.
    from scipy.sparse import csr_array

    covers, radius = scene.drawn == PLAIN, falloff.covered_radius(scene.beta)
    reach = scene.sigma * falloff.cut_radius(scene.beta)[:, None] + covers[:, None]
    low = np.clip(np.floor(scene.mean - reach - 0.5), 0, [width, height]).astype(np.intp)
    high = np.clip(np.ceil(scene.mean + reach + 0.5), 0, [width, height]).astype(np.intp)
    transmittance, whitening = np.ones((height, width)), whitening_of(scene.sigma, scene.rho)
    pixel = np.arange(height * width).reshape(height, width)
    values, pixels = [np.zeros(0)] * (len(scene) + 1), [pixel[0, :0]] * (len(scene) + 1)
    for k in range(len(scene) - 1, -1, -1):
        (x0, y0), (x1, y1) = low[k], high[k]
        u = np.arange(x0, x1) + 0.5 - scene.mean[k, 0]
        v = np.arange(y0, y1)[:, None] + 0.5 - scene.mean[k, 1]
        w11, w21, w22 = whitening[k]
        z = np.stack(np.broadcast_arrays(w11 * u, w21 * u + w22 * v), axis=-1)
        if covers[k]:
            share = falloff.coverage(z, whitening[k], radius[k])
        else:
            share = falloff.profile(np.sqrt(np.square(z).sum(axis=-1)), scene.beta[k])
        alpha = scene.opacity[k] * share
        box = transmittance[y0:y1, x0:x1]
        weight = alpha * box
        shows = weight > 1e-9
        values[k + 1], pixels[k + 1] = weight[shows], pixel[y0:y1, x0:x1][shows]
        box *= 1 - alpha
    shows = transmittance > 1e-9
    values[0], pixels[0] = transmittance[shows], pixel[shows]
    starts = np.cumsum([0, *map(len, values)])
    weights = csr_array(
        (np.concatenate(values), np.concatenate(pixels), starts), (len(values), height * width)
    )
    return weights, (weights @ weights.T).toarray()


def visible_mass(
    scene: Scene, weight: NDArray[np.floating] | None = None
) -> tuple[NDArray[np.float64], int]:
    """Return the visible mass (n,) of each shape, and the number of pixels over which it is summed.

    The visible mass is the sum of weight (alpha transmittance)^2 over all pixels. It is computed on
    a smaller canvas if the canvas is large. If the colour of a shape is optimal, changing it by d
    raises the weighted squared error by visible_mass d^2.

    weight  (h, w) > 0 of any size and with a mean of 1, or None for 1 everywhere
    """
    reduced = min(1.0, 768 / max(scene.width, scene.height))
    width, height = (max(1, round(side * reduced)) for side in (scene.width, scene.height))
    splats = splats_of(scene, (width / scene.width, height / scene.height))
    if weight is not None:
        image = Image.fromarray(np.asarray(weight, np.float32))
        weight = np.asarray(image.resize((width, height), Image.Resampling.NEAREST))
    blank = np.zeros((3, height, width), np.float32)
    return np.maximum(removal_cost(splats, blank, weight)[1][:, 1], 0.0), width * height
