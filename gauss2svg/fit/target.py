"""The picture that a fit looks at: what it has, how far from it the Gaussians are, and why."""

from __future__ import annotations

import math
from functools import cached_property, reduce
from operator import add
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, gaussian_filter
from scipy.special import expit, logit

from gauss2svg.fit.losses import DEFAULT_LOSS, image_gradient
from gauss2svg.photo.alpha import BACKDROPS, has_alpha, shrunk
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
_LEAST_ALPHA = 0.5 / 255  # of a pixel that shows
_LEAST_OPACITY, _MOST_OPACITY = 0.02, 0.98  # with which Gaussians on a picture with alpha begin


class LossAndGradient(NamedTuple):
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


class View(NamedTuple):
    """A picture as a page shows it: planar (3, h, w), and the page's grey level in 0..1.

    page  None where the picture is opaque: then the Gaussians have their own background
    """

    planar: NDArray[np.floating]
    page: float | None

    def on_page(self, splats: Splats) -> Splats:
        """The Gaussians over this page."""
        if self.page is None:
            return splats
        return splats._replace(background=np.full(3, self.page))


class Target:
    """A picture to fit, with its flat areas and the direction of its edges.

    color (3, h, w) is float32 or float64, which is then what the kernels compute in; alpha
    (h, w) None where it is opaque. A picture with alpha is fitted over white and over black at
    once, which is as it is over every page: with C = sum w_k c_k and T_end the Gaussians over a
    page b are C + T_end b, so the kernels visit them once for each.

    planar (3, h, w), or (6, h, w) over both pages, is what is compared, paint (3, h, w) what new
    Gaussians are painted with: the colour of the nearest pixel that shows. weight (h, w) in
    1..1 + flat_weight is large where the picture is flat: there a streak of two levels
    shows, which the squared error alone hardly sees.
    """

    def __init__(
        self,
        color: NDArray[np.floating],
        flat_weight: float = 0.0,
        alpha: NDArray[np.floating] | None = None,
    ) -> None:
        self.height, self.width = color.shape[1:]
        self._alpha = alpha
        self.visible: NDArray[np.bool_] | None = None
        if alpha is None:
            self.planar = self.paint = color
            self._views = (View(color, None),)
        else:
            self.visible = alpha >= _LEAST_ALPHA
            self.paint = _filled(color, self.visible)
            pages = [alpha * color + (1 - alpha) * color.dtype.type(page) for page in BACKDROPS]
            self.planar = np.concatenate(pages)
            self._views = tuple(
                View(self.planar[3 * k : 3 * k + 3], page) for k, page in enumerate(BACKDROPS)
            )
        self._slopes = [_slopes(view.planar) for view in self._views]
        energy = reduce(add, (gx * gx + gy * gy for gx, gy in self._slopes)) / len(self._views)
        energy = gaussian_filter(energy, _FLAT_REACH)
        self.weight = (1 + flat_weight * np.exp(-energy / _FLAT_ENERGY)).astype(color.dtype)

    @property
    def is_transparent(self) -> bool:
        """Whether it has alpha."""
        return self.visible is not None

    @property
    def is_blank(self) -> bool:
        """Whether it has alpha, and nothing of it shows."""
        return self.visible is not None and not self.visible.any()

    @cached_property
    def edges(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Direction of least change in rad, and coherence in 0..1: how much there is only one.

        From the structure tensor J, the smoothed products of the gradient. Only computed
        where it is asked for: selective placement seldom does.
        """
        products = [(gx * gx, gy * gy, gx * gy) for gx, gy in self._slopes]
        jxx, jyy, jxy = (
            gaussian_filter(reduce(add, parts), 2.0) for parts in zip(*products, strict=True)
        )
        along = 0.5 * np.arctan2(2 * jxy, jxx - jyy) + np.pi / 2
        coherence = np.hypot(jxx - jyy, 2 * jxy) / (jxx + jyy + 1e-6)
        return along.astype(np.float32), coherence.astype(np.float32)

    def spacing(self, count: int) -> float:
        """Radius in px of the disc that is each Gaussian's share of the picture."""
        return math.sqrt(self.width * self.height / (max(count, 1) * math.pi))

    def opacity_logits(self, mean: NDArray[np.float64], usual: float) -> NDArray[np.float64]:
        """(n,) logits of the opacities with which Gaussians of mean (n, 2) begin.

        Times alpha, so that details do not begin by covering what shines through. PSNR of the
        model, 1000 Gaussians on half the size, with the usual opacity / with this: a soft ellipse
        35.46 / 35.94 dB, a ramp of alpha 32.87 / 34.63, a hard cut-out 33.73 / 33.85; times
        alpha^2.5 35.82 and 34.70.
        """
        if self._alpha is None:
            return np.full(len(mean), usual)
        x, y = np.clip(mean.astype(np.intp), 0, [self.width - 1, self.height - 1]).T
        opacity = np.clip(expit(usual) * self._alpha[y, x], _LEAST_OPACITY, _MOST_OPACITY)
        return logit(opacity.astype(np.float64))

    def rendered(self, splats: Splats) -> NDArray[np.floating]:
        """The Gaussians on this canvas, like planar."""
        real = self.planar.dtype.type
        return _joined(
            [
                render_planar(view.on_page(splats), self.height, self.width, real)
                for view in self._views
            ]
        )

    def error(self, splats: Splats) -> float:
        """Mean squared difference of the Gaussians to this picture."""
        return float(np.mean(np.square(self.rendered(splats) - self.planar), dtype=np.float64))

    def loss(self, splats: Splats) -> float:
        """The loss of `evaluated`, where it is the squared error."""
        return 0.5 * self.error(splats) * self.planar.size

    def evaluate(self, splats: Splats, loss: str, ssim_weight: float | None) -> LossAndGradient:
        """The loss, one of FitOptions.loss, and its gradient."""
        judgements = [self._evaluate(view, splats, loss, ssim_weight) for view in self._views]
        losses, errors, moments, pairs = zip(*judgements, strict=True)
        return LossAndGradient(
            sum(losses), sum(errors) / len(errors), reduce(add, moments), sum(pairs)
        )

    def _evaluate(
        self, view: View, splats: Splats, loss: str, ssim_weight: float | None
    ) -> LossAndGradient:
        splats = view.on_page(splats)
        image, squares, moments, rows = squared_error(splats, view.planar, self.weight)
        value = 0.5 * squares
        if loss != DEFAULT_LOSS:
            mean, gradient = image_gradient(loss, image, view.planar, ssim_weight)
            value = mean * view.planar.size
            moments = moments_of_gradient(splats, gradient)
        return LossAndGradient(value, squares / view.planar.size, moments, rows * _PIXELS_A_ROW)

    def squares(self, splats: Splats) -> tuple[float, NDArray[np.float64]]:
        """Sum of squared differences, and the moments of half of it."""
        parts = [squared_error(view.on_page(splats), view.planar) for view in self._views]
        return sum(part[1] for part in parts), reduce(add, (part[2] for part in parts))

    def removal_cost(self, splats: Splats) -> tuple[NDArray[np.floating], NDArray[np.float64]]:
        """The Gaussians drawn, and what taking each away would cost, as the kernels say."""
        parts = [removal_cost(view.on_page(splats), view.planar) for view in self._views]
        return _joined([image for image, _ in parts]), reduce(add, (cost for _, cost in parts))


def target_of(pixels: NDArray[np.floating], dtype: Any, flat_weight: float = 0.0) -> Target:
    """The target that a picture (h, w, 3) or (h, w, 4) is."""
    planar = np.ascontiguousarray(np.moveaxis(pixels, -1, 0), dtype)
    return Target(planar[:3], flat_weight, planar[3] if has_alpha(pixels) else None)


def _joined(images: list[NDArray[np.floating]]) -> NDArray[np.floating]:
    return images[0] if len(images) == 1 else np.concatenate(images)


def _slopes(planar: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Derivatives (h, w) of the smoothed luma along x and y."""
    luma = gaussian_filter(planar.mean(axis=0), 1.0)
    height, width = planar.shape[1:]
    gy = np.gradient(luma, axis=0) if height > 1 else np.zeros_like(luma)
    gx = np.gradient(luma, axis=1) if width > 1 else np.zeros_like(luma)
    return gx, gy


def _filled(color: NDArray[np.floating], visible: NDArray[np.bool_]) -> NDArray[np.floating]:
    """Colours (3, h, w), where they do not show those of the nearest pixel that does."""
    if visible.all() or not visible.any():
        return color
    nearest = distance_transform_edt(~visible, return_distances=False, return_indices=True)
    y, x = np.asarray(nearest)
    return np.ascontiguousarray(color[:, y, x])


class Views:
    """A picture (h, w, 3) or (h, w, 4) as targets of 1 / factor its width and height.

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
            small = shrunk(self.pixels, *size)
            self._targets[factor] = target_of(small, self._dtype, self._flat_weight)
        return self._targets[factor]
