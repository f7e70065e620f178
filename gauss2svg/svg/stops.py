"""Gradient stops: the piecewise linear functions nearest to the falloff's profiles.

An SVG gradient is linear between its stops. Their offsets (free knots) and opacities minimise

    integral over the disc of (stops(r) - f(r))^2 2 pi r dr,   r in 0..cut_radius(beta),

in px^2 for a shape of sigma 1 px: the squared error of the image. Finding them takes up to a second
for each exponent, so stops.json has those of all files, which
`python benchmarks/stops.py gauss2svg/svg/stops.json` finds. tests/svg/test_stops.py derives them
again, and has the errors of docs/decisions/svg.md.
"""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, quoted
from gauss2svg.scene.falloff import BETA_CLASSES, cut_radius, profile
from gauss2svg.svg.format import STOP_COUNTS

FEWEST_STOPS = 3
_SAMPLES = 2000
# Exponent from which offsets have four decimals, for a thousandth of the radius shifts a crisp rim
# of sigma 100 px by 0.14 px.
CRISP = 8.0


# Number of stops of a gradient (docs/decisions/svg.md).
LENIENCE = 1.2  # ratio of another exponent's allowed error to that of beta = 1
Stops = tuple[tuple[float, ...], tuple[float, ...]]


def gradient_stops(count: int, beta: float = 1.0) -> Stops:
    """Offsets (0..1, as shares of cut_radius(beta)) and opacities (0..1) of gradient stops.

    At beta = 1 there are `count`; another beta has the fewest with at most lenience times the
    error at beta = 1, or `count`. Raises InputError for a count that is not in STOP_COUNTS, and an
    exponent that is not in BETA_CLASSES, which no file has.
    """
    if count not in STOP_COUNTS:
        raise InputError(
            f"stops must be one of {', '.join(map(str, STOP_COUNTS))}; got {quoted(count)}"
        )
    if beta not in BETA_CLASSES:
        needed = ", ".join(f"{known:g}" for known in BETA_CLASSES)
        raise InputError(f"beta of a gradient must be one of {needed}; got {quoted(beta)}")
    if beta != 1:
        allowed = LENIENCE * _best(count, 1.0)[1]
        for fewer in range(FEWEST_STOPS, count):
            stops, error = _best(fewer, float(beta))
            if error <= allowed:
                return stops
    return best_stops(count, float(beta))


def best_stops(count: int, beta: float) -> Stops:
    """Offsets and opacities of exactly so many stops, 3 or more, of the least error."""
    return _best(count, beta)[0]


@lru_cache(maxsize=256)
def _best(count: int, beta: float) -> tuple[Stops, float]:
    """The best stops, and the integral of their squared error in px^2 at sigma 1 px."""
    stops = known_stops()[count, beta]
    x, weight, target = sampled(beta)
    drawn = np.interp(x, *stops) - target
    return stops, float(np.sum(weight * np.square(drawn)))


@lru_cache(maxsize=1)
def known_stops() -> dict[tuple[int, float], Stops]:
    """The stops of stops.json, whose rows are a count, an exponent, offsets and opacities."""
    rows = json.loads(files("gauss2svg.svg").joinpath("stops.json").read_text(encoding="utf-8"))
    return {(count, beta): (tuple(at), tuple(values)) for count, beta, at, values in rows}


def sampled(
    beta: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.floating]]:
    """Offsets (n,), their weight in the integral over the disc, and the profile there."""
    radius = float(cut_radius(beta))
    x = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    weight = 2 * np.pi * radius * radius / _SAMPLES * x
    return x, weight, profile(x * radius, beta)
