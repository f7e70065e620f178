"""The gradient stops of all files, which gauss2svg/svg/stops.json holds.

    python benchmarks/stops.py gauss2svg/svg/stops.json

Takes half a minute. Rows are a number of stops, an exponent, offsets, opacities, and the integral
of the squared error in px^2 at sigma 1 px. A dynamic
program finds the best knots of an interpolating polygon among candidates, then knots are moved one
by one while the least-squares values improve.
"""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene.falloff import BETA_CLASSES, cut_radius, profile
from gauss2svg.svg import STOP_COUNTS
from gauss2svg.svg.forms import CRISP, FEWEST_STOPS, Stops

SAMPLES = 2000  # of the profile
CANDIDATES = 120  # for the knots of the polygon
FIRST_OFFSET = 0.4  # of the second knot: initial first offset, as a plateau inside costs little
FIRST_MOVE = 0.1  # of the distance to the nearer neighbour
LAST_MOVE = 0.003


def main(path: str) -> None:
    """Write the table."""
    counts = range(FEWEST_STOPS, max(STOP_COUNTS) + 1)
    rows = []
    for n in counts:
        for beta in BETA_CLASSES:
            x, weight, target = sampled(beta)
            stops = optimised_stops(n, beta)
            error = np.sum(weight * np.square(np.interp(x, *stops) - target))
            rows.append([n, beta, *stops, float(f"{error:.6g}")])
    Path(path).write_text("[\n" + ",\n".join(map(json.dumps, rows)) + "\n]\n")


def optimised_stops(count: int, beta: float) -> Stops:
    """Offsets and opacities of exactly so many stops, of the least error, computed anew."""
    x, weight, target = sampled(beta)
    radius = float(cut_radius(beta))
    knots = _interpolating(count, x, weight, target, radius, beta)
    knots[0] = FIRST_OFFSET * knots[1]
    values, error = _fitted(knots, x, weight, target)
    move = FIRST_MOVE
    while move > LAST_MOVE:
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
    decimals = 4 if beta > CRISP else 3
    offsets = np.round(knots, decimals)
    opacities = np.round(values, 3)
    return offsets.tolist(), opacities.tolist()


def sampled(beta: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.floating]]:
    """Offsets (n,), their weight in the integral over the disc, and the profile there."""
    radius = float(cut_radius(beta))
    x = (np.arange(SAMPLES) + 0.5) / SAMPLES
    weight = 2 * np.pi * radius * radius / SAMPLES * x
    return x, weight, profile(x * radius, beta)


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
    inner = np.interp(np.linspace(0, 1, CANDIDATES)[1:-1], density / density[-1], edges[1:])
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


if __name__ == "__main__":
    main(sys.argv[1])
