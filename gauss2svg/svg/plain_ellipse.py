"""Shapes that a plain ellipse, without a gradient, draws as well.

A renderer draws the edge of a filled ellipse by the coverage of each pixel: a ramp one pixel wide.
A crisp rim of the falloff looks the same where it is about that wide,

    f(x) = exp(-exp(x ln(ln 0.1 / ln 0.9) / width)),  width = RIM_WIDTH / (beta |grad r|) px,

with x the distance from the rim outwards and |grad r| the growth of the Mahalanobis distance per
pixel there. The squared difference of the two, integrated along the rim, is compared with the
squared mass of the shape and with the length of the rim (docs/decisions/svg.md).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import PLAIN, Scene
from gauss2svg.scene.falloff import MOST_BETA, RIM_WIDTH, cut_radius, profile

# Profiles of smaller exponents have no flat top.
LEAST_PLAIN_BETA = 3.0
_DIRECTIONS = 16  # in one quadrant; the others mirror it
_WIDTHS = np.geomspace(0.05, 8, 48)  # px
# Exponents that plain_beta tries: steps of 6 % change a rim a pixel wide by a sixteenth of one.
_GRID = tuple(np.round(np.geomspace(LEAST_PLAIN_BETA, MOST_BETA, 78), 2).tolist())


# Largest errors at which a shape is drawn as a plain ellipse (docs/decisions/svg.md).
LARGEST_ERROR = 0.003  # share of the squared mass: a compromise of PSNR and bytes
# Px, times the rim's length: the error of rims of 0.5 and of 1.2 px. Without this limit large
# soft discs would become visibly crisper.
LARGEST_ON_RIM = 0.013
# Px of rim across the major axis under which a shape is a plain ellipse, whose edge, of about a
# pixel, is no crisper.
CRISP_RIM = 1.0


def is_plain(scene: Scene) -> NDArray[np.bool_]:
    """(n,) whether a file draws a shape by a plain ellipse: as it says, or as that looks the same.

    The latter is at the size of the scene's canvas: on a larger one rims are wider.
    """
    return (scene.drawn == PLAIN) | looks_plain(scene.ellipse_axes[0], scene.beta)


def looks_plain(axes: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) whether an ellipse differs by no more than a small share of squared mass and rim.

    axes  (n, 2) one-sigma semi-axes in px, larger first
    beta  (n,) exponents
    """
    plain = beta >= LEAST_PLAIN_BETA
    if plain.any():
        plain[plain] = _strain(axes[plain], beta[plain]) <= 1
    return plain


def plain_beta(semi_axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) exponent whose profile a plain ellipse of semi_axes (n, 2) px, larger first, draws best.

    Its error by the measure of is_plain is smallest, so that a shape written as a plain ellipse is
    plain again. From about 180 px on, at the largest exponent, the profile's rim is softer than
    the ellipse's.
    """
    grade = plain_radius(np.array(_GRID))
    # Where the rim across the minor axis is 0.7 px wide; the best is a few steps from it.
    guess = np.searchsorted(0.7 / RIM_WIDTH * np.array(_GRID) * grade, semi_axes[:, 1])
    best = np.full(len(semi_axes), np.inf)
    beta = np.full(len(semi_axes), _GRID[0])
    for step in range(-8, 9):
        at = np.clip(guess + step, 0, len(_GRID) - 1)
        tried = np.array(_GRID)[at]
        strain = _strain(semi_axes / grade[at, None], tried)
        better = strain < best
        best[better], beta[better] = strain[better], tried[better]
    return beta


def is_arc(axes: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) whether an arc draws shapes of such one-sigma axes: nearly their rim, or a wider one."""
    across = RIM_WIDTH * axes[:, 0] / beta
    crisp = (beta >= LEAST_PLAIN_BETA) & (across < CRISP_RIM)
    return looks_plain(axes, beta) | crisp


def arc_beta(semi_axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) exponents of arcs round ellipses of semi_axes (n, 2) px, larger first.

    That which a plain ellipse draws best, or the crispest where a shape of the best one would be
    written as a soft shape: a thin one.
    """
    beta = plain_beta(semi_axes)
    axes = semi_axes / plain_radius(beta)[:, None]
    return np.where(is_arc(axes, beta), beta, MOST_BETA)


def _strain(axes: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) squared error of plain ellipses as a multiple of the largest one allowed."""
    angle_rad = (np.arange(_DIRECTIONS) + 0.5) * (0.5 * np.pi / _DIRECTIONS)
    along, across = np.cos(angle_rad), np.sin(angle_rad)
    growth = np.hypot(along / axes[:, :1], across / axes[:, 1:])
    width = RIM_WIDTH / (beta[:, None] * growth)
    length = np.hypot(axes[:, :1] * across, axes[:, 1:] * along)
    length *= math.sqrt(2) * 2 * np.pi / _DIRECTIONS
    error = (np.interp(np.log(width), np.log(_WIDTHS), _errors()) * length).sum(axis=1)
    squared_mass = np.array([_integrals(b)[1] for b in np.round(beta, 2)]) * axes.prod(axis=1)
    on_rim = LARGEST_ON_RIM * length.sum(axis=1)
    return error / np.minimum(LARGEST_ERROR * squared_mass, on_rim)


def plain_radius(beta: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) radii in sigmas of ellipses that cover what profiles of exponents (n,) sum up to."""
    return np.sqrt([_integrals(b)[0] / np.pi for b in np.round(beta, 2)])


def drawn_radius(beta: NDArray[np.float64], plain: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return (n,) radii in sigmas of the circles that are drawn, of plain ellipses where plain."""
    radius = cut_radius(beta)
    radius[plain] = plain_radius(beta[plain])
    return radius


def drawn_beta(scene: Scene, plain: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Exponents of the shapes that are plain, a mask (n,), as ellipses of their area draw best."""
    radius = plain_radius(scene.beta[plain])
    return plain_beta(scene.ellipse_axes[0][plain] * radius[:, None])


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
    """Integrals of f and of f^2 over the plane, in px^2 at sigma 1 px."""
    r = (np.arange(2000) + 0.5) / 2000 * float(cut_radius(beta))
    value, area = profile(r, beta), 2 * np.pi * r * (r[1] - r[0])
    return float(np.sum(value * area)), float(np.sum(value**2 * area))
