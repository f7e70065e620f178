"""Palettes: weighted k-means on colours and exponents, one gradient each."""

from __future__ import annotations

import dataclasses
import heapq
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene.falloff import BETA_CLASSES, nearest_class
from gauss2svg.scene.nearest import nearest_entry

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
