"""A palette for the exporter: few colours, so that few gradients have to be written."""

import heapq
import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

# Lloyd's iterations. On three photos, 500 and 5000 Gaussians, 16 to 1250 colours, 5 bring
# what 12 bring within 2 % of the squared error. Starting from clusters split one by one
# leaves 0.2 to 0.9 times the error that starting from colours spread along a space-filling
# curve leaves.
_ITERATIONS = 6
_SEARCHES = 7  # for the number of entries that an allowed error takes
_SAFETY = 1.05
_NEAR = 1.06  # times as many entries as are too few end the search


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
    if allowed <= 0 or len(distinct) <= 1:
        return exact if len(distinct) <= count else _k_means(color, weight, count)
    most = min(count, len(distinct))
    found = exact if len(distinct) <= count else None
    too_few, enough, tried = 0, most, math.ceil(4 * math.sqrt(len(color)))
    for _ in range(_SEARCHES):
        tried = min(max(tried, too_few + 1), enough)
        palette = _k_means(color, weight, tried)
        error = float(np.sum(weight * np.square(palette[0][palette[1]] / 255 - color).sum(axis=1)))
        if error <= allowed:
            found, enough = palette, tried
        else:
            too_few = tried
        if enough <= too_few * _NEAR + 1:
            break
        # In three dimensions the error falls about as tried^(-2 / 3) (Zador, 1982); beyond
        # what is known already, the middle.
        guess = tried * (max(error, 1e-12) / allowed) ** 1.5 * _SAFETY
        inside = too_few * _NEAR < guess < enough / _NEAR
        tried = round(guess if inside else math.sqrt(max(too_few, 1) * enough))
    return found if found is not None else _k_means(color, weight, most)


def _k_means(
    color: NDArray[np.float64], weight: NDArray[np.float64], count: int
) -> tuple[NDArray[np.uint8], NDArray[np.intp]]:
    floor = max(float(weight.mean()), np.finfo(np.float64).tiny) * 1e-3
    weight = weight + floor  # a colour that hardly shows still pulls a little
    entries = _split(color, weight, count)
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
    color: NDArray[np.float64], weight: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """Means (k, 3) of at most `count` clusters: the worst is cut in two, again and again.

    It is cut at its mean, across its direction of largest variance (Wan, Wong and
    Prusinkiewicz, "An algorithm for multidimensional data clustering", 1988).
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
    while len(heap) < count:
        *_, members, _, above = heap[0]
        if above.all() or not above.any():  # one colour only
            break
        heapq.heapreplace(heap, cluster(members[above]))
        heapq.heappush(heap, cluster(members[~above]))
    return np.array([mean for _, _, _, mean, _ in heap])
