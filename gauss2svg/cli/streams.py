"""The standard streams, which may be closed or break, and the messages that commands print."""

from __future__ import annotations

import io
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from typing import IO, Any

from gauss2svg.errors import on_one_line, refusal

_LINE_S = 60.0  # seconds between two lines of progress in a log: some hundreds in a night


def say(line: str) -> None:
    """Print a message of the program on standard error, as one line."""
    print(f"gauss2svg: {on_one_line(line)}", file=sys.stderr)


def standard_stream(stream: Any, name: str) -> IO[bytes]:
    """Return the binary stream under sys.stdin or sys.stdout. Raise InputError if it is closed."""
    if stream is None:  # Python's value for a closed descriptor
        raise refusal(f"standard {name}", "open", "a closed stream", "a file name instead of -")
    return stream.buffer


def write_output(data: bytes) -> None:
    """Write to standard output. Raise InputError if it is closed."""
    stdout = standard_stream(sys.stdout, "output")
    stdout.write(data)
    stdout.flush()


def hold_closed_descriptors() -> None:
    """Open the null device for each closed standard descriptor.

    Otherwise the next file that is opened would get its number, and messages of libraries would go
    into that file. sys.stdin and sys.stdout stay None, which standard_stream detects. sys.stderr
    becomes the null device, because print(file=None) would write to standard output.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # the new descriptor has the lowest free number
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (it stays open until the process ends)


def print_utf8() -> None:
    """Encode what is printed to a pipe or a file as UTF-8, which on Windows is not the default."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and not stream.isatty():
            stream.reconfigure(encoding="utf-8", errors=stream.errors)


def drop_output() -> None:
    """Discard the rest of a broken standard output, because Python would fail again at exit."""
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
    """Yield update(current step, finished steps, total steps), which shows the progress.

    If standard error is no terminal, a line a minute replaces the bar.

    quiet  whether to show nothing
    clock  returns seconds
    """
    from gauss2svg.pipeline.progress_display import terminal_bar

    last_line_at = clock()
    with nullcontext() if quiet else terminal_bar("reading the photos") as show:

        def update(now: str, done: int, total: int) -> None:
            nonlocal last_line_at
            line = f"{done:,} of {total:,}: {now}"
            if show is not None:
                show(line, done / max(total, 1))
            elif not quiet and clock() - last_line_at >= _LINE_S:
                last_line_at = clock()
                say(line)

        yield update
