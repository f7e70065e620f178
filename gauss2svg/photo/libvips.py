"""Configure libvips in this process (loaders, cache, warnings), and fetch samples of its pictures.

Samples are fetched in the calling thread, so libvips starts no thread pool. A forked process would
lack the threads of such a pool, and `--threads` would not limit them.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

import numpy as np
import pyvips
from numpy.typing import NDArray

TYPES = {"uchar": np.uint8, "ushort": np.uint16, "float": np.float32}
_ROWS = 4  # number of rows of a picture that are fetched at once


_thread = threading.local()  # its attribute `warnings` lists libvips' warnings in this thread
# Threads fetch one after the other, because libvips collects messages for the whole process.
_lock = threading.RLock()


def _collect(record: logging.LogRecord) -> bool:
    """Collect a warning of libvips, and return False so that it is not logged."""
    lines = record.getMessage().removeprefix("VIPS: ").splitlines()
    vars(_thread).setdefault("warnings", []).extend(line for line in lines if line)
    return False


logging.getLogger("pyvips").addFilter(_collect)
logging.getLogger("pyvips").setLevel(logging.WARNING)  # needed if the root logger is at ERROR
pyvips.cache_set_max(0)  # the cache would keep earlier photos in memory
# Block the loaders of other formats, such as SVG and PDF.
pyvips.operation_block_set("VipsForeignLoad", True)
for _loader in ("Jpeg", "Png", "Webp", "Tiff", "Heif"):
    pyvips.operation_block_set(f"VipsForeignLoad{_loader}", False)


def samples(make: Callable[[], Any]) -> tuple[NDArray[Any], list[str]]:
    """Return the samples (h, w, bands) of the picture that `make` returns, and libvips' warnings.

    Some warnings come when the picture is freed, so the caller must not hold a reference to it.
    """
    with _lock:
        pyvips.vips_lib.vips_error_clear()  # libvips would add old messages to the next warning
        warnings: list[str] = []
        _thread.warnings = warnings
        picture = make()
        width, height, bands = picture.width, picture.height, picture.bands
        array = np.empty((height, width, bands), TYPES[picture.format])
        region = pyvips.Region.new(picture)
        for top in range(0, height, _ROWS):
            fetched = region.fetch(0, top, width, min(_ROWS, height - top))
            array[top : top + _ROWS] = np.frombuffer(fetched, array.dtype).reshape(-1, width, bands)
        del region, picture
    return array, warnings
