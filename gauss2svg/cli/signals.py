"""Ctrl-C and SIGTERM: the first ends a fit with the best result so far, the second quits.

A signal before the fit quits as well, because there is nothing to write yet.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_ENDING = b"gauss2svg: writing the best result so far; interrupt again to quit at once\n"
STATUS_OF_SIGNAL = 128  # plus the number of the signal, as in shells


class Terminated(KeyboardInterrupt):
    """Raised by SIGTERM, as KeyboardInterrupt is by Ctrl-C."""


class Interruption:
    """Whether a signal has asked the fit to end; created by `interruptible`."""

    def __init__(self) -> None:
        self.signal: int | None = None
        self._fitting = False

    def asked(self) -> bool:
        """The `stop` of `vectorize`; it is called after every step, so a fit is under way."""
        self._fitting = True
        return self.signal is not None

    @property
    def status(self) -> int:
        """Exit status: 0, or that of shells for the signal."""
        return 0 if self.signal is None else STATUS_OF_SIGNAL + self.signal

    def _receive(self, number: int, _frame: FrameType | None) -> None:
        first, self.signal = self.signal is None, number
        if not (first and self._fitting):
            raise_for(number)
        # Not by print, which the main thread may be executing.
        with suppress(OSError):
            os.write(2, _ENDING)


def raise_for(number: int, _frame: FrameType | None = None) -> None:
    """Raise KeyboardInterrupt for SIGINT, Terminated for SIGTERM; a signal handler."""
    raise Terminated if number == signal.SIGTERM else KeyboardInterrupt


@contextmanager
def terminable() -> Iterator[None]:
    """Inside SIGTERM raises Terminated, so that files are closed and child processes end."""
    with _handled((signal.SIGTERM,), raise_for):
        yield


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Inside the Interruption receives signals, if this is the main thread."""
    interruption = Interruption()
    with _handled(_SIGNALS, interruption._receive):
        yield interruption


@contextmanager
def _handled(signals: tuple[signal.Signals, ...], handler: object) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {number: signal.getsignal(number) for number in signals}
    try:
        for number in signals:
            # Signals that were ignored at the start stay ignored, as by nohup or in the background
            # of a shell without job control.
            if before[number] is not signal.SIG_IGN:
                signal.signal(number, handler)  # pyright: ignore[reportArgumentType]
        yield
    finally:
        for number, old in before.items():
            if old is not None:
                signal.signal(number, old)
