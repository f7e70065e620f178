"""Where a fit is between two of its steps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from gauss2svg.errors import InputError, whole_number

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

    @classmethod
    def from_state_dict(cls, memory: dict[str, Any]) -> Stage:
        """The stage of this memory; raises InputError for a name that is none."""
        stage = cls(**memory)
        if stage.name not in (GROWING, REFINING, OVER):
            raise InputError(f"stage of a checkpoint is {stage.name!r}; begin anew")
        whole_number("index", stage.index, 0, 10**6)
        return stage
