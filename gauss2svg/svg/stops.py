"""Stops of gradients: the piecewise linear functions that are nearest to the profiles of falloffs.

An SVG gradient is linear between its stops. The offsets of the stops (free knots) and their
opacities minimise

    integral over the disc of (stops(r) - f(r))^2 2 pi r dr,   r in 0..cut_radius(beta).

This integral is the squared error of the image. It is in px^2 for a shape whose sigma is 1 px. It
takes up to a second to find the stops of one exponent, so stops.json has all stops that files use.
`python benchmarks/stops.py gauss2svg/svg/stops.json` writes this file. tests/svg/test_stops.py
derives the stops again, and checks the errors that docs/decisions/svg.md states.

Whole stops have opaque colours, whose levels are whole numbers because a file rounds colours to 8
bits. The error of this rounding would be as large as that of all layers together. But near most
offsets there is another offset at which the levels of all three channels are nearly whole. So a
search moves the stops of a colour one by one. It gives each stop the best whole colour at its
offset, so that this sum becomes smaller:

    sum over channels of the integral of (stops(r) - level f(r))^2 2 pi r dr

The search gains 1 to 4 dB (docs/decisions/svg.md). The same search finds greys of one hex digit, at
offsets of two decimals, which lose little (docs/decisions/minimal.md).
"""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene.falloff import cut_radius, profile

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]
FEWEST_STOPS = 3
# A gradient whose exponent is not 1 may have fewer stops than the gradient of the exponent 1. Its
# error must then be at most this many times the error of that gradient.
LENIENCE = 1.2
# If the exponent is larger than this, offsets have one more decimal: three in place of two in
# masks, and four in place of three in other gradients. Otherwise, rounding would visibly shift a
# rim that is so crisp: if sigma is 100 px, an error of 0.001 in an offset shifts it by 0.14 px.
CRISP = 8.0
Stops = tuple[list[float], list[float]]


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


MOST_GREY = 15  # largest level of a grey that has one hex digit
_PLACES = 1000  # number of places along the radius at which a stop may be
_SAMPLES_A_PLACE = 8  # number of samples of the falloff from one place to the next


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
    levels = np.full((1, 3), float(MOST_GREY))
    step = 1 if beta > CRISP else 10
    offsets, colors = _moved(levels, known_stops()[count, beta][0], beta, MOST_GREY, step)
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
    count = _PLACES * _SAMPLES_A_PLACE
    x = (np.arange(count) + 0.5) / count
    weight = x / count
    f = profile(x * float(cut_radius(beta)), beta)
    sums = (np.cumsum(weight * part) for part in (np.ones(count), x, x * x, f, f * x))
    return tuple(np.concatenate([[0.0], total])[::_SAMPLES_A_PLACE] for total in sums)
