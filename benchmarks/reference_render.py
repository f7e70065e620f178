"""A scene drawn by the formulas of gauss2svg.render.reference, with its areas and plain ellipses.

Tests and benchmarks compare the fast renderer and the files with it.
"""

from __future__ import annotations

import numpy as np
import torch

from gauss2svg.render import output_size
from gauss2svg.render.areas import draw_areas
from gauss2svg.render.reference import falloff_of
from gauss2svg.scene import ABOVE, ADD, PLAIN, Scene, whitening_of
from gauss2svg.scene.falloff import coverage, covered_radius


def render_reference(
    scene: Scene,
    width: int | None = None,
    height: int | None = None,
    dtype: torch.dtype = torch.float64,
    device: str | torch.device = "cpu",
) -> torch.Tensor:
    """Return the image (height, width, 3) in 0..1 of a scene, by default at the size of its canvas.

    The parameters are first rounded to the dtype. A rho that is rounded to -1 or 1 becomes the
    nearest number between them. Raise InputError for a scene or a size that
    gauss2svg.render.render refuses.
    """
    width, height = output_size(scene, width, height)
    # Scale the arrays and not the scene, because Scene.scaled raises an error if scaled shapes
    # leave the domain of scenes.
    scale, additive = (width / scene.width, height / scene.height), scene.blend == ADD
    image = torch.empty(0)
    ground, first = np.full((height, width, 3), scene.background), 0
    for level in [*np.unique(scene.level[scene.level != ABOVE]).tolist(), ABOVE]:
        last = len(scene.areas) if level == ABOVE else level
        draw_areas(scene.areas[first:last], ground, scale)
        shapes, first = scene.select(scene.level == level), last
        arrays = (
            shapes.mean * scale, shapes.sigma * scale, shapes.rho, shapes.color, shapes.opacity,
            ground, shapes.beta,
        )  # fmt: skip
        tensors = [torch.tensor(array, dtype=dtype, device=device) for array in arrays]
        tensors[2].clamp_(-below_one(dtype), below_one(dtype))
        mean, sigma, rho, color, opacity, image, beta = tensors
        for k in range(len(shapes)):
            draw = _coverage if shapes.drawn[k] == PLAIN else falloff_of
            share = draw((mean[k], sigma[k], rho[k], beta[k]), height, width)[:, :, None]
            if additive:
                image = image + share * color[k]
            else:
                image = image + opacity[k] * share * (color[k] - image)
        ground = image.cpu().to(torch.float64).numpy()
    return image.clamp(0, 1) if additive else image


def _coverage(shape: tuple[torch.Tensor, ...], height: int, width: int) -> torch.Tensor:
    """Return how much of each pixel (height, width) a plain ellipse covers. It has no gradient."""
    (x, y), sigma, rho, beta = (tensor.cpu().double().numpy() for tensor in shape)
    whitening, radius = whitening_of(sigma[None], rho[None])[0], covered_radius(beta[None])[0]
    w11, w21, w22 = whitening
    u, v = np.arange(width) + 0.5 - x, np.arange(height)[:, None] + 0.5 - y
    z = np.stack(np.broadcast_arrays(w11 * u, w21 * u + w22 * v), axis=-1)
    return torch.tensor(coverage(z, whitening, radius)).to(shape[0])


def below_one(dtype: torch.dtype) -> float:
    """Return the largest number of a floating dtype that is below 1."""
    return 1 - torch.finfo(dtype).eps / 2
