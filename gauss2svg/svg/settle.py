"""What of a scene a file keeps: exponents in classes, colours of a palette, plain ellipses."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gauss2svg.falloff import widening
from gauss2svg.render.cpu import removal_cost, splats_of
from gauss2svg.scene import Scene
from gauss2svg.svg.blur import blur_index, blurs
from gauss2svg.svg.options import SvgOptions
from gauss2svg.svg.palette import quantize
from gauss2svg.svg.plain import is_plain

# Colours are weighted by what shows of them, measured on a picture of this side.
_WEIGHING_SIDE = 768


def settled(scene: Scene, options: SvgOptions) -> Scene:
    """The scene as its file has it, save for the rounding of numbers.

    Gradients are shared by colour and exponent: both become those of a palette, and a shape's
    extent changes with its exponent so that its half-way rim stays. Plain ellipses and blurred
    discs need no gradient: they keep their colour, on 8 bits, plain ones their exponent as well.
    """
    blur = blur_index(scene, options.form)
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
    sigma *= widening(scene.betas, beta)[:, None]
    return scene.replace(beta=beta, sigma=sigma, color=color)


def visible_mass(scene: Scene) -> tuple[NDArray[np.float64], int]:
    """(n,) sum over the canvas of (alpha transmittance)^2, in px: what shows of a shape.

    Also the pixels of the canvas that it was measured on, reduced where that is large.
    A change d of a colour changes the summed squared error by visible_mass d^2.
    """
    shrunk = min(1.0, _WEIGHING_SIDE / max(scene.width, scene.height))
    width, height = (max(1, round(side * shrunk)) for side in (scene.width, scene.height))
    splats = splats_of(scene.scaled(width / scene.width, height / scene.height))
    blank = np.zeros((3, height, width), np.float32)
    return np.maximum(removal_cost(splats, blank)[1][:, 1], 0.0), width * height
