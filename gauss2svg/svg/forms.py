"""Forms in which a shape is drawn besides a gradient: a plain ellipse, and a blurred disc.

A plain ellipse, without a gradient, draws some shapes as well as a gradient does:

A renderer draws the edge of a filled ellipse by the coverage of each pixel, as a ramp one pixel
wide. A crisp rim of the falloff looks the same if it is about that wide. Its profile is

    f(x) = exp(-exp(x ln(ln 0.1 / ln 0.9) / width)),  width = RIM_WIDTH / (beta |grad r|) px,

where x is the distance outwards from the rim, and |grad r| is the growth of the Mahalanobis
distance per pixel there. The squared difference of ramp and profile is integrated along the rim,
and compared with the integral of falloff^2 and with the rim's length (docs/decisions/svg.md).

A blurred disc is a circle under feGaussianBlur:

A disc of radius rho blurred by s has the radial profile

    g(r) = integral over t in 0..rho of t / s^2 exp(-(r^2 + t^2) / 2 s^2) I0(r t / s^2),

the variance rho^2 / 4 + s^2 per axis, and the peak g(0) = 1 - exp(-rho^2 / 2 s^2). A small rho / s
gives a faint Gaussian. A large one gives the flat top and crisp rim of a large exponent. So every
ratio draws one exponent and limits the opacity. docs/decisions/svg.md has the exponents, the
largest opacities and errors of BLURS, and tests/svg/test_blur.py derives them again.

`snapped` rounds exponents and colours to those that a file can hold.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import ADD, BLURRED, LEAST_SIGMA, MOST_SIGMA, PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import (
    BETA_CLASSES,
    MOST_BETA,
    RIM_WIDTH,
    covered_radius,
    cut_radius,
    half_radius,
    nearest_class,
    profile,
)
from gauss2svg.svg import Form

# Least exponent of plain ellipses. Profiles of smaller exponents have no flat top.
LEAST_PLAIN_BETA = 3.0
_DIRECTIONS = 16  # directions from the mean to the rim in one quadrant. The others mirror them
_WIDTHS = np.geomspace(0.05, 8, 48)  # px, widths of rims for which `_errors` returns the errors
# Exponents that plain_beta tries. Steps of 6 % change the width of a 1 px rim by 0.06 px.
_PLAIN_BETAS = tuple(np.round(np.geomspace(LEAST_PLAIN_BETA, MOST_BETA, 78), 2).tolist())


# Largest errors at which a shape is drawn as a plain ellipse (docs/decisions/svg.md).
LARGEST_ERROR = 0.003  # share of the integral of falloff^2, a compromise between PSNR and bytes
# Squared error in px for each px of the rim's length. Rims 0.5 to 1.2 px wide stay within this
# limit. Without it large soft discs would become visibly crisper.
LARGEST_ON_RIM = 0.013
# px. Minimal markup also draws a shape as an arc if its rim is narrower than this everywhere. The
# edge of the arc, about a pixel wide, is no crisper than such a rim.
CRISP_RIM = 1.0


def is_plain(scene: Scene) -> NDArray[np.bool_]:
    """Return whether a file draws each shape (n,) as a plain ellipse.

    A file does so if the shape is plain in the scene, or if an ellipse looks the same at the size
    of the scene's canvas. On a larger canvas rims are wider.
    """
    return (scene.drawn == PLAIN) | looks_plain(scene.ellipse_axes[0], scene.beta)


def looks_plain(axes: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether each shape (n,), drawn as a plain ellipse, is within both limits on error.

    axes  (n, 2) one-sigma semi-axes in px, larger first
    beta  (n,) exponents
    """
    plain = beta >= LEAST_PLAIN_BETA
    if plain.any():
        plain[plain] = _relative_error(axes[plain], beta[plain]) <= 1
    return plain


