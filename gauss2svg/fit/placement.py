"""Placement of new Gaussians: position, size, direction, colour (docs/decisions/placement.md).

Connected components are found by a kernel. scikit-image has one too, but importing it would take a
third of a second (docs/decisions/start.md).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.core import Floats, Kernel, Reals
from gauss2svg.fit.target import Target
from gauss2svg.without_scipy import smoothed

# The values of the constants were chosen by measurements (docs/decisions/placement.md).
FIRST_RAW_BETA = 0.1  # ln beta of a new Gaussian with a learned falloff. The value hardly matters
# Least sigma in px of a new Gaussian, before it is stretched in one direction.
LEAST_NEW_SIGMA = 0.8


class NewGaussians(NamedTuple):
    """n Gaussians to add: mean (n, 2), Cholesky factor (n, 3), color (n, 3); float64.

    The colours are taken from the target, or, with additive blending, from the residual.
    """

    mean: Floats
    factor: Floats
    color: Floats


def place(
    placement: str,
    target: Target,
    rendered: Reals,
    count: int,
    total: int,
    rng: np.random.Generator,
    additive: bool = False,
) -> NewGaussians:
    """Return `count` new Gaussians, which are to be added to a scene.

    placement  one of the values of FitOptions.init
    rendered   render of the scene so far, an array of the shape of target.planar
    total      number of Gaussians of the scene, including the new ones
    additive   whether new Gaussians get their colours from the residual instead of the target

    A target with alpha may have invisible pixels. Their residual counts as 0, and the placement
    "random" puts no Gaussians on them.
    """
    spacing = float(np.sqrt(target.width * target.height / (max(total, 1) * np.pi)))
    placer = _Placer(target, rendered, spacing, rng, additive)
    first = {"selective": placer.by_component, "live": placer.as_in_live}.get(placement)
    others = placer.by_error if placement in ("selective", "error") else placer.at_random
    parts = [first(count)] if first else []
    # There may be fewer components than new Gaussians.
    if missing := count - sum(len(part.mean) for part in parts):
        parts.append(others(missing))
    return NewGaussians(*map(np.concatenate, zip(*parts, strict=True)))


class _Placer:
    """The ways to place new Gaussians. Most of them read the residual, the target minus the render.

    The residual is multiplied by the square root of target.visible_weight, so that the squared
    residual is multiplied by this weight. `spacing` is the radius in px of a disc whose area is the
    area of the picture divided by the number of Gaussians.
    """

    def __init__(
        self,
        target: Target,
        rendered: Reals,
        spacing: float,
        rng: np.random.Generator,
        additive: bool,
    ) -> None:
        self._target = target
        self._residual = target.planar - rendered
        if target.visible is not None:
            self._residual *= target.visible
            over_white, over_black = self._residual[:3], self._residual[3:]
            # The residual over white minus the residual over black is the alpha of the render minus
            # the alpha of the target.
            surplus = (over_white - over_black).mean(axis=0)
            # More Gaussians cannot repair a pixel that is covered too much.
            self._residual *= np.where(surplus > 0.03, 0.3, 1.0)
        self._color = self._residual if additive else target.source_color
        if (weight := target.visible_weight) is not None:
            self._residual = self._residual * np.sqrt(weight)
        self._spacing = spacing
        self._rng = rng

    def by_error(self, count: int) -> NewGaussians:
        """Return Gaussians at random pixels.

        The probability of a pixel is proportional to the smoothed squared residual.
        """
        error = np.square(self._residual).sum(axis=0)
        smooth = smoothed(error, min(max(0.5 * self._spacing, 0.5), 4.0))
        if self._target.visible is not None:
            smooth *= self._target.visible
        total = np.cumsum(smooth.ravel(), dtype=np.float64)
        sampled = (np.arange(count) + self._rng.random(count)) / count * total[-1]
        pixel = np.minimum(np.searchsorted(total, sampled), total.size - 1)
        if not total[-1] > 0:  # the render equals the target, so any pixel is as good as another
            pixel = self._rng.integers(total.size, size=count)
        y, x = np.divmod(pixel, self._target.width)
        sigma = np.full(count, max(self._spacing * 0.3, LEAST_NEW_SIGMA))
        factor = np.stack([sigma, 0 * sigma, sigma], axis=1)
        return NewGaussians(np.stack([x + 0.5, y + 0.5], axis=1), factor, self._color_at(x, y))

    def by_component(self, count: int) -> NewGaussians:
        """Return up to `count` Gaussians, one on each of the components with most squared residual.

        Above areas that have Gaussians below them, the largest components are taken instead, as in
        LIVE, because large errors are thin there: they lie along outlines, which
        `gauss2svg.areas.refine` moves.

        Each Gaussian gets the mean colour of its component. At first the Gaussian is round, and as
        wide as a disc with the area A of the component: its sigma is sqrt(A / pi) / 2, which is the
        standard deviation of the points of this disc along any axis. Then the Gaussian is
        stretched. Its direction and the ratio of its axes follow from the second moments of the
        component.
        """
        ground = self._target.ground
        has_gaussians = ground is not None and len(ground) > 0
        squares = None if has_gaussians else np.square(self._residual).sum(axis=0)
        area, center, (xx, xy, yy), color = self._components(
            count, 8 if squares is None else 4, squares
        )
        sigma = np.maximum(0.5 * np.sqrt(area / np.pi), LEAST_NEW_SIGMA)
        spread = portable.hypot(xx - yy, 2 * xy)
        aspect = np.sqrt((xx + yy + spread) / np.maximum(xx + yy - spread, 1 / 6))
        stretch = np.sqrt(np.minimum(aspect, 6.0))
        angle_rad = 0.5 * portable.arctan2(2 * xy, xx - yy)
        major, minor = sigma * stretch, np.maximum(sigma / stretch, 0.6)
        co, si = portable.cos(angle_rad), portable.sin(angle_rad)
        l11 = portable.hypot(co * major, si * minor)
        l21 = co * si * (np.square(major) - np.square(minor)) / l11
        return NewGaussians(center + 0.5, np.stack([l11, l21, major * minor / l11], axis=1), color)

    def as_in_live(self, count: int) -> NewGaussians:
        """Return up to `count` Gaussians, one on each of the largest components, as in the paper.

        On a component of area A px^2, a Gaussian has sigma = sqrt(A / 7) px, rho = 0, and the
        colour at the centre of mass.
        """
        area, center, _, _ = self._components(count)
        # In the paper, sigma is sqrt(A / (r s^2)) with r = 0.07, in units of s / 10 px. Times
        # s / 10, this is sqrt(A / (r 10^2)) px, so s cancels.
        sigma = np.maximum(np.sqrt(area / (0.07 * 10**2)), LEAST_NEW_SIGMA)
        x, y = np.round(center).astype(np.intp).T
        factor = np.stack([sigma, 0 * sigma, sigma], axis=1)
        return NewGaussians(center + 0.5, factor, self._color_at(x, y))

    def at_random(self, count: int) -> NewGaussians:
        """Return Gaussians on random visible pixels.

        Their sigmas are random from LEAST_NEW_SIGMA to `spacing`, and |rho| < 0.95.
        """
        target, rng = self._target, self._rng
        mean = rng.random((count, 2)) * [target.width, target.height]
        if target.visible is not None:
            y, x = np.divmod(rng.choice(np.flatnonzero(target.visible), count), target.width)
            mean = rng.random((count, 2)) + np.stack([x, y], axis=1)
        sigma = np.maximum(rng.random((count, 2)) * self._spacing, LEAST_NEW_SIGMA)
        # If |rho| were nearer to 1, some Gaussians would start as needles.
        rho = rng.uniform(-1, 1, count) * 0.95
        x, y = np.minimum(mean.astype(np.intp), [target.width - 1, target.height - 1]).T
        rest = np.sqrt(1 - rho**2)
        factor = np.stack([sigma[:, 0], rho * sigma[:, 1], rest * sigma[:, 1]], axis=1)
        return NewGaussians(mean, factor, self._color_at(x, y))

    def _color_at(self, x: NDArray[np.intp], y: NDArray[np.intp]) -> Floats:
        return self._color[:, y, x].T.astype(np.float64)

    def _components(
        self, count: int, bins: int = 8, weight: Reals | None = None
    ) -> tuple[Any, ...]:
        """Return the k <= `count` heaviest components, the heaviest first, as four arrays.

        bins    number of bins into which residuals are quantised
        weight  (h, w) weight of each pixel. If it is None, each pixel weighs 1

        The arrays are the areas (k,) in px^2, the mean columns and rows (k, 2) of their pixels,
        the central second moments xx, xy and yy (3, k) in px^2, and the mean colours (k, 3). Pixels
        count as squares and not as points, so no component is infinitely thin.

        The absolute residual of each pixel is summed over the channels. Pixels with sums below a
        fifth of the largest belong to no component. The sums of the other pixels are sorted into
        bins of equal width between 0 and the largest sum. A component is a connected set of pixels
        of the same bin.
        """
        difference = np.abs(self._residual).sum(axis=0)
        largest = float(difference.max()) or 1.0
        levels = np.ceil(difference / largest * bins).astype(np.int32)
        levels[difference < 0.2 * largest] = 0
        components = components_of(levels).ravel()
        area = np.bincount(components)
        weights = area if weight is None else np.bincount(components, weight.ravel())
        weights[0] = -1  # rejected pixels have the number 0 and are no component
        order = np.argsort(-weights, kind="stable")[: min(count, len(area) - 1)]
        rank = np.full(components.max() + 1, -1)
        rank[order] = np.arange(len(order))
        rank = rank[components]
        pixel = np.flatnonzero(rank >= 0)
        rank, area = rank[pixel], area[order]
        y, x = np.divmod(pixel, self._target.width)

        def means(values: NDArray[np.number]) -> Floats:
            return np.bincount(rank, values, len(area)) / area

        mx, my = means(x), means(y)
        # 1 / 12 is the variance of x within a pixel.
        xx, yy = means(x * x) - mx * mx + 1 / 12, means(y * y) - my * my + 1 / 12
        color = np.stack([means(plane[y, x]) for plane in self._color], axis=1)
        return area, np.stack([mx, my], axis=1), (xx, means(x * y) - mx * my, yy), color


_number_components = Kernel("number_components", "int int int32 int64 int64")


def components_of(levels: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return an array (h, w) that gives, for each pixel of `levels`, the number of its component.

    levels: (h, w) whole numbers.

    All pixels of a component have the same level, and they touch along sides or at corners.
    Components are numbered from 1 in the order of their first pixels, row by row. Pixels of level 0
    have the number 0.
    """
    numbers, stack = (np.empty(levels.shape, np.int64) for _ in range(2))
    _number_components(*levels.shape, levels, stack, numbers)
    return numbers
