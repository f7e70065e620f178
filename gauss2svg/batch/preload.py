"""What a worker process of this machine does before it takes up work; Dask imports it by name."""

import signal
from typing import Any

from gauss2svg.batch import work  # noqa: F401 (workers that start together import it together)


def dask_setup(_: Any) -> None:
    """Ignore Ctrl-C, which at a terminal reaches all its processes: the driver ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
