"""The stage that a fit is in between two of its steps."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from gauss2svg.errors import InputError, quoted
from gauss2svg.fit.saved import Saved, as_saved, checks, whole

GROWING, REFINING, FINISHED = "growing", "refining", "finished"


def _known_name(name: str, value: Any) -> str:
    if value not in (names := (GROWING, REFINING, FINISHED)):
        raise InputError(
            f"stage of a checkpoint must be one of {', '.join(names)}; got {quoted(value)}. Try "
            "a fit without --resume"
        )
    return value


@dataclass
class Stage(Saved):
    """The stage of a fit, and what is still to be done in it.

    name                    GROWING, REFINING or FINISHED
    index, begun            the round of growth, and whether it has begun
    adjust_at, exchange_at  progress at which counts will be adjusted, and colours exchanged
    pruned, quantized       whether that is done
    """

    SAVED = checks(
        name=_known_name,
        index=whole(0, 10**6),
        begun=as_saved,
        adjust_at=as_saved,
        exchange_at=as_saved,
        pruned=as_saved,
        quantized=as_saved,
    )

    name: str = GROWING
    index: int = 0
    begun: bool = False
    adjust_at: list[float] = field(default_factory=list)
    exchange_at: list[float] = field(default_factory=list)
    pruned: bool = False
    quantized: bool = False
