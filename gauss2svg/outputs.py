"""Files that a command is given by name, and pictures as they are put into them."""

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

from gauss2svg.atomic import check_writable, folds_case
from gauss2svg.errors import InputError
from gauss2svg.streams import STANDARD_STREAM


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
    taken = {name: what for name, what in inputs.items() if name != STANDARD_STREAM}
    for target in map(os.fspath, targets):
        for name, what in taken.items():
            if _are_one(name, target):
                raise InputError(
                    f"{target} is also {what}; give each its own name so that nothing is lost"
                )
        taken[target] = "another output"
    for target in targets:
        check_writable(target)  # told now, not after the work


def _are_one(name: str, other: str) -> bool:
    """Whether two names are one file's: by links of either kind, or by case where it is folded."""
    first, second = (os.path.realpath(path) for path in (name, other))
    if first == second:
        return True
    try:
        if os.path.lexists(first) and os.path.lexists(second):
            return os.path.samefile(first, second)
    except (OSError, ValueError):
        return False  # told where it is read or written
    # Neither is there, or one alone is: a file system that folds case would know both.
    return first.casefold() == second.casefold() and folds_case(os.path.dirname(second))


def as_png(pixels: NDArray[np.floating]) -> bytes:
    """PNG of a picture (h, w, 3), or (h, w, 4) with alpha, in 0..1, on 8 bits a channel."""
    stream = io.BytesIO()
    Image.fromarray(np.round(pixels * 255).astype(np.uint8)).save(stream, "PNG")
    return stream.getvalue()


def as_json(report: Mapping[str, Any]) -> bytes:
    """A report as indented JSON; a ValueError where it has an infinity or NaN."""
    return (json.dumps(report, indent=2, allow_nan=False) + "\n").encode()
