"""Files of this machine, or of a store of fsspec's, by one set of functions."""

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

STATE = "gauss2svg-batch"  # the folder, beside the outputs, of the table and of unfinished files
PARTS = f"{STATE}/parts"
PARTS_OF = re.compile(r"[/\\]" if os.sep == "\\" else "/")  # what separates parts of a name
# Stores on which a put is whole or not there.
_WHOLE_PUT = "s3, s3a, gs, gcs, az, abfs, abfss, oss, oci, memory"


class _Here:
    """Files of this machine, by those functions of fsspec's file systems that are used."""

    open = staticmethod(open)
    put_file = staticmethod(replace)
    exists = staticmethod(os.path.exists)
    size = staticmethod(os.path.getsize)

    def cat_file(self, path: str) -> bytes:
        return Path(path).read_bytes()

    def ukey(self, path: str) -> str:
        """Return size and date, which change with a file."""
        found = os.stat(path)
        return f"{found.st_size} {found.st_mtime_ns}"


_HERE = _Here()


def is_url(path: str) -> bool:
    """Whether a name is a URL, such as s3://bucket/photo.jpg."""
    return "://" in path


@contextmanager
def reached(
    name: str, verb: str = "read", kind: type[Gauss2SvgError] = InputError
) -> Iterator[tuple[Any, str]]:
    """Yield a file system and the path in it. Raise an error of the kind for what fails inside."""
    advice = "the path or the URL of a photo, a folder, a glob or a list"
    try:
        if is_url(name):
            advice = 'pip install "gauss2svg[s3]", or the package of another store'
            from fsspec.core import url_to_fs

            advice = "another URL, or the same command again"
            fs, path = url_to_fs(name)
            # Listings that are kept would hold a million names, and hide what was written since.
            fs.dircache.use_listings_cache = False
            yield fs, path
        else:
            yield _HERE, name
    except (Gauss2SvgError, MemoryError):
        raise
    except Exception as error:  # each store raises its own
        raise kind(f"cannot {verb} {name}: {reason_of(error)}. Try {advice}") from error


def write(root: str, name: str, data: bytes, sync: bool = True) -> None:
    """Write a file of a folder, whole or not at all, or empty after a power cut without `sync`.

    Raise OutputError.
    The folder of unfinished files is not made: a machine that does not see it writes nothing.
    """
    where = f"{root}/{name}"
    if is_url(where):
        with reached(where, "write", OutputError) as (fs, path):
            fs.pipe_file(path, data)
        return
    make_folder(Path(where).parent)
    write_whole(Path(where), data, Path(root, PARTS, secrets.token_hex(8)), sync)


def prepare(root: str) -> None:
    """Create a folder, and remove the unfinished files of runs that were killed. Raise OutputError.

    Raise InputError for a store on which a file would be seen half written.
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
        with suppress(OSError):  # another run removes them too, or another user wrote them
            # After a minute a live worker has written its part, which takes moments.
            if part.stat().st_mtime < time.time() - 60:
                shutil.rmtree(part) if part.is_dir() else part.unlink()
