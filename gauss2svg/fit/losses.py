"""Losses besides the squared error, whose gradient the kernels compute themselves."""

from __future__ import annotations

import math
from functools import reduce
from operator import add

import numpy as np
from numpy.typing import NDArray

from gauss2svg.render.torch_extra import require_torch

DEFAULT_LOSS = "mse"

# Weight of 1 - SSIM against the pixel term, as in "3D Gaussian Splatting for
# Real-Time Radiance Field Rendering" (Kerbl et al., 2023).
SSIM_WEIGHT = 0.2
_WINDOW, _SIGMA = 11, 1.5
_C1, _C2 = 0.01**2, 0.03**2


def has_ssim(loss: str) -> bool:
    """Whether a loss has an SSIM term."""
    return loss.endswith("+ssim")


def image_gradient(
    loss: str,
    rendered: NDArray[np.floating],
    target: NDArray[np.floating],
    ssim_weight: float | None = None,
) -> tuple[float, NDArray[np.floating]]:
    """Loss and its gradient (3, h, w) with respect to rendered (3, h, w), by torch.

    mse: mean (r - t)^2; l1: mean |r - t|; with +ssim: (1 - w) times that + w (1 - SSIM), with
    w = ssim_weight in 0..1, SSIM_WEIGHT if None. The gradient is multiplied by the number of
    values, so that its scale does not depend on the size.
    """
    torch = require_torch(f"loss {loss!r}")
    image = torch.from_numpy(rendered).requires_grad_()
    reference = torch.from_numpy(target)
    pixel = torch.nn.functional.l1_loss if loss.startswith("l1") else torch.nn.functional.mse_loss
    value = pixel(image, reference)
    if has_ssim(loss):
        ssim_weight = SSIM_WEIGHT if ssim_weight is None else ssim_weight
        dissimilarity = 1 - structural_similarity(image, reference)
        value = (1 - ssim_weight) * value + ssim_weight * dissimilarity
    value.backward()
    assert image.grad is not None  # the loss depends on the image
    return float(value.detach()), (image.grad * image.numel()).numpy()


def structural_similarity(image, other):
    """Mean SSIM of two torch images (3, h, w) in 0..1, differentiable.

    11 x 11 Gaussian window of sigma 1.5 (Wang et al., 2004), only where it lies inside the
    image; a smaller image takes the largest odd window that fits.
    """
    torch = require_torch("SSIM as a loss")
    side = min(_WINDOW, *(s - 1 + s % 2 for s in image.shape[1:]))
    x = torch.arange(side, dtype=image.dtype, device=image.device) - side // 2
    weights = torch.exp(-0.5 * (x / _SIGMA) ** 2)
    taps = list(enumerate((weights / weights.sum()).tolist()))

    def blur(planes):
        # Sums of shifted images: three times as fast as conv2d on the CPU.
        height, width = (s - side + 1 for s in planes.shape[1:])
        rows = reduce(add, (tap * planes[:, :, k : k + width] for k, tap in taps))
        return reduce(add, (tap * rows[:, k : k + height] for k, tap in taps))

    a, b = blur(image), blur(other)
    variance_a = blur(image * image) - a * a
    variance_b = blur(other * other) - b * b
    covariance = blur(image * other) - a * b
    top = (2 * a * b + _C1) * (2 * covariance + _C2)
    bottom = (a * a + b * b + _C1) * (variance_a + variance_b + _C2)
    return (top / bottom).mean()


def psnr_of(error: float) -> float:
    """PSNR in dB of a mean squared error; infinity for 0."""
    return -10 * math.log10(error) if error > 0 else math.inf
