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
offsets there is another offset at which the levels of all three channels are nearly whole, so the
stops are moved there. This gains 1 to 3 dB (docs/decisions/svg.md). Greys of one hex digit, at
offsets of two decimals, are found in the same way (docs/decisions/minimal.md).

Some shapes look the same as a plain ellipse, which needs no gradient. The reason is this: a
renderer colours each pixel at the edge of a filled ellipse by the share of the pixel that the
ellipse covers. So the edge is a ramp one pixel wide. If the crisp rim of a falloff is about that
wide, it looks the same. The profile of the rim is

    f(x) = exp(-exp(x ln(ln 0.1 / ln 0.9) / width)),  width = RIM_WIDTH / (beta |grad r|) px,

where x is the distance outwards from the rim, and |grad r| is the growth of the Mahalanobis
distance per pixel there. So a shape is drawn as a plain ellipse if its rim is everywhere narrower
than PLAIN_RIM (docs/decisions/svg.md).

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
from functools import lru_cache
from importlib.resources import files
from typing import NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.scene import ADD, BLURRED, LEAST_SIGMA, MOST_SIGMA, PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import (
    BETA_CLASSES,
    RIM_WIDTH,
    cut_radius,
    half_radius,
    nearest_class,
    profile,
)
from gauss2svg.svg import Form

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
Stops = tuple[list[float], list[float]]
GRADIENT, BLUR = get_args(Form)

FEWEST_STOPS = 3
# If the exponent is larger than this, offsets have one more decimal: three in place of two in
# masks, and four in place of three in other gradients. Otherwise, rounding would visibly shift a
# rim that is so crisp: if sigma is 100 px, an error of 0.001 in an offset shifts it by 0.14 px.
CRISP = 8.0


def gradient_stops(count: int, beta: float = 1.0) -> Stops:
    """Return the offsets and the opacities of the stops of a gradient.

    Both are in 0..1. Offsets are shares of cut_radius(beta). At beta = 1 there are `count` stops.
    At any other beta there are as few stops as keep the error within 1.2 times the error at
    beta = 1, but at most `count`.

    count  one of STOP_COUNTS
    beta   one of BETA_CLASSES
    """
    known = known_stops()
    allowed = 1.2 * known[count, 1.0][1] if beta != 1 else 0.0
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


def whole_stops(levels: Floats, count: int) -> tuple[Floats, Ints]:
    """Return the stops of n gradients. Their colours are whole levels of 255.

    The results are the offsets (n, count) and the colours (n, count, 3). The last stop is black.

    levels  (n, 3) colours of the peaks in levels of 255, at least 0
    count   number of stops, one of STOP_COUNTS
    """
    return _rounded(levels, gradient_stops(count), 1.0, 1)


def grey_stops(count: int, beta: float) -> tuple[Floats, Ints]:
    """Return the offsets (count,) and the greys (count,), in 0..15, of the stops of a mask.

    count  number of stops, 3..5
    beta   exponent of the profile that the mask draws

    Offsets have two decimals, or three if the exponent is larger than CRISP. The last grey is 0.
    """
    stops, step = known_stops()[count, beta][0], 1 if beta > CRISP else 10
    offsets, colors = _rounded(np.full((1, 1), 15.0), stops, beta, step)
    return offsets[0], colors[0, :, 0]


