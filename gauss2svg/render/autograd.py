"""The fast CPU renderer as a differentiable torch function, so that any torch loss works.

The Gaussians have gradients. The areas and lines of a scene have none: their raster is the picture
that the Gaussians are drawn over.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import quoted, refusal
from gauss2svg.render.cpu import Splats, moments_of_gradient, render_planar, splats_from
from gauss2svg.render.reference import shapes_of, torch
from gauss2svg.scene import whitening_of


def torch_loss(
    function: Callable[[torch.Tensor, torch.Tensor], torch.Tensor],
) -> Callable[[NDArray[np.float32], NDArray[np.float32]], tuple[float, torch.Tensor]]:
    """Return a loss for FitOptions.loss, which returns its gradient too.

    function  differentiable function of the render and the target, both tensors (h, w, 3) in 0..1,
              that returns a scalar >= 0. The loss raises InputError if it does not. It runs with
              one thread of torch: that is faster for small pictures, and the sums in it then do not
              depend on the number of cores
    """

    def loss(
        render: NDArray[np.float32], target: NDArray[np.float32]
    ) -> tuple[float, torch.Tensor]:
        image = torch.from_numpy(render).requires_grad_()
        threads = torch.get_num_threads()
        torch.set_num_threads(1)
        try:
            value = function(image, torch.from_numpy(target))
            if not isinstance(value, torch.Tensor) or value.numel() != 1 or not value.requires_grad:
                needed, advice = "a scalar that depends on the render", ".mean(), without .detach()"
                raise refusal("loss", needed, quoted(value), advice)
            return value.item(), torch.autograd.grad(value, image)[0]
        finally:
            torch.set_num_threads(threads)

    loss.__name__ = getattr(function, "__name__", "loss")
    return loss


class _FastRender(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> torch.Tensor:
        *tensors, height, width, ctx.additive = arguments
        ctx.save_for_backward(*tensors)
        is_double = all(tensor.dtype == torch.float64 for tensor in tensors)
        ctx.real = np.float64 if is_double else np.float32
        image = render_planar(_splats(ctx.additive, *tensors), height, width, ctx.real)
        return torch.from_numpy(np.ascontiguousarray(np.moveaxis(image, 0, -1)))

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride] (the decorator's type)
        ctx: Any, *grad_outputs: torch.Tensor
    ) -> tuple[Any, ...]:
        mean, sigma, rho, color, opacity, background, beta = ctx.saved_tensors
        # The kernels return the product of the opacity and its gradient. At opacity 0 it says
        # nothing about the gradient, so smaller opacities are raised. Ten thousand shapes of the
        # raised opacity change no pixel of an image of this dtype, and no other gradient.
        opacity = opacity.double().clamp(min=1e-12 if ctx.real is np.float32 else 1e-20)
        # If beta is exactly 1, the kernels do not compute the gradient of the exponent. So use the
        # next number above 1.
        if ctx.needs_input_grad[6]:
            beta = torch.where(beta == 1, np.nextafter(1, 2), beta.double())
        splats = _splats(ctx.additive, mean, sigma, rho, color, opacity, background, beta)
        by_pixel = grad_outputs[0].detach()
        planar = np.ascontiguousarray(np.moveaxis(by_pixel.numpy(), -1, 0), ctx.real)
        moments = torch.from_numpy(moments_of_gradient(splats, planar))
        behind = by_pixel.double()
        if not ctx.additive:
            # The light that all shapes together let through is the render of black ones on white.
            black = splats.opacity_color * [1.0, 0.0, 0.0, 0.0]
            black = splats._replace(opacity_color=black, background=np.ones(3), ground=None)
            _, height, width = planar.shape
            through = render_planar(black, height, width, ctx.real)
            behind = behind * torch.from_numpy(through).movedim(0, -1)
        gradients = (
            *_by_shape(moments[:, :5], sigma.double(), rho.double()), moments[:, 6:9],
            moments[:, 5] / opacity, behind.sum_to_size(background.shape), -moments[:, 9],
        )  # fmt: skip
        typed = (g.to(t.dtype) for g, t in zip(gradients, ctx.saved_tensors, strict=True))
        return (*typed, None, None, None)


def _splats(additive: bool, *tensors: torch.Tensor) -> Splats:
    mean, sigma, rho, color, opacity, background, beta = (
        tensor.detach().to(torch.float64).numpy() for tensor in tensors
    )
    is_picture = background.ndim == 3
    splats = splats_from(
        mean, sigma, rho, whitening_of(sigma, rho), color=color, opacity=opacity, beta=beta,
        background=np.zeros(3) if is_picture else background, additive=additive,
    )  # fmt: skip
    return splats._replace(ground=np.moveaxis(background, -1, 0) if is_picture else None)


def _by_shape(
    moments: torch.Tensor, sigma: torch.Tensor, rho: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return the gradients of mean, sigma and rho, by the chain rule through z = W (x - mean).

    Here W = [[1 / sx, 0], [-rho / (sx k), 1 / (sy k)]] and k = sqrt(1 - rho^2).
    """
    m1, m2, m11, m12, m22 = moments.T
    sx, sy = sigma.T
    k = torch.sqrt((1 - rho) * (1 + rho))
    by_mean = torch.stack([(m1 - rho / k * m2) / sx, m2 / (sy * k)], dim=1)
    by_sigma = torch.stack([(m11 - rho / k * m12) / sx, (m22 + rho / k * m12) / sy], dim=1)
    return by_mean, by_sigma, (m12 - rho / k * m22) / k


def fast_composite(
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
    """Return the image of gauss2svg.render.reference.composite, computed by the kernels.

    The tensors must be on the CPU, and may have any floating dtype. The image (height, width, 3) is
    float64 if all tensors are float64, else float32. The background is one colour, or a picture
    (height, width, 3) that lies below the shapes, such as the raster of a scene's areas and lines
    (gauss2svg.render.areas.ground_of). Areas and lines themselves have no gradient. Every tensor
    gets a gradient, but asking for a second derivative raises torch's error. Powers of s = r^2 / 2
    are computed with an s of at least 1e-12. So the factor s^(beta - 1) in the gradients of shapes
    with beta < 1 stays finite at the mean. Raise InputError for values outside the domain
    (gauss2svg.render.reference.shapes_of).
    """
    shapes = shapes_of(height, width, mean, sigma, rho, color, opacity, background, beta)
    return _FastRender.apply(*shapes, height, width, opacity is None)  # pyright: ignore[reportReturnType]
