"""Pareto fronts of PSNR over one or more costs."""

from __future__ import annotations

import math
from collections.abc import Sequence

TOLERANCE = 0.1  # dB below a front that still count as on it


def front(psnr: Sequence[float], cost: Sequence[float]) -> list[int]:
    """Indices of the Pareto front, from the cheapest on; of equal entries the first."""
    best, found = -math.inf, []
    for index in sorted(range(len(psnr)), key=lambda i: (cost[i], -psnr[i], i)):
        if psnr[index] > best:
            best = psnr[index]
            found.append(index)
    return found


def distance_below(psnr: Sequence[float], *costs: Sequence[float]) -> list[float]:
    """Distance (dB, >= 0) of each below the best that costs no more in any respect."""
    return [
        _gap(max(p for p, row in zip(psnr, prices, strict=True) if _no_more(row, own)), mine)
        for prices in [list(zip(*costs, strict=True))]
        for mine, own in zip(psnr, prices, strict=True)
    ]


def _no_more(row: Sequence[float], own: Sequence[float]) -> bool:
    return all(a <= b for a, b in zip(row, own, strict=True))


def _gap(best: float, mine: float) -> float:
    return 0.0 if best == mine else best - mine  # infinite PSNRs have no difference
