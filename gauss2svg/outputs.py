"""Files and streams that a command is given by name, and pictures as they are put into them."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.atomic import check_writable
from gauss2svg.errors import InputError

STANDARD_STREAM = "-"


def refuse_option_like(*names: str) -> None:
    """Raise InputError for a name that begins with -, unless it is the standard stream."""
    for name in names:
        if name.startswith("-") and name != STANDARD_STREAM:
            raise InputError(f"{name} reads like an option; for a file of that name give ./{name}")


def check_targets(inputs: Mapping[str, str], targets: Sequence[Path]) -> None:
    """Refuse outputs that could not be written or would overwrite an input or each other.

    inputs  what each file that is read is, by its name: {"photo.jpg": "the photo"}
    Raises InputError for a clash, OutputError for a target that cannot be written.
    """
    taken = {
        os.path.realpath(name): what for name, what in inputs.items() if name != STANDARD_STREAM
    }
    for target in targets:
        place = os.path.realpath(target)
        if place in taken:
            raise InputError(
                f"{target} is also {taken[place]}; give each its own name so that nothing is lost"
            )
        taken[place] = "another output"
    for target in targets:
        check_writable(target)  # told now, not after the work


def standard_stream(stream: Any, name: str) -> Any:
    """The binary side of sys.stdin or sys.stdout; raises InputError if it is closed."""
    if stream is None:  # what Python makes of a closed descriptor
        raise InputError(f"standard {name} is closed; give a file name instead of -")
    return stream.buffer


def as_png(pixels: NDArray[np.floating]) -> bytes:
    """PNG of a picture (h, w, 3), or (h, w, 4) with alpha, in 0..1, on 8 bits a channel."""
    stream = io.BytesIO()
    Image.fromarray(np.round(pixels * 255).astype(np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def as_json(report: Mapping[str, Any]) -> bytes:
    """A report as indented JSON; a ValueError where it has an infinity or NaN."""
    return (json.dumps(report, indent=2, allow_nan=False) + "\n").encode()
