"""A palette for the exporter: few colours, so that few gradients have to be written."""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

# Lloyd's iterations. On two photos at 5000 Gaussians and 1024 colours the weighted error
# halves in 4, falls by 1.5 % more in 12 and by under 0.01 % after that.
_ITERATIONS = 12
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
    The starting entries are colours spread along a space-filling order; nothing is random.
    """
    levels = np.round(color * 255).astype(np.uint8)
    distinct, entry = np.unique(levels, axis=0, return_inverse=True)
    exact = distinct, entry.reshape(-1)
    if allowed <= 0 or len(distinct) <= 1:
        return exact if len(distinct) <= count else _k_means(color, levels, weight, count)
    most = min(count, len(distinct))
    found = exact if len(distinct) <= count else None
    too_few, enough, tried = 0, most, math.ceil(4 * math.sqrt(len(color)))
    for _ in range(_SEARCHES):
        tried = min(max(tried, too_few + 1), enough)
        palette = _k_means(color, levels, weight, tried)
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
    return found if found is not None else _k_means(color, levels, weight, most)


def _k_means(
    color: NDArray[np.float64], levels: NDArray[np.uint8], weight: NDArray[np.float64], count: int
) -> tuple[NDArray[np.uint8], NDArray[np.intp]]:
    floor = max(float(weight.mean()), np.finfo(np.float64).tiny) * 1e-3
    weight = weight + floor  # a colour that hardly shows still pulls a little
    order = np.argsort(_morton(levels), kind="stable")
    # The best density of k-means entries in three dimensions is the weight's to 3 / 5
    # (Zador, "Asymptotic quantization error", 1982).
    reach = np.cumsum(weight[order] ** 0.6)
    picks = np.searchsorted(reach, (np.arange(count) + 0.5) / count * reach[-1])
    entries = np.unique(color[order[picks]], axis=0)
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


def _morton(levels: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Bits of r, g and b interleaved, so that neighbours in order are neighbours in colour."""
    code = np.zeros(len(levels), np.int64)
    for bit in range(8):
        for channel in range(3):
            code |= ((levels[:, channel].astype(np.int64) >> bit) & 1) << (3 * bit + channel)
    return code
