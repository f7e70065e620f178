"""Read and write files on this machine and in stores that fsspec can access, such as S3."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gauss2svg.errors import Gauss2SvgError, InputError, OutputError
from gauss2svg.files import make_folder, reason_of, write_atomically

STATE = "gauss2svg-batch"  # folder in the output folder, for the table, the options and the marks
TABLE = f"{STATE}/table.csv"


class _Local:
    """Access to local files, by functions with the same names as in a file system of fsspec."""

    open = staticmethod(open)
    exists = staticmethod(os.path.exists)
    size = staticmethod(os.path.getsize)

    def cat_file(self, path: str) -> bytes:
        return Path(path).read_bytes()

    def ukey(self, path: str) -> str:
        """Return text that changes with the file: its size and the time of its last change."""
        status = os.stat(path)
        return f"{status.st_size} {status.st_mtime_ns}"


def is_url(path: str) -> bool:
    """Return whether a name is a URL, such as s3://bucket/photo.jpg."""
    return "://" in path


@contextmanager
def file_system_of(
    name: str, verb: str = "read", kind: type[Gauss2SvgError] = InputError
) -> Iterator[tuple[Any, str]]:
    """Yield the file system of a path or URL, and the path in that file system.

    An error of the with block is turned into an error of the class `kind`, whose message begins
    with "cannot `verb`". Only a Gauss2SvgError and a MemoryError stay as they are.
    """
    advice = "the path or the URL of a photo, a folder, a glob or a list"
    try:
        if is_url(name):
            advice = 'pip install "gauss2svg[s3]", or the package of another store'
            from fsspec.core import url_to_fs

            advice = "another URL, or the same command again"
            fs, path = url_to_fs(name)
            # Without this, files that are written after a listing would seem to be missing.
            fs.dircache.use_listings_cache = False
            yield fs, path
        else:
            yield _Local(), name
    except (Gauss2SvgError, MemoryError):
        raise
    except Exception as error:  # stores raise exceptions of their own classes
        raise kind(f"cannot {verb} {name}: {reason_of(error)}. Try {advice}") from error


def write(root: str, name: str, data: bytes) -> None:
    """Write the file `name` in the folder `root`, either the whole file or nothing.

    Folders are created. Raise OutputError if the file cannot be written.
    """
    target = f"{root}/{name}"
    if is_url(target):
        with file_system_of(target, "write", OutputError) as (fs, path):
            fs.pipe_file(path, data)
    else:
        make_folder(Path(target).parent)
        write_atomically(target, data)
