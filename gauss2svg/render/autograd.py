"""The fast CPU renderer as a differentiable torch function, so that any torch loss works.

The Gaussians have gradients. The areas and lines of a scene have none: their raster is the picture
that the Gaussians are drawn over.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
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
        with _one_thread():
            value = function(image, torch.from_numpy(target))
            if not isinstance(value, torch.Tensor) or value.numel() != 1 or not value.requires_grad:
                needed, advice = "a scalar that depends on the render", ".mean(), without .detach()"
                raise refusal("loss", needed, quoted(value), advice)
            return value.item(), torch.autograd.grad(value, image)[0]

    loss.__name__ = getattr(function, "__name__", "loss")
    return loss


@contextmanager
def _one_thread() -> Iterator[None]:
    """Let torch use one thread, and restore its number of threads afterwards."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


class _FastRender(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, *arguments: Any) -> torch.Tensor:
        *tensors, height, width, ctx.additive = arguments
        ctx.save_for_backward(*tensors)
        splats = _splats(*tensors)._replace(additive=ctx.additive)
        image = render_planar(splats, height, width, _precision(tensors))
        return torch.from_numpy(np.ascontiguousarray(np.moveaxis(image, 0, -1)))

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(  # pyright: ignore[reportIncompatibleMethodOverride] (the decorator's type)
        ctx: Any, *grad_outputs: torch.Tensor
    ) -> tuple[Any, ...]:
        mean, sigma, rho, color, opacity, background, beta = ctx.saved_tensors
        real = _precision(ctx.saved_tensors)
        # The kernels return the product of the opacity and its gradient. At opacity 0 it says
        # nothing about the gradient, so smaller opacities are raised. Ten thousand shapes of the
        # raised opacity change no pixel of an image of this dtype.
        raised_opacity = opacity.double().clamp(min=1e-12 if real is np.float32 else 1e-20)
        # If beta is exactly 1, the kernels do not compute the gradient of the exponent. So use the
        # next number above 1.
        shifted_beta = beta.double()
        if ctx.needs_input_grad[6]:
            shifted_beta = torch.where(shifted_beta == 1, np.nextafter(1, 2), shifted_beta)
        splats = _splats(mean, sigma, rho, color, raised_opacity, background, shifted_beta)
        splats = splats._replace(additive=ctx.additive)
        gradient = np.ascontiguousarray(np.moveaxis(grad_outputs[0].detach().numpy(), -1, 0), real)
        moments = torch.from_numpy(moments_of_gradient(splats, gradient))
        by_opacity = moments[:, 5] / raised_opacity
        # The gradients of the other parameters are proportional to the opacity. The kernels have
        # computed them for the raised opacity, so scale them to the true opacity.
        moments *= (opacity.double() / raised_opacity)[:, None]
        gradients = (
            *_by_shape(moments[:, :5], sigma.double(), rho.double()),
            moments[:, 6:9],
            by_opacity,
            torch.from_numpy(_by_background(splats, gradient)).sum_to_size(background.shape),
            -moments[:, 9],
        )
        typed = (g.to(t.dtype) for g, t in zip(gradients, ctx.saved_tensors, strict=True))
        return (*typed, None, None, None)


def _precision(tensors: Sequence[torch.Tensor]) -> type[np.floating]:
    return np.float64 if all(t.dtype == torch.float64 for t in tensors) else np.float32


def _splats(*tensors: torch.Tensor) -> Splats:
    mean, sigma, rho, color, opacity, background, beta = (
        tensor.detach().to(torch.float64).numpy() for tensor in tensors
    )
    splats = splats_from(
        mean, sigma, rho, whitening_of(sigma, rho),
        color=color, opacity=opacity, beta=beta, background=background,
    )  # fmt: skip
    if background.ndim == 1:
        return splats
    return splats._replace(background=np.zeros(3), ground=np.moveaxis(background, -1, 0))


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


def _by_background(splats: Splats, gradient: NDArray[np.floating]) -> NDArray[np.float64]:
    """Return the gradient (h, w, 3) of the loss with respect to the background of each pixel.

    It is the gradient (3, h, w) of the render times the transmittance of all shapes together. This
    transmittance is the render of black shapes on white, or 1 with additive blending.
    """
    by_pixel = np.moveaxis(gradient, 0, -1).astype(np.float64)
    if splats.additive:
        return by_pixel
    black = splats._replace(
        opacity_color=splats.opacity_color * [1.0, 0.0, 0.0, 0.0],
        background=np.ones(3), ground=None,
    )  # fmt: skip
    _, height, width = gradient.shape
    transmittance = render_planar(black, height, width, gradient.dtype.type)
    return by_pixel * np.moveaxis(transmittance, 0, -1)


def fast_composite(
    mean: torch.Tensor,
    sigma: torch.Tensor,
    rho: torch.Tensor,
    color: torch.Tensor,
    opacity: torch.Tensor,
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
    shapes = shapes_of(mean, sigma, rho, color, background, height, width, opacity, beta)
    return _rendered(shapes, int(height), int(width), additive=False)


def fast_accumulate(
    mean: torch.Tensor,
    sigma: torch.Tensor,
    rho: torch.Tensor,
    color: torch.Tensor,
    background: torch.Tensor,
    height: int,
    width: int,
) -> torch.Tensor:
    """Return the image of gauss2svg.render.reference.accumulate, computed by the kernels.

    `fast_composite` describes the tensors, the gradients and the errors.
    """
    shapes = shapes_of(mean, sigma, rho, color, background, height, width)
    return _rendered(shapes, int(height), int(width), additive=True)


def _rendered(
    shapes: tuple[torch.Tensor, ...], height: int, width: int, additive: bool
) -> torch.Tensor:
    image = _FastRender.apply(*shapes, height, width, additive)
    assert isinstance(image, torch.Tensor)
    return image
