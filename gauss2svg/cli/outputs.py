"""Names of the files that commands write: where they go by default, and what they may be called."""

from __future__ import annotations

import mimetypes
import os
from collections.abc import Iterable
from pathlib import Path

from gauss2svg.errors import InputError, quoted
from gauss2svg.files import STANDARD_STREAM
from gauss2svg.svg.file import check_svg_name, check_type

_OURS = b"written by gauss2svg"  # of the description of every file
_HEAD = 65536  # bytes within which it stands


def default_output(photo: str, overwrite: bool) -> str:
    """The name of the SVG beside a photo: photo.svg of photo.jpg.

    Raises InputError where that is the photo itself or, unless overwrite is True, an existing file
    that gauss2svg did not write.
    """
    if photo == STANDARD_STREAM:
        raise InputError(
            "--output must be given where the photo is standard input. Try -o out.svg, or -o - for "
            "standard output"
        )
    output = Path(photo).with_suffix(".svg")
    if output == Path(photo):
        raise InputError(f"the photo must be an image other than an SVG; got {quoted(photo)}")
    if not overwrite and output.is_file() and not _is_ours(output):
        raise InputError(
            f"{output} must be given by name, for it exists and gauss2svg did not write it. Try "
            f"-o {output} to replace it, or -o with another name"
        )
    return os.fspath(output)


def _is_ours(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return _OURS in file.read(_HEAD)
    except OSError:
        return False


def check_names(files: Iterable[tuple[str, str | os.PathLike[str] | None, str]]) -> None:
    """check_svg_name of further files: option, path or None, and the suffix of what is written."""
    for name, path, suffix in files:
        if path is None:
            continue
        if suffix == ".svg":
            check_svg_name(name, path)
        else:
            known = mimetypes.guess_type(f"x{suffix}")[0]
            allowed = (known,) if known else ()
            check_type(name, os.fspath(path), (*allowed, "text/plain"), suffix)
