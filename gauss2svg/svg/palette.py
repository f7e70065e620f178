"""A palette for the exporter: few colours, so that few gradients have to be written."""

import heapq

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

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


def quantize(
    color: NDArray[np.float64], weight: NDArray[np.float64], count: int, allowed: float = 0.0
) -> tuple[NDArray[np.uint8], NDArray[np.intp]]:
    """Palette (k, 3) of 8-bit sRGB, k <= count, and the entry (n,) of each colour.

    Weighted k-means on color (n, 3) in 0..1: it minimises sum weight |color - entry|^2,
    which is the squared error of the picture if weight (n,) >= 0 is the squared mass a
    Gaussian shows. Colours that are few enough already are kept, rounded to 8 bits. Where
    that sum may come to `allowed` > 0, about as few entries are used as that takes.
    It starts from clusters split again and again; nothing is random.
    """
    levels = np.round(color * 255).astype(np.uint8)
    distinct, entry = np.unique(levels, axis=0, return_inverse=True)
    exact = distinct, entry.reshape(-1)
    if len(distinct) <= 1 or (allowed <= 0 and len(distinct) <= count):
        return exact
    floor = max(float(weight.mean()), np.finfo(np.float64).tiny) * 1e-3
    weight = weight + floor  # a colour that hardly shows still pulls a little
    if allowed <= 0:
        return _lloyd(color, weight, _split(color, weight, count, 0.0)[0])
    most = min(count, len(distinct))
    aim = allowed * _MENDED
    while True:
        entries, left = _split(color, weight, most, aim)
        palette = _lloyd(color, weight, entries)
        error = float(np.sum(weight * np.square(palette[0][palette[1]] / 255 - color).sum(axis=1)))
        if error <= allowed:
            return palette
        if left > aim or len(entries) >= most or aim < allowed * _LEAST_AIM:
            # No palette does; what is left is the rounding to 8 bits.
            return exact if len(distinct) <= count else palette
        aim *= _LESS


def _lloyd(
    color: NDArray[np.float64], weight: NDArray[np.float64], entries: NDArray[np.float64]
) -> tuple[NDArray[np.uint8], NDArray[np.intp]]:
    for _ in range(_ITERATIONS):
        entry = KDTree(entries).query(color)[1]
        mass = np.bincount(entry, weight, len(entries))
        used = mass > 0
        sums = np.stack(
            [np.bincount(entry, weight * color[:, c], len(entries)) for c in range(3)], axis=1
        )
        entries = sums[used] / mass[used, None]
    rounded = np.unique(np.round(entries * 255).astype(np.uint8), axis=0)
    return rounded, np.asarray(KDTree(rounded / 255).query(color)[1], np.intp)


def _split(
    color: NDArray[np.float64], weight: NDArray[np.float64], count: int, aim: float
) -> tuple[NDArray[np.float64], float]:
    """Means (k, 3) of clusters, k <= count, and the squared error that they leave.

    The worst is cut in two, again and again, until no more than `aim` is left: at its mean,
    across its direction of largest variance (Wan, Wong and Prusinkiewicz, "An algorithm for
    multidimensional data clustering", 1988).
    """

    def cluster(members: NDArray[np.intp]) -> tuple[float, int, NDArray, NDArray, NDArray]:
        share = weight[members, None]
        mean = (share * color[members]).sum(axis=0) / share.sum()
        offset = color[members] - mean
        spread = (share * offset).T @ offset
        axis = np.linalg.eigh(spread)[1][:, -1]
        # The first member tells apart clusters of equal error: members are never compared.
        return -float(np.trace(spread)), int(members[0]), members, mean, offset @ axis > 0

    heap = [cluster(np.arange(len(color)))]
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
