"""Functions that read and write files, both local ones and those in fsspec's stores."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from gauss2svg.errors import Gauss2SvgError, InputError, OutputError, refusal
from gauss2svg.files import check_writable, make_folder, reason_of, replace, write_whole

STATE = "gauss2svg-batch"  # folder in the output folder: table, options, unfinished files
PARTS = f"{STATE}/parts"  # folder of unfinished files
PATH_SEPARATOR = re.compile(r"[/\\]" if os.sep == "\\" else "/")  # separates folders in a path
# Protocols of stores that never show a file half written.
_WHOLE_PUT = "s3, s3a, gs, gcs, az, abfs, abfss, oss, oci, memory"


class _Local:
    """Local files, with the functions of fsspec's file systems that this package calls."""

    open = staticmethod(open)
    put_file = staticmethod(replace)
    exists = staticmethod(os.path.exists)
    size = staticmethod(os.path.getsize)

    def cat_file(self, path: str) -> bytes:
        return Path(path).read_bytes()

    def ukey(self, path: str) -> str:
        """Return the size and the time of the last change of a file, as text."""
        status = os.stat(path)
        return f"{status.st_size} {status.st_mtime_ns}"


_LOCAL = _Local()


def is_url(path: str) -> bool:
    """Return whether a name is a URL, such as s3://bucket/photo.jpg."""
    return "://" in path


@contextmanager
def file_system_of(
    name: str, verb: str = "read", kind: type[Gauss2SvgError] = InputError
) -> Iterator[tuple[Any, str]]:
    """Yield (file system, path in it) of a path or URL. Raise an error in the block as a `kind`."""
    advice = "the path or the URL of a photo, a folder, a glob or a list"
    try:
        if is_url(name):
            advice = 'pip install "gauss2svg[s3]", or the package of another store'
            from fsspec.core import url_to_fs

            advice = "another URL, or the same command again"
            fs, path = url_to_fs(name)
            # fsspec's cache of listings would hold a million names, and hide files written later.
            fs.dircache.use_listings_cache = False
            yield fs, path
        else:
            yield _LOCAL, name
    except (Gauss2SvgError, MemoryError):
        raise
    except Exception as error:  # stores raise exceptions of their own classes
        raise kind(f"cannot {verb} {name}: {reason_of(error)}. Try {advice}") from error


def write(root: str, name: str, data: bytes, sync: bool = True) -> None:
    """Write the file `name` of the folder `root`, whole or not at all. Raise OutputError.

    Without `sync`, a power cut may leave an empty file. The folder PARTS is not created here, so a
    worker on a machine without the output folder of the run fails, and writes no file.
    """
    target = f"{root}/{name}"
    if is_url(target):
        with file_system_of(target, "write", OutputError) as (fs, path):
            fs.pipe_file(path, data)
        return
    make_folder(Path(target).parent)
    write_whole(Path(target), data, Path(root, PARTS, secrets.token_hex(8)), sync)


def prepare(root: str) -> None:
    """Create the output folder `root`, and remove the unfinished files of killed runs.

    Raise OutputError if the folder cannot be written, and InputError for a store on which others
    could see a file half written.
    """
    if is_url(root):
        if root.partition("://")[0] not in _WHOLE_PUT.split(", "):
            raise refusal("output", f"a folder, or on one of {_WHOLE_PUT}", root, "a folder")
        write(root, f"{PARTS}/writable", b"")
        return
    parts = Path(root, PARTS)
    make_folder(parts)
    check_writable(parts / "writable")
    for part in parts.iterdir():
        with suppress(OSError):  # another run has removed the part, or another user owns it
            # A live worker soon renames its part. A part a minute old is from a killed run.
            if part.stat().st_mtime < time.time() - 60:
                shutil.rmtree(part) if part.is_dir() else part.unlink()
