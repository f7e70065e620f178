"""Exponents and colours as a file can hold them, before any palette."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import ADD, BLURRED, LEAST_SIGMA, MOST_SIGMA, PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, half_radius, nearest_class
from gauss2svg.svg.blur import BLURS, chosen_blurs
from gauss2svg.svg.plain_ellipse import is_plain


def snapped(scene: Scene, form: str) -> Scene:
    """Return the scene with exponents and colours as in a file of this form; idempotent.

    Exponents become those of BETA_CLASSES, or in the form blur those of blurred discs. Sigma
    changes with them so that the contour of half height stays. Plain ellipses keep their exponent.
    Colours are rounded to 8 bits. Additive scenes are returned as they are: their stops are
    computed from exact colours.
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
    drawn = np.where(blurred, BLURRED, np.where(scene.drawn == PLAIN, PLAIN, SOFT))
    color = np.round(scene.color * 255) / 255
    return with_falloffs(scene, beta).replace(color=color, drawn=drawn)


def with_falloffs(scene: Scene, beta: NDArray[np.float64]) -> Scene:
    """Return the scene with other exponents (n,); each shape keeps its contour of half height."""
    sigma = scene.sigma * (half_radius(scene.beta) / half_radius(beta))[:, None]
    return scene.replace(beta=beta, sigma=np.clip(sigma, LEAST_SIGMA, MOST_SIGMA))
