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
from numba import get_num_threads
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.render.kernels import MOMENTS
from gauss2svg.render.tiles import Pairs, find_pairs
from gauss2svg.render.walk import (
    GIVEN_GRADIENT,
    REMOVAL,
    RENDER,
    SQUARED_ERROR,
    sum_pairs,
    sum_tiles,
    walk_tiles,
)
from gauss2svg.scene import ADD, Scene, whitening_of
from gauss2svg.scene.falloff import cut_radius

# numba's fallback threading layer aborts the process if two Python threads are in a
# parallel kernel at once; whoever calls one holds this lock.
kernel_lock = threading.RLock()

Real = TypeVar("Real", bound=np.floating)  # np.float32 or np.float64


class Splats(NamedTuple):
    """What the kernels read of n Gaussians, bottom first; all float64.

    mean (n, 2), sigma (n, 2), rho (n,), radius (n,) of the cut: for the tiles
    shape (n, 7): mean x, y, whitening w11, w21, w22, beta and radius^2
    paint (n, 4): opacity, r, g, b
    background (3,)
    additive: whether they are summed; opacities are not read then, nor exponents
    """

    mean: NDArray[np.float64]
    sigma: NDArray[np.float64]
    rho: NDArray[np.float64]
    radius: NDArray[np.float64]
    shape: NDArray[np.float64]
    paint: NDArray[np.float64]
    background: NDArray[np.float64]
    additive: bool = False


def splats_of(scene: Scene, scale: tuple[float, float] = (1.0, 1.0)) -> Splats:
    """The kernels' view of a scene, scaled along x and y.

    As of scene.scaled(*scale), save that a scale may lead out of the domain of scenes.
    """
    # New arrays: numba compiles everything once more for read-only ones.
    mean, sigma = scene.mean * scale, scene.sigma * scale
    radius = cut_radius(scene.betas)
    return Splats(
        mean,
        sigma,
        scene.rho.copy(),
        radius,
        np.column_stack([mean, whitening_of(sigma, scene.rho), scene.betas, radius**2]),
        np.concatenate([scene.opacity[:, None], scene.color], axis=1),
        scene.background.copy(),
        scene.blend == ADD,
    )


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
        weight = np.ones((1, 1) if mode != SQUARED_ERROR else (height, width), image.dtype)
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
    walk = sum_tiles if splats.additive else walk_tiles
    walk(
        mode, get_num_threads(), splats.shape, splats.paint, splats.background,
        image, weight, pairs, pair_out, out, loss,
    )  # fmt: skip
    row_count = int((pairs.rows[:, 1] - pairs.rows[:, 0]).sum())
    return out, float(loss.sum()), sum_pairs(pairs.offset, pair_out), row_count


def render_planar(
    splats: Splats, height: int, width: int, dtype: type[Real] = np.float32
) -> NDArray[Real]:
    """(3, height, width) image of the Gaussians, one sample at each pixel centre.

    dtype is np.float32 or np.float64; InputError for another.
    """
    blank = np.zeros((3, height, width), dtype)  # not read, and so no memory that is really there
    return _visit(RENDER, splats, blank, 1)[0]


def squared_error(
    splats: Splats, target: NDArray[Real], weight: NDArray[Real] | None = None
) -> tuple[NDArray[Real], float, NDArray[np.float64], int]:
    """Image, sum of squared errors, gradient as moments (n, MOMENTS), and pair rows.

    target is (3, h, w), weight (h, w) > 0 or None for 1; target's dtype, float32 or float64,
    is what is computed in. The sum is not weighted. The moments (gauss2svg.render.kernels)
    belong to L = 1/2 sum weight (rendered - target)^2; forward and backward share one visit
    of a tile.
    """
    return _visit(SQUARED_ERROR, splats, target, MOMENTS, weight)


def moments_of_gradient(splats: Splats, gradient: NDArray[Real]) -> NDArray[np.float64]:
    """Moments (n, MOMENTS) of any loss from its gradient (3, h, w) with respect to the image."""
    return _visit(GIVEN_GRADIENT, splats, gradient, MOMENTS)[2]


def removal_cost(
    splats: Splats, target: NDArray[Real]
) -> tuple[NDArray[Real], NDArray[np.float64]]:
    """Image, and (n, 2): what taking each Gaussian away costs, and the sum of its w^2.

    The cost is the change of the summed squared error against target (3, h, w), with
    what lies behind showing through; negative where the picture would gain.
    """
    image, _, cost, _ = _visit(REMOVAL, splats, target, 2)
    return image, cost
