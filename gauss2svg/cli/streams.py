"""The standard streams of a process: some may be closed, and some break."""

from __future__ import annotations

import os
import sys
from contextlib import suppress
from typing import Any

from gauss2svg.errors import InputError


def standard_stream(stream: Any, name: str) -> Any:
    """The binary side of sys.stdin or sys.stdout; raises InputError if it is closed."""
    if stream is None:  # what Python makes of a closed descriptor
        raise InputError(f"standard {name} is closed; give a file name instead of -")
    return stream.buffer


def hold_closed_descriptors() -> None:
    """Give standard descriptors that are closed to the null device.

    The next file that is opened would get their number, and what a library says there would go
    into it. sys.stdin and sys.stdout stay None, by which standard_stream knows; sys.stderr
    becomes the null device, for print would take standard output in place of None.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the least number that is free
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")  # noqa: SIM115 (for as long as the process runs)


def drop_output() -> None:
    """Let go of what a broken standard output does not take: the exit would complain once more."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError):
            null = os.open(os.devnull, os.O_WRONLY)
            os.dup2(null, sys.stdout.fileno())
            os.close(null)
