"""The radial profile of a shape, for renderers and writers alike.

    f(r) = (exp(-(r^2 / 2)^beta) - RIM) / (1 - RIM)   for r < cut_radius(beta), 0 beyond,

where r is the Mahalanobis distance to the mean and beta is the exponent of the generalised Gaussian
(exponential power) profile. beta = 1 is the Gaussian, a large beta is an ellipse with a crisp rim
at r = sqrt 2, and a beta below 1 is a peak with long tails. Subtracting RIM makes f end at 0
instead of at a visible step, and f(0) stays 1. The cut lies where the power (r^2 / 2)^beta is CUT:

    cut_radius(beta) = sqrt(2 CUT^(1 / beta)),

so the support shrinks as beta grows: 3 sigma at 1, 1.64 at 5, sqrt 2 in the limit. Near the mean,
the derivative of f is proportional to r^(2 beta - 1). Below beta = 1/2 it is infinite at the mean,
so the domain begins at LEAST_BETA = 1/2.

A plain ellipse has no falloff. A renderer draws each pixel by the share of it that the ellipse
covers. Let z = W (x - mean) with the scene's whitening W, so that |z| = r. Per px, r grows by
g = |W^T z| / |z|. The ellipse ends at R = covered_radius(beta). The share follows from the
distances in px to the near and the far rim:

    clip(1/2 + (R - |z|) / g) + clip(1/2 + (R + |z|) / g) - 1,  clip to 0..1.

Two bounds correct the share for needles. It is at most min(1, 2 b, pi a b), where a >= b are the
semi-axes in px, because a needle covers no more of any pixel. It is 0 outside the ellipse whose
semi-axes are half a px longer, because the formula gives too much beyond a needle's ends.
"""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

# Distance in sigmas at which a Gaussian is cut. It has 1 % of its peak there. With a cut at 3.5,
# Gaussians would cover 36 % more pixels.
RADIUS = 3.0
CUT = RADIUS * RADIUS / 2
RIM = math.exp(-CUT)

LEAST_BETA, MOST_BETA = 0.5, 256.0
# A rim of large beta falls from 0.9 to 0.1 over RIM_WIDTH / beta px if sigma is 1 px.
RIM_WIDTH = math.log(math.log(0.1) / math.log(0.9)) / math.sqrt(2)

# The exponents that files have. Shapes of equal colour and exponent share a gradient, and more
# exponents would gain nothing (docs/decisions/falloff.md).
BETA_CLASSES = (1.0, 1.7, 3.0, 6.0, 16.0, 64.0)


def cut_radius(beta: ArrayLike) -> NDArray[np.float64]:
    """Return the Mahalanobis distances sqrt(2 CUT^(1 / beta)) beyond which profiles are 0."""
    return np.sqrt(2 * CUT ** (1 / np.asarray(beta, np.float64)))


def profile(r: NDArray[np.floating], beta: ArrayLike = 1.0) -> NDArray[np.floating]:
    """Return the falloff f(r) in 0..1 at Mahalanobis distances r >= 0; r and beta broadcast."""
    power = np.minimum(0.5 * np.square(r), 2 * CUT ** (1 / np.asarray(beta))) ** beta
    return np.maximum((np.exp(-power) - RIM) / (1 - RIM), 0.0) * (r < cut_radius(beta))


def coverage(
    z: NDArray[np.float64], whitening: NDArray[np.float64], radius: ArrayLike
) -> NDArray[np.float64]:
    """Return the share in 0..1 of each pixel that plain ellipses cover.

    z          (..., 2) W (x - mean) at the pixel's centre x
    whitening  (..., 3) entries w11, w21, w22 of W in 1/px
    radius     (...) in sigmas
    The arguments broadcast.
    """
    whitening, radius = np.asarray(whitening, np.float64), np.asarray(radius, np.float64)
    z1, z2 = np.moveaxis(z, -1, 0)
    w11, w21, w22 = np.moveaxis(whitening, -1, 0)
    r = np.hypot(z1, z2)
    slope = np.hypot(w11 * z1 + w21 * z2, w22 * z2)
    # px per unit of r; infinite at the mean, where the share is the largest
    px = np.divide(r, slope, out=np.full_like(r, np.inf), where=slope > 0)
    near, far = ((radius + sign * r) * px + 0.5 for sign in (-1, 1))
    share = np.clip(near, 0, 1) + np.clip(far, 0, 1) - 1
    longer, max_share = longer_axes(whitening, radius)
    o11, o21, o22 = np.moveaxis(longer, -1, 0)
    u, v = z1 / w11, (z2 - w21 * z1 / w11) / w22
    inside = np.square(o11 * u) + np.square(o21 * u + o22 * v) < 1
    return np.where(inside, np.minimum(share, max_share), 0.0)


def longer_axes(
    whitening: NDArray[np.float64], radius: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lengthen the semi-axes of ellipses by half a px, and bound the share of a pixel they cover.

    whitening  (..., 3) entries w11, w21, w22 in 1/px
    radius     (...) in sigmas
    Return the whitening (..., 3) for which the longer ellipses have radius 1, and the bounds (...)
    min(1, 2 b, pi a b), where a >= b are the semi-axes before the lengthening.
    """
    w11, w21, w22 = np.moveaxis(whitening, -1, 0)
    l11, l21, l22 = radius / w11, -radius * w21 / (w11 * w22), radius / w22
    xx, xy, yy = l11 * l11, l11 * l21, l21 * l21 + l22 * l22
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    long = np.sqrt(middle + half)
    short = l11 * l22 / long
    # each squared semi-axis grows: (a + 1/2)^2 = a^2 + a + 1/4
    mean_growth, half_difference = 0.5 * (long + short) + 0.25, 0.5 * (long - short)
    ratio = np.divide(half_difference, half, out=np.zeros_like(half), where=half > 0)
    xx += mean_growth + ratio * 0.5 * (xx - yy)
    xy += ratio * xy
    l11 = np.sqrt(xx)
    l21 = xy / l11
    l22 = (long + 0.5) * (short + 0.5) / l11  # determinant / l11 has no cancellation
    max_share = np.minimum(1.0, short * np.minimum(2.0, np.pi * long))
    return np.stack([1 / l11, -l21 / (l11 * l22), 1 / l22], axis=-1), max_share


def covered_radius(beta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the radii (n,) in sigmas of plain ellipses that have the integrals of profiles.

    R^2 = 2 integral f(r) r dr, interpolated in a table to within 1e-5.
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
    """Return the Mahalanobis distances at which profiles of exponents beta are 1/2.

    (r^2 / 2)^beta = -ln((1 + RIM) / 2) there, so r is 1.165 at beta = 1.
    """
    return np.sqrt(2 * (-math.log(0.5 * (1 + RIM))) ** (1 / np.asarray(beta, np.float64)))


def nearest_class(beta: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return for each beta the index of the entry of BETA_CLASSES nearest in logarithm."""
    logs = np.log(BETA_CLASSES)
    return np.searchsorted(0.5 * (logs[1:] + logs[:-1]), np.log(beta))
