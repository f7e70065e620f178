"""Vectorise many photos, on this machine or on a Dask cluster.

A batch writes an SVG and a record of each photo, and one table of all photos.
"""

import re
from dataclasses import dataclass
from typing import Annotated, Any

from gauss2svg.errors import quoted, refusal
from gauss2svg.options import Interval, OptionGroup


def _check_address(name: str, value: Any) -> str:
    """Return the address of a Dask scheduler. Raise InputError if it is not of the right form."""
    if not re.fullmatch(r"((tcp|tls|wss?|ucx)://)?[^\s/]+:\d{1,5}", str(value)):
        needed = "an address of a Dask scheduler with a port"
        raise refusal(name, needed, quoted(value), "tcp://host:8786")
    return str(value)


@dataclass(frozen=True, kw_only=True)
class BatchOptions(OptionGroup):
    """Options of the processes that run a batch."""

    # Few machines have 1024 cores, so a larger number is probably a mistake.
    workers: Annotated[int | None, Interval(ge=1, le=1024)] = None
    """Number of worker processes on this machine. The default is one for each core, or as many as
    the memory allows."""

    scheduler: Annotated[str | None, _check_address] = None
    """Address of a Dask scheduler whose workers do the work, such as tcp://host:8786."""
