"""Many photos on Dask: inputs, shards, what a worker does with one, records, a table."""

from collections.abc import Callable

# A Ctrl-C is lost where what it raises is in a callback of Python's garbage collector or of C code:
# the handler of a command leaves it here as well.
pending: Callable[[], None] | None = None


def raise_pending() -> None:
    """Raise again what a signal has raised; called between tasks and at the end of a command."""
    if pending is not None:
        pending()
