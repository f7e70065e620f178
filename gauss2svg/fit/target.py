"""The image to fit: colours and edges, and the loss of Gaussians against it.

The weight map says how much an error at a pixel counts. Tuned for perception it is w = (1 + min(v,
m) / c^2)^-g, with v the local variance of luma and m a hundred times its median, from .025 to .04.
An error hides in texture and shows on smooth areas, as in visual masking (Daly, "The Visible
Differences Predictor", 1993). The crisp edges of drawings, where half of the picture is flat, still
count. Tuned for PSNR, w is 1, and up to 1 + FLAT on flat areas, where a streak of two levels is
visible that the squared error alone hardly counts. docs/decisions/perceptual.md has what each
gains.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, reduce
from operator import add
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.losses import image_gradient
from gauss2svg.fit.options import DEFAULT_LOSS, PSNR
from gauss2svg.photo.alpha import BACKDROPS, has_alpha, shrunk
from gauss2svg.render.cpu import (
    Splats,
    moments_of_gradient,
    removal_cost,
    render_planar,
    squared_error,
)
from gauss2svg.render.smooth import smoothed

# Opacity of new Gaussians on a target with alpha (docs/decisions/placement.md).
LEAST_OPACITY = 0.02  # least opacity at which a new Gaussian begins
MOST_OPACITY = 0.98  # largest opacity at which a new Gaussian begins


class LossAndGradient(NamedTuple):
    """The loss of a state, and the gradient that the optimiser follows.

    loss      summed over all values, none weighted; for "mse" half the squared error
    error     mean squared, not weighted
    moments   (n, MOMENTS) of the gradient, see gauss2svg.render.kernels; for "mse" not of loss, but
              of half the squared error as Target.weight weights it
    pairs     number of pixel-Gaussian pairs that were evaluated
    rendered  over each of the target's backdrops, (3, h, w)
    """

    loss: float
    error: float
    moments: NDArray[np.float64]
    pairs: int
    rendered: tuple[NDArray[np.floating], ...]


def _over(splats: Splats, backdrop: float | None) -> Splats:
    """Return the Gaussians over a backdrop of this grey level, or None over their background."""
    return splats if backdrop is None else splats._replace(background=np.full(3, backdrop))


class Target:
    """An image to fit, with what an error counts at each pixel and the direction of its edges.

    color (3, h, w) is float32 or float64, which the kernels then compute in; alpha (h, w) is None
    where the image is opaque. An image with alpha is fitted over a white and a black backdrop at
    once, which determines it over every other: Gaussians over a backdrop b are C + T_end b, with
    C = sum w_k c_k and the transmittance T_end. The kernels run once for each backdrop.

    planar        (3, h, w), or (6, h, w) over both backdrops: what the loss compares
    source_color  (3, h, w): colours for new Gaussians, those of the nearest visible pixel
    visible       (h, w) where alpha is above zero; None where the image is opaque
    weight        (h, w) of the squared error, by pixel_weight
    """

    def __init__(
        self,
        color: NDArray[np.floating],
        tune: str,
        alpha: NDArray[np.floating] | None = None,
    ) -> None:
        self.height, self.width = color.shape[1:]
        self._alpha = alpha
        self.visible: NDArray[np.bool_] | None = None
        if alpha is None:
            self.planar = self.source_color = color
            self._views: list[tuple[NDArray[np.floating], float | None]] = [(color, None)]
        else:
            self.visible = alpha >= 0.5 / 255
            self.source_color = _filled(color, self.visible)
            shown = [alpha * color + (1 - alpha) * color.dtype.type(b) for b in BACKDROPS]
            self.planar = np.concatenate(shown)
            self._views = [(self.planar[3 * k : 3 * k + 3], b) for k, b in enumerate(BACKDROPS)]
        self.tune = tune
        self.weight = pixel_weight([planar for planar, _ in self._views], tune)

    @property
    def is_transparent(self) -> bool:
        """Whether the target has alpha."""
        return self.visible is not None

    @property
    def is_blank(self) -> bool:
        """Whether no pixel of the target is visible."""
        return self.visible is not None and not self.visible.any()

    @cached_property
    def edges(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Direction of least change (h, w) in rad, and its coherence (h, w) in 0..1.

        From the structure tensor, the smoothed products of the gradient.
        """
        by_view = [slopes(planar.mean(axis=0)) for planar, _ in self._views]
        products = [(gx * gx, gy * gy, gx * gy) for gx, gy in by_view]
        jxx, jyy, jxy = (smoothed(reduce(add, parts), 2.0) for parts in zip(*products, strict=True))
        along = 0.5 * np.arctan2(2 * jxy, jxx - jyy) + np.pi / 2
        coherence = np.hypot(jxx - jyy, 2 * jxy) / (jxx + jyy + 1e-6)
        return along.astype(np.float32), coherence.astype(np.float32)

    def opacity_logits(self, mean: NDArray[np.float64], usual: float) -> NDArray[np.float64]:
        """(n,) logits of the initial opacities of Gaussians of mean (n, 2).

        The usual opacity times alpha, so that Gaussians do not begin by covering a translucent
        target (docs/decisions/placement.md).
        """
        if self._alpha is None:
            return np.full(len(mean), usual)
        from scipy.special import expit, logit  # a third of a second, and seldom needed

        x, y = np.clip(mean.astype(np.intp), 0, [self.width - 1, self.height - 1]).T
        opacity = expit(usual) * self._alpha[y, x]
        opacity = np.clip(opacity, LEAST_OPACITY, MOST_OPACITY)
        return logit(opacity.astype(np.float64))

    def rendered(self, splats: Splats) -> NDArray[np.floating]:
        """Render the Gaussians on this canvas, like planar."""
        real, size = self.planar.dtype.type, (self.height, self.width)
        return _joined([render_planar(_over(splats, b), *size, real) for _, b in self._views])

    def error(self, splats: Splats) -> float:
        """Mean squared error of the Gaussians against the target."""
        return float(np.mean(np.square(self.rendered(splats) - self.planar), dtype=np.float64))

    def error_of(self, rendered: Sequence[NDArray[np.floating]]) -> float:
        """Mean squared error of renders over each of the target's backdrops, (3, h, w)."""
        pairs = zip(rendered, self._views, strict=True)
        errors = [np.mean(np.square(own - view[0]), dtype=np.float64) for own, view in pairs]
        return float(np.mean(errors))

    def loss(self, splats: Splats) -> float:
        """The loss of `evaluate` for "mse", without the gradient."""
        return 0.5 * self.error(splats) * self.planar.size

    def evaluate(self, splats: Splats, loss: str, ssim_weight: float | None) -> LossAndGradient:
        """One of FitOptions.loss and its gradient."""
        parts: list[LossAndGradient] = []
        for planar, backdrop in self._views:
            over = _over(splats, backdrop)
            image, squares, moments, rows = squared_error(over, planar, self.weight)
            value = 0.5 * squares
            if loss != DEFAULT_LOSS:
                mean, gradient = image_gradient(loss, image, planar, ssim_weight)
                value, moments = mean * planar.size, moments_of_gradient(over, gradient)
            # Kernels count pairs in rows of a tile, of 16 px each.
            error = squares / planar.size / len(self._views)
            parts.append(LossAndGradient(value, error, moments, rows * 16, (image,)))
        return LossAndGradient(*(reduce(add, values) for values in zip(*parts, strict=True)))

    def squares(self, splats: Splats) -> tuple[float, NDArray[np.float64]]:
        """Weighted sum of squared differences, and the moments of the gradient of half of it."""
        parts = [squared_error(_over(splats, b), planar, self.weight) for planar, b in self._views]
        rendered = _joined([part[0] for part in parts])
        return self.weighted_squares(rendered), reduce(add, (part[2] for part in parts))

    def weighted_squares(self, rendered: NDArray[np.floating]) -> float:
        """Weighted sum of squared differences of a render, like planar."""
        squares = np.square(rendered - self.planar) * self.weight
        return float(np.sum(squares, dtype=np.float64))

    def removal_cost(self, splats: Splats) -> tuple[NDArray[np.floating], NDArray[np.float64]]:
        """The render, like planar, and what removing each costs; see gauss2svg.render.cpu."""
        parts = [removal_cost(_over(splats, b), planar, self.weight) for planar, b in self._views]
        return _joined([image for image, _ in parts]), reduce(add, (cost for _, cost in parts))


