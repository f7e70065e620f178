"""Where photos are read and SVGs are written: folders of this machine, or any store of fsspec's."""

from __future__ import annotations

import io
import json
import os
import re
import secrets
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

from gauss2svg.errors import InputError, OutputError, brief, on_one_line
from gauss2svg.files import check_writable, make_folder, reading, replace, write_whole

STATE = "gauss2svg-batch"  # the folder, beside the outputs, of all that is not an output
PARTS = f"{STATE}/parts"  # for unfinished files, which are renamed once they are whole
PARTS_OF = re.compile(r"[/\\]" if os.sep == "\\" else "/")  # what separates parts of a name
_ADVICE = "the path or the URL of a photo"
_AGAIN = "Try the same command again"
# Stores on which a put is whole or not there, and those whose rename replaces a file at once.
_WHOLE_PUT = {"s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "oss", "oci", "memory"}
_RENAMING = {"sftp", "ssh"}
_LOCAL = ("file://", "local://")
# Entries of a store's listing of which one at least changes with the bytes, as stores call them.
# With none of them, such as from a server that gives sizes alone, a photo is read.
_TELLING = {
    "etag", "mtime", "lastmodified", "updated", "modified", "created", "contentmd5", "md5hash",
    "md5", "crc32c", "digest", "generation", "versionid",
}  # fmt: skip


def is_url(path: str) -> bool:
    """Whether a name is a URL, such as s3://bucket/photo.jpg."""
    return "://" in path


def without_file_protocol(path: str) -> str:
    """The path of a URL of a file of this machine; any other name as it is."""
    if not path.startswith(_LOCAL):
        return path
    from fsspec.implementations.local import LocalFileSystem

    return LocalFileSystem._strip_protocol(path)


def is_contained(name: str) -> bool:
    """Whether a file of this name, relative to a folder, is in it."""
    return not os.path.splitdrive(name)[0] and {"", ".", ".."}.isdisjoint(PARTS_OF.split(name))


def filesystem(url: str) -> tuple[Any, str]:
    """Fsspec's file system of a URL, and the path in it; raises InputError where there is none."""
    from fsspec.core import url_to_fs

    try:
        # Listings that are kept would hold a million names, and hide what was written since. SFTP
        # keeps none, and would hand the option to its connection.
        has_option = not url.startswith(tuple(f"{name}://" for name in _RENAMING))
        return url_to_fs(url, **({"use_listings_cache": False} if has_option else {}))
    except MemoryError:
        raise
    except Exception as error:  # some stores connect here, and raise their own
        advice = 'pip install "gauss2svg[s3]"' if url.startswith("s3") else "another URL"
        raise InputError(f"cannot open {url}: {reason_of(error)}. Try {advice}") from error


def reason_of(error: BaseException) -> str:
    """Why a file cannot be read or written, on one line."""
    text = getattr(error, "strerror", None) or str(error) or type(error).__name__
    return on_one_line(text).strip().rstrip(".")[:300]


@contextmanager
def opened(source: str) -> Iterator[BinaryIO]:
    """A photo open for reading; raises InputError."""
    if is_url(source):
        with _reading(source) as (fs, path):
            data = fs.cat_file(path)
        yield io.BytesIO(data)
    else:
        with reading(source, _ADVICE) as file:
            yield file


@contextmanager
def lines_of(source: str) -> Iterator[Iterable[bytes]]:
    """The lines of a list of photos, read as they are wanted; raises InputError."""
    if is_url(source):
        with _reading(source) as (fs, path), fs.open(path, "rb") as file:
            yield file
    else:
        with reading(source, _ADVICE) as file:
            yield file


@contextmanager
def _reading(source: str) -> Iterator[tuple[Any, str]]:
    """The file system of a URL and the path in it; raises InputError for what fails within."""
    try:
        yield filesystem(source)
    except (InputError, MemoryError):
        raise
    except Exception as error:  # each store raises its own
        raise InputError(f"cannot read {source}: {reason_of(error)}. Try {_ADVICE}") from error


def stamp_of(source: str) -> str:
    """What changes whenever a photo does, without reading it; empty where nothing is known to.

    Raises InputError.
    """
    if not is_url(source):
        try:
            found = os.stat(source)
        except (OSError, ValueError) as error:
            raise InputError(f"cannot read {source}: {reason_of(error)}. Try {_ADVICE}") from error
        return f"{found.st_size} {found.st_mtime_ns} {found.st_ctime_ns} {found.st_ino}"
    with _reading(source) as (fs, path):
        info = fs.info(path)
    known = {k: str(v) for k, v in info.items() if isinstance(v, (str, int, float, datetime)) and v}
    names = {re.sub("[^a-z0-9]", "", name.lower()) for name in known}
    return json.dumps(known, sort_keys=True) if names & _TELLING else ""


def _protocols(fs: Any) -> set[str]:
    return {fs.protocol} if isinstance(fs.protocol, str) else set(fs.protocol)


@dataclass(frozen=True)
class Store:
    """A folder that is written: a path of this machine, or a URL.

    Raises OutputError for what cannot be written.
    """

    root: str

    def __post_init__(self) -> None:
        root = self.root.rstrip("/") if is_url(self.root) else os.path.abspath(self.root)
        object.__setattr__(self, "root", root)

    @cached_property
    def is_local(self) -> bool:
        """Whether the store is a folder of this machine."""
        return not is_url(self.root)

    def path(self, name: str) -> str:
        """The path or the URL of a file."""
        return os.path.join(self.root, name) if self.is_local else f"{self.root}/{name}"

    def write(self, name: str, data: bytes) -> None:
        """Write a file, whole or not at all, replacing another of its name."""
        if not is_contained(name):
            raise OutputError(f"cannot write {name}: it is not in {self.root}. Try another name")
        if self.is_local:
            path, parts = Path(self.root, name), Path(self.root, PARTS)
            make_folder(parts)
            make_folder(path.parent)
            write_whole(path, data, parts / secrets.token_hex(8))
            return
        with self._putting(name) as (fs, path):
            fs.pipe_file(path, data)

    def adopt(self, made: Path, name: str) -> None:
        """Move a file of this machine there."""
        if self.is_local:
            with self._writing(name):
                replace(made, self.path(name))
            return
        with self._putting(name) as (fs, path):
            fs.put_file(str(made), path)
        made.unlink()

    def read(self, name: str) -> bytes | None:
        """The content of a file; None where there is none."""
        return self._looked_up(
            name, lambda path: Path(path).read_bytes(), lambda fs, path: fs.cat_file(path)
        )

    def size(self, name: str) -> int | None:
        """Bytes of a file; None where there is none."""
        return self._looked_up(
            name,
            lambda path: os.stat(path).st_size,
            lambda fs, path: fs.info(path)["size"],
            absent=(FileNotFoundError, NotADirectoryError),
        )

    def names(self, folder: str) -> list[str]:
        """The files of a folder, sorted."""
        paths = self._looked_up(folder, os.listdir, lambda fs, path: fs.ls(path, detail=False))
        return sorted(one.rpartition("/")[2] for one in paths or ())

    def prepare(self) -> None:
        """Create the folder; raises OutputError where nothing can be written.

        Raises InputError for a store on which a file would be seen half written.
        """
        if not self.is_local:
            protocols = _protocols(filesystem(self.root)[0])
            if not protocols & (_WHOLE_PUT | _RENAMING):
                raise InputError(
                    "output must be a folder, or on one of "
                    f"{', '.join(sorted(_WHOLE_PUT | _RENAMING))}; got {brief(self.root)}. Try a "
                    "mounted folder"
                )
            self.write(f"{PARTS}/writable", b"")
            return
        parts = Path(self.root, PARTS)
        make_folder(parts)
        check_writable(parts / "writable")

    def sweep(self, older_than: float) -> None:
        """Remove unfinished files, which a process that was killed has left on this machine."""
        if self.is_local:
            for part in Path(self.root, PARTS).iterdir():
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
                f"cannot write {self.path(name)}: {reason_of(error)}. {_AGAIN}"
            ) from error

    @contextmanager
    def _putting(self, name: str) -> Iterator[tuple[Any, str]]:
        """The path to put a file at: another one, renamed then, if a put is seen half done."""
        with self._writing(name) as (fs, path):
            if _protocols(fs) & _WHOLE_PUT:
                yield fs, path
                return
            root = path.removesuffix(f"/{name}")
            part = f"{root}/{PARTS}/{secrets.token_hex(8)}"
            for file in (part, path):
                fs.makedirs(file.rpartition("/")[0], exist_ok=True)
            try:
                yield fs, part
                fs.mv(part, path)
            except BaseException:
                with suppress(Exception):  # it may not be there; the first error says why
                    fs.rm_file(part)
                raise

    def _looked_up(
        self,
        name: str,
        here: Callable[[str], Any],
        there: Callable[[Any, str], Any],
        absent: tuple[type[Exception], ...] = (FileNotFoundError,),
    ) -> Any:
        """What is found at a path of this machine or on a file system; None where nothing is."""
        where = self.path(name)
        try:
            return here(where) if self.is_local else there(*filesystem(where))
        except absent:
            return None
        except Exception as error:
            raise OutputError(f"cannot read {where}: {reason_of(error)}. {_AGAIN}") from error
