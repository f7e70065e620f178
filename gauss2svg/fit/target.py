"""The picture that a fit looks at: what it has, how far from it the Gaussians are, and why."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from gauss2svg.fit.losses import DEFAULT_LOSS, image_gradient
from gauss2svg.image import shrink
from gauss2svg.render.cpu import (
    Splats,
    moments_of_gradient,
    removal_cost,
    render_planar,
    squared_error,
)

# Flat: gradients under 0.02 a px (5 levels of 255) within some 4 px.
_FLAT_ENERGY = 0.02**2
_FLAT_REACH = 4.0
_PIXELS_A_ROW = 16  # of a pair row, what the kernels count


class Judgement(NamedTuple):
    """What a step of a fit goes by.

    loss     what is made small, summed over all values
    error    mean squared
    moments  (n, MOMENTS) of the gradient, see gauss2svg.render.kernels
    pairs    of a pixel and a Gaussian, that were visited
    """

    loss: float
    error: float
    moments: NDArray[np.float64]
    pairs: int


class Target:
    """A picture (3, h, w) to fit, with its flat areas and the direction of its edges.

    planar is float32 or float64, which is then what the kernels compute in. weight (h, w)
    in 1..1 + flat_weight is large where the picture is flat: there a streak of two levels
    shows, which the squared error alone hardly sees.
    """

    def __init__(self, planar: NDArray[np.floating], flat_weight: float = 0.0) -> None:
        self.planar = planar
        self.height, self.width = planar.shape[1:]
        luma = gaussian_filter(planar.mean(axis=0), 1.0)
        gy = np.gradient(luma, axis=0) if self.height > 1 else np.zeros_like(luma)
        gx = np.gradient(luma, axis=1) if self.width > 1 else np.zeros_like(luma)
        self._slopes = gx, gy
        energy = gaussian_filter(gx * gx + gy * gy, _FLAT_REACH)
        self.weight = (1 + flat_weight * np.exp(-energy / _FLAT_ENERGY)).astype(planar.dtype)

    @cached_property
    def edges(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Direction of least change in rad, and coherence in 0..1: how much there is only one.

        From the structure tensor J, the smoothed products of the gradient. Only computed
        where it is asked for: selective placement seldom does.
        """
        gx, gy = self._slopes
        jxx, jyy, jxy = (gaussian_filter(p, 2.0) for p in (gx * gx, gy * gy, gx * gy))
        along = 0.5 * np.arctan2(2 * jxy, jxx - jyy) + np.pi / 2
        coherence = np.hypot(jxx - jyy, 2 * jxy) / (jxx + jyy + 1e-6)
        return along.astype(np.float32), coherence.astype(np.float32)

    def spacing(self, count: int) -> float:
        """Radius in px of the disc that is each Gaussian's share of the picture."""
        return math.sqrt(self.width * self.height / (max(count, 1) * math.pi))

    def rendered(self, splats: Splats) -> NDArray[np.floating]:
        """The Gaussians on this canvas, (3, h, w) like planar."""
        return render_planar(splats, self.height, self.width, self.planar.dtype.type)

    def error(self, splats: Splats) -> float:
        """Mean squared difference of the Gaussians to this picture."""
        return float(np.mean(np.square(self.rendered(splats) - self.planar), dtype=np.float64))

    def judged(self, splats: Splats, loss: str, ssim_weight: float | None) -> Judgement:
        """The loss, one of gauss2svg.fit.losses.LOSSES, and its gradient."""
        image, squares, moments, rows = squared_error(splats, self.planar, self.weight)
        value = 0.5 * squares
        if loss != DEFAULT_LOSS:
            mean, gradient = image_gradient(loss, image, self.planar, ssim_weight)
            value = mean * self.planar.size
            moments = moments_of_gradient(splats, gradient)
        return Judgement(value, squares / self.planar.size, moments, rows * _PIXELS_A_ROW)

    def removal_cost(self, splats: Splats) -> tuple[NDArray[np.floating], NDArray[np.float64]]:
        """The Gaussians drawn, and what taking each away would cost, as the kernels say."""
        return removal_cost(splats, self.planar)


class Views:
    """A picture (h, w, 3) float32 in 0..1 as targets of 1 / factor its width and height.

    dtype is what is computed in, flat_weight that of Target.
    """

    def __init__(self, pixels: NDArray[np.float32], dtype: Any, flat_weight: float) -> None:
        self.pixels = pixels
        self._dtype = dtype
        self._flat_weight = flat_weight
        self._targets: dict[int, Target] = {}

    def reduced(self, factor: int) -> Target:
        """The picture at 1 / factor of its width and height, made once."""
        if factor not in self._targets:
            height, width = self.pixels.shape[:2]
            size = max(1, height // factor), max(1, width // factor)
            planar = np.moveaxis(shrink(self.pixels, *size), -1, 0)
            planar = np.ascontiguousarray(planar, self._dtype)
            self._targets[factor] = Target(planar, self._flat_weight)
        return self._targets[factor]
