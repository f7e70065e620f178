"""The two forms in which a shape is drawn without a gradient: a plain ellipse and a blurred disc.

Some shapes look the same as a plain ellipse, which needs no gradient. The reason is this: a
renderer colours each pixel at the edge of a filled ellipse by the share of the pixel that the
ellipse covers. So the edge is a ramp one pixel wide. If the crisp rim of a falloff is about that
wide, it looks the same. The profile of the rim is

    f(x) = exp(-exp(x ln(ln 0.1 / ln 0.9) / width)),  width = RIM_WIDTH / (beta |grad r|) px,

where x is the distance outwards from the rim, and |grad r| is the growth of the Mahalanobis
distance per pixel there. The squared difference between the ramp and the profile is integrated
along the rim. This error is compared with the integral of falloff^2, and with the length of the rim
(docs/decisions/svg.md).

A blurred disc is a circle under feGaussianBlur. If its radius is rho and the standard deviation of
the blur is s, it has the radial profile

    g(r) = integral over t in 0..rho of t / s^2 exp(-(r^2 + t^2) / 2 s^2) I0(r t / s^2),

the variance rho^2 / 4 + s^2 per axis, and the peak g(0) = 1 - exp(-rho^2 / 2 s^2). If the ratio
rho / s is small, the profile is a faint Gaussian. If the ratio is large, the profile has the flat
top and the crisp rim of a large exponent. So each ratio draws one exponent, and limits the opacity.
docs/decisions/svg.md has the exponents, largest opacities and errors of BLURS, and
tests/svg/test_blur.py derives them again.

`as_written` returns a scene as an editable file has it.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.scene import ADD, BLURRED, LEAST_SIGMA, MOST_SIGMA, PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import (
    BETA_CLASSES,
    MOST_BETA,
    RIM_WIDTH,
    covered_radius,
    half_radius,
    nearest_class,
    profile,
    square_integral,
)
from gauss2svg.svg import Form

# The smallest exponent of plain ellipses. Profiles with a smaller exponent have no flat top.
LEAST_PLAIN_BETA = 3.0
# The number of directions, from the mean to the rim, in which errors are computed. They are all in
# one quadrant, because the other quadrants have the same errors.
_DIRECTIONS = 16
# The widths of rims, in px, for which `_errors` computes errors.
_WIDTHS = np.geomspace(0.05, 8, 48)
# The exponents that plain_beta tries. From one to the next they grow by 6 %, which changes the
# width of a rim of 1 px by 0.06 px.
_PLAIN_BETAS = tuple(np.round(np.geomspace(LEAST_PLAIN_BETA, MOST_BETA, 78), 2).tolist())


# A shape is drawn as a plain ellipse if its squared error is within the next two limits
# (docs/decisions/svg.md). The first limit is for the squared error divided by the integral of
# falloff^2. It is a compromise between PSNR and bytes.
LARGEST_ERROR = 0.003
# The second limit is for the squared error divided by the length of the rim, in px. If a rim is 0.5
# to 1.2 px wide, the error is within this limit. Without the limit, large soft discs would also be
# drawn as plain ellipses, and would look visibly crisper.
LARGEST_ON_RIM = 0.013
# If the rim of a shape is everywhere narrower than this, in px, minimal markup draws the shape as
# an arc. The edge of an arc is about one pixel wide, so it is no crisper than such a rim.
CRISP_RIM = 1.0


def is_plain(scene: Scene, minimal: bool = False) -> NDArray[np.bool_]:
    """Return for each shape (n,) whether a file draws it as a plain ellipse.

    That is so if the shape is already a plain ellipse in the scene, or if a plain ellipse looks the
    same: its exponent is at least LEAST_PLAIN_BETA, and the error of the ellipse is within the
    limits LARGEST_ERROR and LARGEST_ON_RIM. Whether it looks the same depends on the size of the
    canvas, because rims are wider on a larger canvas.

    minimal  whether the file has minimal markup, in which a plain ellipse also replaces a shape
             whose rim is narrower than CRISP_RIM
    """
    axes, beta, plain = scene.ellipse_axes[0], scene.beta, scene.drawn == PLAIN
    maybe = ~plain & (beta >= LEAST_PLAIN_BETA)
    if minimal:
        plain |= maybe & (RIM_WIDTH * axes[:, 0] / beta < CRISP_RIM)
        maybe &= ~plain
    if maybe.any():
        plain[maybe] = _relative_error(axes[maybe], beta[maybe]) <= 1
    return plain


def plain_beta(semi_axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return for each plain ellipse (n,) the exponent of the profile that differs least from it.

    semi_axes  (n, 2) semi-axes of the ellipses in px, the larger one first

    The difference is measured as the error that `is_plain` limits. A shape is written as a plain
    ellipse only if its error is within the limits. When the file is read, the shape gets the
    exponent that this function returns. Its error is then no larger than before, so the shape is
    written as a plain ellipse again.

    If the semi-axes exceed about 180 px, the result is the largest exponent that is tried, although
    the rim of this profile is still softer than the edge of the ellipse.
    """
    radius = covered_radius(np.array(_PLAIN_BETAS))
    # Begin at the exponent whose rim is 0.7 px wide along the minor axis. The best exponent is near
    # this one.
    guess = np.searchsorted(0.7 / RIM_WIDTH * np.array(_PLAIN_BETAS) * radius, semi_axes[:, 1])
    best = np.full(len(semi_axes), np.inf)
    beta = np.full(len(semi_axes), _PLAIN_BETAS[0])
    for step in range(-8, 9):
        at = np.clip(guess + step, 0, len(_PLAIN_BETAS) - 1)
        tried = np.array(_PLAIN_BETAS)[at]
        error = _relative_error(semi_axes / radius[at, None], tried)
        better = error < best
        best[better], beta[better] = error[better], tried[better]
    return beta


