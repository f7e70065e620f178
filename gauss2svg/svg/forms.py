"""The forms of a shape in a file: a gradient, a plain ellipse and a blurred disc.

A gradient is linear between its stops. The offsets of the stops (free knots) and their opacities
minimise

    integral over the disc of (stops(r) - f(r))^2 2 pi r dr,   r in 0..cut_radius(beta).

This integral is the squared error of the image. It is in px^2 for a shape whose sigma is 1 px. It
takes up to a second to find the stops of one exponent, so stops.json has all stops that files use.
`python benchmarks/stops.py gauss2svg/svg/stops.json` writes this file. tests/svg/test_forms.py
derives the stops again, and checks the errors that docs/decisions/svg.md states.

Whole stops have opaque colours, whose levels are whole numbers because a file rounds colours to 8
bits. The error of this rounding would be as large as that of all layers together. But near most
offsets there is another offset at which the levels of all three channels are nearly whole. So a
search moves the stops of a colour one by one. It gives each stop the best whole colour at its
offset, so that this sum becomes smaller:

    sum over channels of the integral of (stops(r) - level f(r))^2 2 pi r dr

The search gains 1 to 4 dB (docs/decisions/svg.md). The same search finds greys of one hex digit, at
offsets of two decimals, which lose little (docs/decisions/minimal.md).

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
tests/svg/test_forms.py derives them again.

`as_written` returns a scene as an editable file has it.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from importlib.resources import files
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
    cut_radius,
    half_radius,
    nearest_class,
    profile,
    square_integral,
)
from gauss2svg.svg import Form

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Stops = tuple[list[float], list[float]]
GRADIENT, BLUR = get_args(Form)

FEWEST_STOPS = 3
# A gradient whose exponent is not 1 may have fewer stops than the gradient of the exponent 1. Its
# error must then be at most this many times the error of that gradient.
LENIENCE = 1.2
# If the exponent is larger than this, offsets have one more decimal: three in place of two in
# masks, and four in place of three in other gradients. Otherwise, rounding would visibly shift a
# rim that is so crisp: if sigma is 100 px, an error of 0.001 in an offset shifts it by 0.14 px.
CRISP = 8.0


def gradient_stops(count: int, beta: float = 1.0) -> Stops:
    """Return the offsets and the opacities of the stops of a gradient.

    Both are in 0..1. Offsets are shares of cut_radius(beta). At beta = 1 there are `count` stops.
    At any other beta there are fewer stops if this keeps the error within LENIENCE times the error
    at beta = 1. Otherwise there are `count` stops.

    count  one of STOP_COUNTS
    beta   one of BETA_CLASSES
    """
    known = known_stops()
    allowed = LENIENCE * known[count, 1.0][1] if beta != 1 else 0.0
    fewer = (n for n in range(FEWEST_STOPS, count) if known[n, beta][1] <= allowed)
    return known[next(fewer, count), beta][0]


@lru_cache(maxsize=1)
def known_stops() -> dict[tuple[int, float], tuple[Stops, float]]:
    """Return the stops that draw each profile best, and their squared errors, from stops.json.

    Each key of the result is a pair: the number of stops, and the exponent of the profile. Each
    value has the stops, and their squared error in px^2.
    """
    rows = json.loads(files("gauss2svg.svg").joinpath("stops.json").read_text(encoding="utf-8"))
    return {(count, beta): ((at, values), error) for count, beta, at, values, error in rows}


_PLACES = 1000  # number of places along the radius at which a stop may be
# The next three numbers are settings of the search for stops whose colours are whole levels
# (docs/decisions/svg.md). To move a stop, the search tries this many places between its neighbours.
TRIED = 24
SWEEPS = 3  # number of times that each stop is moved
GAP = 8  # smallest distance between two stops, in places
_Integrals = tuple[Floats, ...]


def whole_stops(levels: Floats, count: int) -> tuple[Floats, Ints]:
    """Return the stops of n gradients. Their colours are whole levels of 255.

    The results are the offsets (n, count) and the colours (n, count, 3). The last stop is black.

    levels  (n, 3) colours of the peaks in levels of 255, at least 0
    count   number of stops, one of STOP_COUNTS
    """
    return _moved(levels, gradient_stops(count), 1.0, 255, 1)


def grey_stops(count: int, beta: float) -> tuple[Floats, Ints]:
    """Return the offsets (count,) and the greys (count,), in 0..15, of the stops of a mask.

    count  number of stops, 3..5
    beta   exponent of the profile that the mask draws

    Offsets have two decimals, or three if the exponent is larger than CRISP. The last grey is 0.
    """
    levels = np.full((1, 3), 15.0)
    step = 1 if beta > CRISP else 10
    offsets, colors = _moved(levels, known_stops()[count, beta][0], beta, 15, step)
    return offsets[0], colors[0, :, 0]


def _moved(levels: Floats, stops: Stops, beta: float, most: int, step: int) -> tuple[Floats, Ints]:
    """Return the stops of n gradients. Their colours are whole levels.

    The results are the offsets (n, count) and the colours (n, count, 3). They are found by a search
    that moves one stop at a time. Of the places that are tried for a stop, the search takes the one
    at which the squared error is smallest, and it gives the stop the best whole levels there.

    levels  (n, 3) colours of the peaks
    stops   offsets and opacities from which the search begins
    beta    exponent of the profile that the gradients draw
    most    largest level that a channel of a stop may have
    step    offsets are multiples of this number of places
    """
    offsets, values = (np.array(part) for part in stops)
    count, moments = len(offsets), _moments(beta)
    rounded = step * np.round(offsets * (_PLACES / step)).astype(np.intp)
    places = np.tile(rounded, (len(levels), 1))
    colors = np.round(levels[:, None, :] * values[:, None])
    share, gap = (np.arange(TRIED) + 0.5) / TRIED, max(GAP, step)
    rows = np.arange(len(levels))
    for k in [*range(count)] * SWEEPS:
        first = places[:, k - 1] + gap if k else np.zeros(len(levels), np.intp)
        last = places[:, k + 1] - gap if k + 1 < count else np.full(len(levels), _PLACES)
        moved = np.round(share * (last - first)[:, None] / step).astype(np.intp)
        between = first[:, None] + step * moved
        tried = np.column_stack([places[:, k], between])
        square, linear, cost = _around(k, tried, places, colors, levels, moments)
        best = np.zeros_like(linear)
        if k + 1 < count:
            best = linear / np.maximum(square, np.finfo(np.float64).tiny)[:, :, None]
            best = np.clip(np.round(best), 0, most)
        cost += (best * (best * square[:, :, None] - 2 * linear)).sum(axis=2)
        chosen = cost.argmin(axis=1)
        places[:, k], colors[:, k] = tried[rows, chosen], best[rows, chosen]
    return places / _PLACES, colors.astype(np.intp)


def _around(
    k: int, tried: Ints, places: Ints, colors: Floats, levels: Floats, moments: _Integrals
) -> _Integrals:
    """Return three terms from which the squared error around the k-th stop is computed.

    tried  (n, t) places at which the stop may be

    The terms are square (n, t), linear (n, t, 3) and cost (n, t). They are for the part of the
    radius from the stop before the k-th one to the stop after it. The squared error of this part
    is a constant plus `cost` plus the sum of u^2 square - 2 u linear over the three channels, where
    u is the level of the k-th stop in a channel. The constant is the same for all places.
    """
    level = levels[:, None, :]
    # There is no stop before the first one. Up to its place, the gradient has the colour of the
    # first stop everywhere, so these terms are those of a disc of one colour.
    if k == 0:
        square, linear = moments[0][tried], level * moments[3][tried][:, :, None]
        cost = np.zeros(tried.shape)
    else:
        before = colors[:, None, k - 1]
        aa, ab, square, fa, fb = _segment(places[:, k - 1, None], tried, moments)
        linear = level * fb - before * ab
        cost = (before * (before * aa[:, :, None] - 2 * level * fa)).sum(axis=2)
    if k + 1 < places.shape[1]:
        after = colors[:, None, k + 1]
        aa, ab, bb, fa, fb = _segment(tried, places[:, k + 1, None], moments)
        square = square + aa
        linear = linear + level * fa - after * ab
        cost = cost + (after * (after * bb[:, :, None] - 2 * level * fb)).sum(axis=2)
    return square, linear, cost


def _segment(first: Ints, last: Ints, moments: _Integrals) -> _Integrals:
    """Return the integrals of a^2, a b, b^2, f a and f b over a part of the radius.

    This part begins at the place `first` and ends at the place `last`. f is the falloff. a is the
    linear function that falls from 1 at the first place to 0 at the last place, and b = 1 - a. Each
    integrand is multiplied by the radius, as in `_moments`. The integrals of a^2 and b^2 have the
    shape (n, t), and the others have the shape (n, t, 1).
    """
    one, x, xx, f, fx = (moment[last] - moment[first] for moment in moments)
    p, q = first / _PLACES, last / _PLACES
    width = q - p
    aa = (q * q * one - 2 * q * x + xx) / (width * width)
    ab = ((p + q) * x - p * q * one - xx) / (width * width)
    bb = (p * p * one - 2 * p * x + xx) / (width * width)
    fa, fb = (q * f - fx) / width, (fx - p * f) / width
    return aa, ab[:, :, None], bb, fa[:, :, None], fb[:, :, None]


@lru_cache(maxsize=8)
def _moments(beta: float) -> _Integrals:
    """Return the integrals of 1, x, x^2, f and f x over a disc that ends at each of the places.

    x is the radius as a share of cut_radius(beta), and f is the falloff at this radius. Each
    integrand is multiplied by the weight x, because the length of a circle is proportional to its
    radius.
    """
    samples = 8  # number of samples of the falloff from one place to the next
    count = _PLACES * samples
    x = (np.arange(count) + 0.5) / count
    weight = x / count
    f = profile(x * float(cut_radius(beta)), beta)
    sums = (np.cumsum(weight * part) for part in (np.ones(count), x, x * x, f, f * x))
    return tuple(np.concatenate([[0.0], total])[::samples] for total in sums)


# The smallest exponent of plain ellipses. Profiles with a smaller exponent have no flat top.
LEAST_PLAIN_BETA = 3.0

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


def plain_beta(semi_axes: Floats) -> Floats:
    """Return for each plain ellipse (n,) the exponent of the profile that differs least from it.

    semi_axes  (n, 2) semi-axes of the ellipses in px, the larger one first

    The difference is measured as the error that `is_plain` limits. A shape is written as a plain
    ellipse only if its error is within the limits. When the file is read, the shape gets the
    exponent that this function returns. Its error is then no larger than before, so the shape is
    written as a plain ellipse again.

    If the semi-axes exceed about 180 px, the result is the largest exponent that is tried, although
    the rim of this profile is still softer than the edge of the ellipse.
    """
    # From one exponent that is tried to the next they grow by 6 %, which changes the width of a rim
    # of 1 px by 0.06 px.
    betas = np.round(np.geomspace(LEAST_PLAIN_BETA, MOST_BETA, 78), 2)
    radius = covered_radius(betas)
    # Begin at the exponent whose rim is 0.7 px wide along the minor axis. The best exponent is near
    # this one.
    guess = np.searchsorted(0.7 / RIM_WIDTH * betas * radius, semi_axes[:, 1])
    best, beta = np.full(len(semi_axes), np.inf), np.full(len(semi_axes), betas[0])
    for step in range(-8, 9):
        at = np.clip(guess + step, 0, len(betas) - 1)
        tried = betas[at]
        error = _relative_error(semi_axes / radius[at, None], tried)
        better = error < best
        best[better], beta[better] = error[better], tried[better]
    return beta


def _relative_error(axes: Floats, beta: Floats) -> Floats:
    """Return the squared error of each plain ellipse (n,), divided by the error that is allowed."""
    # Directions from the mean to the rim. They are all in one quadrant, because the other quadrants
    # have the same errors.
    angle_rad = (np.arange(16) + 0.5) * (0.5 * np.pi / 16)
    along, across = portable.cos(angle_rad), portable.sin(angle_rad)
    growth = portable.hypot(along / axes[:, :1], across / axes[:, 1:])
    width = RIM_WIDTH / (beta[:, None] * growth)
    length = portable.hypot(axes[:, :1] * across, axes[:, 1:] * along)
    length *= math.sqrt(2) * 2 * np.pi / 16
    error = (np.interp(portable.log(width), *_rim_errors()) * length).sum(axis=1)
    in_mass = LARGEST_ERROR * square_integral(beta) * axes.prod(axis=1)
    return error / np.minimum(in_mass, LARGEST_ON_RIM * length.sum(axis=1))


@lru_cache(maxsize=1)
def _rim_errors() -> tuple[Floats, Floats]:
    """Return logarithms of widths of rims in px, and the errors of plain ellipses across them.

    The error in px is the integral of (rim - ramp)^2. `rim` is the opacity across a rim of this
    width, and `ramp` is the opacity across the edge of the ellipse.
    """
    widths, x = np.geomspace(0.05, 8, 48), np.linspace(-12, 12, 4801)
    step = x[1] - x[0]
    grade = portable.log(portable.log(0.1) / portable.log(0.9)) / widths[:, None]
    rim = portable.exp(-portable.exp(np.minimum(grade * x, 30.0)))
    # The antialiased edge of a plain ellipse is a ramp that is one px wide. The middle of this ramp
    # is at x = edge, so that the ramp and the rim have the same integral.
    edge = rim.sum(axis=1, keepdims=True) * step + x[0]
    errors = np.square(rim - np.clip(0.5 - (x - edge), 0, 1)).sum(axis=1) * step
    return portable.log(widths), errors


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
# blurred disc draws the profile as well as possible, and tests/svg/test_forms.py fits them again.
BLURS = (
    Blur(1 / 1.4, 1.01147233778, 1.09458307443, 1.59501799762),
    Blur(1 / 2, 1.14528662352, 1.25762415807, 1.16469982183),
    Blur(1 / 2.6, 1.36563435691, 1.30896075143, 1.04243700421),
    Blur(1 / 3.4, 1.74340697660, 1.32641735405, 0.99816573719),
    Blur(1 / 5, 2.60683835486, 1.33969286603, 0.98493441846),
    Blur(1 / 8, 4.31967523876, 1.35788668786, 0.98709482037),
    Blur(1 / 12, 6.64289524310, 1.37279799581, 0.99067903041),
)


def blurred_disc(r: Floats, ratio: float) -> Floats:
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
    # The difference is computed only for exponents whose logarithm is a multiple of 0.04.
    steps = (round(portable.log(beta) / 0.04) for beta in scene.beta[others])
    differences = list(map(_difference, steps, nearest_blurs(scene)[others]))
    blurred[others] = scene.opacity[others] * differences <= MOST_DIFFERING
    return blurred


@lru_cache(maxsize=4096)
def _difference(step: int, index: int) -> float:
    """Return the largest difference in opacity, 0..1, between a blurred disc and a profile.

    The size of the disc is chosen so that the opacities of disc and profile fall to half of their
    peaks at the same radius.

    step   logarithm of the exponent of the profile, as a multiple of 0.04
    index  index of the blur in BLURS
    """
    beta, blur = portable.exp(step * 0.04), BLURS[index]
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


def with_falloffs(scene: Scene, beta: Floats) -> Scene:
    """Return the scene with the exponents `beta` (n,).

    The sigmas change too, so that each shape keeps its contour at half height.
    """
    sigma = scene.sigma * (half_radius(scene.beta) / half_radius(beta))[:, None]
    return scene.replace(beta=beta, sigma=np.clip(sigma, LEAST_SIGMA, MOST_SIGMA))
