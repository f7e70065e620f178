"""Quantisation to a palette, by weighted k-means on colours and exponents.

The file has a gradient for each entry of the palette, so fewer entries make a smaller file.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import quoted, refusal, required
from gauss2svg.render.weights import visible_mass
from gauss2svg.scene import ADD, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, nearest_class
from gauss2svg.svg.forms import GRADIENT, drawn_blurs, is_plain, snapped, with_falloffs
from gauss2svg.without_scipy import nearest_entry

# Constants of the search for a palette (docs/decisions/palette.md).
ITERATIONS = 6  # iterations of Lloyd's algorithm. Twice as many gain under 2 %
# Splitting ends at this multiple of the allowed error. Lloyd's iterations then remove about a tenth
# of the error.
SPARE = 1.12
LESS = 0.94  # factor on SPARE each time that the error is still too large after Lloyd's iterations
LEAST_AIM = 0.1  # multiple of the allowed error below which the search gives up
# Weight of ln beta relative to colours in 0..1. It is the best weight for photos, and nearly the
# best for files of few bytes.
BETA_WEIGHT = 0.1
Rows = NDArray[np.float64]


def best_palette(
    color: Rows, beta: Rows, weight: Rows, count: int, allowed: float = 0.0
) -> tuple[Rows, Rows, NDArray[np.intp]]:
    """Choose a palette of at most `count` pairs of a colour and an exponent.

    Return the colours (k, 3) in 0..1 of its entries, their exponents (k,), and the index (n,) of
    each shape's entry.

    Weighted k-means on color (n, 3) in 0..1 and BETA_WEIGHT ln beta (n,) minimises

        sum weight |difference|^2.

    The colour part of this sum is the squared error of the image if weight (n,) >= 0 is the visible
    mass of each shape. Colours are rounded to 8 bits and exponents to BETA_CLASSES. If `allowed` is
    0, all pairs are kept if they are at most `count`. If it is larger, about the fewest entries
    that keep the sum under it are used. The result is deterministic, because the
    first clusters come from repeated splits.
    """
    features = np.column_stack([color, BETA_WEIGHT * np.log(_class_of(beta))])
    entries, entry = few_entries(features, weight, count, allowed, _rounded)
    return entries[:, :3], _class_of(np.exp(entries[:, 3] / BETA_WEIGHT)), entry


def few_entries(
    features: Rows, weight: Rows, count: int, allowed: float, rounded: Callable[[Rows], Rows]
) -> tuple[Rows, NDArray[np.intp]]:
    """Return at most `count` entries (k, d) for features (n, d), and the entry (n,) of each.

    allowed  weighted squared error that may be added so that there are fewer entries. 0: none
    rounded  function that rounds features to values that a file can have
    """
    kept, entry_kept = np.unique(rounded(features), axis=0, return_inverse=True)
    exact, distinct = (kept, entry_kept.reshape(-1)), len(kept)
    if distinct <= 1 or (allowed <= 0 and distinct <= count):
        return exact
    floor = max(float(weight.mean()), np.finfo(np.float64).tiny) * 1e-3
    weight = weight + floor  # hardly visible colours count a little

    def loss(entries: Rows, entry: NDArray[np.intp]) -> float:
        return float(np.sum(weight * np.square(entries[entry] - features).sum(axis=1)))

    def refined(entries: Rows) -> tuple[Rows, NDArray[np.intp]]:
        """Return the entries after Lloyd's iterations, and the entry of each feature."""
        for _ in range(ITERATIONS):
            entry = nearest_entry(entries, features)[1]
            mass = np.bincount(entry, weight, len(entries))
            sums = [np.bincount(entry, weight * column, len(entries)) for column in features.T]
            entries = np.stack(sums, axis=1)[mass > 0] / mass[mass > 0, None]
        entries = np.unique(rounded(entries), axis=0)
        return entries, nearest_entry(entries, features)[1]

    if distinct <= count and loss(*exact) > allowed:
        return exact  # rounding alone loses more than is allowed
    most, aim = min(count, distinct), allowed * SPARE
    while True:
        means, left = _split(features, weight, most, aim)
        entries, entry = refined(means)
        if loss(entries, entry) <= allowed:
            return entries, entry
        if left > aim or len(means) >= most or aim <= allowed * LEAST_AIM:
            # No palette reaches `allowed`, because the rest of the error is rounding.
            return exact if distinct <= count else (entries, entry)
        aim *= LESS


