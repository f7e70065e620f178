"""The oracle: the model's formula in plain torch, for any dtype, device and output size.

    C(x) = sum_k w_k c_k + T_end background,  w_k = alpha_k prod_{j in front} (1 - alpha_j),
    alpha_k(x) = opacity_k f(|W_k (x - mean_k)|)

sampled at pixel centres. Differentiable by autograd, no tiles, no tricks: memory and
time grow with Gaussians times pixels, so keep it to small pictures.
"""

from __future__ import annotations

import torch

from gauss2svg.errors import InputError
from gauss2svg.falloff import RADIUS, RIM
from gauss2svg.scene import Scene


def composite(
    mean: torch.Tensor,
    sigma: torch.Tensor,
    rho: torch.Tensor,
    color: torch.Tensor,
    opacity: torch.Tensor,
    background: torch.Tensor,
    height: int,
    width: int,
) -> torch.Tensor:
    """Image (height, width, 3) of n Gaussians, bottom first, on a canvas of the same size.

    mean (n, 2) and sigma (n, 2) in px, rho (n,), color (n, 3), opacity (n,),
    background (3,); all of one dtype and device, which the image shares.
    """
    y = torch.arange(height, dtype=mean.dtype, device=mean.device) + 0.5
    x = torch.arange(width, dtype=mean.dtype, device=mean.device) + 0.5
    image = background.expand(height, width, 3)
    for k in range(len(mean)):
        z1 = (x - mean[k, 0]) / sigma[k, 0]
        v = (y - mean[k, 1]) / sigma[k, 1]
        z2 = (v[:, None] - rho[k] * z1) / torch.sqrt((1 - rho[k]) * (1 + rho[k]))
        squared = z1 * z1 + z2 * z2
        inside = squared < RADIUS * RADIUS
        # Masked before exp, so that no infinity can meet a zero in the backward pass.
        bell = torch.exp(-0.5 * torch.where(inside, squared, torch.zeros_like(squared)))
        alpha = torch.where(inside, opacity[k] * (bell - RIM) / (1 - RIM), torch.zeros_like(bell))
        image = image + alpha[:, :, None] * (color[k] - image)
    return image


def render_reference(
    scene: Scene,
    width: int | None = None,
    height: int | None = None,
    dtype: torch.dtype = torch.float64,
    device: str | torch.device = "cpu",
) -> torch.Tensor:
    """Image (height, width, 3) of a scene at any output size, by default that of its canvas.

    Values lie in 0..1. Raises InputError for a size under one pixel.
    """
    width = round(scene.width) if width is None else width
    height = round(scene.height) if height is None else height
    if width < 1 or height < 1:
        raise InputError(f"output size is {width}x{height}; needed is at least 1x1 px")
    shown = scene.scaled(width / scene.width, height / scene.height)
    arrays = (shown.mean, shown.sigma, shown.rho, shown.color, shown.opacity, shown.background)
    mean, sigma, rho, color, opacity, background = (
        torch.tensor(array, dtype=dtype, device=device) for array in arrays
    )
    with torch.no_grad():
        return composite(mean, sigma, rho, color, opacity, background, height, width)
