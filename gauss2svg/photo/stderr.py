"""Silencing C libraries, which write to the standard error of the process by themselves."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_STANDARD_ERROR = 2
_owned = ContextVar("standard error is the command's own", default=False)


@contextmanager
def own_standard_error() -> Iterator[None]:
    """Let `stderr_silenced` work inside: a command may silence itself, a library not its host."""
    token = _owned.set(True)
    try:
        yield
    finally:
        _owned.reset(token)


@contextmanager
def stderr_silenced() -> Iterator[None]:
    """Silence standard error inside if it is the command's own: errors are raised too."""
    if not _owned.get():
        yield
        return
    try:
        kept = os.dup(_STANDARD_ERROR)
    except OSError:  # it is closed
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, _STANDARD_ERROR)
    os.close(nowhere)
    try:
        yield
    finally:
        os.dup2(kept, _STANDARD_ERROR)
        os.close(kept)
