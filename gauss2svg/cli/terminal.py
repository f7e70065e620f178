"""Handle signals, print messages, and prepare for standard streams that are closed or fail.

If Ctrl-C, SIGTERM or Ctrl-Break comes during the fit, the fit ends, and the command writes the best
result so far. A second signal ends the command at once, unless it comes at the same moment: the
program `timeout` sends each signal twice, to the process and to its group. A signal before the fit
also ends the command at once, because there is nothing to write yet. If the first signal comes
after the fit, the command still measures and writes the result. Every file is either written
completely or left untouched.
"""

import io
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any

from gauss2svg.errors import on_one_line

# Signals that end a command. Windows sends SIGBREAK after Ctrl-Break and when a console is closed.
SIGNALS = {signal.SIGINT, signal.SIGTERM, getattr(signal, "SIGBREAK", signal.SIGTERM)}
SAME_MOMENT_S = 0.3  # seconds within which a second signal is the first one again
UNTOUCHED = "interrupted; every file is whole or untouched"


class Interruption:
    """Record of the signals that ask a fit to end.

    signal  number of the last signal, or None if no signal has come
    The method `receive` is a signal handler, which has to be passed to `handling`.
    """

    def __init__(self) -> None:
        self.signal: int | None = None
        self._has_fitted, self._first_ends_s = False, math.inf

    def should_stop(self) -> bool:
        """Return whether the fit should end. The fit calls this method after every step."""
        self._has_fitted = True
        return self.signal is not None

    def receive(self, number: int, _frame: FrameType | None) -> None:
        """Handle a signal: end the fit, or end the command at once.

        The command ends at once if this is a second signal, and not the first one again, or if the
        fit has not begun.
        """
        is_first, self.signal = self.signal is None, number
        if not self._has_fitted or time.monotonic() > self._first_ends_s:
            raise_for(number)
        if is_first:
            self._first_ends_s = time.monotonic() + SAME_MOMENT_S
            _write_line("writing the best result so far; interrupt again to quit at once")


def _write_line(line: str) -> None:
    # This does not call print(), because the signal may have interrupted a call of print(), and
    # print() fails if it is called inside itself.
    with suppress(OSError):
        # In a terminal, the cursor may be in the line of a progress bar.
        os.write(2, b"\n" * os.isatty(2) + f"gauss2svg: {line}\n".encode())


class Terminated(KeyboardInterrupt):
    """The exception for SIGTERM and Ctrl-Break. The one for Ctrl-C is KeyboardInterrupt."""


def raise_for(number: int, _frame: FrameType | None = None) -> None:
    """Raise KeyboardInterrupt for SIGINT, and Terminated for any other signal."""
    raise KeyboardInterrupt if number == signal.SIGINT else Terminated


def status_of(number: int) -> int:
    """Return the exit status after a signal: 130 for SIGINT, and 143 for any other."""
    return 128 + (signal.SIGINT if number == signal.SIGINT else signal.SIGTERM)


def exit_for(number: int, _frame: FrameType | None = None) -> None:
    """Handle a signal: print a line on standard error, and end the process without cleaning up.

    The handler does not raise an exception, which could leave a module half imported.
    """
    _write_line(UNTOUCHED)
    os._exit(status_of(number))


@contextmanager
def handling(handler: Callable[[int, FrameType | None], None] = raise_for) -> Iterator[None]:
    """Let `handler` handle signals inside the `with` block."""
    before = set_handlers(dict.fromkeys(SIGNALS, handler))
    try:
        yield
    finally:
        set_handlers(before)


def set_handlers(handlers: Mapping[int, Any]) -> dict[int, Any]:
    """Set a handler for each signal, and return the previous handlers.

    A signal that this process already ignores stays ignored. A process ignores signals from its
    start if nohup has started it, for example, or if a shell without job control has started it in
    the background.
    """
    before = {number: signal.getsignal(number) for number in handlers}
    for number, handler in handlers.items():
        if before[number] is not signal.SIG_IGN:
            signal.signal(number, handler)
    return before


def say(line: str) -> None:
    """Print a message of the program on standard error, as one line."""
    print(f"gauss2svg: {on_one_line(line)}", file=sys.stderr)


def prepare_streams() -> None:
    """Encode what is printed to a pipe or a file as UTF-8, which is not the default on Windows.

    If standard error is closed, discard messages. print(file=None) would write to standard output.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper) and not stream.isatty():
            stream.reconfigure(encoding="utf-8", errors=stream.errors)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115 (it stays open until the process ends)


def drop_output() -> None:
    """If the text in the buffer of standard output cannot be written, discard the text.

    Otherwise Python would try to write this text at exit, and would fail.
    """
    if sys.stdout is not None:
        try:
            sys.stdout.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
