"""Set the loaders, the cache and the warnings of libvips, and fetch the samples of its pictures.

The settings hold for the whole process. Samples are fetched in the calling thread, so that libvips
starts no pool of threads. `--threads` would not limit such a pool, and a forked process would not
have its threads.
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
_ROWS = 4  # number of rows that are fetched at a time


# The attribute `warnings` has the warnings of the call of `samples` that runs in this thread.
_thread = threading.local()
# Only one thread at a time fetches samples, because libvips collects its messages in one place for
# the whole process.
_lock = threading.Lock()


def _collect(record: logging.LogRecord) -> bool:
    """Add a warning of libvips to those of this thread.

    Return False, so that the warning is not logged.
    """
    lines = record.getMessage().removeprefix("VIPS: ").splitlines()
    vars(_thread).get("warnings", []).extend(filter(None, lines))
    return False


logging.getLogger("pyvips").addFilter(_collect)
# Without a level of its own, this logger would drop warnings if the root logger is at ERROR.
logging.getLogger("pyvips").setLevel(logging.WARNING)
pyvips.cache_set_max(0)  # a cache would keep earlier photos in memory
# Block all loaders except the five below. This blocks formats such as SVG and PDF.
pyvips.operation_block_set("VipsForeignLoad", True)
for _loader in ("Jpeg", "Png", "Webp", "Tiff", "Heif"):
    pyvips.operation_block_set(f"VipsForeignLoad{_loader}", False)


def samples(make: Callable[[], Any]) -> tuple[NDArray[Any], list[str]]:
    """Return the samples (h, w, bands) of a picture, and the warnings of libvips about it.

    make  function that returns the picture

    libvips gives some warnings only when the picture is freed. To collect these too, the caller
    must not keep a reference to the picture.
    """
    with _lock:
        _thread.warnings = []
        # libvips would otherwise add its old messages to the next warning.
        pyvips.vips_lib.vips_error_clear()
        picture = make()
        width, height, bands = picture.width, picture.height, picture.bands
        array = np.empty((height, width, bands), TYPES[picture.format])
        region = pyvips.Region.new(picture)
        for top in range(0, height, _ROWS):
            rows = min(_ROWS, height - top)
            fetched = np.frombuffer(region.fetch(0, top, width, rows), array.dtype)
            array[top : top + rows] = fetched.reshape(-1, width, bands)
        del region, picture
        return array, vars(_thread).pop("warnings")
