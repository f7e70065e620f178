"""Palettes of n features by weighted k-means. The first clusters come from repeated splits."""

from __future__ import annotations

import heapq
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.without_scipy import nearest_entry, weighted_means

# The next constants control the search for a palette (docs/decisions/palette.md).
# Number of iterations of Lloyd's algorithm. Twice as many improve the result by less than 2 %.
ITERATIONS = 6
# Clusters are split until their error is at most a bound. The first bound is the allowed error
# multiplied by this factor. The factor may be larger than 1, because Lloyd's algorithm then removes
# about a tenth of the clusters' error.
CLUSTER_SPARE = 1.12
# If the error after Lloyd's algorithm is still larger than allowed, the bound on the error of the
# clusters is lowered by the excess, and at least to this share of it. Then more clusters are split.
LESS = 0.94
LEAST_AIM = 0.1  # the search gives up when the bound has fallen to this share of the allowed error
Rows = NDArray[np.float64]
# Entries (k, d), and the index (n,) of each feature's entry.
Palette = tuple[Rows, NDArray[np.intp]]


def few_entries(
    features: Rows,
    weight: Rows,
    count: int,
    allowed: float,
    rounded: Callable[[Rows], Rows],
) -> Palette:
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

    def refined(entries: Rows) -> Palette:
        """Improve entries by Lloyd's algorithm.

        Return the improved entries, and an array with the index of each feature's entry.
        """
        for _ in range(ITERATIONS):
            entry = nearest_entry(entries, features)[1]
            entries = weighted_means(features, weight, entry, entries)[np.unique(entry)]
        entries = np.unique(rounded(entries), axis=0)
        return entries, nearest_entry(entries, features)[1]

    if distinct <= count and loss(*exact) > allowed:
        # Rounding alone causes more error than is allowed. Fewer entries would cause still more.
        return exact
    most, aim = min(count, distinct), allowed * CLUSTER_SPARE
    clusters = Clusters(features, weight)
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


class Clusters:
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

    @property
    def members(self) -> list[NDArray[np.intp]]:
        """Indices of the features of each cluster."""
        return [members for _, _, members, _, _ in self._heap]

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
        axis = portable.main_axis(np.sqrt(share) * offset)
        spread = float((share * np.square(offset)).sum())
        # The heap compares these tuples. Clusters of equal error are ordered by the index of their
        # first member, so that the arrays are never compared.
        return -spread, int(members[0]), members, mean, portable.product(offset, axis) > 0
