"""Options of a batch besides those of a vectorisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from gauss2svg.options import OptionGroup, Whole

_MOST_WORKERS = 1024  # more cores than a machine has; more processes are a slip of the keyboard


@dataclass(frozen=True, kw_only=True)
class BatchOptions(OptionGroup):
    """Where a batch runs, and what of an earlier run it takes up."""

    workers: Annotated[int | None, Whole(1, _MOST_WORKERS)] = None
    """Number of worker processes on this machine; one for each core if not given, or as many as the
    memory allows."""

    scheduler: str | None = None
    """Address of a Dask scheduler, such as tcp://host:8786, whose workers do the work."""

    retry_failed: bool = False
    """Also take up photos at which an earlier run failed."""
