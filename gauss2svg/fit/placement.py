"""Where new Gaussians go, how large they are and how they lie."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from gauss2svg.errors import InputError

PLACEMENTS = ("selective", "error", "random")
DEFAULT_PLACEMENT = "selective"

FIRST_OPACITY_LOGIT = 1.0
# ln beta; starting at 1, 1.5, 2.5 or 3, everywhere or only for components, ends within the
# scatter of +-0.3 dB on drawings and 0.03 dB on photos.
FIRST_RAW_BETA = 0.1
# First sigma as a share of the mean spacing sqrt(area / (pi n)): 0.3 to 0.42 end
# within 0.08 dB, 0.6 loses 0.7 dB.
_SIGMA_SHARE = 0.3
_LEAST_SIGMA = 0.8
_LEAST_MINOR = 0.6
_ELONGATION = 0.5  # along an edge sigma is e^0.5 longer, across it as much shorter
# Flat: gradients under 0.02 a px (5 levels of 255) within some 4 px.
_FLAT_ENERGY = 0.02**2
_FLAT_REACH = 4.0
# selective: differences under this share of the largest are left out, the rest is
# cut into this many bins of equal width (LIVE uses a similar quantisation).
_REJECTED_SHARE = 0.2
_BINS = 8
# A component's axes are lengthened no more than this ratio; round starts lose 0.1 to 0.3 dB
# on drawings of 32 to 512 shapes and 0.03 dB on photos of 1000.
_MOST_FIRST_ASPECT = 6.0
_PIXEL_VARIANCE = 1 / 12  # px^2, of a pixel's own extent


@dataclass(frozen=True)
class New:
    """n Gaussians to add: mean (n, 2), Cholesky factor (n, 3), color (n, 3); float64."""

    mean: NDArray[np.float64]
    factor: NDArray[np.float64]
    color: NDArray[np.float64]


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


def place(
    placement: str,
    target: Target,
    rendered: NDArray[np.floating],
    count: int,
    total: int,
    rng: np.random.Generator,
) -> New:
    """New Gaussians, `count` of them, for a scene that has `total` with them.

    rendered is the scene so far, (3, h, w). Raises InputError for an unknown placement.
    """
    if placement == "error":
        return _by_error(target, rendered, count, target.spacing(total), rng)
    if placement == "selective":
        return _by_component(target, rendered, count, target.spacing(total), rng)
    if placement == "random":
        return _at_random(target, count, target.spacing(total), rng)
    raise InputError(f"init is {placement!r}; needed is one of {', '.join(PLACEMENTS)}")


def _by_error(
    target: Target,
    rendered: NDArray[np.floating],
    count: int,
    spacing: float,
    rng: np.random.Generator,
) -> New:
    """Drawn in proportion to the squared error, one from each of `count` equal parts of it."""
    error = np.square(rendered - target.planar).sum(axis=0)
    smooth = gaussian_filter(error, min(max(0.5 * spacing, 0.5), 4.0))
    chance = np.cumsum(smooth.ravel(), dtype=np.float64)
    drawn = (np.arange(count) + rng.random(count)) / count * chance[-1]
    pixel = np.minimum(np.searchsorted(chance, drawn), chance.size - 1)
    if not chance[-1] > 0:  # already exact everywhere
        pixel = rng.integers(chance.size, size=count)
    y, x = np.divmod(pixel, target.width)
    sigma = max(spacing * _SIGMA_SHARE, _LEAST_SIGMA)
    along, coherence = target.edges
    stretch = np.exp(_ELONGATION * coherence[y, x])
    color = target.planar[:, y, x].T.astype(np.float64)
    factor = _oriented(sigma * stretch, sigma / stretch, along[y, x])
    return New(np.stack([x + 0.5, y + 0.5], axis=1), factor, color)


def _oriented(
    major: NDArray[np.floating], minor: NDArray[np.floating], angle_rad: NDArray[np.floating]
) -> NDArray[np.float64]:
    """Cholesky factors (n, 3) of ellipses with the given semi-axes and direction."""
    co, si = np.cos(angle_rad, dtype=np.float64), np.sin(angle_rad, dtype=np.float64)
    l11 = np.hypot(co * major, si * minor)
    l21 = co * si * (np.square(major) - np.square(minor)) / l11
    return np.stack([l11, l21, major * minor / l11], axis=1).astype(np.float64)


def _by_component(
    target: Target,
    rendered: NDArray[np.floating],
    count: int,
    spacing: float,
    rng: np.random.Generator,
) -> New:
    """The largest connected components of the quantised difference, the rest by error.

    As in LIVE: the difference summed over channels, small ones rejected, the others cut
    into bins; each component of one bin proposes its centre of mass, its area A and the
    direction and aspect of its second moments. A disc of area A and a Gaussian agree in
    variance at sigma = sqrt(A / pi) / 2.
    """
    from skimage.measure import label

    difference = np.abs(rendered - target.planar).sum(axis=0)
    largest = float(difference.max())
    if largest <= 0:
        return _by_error(target, rendered, count, spacing, rng)
    bins = np.ceil(difference / largest * _BINS).astype(np.int32)
    bins[difference < _REJECTED_SHARE * largest] = 0
    components = np.asarray(label(bins, background=0, connectivity=2)).ravel()
    area = np.bincount(components)
    area[0] = 0  # what was rejected
    order = np.argsort(-area, kind="stable")[: min(count, len(area) - 1)]
    area = area[order]
    rank = np.full(components.max() + 1, -1)
    rank[order] = np.arange(len(order))
    rank = rank[components]
    pixel = np.flatnonzero(rank >= 0)
    rank = rank[pixel]
    y, x = np.divmod(pixel, target.width)

    def means(values: NDArray[np.number]) -> NDArray[np.float64]:
        return np.bincount(rank, values, len(order)) / area

    sigma = np.maximum(0.5 * np.sqrt(area / np.pi), _LEAST_SIGMA)
    mx, my = means(x), means(y)
    xx = means(x * x) - mx * mx + _PIXEL_VARIANCE
    xy = means(x * y) - mx * my
    yy = means(y * y) - my * my + _PIXEL_VARIANCE
    spread = np.hypot(xx - yy, 2 * xy)
    aspect = np.sqrt((xx + yy + spread) / np.maximum(xx + yy - spread, 2 * _PIXEL_VARIANCE))
    stretch = np.sqrt(np.minimum(aspect, _MOST_FIRST_ASPECT))
    angle_rad = 0.5 * np.arctan2(2 * xy, xx - yy)
    found = New(
        mean=np.stack([mx, my], axis=1) + 0.5,
        factor=_oriented(sigma * stretch, np.maximum(sigma / stretch, _LEAST_MINOR), angle_rad),
        color=np.stack([means(channel[y, x]) for channel in target.planar], axis=1),
    )
    if len(order) == count:
        return found
    rest = _by_error(target, rendered, count - len(order), spacing, rng)
    return New(
        np.concatenate([found.mean, rest.mean]),
        np.concatenate([found.factor, rest.factor]),
        np.concatenate([found.color, rest.color]),
    )


def _at_random(target: Target, count: int, spacing: float, rng: np.random.Generator) -> New:
    """Means over the whole canvas, sigma in (0, 1) spacings, rho in (-1, 1), target's colour."""
    mean = rng.random((count, 2)) * [target.width, target.height]
    sigma = np.maximum(rng.random((count, 2)) * spacing, _LEAST_SIGMA)
    rho = rng.uniform(-1, 1, count) * 0.95  # nearer to 1 it would start as a needle
    x, y = np.minimum(mean.astype(np.intp), [target.width - 1, target.height - 1]).T
    factor = np.stack([sigma[:, 0], rho * sigma[:, 1], np.sqrt(1 - rho**2) * sigma[:, 1]], axis=1)
    return New(mean, factor, target.planar[:, y, x].T.astype(np.float64))
