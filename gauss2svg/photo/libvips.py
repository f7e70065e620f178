"""libvips in this process: its cache, its warnings, and the rows of its pictures.

Rows are fetched in the calling thread: libvips starts no pool of threads, which a forked process
would lack, and which `--threads` would have to limit.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pyvips
from numpy.typing import NDArray

from gauss2svg.photo.reduce import rows_at_once

TYPES = {"uchar": np.uint8, "ushort": np.uint16, "float": np.float32}


class _Warnings(logging.Handler):
    """What libvips warns of in each thread, which Python would write to standard error."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._local = threading.local()

    def emit(self, record: logging.LogRecord) -> None:
        lines = record.getMessage().removeprefix("VIPS: ").splitlines()
        self.of_thread.extend(line for line in lines if line)

    @property
    def of_thread(self) -> list[str]:
        return self._local.__dict__.setdefault("messages", [])


_warnings = _Warnings()
_log = logging.getLogger("pyvips")
_log.addHandler(_warnings)
_log.setLevel(logging.WARNING)  # whatever that of the program's log is
pyvips.cache_set_max(0)  # operations of the past, with their photos


def rows(picture: Any) -> Iterator[NDArray[Any]]:
    """Yield all rows (n, w, channels) of a picture from the top, some at a time."""
    region, width, height = pyvips.Region.new(picture), picture.width, picture.height
    step = rows_at_once(width, picture.bands)
    for top in range(0, height, step):
        fetched = region.fetch(0, top, width, min(step, height - top))
        yield np.frombuffer(fetched, TYPES[picture.format]).reshape(-1, width, picture.bands)


def forget_warnings() -> None:
    """Clear the warnings of this thread, and the messages that libvips would add to the next."""
    pyvips.Error("")
    _warnings.of_thread.clear()


def warnings() -> list[str]:
    """Return what libvips has warned of in this thread since `forget_warnings`."""
    return _warnings.of_thread
