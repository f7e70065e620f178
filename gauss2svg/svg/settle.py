"""What of a scene a file keeps: exponents in classes, colours of a palette, plain ellipses."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.falloff import widening
from gauss2svg.render.cpu import removal_cost, splats_of
from gauss2svg.scene import ADD, LEAST_SIGMA, MOST_SIGMA, Scene
from gauss2svg.svg.blur import GRADIENT, HYBRID, blurs, chosen_blurs, drawn_blurs
from gauss2svg.svg.options import SvgOptions
from gauss2svg.svg.palette import quantize, quantize_signed
from gauss2svg.svg.plain import is_plain

# Colours are weighted by what shows of them, measured on a picture of this side.
_WEIGHING_SIDE = 768
# Of a file: a gradient without stops, a stop, a shape's reference to a filter.
_GRADIENT_BYTES, _STOP_BYTES, _REFERENCE_BYTES = 100, 57, 17


def settled(scene: Scene, options: SvgOptions) -> Scene:
    """The scene as its file has it, save for the rounding of numbers.

    Gradients are shared by colour and exponent: both become those of a palette, and a shape's
    extent changes with its exponent so that its half-way rim stays. Plain ellipses and blurred
    discs need no gradient: they keep their colour, on 8 bits, plain ones their exponent as well.
    Of an additive scene colours alone become those of a palette, and are not rounded.
    Raises InputError for an additive scene in another form than gradients.
    """
    if scene.blend == ADD:
        return _settled_sum(scene, options)
    blur = chosen_blurs(scene, options.form)
    if options.form == HYBRID and not _blurs_save_bytes(scene, options):
        blur = np.where(drawn_blurs(scene) >= 0, blur, -1)
    blurred = blur >= 0
    shaded = ~is_plain(scene) & ~blurred
    beta, sigma, color = scene.betas.copy(), scene.sigma.copy(), np.round(scene.color * 255) / 255
    beta[blurred] = [blurs()[k].beta for k in blur[blurred]]
    if shaded.any():
        count = len(scene)
        if options.palette:
            count = max(1, math.ceil(options.palette * (1 - blurred.mean())))
        weight, pixels = np.ones(len(scene)), 1
        if options.palette or options.color_error:
            weight, pixels = visible_mass(scene)
        palette = quantize(
            scene.color[shaded], beta[shaded], weight[shaded], count,
            options.color_error * 3 * pixels,
        )  # fmt: skip
        color[shaded] = palette.color[palette.entry] / 255
        beta[shaded] = palette.beta[palette.entry]
    sigma = np.clip(sigma * widening(scene.betas, beta)[:, None], LEAST_SIGMA, MOST_SIGMA)
    return scene.replace(beta=beta, sigma=sigma, color=color)


def _settled_sum(scene: Scene, options: SvgOptions) -> Scene:
    if options.form != GRADIENT:
        raise InputError(
            f"form is {options.form!r}, and the scene's blend 'add'; needed is {GRADIENT!r}: "
            "blurs cannot be summed exactly"
        )
    if not len(scene) or not (options.palette or options.color_error):
        return scene
    weight, pixels = visible_mass(scene)
    count = options.palette or len(scene)
    allowed = options.color_error * 3 * pixels
    return scene.replace(color=quantize_signed(scene.color, weight, count, allowed))


def _blurs_save_bytes(scene: Scene, options: SvgOptions) -> bool:
    """Whether the gradients of fewer shapes are shorter by more than references to filters are."""
    shaded = drawn_blurs(scene) < 0  # those that are blurred already have paid
    if not shaded.any():
        return True
    by_gradients = settled(scene.select(shaded), dataclasses.replace(options, form=GRADIENT))
    by_gradients = by_gradients.select(~is_plain(by_gradients))
    pairs = np.column_stack([by_gradients.color, by_gradients.betas])
    gradients = len(np.unique(pairs.round(6), axis=0))
    gradient_bytes = _GRADIENT_BYTES + _STOP_BYTES * options.stops
    return gradients * gradient_bytes > _REFERENCE_BYTES * len(by_gradients)


def visible_mass(scene: Scene) -> tuple[NDArray[np.float64], int]:
    """(n,) sum over the canvas of (alpha transmittance)^2, in px: what shows of a shape.

    Also the pixels of the canvas that it was measured on, reduced where that is large.
    A change d of a colour changes the summed squared error by visible_mass d^2.
    """
    shrunk = min(1.0, _WEIGHING_SIDE / max(scene.width, scene.height))
    width, height = (max(1, round(side * shrunk)) for side in (scene.width, scene.height))
    splats = splats_of(scene, (width / scene.width, height / scene.height))
    blank = np.zeros((3, height, width), np.float32)
    return np.maximum(removal_cost(splats, blank)[1][:, 1], 0.0), width * height
