"""Read and write files on this machine and in stores that fsspec can access, such as S3."""

from __future__ import annotations

import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from gauss2svg.errors import Gauss2SvgError, InputError, OutputError, refusal
from gauss2svg.files import check_writable, make_folder, reason_of, replace, write_whole

# Folder in the output folder, for the table, the options, the marks and the unfinished files.
STATE = "gauss2svg-batch"
TABLE = f"{STATE}/table.csv"
PARTS = f"{STATE}/parts"  # folder of the unfinished files
MARKS = f"{STATE}/marks"  # folder of the marks
PATH_SEPARATOR = re.compile(r"[/\\]" if os.sep == "\\" else "/")


class _Local:
    """Access to local files, by functions with the same names as in a file system of fsspec.

    The class has only those functions that this package calls.
    """

    open = staticmethod(open)
    put_file = staticmethod(replace)
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
            start, colons, end = name.partition("::")
            # Two colons are in the name of a file, unless another store of a chain follows them.
            if colons and "://" not in end:
                folder, _, start = start.rpartition("/")
                fs, folder = url_to_fs(folder)
                path = f"{folder}/{start}::{end}"
            else:
                fs, path = url_to_fs(name)
            # fsspec's cache of listings is not used. It would keep a million names in memory, and
            # files that are written after a listing would seem to be missing.
            fs.dircache.use_listings_cache = False
            yield fs, path
        else:
            yield _Local(), name
    except (Gauss2SvgError, MemoryError):
        raise
    except Exception as error:  # stores raise exceptions of their own classes
        raise kind(f"cannot {verb} {name}: {reason_of(error)}. Try {advice}") from error


def write(root: str, name: str, data: bytes, sync: bool = True) -> None:
    """Write the file `name` in the folder `root`, either the whole file or nothing.

    A local file is first written into the folder PARTS, which this function does not create. So if
    a worker on another machine cannot see the output folder of the run, it fails, and writes no
    file on that machine. Without `sync`, a power cut may leave an empty local file. Raise
    OutputError if the file cannot be written.
    """
    target = f"{root}/{name}"
    if is_url(target):
        with file_system_of(target, "write", OutputError) as (fs, path):
            fs.pipe_file(path, data)
        return
    make_folder(Path(target).parent)
    write_whole(Path(target), data, Path(root, PARTS, secrets.token_hex(8)), sync)


def prepare(root: str) -> None:
    """Create the output folder `root`.

    Unfinished files of killed runs stay there. A run on another machine may still be writing such a
    file, however old it is.

    Raise OutputError if the folder cannot be written, and InputError for a store in which others
    could see a file half written.
    """
    if is_url(root):
        # In these stores nobody can see a file half written.
        stores = "s3, s3a, gs, gcs, az, abfs, abfss, oss, oci, memory"
        if root.partition("://")[0] not in stores.split(", "):
            raise refusal("output", f"a folder, or on one of {stores}", root, "a folder")
        write(root, f"{PARTS}/writable", b"")
        return
    make_folder(Path(root, PARTS))
    check_writable(Path(root, PARTS, "writable"))
