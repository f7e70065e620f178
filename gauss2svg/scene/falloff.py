"""The radial profile of a shape: the one place that renderers and exporter share.

    f(r) = (exp(-(r^2 / 2)^beta) - RIM) / (1 - RIM)   for r < cut_radius(beta), 0 beyond,

with r the Mahalanobis distance to the mean and beta the exponent of the generalised
Gaussian (exponential power) profile: 1 is the Gaussian, a large beta an ellipse with a
crisp rim at r = sqrt 2, beta < 1 a peak with long tails. Taking RIM off lets f end at 0
instead of at a visible step, and f(0) stays 1. The cut lies where the power is CUT:

    cut_radius(beta) = sqrt(2 CUT^(1 / beta)),

so that the support shrinks as beta grows: 3 sigma at 1, 1.65 at 5, sqrt 2 in the limit.
Under beta = 1/2 the derivative by the mean, which goes with r^(2 beta - 1), is infinite at
the mean itself: LEAST_BETA is the end of the domain.

A plain ellipse has no falloff: a renderer draws its edge by how much of each pixel it covers. With
R = covered_radius(beta) its radius and g = |W^T z| / |z| the growth of |z| for each px, that is

    clip(1/2 + (R - |z|) / g) + clip(1/2 + (R + |z|) / g) - 1,  clip to 0..1,

the pixel's distances in px from the near and from the far rim; at most min(1, 2 b, pi a b), a >= b
the semi-axes in px, for a needle covers no more of any pixel; and 0 outside of the ellipse whose
semi-axes are half a pixel longer, for beyond the ends of a needle the distances say too much.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Cut of a Gaussian in sigma, where 1 % of the peak is left: 3.5 would cover 36 % more pixels.
RADIUS = 3.0
CUT = RADIUS * RADIUS / 2
RIM = math.exp(-CUT)

LEAST_BETA, MOST_BETA = 0.5, 256.0
# The width in px over which a large beta's rim falls from 0.9 to 0.1, times beta, at sigma 1 px.
RIM_WIDTH = math.log(math.log(0.1) / math.log(0.9)) / math.sqrt(2)

# The exponents of a file: gradients are shared by colour and exponent, and more exponents gain
# nothing (docs/decisions/falloff.md).
BETA_CLASSES = (1.0, 1.7, 3.0, 6.0, 16.0, 64.0)


def cut_radius(beta: ArrayLike) -> NDArray[np.float64]:
    """Mahalanobis distance sqrt(2 CUT^(1 / beta)) from which on the profile is 0; any shape."""
    return np.sqrt(2 * CUT ** (1 / np.asarray(beta, np.float64)))


def profile(r: NDArray[np.floating], beta: ArrayLike = 1.0) -> NDArray[np.floating]:
    """Falloff f(r) at Mahalanobis distances r >= 0; r and beta broadcast, values in 0..1."""
    power = np.minimum(0.5 * np.square(r), 2 * CUT ** (1 / np.asarray(beta))) ** beta
    return np.maximum((np.exp(-power) - RIM) / (1 - RIM), 0.0) * (r < cut_radius(beta))


def coverage(
    z: NDArray[np.float64], whitening: NDArray[np.float64], radius: ArrayLike
) -> NDArray[np.float64]:
    """Share of each pixel that plain ellipses cover, in 0..1, for z (..., 2) = W (x - mean).

    whitening (..., 3) entries w11, w21, w22 of W in 1/px, radius (...) in sigmas; broadcast.
    """
    whitening, radius = np.asarray(whitening, np.float64), np.asarray(radius, np.float64)
    z1, z2 = np.moveaxis(z, -1, 0)
    w11, w21, w22 = np.moveaxis(whitening, -1, 0)
    r = np.hypot(z1, z2)
    slope = np.hypot(w11 * z1 + w21 * z2, w22 * z2)
    # px for each unit of r; at the mean itself all is covered that can be
    px = np.divide(r, slope, out=np.full_like(r, np.inf), where=slope > 0)
    near, far = ((radius + sign * r) * px + 0.5 for sign in (-1, 1))
    share = np.clip(near, 0, 1) + np.clip(far, 0, 1) - 1
    longer, most = longer_axes(whitening, radius)
    o11, o21, o22 = np.moveaxis(longer, -1, 0)
    u, v = z1 / w11, (z2 - w21 * z1 / w11) / w22
    inside = np.square(o11 * u) + np.square(o21 * u + o22 * v) < 1
    return np.where(inside, np.minimum(share, most), 0.0)


def longer_axes(
    whitening: NDArray[np.float64], radius: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ellipses half a px longer than those of a radius (...), and the most these cover of a pixel.

    whitening (..., 3) entries w11, w21, w22 in 1/px; returns the whitening (..., 3) of the ellipses
    whose semi-axes are half a px longer and whose radius is 1, and min(1, 2 b, pi a b).
    """
    w11, w21, w22 = np.moveaxis(whitening, -1, 0)
    l11, l21, l22 = radius / w11, -radius * w21 / (w11 * w22), radius / w22
    xx, xy, yy = l11 * l11, l11 * l21, l21 * l21 + l22 * l22
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    long = np.sqrt(middle + half)
    short = l11 * l22 / long
    # (a + 1/2)^2 = a^2 + a + 1/4 along either axis
    more, rest = 0.5 * (long + short) + 0.25, 0.5 * (long - short)
    turned = np.divide(rest, half, out=np.zeros_like(half), where=half > 0)
    xx += more + turned * 0.5 * (xx - yy)
    xy += turned * xy
    l11 = np.sqrt(xx)
    l21 = xy / l11
    l22 = (long + 0.5) * (short + 0.5) / l11  # by the determinant, which does not cancel
    most = np.minimum(1.0, short * np.minimum(2.0, np.pi * long))
    return np.stack([1 / l11, -l21 / (l11 * l22), 1 / l22], axis=-1), most


def covered_radius(beta: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) radii in sigmas of plain ellipses that cover what profiles of exponents (n,) sum up to.

    R^2 = 2 integral f(r) r dr; within 1e-5 by a table.
    """
    return np.interp(np.log(beta), *_covered_radii())


@lru_cache(maxsize=1)
def _covered_radii() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    logs = np.linspace(math.log(LEAST_BETA), math.log(MOST_BETA), 400)
    share = (np.arange(4000) + 0.5) / 4000
    radii = [
        cut * math.sqrt(2 * np.mean(profile(share * cut, beta) * share))
        for beta, cut in zip(np.exp(logs), cut_radius(np.exp(logs)), strict=True)
    ]
    return logs, np.array(radii)


def half_radius(beta: ArrayLike) -> NDArray[np.float64]:
    """Mahalanobis distance at which the profile is 1/2; any shape.

    1.165 at beta = 1; where (r^2 / 2)^beta = -ln((1 + RIM) / 2).
    """
    return np.sqrt(2 * (-math.log(0.5 * (1 + RIM))) ** (1 / np.asarray(beta, np.float64)))


def nearest_class(beta: NDArray[np.float64]) -> NDArray[np.intp]:
    """Index into BETA_CLASSES of the nearest, as ratios go; any shape."""
    logs = np.log(BETA_CLASSES)
    return np.searchsorted(0.5 * (logs[1:] + logs[:-1]), np.log(beta))
