"""Many photos: options, inputs, what becomes of one, its mark, the table, and Dask's clusters."""

from dataclasses import dataclass
from functools import partial
from typing import Annotated

from annotated_types import Interval

from gauss2svg.options import OptionGroup, file_name

_MOST_WORKERS = 1024  # more cores than a machine has; more processes are a slip of the keyboard


@dataclass(frozen=True, kw_only=True)
class BatchOptions(OptionGroup):
    """Where a batch runs."""

    workers: Annotated[int | None, Interval(ge=1, le=_MOST_WORKERS)] = None
    """Number of worker processes on this machine. The default is one for each core, or as many as
    the memory allows."""

    scheduler: Annotated[str | None, partial(file_name, needed="the address of a scheduler")] = None
    """Address of a Dask scheduler whose workers do the work, such as tcp://host:8786."""