def _relative_error(axes: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the squared error of each plain ellipse (n,), divided by the error that is allowed."""
    angle_rad = (np.arange(_DIRECTIONS) + 0.5) * (0.5 * np.pi / _DIRECTIONS)
    along, across = portable.cos(angle_rad), portable.sin(angle_rad)
    growth = portable.hypot(along / axes[:, :1], across / axes[:, 1:])
    width = RIM_WIDTH / (beta[:, None] * growth)
    length = portable.hypot(axes[:, :1] * across, axes[:, 1:] * along)
    length *= math.sqrt(2) * 2 * np.pi / _DIRECTIONS
    error = (np.interp(portable.log(width), portable.log(_WIDTHS), _errors()) * length).sum(axis=1)
    in_mass = LARGEST_ERROR * square_integral(beta) * axes.prod(axis=1)
    return error / np.minimum(in_mass, LARGEST_ON_RIM * length.sum(axis=1))


@lru_cache(maxsize=1)
def _errors() -> NDArray[np.float64]:
    """Return the error of a plain ellipse across its rim, in px, for each width in _WIDTHS.

    The error is the integral of (rim - ramp)^2. `rim` is the opacity across a rim of this width,
    and `ramp` is the opacity across the edge of the ellipse.
    """
    x = np.linspace(-12, 12, 4801)
    step = x[1] - x[0]
    grade = portable.log(portable.log(0.1) / portable.log(0.9)) / _WIDTHS[:, None]
    rim = portable.exp(-portable.exp(np.minimum(grade * x, 30.0)))
    # The antialiased edge of a plain ellipse is a ramp that is one px wide. The middle of this ramp
    # is at x = edge, so that the ramp and the rim have the same integral.
    edge = rim.sum(axis=1, keepdims=True) * step + x[0]
    return np.square(rim - np.clip(0.5 - (x - edge), 0, 1)).sum(axis=1) * step


GRADIENT, BLUR = get_args(Form)
# `_difference` is computed only for exponents whose logarithm is a multiple of this step. For any
# other exponent, the result for the nearest of these is used.
_LOG_STEP = 0.04

# The next three numbers limit which shapes become blurred discs (docs/decisions/svg.md). A shape
# may become a blurred disc only if all points of its contour at half height are at least this far
# from its mean, in px.
LEAST_HALF_WIDTH = 1.8
# A shape may become a blurred disc only if their opacities differ by at most this, on the scale
# 0..1. A gradient may differ from its shape as much, because a file has only a few exponents, and
# the gradient gets the one of these that is nearest to the exponent of the shape.
MOST_DIFFERING = 0.08
# A shape may need a blurred disc whose fill-opacity exceeds 1. If it exceeds 1 by at most this, the
# disc is used, and its fill-opacity is written as 1.
OVERFULL = 0.02
CLEAR = 3.5  # margin of a filter's region around the disc, in standard deviations of the blur


class Blur(NamedTuple):
    """A blur of a disc of radius 1, and the profile that the blurred disc draws.

    deviation  standard deviation of the blur, as a multiple of the disc's radius
    beta       exponent of the profile
    radius     radius of the disc, in sigmas of the profile
    peak       fill-opacity of the disc, divided by the opacity of the shape
    """

    deviation: float
    beta: float
    radius: float
    peak: float


# The blurs that a file may have, from the softest to the crispest. The first number of each blur is
# its standard deviation, for a disc of radius 1. The other three numbers were fitted so that the
# blurred disc draws the profile as well as possible, and tests/svg/test_blur.py fits them again.
BLURS = (
    Blur(1 / 1.4, 1.01147233778, 1.09458307443, 1.59501799762),
    Blur(1 / 2, 1.14528662352, 1.25762415807, 1.16469982183),
    Blur(1 / 2.6, 1.36563435691, 1.30896075143, 1.04243700421),
    Blur(1 / 3.4, 1.74340697660, 1.32641735405, 0.99816573719),
    Blur(1 / 5, 2.60683835486, 1.33969286603, 0.98493441846),
    Blur(1 / 8, 4.31967523876, 1.35788668786, 0.98709482037),
    Blur(1 / 12, 6.64289524310, 1.37279799581, 0.99067903041),
)


def blurred_disc(r: NDArray[np.float64], ratio: float) -> NDArray[np.float64]:
    """Return the opacity (n,) of a blurred disc at the radii r (n,).

    The radius of the disc is 1, and the standard deviation of the blur is 1 / ratio.
    """
    from scipy.special import ive  # imported here because it takes 0.3 s and is seldom needed

    t = (np.arange(300) + 0.5) / 300
    exponent = -0.5 * (ratio * (r[:, None] - t)) ** 2
    return (t * ratio**2 * portable.exp(exponent) * ive(0, r[:, None] * t * ratio**2)).mean(axis=1)


def nearest_blurs(scene: Scene) -> NDArray[np.intp]:
    """Return for each shape (n,) the index in BLURS of its nearest possible blur.

    A blur is possible if the fill-opacity of the blurred disc would be at most 1 + OVERFULL. The
    nearest one is that whose exponent is nearest to the exponent of the shape.
    """
    distance = np.abs(portable.log(scene.beta[:, None] / [blur.beta for blur in BLURS]))
    full = np.array([blur.peak for blur in BLURS]) * scene.opacity[:, None]
    return np.where(full <= 1 + OVERFULL, distance, np.inf).argmin(axis=1)


def _becomes_blurred(scene: Scene) -> NDArray[np.bool_]:
    """Return for each shape (n,) whether a file of the form "blur" draws it as a blurred disc.

    That is so if the shape is already a blurred disc in the scene. It is also so for any other
    shape, unless the shape is small, is drawn as a plain ellipse, or would differ too much from the
    blurred disc.
    """
    large = scene.ellipse_axes[0][:, 1] * half_radius(scene.beta) >= LEAST_HALF_WIDTH
    blurred = (scene.drawn == BLURRED) | (large & ~is_plain(scene))
    others = np.flatnonzero(blurred & (scene.drawn != BLURRED))
    steps = (round(portable.log(beta) / _LOG_STEP) for beta in scene.beta[others])
    differences = list(map(_difference, steps, nearest_blurs(scene)[others]))
    blurred[others] = scene.opacity[others] * differences <= MOST_DIFFERING
    return blurred


@lru_cache(maxsize=4096)
def _difference(step: int, index: int) -> float:
    """Return the largest difference in opacity, 0..1, between a blurred disc and a profile.

    The size of the disc is chosen so that the opacities of disc and profile fall to half of their
    peaks at the same radius.

    step   logarithm of the exponent of the profile, as a multiple of _LOG_STEP
    index  index of the blur in BLURS
    """
    beta, blur = portable.exp(step * _LOG_STEP), BLURS[index]
    r = np.linspace(0, 4, 400)  # radii in sigmas of the profile
    own = r * float(half_radius(blur.beta) / half_radius(beta))
    drawn = blur.peak * blurred_disc(own / blur.radius, 1 / blur.deviation)
    # The last digits of SciPy's Bessel function differ from machine to machine.
    return round(float(np.abs(drawn - profile(r, beta)).max()), 9)


def as_written(scene: Scene, form: str) -> Scene:
    """Return the scene that an editable file of this form draws, except for rounded coordinates.

    `drawn` says how the file draws each shape. A blurred disc gets the exponent of its blur. A
    shape that has a gradient gets the nearest exponent of BETA_CLASSES. The sigmas of these shapes
    change too, so that each keeps its contour at half height. Plain ellipses keep their exponents.
    Colours are rounded to 8 bits. If a scene that this function returned is passed to it again, the
    scene does not change. An additive scene is returned as it is, because its stops are computed
    from the exact colours.
    """
    if scene.blend == ADD:
        return scene
    blurred = np.full(len(scene), False) if form == GRADIENT else _becomes_blurred(scene)
    shaded, beta = ~is_plain(scene) & ~blurred, scene.beta.copy()
    beta[blurred] = np.array([blur.beta for blur in BLURS])[nearest_blurs(scene)[blurred]]
    beta[shaded] = np.array(BETA_CLASSES)[nearest_class(beta[shaded])]
    color = np.round(scene.color * 255) / 255
    written = with_falloffs(scene, beta).replace(color=color)
    return written.replace(
        drawn=np.where(is_plain(written), PLAIN, np.where(blurred, BLURRED, SOFT))
    )


def with_falloffs(scene: Scene, beta: NDArray[np.float64]) -> Scene:
    """Return the scene with the exponents `beta` (n,).

    The sigmas change too, so that each shape keeps its contour at half height.
    """
    sigma = scene.sigma * (half_radius(scene.beta) / half_radius(beta))[:, None]
    return scene.replace(beta=beta, sigma=np.clip(sigma, LEAST_SIGMA, MOST_SIGMA))
