"""Pareto fronts: the most PSNR for the least of one or more costs; pure functions."""

from __future__ import annotations

import math
from collections.abc import Sequence

TOLERANCE = 0.1  # dB: less below a front counts as on it


def front(psnr: Sequence[float], cost: Sequence[float]) -> list[int]:
    """Indices of what nothing beats in both, from the cheapest on; of equals the first."""
    best, found = -math.inf, []
    for index in sorted(range(len(psnr)), key=lambda i: (cost[i], -psnr[i], i)):
        if psnr[index] > best:
            best = psnr[index]
            found.append(index)
    return found


def distance_below(psnr: Sequence[float], *costs: Sequence[float]) -> list[float]:
    """How many dB each is below the best of those that cost no more in any way; >= 0."""
    return [
        _gap(max(p for p, row in zip(psnr, prices, strict=True) if _no_more(row, own)), mine)
        for prices in [list(zip(*costs, strict=True))]
        for mine, own in zip(psnr, prices, strict=True)
    ]


def _no_more(row: Sequence[float], own: Sequence[float]) -> bool:
    return all(a <= b for a, b in zip(row, own, strict=True))


def _gap(best: float, mine: float) -> float:
    return 0.0 if best == mine else best - mine  # infinite PSNRs have no difference
