"""Vectorise many photos, on this machine or on a Dask cluster.

A batch writes an SVG and a record of each photo, and one table of all photos.
"""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from gauss2svg.options import Interval, OptionGroup, file_name

# Largest value of --workers. A larger one is probably a mistake, because few machines have as many
# cores.
_MAX_WORKERS = 1024


@dataclass(frozen=True, kw_only=True)
class BatchOptions(OptionGroup):
    """Options of the processes that run a batch."""

    workers: Annotated[int | None, Interval(ge=1, le=_MAX_WORKERS)] = None
    """Number of worker processes on this machine. The default is one for each core, or as many as
    the memory allows."""

    scheduler: Annotated[str | None, partial(file_name, needed="the address of a scheduler")] = None
    """Address of a Dask scheduler whose workers do the work, such as tcp://host:8786."""
