"""Exponents, skews and colours as a file can hold them, before any palette."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import ADD, BLURRED, LEAST_SIGMA, MOST_MEAN, MOST_SIGMA, PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import (
    BETA_CLASSES,
    cut_radius,
    half_radius,
    nearest_class,
    with_length,
    written_skew,
)
from gauss2svg.svg.blur import BLURS, chosen_blurs
from gauss2svg.svg.plain_ellipse import is_plain


def snapped(scene: Scene, form: str) -> Scene:
    """The scene with exponents, skews and colours as a file of this form; `snapped` of it is it.

    Exponents become those of BETA_CLASSES, or in the form blur those of blurred discs, and lengths
    of skews those of written_skew; sigma and mean change with them so that the contour of half
    height stays. Plain ellipses keep their exponent; they, blurred discs and exponents from
    SYMMETRIC_FROM on have no skew. Colours are rounded to 8 bits. Additive scenes are returned as
    they are: their stops are computed from exact colours.
    """
    if scene.blend == ADD:
        return scene
    blur = chosen_blurs(scene, form)
    blurred = blur >= 0
    plain = is_plain(scene)
    shaded = ~plain & ~blurred
    beta = scene.beta.copy()
    beta[blurred] = [BLURS[k].beta for k in blur[blurred]]
    beta[shaded] = np.array(BETA_CLASSES)[nearest_class(beta[shaded])]
    length = np.where(shaded, written_skew(np.hypot(*scene.skew.T), beta), 0.0)
    drawn = np.where(blurred, BLURRED, np.where(scene.drawn == PLAIN, PLAIN, SOFT))
    color = np.round(scene.color * 255) / 255
    skew = with_length(scene.skew, length)
    return with_falloffs(scene, beta, skew).replace(color=color, drawn=drawn)


def with_falloffs(
    scene: Scene, beta: NDArray[np.float64], skew: NDArray[np.float64] | None = None
) -> Scene:
    """The scene with other exponents (n,) and skews (n, 2), None for its own.

    Each shape keeps its contour of half height: the ellipse of radius half_radius(beta) round
    mean + (cut_radius(beta) - half_radius(beta)) L f, with L its covariance's Cholesky factor.
    """
    skew = scene.skew if skew is None else skew
    sigma = scene.sigma * (half_radius(scene.beta) / half_radius(beta))[:, None]
    changed = scene.replace(beta=beta, skew=skew, sigma=np.clip(sigma, LEAST_SIGMA, MOST_SIGMA))
    moved = half_centers(scene) - half_centers(changed)
    # A shape at the end of the domain stays within it.
    return changed.replace(mean=np.clip(scene.mean + moved, -MOST_MEAN, MOST_MEAN))


def half_centers(scene: Scene) -> NDArray[np.float64]:
    """(n, 2) offsets in px from the means to the centres of the contours of half height."""
    out = (cut_radius(scene.beta) - half_radius(scene.beta))[:, None] * scene.skew
    return np.einsum("nij,nj->ni", scene.factor, out)
