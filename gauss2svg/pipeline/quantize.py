"""Quantisation: fewer distinct pairs of a colour and an exponent, hence fewer gradients."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, must_be
from gauss2svg.pipeline.palette import best_palette, quantize_signed
from gauss2svg.render.cpu import removal_cost, splats_of
from gauss2svg.scene import ADD, Scene
from gauss2svg.svg.blur import GRADIENT, drawn_blurs
from gauss2svg.svg.plain import is_plain
from gauss2svg.svg.snap import snapped, with_exponents

# Colours are weighted by their visible mass, on a canvas of at most this side.
_WEIGHING_SIDE = 768


def quantize(
    scene: Scene, form: str = GRADIENT, palette: int = 0, color_error: float = 0.0
) -> Scene:
    """The scene with colours and exponents of a palette; the operation is idempotent.

    form         of the shapes in the file, "gradient" or "blur"
    palette      largest number of gradients, one for each pair of a colour and an exponent, in
                 proportion if some shapes are blurred; 0: no limit
    color_error  mean squared error that fewer gradients may add; 0: as many as the palette has

    Solid ellipses and blurred discs need no gradient and keep their colour, rounded to 8 bits. In
    an additive scene only colours are quantised, and not rounded. Raises InputError for an additive
    scene in another form than gradients.
    """
    if scene.blend == ADD:
        return _quantize_additive(scene, form, palette, color_error)
    exact, scene = scene, snapped(scene, form)
    blurred = (drawn_blurs(scene) >= 0) & (form != GRADIENT)
    shaded = ~is_plain(exact) & ~blurred
    if not shaded.any() or not (palette or color_error):
        return scene
    count = max(1, math.ceil(palette * (1 - blurred.mean()))) if palette else len(scene)
    weight, pixels = visible_mass(exact)
    found = best_palette(
        exact.color[shaded], exact.betas[shaded], weight[shaded], count, color_error * 3 * pixels
    )
    beta, color = scene.betas.copy(), scene.color.copy()
    color[shaded] = found.color[found.entry] / 255
    beta[shaded] = found.beta[found.entry]
    return with_exponents(exact, beta).replace(color=color)


def _quantize_additive(scene: Scene, form: str, palette: int, color_error: float) -> Scene:
    if form != GRADIENT:
        raise InputError(must_be("form", f"{GRADIENT!r} for an additive scene", form))
    if not len(scene) or not (palette or color_error):
        return scene
    weight, pixels = visible_mass(scene)
    count = palette or len(scene)
    return scene.replace(
        color=quantize_signed(scene.color, weight, count, color_error * 3 * pixels)
    )


def visible_mass(scene: Scene) -> tuple[NDArray[np.float64], int]:
    """(n,) visible mass of each shape, sum over the canvas of (alpha transmittance)^2, in px.

    And the pixels of the canvas that it was computed on, which is reduced if large. A change d of
    a colour changes the total squared error by visible_mass d^2.
    """
    shrunk = min(1.0, _WEIGHING_SIDE / max(scene.width, scene.height))
    width, height = (max(1, round(side * shrunk)) for side in (scene.width, scene.height))
    splats = splats_of(scene, (width / scene.width, height / scene.height))
    blank = np.zeros((3, height, width), np.float32)
    return np.maximum(removal_cost(splats, blank)[1][:, 1], 0.0), width * height
