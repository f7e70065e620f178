"""Where a fit is between two of its steps."""

from __future__ import annotations

from dataclasses import dataclass, field

GROWING, REFINING, OVER = "growing", "refining", "over"


@dataclass
class Stage:
    """Where a fit is between its steps.

    name         GROWING, REFINING or OVER
    index        of the round of growth, and whether that has begun
    adjust_at, exchange_at  shares of the fit at which that is still to be done
    pruned, settled         whether that is done
    """

    name: str = GROWING
    index: int = 0
    begun: bool = False
    adjust_at: list[float] = field(default_factory=list)
    exchange_at: list[float] = field(default_factory=list)
    pruned: bool = False
    settled: bool = False
