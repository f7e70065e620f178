"""Gradient stops: the piecewise linear functions nearest to the falloff's profiles.

An SVG gradient is linear between its stops. Their offsets (free knots) and opacities minimise

    integral over the disc of (stops(r) - f(r))^2 2 pi r dr,   r in 0..cut_radius(beta),

in px^2 for a shape of sigma 1 px: the squared error of the image. A dynamic program finds the best
knots of an interpolating polygon among candidates, then knots are moved one by one while the
least-squares values improve. tests/svg/test_stops.py checks STATED_ERRORS.

That takes up to a second for each exponent, so stops.json has those of all files
(`python benchmarks/stops.py gauss2svg/svg/stops.json`), and
tests/svg/test_stops.py derives them again.
"""

from __future__ import annotations

import json
import math
from functools import lru_cache
from importlib.resources import files

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, quoted
from gauss2svg.scene.falloff import cut_radius, profile
from gauss2svg.svg.format import STOP_COUNTS

# Root mean square error over the disc and largest error, by number of stops, at beta = 1.
STATED_ERRORS = {
    5: (0.0045, 0.012), 6: (0.0028, 0.012), 8: (0.0017, 0.007), 10: (0.0011, 0.007),
    12: (0.0008, 0.005),
}  # fmt: skip
FEWEST_STOPS = 3
_LENIENCE = 1.2  # allowed error of another exponent, as a multiple of that at beta = 1
_SAMPLES = 2000
_CANDIDATES = 120
_FIRST_OFFSET = 0.4  # of the second knot: initial first offset, as a plateau inside costs little
_FIRST_MOVE, _LAST_MOVE = 0.1, 0.003  # of the distance to the nearer neighbour
# A thousandth of the radius shifts a crisp rim of sigma 100 px by 0.14 px.
CRISP = 8.0
_OFFSET_DECIMALS, _CRISP_OFFSET_DECIMALS = 3, 4

Stops = tuple[tuple[float, ...], tuple[float, ...]]


def gradient_stops(count: int, beta: float = 1.0) -> Stops:
    """Offsets (0..1, as shares of cut_radius(beta)) and opacities (0..1) of gradient stops.

    At beta = 1 there are `count`; another beta has the fewest with at most _LENIENCE times the
    error at beta = 1, or `count`.
    Raises InputError for a count other than those in STOP_COUNTS.
    """
    if count not in STOP_COUNTS:
        raise InputError(
            f"stops must be one of {', '.join(map(str, STOP_COUNTS))}; got {quoted(count)}"
        )
    return _fewest(count, float(beta))


def best_stops(count: int, beta: float) -> Stops:
    """Offsets and opacities of exactly so many stops, 3 or more, of the least error."""
    return _best(count, beta)[0]


@lru_cache(maxsize=256)
def _fewest(count: int, beta: float) -> Stops:
    if beta == 1:
        return _best(count, beta)[0]
    allowed = _LENIENCE * _best(count, 1.0)[1]
    for fewer in range(FEWEST_STOPS, count):
        stops, error = _best(fewer, beta)
        if error <= allowed:
            return stops
    return _best(count, beta)[0]


@lru_cache(maxsize=256)
def _best(count: int, beta: float) -> tuple[Stops, float]:
    """The best stops, and the integral of their squared error in px^2 at sigma 1 px."""
    stops = known_stops().get((count, beta)) or optimised_stops(count, beta)
    x, weight, target = _sampled(beta)
    drawn = np.interp(x, *stops) - target
    return stops, float(np.sum(weight * np.square(drawn)))


@lru_cache(maxsize=1)
def known_stops() -> dict[tuple[int, float], Stops]:
    """The stops of stops.json, whose rows are a count, an exponent, offsets and opacities."""
    rows = json.loads(files("gauss2svg.svg").joinpath("stops.json").read_text(encoding="utf-8"))
    return {(count, beta): (tuple(at), tuple(values)) for count, beta, at, values in rows}


def _sampled(
    beta: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.floating]]:
    """Offsets (n,), their weight in the integral over the disc, and the profile there."""
    radius = float(cut_radius(beta))
    x = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    weight = 2 * np.pi * radius * radius / _SAMPLES * x
    return x, weight, profile(x * radius, beta)


