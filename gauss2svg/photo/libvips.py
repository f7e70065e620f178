"""libvips in this process: its loaders, its cache, its warnings, and the samples of its pictures.

Samples are fetched in the calling thread: libvips starts no pool of threads, which a forked process
would lack, and which `--threads` would have to limit.
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
_ROWS = 4  # that are fetched at once


_kept = threading.local()  # warnings of libvips in each thread
# The messages from which libvips makes a warning belong to the process.
_one_photo = threading.RLock()


def _keep(record: logging.LogRecord) -> bool:
    """Keep a warning that Python would write to standard error."""
    lines = record.getMessage().removeprefix("VIPS: ").splitlines()
    vars(_kept).setdefault("warnings", []).extend(line for line in lines if line)
    return False


logging.getLogger("pyvips").addFilter(_keep)
logging.getLogger("pyvips").setLevel(logging.WARNING)  # whatever that of the program's log is
pyvips.cache_set_max(0)  # operations of the past, with their photos
# The package has loaders of other formats too, such as SVG and PDF.
pyvips.operation_block_set("VipsForeignLoad", True)
for _loader in ("Jpeg", "Png", "Webp", "Tiff", "Heif"):
    pyvips.operation_block_set(f"VipsForeignLoad{_loader}", False)


def samples(make: Callable[[], Any]) -> tuple[NDArray[Any], list[str]]:
    """Return the samples (h, w, bands) of a picture that is made here, and what libvips warns of.

    Some warnings come when the picture is freed, so the caller must not hold it.
    """
    with _one_photo:
        pyvips.vips_lib.vips_error_clear()  # messages that libvips would add to the next
        warnings: list[str] = []
        _kept.warnings = warnings
        picture = make()
        width, height, bands = picture.width, picture.height, picture.bands
        array = np.empty((height, width, bands), TYPES[picture.format])
        region = pyvips.Region.new(picture)
        for top in range(0, height, _ROWS):
            fetched = region.fetch(0, top, width, min(_ROWS, height - top))
            array[top : top + _ROWS] = np.frombuffer(fetched, array.dtype).reshape(-1, width, bands)
        del region, picture
    return array, warnings
