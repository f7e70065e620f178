"""The radial profile of a Gaussian: the one place that renderers and exporter share.

    f(r) = (exp(-r^2 / 2) - rim) / (1 - rim)   for r < RADIUS, 0 beyond,
    rim  = exp(-RADIUS^2 / 2),

with r the Mahalanobis distance to the mean. Taking the rim off lets f end at 0
instead of at a visible step, and f(0) stays 1. An SVG gradient is linear between
its stops, so the exporter writes the piecewise linear function nearest to f.
"""

import math

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError

GAUSSIAN = "gaussian"
FALLOFFS = (GAUSSIAN,)

# Cut at 3 sigma, where 1 % of the peak is left: 3.5 would cover 36 % more pixels.
RADIUS = 3.0
RIM = math.exp(-RADIUS * RADIUS / 2)

# Knots (offset as a share of RADIUS) and values of the best piecewise linear
# functions with K stops: knots free, values by least squares, error weighted by
# the area 2 pi r dr on which it shows, rounded to three decimals. Largest error,
# and root mean square over the disc, are checked by tests/test_falloff.py.
_STOPS: dict[int, tuple[tuple[float, ...], tuple[float, ...]]] = {
    6: (
        (0, 0.171, 0.503, 0.657, 0.82, 1),
        (1, 0.886, 0.304, 0.126, 0.032, 0),
    ),
    8: (
        (0, 0.115, 0.211, 0.473, 0.597, 0.718, 0.854, 1),
        (1, 0.947, 0.821, 0.353, 0.187, 0.084, 0.023, 0),
    ),
    10: (
        (0, 0.118, 0.218, 0.445, 0.535, 0.619, 0.703, 0.793, 0.895, 1),
        (1, 0.944, 0.81, 0.401, 0.265, 0.167, 0.096, 0.047, 0.015, 0),
    ),
    12: (
        (0, 0.091, 0.162, 0.239, 0.432, 0.513, 0.586, 0.659, 0.734, 0.816, 0.908, 1),
        (1, 0.967, 0.889, 0.773, 0.424, 0.296, 0.202, 0.13, 0.077, 0.038, 0.012, 0),
    ),
}
STOP_COUNTS = tuple(_STOPS)


def profile(r: NDArray[np.floating]) -> NDArray[np.floating]:
    """Falloff f(r) at Mahalanobis distances r >= 0; any shape, values in 0..1."""
    return np.maximum((np.exp(-0.5 * np.square(r)) - RIM) / (1 - RIM), 0.0) * (r < RADIUS)


def gradient_stops(count: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Offsets (0..1, as shares of RADIUS) and opacities (0..1) of `count` gradient stops.

    Raises InputError for a count other than those in STOP_COUNTS.
    """
    if count not in _STOPS:
        known = ", ".join(map(str, STOP_COUNTS))
        raise InputError(f"stops is {count}; needed is one of {known}")
    return _STOPS[count]
