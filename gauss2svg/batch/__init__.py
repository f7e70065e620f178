"""Vectorise many photos, on this machine or on a Dask cluster.

A batch writes an SVG and a record of each photo, and one table of all photos.
"""

from dataclasses import dataclass
from typing import Annotated

from gauss2svg.options import Interval, OptionGroup
from gauss2svg.svg import check_text


@dataclass(frozen=True, kw_only=True)
class BatchOptions(OptionGroup):
    """Options of the processes that run a batch."""

    # Few machines have 1024 cores, so a larger number is probably a mistake.
    workers: Annotated[int | None, Interval(ge=1, le=1024)] = None
    """Number of worker processes on this machine. The default is one for each core, or as many as
    the memory allows."""

    scheduler: Annotated[str | None, check_text] = None
    """Address of a Dask scheduler whose workers do the work, such as tcp://host:8786."""
