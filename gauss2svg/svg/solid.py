"""Which shapes are as well drawn by a solid filled ellipse, without a gradient.

A renderer draws the edge of a filled ellipse as the share of each pixel that it covers: a
ramp one pixel wide. A crisp rim of the falloff looks the same where it is about that wide,

    f(x) = exp(-exp(x ln(ln 0.1 / ln 0.9) / width)),  width = RIM_WIDTH / (beta |grad r|) px,

x being the distance from the rim outwards and |grad r| what the Mahalanobis distance grows by
in a pixel there. The squared error of the one for the other, integrated along the rim, is
compared with the shape's own squared mass, and with the rim's length. Comparing with the
profile averaged over a pixel instead lets narrower rims pass, and loses 0.06 dB on drawings
of 128 shapes and 0.09 on 512.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import MOST_BETA, RIM_WIDTH, cut_radius, profile

# Of the squared mass. On five drawings of 32 to 512 shapes 0.003 costs the drawn SVG -0.07 to
# 0.11 dB (once 0.8, at 49 dB) and saves up to 9 % of its bytes, 0.01 costs up to 1.7 dB and
# saves up to 27 %.
_LARGEST_ERROR = 0.003
# In px, of the rim's length: what rims of 0.5 and of 1.2 px err. Large soft discs would become
# visibly crisper without it.
_LARGEST_ON_RIM = 0.013
# Duller profiles have no flat top.
_LEAST_BETA = 3.0
_DIRECTIONS = 16  # in one quadrant, which the others mirror
_WIDTHS = np.geomspace(0.05, 8, 48)  # px
# Exponents that solid_beta tries: steps of 6 % change a rim a pixel wide by a sixteenth of one.
_GRID = tuple(np.round(np.geomspace(_LEAST_BETA, MOST_BETA, 78), 2).tolist())
_LIKELY, _STEPS = 0.7, 8  # px; exponents tried on either side


def is_solid(scene: Scene) -> NDArray[np.bool_]:
    """(n,) whether a solid ellipse errs no more than a small share of squared mass and rim.

    In pixels of the scene's canvas: on a larger one rims are wider.
    """
    solid = scene.betas >= _LEAST_BETA
    if not solid.any():
        return solid
    solid[solid] = _strain(scene.ellipse_axes[0][solid], scene.betas[solid]) <= 1
    return solid


def solid_beta(semi_axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) exponent whose profile a solid ellipse of semi_axes (n, 2) px, larger first, draws best.

    It errs least by the measure of is_solid, so that what was written as a solid ellipse is
    solid again. Beyond the largest exponent, from some 180 px on, the profile's rim is softer
    than the ellipse's.
    """
    grade = np.array([solid_radius(beta) for beta in _GRID])
    # Where the rim across the minor axis is so wide; the best is a few steps from it.
    guess = np.searchsorted(_LIKELY / RIM_WIDTH * np.array(_GRID) * grade, semi_axes[:, 1])
    best = np.full(len(semi_axes), np.inf)
    beta = np.full(len(semi_axes), _GRID[0])
    for step in range(-_STEPS, _STEPS + 1):
        at = np.clip(guess + step, 0, len(_GRID) - 1)
        tried = np.array(_GRID)[at]
        strain = _strain(semi_axes / grade[at, None], tried)
        better = strain < best
        best[better], beta[better] = strain[better], tried[better]
    return beta


def _strain(axes: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) squared error of solid ellipses as a multiple of the largest one allowed."""
    angle_rad = (np.arange(_DIRECTIONS) + 0.5) * (0.5 * np.pi / _DIRECTIONS)
    along, across = np.cos(angle_rad), np.sin(angle_rad)
    growth = np.hypot(along / axes[:, :1], across / axes[:, 1:])
    width = RIM_WIDTH / (beta[:, None] * growth)
    length = np.hypot(axes[:, :1] * across, axes[:, 1:] * along)
    length *= math.sqrt(2) * 2 * np.pi / _DIRECTIONS
    error = (np.interp(np.log(width), np.log(_WIDTHS), _errors()) * length).sum(axis=1)
    squared_mass = np.array([_integrals(b)[1] for b in np.round(beta, 2)]) * axes.prod(axis=1)
    return error / np.minimum(_LARGEST_ERROR * squared_mass, _LARGEST_ON_RIM * length.sum(axis=1))


def solid_radius(beta: float) -> float:
    """Mahalanobis radius of the ellipse that covers what a profile sums up to."""
    return math.sqrt(_integrals(round(beta, 2))[0] / np.pi)


@lru_cache(maxsize=1)
def _errors() -> NDArray[np.float64]:
    """Integral of the squared difference across the rim in px, for each of _WIDTHS."""
    x = np.linspace(-12, 12, 4801)
    step = x[1] - x[0]
    grade = math.log(math.log(0.1) / math.log(0.9)) / _WIDTHS[:, None]
    rim = np.exp(-np.exp(np.minimum(grade * x, 30.0)))
    edge = rim.sum(axis=1, keepdims=True) * step + x[0]  # of equal mass
    return np.square(rim - np.clip(0.5 - (x - edge), 0, 1)).sum(axis=1) * step


@lru_cache(maxsize=4096)
def _integrals(beta: float) -> tuple[float, float]:
    """Of f and of f^2 over the plane, in px^2 at sigma 1 px."""
    r = (np.arange(2000) + 0.5) / 2000 * float(cut_radius(beta))
    value, area = profile(r, beta), 2 * np.pi * r * (r[1] - r[0])
    return float(np.sum(value * area)), float(np.sum(value**2 * area))
