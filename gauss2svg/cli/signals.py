"""Ctrl-C and SIGTERM: the first ends a fit with the best so far, the second ends everything.

A signal before the fit has begun ends everything as well: there is nothing to write yet.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_ENDING = b"gauss2svg: ending after this step with the best so far; once more ends at once\n"
STATUS_OF_SIGNAL = 128  # plus its number, as shells count


class Terminated(KeyboardInterrupt):
    """SIGTERM came, and is to end what runs like a Ctrl-C does."""


class Interruption:
    """Whether a signal has asked a fit to end; made by `interruptible`."""

    def __init__(self) -> None:
        self.signal: int | None = None
        self._fitting = False

    def asked(self) -> bool:
        """For the `stop` of `vectorize`: asked after every step, so a fit is under way."""
        self._fitting = True
        return self.signal is not None

    @property
    def status(self) -> int:
        """Exit status: 0, or what shells give for the signal that came."""
        return 0 if self.signal is None else STATUS_OF_SIGNAL + self.signal

    def _receive(self, number: int, _frame: FrameType | None) -> None:
        first, self.signal = self.signal is None, number
        if not (first and self._fitting):
            raise_for(number)
        # Not by print: the main thread may be inside of one.
        with suppress(OSError):
            os.write(2, _ENDING)


def raise_for(number: int, _frame: FrameType | None = None) -> None:
    """Raise KeyboardInterrupt for SIGINT, Terminated for SIGTERM; a handler of both."""
    raise Terminated if number == signal.SIGTERM else KeyboardInterrupt


@contextmanager
def terminable() -> Iterator[None]:
    """Inside SIGTERM is raised as Terminated, so that files are closed and children ended."""
    with _handled((signal.SIGTERM,), raise_for):
        yield


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Inside signals are received by the Interruption; only in the main thread there are any."""
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
            # What was ignored when the program began, as by nohup and in the background of a
            # shell without job control, stays ignored.
            if before[number] is not signal.SIG_IGN:
                signal.signal(number, handler)  # pyright: ignore[reportArgumentType]
        yield
    finally:
        for number, old in before.items():
            if old is not None:
                signal.signal(number, old)
