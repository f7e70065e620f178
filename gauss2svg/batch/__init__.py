"""Many photos: options, inputs, what becomes of one, its mark, the table, and Dask's clusters."""

from dataclasses import dataclass
from typing import Annotated, Any

from gauss2svg.errors import quoted, refusal
from gauss2svg.options import OptionGroup, Whole

_MOST_WORKERS = 1024  # more cores than a machine has; more processes are a slip of the keyboard


def _address(name: str, value: Any) -> str:
    """Return an address, which Dask checks. Raise InputError that names it for no text."""
    if not isinstance(value, str):
        raise refusal(name, "the address of a Dask scheduler", quoted(value), "tcp://host:8786")
    return value


@dataclass(frozen=True, kw_only=True)
class BatchOptions(OptionGroup):
    """Where a batch runs, and what of an earlier run it takes up."""

    workers: Annotated[int | None, Whole(1, _MOST_WORKERS)] = None
    """Number of worker processes on this machine. The default is one for each core, or as many as
    the memory allows."""

    scheduler: Annotated[str | None, _address] = None
    """Address of a Dask scheduler whose workers do the work, such as tcp://host:8786."""

    retry_failed: bool = False
    """Try again the photos that failed in an earlier run."""
