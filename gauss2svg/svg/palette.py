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
_APART = 16.0


def quantize(
    color: NDArray[np.float64],
    weight: NDArray[np.float64],
    count: int,
    allowed: float = 0.0,
    group: NDArray[np.intp] | None = None,
) -> tuple[NDArray[np.uint8], NDArray[np.intp]]:
    """Palette (k, 3) of 8-bit sRGB, k <= count, and the entry (n,) of each colour.

    Weighted k-means on color (n, 3) in 0..1: it minimises sum weight |color - entry|^2,
    which is the squared error of the picture if weight (n,) >= 0 is the squared mass a
    Gaussian shows. Colours that are few enough already are kept, rounded to 8 bits. Where
    that sum may come to `allowed` > 0, about as few entries are used as that takes.
    It starts from clusters split again and again; nothing is random. Colours of different
    group (n,) never share an entry, so that there is at least one entry for each group.
    """
    group = np.zeros(len(color), np.intp) if group is None else group
    # A coordinate that keeps groups apart: colours differ by sqrt 3 at most.
    color = np.column_stack([color, _APART * group]).astype(np.float64)
    count = max(count, len(np.unique(group)))
    exact = _rounded(color)
    distinct = exact[0]
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
        missed = palette[0][palette[1]] / 255 - color[:, :3]
        error = float(np.sum(weight * np.square(missed).sum(axis=1)))
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
            [np.bincount(entry, weight * column, len(entries)) for column in color.T], axis=1
        )
        entries = sums[used] / mass[used, None]
    return _rounded(entries, color)


def _rounded(
    entries: NDArray[np.float64], color: NDArray[np.float64] | None = None
) -> tuple[NDArray[np.uint8], NDArray[np.intp]]:
    """Distinct entries on 8 bits, and the nearest one to each colour, or to each entry's own."""
    levels = np.column_stack([np.round(entries[:, :3] * 255), entries[:, 3]])
    distinct, entry = np.unique(levels, axis=0, return_inverse=True)
    if color is not None:
        entry = KDTree(distinct / [255, 255, 255, 1]).query(color)[1]
    return distinct[:, :3].astype(np.uint8), np.asarray(entry, np.intp).reshape(-1)


def _split(
    color: NDArray[np.float64], weight: NDArray[np.float64], count: int, aim: float
) -> tuple[NDArray[np.float64], float]:
    """Means (k, 4) of clusters, k <= count, and the squared error that they leave.

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

    heap = [cluster(np.flatnonzero(color[:, 3] == g)) for g in np.unique(color[:, 3])]
    heapq.heapify(heap)
    left = -sum(error for error, *_ in heap)
    while len(heap) < count and left > aim:
        worst, _, members, _, above = heap[0]
        if above.all() or not above.any():  # one colour only
            break
        parts = cluster(members[above]), cluster(members[~above])
        heapq.heapreplace(heap, parts[0])
        heapq.heappush(heap, parts[1])
        left += worst - parts[0][0] - parts[1][0]
    return np.array([mean for _, _, _, mean, _ in heap]), left
