"""The reference renderer: the model's formula in plain torch, for any dtype, device and size.

    C(x) = sum_k w_k c_k + T_end background,  w_k = alpha_k prod_{j in front} (1 - alpha_j),
    alpha_k(x) = opacity_k f(|W_k (x - mean_k)|; beta_k)

or, with additive blending,

    C(x) = background + sum_k f(|W_k (x - mean_k)|) c_k

with f of gauss2svg.scene.falloff, sampled at pixel centres. The result is differentiable by
autograd, and there are no tiles and no approximations. Memory and time are proportional to the
number of Gaussians times the number of pixels, so use this renderer only for small images.
"""

from __future__ import annotations

from typing import Any

from gauss2svg.errors import refusal
from gauss2svg.render import TorchMissingError, side_of
from gauss2svg.scene import MOST_SIGNED
from gauss2svg.scene.falloff import CUT, RIM
from gauss2svg.scene.scene import PARAMETERS

try:  # autograd.py imports torch from this module, so that only this place reports a missing torch
    import torch
except ImportError as error:
    raise TorchMissingError(
        'the differentiable renderer needs PyTorch. Try pip install "gauss2svg[torch]"'
    ) from error

_BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}
# Names of the tensors of a renderer, in their order.
_NAMES = ("mean", "sigma", "rho", "color", "opacity", "background", "beta")


def composite(
    mean: torch.Tensor,
    sigma: torch.Tensor,
    rho: torch.Tensor,
    color: torch.Tensor,
    opacity: torch.Tensor | None,
    background: torch.Tensor,
    height: int,
    width: int,
    beta: torch.Tensor | None = None,
) -> torch.Tensor:
    """Return the image (height, width, 3) of n alpha-composited shapes, the bottom shape first.

    mean (n, 2) and sigma (n, 2) are in px. rho is (n,), color (n, 3) and opacity (n,). If opacity
    is None, the shapes are added up, in any order: the image is the unclipped sum of the background
    and the shapes, whose colours are signed. background is (3,), or a picture (height, width, 3)
    that lies below the shapes. beta is (n,), or None for Gaussians. All tensors must have the same
    dtype and device, which are also those of the image. Raise InputError for values outside the
    domain (see shapes_of).
    """
    shapes = shapes_of(height, width, mean, sigma, rho, color, opacity, background, beta)
    mean, sigma, rho, color, alpha, background, beta = shapes
    image = background.expand(height, width, 3)  # the background is one colour, or an image
    for k in range(len(mean)):
        falloff = falloff_of((mean[k], sigma[k], rho[k], beta[k]), height, width)[:, :, None]
        if opacity is None:
            image = image + falloff * color[k]
        else:
            image = image + alpha[k] * falloff * (color[k] - image)
    return image


def falloff_of(shape: tuple[torch.Tensor, ...], height: int, width: int) -> torch.Tensor:
    """Return the falloff (height, width) of a shape, by the formula of gauss2svg.scene.falloff.

    shape: mean, sigma, rho and beta.

    It is computed in float64 if the device has float64. float32 is too coarse for the offset from a
    distant mean. It is also too coarse for z2 of a thin sheared shape, which is the sum of two
    terms that nearly cancel.
    """
    dtype = shape[0].dtype
    widest = torch.float32 if shape[0].device.type == "mps" else torch.float64
    mean, sigma, rho, beta = (tensor.to(widest) for tensor in shape)
    y = torch.arange(height, dtype=mean.dtype, device=mean.device) + 0.5
    x = torch.arange(width, dtype=mean.dtype, device=mean.device) + 0.5
    z1 = (x - mean[0]) / sigma[0]
    v = (y - mean[1]) / sigma[1]
    z2 = (v[:, None] - rho * z1) / torch.sqrt((1 - rho) * (1 + rho))
    half = 0.5 * (z1 * z1 + z2 * z2)
    inside = half < CUT ** (1 / beta)
    # Pixels outside the support are masked before the power is computed, so that the backward pass
    # never multiplies infinity by zero. A pixel at the mean is masked too, because there the
    # gradient of the power would need the logarithm of 0. Its falloff is 1 anyway.
    off_mean = inside & (half > 0)
    power = torch.where(off_mean, half, torch.ones_like(half)) ** beta
    bell = torch.exp(-torch.where(off_mean, power, torch.zeros_like(power)))
    return torch.where(inside, (bell - RIM) / (1 - RIM), torch.zeros_like(bell)).to(dtype)


def shapes_of(height: int, width: int, *tensors: Any) -> tuple[torch.Tensor, ...]:
    """Check the tensors of `composite`, in the order of _NAMES, and return them.

    height, width  sides of the image, which a picture as the background must have

    If opacity or beta is None, it becomes 1 for all shapes. Raise InputError if a tensor has a
    wrong shape, and if an element is not finite or is outside the domain of its parameter. The
    domains are those of gauss2svg.scene.scene.Scene, except that colours may be signed with both
    blends.
    """
    side_of("height", height)
    side_of("width", width)
    mean, _, rho, *_ = tensors
    shapes = []
    for name, tensor in zip(_NAMES, tensors, strict=True):
        tensor = torch.ones_like(rho) if tensor is None else tensor
        allowed, least, most = [(3,), (height, width, 3)], -MOST_SIGNED, MOST_SIGNED
        if parameter := _BY_NAME.get(name):
            allowed = [parameter.shape(len(mean))]
            if name != "color":
                least, most = parameter.least, parameter.most
        if tuple(tensor.shape) not in allowed:
            needed = f"of shape {' or '.join(map(str, allowed))}"
            raise refusal(name, needed, str(tuple(tensor.shape)))
        # The bounds are rounded to the dtype of the tensor, which makes the largest rho 1.
        bad = ~(tensor.isfinite() & (tensor >= least) & (tensor <= most))
        bad |= (tensor.abs() >= 1) & (name == "rho")
        if bad.any():
            needed = f"finite and in {least!r}..{most!r}"
            raise refusal(name, needed, str(tensor[bad][0].item()), "clamping it")
        shapes.append(tensor)
    return tuple(shapes)
