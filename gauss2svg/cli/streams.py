"""The standard streams of a process, which may be closed or break, and what commands say there."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import IO, Any

from gauss2svg.errors import on_one_line, refusal

_LINE_S = 60.0  # between two lines of progress in a log, which a night makes some hundreds long


def say(line: str) -> None:
    """Print a line of the program on standard error."""
    print(f"gauss2svg: {on_one_line(line)}", file=sys.stderr)


def standard_stream(stream: Any, name: str) -> IO[bytes]:
    """Return the binary side of sys.stdin or sys.stdout; raise InputError if it is closed."""
    if stream is None:  # Python's value for a closed descriptor
        raise refusal(f"standard {name}", "open", "a closed stream", "a file name instead of -")
    return stream.buffer


def write_output(data: bytes) -> None:
    """Write to standard output; raise InputError if it is closed."""
    stdout = standard_stream(sys.stdout, "output")
    stdout.write(data)
    stdout.flush()


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
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def counting_bar(
    quiet: bool, clock: Callable[[], float] = time.monotonic
) -> Iterator[Callable[[str, int, int], None]]:
    """Yield update(current step, finished steps, total steps), which shows how far a command is.

    clock  seconds: where standard error is no terminal, a line a minute stands in for the bar
    Nothing is shown if quiet.
    """
    from gauss2svg.pipeline.progress_display import terminal_bar

    said = clock()
    with nullcontext() if quiet else terminal_bar("reading the photos") as show:

        def update(now: str, done: int, total: int) -> None:
            nonlocal said
            line = f"{done:,} of {total:,}: {now}"
            if show is not None:
                show(line, done / max(total, 1))
            elif not quiet and clock() - said >= _LINE_S:
                said = clock()
                say(line)

        yield update
