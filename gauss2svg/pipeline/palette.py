"""Quantisation to a palette, by weighted k-means on colours and exponents.

A palette has a gradient for each of its entries, so fewer entries make a smaller file.
"""

from __future__ import annotations

import dataclasses
import heapq
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, quoted, required
from gauss2svg.render.cpu import removal_cost, splats_of
from gauss2svg.scene import ADD, PLAIN, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, RIM_WIDTH, covered_radius, nearest_class
from gauss2svg.scene.nearest import nearest_entry
from gauss2svg.svg.blur import GRADIENT, drawn_blurs, snapped, with_falloffs
from gauss2svg.svg.plain_ellipse import drawn_beta, is_plain

# Search for a palette (docs/decisions/palette.md).
ITERATIONS = 6  # iterations of Lloyd's algorithm; twice as many gain under 2 %
# Multiple of the allowed error until which clusters are split, because Lloyd's iterations remove
# about a tenth of it.
SPARE = 1.12
LESS = 0.94  # factor of that multiple if Lloyd's iterations remove less than a tenth
LEAST_AIM = 0.1  # multiple of the allowed error under which no palette suffices
# Weight of ln beta beside colours in 0..1: the best for photos and near the best at few bytes.
BETA_WEIGHT = 0.1
_Entries = tuple[NDArray[np.float64], NDArray[np.intp]]


@dataclass(frozen=True)
class Palette:
    """k entries: 8-bit sRGB color (k, 3) and exponent beta (k,); entry (n,) of each shape."""

    color: NDArray[np.uint8]
    beta: NDArray[np.float64]
    entry: NDArray[np.intp]


def best_palette(
    color: NDArray[np.float64],
    beta: NDArray[np.float64],
    weight: NDArray[np.float64],
    count: int,
    allowed: float = 0.0,
) -> Palette:
    """Return at most `count` pairs of a colour and an exponent, and the one of each shape.

    Weighted k-means on color (n, 3) in 0..1 and beta_weight ln beta (n,) minimises

        sum weight |difference|^2,

    whose colour part is the squared error of the image if weight (n,) >= 0 is the squared visible
    mass of a shape. Pairs that are few enough already are kept, colours rounded to 8 bits and
    exponents to BETA_CLASSES. If `allowed` > 0, about as few entries are used as keep the sum under
    it. The result is deterministic: it starts from clusters that are split again and again.
    """
    classes = np.array(BETA_CLASSES)[nearest_class(beta)]
    features = _stacked(color, classes)

    def written(palette: Palette) -> NDArray[np.float64]:
        return _stacked(palette.color / 255, palette.beta)

    exact = _rounded(features)
    kept = written(exact), exact.entry
    entries, entry = _few(features, weight, count, allowed, kept, lambda e: written(_rounded(e)))
    return dataclasses.replace(_rounded(entries), entry=entry)


def quantize_signed(
    color: NDArray[np.float64], weight: NDArray[np.float64], count: int, allowed: float = 0.0
) -> NDArray[np.float64]:
    """Signed colours (n, 3) with at most `count` different ones, in place of color (n, 3).

    As in `best_palette`, without exponents and without rounding.
    """
    distinct, entry = np.unique(color, axis=0, return_inverse=True)
    kept = distinct, entry.reshape(-1)
    entries, entry = _few(color, weight, count, allowed, kept, lambda means: means)
    return entries[entry]


def _few(
    features: NDArray[np.float64],
    weight: NDArray[np.float64],
    count: int,
    allowed: float,
    kept: _Entries,
    written: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> _Entries:
    """Entries (k, d) that `best_palette` chooses for features (n, d), and that of each (n,).

    kept     the entries if no fewer are needed
    written  rounds entries (k, d) to distinct ones of the file
    """
    distinct = len(kept[0])
    if distinct <= 1 or (allowed <= 0 and distinct <= count):
        return kept
    floor = max(float(weight.mean()), np.finfo(np.float64).tiny) * 1e-3
    weight = weight + floor  # so that colours that are hardly visible still count
    if allowed <= 0:
        return _lloyd(features, weight, _split(features, weight, count, 0.0)[0], written)
    if distinct <= count and _loss(features, weight, *kept) > allowed:
        return kept  # rounding alone loses more
    most = min(count, distinct)
    aim = allowed * SPARE
    while True:
        means, left = _split(features, weight, most, aim)
        entries, entry = _lloyd(features, weight, means, written)
        if _loss(features, weight, entries, entry) <= allowed:
            return entries, entry
        if left > aim or len(means) >= most or aim < allowed * LEAST_AIM:
            # No palette suffices: the rest of the error is rounding.
            return kept if distinct <= count else (entries, entry)
        aim *= LESS


def _loss(
    features: NDArray[np.float64],
    weight: NDArray[np.float64],
    entries: NDArray[np.float64],
    entry: NDArray[np.intp],
) -> float:
    """The sum that `best_palette` minimises."""
    return float(np.sum(weight * np.square(entries[entry] - features).sum(axis=1)))


def _stacked(color: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the features (n, 4) of colours (n, 3) and exponents (n,)."""
    return np.column_stack([color, BETA_WEIGHT * np.log(beta)])


def _lloyd(
    features: NDArray[np.float64],
    weight: NDArray[np.float64],
    entries: NDArray[np.float64],
    written: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> _Entries:
    for _ in range(ITERATIONS):
        entry = nearest_entry(entries, features)[1]
        mass = np.bincount(entry, weight, len(entries))
        used = mass > 0
        sums = np.stack(
            [np.bincount(entry, weight * column, len(entries)) for column in features.T], axis=1
        )
        entries = sums[used] / mass[used, None]
    entries = written(entries)
    return entries, nearest_entry(entries, features)[1]


def _rounded(features: NDArray[np.float64]) -> Palette:
    """Return the distinct 8-bit colours with the classes of their exponents."""
    classes = nearest_class(np.exp(features[:, 3] / BETA_WEIGHT))
    levels = np.column_stack([np.round(features[:, :3] * 255), classes]).astype(np.intp)
    distinct, entry = np.unique(levels, axis=0, return_inverse=True)
    beta = np.array(BETA_CLASSES)[distinct[:, 3]]
    return Palette(distinct[:, :3].astype(np.uint8), beta, entry.reshape(-1))


def _split(
    features: NDArray[np.float64], weight: NDArray[np.float64], count: int, aim: float
) -> tuple[NDArray[np.float64], float]:
    """Means (k, d) of clusters, k <= count, and the squared error that is left.

    The cluster of the largest error is cut at its mean, across its direction of largest variance,
    until the error is at most `aim` (Wan, Wong and Prusinkiewicz, "An algorithm for
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
        if above.all() or not above.any():  # one colour only
            break
        parts = cluster(members[above]), cluster(members[~above])
        heapq.heapreplace(heap, parts[0])
        heapq.heappush(heap, parts[1])
        left += worst - parts[0][0] - parts[1][0]
    return np.array([mean for _, _, _, mean, _ in heap]), left


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
