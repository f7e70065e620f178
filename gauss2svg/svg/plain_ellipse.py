"""Tests of whether a plain ellipse, without a gradient, draws a shape equally well.

A renderer draws the edge of a filled ellipse by the coverage of each pixel, as a ramp one pixel
wide. A crisp rim of the falloff looks the same if it is about that wide. Its profile is

    f(x) = exp(-exp(x ln(ln 0.1 / ln 0.9) / width)),  width = RIM_WIDTH / (beta |grad r|) px,

where x is the distance outwards from the rim, and |grad r| is the growth of the Mahalanobis
distance per pixel there. The squared difference of ramp and profile is integrated along the rim. It
is compared with the shape's squared mass and the rim's length (docs/decisions/svg.md).
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import PLAIN, Scene
from gauss2svg.scene.falloff import MOST_BETA, RIM_WIDTH, cut_radius, profile

# Least exponent of plain ellipses. Profiles of smaller exponents have no flat top.
LEAST_PLAIN_BETA = 3.0
_DIRECTIONS = 16  # directions in one quadrant, which the others mirror
_WIDTHS = np.geomspace(0.05, 8, 48)  # widths of rims in px
# Exponents that plain_beta tries. Steps of 6 % change the width of a 1 px rim by 0.06 px.
_GRID = tuple(np.round(np.geomspace(LEAST_PLAIN_BETA, MOST_BETA, 78), 2).tolist())


# Largest errors at which a shape is drawn as a plain ellipse (docs/decisions/svg.md).
LARGEST_ERROR = 0.003  # share of the squared mass, a compromise of PSNR and bytes
# Error in px for each px of the rim's length: that of rims 0.5 and 1.2 px wide. Without this limit
# large soft discs would become visibly crisper.
LARGEST_ON_RIM = 0.013
# Largest width in px, across the major axis, of a crisp rim. is_arc accepts crisp rims, because the
# edge of an ellipse, about a pixel wide, is no crisper.
CRISP_RIM = 1.0


def is_plain(scene: Scene) -> NDArray[np.bool_]:
    """Return whether a file draws each shape (n,) as a plain ellipse.

    It does if the shape is plain in the scene, or if an ellipse looks the same at the size of the
    scene's canvas. On a larger canvas rims are wider.
    """
    return (scene.drawn == PLAIN) | looks_plain(scene.ellipse_axes[0], scene.beta)


def looks_plain(axes: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether a plain ellipse looks like each shape (n,), within the limits on its error.

    axes  (n, 2) one-sigma semi-axes in px, larger first
    beta  (n,) exponents
    """
    plain = beta >= LEAST_PLAIN_BETA
    if plain.any():
        plain[plain] = _strain(axes[plain], beta[plain]) <= 1
    return plain


def plain_beta(semi_axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the exponents (n,) of the profiles that plain ellipses draw best.

    semi_axes  (n, 2) px, larger first

    The error that is_plain measures is smallest, so a shape written as a plain ellipse is plain
    when it is read. From about 180 px on, even the largest exponent has a softer rim than the
    ellipse.
    """
    grade = plain_radius(np.array(_GRID))
    # Begin at the exponent with a rim of 0.7 px across the minor axis. The best one is near it.
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
    """Return whether minimal markup draws each shape (n,) as an arc.

    It does if the ellipse looks the same, or if the exponent is at least LEAST_PLAIN_BETA and the
    rim is narrower than CRISP_RIM.

    axes  (n, 2) one-sigma semi-axes in px, larger first
    beta  (n,) exponents
    """
    across = RIM_WIDTH * axes[:, 0] / beta
    crisp = (beta >= LEAST_PLAIN_BETA) & (across < CRISP_RIM)
    return looks_plain(axes, beta) | crisp


def arc_beta(semi_axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the exponents (n,) of arcs round ellipses of semi_axes (n, 2) px, larger first.

    It is the exponent that a plain ellipse draws best. Thin shapes with that exponent would be
    written as soft shapes, so they get the largest exponent.
    """
    beta = plain_beta(semi_axes)
    axes = semi_axes / plain_radius(beta)[:, None]
    return np.where(is_arc(axes, beta), beta, MOST_BETA)


def _strain(axes: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the squared errors (n,) of plain ellipses as multiples of the largest one allowed."""
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
    """Return the radii (n,) in sigmas of ellipses with the mass of profiles of exponents (n,)."""
    return np.sqrt([_integrals(b)[0] / np.pi for b in np.round(beta, 2)])


def drawn_radius(beta: NDArray[np.float64], plain: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the radii (n,) in sigmas of plain ellipses, for the mask `plain`, or of gradients."""
    radius = cut_radius(beta)
    radius[plain] = plain_radius(beta[plain])
    return radius


def drawn_beta(scene: Scene, plain: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the exponents that ellipses draw best, for the shapes in the mask `plain` (n,)."""
    radius = plain_radius(scene.beta[plain])
    return plain_beta(scene.ellipse_axes[0][plain] * radius[:, None])


@lru_cache(maxsize=1)
def _errors() -> NDArray[np.float64]:
    """Return the integral in px of the squared difference across the rim, for each of _WIDTHS."""
    x = np.linspace(-12, 12, 4801)
    step = x[1] - x[0]
    grade = math.log(math.log(0.1) / math.log(0.9)) / _WIDTHS[:, None]
    rim = np.exp(-np.exp(np.minimum(grade * x, 30.0)))
    edge = rim.sum(axis=1, keepdims=True) * step + x[0]  # edge of equal mass
    return np.square(rim - np.clip(0.5 - (x - edge), 0, 1)).sum(axis=1) * step


@lru_cache(maxsize=4096)
def _integrals(beta: float) -> tuple[float, float]:
    """Return the integrals of f and of f^2 over the plane, in px^2 at sigma 1 px."""
    r = (np.arange(2000) + 0.5) / 2000 * float(cut_radius(beta))
    value, area = profile(r, beta), 2 * np.pi * r * (r[1] - r[0])
    return float(np.sum(value * area)), float(np.sum(value**2 * area))
