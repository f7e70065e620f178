"""Gaussians as blurred discs, which are circles under feGaussianBlur.

A disc of radius rho blurred by s has the radial profile

    g(r) = integral over t in 0..rho of t / s^2 exp(-(r^2 + t^2) / 2 s^2) I0(r t / s^2),

the variance rho^2 / 4 + s^2 per axis, and the peak g(0) = 1 - exp(-rho^2 / 2 s^2). A small rho / s
gives a faint Gaussian. A large one gives the flat top and crisp rim of a large exponent. So every
ratio stands for one exponent and limits the opacity. docs/decisions/svg.md has the exponents,
largest opacities and errors of BLURS, and tests/svg/test_blur.py derives them again.

`snapped` rounds exponents and colours to those that a file can hold, before any palette.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import ADD, BLURRED, LEAST_SIGMA, MOST_SIGMA, PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, half_radius, nearest_class, profile
from gauss2svg.svg.document import Form
from gauss2svg.svg.plain_ellipse import is_plain

GRADIENT, BLUR = get_args(Form)
_LOG_STEP = 0.04  # step of log(exponent) at which differences are cached

# Shapes that are blurred (docs/decisions/svg.md).
# Least distance in px from the mean to half of the height, along the minor axis.
LEAST_HALF_WIDTH = 1.8
# Largest error of a blurred disc, as a share of the full height. It is as large as the error by the
# nearest exponent of a gradient.
MOST_DIFFERING = 0.08
OVERFULL = 0.02  # relative excess over a disc's largest opacity that may be clipped
CLEAR = 3.5  # margin of a filter region around the disc, in standard deviations


class Blur(NamedTuple):
    """A blur of a disc of radius 1, and the profile that it draws.

    deviation  standard deviation of the blur, in radii of the disc
    beta       exponent of the profile
    radius     radius of the disc, in sigmas of the profile
    peak       fill-opacity of the disc divided by the opacity of the shape
    """

    deviation: float
    beta: float
    radius: float
    peak: float


# Blurs that a file may have, softest first: for discs with radii of 1.4, 2, 2.6, 3.4, 5, 8 and 12
# standard deviations. tests/svg/test_blur.py fits the other numbers.
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
    """Return the opacity (n,), at radii r (n,), of a disc of radius 1 blurred by 1 / ratio."""
    from scipy.special import ive  # takes 0.3 s, and is seldom needed

    t = (np.arange(300) + 0.5) / 300
    exponent = -0.5 * (ratio * (r[:, None] - t)) ** 2
    return (t * ratio**2 * np.exp(exponent) * ive(0, r[:, None] * t * ratio**2)).mean(axis=1)


def chosen_blurs(scene: Scene, form: str) -> NDArray[np.intp]:
    """Return the index (n,) into BLURS of each shape's blur in a form, -1 for no blur.

    Of the blurs that allow the shape's opacity, it is the one with the nearest exponent. A shape
    has no blur if it is small, or if the two profiles differ too much. A shape that is blurred
    already keeps its blur, unless its opacity needs another.
    """
    index = np.full(len(scene), -1)
    if form == GRADIENT or not len(scene):
        return index
    half_width = scene.ellipse_axes[0][:, 1] * half_radius(scene.beta)
    large = (half_width >= LEAST_HALF_WIDTH) & ~is_plain(scene)
    before = drawn_blurs(scene) >= 0
    candidates = large | before
    beta, opacity = scene.beta[candidates], scene.opacity[candidates]
    distance = np.abs(np.log(beta[:, None] / [blur.beta for blur in BLURS]))
    full = np.array([blur.peak for blur in BLURS]) * opacity[:, None]
    nearest = np.where(full <= 1 + OVERFULL, distance, np.inf).argmin(axis=1)
    steps = (round(math.log(b) / _LOG_STEP) for b in beta)
    differing = opacity * list(map(_differing, steps, nearest))
    kept = before[candidates] | (differing <= MOST_DIFFERING)
    index[candidates] = np.where(kept, nearest, -1)
    return index


def drawn_blurs(scene: Scene) -> NDArray[np.intp]:
    """Return the index (n,) into BLURS of each blurred shape, by its exponent, -1 for others."""
    distance = np.abs(np.log(scene.beta[:, None] / [blur.beta for blur in BLURS]))
    return np.where(scene.drawn == BLURRED, distance.argmin(axis=1), -1)


@lru_cache(maxsize=4096)
def _differing(step: int, index: int) -> float:
    """Return the largest difference, 0..1, of a blurred disc from a profile of equal half-radius.

    The exponent of the profile is exp(step * _LOG_STEP).
    """
    beta, blur = math.exp(step * _LOG_STEP), BLURS[index]
    r = np.linspace(0, 4, 400)  # radii in sigmas of the profile
    own = r * float(half_radius(blur.beta) / half_radius(beta))
    drawn = blur.peak * blurred_disc(own / blur.radius, 1 / blur.deviation)
    return float(np.abs(drawn - profile(r, beta)).max())


def snapped(scene: Scene, form: str) -> Scene:
    """Return the scene with the exponents and colours that a file of this form holds.

    Exponents become those of BETA_CLASSES, or those of BLURS for shapes that the form blurs. Sigma
    changes with them so that the contour of half height stays. Plain ellipses keep their exponent.
    Colours are rounded to 8 bits. Additive scenes are returned as they are, because their stops are
    computed from exact colours. A scene that is snapped already does not change.
    """
    if scene.blend == ADD:
        return scene
    blur = chosen_blurs(scene, form)
    blurred = blur >= 0
    plain = is_plain(scene)
    shaded = ~plain & ~blurred
    beta = scene.beta.copy()
    beta[blurred] = [BLURS[k].beta for k in blur[blurred]]
    beta[shaded] = np.array(BETA_CLASSES)[nearest_class(beta[shaded])]
    drawn = np.where(blurred, BLURRED, np.where(scene.drawn == PLAIN, PLAIN, SOFT))
    color = np.round(scene.color * 255) / 255
    return with_falloffs(scene, beta).replace(color=color, drawn=drawn)


def with_falloffs(scene: Scene, beta: NDArray[np.float64]) -> Scene:
    """Return the scene with other exponents (n,). Shapes keep their contours of half height."""
    sigma = scene.sigma * (half_radius(scene.beta) / half_radius(beta))[:, None]
    return scene.replace(beta=beta, sigma=np.clip(sigma, LEAST_SIGMA, MOST_SIGMA))
