"""Quantisation: fewer distinct colours and exponents, hence fewer gradients."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, quoted, required
from gauss2svg.pipeline.palette import best_palette, quantize_signed
from gauss2svg.render.cpu import removal_cost, splats_of
from gauss2svg.scene import ADD, PLAIN, Scene
from gauss2svg.scene.falloff import RIM_WIDTH, covered_radius
from gauss2svg.svg.blur import GRADIENT, drawn_blurs
from gauss2svg.svg.plain_ellipse import drawn_beta, is_plain
from gauss2svg.svg.snap import snapped, with_falloffs

# Shapes of a drawing that are edges (docs/decisions/enlarged.md).
RIM = 1.5  # longest rim of an edge, px across the minor axis from .9 to .1
# Least distance in px from the middle to the edge. What is thinner cannot be seen to be crisp,
# and is closer as it was fitted.
HALF = 1.0


def quantize(
    scene: Scene,
    form: str = GRADIENT,
    palette: int = 0,
    color_error: float = 0.0,
    weight: NDArray[np.floating] | None = None,
) -> Scene:
    """Return the scene with colours and exponents of a palette; the operation is idempotent.

    form         of the shapes in the file, "gradient" or "blur"
    palette      largest number of gradients, one for each colour and exponent, in proportion if
                 some shapes are blurred; 0: no limit
    color_error  mean squared error that fewer gradients may add; 0: as many as the palette has
    weight       (h, w) of a pixel's error, of any size and mean 1; None: 1 everywhere

    Plain ellipses and blurred discs need no gradient and keep their colour, rounded to 8 bits. In
    an additive scene only colours are quantised, and not rounded. Raises InputError for an additive
    scene in another form than gradients.
    """
    if required(scene, "scene", Scene).blend == ADD:
        return _quantize_additive(scene, form, palette, color_error, weight)
    exact, scene = scene, snapped(scene, form)
    blurred = (drawn_blurs(scene) >= 0) & (form != GRADIENT)
    shaded = ~is_plain(exact) & ~blurred
    if not shaded.any() or not (palette or color_error):
        return scene
    count = max(1, math.ceil(palette * (1 - blurred.mean()))) if palette else len(scene)
    mass, pixels = visible_mass(exact, weight)
    found = best_palette(
        exact.color[shaded], exact.beta[shaded], mass[shaded], count, color_error * 3 * pixels,
    )  # fmt: skip
    beta, color = scene.beta.copy(), scene.color.copy()
    color[shaded] = found.color[found.entry] / 255
    beta[shaded] = found.beta[found.entry]
    return with_falloffs(exact, beta).replace(color=color, drawn=scene.drawn)


def with_plain_edges(scene: Scene) -> Scene:
    """The scene whose crisp shapes are plain ellipses whatever their size.

    They keep their contour of half height. In a fit that goes on such a shape counts by how much of
    each pixel it covers.
    """
    minor = scene.ellipse_axes[0][:, 1]
    crisp = RIM_WIDTH * minor < RIM * scene.beta
    plain = is_plain(scene) | (crisp & (minor * covered_radius(scene.beta) > HALF))
    beta = scene.beta.copy()
    beta[plain] = drawn_beta(scene, plain)
    return with_falloffs(scene, beta).replace(drawn=np.where(plain, PLAIN, scene.drawn))


def _quantize_additive(
    scene: Scene, form: str, palette: int, color_error: float, weight: NDArray[np.floating] | None
) -> Scene:
    if form != GRADIENT:
        raise InputError(f"form must be {GRADIENT!r} for an additive scene; got {quoted(form)}")
    if not len(scene) or not (palette or color_error):
        return scene
    mass, pixels = visible_mass(scene, weight)
    count = palette or len(scene)
    return scene.replace(color=quantize_signed(scene.color, mass, count, color_error * 3 * pixels))


def visible_mass(
    scene: Scene, weight: NDArray[np.floating] | None = None
) -> tuple[NDArray[np.float64], int]:
    """(n,) visible mass in px of each shape, sum over the canvas of weight (alpha transmittance)^2.

    And the pixels of the canvas that it was computed on, which is reduced if large. A change d of
    a colour changes the weighted sum of squared errors by visible_mass d^2. weight is as for
    `quantize`.
    """
    # On a canvas of at most this side, which is enough for weights.
    shrunk = min(1.0, 768 / max(scene.width, scene.height))
    width, height = (max(1, round(side * shrunk)) for side in (scene.width, scene.height))
    splats = splats_of(scene, (width / scene.width, height / scene.height))
    blank = np.zeros((3, height, width), np.float32)
    if weight is not None:
        rows, columns = (
            ((np.arange(n) + 0.5) * m / n).astype(np.intp)
            for n, m in zip((height, width), weight.shape, strict=True)
        )
        weight = weight[np.ix_(rows, columns)]
    return np.maximum(removal_cost(splats, blank, weight)[1][:, 1], 0.0), width * height