def plain_beta(semi_axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the exponents (n,) of the profiles that plain ellipses draw best.

    semi_axes  (n, 2) px, larger first

    At these exponents the error that is_plain measures is smallest, so a shape written as a plain
    ellipse is plain when it is read. If the semi-axes exceed about 180 px, even the largest
    exponent has a softer rim than the ellipse.
    """
    radius = plain_radius(np.array(_PLAIN_BETAS))
    # Begin at the exponent whose rim is 0.7 px wide along the minor axis. The best one is near.
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


def is_arc(axes: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether minimal markup draws each shape (n,) as an arc.

    It does so if the ellipse looks the same, or if the exponent is at least LEAST_PLAIN_BETA and
    the rim is narrower than CRISP_RIM.

    axes  (n, 2) one-sigma semi-axes in px, larger first
    beta  (n,) exponents
    """
    across = RIM_WIDTH * axes[:, 0] / beta
    crisp = (beta >= LEAST_PLAIN_BETA) & (across < CRISP_RIM)
    return looks_plain(axes, beta) | crisp


def arc_beta(semi_axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the exponents (n,) that arcs of semi_axes (n, 2) px, larger first, stand for.

    An arc stands for the exponent that a plain ellipse draws best. But thin shapes of that exponent
    would be written as soft shapes, so thin arcs stand for the largest exponent.
    """
    beta = plain_beta(semi_axes)
    axes = semi_axes / plain_radius(beta)[:, None]
    return np.where(is_arc(axes, beta), beta, MOST_BETA)


def _relative_error(axes: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the squared errors (n,) of plain ellipses, divided by the largest allowed ones."""
    angle_rad = (np.arange(_DIRECTIONS) + 0.5) * (0.5 * np.pi / _DIRECTIONS)
    along, across = np.cos(angle_rad), np.sin(angle_rad)
    growth = np.hypot(along / axes[:, :1], across / axes[:, 1:])
    width = RIM_WIDTH / (beta[:, None] * growth)
    length = np.hypot(axes[:, :1] * across, axes[:, 1:] * along)
    length *= math.sqrt(2) * 2 * np.pi / _DIRECTIONS
    error = (np.interp(np.log(width), np.log(_WIDTHS), _errors()) * length).sum(axis=1)
    mass_of_square = np.array([_integrals(b)[1] for b in np.round(beta, 2)]) * axes.prod(axis=1)
    on_rim = LARGEST_ON_RIM * length.sum(axis=1)
    return error / np.minimum(LARGEST_ERROR * mass_of_square, on_rim)


def plain_radius(beta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the radii (n,), in sigmas, of ellipses with as much mass as the profiles of beta."""
    return np.sqrt([_integrals(b)[0] / np.pi for b in np.round(beta, 2)])


def drawn_radius(beta: NDArray[np.float64], plain: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return each shape's radius (n,) in sigmas: the ellipse's if plain, else the gradient's."""
    radius = cut_radius(beta)
    radius[plain] = plain_radius(beta[plain])
    return radius


def drawn_beta(scene: Scene, plain: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the exponents that ellipses draw best, for the shapes in the mask `plain` (n,)."""
    radius = plain_radius(scene.beta[plain])
    return plain_beta(scene.ellipse_axes[0][plain] * radius[:, None])


@lru_cache(maxsize=1)
def _errors() -> NDArray[np.float64]:
    """Return the integral of (rim - ramp)^2 across a rim, in px, for each of _WIDTHS."""
    x = np.linspace(-12, 12, 4801)
    step = x[1] - x[0]
    grade = math.log(math.log(0.1) / math.log(0.9)) / _WIDTHS[:, None]
    rim = np.exp(-np.exp(np.minimum(grade * x, 30.0)))
    edge = rim.sum(axis=1, keepdims=True) * step + x[0]  # middle of the ramp of equal mass
    return np.square(rim - np.clip(0.5 - (x - edge), 0, 1)).sum(axis=1) * step


@lru_cache(maxsize=4096)
def _integrals(beta: float) -> tuple[float, float]:
    """Return the integrals of f and of f^2 over the plane, in px^2 at sigma 1 px."""
    r = (np.arange(2000) + 0.5) / 2000 * float(cut_radius(beta))
    value, area = profile(r, beta), 2 * np.pi * r * (r[1] - r[0])
    return float(np.sum(value * area)), float(np.sum(value**2 * area))


GRADIENT, BLUR = get_args(Form)
_LOG_STEP = 0.04  # step of log(exponent) between cached differences

# Limits of blurred shapes (docs/decisions/svg.md).
# px. Shapes whose contour of half height is nearer to the mean than this are not blurred.
LEAST_HALF_WIDTH = 1.8
# Largest error of a blurred disc's opacity, 0..1. A gradient of the nearest exponent errs as much.
MOST_DIFFERING = 0.08
OVERFULL = 0.02  # largest excess over 1 of a disc's fill-opacity, which is then clipped
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
    """Return the index (n,) into BLURS of the blur that a form gives each shape. -1 is no blur.

    A shape gets the blur of nearest exponent among those that allow its opacity. It gets none if it
    is small, or if its profile and the blur's differ too much. A shape that is blurred already
    keeps its blur, unless its opacity needs another.
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
    difference = opacity * list(map(_difference, steps, nearest))
    kept = before[candidates] | (difference <= MOST_DIFFERING)
    index[candidates] = np.where(kept, nearest, -1)
    return index


def drawn_blurs(scene: Scene) -> NDArray[np.intp]:
    """Return the index (n,) into BLURS of each blurred shape, by its exponent. Others have -1."""
    distance = np.abs(np.log(scene.beta[:, None] / [blur.beta for blur in BLURS]))
    return np.where(scene.drawn == BLURRED, distance.argmin(axis=1), -1)


@lru_cache(maxsize=4096)
def _difference(step: int, index: int) -> float:
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

    Exponents become values of BETA_CLASSES, or of BLURS for shapes that the form blurs. Sigma
    changes with them so that the contour of half height stays. Plain ellipses keep their exponent.
    Colours are rounded to 8 bits. Additive scenes are returned as they are, because their stops are
    computed from exact colours. A scene that was snapped before does not change.
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


# Bounds within which a shape of a drawing counts as crisp (docs/decisions/enlarged.md).
RIM_OF_EDGE = 1.5  # widest crisp rim in px, from .9 to .1 of the opacity across the minor axis
# Least distance in px from the middle of a crisp shape to its rim. A thinner shape does not look
# crisp, and matches the picture better in the form in which it was fitted.
MIDDLE_OF_EDGE = 1.0


def with_plain_edges(scene: Scene) -> Scene:
    """Return the scene with its crisp shapes as plain ellipses.

    Shapes keep their contour at half the opacity. A fit of this scene draws a plain ellipse by the
    share of each pixel that it covers.
    """
    minor = scene.ellipse_axes[0][:, 1]
    crisp = RIM_WIDTH * minor < RIM_OF_EDGE * scene.beta
    plain = is_plain(scene) | (crisp & (minor * covered_radius(scene.beta) > MIDDLE_OF_EDGE))
    return with_plain(scene, plain).replace(drawn=np.where(plain, PLAIN, scene.drawn))


def with_plain(
    scene: Scene, plain: NDArray[np.bool_], beta: NDArray[np.float64] | None = None
) -> Scene:
    """Return the scene with exponents `beta`, and with some shapes as plain ellipses.

    plain  (n,) whether a shape gets the exponent that a plain ellipse draws
    beta   (n,) exponents of the other shapes, by default those of the scene
    """
    beta = (scene.beta if beta is None else beta).copy()
    beta[plain] = drawn_beta(scene, plain)
    return with_falloffs(scene, beta)
