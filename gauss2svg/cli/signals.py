"""Ctrl-C, SIGTERM, Ctrl-Break: the first ends a fit with the best result so far, the second quits.

A signal before the fit quits as well, because there is nothing to write yet. After the fit the
first signal lets the command write and measure the result. Files are whole or untouched.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import partial
from types import FrameType
from typing import Any

from gauss2svg import processes

_QUITTING = b"gauss2svg: interrupted; every file is whole or untouched\n"
_SHOW_CURSOR = b"\x1b[?25h"  # which a progress bar hides
_ENDING = b"gauss2svg: writing the best result so far; interrupt again to quit at once\n"


SIGNALS: tuple[int, ...] = (signal.SIGINT, signal.SIGTERM)  # signals that end a command
if sys.platform == "win32":
    # Closing a console sends Ctrl-Break as well; no other program sends SIGTERM there.
    SIGNALS += (signal.SIGBREAK,)


class Terminated(KeyboardInterrupt):
    """Raised by SIGTERM and Ctrl-Break, as KeyboardInterrupt is by Ctrl-C."""


class Interruption:
    """Whether a signal has asked the fit to end, while `handling` has `receive` as its handler."""

    def __init__(self) -> None:
        self.signal: int | None = None
        self._has_fitted = False

    def asked(self) -> bool:
        """Return whether the fit is to end; the `stop` of `vectorize`, called after every step."""
        if not self._has_fitted:
            processes.pending()  # there is nothing to write
        self._has_fitted = True
        return self.signal is not None

    def receive(self, number: int, _frame: FrameType | None) -> None:
        """Note the first signal once a fit has begun, and quit at any other; a signal handler."""
        first, self.signal = self.signal is None, number
        if not self._has_fitted:
            _before_the_fit(number)
        if not first or not self._has_fitted:
            raise_for(number)
        _tell(_ENDING)


def _tell(line: bytes) -> None:
    # Not by print, which the main thread may be executing.
    with suppress(OSError):
        os.write(2, line)


def status_of(number: int) -> int:
    """Return the exit status after a signal: that of shells, and for Ctrl-Break that of SIGTERM."""
    return 128 + (signal.SIGINT if number == signal.SIGINT else signal.SIGTERM)


def raise_for(number: int, _frame: FrameType | None = None) -> None:
    """Raise KeyboardInterrupt for SIGINT, Terminated for the others; a signal handler."""
    processes.pending = partial(raise_for, number)
    raise KeyboardInterrupt if number == signal.SIGINT else Terminated


def exit_for(number: int, _frame: FrameType | None = None) -> None:
    """End the process at once, with one line; a signal handler for when nothing is to be cleaned.

    An exception could be lost in a callback of a C library, or end an import half-way.
    """
    _tell((_SHOW_CURSOR if os.isatty(2) else b"") + _QUITTING)
    os._exit(status_of(number))


_before_the_fit: Callable[[int], None] = raise_for


def exit_before_fits() -> None:
    """Let signals end a command's process at once, until a fit or another command runs."""
    global _before_the_fit
    _before_the_fit = exit_for
    _set(dict.fromkeys(SIGNALS, exit_for))


@contextmanager
def handling(handler: Callable[[int, FrameType | None], None] = raise_for) -> Iterator[None]:
    """Let a handler receive SIGNALS inside, if this is the main thread.

    What it raises, and a callback of a C library loses, is raised again at the end at the latest.
    """
    is_main = threading.current_thread() is threading.main_thread()
    before = _set(dict.fromkeys(SIGNALS, handler)) if is_main else {}
    try:
        processes.pending()  # what came before
        yield
        processes.pending()
    finally:
        _set(before)
        processes.pending = processes.nothing


def ignore() -> None:
    """Let signals change nothing any more: the status of the command is known."""
    _set(dict.fromkeys(SIGNALS, signal.SIG_IGN))


def _set(handlers: Mapping[int, Any]) -> dict[int, Any]:
    """Set handlers of signals, and return those that they replace.

    Signals that were ignored at the start stay ignored, as by nohup or in the background of a shell
    without job control.
    """
    before = {number: signal.getsignal(number) for number in handlers}
    for number, handler in handlers.items():
        if handler is not None and before[number] is not signal.SIG_IGN:
            signal.signal(number, handler)
    return before
