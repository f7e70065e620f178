"""Handle signals, print messages, and prepare for standard streams that are closed or fail.

If Ctrl-C, SIGTERM or Ctrl-Break comes during the fit, the fit ends, and the command writes the best
result so far. A second signal ends the command at once. A signal before the fit also ends the
command at once, because there is nothing to write yet. If the first signal comes after the fit, the
command still measures and writes the result. Every file is either written completely or left
untouched.
"""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from types import FrameType
from typing import Any

from gauss2svg import processes
from gauss2svg.errors import on_one_line

SIGNALS: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM)  # signals that end a command
if sys.platform == "win32":
    # Windows sends SIGBREAK after Ctrl-Break and when a console is closed. The command handles it
    # like SIGTERM, which programs on Windows do not send to each other.
    SIGNALS += (signal.SIGBREAK,)


class Terminated(KeyboardInterrupt):
    """The exception for SIGTERM and Ctrl-Break. The one for Ctrl-C is KeyboardInterrupt."""


class Interruption:
    """Record of the signals that ask a fit to end.

    signal  number of the last signal, or None if no signal has come
    The method `receive` is a signal handler, which has to be passed to `handling`.
    """

    def __init__(self) -> None:
        self.signal: int | None = None
        self._has_fitted = False

    def should_stop(self) -> bool:
        """Return whether the fit should end. The fit calls this method after every step."""
        if not self._has_fitted:
            # If a signal has already come, the command ends here, because there is nothing to write
            # yet.
            processes.pending()
        self._has_fitted = True
        return self.signal is not None

    def receive(self, number: int, _frame: FrameType | None) -> None:
        """Handle a signal: end the fit, or end the command at once.

        The command ends at once if this is the second signal, or if the fit has not begun.
        """
        is_first, self.signal = self.signal is None, number
        if not self._has_fitted:
            _quit_before_fit(number)
        if not is_first or not self._has_fitted:
            raise_for(number)
        _write_line("writing the best result so far; interrupt again to quit at once")


def _write_line(line: str) -> None:
    # This does not call print(), because the signal may have interrupted a call of print(), and
    # print() fails if it is called inside itself.
    with suppress(OSError):
        # In a terminal, the cursor may be in the line of a progress bar.
        os.write(2, b"\n" * os.isatty(2) + f"gauss2svg: {line}\n".encode())


def status_of(number: int) -> int:
    """Return the exit status after a signal: 130 for SIGINT, and 143 for the other SIGNALS."""
    return 128 + (signal.SIGINT if number == signal.SIGINT else signal.SIGTERM)


def raise_for(number: int, _frame: FrameType | None = None) -> None:
    """Raise KeyboardInterrupt for SIGINT, and Terminated for any other signal.

    Python may drop this exception, so processes.pending() is set to raise it once more.
    """
    processes.pending = partial(raise_for, number)
    raise KeyboardInterrupt if number == signal.SIGINT else Terminated


def exit_for(number: int, _frame: FrameType | None = None) -> None:
    """Handle a signal: print a line on standard error, and end the process without cleaning up.

    The handler does not raise an exception, because a callback of a C library could lose it, or it
    could leave a module half imported.
    """
    _write_line("interrupted; every file is whole or untouched")
    os._exit(status_of(number))


_quit_before_fit: Callable[[int], None] = raise_for


def exit_before_fits() -> None:
    """Let a signal end the process at once during start-up.

    Start-up lasts until the fit begins in the main command, and until the command's own code begins
    in any other command.
    """
    global _quit_before_fit
    _quit_before_fit = exit_for
    _set_handlers(dict.fromkeys(SIGNALS, exit_for))


@contextmanager
def handling(handler: Callable[[int, FrameType | None], None] = raise_for) -> Iterator[None]:
    """Let `handler` handle SIGNALS inside the `with` block, if this is the main thread.

    If a callback of a C library or a __del__ method drops the exception that `raise_for` raised,
    the exception is raised again, at the latest when the block ends. Python's message "Exception
    ignored" is not printed for it.
    """
    is_main = threading.current_thread() is threading.main_thread()
    before = _set_handlers(dict.fromkeys(SIGNALS, handler)) if is_main else {}
    print_swallowed = sys.unraisablehook

    def print_others(swallowed: Any) -> None:
        if not isinstance(swallowed.exc_value, KeyboardInterrupt):
            print_swallowed(swallowed)

    if is_main:
        sys.unraisablehook = print_others
    try:
        processes.pending()  # raises an exception if a signal has come before
        yield
        processes.pending()
    finally:
        _set_handlers(before)
        if is_main:
            sys.unraisablehook = print_swallowed
        processes.pending = processes.nothing


def ignore_signals() -> None:
    """Ignore signals from now on, because the exit status of the command is already known."""
    _set_handlers(dict.fromkeys(SIGNALS, signal.SIG_IGN))


def _set_handlers(handlers: Mapping[int, Any]) -> dict[int, Any]:
    """Set a handler for each signal, and return the previous handlers.

    A signal that this process already ignores stays ignored. A process ignores signals from its
    start if nohup has started it, for example, or if a shell without job control has started it in
    the background.
    """
    before = {number: signal.getsignal(number) for number in handlers}
    for number, handler in handlers.items():
        if handler is not None and before[number] is not signal.SIG_IGN:
            signal.signal(number, handler)
    return before


def say(line: str) -> None:
    """Print a message of the program on standard error, as one line."""
    print(f"gauss2svg: {on_one_line(line)}", file=sys.stderr)


def hold_closed_descriptors() -> None:
    """Open the null device for each closed standard descriptor.

    Otherwise the next file that is opened would get that descriptor, and messages of libraries
    would go into it. sys.stdin and sys.stdout stay None, which files.standard_stream detects.
    sys.stderr becomes the null device, because print(file=None) would write to standard output.
    """
    for descriptor in (0, 1, 2):
        try:
            os.fstat(descriptor)
        except OSError:
            # The null device gets the number `descriptor`, because the system gives an opened
            # file the lowest free number.
            os.open(os.devnull, os.O_RDWR)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (it stays open until the process ends)


def print_utf8() -> None:
    """Encode what is printed to a pipe or a file as UTF-8, which is not the default on Windows."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and not stream.isatty():
            stream.reconfigure(encoding="utf-8", errors=stream.errors)


def drop_output() -> None:
    """If the text in the buffer of standard output cannot be written, discard the text.

    Otherwise Python would try to write this text at exit, and would fail.
    """
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextmanager
def counting_bar(quiet: bool) -> Iterator[Callable[[str, int, int], None]]:
    """Show a progress bar on standard error, and yield a function that moves the bar.

    The function is update(current step, finished steps, total steps). If standard error is not a
    terminal, there is no bar, and `update` prints a line every minute instead.

    quiet  whether to show nothing
    """
    from gauss2svg.pipeline.progress_display import counted, terminal_bar

    last_line_at = time.monotonic()
    with nullcontext() if quiet else terminal_bar("reading the photos") as show:

        def update(now: str, done: int, total: int) -> None:
            nonlocal last_line_at
            line, share = counted(now, done, total)
            if show is not None:
                show(line, share)
            elif not quiet and time.monotonic() - last_line_at >= 60:
                # A run of one night writes only hundreds of lines.
                last_line_at = time.monotonic()
                say(line)

        yield update
