"""Functions that read and write local files as well as files of fsspec's stores."""

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

STATE = "gauss2svg-batch"  # folder in the output folder for the table and unfinished files
PARTS = f"{STATE}/parts"  # folder of unfinished files
PARTS_OF = re.compile(r"[/\\]" if os.sep == "\\" else "/")  # separator of a path's parts
# Protocols of stores that never show a file half written.
_WHOLE_PUT = "s3, s3a, gs, gcs, az, abfs, abfss, oss, oci, memory"


class _Local:
    """Local files, with those functions of fsspec's file systems that this package uses."""

    open = staticmethod(open)
    put_file = staticmethod(replace)
    exists = staticmethod(os.path.exists)
    size = staticmethod(os.path.getsize)

    def cat_file(self, path: str) -> bytes:
        return Path(path).read_bytes()

    def ukey(self, path: str) -> str:
        """Return the size and date of a file. They change if its content changes."""
        status = os.stat(path)
        return f"{status.st_size} {status.st_mtime_ns}"


_LOCAL = _Local()


def is_url(path: str) -> bool:
    """Return whether a name is a URL, such as s3://bucket/photo.jpg."""
    return "://" in path


@contextmanager
def reached(
    name: str, verb: str = "read", kind: type[Gauss2SvgError] = InputError
) -> Iterator[tuple[Any, str]]:
    """Yield the file system of a name and the path in it. Turn errors inside into a `kind`."""
    advice = "the path or the URL of a photo, a folder, a glob or a list"
    try:
        if is_url(name):
            advice = 'pip install "gauss2svg[s3]", or the package of another store'
            from fsspec.core import url_to_fs

            advice = "another URL, or the same command again"
            fs, path = url_to_fs(name)
            # fsspec's cache of listings would hold a million names, and hide files written since.
            fs.dircache.use_listings_cache = False
            yield fs, path
        else:
            yield _LOCAL, name
    except (Gauss2SvgError, MemoryError):
        raise
    except Exception as error:  # stores raise exceptions of their own classes
        raise kind(f"cannot {verb} {name}: {reason_of(error)}. Try {advice}") from error


def write(root: str, name: str, data: bytes, sync: bool = True) -> None:
    """Write a file of a folder, whole or not at all. Raise OutputError.

    Without `sync`, a power cut may leave an empty file. The folder of unfinished files is not
    created here, so a machine that does not see the output folder of the run writes nothing.
    """
    target = f"{root}/{name}"
    if is_url(target):
        with reached(target, "write", OutputError) as (fs, path):
            fs.pipe_file(path, data)
        return
    make_folder(Path(target).parent)
    write_whole(Path(target), data, Path(root, PARTS, secrets.token_hex(8)), sync)


def prepare(root: str) -> None:
    """Create a folder, and remove the unfinished files of runs that were killed.

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
        with suppress(OSError):  # another run removes the part too, or another user owns it
            # A live worker renames its part within moments, so a part a minute old is left over.
            if part.stat().st_mtime < time.time() - 60:
                shutil.rmtree(part) if part.is_dir() else part.unlink()