def optimised_stops(count: int, beta: float) -> Stops:
    """Offsets and opacities of exactly so many stops, of the least error, computed anew."""
    x, weight, target = _sampled(beta)
    radius = float(cut_radius(beta))
    knots = _interpolating(count, x, weight, target, radius, beta)
    knots[0] = _FIRST_OFFSET * knots[1]
    values, error = _fitted(knots, x, weight, target)
    move = _FIRST_MOVE
    while move > _LAST_MOVE:
        better = False
        for k in range(count):
            # The ends are free too, between 0 and 1.
            below = knots[k] - knots[k - 1] if k else knots[1] - knots[0]
            above = knots[k + 1] - knots[k] if k + 1 < count else below
            for way in (-1, 1):
                moved = knots.copy()
                moved[k] = np.clip(moved[k] + way * move * min(below, above), 0.0, 1.0)
                tried = _fitted(moved, x, weight, target)
                if tried[1] < error:
                    knots, (values, error), better = moved, tried, True
        if not better:
            move /= 2
    decimals = _CRISP_OFFSET_DECIMALS if beta > CRISP else _OFFSET_DECIMALS
    offsets = np.round(knots, decimals)
    opacities = np.round(values, 3)
    return tuple(offsets.tolist()), tuple(opacities.tolist())


def _interpolating(
    count: int,
    x: NDArray[np.float64],
    weight: NDArray[np.float64],
    target: NDArray[np.floating],
    radius: float,
    beta: float,
) -> NDArray[np.float64]:
    """Knots (count,) of the best polygon through the profile, by dynamic programming."""
    # Candidates lie densely where the profile bends: the best knots of a curve follow
    # the power 2/5 of its second derivative (de Boor, "A practical guide to splines").
    edges = np.linspace(0, 1, len(x) + 1)
    bend = np.abs(np.gradient(np.gradient(profile(edges * radius, beta), edges), edges))[1:]
    density = np.cumsum((bend * np.maximum(x, 0.02)) ** 0.4 + 1e-3)
    inner = np.interp(np.linspace(0, 1, _CANDIDATES)[1:-1], density / density[-1], edges[1:])
    knots = np.unique(np.concatenate([[0.0], np.round(inner, 4), [1.0]]))
    values = profile(knots * radius, beta)
    at = np.searchsorted(x, knots)
    products = (weight, weight * x, weight * x * x, weight * target, weight * target * x)
    sums = [np.concatenate([[0.0], np.cumsum(p)])[at] for p in (*products, weight * target**2)]
    first, last = np.triu_indices(len(knots), 1)
    w, wx, wxx, wf, wfx, wff = (s[last] - s[first] for s in sums)
    slope = (values[last] - values[first]) / (knots[last] - knots[first])
    level = values[first] - slope * knots[first]
    cost = np.full((len(knots), len(knots)), math.inf)
    cost[first, last] = (
        wff - 2 * (level * wf + slope * wfx)
        + level * level * w + 2 * level * slope * wx + slope * slope * wxx
    )  # fmt: skip
    least, came_from = cost[0], []
    for _ in range(count - 2):
        through = least[:, None] + cost
        came_from.append(through.argmin(axis=0))
        least = through.min(axis=0)
    path = [len(knots) - 1]
    for choice in reversed(came_from):
        path.append(int(choice[path[-1]]))
    return knots[[0, *reversed(path)]]


def _fitted(
    knots: NDArray[np.float64],
    x: NDArray[np.float64],
    weight: NDArray[np.float64],
    target: NDArray[np.floating],
) -> tuple[NDArray[np.float64], float]:
    """Least-squares values in 0..1 at given knots, 0 at the last, and their error."""
    hats = np.stack([np.interp(x, knots, unit) for unit in np.eye(len(knots))[:-1]], axis=1)
    normal = hats.T @ (weight[:, None] * hats)
    # lstsq, because the first two hats are nearly equal where their knots nearly meet.
    values = np.linalg.lstsq(normal, hats.T @ (weight * target))[0]
    values = np.clip(values, 0.0, 1.0)
    error = float(np.sum(weight * np.square(hats @ values - target)))
    return np.append(values, 0.0), error
