"""Gradient stops: the piecewise linear functions that are nearest to the falloff's profiles.

An SVG gradient is linear between its stops. Their offsets (free knots) and opacities minimise

    integral over the disc of (stops(r) - f(r))^2 2 pi r dr,   r in 0..cut_radius(beta),

in px^2 for a shape of sigma 1 px. The integral is the squared error of the image. Finding stops
takes up to a second for each exponent, so stops.json has all stops that files use, and
`python benchmarks/stops.py gauss2svg/svg/stops.json` writes it. tests/svg/test_stops.py derives the
stops again, and checks the errors that docs/decisions/svg.md states.

Whole stops are stops of opaque colours in whole levels, because a file rounds colours to 8 bits.
The error of this rounding is as large as that of all layers together. But most offsets are near
another one at which all three channels are nearly whole. So a search moves a colour's stops one by
one, and gives each stop the best whole colour at its offset, so that

    sum over channels of the integral of (stops(r) - level f(r))^2 2 pi r dr

falls. The search gains 1 to 4 dB (docs/decisions/svg.md). By the same search, greys of one hex
digit with offsets of two decimals lose little (docs/decisions/minimal.md).
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
LENIENCE = 1.2  # largest error of another exponent's stops, as a multiple of the error at beta = 1
# Above this exponent offsets have one more decimal, because a thousandth of the radius shifts a
# crisp rim of sigma 100 px by 0.14 px.
CRISP = 8.0
Stops = tuple[list[float], list[float]]


def gradient_stops(count: int, beta: float = 1.0) -> Stops:
    """Return offsets (0..1, as shares of cut_radius(beta)) and opacities (0..1) of gradient stops.

    At beta = 1 there are `count` stops. Another beta has the fewest stops whose error is at most
    LENIENCE times that at beta = 1, and never more than `count`.

    count  one of STOP_COUNTS
    beta   one of BETA_CLASSES
    """
    known = known_stops()
    allowed = LENIENCE * known[count, 1.0][1] if beta != 1 else 0.0
    fewer = (n for n in range(FEWEST_STOPS, count) if known[n, beta][1] <= allowed)
    return known[next(fewer, count), beta][0]


@lru_cache(maxsize=1)
def known_stops() -> dict[tuple[int, float], tuple[Stops, float]]:
    """Return the best stops and their squared error in px^2, by number of stops and exponent."""
    rows = json.loads(files("gauss2svg.svg").joinpath("stops.json").read_text(encoding="utf-8"))
    return {(count, beta): ((at, values), error) for count, beta, at, values, error in rows}


MOST_GREY = 15  # largest level of a grey of one hex digit
_PLACES = 1000  # number of places on a radius. Offsets are multiples of a thousandth
_SAMPLES_A_PLACE = 8  # samples of the falloff from one place to the next


# Settings of the search for whole stops (docs/decisions/svg.md).
TRIED = 24  # offsets tried for a stop between its neighbours
SWEEPS = 3  # number of times that each stop is moved
GAP = 8  # least distance between two stops, in places
_Integrals = tuple[Floats, ...]


def whole_stops(levels: Floats, count: int) -> tuple[Floats, Ints]:
    """Return whole stops: offsets (n, count), and colours (n, count, 3) in levels of 255.

    levels  (n, 3) colours of the peaks, >= 0, in levels of 255

    The last stop is black.
    """
    return _moved(levels, gradient_stops(count), 1.0, 255, 1)


def grey_stops(count: int, beta: float) -> tuple[Floats, Ints]:
    """Return the offsets (count,) and greys (count,), in 0..15, of an exponent's profile.

    count  3..5

    Offsets have two decimals, or three for crisp exponents. The last grey is 0.
    """
    levels = np.full((1, 3), float(MOST_GREY))
    step = 1 if beta > CRISP else 10
    offsets, colors = _moved(levels, known_stops()[count, beta][0], beta, MOST_GREY, step)
    return offsets[0], colors[0, :, 0]


def _moved(levels: Floats, stops: Stops, beta: float, most: int, step: int) -> tuple[Floats, Ints]:
    """Return whole stops near `stops`: offsets (n, count) and colours (n, count, 3) in 0..most.

    Offsets are multiples of `step` places.
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
    """Return square (n, t), linear (n, t, 3) and cost (n, t) of the k-th stop at places `tried`.

    If the stop has a colour u there, the squared error between its two neighbours is, up to a
    constant, cost plus the sum over channels of u^2 square - 2 u linear.
    """
    level = levels[:, None, :]
    if k == 0:  # the first stop's colour fills the disc inside it
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
    """Return the integrals of a a, a b, b b, f a and f b from one place to another, weighted by r.

    a falls from 1 to 0 between the places, and b = 1 - a. The integrals of a a and b b have the
    shape (n, t), the others (n, t, 1).
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
    """Return the integrals of r, r x, r x^2, r f and r f x from 0 to each place (x: offset)."""
    count = _PLACES * _SAMPLES_A_PLACE
    x = (np.arange(count) + 0.5) / count
    weight = x / count
    f = profile(x * float(cut_radius(beta)), beta)
    sums = (np.cumsum(weight * part) for part in (np.ones(count), x, x * x, f, f * x))
    return tuple(np.concatenate([[0.0], total])[::_SAMPLES_A_PLACE] for total in sums)
