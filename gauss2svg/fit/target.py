"""The image to fit: its colours and edges, and the loss of Gaussians against it.

Each pixel has a weight w, which says how much an error there counts. If the target is tuned for
perception, w is (1 + min(v, m) / c^2)^-g, divided by its mean over the picture. v is the local
variance of luma, and m is 0.03. So errors count
less in texture, which hides them, than on smooth areas, where they are visible. This is visual
masking (Daly, "The Visible Differences Predictor", 1993). The bound m keeps the weight of crisp
edges from becoming too small in drawings, half of which is flat.

If the target is tuned for PSNR, w is larger on flat areas, up to 9, and nearly 1 elsewhere.
On a flat area, a streak of two levels is visible, although it hardly changes the squared error.
docs/decisions/perceptual.md says how much both kinds of weights improve pictures.

A mask of where detail matters (docs/decisions/focus.md) multiplies w. All errors and losses are
then means that are weighted by the mask.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from operator import add
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.core import Floats, Reals
from gauss2svg.errors import refusal
from gauss2svg.fit import DEFAULT_LOSS, PERCEPTUAL, PSNR, LossFunction, LossName, has_ssim
from gauss2svg.photo.pixels import BACKDROPS, Focus, has_alpha, shrunk
from gauss2svg.render import cpu
from gauss2svg.render.cpu import Splats
from gauss2svg.scene import Scene
from gauss2svg.without_scipy import smoothed


class LossAndGradient(NamedTuple):
    """The loss of a state, and the gradient that the optimiser follows.

    loss      sum of the losses of all channels of all pixels, weighted by Target.focus. For
              SQUARED_LOSSES it is half the sum of squared errors
    error     mean squared error, weighted by Target.focus
    moments   (n, MOMENTS) moments of the gradient (gauss2svg.render.kernels). For DEFAULT_LOSS this
              is not the gradient of `loss`, but of half the sum of squared errors with the weights
              Target.weight
    pairs     number of pixel-Gaussian pairs that were evaluated
    rendered  the renders (3, h, w): one render for each backdrop of the target
    """

    loss: float
    error: float
    moments: Floats
    pairs: int
    rendered: tuple[Reals, ...]


class Target:
    """An image to fit, with the weight of an error and the direction of edges at each pixel.

    pixels     (h, w, 3) or (h, w, 4) in 0..1, float32 or float64. The kernels compute in this
               dtype. float64 takes twice the time and does not raise the PSNR
               (docs/decisions/numbers.md)
    tune       value of FitOptions.tune
    transform  function from `pixels`, perhaps reduced, to the picture that is fitted. If it is
               None, the pixels themselves are fitted
    mask       mask of the parts of the image where detail matters most. If it is None, detail
               matters equally everywhere
    ground     scene of areas, without Gaussians, that lies below the Gaussians. If it is None, only
               a background lies below them

    An image with alpha is fitted over a white and a black backdrop at the same time. The render
    over any other backdrop b follows from these two renders, because it is C + T_end b with the
    Gaussians' colour C = sum w_k c_k and their transmittance T_end. The kernels run once for each
    backdrop.

    planar        image with which renders are compared: (3, h, w), or (6, h, w) if the image has
                  alpha, first over white and then over black
    source_color  (3, h, w) colours for new Gaussians. An invisible pixel has the colour of the
                  nearest visible pixel
    is_transparent  whether the image has alpha
    visible       (h, w) whether alpha is at least half of 1/255; None if the image is opaque
    focus         (h, w) weight of errors by the mask, of mean 1; None without a mask
    weight        (h, w) weight of the squared error at each pixel: that of pixel_weight, multiplied
                  by `focus`
    """

    def __init__(
        self,
        pixels: Reals,
        tune: str,
        transform: Callable[[NDArray[Any]], NDArray[Any]] | None = None,
        mask: Focus | None = None,
        ground: Scene | None = None,
    ) -> None:
        self.pixels, self.tune, self.mask, self.ground = pixels, tune, mask, ground
        self.height, self.width = pixels.shape[:2]
        self._arguments = tune, transform, mask, ground
        self._reduced: dict[int, Target] = {}
        fitted = pixels if transform is None else transform(pixels)
        planar = np.ascontiguousarray(np.moveaxis(fitted, -1, 0))
        color, alpha = planar[:3], planar[3] if has_alpha(fitted) else None
        self._alpha = alpha
        self.visible: NDArray[np.bool_] | None = None
        self.is_transparent = alpha is not None
        if alpha is None:
            self.planar = self.source_color = color
            self._views: list[tuple[Reals, float | None]] = [(color, None)]
        else:
            self.visible = visible = alpha >= 0.5 / 255
            self.source_color = _filled(color, visible)
            composites = [alpha * color + (1 - alpha) * color.dtype.type(b) for b in BACKDROPS]
            self.planar = np.concatenate(composites)
            self._views = [(self.planar[3 * k : 3 * k + 3], b) for k, b in enumerate(BACKDROPS)]
        self.weight = weight = pixel_weight([planar for planar, _ in self._views], tune)
        self.focus: Reals | None = None
        if mask is not None:
            self.focus = mask.weight(self.height, self.width).astype(planar.dtype)
            self.weight = self.focus * weight
            self.weight *= weight.mean() / self.weight.mean()
        self._grounds: dict[float | None, Reals] = {}
        if ground is not None:
            from gauss2svg.render.areas import ground_of  # few fits need its kernels

            size = self.height, self.width, planar.dtype.type
            self._grounds = {b: ground_of(ground, *size, b) for _, b in self._views}

    def reduced(self, factor: int) -> Target:
        """Return the target at 1 / factor of width and height. Each target is made only once."""
        if factor == 1:
            return self
        if factor not in self._reduced:
            small = shrunk(self.pixels, max(1, self.height // factor), max(1, self.width // factor))
            self._reduced[factor] = Target(small, *self._arguments)
        return self._reduced[factor]

    @property
    def visible_weight(self) -> Reals | None:
        """Weight (h, w) that says how much an error at each pixel matters to a viewer.

        Its mean is 1. It is None if all weights are 1. In contrast to `weight`, it never contains
        the larger weights that flat areas have if the target is tuned for PSNR.
        """
        return self.weight if self.tune == PERCEPTUAL else self.focus

    @property
    def is_blank(self) -> bool:
        """Whether no pixel of the target is visible."""
        return self.visible is not None and not self.visible.any()

    def _over_each(self, splats: Splats) -> Iterator[tuple[Reals, Splats]]:
        """Yield the picture over each backdrop, and the splats over it or over the ground."""
        for planar, backdrop in self._views:
            if self._grounds:
                splats = splats._replace(ground=self._grounds[backdrop])
            elif backdrop is not None:
                splats = splats._replace(background=np.full(3, backdrop))
            yield planar, splats

    def opacity_logits(self, mean: Floats, usual_logit: float) -> Floats:
        """Return the logits (n,) of the initial opacities of Gaussians with means `mean` (n, 2).

        The logit is `usual_logit` on an opaque target. On a target with alpha, the opacity is the
        usual opacity times the alpha at the mean, so that new Gaussians do not cover a translucent
        area too much (docs/decisions/placement.md).
        """
        if self._alpha is None:
            return np.full(len(mean), usual_logit)
        x, y = np.clip(mean.astype(np.intp), 0, [self.width - 1, self.height - 1]).T
        opacity = self._alpha[y, x] / (1 + portable.exp(-usual_logit))
        opacity = np.clip(opacity, 0.02, 0.98).astype(np.float64)
        return portable.log(opacity / (1 - opacity))

    def rendered(self, splats: Splats) -> Reals:
        """Return the render of the Gaussians, an array of the shape of `planar`."""
        real, size = self.planar.dtype.type, (self.height, self.width)
        return joined([cpu.render_planar(one, *size, real) for _, one in self._over_each(splats)])

    def error_of(self, rendered: Reals, planar: Reals | None = None) -> float:
        """Return the mean squared error of a render against `planar`, by default all of it."""
        squares = np.square(rendered - (self.planar if planar is None else planar))
        if self.focus is not None:
            squares *= self.focus
        return float(np.mean(squares, dtype=np.float64))

    def evaluate(self, splats: Splats, loss: LossName | LossFunction) -> LossAndGradient:
        """Return the loss of the Gaussians and its gradient.

        loss: one of the values of FitOptions.loss.
        """
        parts: list[LossAndGradient] = []
        weight = self.weight if loss == DEFAULT_LOSS else self.focus
        for planar, on_backdrop in self._over_each(splats):
            image, squares, moments, rows = cpu.squared_error(on_backdrop, planar, weight)
            if self.focus is not None:
                squares = self.error_of(image, planar) * planar.size
            value = 0.5 * squares
            if loss not in SQUARED_LOSSES:
                mean, gradient = image_gradient(loss, image, planar, self.focus)
                value, moments = mean * planar.size, cpu.moments_of_gradient(on_backdrop, gradient)
            # squared_error counts pair rows. A pair row has 16 px, so it is 16 pixel-Gaussian
            # pairs.
            error = squares / planar.size / len(self._views)
            parts.append(LossAndGradient(value, error, moments, rows * 16, (image,)))
        return LossAndGradient(*(reduce(add, values) for values in zip(*parts, strict=True)))

    def weighted_squares(self, rendered: Reals) -> float:
        """Return the sum of the squared errors of a render, weighted by `weight`.

        rendered: render of the shape of `planar`.
        """
        squares = np.square(rendered - self.planar) * self.weight
        return float(np.sum(squares, dtype=np.float64))

    def removal_cost(self, splats: Splats) -> tuple[Reals, Floats]:
        """Return the render, and an array (n, 2).

        The render has the shape of `planar`. The array has the removal cost and the mass of each
        Gaussian, which gauss2svg.render.cpu.removal_cost defines.
        """
        over = self._over_each(splats)
        parts = [cpu.removal_cost(one, planar, self.weight) for planar, one in over]
        return joined([image for image, _ in parts]), reduce(add, (cost for _, cost in parts))


def joined(images: Sequence[Reals]) -> Reals:
    """Return renders (3, h, w), one for each backdrop, as an array of the shape of `planar`."""
    return images[0] if len(images) == 1 else np.concatenate(images)


def _filled(color: Reals, visible: NDArray[np.bool_]) -> Reals:
    """Return `color` (3, h, w) with the colours of invisible pixels replaced.

    Each invisible pixel gets the colour of the nearest visible pixel, if there is one.
    """
    if visible.all() or not visible.any():
        return color
    # This import is slow and seldom needed.
    from scipy.ndimage import distance_transform_edt

    nearest = distance_transform_edt(~visible, return_distances=False, return_indices=True)
    y, x = np.asarray(nearest)
    return np.ascontiguousarray(color[:, y, x])


CONTRAST = 0.03  # c: standard deviation of luma (0..1) above which texture masks errors
MOST_VARIANCE = 0.03  # m (docs/decisions/perceptual.md)


def pixel_weight(views: list[Reals], tune: str) -> Reals:
    """Return the weight (h, w) > 0 of the squared error at each pixel of a picture.

    views: the picture (3, h, w) over each of its backdrops, or only the picture if it is opaque.
    """
    lumas = [view.mean(axis=0) for view in views]
    if tune == PSNR:
        energy = np.mean([_slope_energy(luma) for luma in lumas], axis=0)
        # A change of 0.02 per px, which is 5 levels of 255, is flat (docs/decisions/metrics.md).
        weight = 1 + 8 * portable.exp(-smoothed(energy, 4.0) / 0.02**2)
    else:
        variance = np.mean([_local_variance(luma) for luma in lumas], axis=0)
        # In texture, the weight falls as the variance to the power -g, with g = 0.5.
        weight = portable.power(1 + np.minimum(variance, MOST_VARIANCE) / CONTRAST**2, -0.5)
        weight /= weight.mean()
    return weight.astype(views[0].dtype)


def _slope_energy(luma: Reals) -> Reals:
    """Smooth `luma` (h, w), and return the square of its gradient (h, w)."""
    luma = smoothed(luma, 1.0)
    axes = [axis for axis in (1, 0) if luma.shape[axis] > 1]
    return sum((np.square(np.gradient(luma, axis=axis)) for axis in axes), np.zeros_like(luma))


def _local_variance(luma: Reals) -> Reals:
    mean = smoothed(luma, 2.0)
    return np.maximum(smoothed(luma * luma, 2.0) - mean * mean, 0)


SQUARED_LOSSES = (DEFAULT_LOSS, "mse")  # a kernel computes these and their gradients
# The weight of SSIM in "3D Gaussian Splatting for Real-Time Radiance Field Rendering" (Kerbl et
# al., 2023)
SSIM_WEIGHT = 0.2


def image_gradient(
    loss: LossName | LossFunction, rendered: Reals, target: Reals, focus: Reals | None = None
) -> tuple[float, Reals]:
    """Return the loss and its gradient (3, h, w) with respect to rendered (3, h, w).

    loss   a function, or mse or l1, which may be followed by +ssim
    focus  (h, w) weight of each pixel, of mean 1. If it is None, all weights are 1

    Let p be the mean of the pixel loss over all values of the image, weighted by `focus`. Without
    +ssim, the loss is p. With +ssim, it is (1 - w) p + w (1 - SSIM), where w is SSIM_WEIGHT. The
    gradient of the loss is multiplied by the number of values of the image, so that its scale does
    not depend on the size of the image.
    """
    if not isinstance(loss, str):
        return _by_function(loss, rendered, target)
    difference = rendered - target
    if loss.startswith("l1"):
        losses, gradient = np.abs(difference), np.sign(difference)
    else:
        losses, gradient = difference**2, 2 * difference
    if focus is not None:
        losses, gradient = losses * focus, gradient * focus
    value = np.mean(losses, dtype=np.float64)
    if has_ssim(loss):
        value *= 1 - SSIM_WEIGHT
        gradient *= 1 - SSIM_WEIGHT
        for channel, planes in enumerate(zip(rendered, target, strict=True)):
            similarity, slope = structural_similarity(*planes, focus)
            value += SSIM_WEIGHT * (1 - similarity) / len(rendered)
            gradient[channel] -= SSIM_WEIGHT * slope
    return float(value), gradient


def _by_function(loss: LossFunction, rendered: Reals, target: Reals) -> tuple[float, Reals]:
    """Return the loss of a function and its gradient, as image_gradient does.

    Raise InputError if the loss is below 0, because the guard against divergence compares ratios,
    if the gradient has not the shape of the render, or if a number is not finite.
    """
    pictures = [np.ascontiguousarray(np.moveaxis(one, 0, -1)) for one in (rendered, target)]
    advice = "torch_loss(function) for a loss of tensors"
    try:
        returned = loss(*pictures)
    except (AttributeError, TypeError) as error:
        error.add_note(f"The loss got arrays of NumPy. Try {advice}")
        raise
    try:
        value, slope = returned
        value, slope = float(value), np.asarray(slope, rendered.dtype)
    except (TypeError, ValueError, RuntimeError):
        value, slope = math.nan, np.empty(0, rendered.dtype)
    is_usable = 0 <= value < np.inf and np.isfinite(slope).all()
    if not is_usable or slope.shape != pictures[0].shape:
        needed = f"a function that returns a loss >= 0 and its finite gradient {pictures[0].shape}"
        got = f"{type(returned).__name__}, loss {value:g}, gradient {slope.shape}"
        raise refusal("loss", needed, got, advice)
    return value, np.ascontiguousarray(np.moveaxis(slope, -1, 0)) * rendered.dtype.type(slope.size)


def structural_similarity(
    image: Reals, target: Reals, focus: Reals | None = None
) -> tuple[float, Reals]:
    """Return the mean SSIM of two planes (h, w), and its gradient (h, w) multiplied by h w.

    The gradient is the derivative of the mean SSIM with respect to each pixel of `image`. In the
    mean, the weight of a window is that of its centre in focus (h, w). If focus is None, all
    weights are 1.

    Let x be the image, t the target, and a, b, p, s, q the blurred planes x, t, x^2, t^2 and x t.
    Then the SSIM of a window is

        SSIM = A1 A2 / (B1 B2),  A1 = 2 a b + C1,        A2 = 2 (q - a b) + C2,
                                 B1 = a^2 + b^2 + C1,    B2 = p - a^2 + s - b^2 + C2.

    Blurring is its own transpose, so the gradient is blur(d/da) + 2 x blur(d/dp) + t blur(d/dq),
    where d/da is the derivative of the SSIM with respect to a.

    A window is a Gaussian of sigma 1.5 over 11 x 11 pixels (Wang et al., 2004), and only windows
    inside the image count. In an image smaller than this, windows have the largest odd size that
    fits.
    """
    height, width = image.shape
    c1, c2 = 0.01**2, 0.03**2
    radius = min(5, (height - 1) // 2, (width - 1) // 2)
    windows = slice(radius, height - radius), slice(radius, width - radius)
    # The weights are divided by their mean, so that the mean SSIM of equal images is 1 and their
    # loss is 0. With a larger loss, the ratio of two losses would not show whether a fit has
    # diverged.
    weight = 1 if focus is None else focus[windows] / focus[windows].mean()

    def blurred(plane: Reals) -> Reals:
        return smoothed(plane, 1.5, radius / 1.5)

    def gathered(slope: Reals) -> Reals:
        padded = np.zeros_like(image)
        padded[windows] = slope * weight
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
    mean = float((similarity * weight).mean(dtype=np.float64))
    return mean, gradient * (image.size / similarity.size)
