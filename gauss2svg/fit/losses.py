"""Losses with their gradients. For "mse" alone the kernels compute the gradient themselves."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.options import has_ssim

# Weight of 1 - SSIM against the pixel term, as in "3D Gaussian Splatting for
# Real-Time Radiance Field Rendering" (Kerbl et al., 2023).
SSIM_WEIGHT = 0.2

# Functions from the difference of a value from its target to the loss and its derivative.
PIXEL_LOSSES: dict[str, Callable[[Any], tuple[Any, Any]]] = {
    "mse": lambda difference: (difference**2, 2 * difference),
    "l1": lambda difference: (np.abs(difference), np.sign(difference)),
}


def image_gradient(
    loss: str,
    rendered: NDArray[np.floating],
    target: NDArray[np.floating],
    ssim_weight: float | None = None,
) -> tuple[float, NDArray[np.floating]]:
    """Return the loss and its gradient (3, h, w) with respect to rendered (3, h, w).

    The loss is the mean of a pixel loss p. With +ssim it is (1 - w) p + w (1 - SSIM), where w is
    ssim_weight in 0..1, or SSIM_WEIGHT if None. The gradient is multiplied by the number of values,
    so that its scale does not depend on the size.
    """
    losses, gradient = PIXEL_LOSSES[loss.removesuffix("+ssim")](rendered - target)
    value = np.mean(losses, dtype=np.float64)
    if has_ssim(loss):
        weight = SSIM_WEIGHT if ssim_weight is None else ssim_weight
        value *= 1 - weight
        gradient *= 1 - weight
        for channel, planes in enumerate(zip(rendered, target, strict=True)):
            similarity, slope = structural_similarity(*planes)
            value += weight * (1 - similarity) / len(rendered)
            gradient[channel] -= weight * slope
    return float(value), gradient


def structural_similarity(
    image: NDArray[np.floating], target: NDArray[np.floating]
) -> tuple[float, NDArray[np.floating]]:
    """Return the mean SSIM of planes (h, w) in 0..1, and its gradient by image times h w.

    With a, b, p, s and q the blurred image x, target t, x^2, t^2 and x t, a window has

        SSIM = A1 A2 / (B1 B2),  A1 = 2 a b + C1,        A2 = 2 (q - a b) + C2,
                                 B1 = a^2 + b^2 + C1,    B2 = p - a^2 + s - b^2 + C2.

    Blurring is its own transpose, so the gradient is blur(d/da) + 2 x blur(d/dp) + t blur(d/dq).

    Windows are Gaussians of sigma 1.5 over 11 x 11 pixels (Wang et al., 2004) inside the image. For
    a smaller image they have the largest odd size that fits.
    """
    height, width = image.shape
    c1, c2 = 0.01**2, 0.03**2
    radius = min(5, (height - 1) // 2, (width - 1) // 2)
    windows = slice(radius, height - radius), slice(radius, width - radius)

    from scipy.ndimage import gaussian_filter  # slow to import, seldom needed

    def blurred(plane: NDArray[np.floating]) -> NDArray[np.floating]:
        return gaussian_filter(plane, 1.5, radius=radius, mode="constant")

    def gathered(slope: NDArray[np.floating]) -> NDArray[np.floating]:
        padded = np.zeros_like(image)
        padded[windows] = slope
        return blurred(padded)

    products = image, target, image * image, target * target, image * target
    a, b, p, s, q = (blurred(plane)[windows] for plane in products)
    a1, a2 = 2 * a * b + c1, 2 * (q - a * b) + c2
    b1, b2 = a * a + b * b + c1, p - a * a + s - b * b + c2
    over = 1 / (b1 * b2)
    similarity = a1 * a2 * over
    by_mean = 2 * b * (a2 - a1) * over + 2 * a * similarity * (1 / b2 - 1 / b1)
    gradient = gathered(by_mean) + target * gathered(2 * a1 * over)
    gradient -= 2 * image * gathered(similarity / b2)
    return float(similarity.mean(dtype=np.float64)), gradient * (image.size / similarity.size)


def psnr_of(error: float) -> float:
    """Return the PSNR in dB of a mean squared error; infinity for 0."""
    return -10 * math.log10(error) if error > 0 else math.inf