def _rounded(levels: Floats, stops: Stops, beta: float, step: int) -> tuple[Floats, Ints]:
    """Return the offsets (n, count) and the colours (n, count, c) of n gradients in whole levels.

    Each stop is moved along the profile to where its colour is nearly whole.

    levels  (n, c) colours of the peaks
    stops   offsets and opacities of the exact gradient
    beta    exponent of the profile
    step    offsets are multiples of this number of thousandths
    """
    radius, count = float(cut_radius(beta)), len(stops[0])
    moves = np.arange(-40, 41, step)
    last = round(stops[0][-1] * 1000 / step) * step
    places = np.full((len(levels), count), last)
    colors = np.zeros((len(levels), count, levels.shape[1]), np.intp)
    before = np.full((len(levels), 1), -step)
    for k, (offset, value) in enumerate(zip(stops[0][:-1], stops[1][:-1], strict=True)):
        tried = round(offset * 1000 / step) * step + moves
        tried = np.clip(tried, before + step, last - step * (count - 1 - k))
        rise = profile(tried / 1000 * radius, beta) - profile(np.array(offset * radius), beta)
        exact = levels[:, None] * (value + rise)[:, :, None]
        # A stop that is moved along the curve is wrong too, but by less than one that is rounded.
        cost = np.square(np.round(exact) - exact).sum(axis=2)
        cost += 0.1 * np.square(rise) * np.square(levels).sum(axis=1, keepdims=True)
        best = cost.argmin(axis=1)[:, None]
        before = places[:, k, None] = np.take_along_axis(tried, best, axis=1)
        colors[:, k] = np.round(np.take_along_axis(exact, best[:, :, None], axis=1)[:, 0])
    return places / 1000, np.clip(colors, 0, 255)


# The smallest exponent of plain ellipses. Profiles with a smaller exponent have no flat top.
LEAST_PLAIN_BETA = 3.0
# If the rim of a shape is everywhere narrower than this, in px, a file draws it as a plain ellipse,
# whose edge is about one pixel wide (docs/decisions/svg.md).
PLAIN_RIM = 1.0


def is_plain(scene: Scene) -> NDArray[np.bool_]:
    """Return for each shape (n,) whether a file draws it as a plain ellipse.

    That is so if the shape is already a plain ellipse in the scene, or if a plain ellipse looks the
    same. Whether it looks the same depends on the size of the canvas, because rims are wider on a
    larger canvas.
    """
    rim = RIM_WIDTH * scene.ellipse_axes[0][:, 0] / scene.beta
    return (scene.drawn == PLAIN) | ((scene.beta >= LEAST_PLAIN_BETA) & (rim < PLAIN_RIM))


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


def nearest_blurs(scene: Scene) -> NDArray[np.intp]:
    """Return for each shape (n,) the index in BLURS of its nearest possible blur.

    A blur is possible if the fill-opacity of the blurred disc would exceed 1 by at most 0.02. It is
    then written as 1. The nearest one is that whose exponent is nearest to that of the shape.
    """
    full = np.array([blur.peak for blur in BLURS]) * scene.opacity[:, None]
    distance = np.abs(portable.log(scene.beta[:, None] / [blur.beta for blur in BLURS]))
    return np.where(full <= 1.02, distance, np.inf).argmin(axis=1)


def as_written(scene: Scene, form: str) -> Scene:
    """Return the scene that an editable file of this form draws, except for rounded coordinates.

    `drawn` says how the file draws each shape. In a file of the form "blur", a shape becomes a
    blurred disc unless it is small, is drawn as a plain ellipse, or would differ too much from the
    disc (docs/decisions/svg.md). A blurred disc gets the exponent of its blur. A shape that has a
    gradient gets the nearest exponent of BETA_CLASSES. The sigmas of these shapes change too, so
    that each keeps its contour at half height. Plain ellipses keep their exponents. Colours are
    rounded to 8 bits. If a scene that this function returned is passed to it again, the scene does
    not change. An additive scene is returned as it is, because its stops are computed from the
    exact colours.
    """
    if scene.blend == ADD:
        return scene
    plain, beta, blurred = is_plain(scene), scene.beta.copy(), np.full(len(scene), False)
    if form != GRADIENT:
        nearest = np.array([blur.beta for blur in BLURS])[nearest_blurs(scene)]
        large = scene.ellipse_axes[0][:, 1] * half_radius(beta) >= 1.8  # px
        # The opacity of the disc then differs by at most 0.08, as much as that of a gradient may.
        is_near = scene.opacity * np.abs(portable.log(beta / nearest)) <= 0.25
        blurred = (scene.drawn == BLURRED) | (large & is_near & ~plain)
        beta[blurred] = nearest[blurred]
    shaded = ~plain & ~blurred
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
