"""Quantisation of a scene's colours and exponents to a palette, by weighted k-means.

The file has one gradient for each entry of the palette, so fewer entries make a smaller file.
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

# The next constants control the search for a palette (docs/decisions/palette.md).
# Number of iterations of Lloyd's algorithm. Twice as many improve the result by less than 2 %.
ITERATIONS = 6
# Clusters are split until their error is at most a bound. The first bound is the allowed error
# multiplied by this factor. The factor may be larger than 1, because Lloyd's algorithm then removes
# about a tenth of the clusters' error.
SPARE = 1.12
# If the error after Lloyd's algorithm is still larger than allowed, the bound on the error of the
# clusters is lowered by the excess, and at least to this share of it. Then more clusters are split.
LESS = 0.94
LEAST_AIM = 0.1  # the search gives up when the bound has fallen to this share of the allowed error
# Shapes are clustered by their colours, which are in 0..1, and by their exponents beta. For this,
# ln beta is multiplied by this factor. This value of the factor is the best for photos, and nearly
# the best for files of few bytes.
BETA_WEIGHT = 0.1
Rows = NDArray[np.float64]


def best_palette(
    color: Rows, beta: Rows, weight: Rows, count: int, allowed: float = 0.0
) -> tuple[Rows, Rows, NDArray[np.intp]]:
    """Choose a palette for n shapes. Each of its entries is a pair of a colour and an exponent.

    Return the colours (k, 3) of the entries in 0..1, their exponents (k,), and for each shape the
    index (n,) of its entry.

    color    (n, 3) colours of the shapes in 0..1
    beta     (n,) exponents of the shapes
    weight   (n,) weights of the shapes, >= 0
    count    largest number of entries
    allowed  largest error that the palette may cause, see below

    Weighted k-means on the vectors (color, BETA_WEIGHT ln beta) minimises the error

        sum of weight |difference of a shape's vector from that of its entry|^2.

    If the weights are the visible masses of the shapes, the colours' part of this sum is the
    squared error that the palette adds to the image. Colours are rounded to 8 bits and exponents to
    BETA_CLASSES. If `allowed` is 0, and there are at most `count` different pairs, all of them are
    kept. If `allowed` is larger, the palette has about the fewest entries whose error is at most
    `allowed`. The result is deterministic, because the first clusters come from repeated splits.
    """
    features = np.column_stack([color, BETA_WEIGHT * np.log(_class_of(beta))])
    entries, entry = few_entries(features, weight, count, allowed, _rounded)
    return entries[:, :3], _class_of(np.exp(entries[:, 3] / BETA_WEIGHT)), entry


def few_entries(
    features: Rows, weight: Rows, count: int, allowed: float, rounded: Callable[[Rows], Rows]
) -> tuple[Rows, NDArray[np.intp]]:
    """Choose a palette of at most `count` entries for n features (n, d).

    Return the entries (k, d), and an array (n,) with the index of each feature's entry.

    allowed  largest weighted squared error that the entries may cause. The larger it is, the fewer
             entries there are. 0: there are as many as are needed, up to `count`
    rounded  function that rounds features to values that a file can contain
    """
    kept, entry_kept = np.unique(rounded(features), axis=0, return_inverse=True)
    exact, distinct = (kept, entry_kept.reshape(-1)), len(kept)
    if distinct <= 1 or (allowed <= 0 and distinct <= count):
        return exact
    floor = max(float(weight.mean()), np.finfo(np.float64).tiny) * 1e-3
    # Each weight is raised a little, so that the colours of hardly visible shapes count too.
    weight = weight + floor

    def loss(entries: Rows, entry: NDArray[np.intp]) -> float:
        return float(np.sum(weight * np.square(entries[entry] - features).sum(axis=1)))

    def refined(entries: Rows) -> tuple[Rows, NDArray[np.intp]]:
        """Improve entries by Lloyd's algorithm.

        Return the improved entries, and an array with the index of each feature's entry.
        """
        for _ in range(ITERATIONS):
            entry = nearest_entry(entries, features)[1]
            mass = np.bincount(entry, weight, len(entries))
            sums = [np.bincount(entry, weight * column, len(entries)) for column in features.T]
            entries = np.stack(sums, axis=1)[mass > 0] / mass[mass > 0, None]
        entries = np.unique(rounded(entries), axis=0)
        return entries, nearest_entry(entries, features)[1]

    if distinct <= count and loss(*exact) > allowed:
        # Rounding alone causes more error than is allowed. Fewer entries would cause still more.
        return exact
    most, aim = min(count, distinct), allowed * SPARE
    clusters = _Clusters(features, weight)
    while True:
        clusters.split(most, aim)
        entries, entry = refined(clusters.means)
        excess = loss(entries, entry) - allowed
        if excess <= 0:
            return entries, entry
        if clusters.left > aim or len(clusters) >= most or aim <= allowed * LEAST_AIM:
            # More splits would not help. The error is too large only because colours are rounded,
            # or because no more entries are allowed.
            return exact if distinct <= count else (entries, entry)
        aim = min(aim * LESS, aim - excess)


def _class_of(beta: Rows) -> Rows:
    return np.array(BETA_CLASSES)[nearest_class(beta)]


def _rounded(features: Rows) -> Rows:
    """Round colours to 8 bits and exponents to their classes."""
    classes = _class_of(np.exp(features[:, 3] / BETA_WEIGHT))
    return np.column_stack([np.round(features[:, :3] * 255) / 255, BETA_WEIGHT * np.log(classes)])


class _Clusters:
    """Clusters of features. Again and again, the one with the largest error is split in two.

    It is split at its mean, across the direction of its largest variance (Wan, Wong and
    Prusinkiewicz, "An algorithm for multidimensional data clustering", 1988).

    left  weighted squared error of all features against the means of their clusters
    """

    def __init__(self, features: Rows, weight: Rows) -> None:
        self._features, self._weight = features, weight
        self._heap = [self._cluster(np.arange(len(features)))]
        self.left = -self._heap[0][0]

    def __len__(self) -> int:
        return len(self._heap)

    @property
    def means(self) -> Rows:
        """Means (k, d) of the clusters."""
        return np.array([mean for _, _, _, mean, _ in self._heap])

    def split(self, count: int, aim: float) -> None:
        """Split clusters until there are `count`, or until the error is at most `aim`."""
        while len(self._heap) < count and self.left > aim:
            worst, _, members, _, above = self._heap[0]
            if above.all() or not above.any():  # all members of each cluster are equal
                break
            parts = self._cluster(members[above]), self._cluster(members[~above])
            heapq.heapreplace(self._heap, parts[0])
            heapq.heappush(self._heap, parts[1])
            self.left += worst - parts[0][0] - parts[1][0]

    def _cluster(self, members: NDArray[np.intp]) -> tuple[float, int, NDArray, NDArray, NDArray]:
        share = self._weight[members, None]
        mean = (share * self._features[members]).sum(axis=0) / share.sum()
        offset = self._features[members] - mean
        spread = (share * offset).T @ offset
        axis = np.linalg.eigh(spread)[1][:, -1]
        # The heap compares these tuples. Clusters of equal error are ordered by the index of their
        # first member, so that the arrays are never compared.
        return -float(np.trace(spread)), int(members[0]), members, mean, offset @ axis > 0


def quantize(
    scene: Scene,
    form: str = GRADIENT,
    palette: int = 0,
    color_error: float = 0.0,
    weight: NDArray[np.floating] | None = None,
) -> Scene:
    """Return the scene with the colours and exponents of a palette.

    A second call with the result changes nothing.

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
