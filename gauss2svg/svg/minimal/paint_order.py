"""Painter's orders that draw the same with shapes of one colour after one another.

Two shapes may change places where they do not overlap, or where their colours are equal.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_DIRECTIONS = 12  # along which the projections of two ellipses are compared
_ROWS = 256  # of all pairs at a time, which else take eight bytes each


def overlaps(
    mean: NDArray[np.float64], factor: NDArray[np.float64], margin: float
) -> NDArray[np.bool_]:
    """(n, n) whether the shape of a row lies below that of a column and is not apart from it.

    Arguments are those of `colors_together`.
    """
    count = len(mean)
    below = np.triu(np.ones((count, count), bool), 1)
    # First the two along the sides of a picture, after which few pairs are left.
    steps = sorted(range(_DIRECTIONS), key=lambda k: k % (_DIRECTIONS // 2))
    at, reach = [], []
    for angle_rad in np.array(steps) * np.pi / _DIRECTIONS:
        x, y = np.cos(angle_rad), np.sin(angle_rad)
        at.append(mean @ [x, y])
        reach.append(np.hypot(factor[:, 0] * x + factor[:, 1] * y, factor[:, 2] * y))
    for begin in range(0, count, _ROWS):
        rows = slice(begin, begin + _ROWS)
        block = below[rows, begin:]
        for a, r in zip(at[:2], reach[:2], strict=True):
            block &= np.abs(a[rows, None] - a[begin:]) < r[rows, None] + r[begin:] + margin
        row, column = np.nonzero(block)
        for a, r in zip(at[2:], reach[2:], strict=True):
            a, r = a[begin:], r[begin:]
            near = np.abs(a[row] - a[column]) < r[row] + r[column] + margin
            row, column = row[near], column[near]
        block[:] = False
        block[row, column] = True
    return below


def colors_together(
    mean: NDArray[np.float64],
    factor: NDArray[np.float64],
    color: NDArray[np.intp],
    key: NDArray[np.float64],
    margin: float,
) -> NDArray[np.intp]:
    """(n,) order of n shapes with few changes of colour; it does not depend on equivalent orders.

    mean    (n, 2); factor (n, 3) l11 l21 l22 of the ellipses that the shapes stay in
    color   (n, 3) whole levels
    key     (k, n) by which those of a run are sorted, the last row first
    margin  of lengths, from which two ellipses count as apart
    From below: a colour all of whose shapes can be drawn, else the one of the largest share.
    """
    kind = np.unique(color, axis=0, return_inverse=True)[1].reshape(-1)
    below = overlaps(mean, factor, margin) & (kind[:, None] != kind)
    waiting, left = below.sum(axis=0), np.ones(len(mean), bool)
    order = []
    while left.any():
        ready = np.bincount(kind[left & (waiting == 0)], minlength=kind.max() + 1)
        share = ready / np.maximum(np.bincount(kind[left], minlength=len(ready)), 1)
        chosen = np.flatnonzero(left & (waiting == 0) & (kind == share.argmax()))
        order.append(chosen[np.lexsort(key[:, chosen])])
        left[chosen] = False
        waiting -= below[chosen].sum(axis=0)
    return np.concatenate(order) if order else np.zeros(0, np.intp)
