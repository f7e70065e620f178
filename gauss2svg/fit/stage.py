"""The stage that a fit is in between two of its steps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from gauss2svg.errors import InputError, must_be, whole_number

GROWING, REFINING, FINISHED = "growing", "refining", "finished"

_ADVICE = "a fit without --resume"


@dataclass
class Stage:
    """The stage of a fit, and what is still to be done in it.

    name                    GROWING, REFINING or FINISHED
    index, begun            the round of growth, and whether it has begun
    adjust_at, exchange_at  progress at which counts will be adjusted, and colours exchanged
    pruned, quantized       whether that is done
    """

    name: str = GROWING
    index: int = 0
    begun: bool = False
    adjust_at: list[float] = field(default_factory=list)
    exchange_at: list[float] = field(default_factory=list)
    pruned: bool = False
    quantized: bool = False

    @classmethod
    def from_state_dict(cls, saved: dict[str, Any]) -> Stage:
        """The saved stage; raises InputError for an unknown name."""
        stage = cls(**saved)
        names = (GROWING, REFINING, FINISHED)
        if stage.name not in names:
            needed = f"one of {', '.join(names)}"
            raise InputError(must_be("stage of a checkpoint", needed, stage.name, _ADVICE))
        whole_number("index", stage.index, 0, 10**6)
        return stage
