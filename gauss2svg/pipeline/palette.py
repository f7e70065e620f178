"""Quantisation of a scene's colours and exponents to a palette, by weighted k-means.

The file has one gradient for each entry of the palette, so fewer entries make a smaller file.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.errors import quoted, refusal, required
from gauss2svg.pipeline.clusters import Rows, few_entries
from gauss2svg.pipeline.hues import LARGEST_CHANGE, HueChange, keep_hues
from gauss2svg.render.cpu import visible_mass
from gauss2svg.scene import ADD, BLURRED, SOFT, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, nearest_class
from gauss2svg.svg.forms import GRADIENT, as_written, is_plain, with_falloffs

# Shapes are clustered by their colours, which are in 0..1, and by their exponents beta. For this,
# ln beta is multiplied by this factor. This value of the factor is the best for photos, and nearly
# the best for files of few bytes.
BETA_WEIGHT = 0.1
# If there are as many entries as allowed, and they change hues, this share of them is left to the
# parts whose hue would change. If an error decides their number, the entries that are added are at
# most the larger of LEAST_ADDED and a share ADDED of the shapes, because a gradient takes as many
# bytes as three shapes.
FOR_HUES, ADDED, LEAST_ADDED = 0.1, 0.06, 4
PAYS = 0.9  # the largest change of hue must fall to this share, or the palette stays as it is


def best_palette(
    color: Rows,
    beta: Rows,
    weight: Rows,
    count: int,
    allowed: float = 0.0,
    change: HueChange | None = None,
) -> tuple[Rows, Rows, NDArray[np.intp]]:
    """Choose a palette for n shapes. Each of its entries is a pair of a colour and an exponent.

    Return the colours (k, 3) of the entries in 0..1, their exponents (k,), and for each shape the
    index (n,) of its entry.

    color    (n, 3) colours of the shapes in 0..1
    beta     (n,) exponents of the shapes
    weight   (n,) weights of the shapes, >= 0
    count    largest number of entries
    allowed  largest error that the palette may cause, see below
    change   if it is given, small parts of its scene keep their hue. This takes some more entries

    Weighted k-means on the vectors (color, BETA_WEIGHT ln beta) minimises the error

        sum of weight |difference of a shape's vector from that of its entry|^2.

    If the weights are the visible masses of the shapes, the colours' part of this sum is the
    squared error that the palette adds to the image. Colours are rounded to 8 bits and exponents to
    BETA_CLASSES. If `allowed` is 0, and there are at most `count` different pairs, all of them are
    kept. If `allowed` is larger, the palette has about the fewest entries whose error is at most
    `allowed`. The result is deterministic, because the first clusters come from repeated splits.
    """
    features = np.column_stack([color, BETA_WEIGHT * portable.log(_class_of(beta))])
    entries, entry = few_entries(features, weight, count, allowed, _rounded)
    if change is not None and (before := change.largest(entries[entry, :3])) > LARGEST_CHANGE:
        most, palette = count - math.ceil(FOR_HUES * count), (entries, entry)
        if len(entries) > most:
            palette = few_entries(features, weight, most, allowed, _rounded)
        else:
            count = min(count, len(entries) + max(LEAST_ADDED, round(ADDED * len(entry))))
        palette = keep_hues(change, features, palette, count, _rounded)
        if change.largest(palette[0][palette[1], :3]) < PAYS * before:
            entries, entry = palette
    return entries[:, :3], _class_of(portable.exp(entries[:, 3] / BETA_WEIGHT)), entry


def _class_of(beta: Rows) -> Rows:
    return np.array(BETA_CLASSES)[nearest_class(beta)]


def _rounded(features: Rows) -> Rows:
    """Round colours to 8 bits and exponents to their classes."""
    classes = _class_of(portable.exp(features[:, 3] / BETA_WEIGHT))
    return np.column_stack(
        [np.round(features[:, :3] * 255) / 255, BETA_WEIGHT * portable.log(classes)]
    )


def quantize(
    scene: Scene,
    form: str = GRADIENT,
    palette: int = 0,
    color_error: float = 0.0,
    weight: NDArray[np.floating] | None = None,
) -> Scene:
    """Return the scene with the colours and exponents of a palette.

    A second call with the result and the same palette changes nothing.

    form         form of the shapes in the file, "gradient" or "blur"
    palette      largest number of entries. The file has a gradient for each. If a share of the
                 shapes is blurred, the number is reduced by this share. 0: no limit
    color_error  largest mean squared error that the palette may add to the image. The larger it is,
                 the fewer gradients there are. 0: as many gradients as `palette` allows
    weight       (h, w) weights of the pixels' errors, with mean 1. Their size may differ from that
                 of the scene. None: 1 everywhere

    Plain ellipses and blurred discs need no gradient. They keep their colour, rounded to 8 bits. In
    an additive scene only the colours are quantised, and they are not rounded. Raise InputError for
    an additive scene if the form is not "gradient".
    """
    additive = required(scene, "scene", Scene).blend == ADD
    if additive and form != GRADIENT:
        raise refusal("form", f"{GRADIENT!r} for an additive scene", quoted(form))
    written = as_written(scene, form)
    blurred = written.drawn == BLURRED
    # A shape that only looks the same as a plain ellipse stays soft, because a fit may change it.
    if not additive:
        soft = np.where(scene.drawn == BLURRED, SOFT, scene.drawn)
        written = written.replace(drawn=np.where(blurred, BLURRED, soft))
    shaded = ~is_plain(scene) & ~blurred
    if not shaded.any() or not (palette or color_error):
        return written
    count = max(1, math.ceil(palette * (1 - blurred.mean()))) if palette else len(scene)
    mass, pixels = visible_mass(scene, weight)
    allowed = color_error * 3 * pixels
    if additive:
        entries, entry = few_entries(scene.color, mass, count, allowed, lambda colors: colors)
        return scene.replace(color=entries[entry])
    shades = scene.color[shaded], scene.beta[shaded], mass[shaded]
    colors, exponents, entry = best_palette(*shades, count, allowed, HueChange(scene, shaded))
    beta, color = written.beta.copy(), written.color.copy()
    color[shaded], beta[shaded] = colors[entry], exponents[entry]
    return with_falloffs(scene, beta).replace(color=color, drawn=written.drawn)
