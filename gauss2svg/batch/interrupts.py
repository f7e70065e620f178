"""A Ctrl-C that was lost, as what it raises is in a callback of Python's garbage collector.

The handler of a command remembers it in `pending`, and a loop that waits for tasks raises it again.
"""

from __future__ import annotations

from collections.abc import Callable

pending: Callable[[], None] | None = None


def raise_pending() -> None:
    """Raise what a signal has raised, if one came."""
    if pending is not None:
        pending()
