"""Where new Gaussians go, how large they are and how they lie."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from gauss2svg.fit.blending import Blending
from gauss2svg.fit.target import Target

# ln beta; starting at 1, 1.5, 2.5 or 3, everywhere or only for components, ends within the
# scatter of +-0.3 dB on drawings and 0.03 dB on photos.
FIRST_RAW_BETA = 0.1
_LEAST_SIGMA = 0.8
_LEAST_MINOR = 0.6
_ELONGATION = 0.5  # along an edge sigma is e^0.5 longer, across it as much shorter
# selective: differences under this share of the largest are left out, the rest is
# cut into this many bins of equal width (LIVE uses a similar quantisation).
_REJECTED_SHARE = 0.2
_BINS = 8
# A component's axes are lengthened no more than this ratio; round starts lose 0.1 to 0.3 dB
# on drawings of 32 to 512 shapes and 0.03 dB on photos of 1000.
_MOST_FIRST_ASPECT = 6.0
# More paint cannot mend what covers too much: from so much alpha on the difference counts by that
# share. 300 / 1000 Gaussians on a ramp of alpha 30.30 / 34.52 dB without, 30.98 / 34.90 with it, by
# a share of 0 30.71 / 34.92; a soft ellipse 29.73 / 35.91, 29.71 / 35.85, 29.71 / 35.86.
_TOO_COVERED, _MENDS_LESS = 0.03, 0.3
_PIXEL_VARIANCE = 1 / 12  # px^2, of a pixel's own extent
# live: sigma = sqrt(A / (r s^2)) of the grid's units for a component of A px and a kernel of
# s samples; the grid reaches from -5 to 5, so that a unit is s / 10 px and s cancels:
# sigma = sqrt(A / 7) px, 1.3 times that of a disc of area A.
_LIVE_R, _GRID_UNITS = 0.07, 10


@dataclass(frozen=True)
class New:
    """n Gaussians to add: mean (n, 2), Cholesky factor (n, 3), color (n, 3); float64.

    color is the target's there, or what the target has more than the picture so far.
    """

    mean: NDArray[np.float64]
    factor: NDArray[np.float64]
    color: NDArray[np.float64]

    def with_more(self, others: Callable[[int], New], count: int) -> New:
        """These and as many others as are missing to `count`."""
        if len(self.mean) == count:
            return self
        more = others(count - len(self.mean))
        return New(
            np.concatenate([self.mean, more.mean]),
            np.concatenate([self.factor, more.factor]),
            np.concatenate([self.color, more.color]),
        )


def place(
    placement: str,
    target: Target,
    rendered: NDArray[np.floating],
    count: int,
    total: int,
    rng: np.random.Generator,
    blending: Blending,
) -> New:
    """New Gaussians, `count` of them, for a scene that has `total` with them.

    placement is that of DensifyOptions.init.

    rendered is the scene so far, like target.planar. Where the target has alpha and nothing of
    it shows, none go: more paint can only make that worse.
    """
    placing = _Placing(target, rendered, target.spacing(total), rng, blending)
    if placement == "error":
        return placing.by_error(count)
    if placement == "selective":
        return placing.by_component(count)
    if placement == "live":
        return placing.as_in_live(count)
    return placing.at_random(count)


class _Placing:
    """What new Gaussians are placed by; spacing in px is the radius of each one's share."""

    def __init__(
        self,
        target: Target,
        rendered: NDArray[np.floating],
        spacing: float,
        rng: np.random.Generator,
        blending: Blending,
    ) -> None:
        self._target = target
        self._missed = target.planar - rendered
        if target.visible is not None:
            self._missed *= target.visible
            over_white, over_black = self._missed[:3], self._missed[3:]
            covered = (over_white - over_black).mean(axis=0)  # more than in the target
            self._missed *= np.where(covered > _TOO_COVERED, _MENDS_LESS, 1.0)
        self._paint = self._missed if blending.by_residual else target.paint
        self._spacing = spacing
        self._rng = rng
        self._sigma_share = blending.sigma_share

    def by_error(self, count: int) -> New:
        """Drawn in proportion to the squared error, one from each of `count` equal parts of it."""
        error = np.square(self._missed).sum(axis=0)
        smooth = gaussian_filter(error, min(max(0.5 * self._spacing, 0.5), 4.0))
        if self._target.visible is not None:
            smooth *= self._target.visible
        chance = np.cumsum(smooth.ravel(), dtype=np.float64)
        drawn = (np.arange(count) + self._rng.random(count)) / count * chance[-1]
        pixel = np.minimum(np.searchsorted(chance, drawn), chance.size - 1)
        if not chance[-1] > 0:  # already exact everywhere
            pixel = self._rng.integers(chance.size, size=count)
        y, x = np.divmod(pixel, self._target.width)
        sigma = max(self._spacing * self._sigma_share, _LEAST_SIGMA)
        along, coherence = self._target.edges
        stretch = np.exp(_ELONGATION * coherence[y, x])
        factor = _oriented(sigma * stretch, sigma / stretch, along[y, x])
        return New(np.stack([x + 0.5, y + 0.5], axis=1), factor, self._paint_at(x, y))

    def by_component(self, count: int) -> New:
        """The largest connected components of the quantised difference, the rest by error.

        As in LIVE, but each proposes its mean colour and the direction and aspect of its second
        moments too. A disc of area A and a Gaussian agree in variance at sigma =
        sqrt(A / pi) / 2.
        """
        parts = self._components(count)
        if parts is None:
            return self.by_error(count)
        sigma = np.maximum(0.5 * np.sqrt(parts.area / np.pi), _LEAST_SIGMA)
        xx, xy, yy = parts.moments()
        spread = np.hypot(xx - yy, 2 * xy)
        aspect = np.sqrt((xx + yy + spread) / np.maximum(xx + yy - spread, 2 * _PIXEL_VARIANCE))
        stretch = np.sqrt(np.minimum(aspect, _MOST_FIRST_ASPECT))
        angle_rad = 0.5 * np.arctan2(2 * xy, xx - yy)
        minor = np.maximum(sigma / stretch, _LEAST_MINOR)
        found = New(
            mean=parts.center() + 0.5,
            factor=_oriented(sigma * stretch, minor, angle_rad),
            color=np.stack([parts.means(c[parts.y, parts.x]) for c in self._paint], axis=1),
        )
        return found.with_more(self.by_error, count)

    def as_in_live(self, count: int) -> New:
        """The same to the paper's letter: sigma = sqrt(A / (r s^2)), rho = 0, the rest random.

        Colours are what is missing, or the target's, at the centre of mass.
        """
        parts = self._components(count)
        if parts is None:
            return self.at_random(count)
        sigma = np.maximum(np.sqrt(parts.area / (_LIVE_R * _GRID_UNITS**2)), _LEAST_SIGMA)
        center = parts.center()
        x, y = np.round(center).astype(np.intp).T
        factor = np.stack([sigma, 0 * sigma, sigma], axis=1)
        return New(center + 0.5, factor, self._paint_at(x, y)).with_more(self.at_random, count)

    def at_random(self, count: int) -> New:
        """Means wherever the target shows, sigma in (0, 1) spacings, rho in (-1, 1)."""
        target, rng = self._target, self._rng
        mean = rng.random((count, 2)) * [target.width, target.height]
        if target.visible is not None:
            y, x = np.divmod(rng.choice(np.flatnonzero(target.visible), count), target.width)
            mean = rng.random((count, 2)) + np.stack([x, y], axis=1)
        sigma = np.maximum(rng.random((count, 2)) * self._spacing, _LEAST_SIGMA)
        rho = rng.uniform(-1, 1, count) * 0.95  # nearer to 1 it would start as a needle
        x, y = np.minimum(mean.astype(np.intp), [target.width - 1, target.height - 1]).T
        rest = np.sqrt(1 - rho**2)
        factor = np.stack([sigma[:, 0], rho * sigma[:, 1], rest * sigma[:, 1]], axis=1)
        return New(mean, factor, self._paint_at(x, y))

    def _paint_at(self, x: NDArray[np.intp], y: NDArray[np.intp]) -> NDArray[np.float64]:
        return self._paint[:, y, x].T.astype(np.float64)

    def _components(self, count: int) -> _Components | None:
        """The largest `count` components, or as many as there are; None without any error.

        The difference is summed over channels, small ones are rejected, the others cut into bins
        spread evenly between 0 and the largest.
        """
        from skimage.measure import label

        difference = np.abs(self._missed).sum(axis=0)
        largest = float(difference.max())
        if largest <= 0:
            return None
        bins = np.ceil(difference / largest * _BINS).astype(np.int32)
        bins[difference < _REJECTED_SHARE * largest] = 0
        components = np.asarray(label(bins, background=0, connectivity=2)).ravel()
        area = np.bincount(components)
        area[0] = 0  # what was rejected
        order = np.argsort(-area, kind="stable")[: min(count, len(area) - 1)]
        rank = np.full(components.max() + 1, -1)
        rank[order] = np.arange(len(order))
        rank = rank[components]
        pixel = np.flatnonzero(rank >= 0)
        y, x = np.divmod(pixel, self._target.width)
        return _Components(area[order], rank[pixel], x, y)


