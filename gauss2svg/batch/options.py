"""Options of a batch besides those of a vectorisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any
from urllib.parse import urlsplit

from gauss2svg.errors import InputError, quoted
from gauss2svg.options import OptionGroup, Whole

_PROTOCOLS = ("tcp://", "tls://", "ws://", "wss://", "ucx://")  # of Dask, between machines
_MOST_WORKERS = 1024  # more cores than a machine has; more processes are a slip of the keyboard


def address(name: str, value: Any) -> str:
    """An address of a scheduler; raises InputError for what cannot be one."""
    if not isinstance(value, str) or not _is_address(value.strip()):
        raise InputError(
            f"{name} must be HOST:PORT, or one of {', '.join(_PROTOCOLS)} before it; got "
            f"{quoted(value)}. Try tcp://host:8786"
        )
    return value.strip()


def _is_address(text: str) -> bool:
    protocol, _, place = text.rpartition("://")
    if protocol == "inproc":  # within this process: machine, process, number
        return len(place.split("/")) == 3
    try:
        parts = urlsplit(f"//{place}")
        is_whole = bool(parts.hostname) and bool(parts.port)
    except ValueError:  # of the port, or of brackets
        return False
    has_more = parts.path.strip("/") or parts.query or parts.fragment or " " in place
    return is_whole and not has_more and (not protocol or f"{protocol}://" in _PROTOCOLS)


@dataclass(frozen=True, kw_only=True)
class BatchOptions(OptionGroup):
    """Where a batch runs, and what of an earlier run it takes up."""

    workers: Annotated[int | None, Whole(1, _MOST_WORKERS)] = None
    """Number of worker processes on this machine. The default is one for each core, or as many as
    the memory allows."""

    scheduler: Annotated[str | None, address] = None
    """Address of a Dask scheduler whose workers do the work, such as tcp://host:8786."""

    retry_failed: bool = False
    """Try again the photos that failed in an earlier run."""
