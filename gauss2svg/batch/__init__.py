"""Many photos on Dask: inputs, shards, what a worker does with one, records, a table."""

from collections.abc import Callable

# A Ctrl-C is lost where what it raises is in a callback of Python's garbage collector: the handler
# of a command leaves it here as well, and the loop that waits for tasks raises it again.
pending: Callable[[], None] | None = None
