"""A palette for the exporter: few pairs of colour and exponent, so few gradients are written."""

from __future__ import annotations

import dataclasses
import heapq
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from gauss2svg.scene.falloff import BETA_CLASSES, nearest_class

# Lloyd's iterations. On three photos, 500 and 5000 Gaussians, 16 to 1250 colours, 5 bring
# what 12 bring within 2 % of the squared error. Starting from clusters split one by one
# leaves 0.2 to 0.9 times the error that starting from colours spread along a space-filling
# curve leaves.
_ITERATIONS = 6
# Clusters are split until this many times the error allowed is left, for Lloyd's iterations
# mend about a tenth of it; where they mend less, until less is left.
_MENDED = 1.12
_LESS = 0.94
_LEAST_AIM = 0.1
# Of ln beta beside colours in 0..1. With 0.3, 0.1, 0.05, 0.03 six pictures of at most 100 kB reach
# 27.15, 27.46, 27.46, 27.38 dB, of at most 30 kB 23.05, 23.20, 23.52, 23.48 (Gaussians alone 27.05
# and 22.51); three Kodak photos of 5000 shapes 31.84, 31.84, 31.80, 31.74 dB.
_BETA_WEIGHT = 0.1

_Entries = tuple[NDArray[np.float64], NDArray[np.intp]]


@dataclass(frozen=True)
class Palette:
    """k entries, sRGB color (k, 3) on 8 bits and exponent beta (k,); entry (n,) of each shape."""

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
    """At most `count` pairs of a colour and an exponent, and the one that each shape gets.

    Weighted k-means on color (n, 3) in 0..1 and _BETA_WEIGHT ln beta (n,): it minimises
    sum weight |difference|^2, whose part by colour is the squared error of the picture if
    weight (n,) >= 0 is the squared mass a shape shows. Pairs that are few enough already are
    kept, colours rounded to 8 bits and exponents to BETA_CLASSES. Where that sum may come to
    `allowed` > 0, about as few entries are used as that takes. It starts from clusters split
    again and again; nothing is random.
    """
    classes = np.array(BETA_CLASSES)[nearest_class(beta)]
    features = np.column_stack([color, _BETA_WEIGHT * np.log(classes)])
    exact = _rounded(features)
    kept = _features(exact), exact.entry
    entries, entry = _few(features, weight, count, allowed, kept, lambda e: _features(_rounded(e)))
    return dataclasses.replace(_rounded(entries), entry=entry)


def quantize_signed(
    color: NDArray[np.float64], weight: NDArray[np.float64], count: int, allowed: float = 0.0
) -> NDArray[np.float64]:
    """Signed colours (n, 3) of which at most `count` are different, in place of color (n, 3).

    As `quantize`, without exponents and without rounding.
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
    """Entries as `quantize` chooses them for features (n, d): (k, d), and which each gets (n,).

    kept     what is used where no fewer are needed
    written  entries (k, d) as the file has them, distinct
    """
    distinct = len(kept[0])
    if distinct <= 1 or (allowed <= 0 and distinct <= count):
        return kept
    floor = max(float(weight.mean()), np.finfo(np.float64).tiny) * 1e-3
    weight = weight + floor  # a colour that hardly shows still pulls a little
    if allowed <= 0:
        return _lloyd(features, weight, _split(features, weight, count, 0.0)[0], written)
    most = min(count, distinct)
    aim = allowed * _MENDED
    while True:
        means, left = _split(features, weight, most, aim)
        entries, entry = _lloyd(features, weight, means, written)
        missed = entries[entry] - features
        if float(np.sum(weight * np.square(missed).sum(axis=1))) <= allowed:
            return entries, entry
        if left > aim or len(means) >= most or aim < allowed * _LEAST_AIM:
            # No palette does; what is left is the rounding of the numbers.
            return kept if distinct <= count else (entries, entry)
        aim *= _LESS


def _features(palette: Palette) -> NDArray[np.float64]:
    return np.column_stack([palette.color / 255, _BETA_WEIGHT * np.log(palette.beta)])


def _lloyd(
    features: NDArray[np.float64],
    weight: NDArray[np.float64],
    entries: NDArray[np.float64],
    written: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> _Entries:
    for _ in range(_ITERATIONS):
        entry = KDTree(entries).query(features)[1]
        mass = np.bincount(entry, weight, len(entries))
        used = mass > 0
        sums = np.stack(
            [np.bincount(entry, weight * column, len(entries)) for column in features.T], axis=1
        )
        entries = sums[used] / mass[used, None]
    entries = written(entries)
    return entries, np.asarray(KDTree(entries).query(features)[1], np.intp)


def _rounded(features: NDArray[np.float64]) -> Palette:
    """Distinct colours on 8 bits with the classes of their exponents."""
    classes = nearest_class(np.exp(features[:, 3] / _BETA_WEIGHT))
    levels = np.column_stack([np.round(features[:, :3] * 255), classes]).astype(np.intp)
    distinct, entry = np.unique(levels, axis=0, return_inverse=True)
    beta = np.array(BETA_CLASSES)[distinct[:, 3]]
    return Palette(distinct[:, :3].astype(np.uint8), beta, entry.reshape(-1))


def _split(
    features: NDArray[np.float64], weight: NDArray[np.float64], count: int, aim: float
) -> tuple[NDArray[np.float64], float]:
    """Means (k, d) of clusters, k <= count, and the squared error that they leave.

    The worst is cut in two, again and again, until no more than `aim` is left: at its mean,
    across its direction of largest variance (Wan, Wong and Prusinkiewicz, "An algorithm for
    multidimensional data clustering", 1988).
    """

    def cluster(members: NDArray[np.intp]) -> tuple[float, int, NDArray, NDArray, NDArray]:
        share = weight[members, None]
        mean = (share * features[members]).sum(axis=0) / share.sum()
        offset = features[members] - mean
        spread = (share * offset).T @ offset
        axis = np.linalg.eigh(spread)[1][:, -1]
        # The first member tells apart clusters of equal error: members are never compared.
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
