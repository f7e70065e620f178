"""The standard streams of a process, which may be closed or break."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import Any

from gauss2svg.errors import InputError


def standard_stream(stream: Any, name: str) -> Any:
    """The binary side of sys.stdin or sys.stdout; raises InputError if it is closed."""
    if stream is None:  # Python's value for a closed descriptor
        raise InputError(
            f"standard {name} must be open; got a closed stream. Try a file name instead of -"
        )
    return stream.buffer


def hold_closed_descriptors() -> None:
    """Open the null device for standard descriptors that are closed.

    Otherwise the next file that is opened would get their number, and messages of libraries would
    be written into it. sys.stdin and sys.stdout stay None, which standard_stream detects;
    sys.stderr becomes the null device, because print writes to standard output in place of None.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (for as long as the process runs)


def drop_output() -> None:
    """Discard what a broken standard output does not accept, which would fail again at exit."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError):
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, sys.stdout.fileno())
            os.close(null)
