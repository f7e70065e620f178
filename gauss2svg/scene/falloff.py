"""The radial profile of a shape, its falloff, which renderers and writers share.

    f(r) = (exp(-(r^2 / 2)^beta) - RIM) / (1 - RIM)   for r < cut_radius(beta), 0 beyond,

where r is the Mahalanobis distance to the mean and beta is the exponent of the generalised Gaussian
(exponential power) profile. A beta of 1 gives the Gaussian. A large beta gives an ellipse with a
crisp rim at r = sqrt 2, and a beta below 1 gives a peak with long tails. Because RIM is subtracted,
f ends at 0 instead of at a visible step. Because of the divisor, f(0) is 1. The cut lies where the
power (r^2 / 2)^beta is CUT:

    cut_radius(beta) = sqrt(2 CUT^(1 / beta)).

So a shape becomes smaller as beta grows: it ends at 3 sigma for beta = 1, at 1.64 sigma for
beta = 5, and at sqrt 2 sigma in the limit. Near the mean, the derivative of f is proportional to
r^(2 beta - 1), which is infinite at the mean if beta is below 1/2. So the domain begins at
LEAST_BETA = 1/2.

A plain ellipse has no falloff. In each pixel, its alpha is its opacity times the share of the pixel
that it covers. Let z = W (x - mean) with the scene's whitening W, so that |z| = r. Per px, r grows
by g = |W^T z| / |z|. The ellipse ends at R = covered_radius(beta). The share follows from the
distances in px to the near and to the far rim:

    clip(1/2 + (R - |z|) / g) + clip(1/2 + (R + |z|) / g) - 1,

where clip limits a number to 0..1. Two bounds correct the share for needles. It is at most
min(1, 2 b, pi a b), where a >= b are the semi-axes in px, because a needle does not cover more of
any pixel. It is 0 outside the ellipse whose semi-axes are half a px longer, because beyond the ends
of a needle the formula gives too much.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg import portable

# Distance in sigmas at which a Gaussian is cut off. There it has fallen to 1 % of its peak. With a
# cut at 3.5 sigmas, Gaussians would cover 36 % more pixels.
RADIUS = 3.0
CUT = RADIUS * RADIUS / 2
RIM = 0.011108996538242306  # exp(-CUT)

LEAST_BETA, MOST_BETA = 0.5, 256.0
# If beta is large and sigma is 1 px, the falloff drops from 0.9 to 0.1 over RIM_WIDTH / beta px.
RIM_WIDTH = 2.1809999950677046  # ln(ln 0.1 / ln 0.9) / sqrt 2

# The shapes of a file have only these exponents. Shapes of equal colour and exponent share a
# gradient in the file, so few exponents keep the file small. More exponents would not improve
# pictures (docs/decisions/falloff.md).
BETA_CLASSES = (1.0, 1.7, 3.0, 6.0, 16.0, 64.0)


def cut_radius(beta: ArrayLike) -> NDArray[np.float64]:
    """Return the Mahalanobis distances sqrt(2 CUT^(1 / beta)) beyond which profiles are 0."""
    return np.sqrt(2 * portable.power(CUT, 1 / np.asarray(beta, np.float64)))


def profile(r: NDArray[np.floating], beta: ArrayLike = 1.0) -> NDArray[np.floating]:
    """Return the falloff f(r) in 0..1 at Mahalanobis distances r >= 0. r and beta broadcast."""
    half = np.minimum(0.5 * np.square(r), 2 * portable.power(CUT, 1 / np.asarray(beta)))
    power = portable.power(half, beta)
    return np.maximum((portable.exp(-power) - RIM) / (1 - RIM), 0.0) * (r < cut_radius(beta))


def coverage(
    z: NDArray[np.float64], whitening: NDArray[np.float64], radius: ArrayLike
) -> NDArray[np.float64]:
    """Return how much of each pixel a plain ellipse covers, as a share in 0..1.

    z          (..., 2) whitened offset W (x - mean), where x is the centre of the pixel
    whitening  (..., 3) entries w11, w21, w22 of the ellipse's W in 1/px
    radius     (...) radius of the ellipse in sigmas

    The arguments broadcast.
    """
    whitening, radius = np.asarray(whitening, np.float64), np.asarray(radius, np.float64)
    z1, z2 = np.moveaxis(z, -1, 0)
    w11, w21, w22 = np.moveaxis(whitening, -1, 0)
    r = portable.hypot(z1, z2)
    slope = portable.hypot(w11 * z1 + w21 * z2, w22 * z2)
    # Moving by this many px along the gradient of r raises r by 1. At the mean, r has no gradient.
    # There the number is infinite, so that `share` becomes 1, and is limited to max_share below.
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
    """Return what limits `coverage`: larger ellipses outside which it is 0, and its largest value.

    whitening  (..., 3) entries w11, w21, w22 of the original ellipses in 1/px
    radius     (...) radius of the original ellipses in sigmas

    The semi-axes of the larger ellipses are longer by half a px. The first array returned is the
    whitening (..., 3) with which the larger ellipses have the radius 1. The second (...) is the
    largest share of a pixel that an original ellipse covers: min(1, 2 b, pi a b), where a >= b are
    its semi-axes in px.
    """
    w11, w21, w22 = np.moveaxis(whitening, -1, 0)
    l11, l21, l22 = radius / w11, -radius * w21 / (w11 * w22), radius / w22
    xx, xy, yy = l11 * l11, l11 * l21, l21 * l21 + l22 * l22
    middle, half = 0.5 * (xx + yy), portable.hypot(0.5 * (xx - yy), xy)
    long = np.sqrt(middle + half)
    short = l11 * l22 / long
    # Each semi-axis a becomes a + 1/2. So its square, which is an eigenvalue of the matrix
    # [[xx, xy], [xy, yy]], grows by a + 1/4.
    mean_growth, half_difference = 0.5 * (long + short) + 0.25, 0.5 * (long - short)
    ratio = np.divide(half_difference, half, out=np.zeros_like(half), where=half > 0)
    xx += mean_growth + ratio * 0.5 * (xx - yy)
    xy += ratio * xy
    l11 = np.sqrt(xx)
    l21 = xy / l11
    # The product of the semi-axes equals l11 l22, the determinant of the factor. The formula
    # l22 = sqrt(yy - l21^2) would be less accurate, because its two terms may nearly cancel.
    l22 = (long + 0.5) * (short + 0.5) / l11
    max_share = np.minimum(1.0, short * np.minimum(2.0, np.pi * long))
    return np.stack([1 / l11, -l21 / (l11 * l22), 1 / l22], axis=-1), max_share


def covered_radius(beta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the radii R (n,) in sigmas of plain ellipses that replace profiles of exponents beta.

    A plain ellipse and its profile have the same integral, so R^2 = 2 integral f(r) r dr. Let s be
    1 + 1 / beta. If t = (r^2 / 2)^beta replaces r, integration by parts gives

        R^2 = 2 / (1 - RIM) integral over t in 0..CUT of t^(s - 1) exp(-t).
    """
    # The lower incomplete gamma function of s is the series
    #     CUT^s exp(-CUT) / s (1 + CUT / (s + 1) (1 + CUT / (s + 2) (1 + ..))).
    s, total = 1 + 1 / beta, np.ones_like(beta)
    for k in range(30, 0, -1):  # double precision needs 30 terms
        total = 1 + total * (CUT / (s + k))
    gamma = total * (portable.power(CUT, s) * portable.exp(-CUT) / s)
    return np.sqrt(2 / (1 - RIM) * gamma)


def drawn_radius(beta: NDArray[np.float64], is_plain: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the radius (n,) in sigmas of each plain ellipse, or else of the gradient."""
    return np.where(is_plain, covered_radius(beta), cut_radius(beta))


def half_radius(beta: ArrayLike) -> NDArray[np.float64]:
    """Return the Mahalanobis distances at which profiles of exponents beta are 1/2.

    At these distances (r^2 / 2)^beta = -ln((1 + RIM) / 2), so r is 1.165 if beta is 1.
    """
    return np.sqrt(
        2 * portable.power(-portable.log(0.5 * (1 + RIM)), 1 / np.asarray(beta, np.float64))
    )


def nearest_class(beta: NDArray[np.float64]) -> NDArray[np.intp]:
    """Return for each beta the index in BETA_CLASSES of the exponent that is nearest to it.

    The nearest exponent is the one whose logarithm differs least from the logarithm of beta.
    """
    logs = portable.log(BETA_CLASSES)
    return np.searchsorted(0.5 * (logs[1:] + logs[:-1]), portable.log(beta))
