"""Pairs of a Gaussian and a tile that it reaches, with the rows of pixels that it reaches there.

The canvas is cut into tiles, which are TILE_WIDTH pixels wide (one vector register of float32) and
TILE_HEIGHT rows high. A "pair" is one Gaussian in one tile. Kernels visit only those rows of the
tile that the Gaussian's ellipse reaches. So work is counted in pair rows, which have TILE_WIDTH
pixels each.

The kernels compute in float32. They go from one row of a pair to the next by adding
w22 = 1 / (sy sqrt(1 - rho^2)) to the whitened offsets (`across` of gauss2svg/core/gaussians.h).
Over 8 rows, rounding changes the offsets by up to 1e-6 w22, which is too much for very thin shapes.
So shapes thinner than LEAST_STEPPED are split into pairs of one row each, which need no such
addition. The shapes of a fit are far wider.

Kernels compute in one thread. ctypes releases Python's global lock, so ordinary Python threads can
run them at the same time.
"""

import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.core import Kernel

# The OpenMP library of torch reads this variable when it is loaded. With PASSIVE, its idle threads
# sleep. By default they would wait busily, on cores that a kernel could use. If the user has set
# the variable, its value is kept.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

_find_strip_rows = Kernel("find_strip_rows", "int int float float int float64 int64 int64 int64")
_list_pairs = Kernel(
    "list_pairs",
    "int int int int int64 int64 int64 int64 int64 int32 int32 int32 int64 int64 int32",
)

# Number of cores that this process may use.
CORES = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
threads = CORES  # threads that in_shares uses. Only Run changes it, under the lock of the kernels


def in_shares(work: Callable[[int, int], object], max_shares: int) -> None:
    """Divide `work` into shares, do them at the same time in several threads, and wait for all.

    work(share, shares) is called for share = 0, ..., shares - 1. The number of shares is `threads`,
    but at most max_shares. The calling thread does the first share, so if there is only one share,
    no other thread is needed.
    """
    shares = max(1, min(threads, max_shares))
    if shares == 1:
        work(0, 1)
        return
    # The threads end with the call. Starting them takes a tenth of a millisecond.
    with ThreadPoolExecutor(shares - 1, "gauss2svg-kernel") as pool:
        others = [pool.submit(work, share, shares) for share in range(1, shares)]
        work(0, shares)
    for other in others:
        other.result()


# Width of a tile in px. 16 numbers of float32 fill one register of 512 bits, or two of 256 bits.
TILE_WIDTH = 16
TILE_BITS = 4
TILE_HEIGHT = 1 << TILE_BITS
# A shape is thin if its width sy sqrt(1 - rho^2) along a column is less than this number of px.
# Each pair of a thin shape has only one row, because rounding would make steps from one row to the
# next too inexact.
LEAST_STEPPED = 1 / 64


def find_pairs(
    mean: NDArray[np.float64],
    sigma: NDArray[np.float64],
    rho: NDArray[np.float64],
    radius: NDArray[np.float64],
    height: int,
    width: int,
) -> tuple[NDArray[Any], ...]:
    """Return the p pairs of n Gaussians and the tiles of a canvas of height x width px.

    mean (n, 2) and sigma (n, 2) are in px, and rho is (n,). radius (n,) is the Mahalanobis distance
    at which each Gaussian is cut off.

    A pair is the part of one Gaussian on consecutive rows of one tile. The pairs are stored
    Gaussian by Gaussian. Six arrays are returned:

    offset    (n + 1,) int64: Gaussian i has the pairs offset[i]:offset[i + 1]
    gaussian  (p,) int32: index of the Gaussian of each pair
    rows      (p, 2) int32: first image row of each pair, and the row after its last row
    start     (tiles + 1,) int64: the pairs of tile t are order[start[t]:start[t + 1]]
    order     (p,) int32: indices of pairs, tile by tile. Within a tile they are listed from front
              to back: the topmost Gaussian is first
    count     (tiles,) int64: number of pair rows in each tile
    """
    count = len(mean)
    columns = -(-width // TILE_WIDTH)
    tiles = columns * -(-height // TILE_HEIGHT)
    # A strip is the part of one Gaussian that lies in one column of tiles.
    left, right = (mean[:, 0] + sign * sigma[:, 0] * radius for sign in (-1, 1))
    # Clip before the conversion to int, because means may lie far off the canvas.
    column, last = (
        np.clip(x, 0, most).astype(np.int64) // TILE_WIDTH
        for x, most in ((left, width), (right, width - 1))
    )
    strip_count = np.where((right >= 0) & (left <= width), last + 1 - column, 0)
    strip = np.zeros(count + 1, np.int64)
    np.cumsum(strip_count, out=strip[1:])
    strip_rows = np.empty((strip[-1], 2), np.int64)
    shape = np.column_stack([mean, sigma, rho, radius])

    def find_rows(share: int, shares: int) -> None:
        first, end = (count * k // shares for k in (share, share + 1))
        _find_strip_rows(first, end, height, width, TILE_WIDTH, shape, column, strip, strip_rows)

    in_shares(find_rows, count // 512)  # a thread of its own is worth this number of Gaussians
    thin = sigma[:, 1] * np.sqrt((1 - rho) * (1 + rho)) < LEAST_STEPPED
    bits = np.where(thin, 0, TILE_BITS)  # a pair of Gaussian i has at most 2^bits[i] rows
    first, end = strip_rows.T
    shift = np.repeat(bits, strip_count)
    total = int(np.where(end > first, ((end - 1) >> shift) - (first >> shift) + 1, 0).sum())
    offset, start = np.zeros(count + 1, np.int64), np.zeros(tiles + 1, np.int64)
    gaussian, tile, order = (np.empty(total, np.int32) for _ in range(3))
    rows = np.empty((total, 2), np.int32)
    tile_rows = np.zeros(tiles, np.int64)
    _list_pairs(
        count, columns, tiles, TILE_BITS, bits, column, strip, strip_rows, offset, gaussian, tile,
        rows, start, tile_rows, order,
    )  # fmt: skip
    return offset, gaussian, rows, start, order, tile_rows
