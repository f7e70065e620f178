"""What a worker process of this machine does before it takes up work; Dask imports it by name."""

import signal
from typing import Any

from gauss2svg.batch import work  # noqa: F401 (workers that start together import it together)


def dask_setup(_: Any) -> None:
    """Ignore Ctrl-C, and Ctrl-Break of Windows: at a terminal they reach all its processes.

    The driver ends its workers.
    """
    for name in ("SIGINT", "SIGBREAK"):
        if number := getattr(signal, name, None):
            signal.signal(number, signal.SIG_IGN)
