"""Pairs of a Gaussian and a tile that it reaches, with the rows of pixels that it reaches there.

The canvas is cut into tiles, which are TILE_WIDTH pixels wide (one vector register of float32) and
TILE_HEIGHT rows high. A "pair" is one Gaussian in one tile. Kernels visit only those rows of the
tile that the Gaussian's ellipse reaches. So work is counted in pair rows, which have TILE_WIDTH
pixels each.

The kernels compute in float32. They go from one row of a pair to the next by adding
w22 = 1 / (sy sqrt(1 - rho^2)) to the whitened offsets (`across` of gauss2svg/core/gaussians.h).
Over 8 rows, rounding changes the offsets by up to 1e-6 w22, which is too much for very thin shapes.
So shapes thinner than 1/64 px are split into pairs of one row each, which need no such addition.
The shapes of a fit are far wider.

Kernels compute in one thread. ctypes releases Python's global lock, so ordinary Python threads can
run them at the same time.
"""

import os
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from gauss2svg.core import Kernel

# The OpenMP library of torch reads this variable when it is loaded. With PASSIVE, its idle threads
# sleep. By default they would wait busily, on cores that a kernel could use. If the user has set
# the variable, its value is kept.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

_list_pairs = Kernel(
    "list_pairs", "int int int float64 int64 int64 int64 int32 int32 int32"
)  # fmt: skip

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
TILE_HEIGHT = 16


def find_pairs(
    ellipse: NDArray[np.float64], height: int, width: int
) -> tuple[NDArray[np.int64 | np.int32], ...]:
    """Return the p pairs of n Gaussians and the tiles of a canvas of height x width px.

    ellipse: (n, 6) mean x, y and sigma x, y in px, rho, and the Mahalanobis distance at which each
    Gaussian is cut off.

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
    count, tiles = len(ellipse), -(-width // TILE_WIDTH) * -(-height // TILE_HEIGHT)
    offset = np.zeros(count + 1, np.int64)
    tile_rows, tile_pairs = np.zeros(tiles, np.int64), np.zeros(tiles, np.int64)
    own = count, height, width, ellipse, offset, tile_rows
    _list_pairs(*own, tile_pairs, None, None, None)
    start = np.concatenate([[0], np.cumsum(tile_pairs)])
    gaussian, order = np.empty((2, offset[-1]), np.int32)
    rows = np.empty((offset[-1], 2), np.int32)
    _list_pairs(*own, start[1:].copy(), gaussian, rows, order)
    return offset, gaussian, rows, start, order, tile_rows
