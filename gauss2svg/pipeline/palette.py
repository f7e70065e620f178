"""Palettes: weighted k-means on colours, exponents and skews, one gradient each."""

from __future__ import annotations

import dataclasses
import heapq
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene.falloff import BETA_CLASSES, SKEW_STEP, nearest_class, written_skew
from gauss2svg.scene.nearest import nearest_entry


@dataclass(frozen=True)
class PaletteTuning:
    """How a palette is found (docs/decisions/palette.md).

    iterations   of Lloyd; twice as many gain under 2 %
    spare        times the allowed error, until which clusters are split, because Lloyd's iterations
                 remove about a tenth of it
    less         times that number, where Lloyd's iterations remove less than a tenth
    least_aim    times the allowed error, under which no palette suffices
    beta_weight  of ln beta beside colours in 0..1: the best for photos and near the best at few
                 bytes
    skew_weight  of the length of a skew beside them (docs/decisions/skew.md)
    """

    iterations: int = 6
    spare: float = 1.12
    less: float = 0.94
    least_aim: float = 0.1
    beta_weight: float = 0.1
    skew_weight: float = 0.04


TUNING = PaletteTuning()
_Entries = tuple[NDArray[np.float64], NDArray[np.intp]]


@dataclass(frozen=True)
class Palette:
    """k entries: 8-bit sRGB color (k, 3), exponent beta (k,) and skew (k,); entry (n,) of shapes.

    skew is the length of it.
    """

    color: NDArray[np.uint8]
    beta: NDArray[np.float64]
    skew: NDArray[np.float64]
    entry: NDArray[np.intp]


def best_palette(
    color: NDArray[np.float64],
    beta: NDArray[np.float64],
    weight: NDArray[np.float64],
    count: int,
    allowed: float = 0.0,
    skew: NDArray[np.float64] | None = None,
) -> Palette:
    """At most `count` pairs of a colour and an exponent, each with a skew, and that of each shape.

    Weighted k-means on color (n, 3) in 0..1, beta_weight ln beta (n,) and skew_weight times the
    lengths of skews (n,), None for all 0, minimises

        sum weight |difference|^2,

    whose colour part is the squared error of the image if weight (n,) >= 0 is the squared visible
    mass of a shape. Pairs that are few enough already are kept, colours rounded to 8 bits and
    exponents to BETA_CLASSES, skews to what a file has. If `allowed` > 0, about as few entries are
    used as keep the sum under it. The result is deterministic: it starts from clusters that are
    split again and again.
    """
    classes = np.array(BETA_CLASSES)[nearest_class(beta)]
    skew = skew if skew is not None and skew.any() else None
    features = _stacked(color, classes, skew)

    def written(palette: Palette) -> NDArray[np.float64]:
        lengths = None if skew is None else palette.skew
        return _stacked(palette.color / 255, palette.beta, lengths)

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
    aim = allowed * TUNING.spare
    while True:
        means, left = _split(features, weight, most, aim)
        entries, entry = _lloyd(features, weight, means, written)
        if _loss(features, weight, entries, entry) <= allowed:
            return entries, entry
        if left > aim or len(means) >= most or aim < allowed * TUNING.least_aim:
            # No palette suffices: the rest of the error is rounding.
            return kept if distinct <= count else (entries, entry)
        aim *= TUNING.less


def _loss(
    features: NDArray[np.float64],
    weight: NDArray[np.float64],
    entries: NDArray[np.float64],
    entry: NDArray[np.intp],
) -> float:
    """The sum that `best_palette` minimises."""
    return float(np.sum(weight * np.square(entries[entry] - features).sum(axis=1)))


def _stacked(
    color: NDArray[np.float64], beta: NDArray[np.float64], skew: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """Features (n, 4), or (n, 5) with skews: a column of zeros would turn the axes of a split."""
    columns = [color, (TUNING.beta_weight * np.log(beta))[:, None]]
    if skew is not None:
        columns.append((TUNING.skew_weight * skew)[:, None])
    return np.hstack(columns)


def _lloyd(
    features: NDArray[np.float64],
    weight: NDArray[np.float64],
    entries: NDArray[np.float64],
    written: Callable[[NDArray[np.float64]], NDArray[np.float64]],
) -> _Entries:
    for _ in range(TUNING.iterations):
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
    """Distinct 8-bit colours with the classes of their exponents, and skews as a file has them."""
    classes = nearest_class(np.exp(features[:, 3] / TUNING.beta_weight))
    skewed = features.shape[1] > 4
    length = features[:, 4] / TUNING.skew_weight if skewed else np.zeros(len(features))
    steps = np.round(written_skew(length, np.array(BETA_CLASSES)[classes]) / SKEW_STEP)
    levels = np.column_stack([np.round(features[:, :3] * 255), classes, steps]).astype(np.intp)
    distinct, entry = np.unique(levels, axis=0, return_inverse=True)
    beta = np.array(BETA_CLASSES)[distinct[:, 3]]
    skew = np.asarray(SKEW_STEP * distinct[:, 4], np.float64)
    return Palette(distinct[:, :3].astype(np.uint8), beta, skew, entry.reshape(-1))


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
