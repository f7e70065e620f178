"""Vectorise many photos, here or on a Dask cluster, with a record of each and one table."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from annotated_types import Interval

from gauss2svg.options import OptionGroup, file_name

_MAX_WORKERS = 1024  # limit of --workers. No machine has more cores, so a larger number is an error


@dataclass(frozen=True, kw_only=True)
class BatchOptions(OptionGroup):
    """Options of the processes that run a batch."""

    workers: Annotated[int | None, Interval(ge=1, le=_MAX_WORKERS)] = None
    """Number of worker processes on this machine. The default is one for each core, or as many as
    the memory allows."""

    scheduler: Annotated[str | None, partial(file_name, needed="the address of a scheduler")] = None
    """Address of a Dask scheduler whose workers do the work, such as tcp://host:8786."""
