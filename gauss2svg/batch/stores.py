"""Where photos are read and SVGs are written: folders of this machine, or any store of fsspec's."""

from __future__ import annotations

import io
import json
import os
import re
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, BinaryIO

from gauss2svg.errors import InputError, OutputError, on_one_line
from gauss2svg.files import check_writable, reading, write_whole

PARTS_OF = re.compile(r"[/\\]" if os.sep == "\\" else "/")  # what separates parts of a name
_ADVICE = "the path or the URL of a photo"
# Entries of a store's listing of which one at least changes with the bytes, as stores call them.
# With none of them, such as from a server that gives sizes alone, a photo is read.
_TELLING = {
    "etag", "mtime", "lastmodified", "updated", "modified", "created", "contentmd5", "md5hash",
    "md5", "crc32c", "digest", "generation", "versionid",
}  # fmt: skip


def is_url(path: str) -> bool:
    """Whether a name is a URL, such as s3://bucket/photo.jpg."""
    return "://" in path


def is_contained(name: str) -> bool:
    """Whether a file of this name, relative to a folder, is in it."""
    return not os.path.splitdrive(name)[0] and not {"", ".", ".."} & set(PARTS_OF.split(name))


def filesystem(url: str) -> tuple[Any, str]:
    """Fsspec's file system of a URL, and the path in it; raises InputError where there is none."""
    from fsspec.core import url_to_fs

    try:
        # Listings that are kept would hold a million names, and hide what was written since.
        return url_to_fs(url, use_listings_cache=False)
    except (ImportError, ValueError) as error:
        advice = 'pip install "gauss2svg[s3]"' if url.startswith("s3") else "another URL"
        raise InputError(f"cannot open {url}: {reason_of(error)}. Try {advice}") from error


def reason_of(error: BaseException) -> str:
    """Why a file cannot be read or written, on one line."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return on_one_line(text).strip().rstrip(".")[:300]


@contextmanager
def opened(source: str) -> Iterator[BinaryIO]:
    """A photo or a list of photos, open for reading; raises InputError."""
    if not is_url(source):
        with reading(source, _ADVICE) as file:
            yield file
        return
    fs, path = filesystem(source)
    try:
        data = fs.cat_file(path)
    except MemoryError:
        raise
    except Exception as error:  # each store raises its own
        raise InputError(f"cannot read {source}: {reason_of(error)}. Try {_ADVICE}") from error
    yield io.BytesIO(data)


def stamp_of(source: str) -> str:
    """What changes whenever a photo does, without reading it; empty where nothing is known to.

    Raises InputError.
    """
    try:
        if not is_url(source):
            found = os.stat(source)
            facts = (found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino)
            return " ".join(map(str, facts))
        fs, path = filesystem(source)
        info = fs.info(path)
    except InputError:
        raise
    except Exception as error:
        raise InputError(f"cannot read {source}: {reason_of(error)}. Try {_ADVICE}") from error
    known = {k: str(v) for k, v in info.items() if isinstance(v, (str, int, float, datetime)) and v}
    names = {re.sub("[^a-z0-9]", "", name.lower()) for name in known}
    return json.dumps(known, sort_keys=True) if names & _TELLING else ""


@dataclass(frozen=True)
class Store:
    """A folder that is written: a path of this machine, or a URL.

    parts  folder in it for unfinished files, which are renamed once they are whole
    Raises OutputError for what cannot be written.
    """

    root: str
    parts: str

    def __post_init__(self) -> None:
        root = self.root.rstrip("/") if is_url(self.root) else os.path.abspath(self.root)
        object.__setattr__(self, "root", root)

    @property
    def is_local(self) -> bool:
        """Whether it is a folder of this machine."""
        return not is_url(self.root)

    def path(self, name: str) -> str:
        """The path or the URL of a file."""
        return f"{self.root}/{name}" if not self.is_local else os.path.join(self.root, name)

    def write(self, name: str, data: bytes) -> None:
        """Write a file, whole or not at all, replacing another of its name."""
        if not is_contained(name):
            raise OutputError(f"cannot write {name}: it is not in {self.root}. Try another name")
        if self.is_local:
            path, parts = Path(self.root, name), Path(self.root, self.parts)
            self._make(parts)
            self._make(path.parent)
            write_whole(path, data, parts / secrets.token_hex(8))
            return
        with self._writing(name) as (fs, path):
            fs.pipe_file(path, data)

    def adopt(self, made: Path, name: str) -> None:
        """Move a file of this machine there."""
        if self.is_local:
            with self._writing(name):
                os.replace(made, self.path(name))
            return
        with self._writing(name) as (fs, path):
            fs.put_file(str(made), path)
        made.unlink()

    def read(self, name: str) -> bytes | None:
        """The content of a file; None where there is none."""
        try:
            if self.is_local:
                return Path(self.root, name).read_bytes()
            fs, path = filesystem(self.path(name))
            return fs.cat_file(path)
        except FileNotFoundError:
            return None
        except Exception as error:
            raise OutputError(f"cannot read {self.path(name)}: {reason_of(error)}") from error

    def size(self, name: str) -> int | None:
        """Bytes of a file; None where there is none."""
        try:
            if self.is_local:
                return Path(self.root, name).stat().st_size
            fs, path = filesystem(self.path(name))
            return fs.info(path)["size"]
        except (FileNotFoundError, NotADirectoryError):
            return None
        except Exception as error:
            raise OutputError(f"cannot read {self.path(name)}: {reason_of(error)}") from error

    def names(self, folder: str) -> list[str]:
        """The files of a folder, sorted."""
        try:
            if self.is_local:
                return sorted(os.listdir(Path(self.root, folder)))
            fs, path = filesystem(self.path(folder))
            return sorted(one.rpartition("/")[2] for one in fs.ls(path, detail=False))
        except FileNotFoundError:
            return []
        except Exception as error:
            raise OutputError(f"cannot read {self.path(folder)}: {reason_of(error)}") from error

    def prepare(self) -> None:
        """Create the folder; raises OutputError where nothing can be written."""
        if not self.is_local:
            self.write(f"{self.parts}/writable", b"")
            return
        parts = Path(self.root, self.parts)
        self._make(parts)
        check_writable(parts / "writable")

    def sweep(self, older_than: float) -> None:
        """Remove unfinished files, which a process that was killed has left."""
        if self.is_local:
            for part in Path(self.root, self.parts).iterdir():
                with suppress(FileNotFoundError):
                    if part.stat().st_mtime < older_than:
                        part.unlink()

    @contextmanager
    def _writing(self, name: str) -> Iterator[Any]:
        try:
            yield None if self.is_local else filesystem(self.path(name))
        except MemoryError:
            raise
        except Exception as error:
            raise OutputError(
                f"cannot write {self.path(name)}: {reason_of(error)}. Try the same command again"
            ) from error

    def _make(self, folder: Path) -> None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except (OSError, ValueError) as error:
            raise OutputError(
                f"cannot create {folder}: {reason_of(error)}. Try another folder"
            ) from error