def _class_of(beta: Rows) -> Rows:
    return np.array(BETA_CLASSES)[nearest_class(beta)]


def _rounded(features: Rows) -> Rows:
    """Round colours to 8 bits and exponents to their classes."""
    classes = _class_of(np.exp(features[:, 3] / BETA_WEIGHT))
    return np.column_stack([np.round(features[:, :3] * 255) / 255, BETA_WEIGHT * np.log(classes)])


def _split(features: Rows, weight: Rows, count: int, aim: float) -> tuple[Rows, float]:
    """Return the means (k, d) of k <= count clusters, and the squared error that is left.

    The cluster with the largest error is cut at its mean, across its direction of largest variance,
    until the total error is at most `aim` (Wan, Wong and Prusinkiewicz, "An algorithm for
    multidimensional data clustering", 1988).
    """

    def cluster(members: NDArray[np.intp]) -> tuple[float, int, NDArray, NDArray, NDArray]:
        share = weight[members, None]
        mean = (share * features[members]).sum(axis=0) / share.sum()
        offset = features[members] - mean
        spread = (share * offset).T @ offset
        axis = np.linalg.eigh(spread)[1][:, -1]
        # The first member orders clusters of equal error, so that arrays are never compared.
        return -float(np.trace(spread)), int(members[0]), members, mean, offset @ axis > 0

    heap = [cluster(np.arange(len(features)))]
    left = -heap[0][0]
    while len(heap) < count and left > aim:
        worst, _, members, _, above = heap[0]
        if above.all() or not above.any():  # all members are equal
            break
        parts = cluster(members[above]), cluster(members[~above])
        heapq.heapreplace(heap, parts[0])
        heapq.heappush(heap, parts[1])
        left += worst - parts[0][0] - parts[1][0]
    return np.array([mean for _, _, _, mean, _ in heap]), left


def quantize(
    scene: Scene,
    form: str = GRADIENT,
    palette: int = 0,
    color_error: float = 0.0,
    weight: NDArray[np.floating] | None = None,
) -> Scene:
    """Return the scene with the colours and exponents of a palette. The operation is idempotent.

    form         form of the shapes in the file, "gradient" or "blur"
    palette      largest number of gradients, one for each colour and exponent. If some shapes are
                 blurred, this number shrinks by their share. 0: no limit
    color_error  mean squared error that fewer gradients may add. 0: gradients up to the limit
    weight       (h, w) weight of each pixel's error, of any size and mean 1. None: 1 everywhere

    Plain ellipses and blurred discs need no gradient and keep their colour, rounded to 8 bits. In
    an additive scene only colours are quantised, and they are not rounded. Raise InputError for an
    additive scene if the form is not "gradient".
    """
    additive, exact = required(scene, "scene", Scene).blend == ADD, scene
    if additive and form != GRADIENT:
        raise refusal("form", f"{GRADIENT!r} for an additive scene", quoted(form))
    scene = scene if additive else snapped(scene, form)
    blurred = (drawn_blurs(scene) >= 0) & (form != GRADIENT)
    shaded = ~is_plain(exact) & ~blurred
    if not shaded.any() or not (palette or color_error):
        return scene
    count = max(1, math.ceil(palette * (1 - blurred.mean()))) if palette else len(scene)
    mass, pixels = visible_mass(exact, weight)
    allowed = color_error * 3 * pixels
    if additive:
        entries, entry = few_entries(scene.color, mass, count, allowed, lambda colors: colors)
        return scene.replace(color=entries[entry])
    shades = exact.color[shaded], exact.beta[shaded], mass[shaded]
    colors, exponents, entry = best_palette(*shades, count, allowed)
    beta, color = scene.beta.copy(), scene.color.copy()
    color[shaded], beta[shaded] = colors[entry], exponents[entry]
    return with_falloffs(exact, beta).replace(color=color, drawn=scene.drawn)