@dataclass(frozen=True)
class _Components:
    """k connected components: area (k,) in px; pixels x, y and of which component, rank (p,)."""

    area: NDArray[np.intp]
    rank: NDArray[np.intp]
    x: NDArray[np.intp]
    y: NDArray[np.intp]

    def means(self, values: NDArray[np.number]) -> NDArray[np.float64]:
        """(k,) mean of values (p,) over each component."""
        return np.bincount(self.rank, values, len(self.area)) / self.area

    def center(self) -> NDArray[np.float64]:
        """(k, 2) centre of mass, in whole pixels from 0."""
        return np.stack([self.means(self.x), self.means(self.y)], axis=1)

    def moments(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Central second moments xx, xy, yy (k,) in px^2, of the pixels with their extent."""
        x, y = self.x, self.y
        mx, my = self.center().T
        xx = self.means(x * x) - mx * mx + _PIXEL_VARIANCE
        yy = self.means(y * y) - my * my + _PIXEL_VARIANCE
        return xx, self.means(x * y) - mx * my, yy


def _oriented(
    major: NDArray[np.floating], minor: NDArray[np.floating], angle_rad: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Cholesky factors (n, 3) of ellipses with the given semi-axes and direction."""
    co, si = np.cos(angle_rad, dtype=np.float64), np.sin(angle_rad, dtype=np.float64)
    l11 = np.hypot(co * major, si * minor)
    l21 = co * si * (np.square(major) - np.square(minor)) / l11
    return np.stack([l11, l21, major * minor / l11], axis=1).astype(np.float64)