def target_of(pixels: NDArray[np.floating], dtype: Any, tune: str) -> Target:
    """The target of an image (h, w, 3) or (h, w, 4)."""
    planar = np.ascontiguousarray(np.moveaxis(pixels, -1, 0), dtype)
    return Target(planar[:3], tune, planar[3] if has_alpha(pixels) else None)


def _joined(images: list[NDArray[np.floating]]) -> NDArray[np.floating]:
    return images[0] if len(images) == 1 else np.concatenate(images)


def _filled(color: NDArray[np.floating], visible: NDArray[np.bool_]) -> NDArray[np.floating]:
    """Colours (3, h, w), on invisible pixels those of the nearest visible one."""
    if visible.all() or not visible.any():
        return color
    from scipy.ndimage import distance_transform_edt  # a third of a second, and seldom needed

    nearest = distance_transform_edt(~visible, return_distances=False, return_indices=True)
    y, x = np.asarray(nearest)
    return np.ascontiguousarray(color[:, y, x])


class TargetPyramid:
    """An image (h, w, 3) or (h, w, 4) as targets of reduced size.

    tune is that of Target. The kernels compute in dtype, float32 or float64, which takes twice the
    time and gains no PSNR (docs/decisions/numbers.md); aimed_at maps a reduced image to what is to
    be drawn of it.
    """

    def __init__(
        self,
        pixels: NDArray[np.float32],
        tune: str,
        dtype: Any = np.float32,
        aimed_at: Callable[[NDArray[np.float32]], NDArray[np.float32]] | None = None,
    ) -> None:
        self.pixels = pixels
        self._aimed_at = aimed_at
        self._dtype = dtype
        self._tune = tune
        self._targets: dict[int, Target] = {}

    def reduced(self, factor: int) -> Target:
        """The target at 1 / factor of the width and height, which is computed once."""
        if factor not in self._targets:
            height, width = self.pixels.shape[:2]
            size = max(1, height // factor), max(1, width // factor)
            small = shrunk(self.pixels, *size)
            if self._aimed_at is not None:
                small = self._aimed_at(small)
            self._targets[factor] = target_of(small, self._dtype, self._tune)
        return self._targets[factor]


# Contrast masking and flat areas, by the module's formulas (docs/decisions/perceptual.md).
CONTRAST = 0.03  # c: standard deviation of luma, in 0..1, from which an error is masked
EXPONENT = 0.5  # g: how fast the weight falls with the variance
TIMES_MEDIAN = 100.0  # multiple of the median variance above which nothing is masked further
LEAST_BOUND = 0.025  # lower bound of that variance
MOST_BOUND = 0.04  # upper bound of that variance
WINDOW = 2.0  # sigma in px of the window of the variance
FLAT = 8.0  # weight of a flat area, to which others are 1 (docs/decisions/metrics.md)
FLAT_GRADIENT = 0.02  # gradient of luma for each px below which an area is flat: 5 levels of 255
FLAT_REACH = 4.0  # sigma in px of the window in which the gradient is averaged


def pixel_weight(views: list[NDArray[np.floating]], tune: str) -> NDArray[np.floating]:
    """(h, w) weights > 0 of a picture, given over each of its backdrops as (3, h, w) in 0..1."""
    lumas = [view.mean(axis=0) for view in views]
    if tune == PSNR:
        energy = reduce(add, map(_gradient_energy, lumas)) / len(lumas)
        flatness = np.exp(-smoothed(energy, FLAT_REACH) / FLAT_GRADIENT**2)
        weight = 1 + FLAT * flatness
    else:
        variance = reduce(add, map(_local_variance, lumas)) / len(lumas)
        most = TIMES_MEDIAN * np.median(variance)
        most = np.clip(most, LEAST_BOUND, MOST_BOUND)
        weight = (1 + np.minimum(variance, most) / CONTRAST**2) ** -EXPONENT
        weight /= weight.mean()
    return weight.astype(views[0].dtype)


def slopes(luma: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Derivatives (h, w) of the smoothed luma (h, w) along x and y."""
    luma = smoothed(luma, 1.0)
    height, width = len(luma), len(luma[0])
    gy = np.gradient(luma, axis=0) if height > 1 else np.zeros_like(luma)
    gx = np.gradient(luma, axis=1) if width > 1 else np.zeros_like(luma)
    return gx, gy


def _gradient_energy(luma: NDArray[np.floating]) -> NDArray[np.floating]:
    gx, gy = slopes(luma)
    return gx * gx + gy * gy


def _local_variance(luma: NDArray[np.floating]) -> NDArray[np.floating]:
    mean = smoothed(luma, WINDOW)
    return np.maximum(smoothed(luma * luma, WINDOW) - mean * mean, 0)
