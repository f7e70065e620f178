"""Kernels that are kept on disk between processes, any number of which may save them at once."""

from __future__ import annotations

import hashlib
import os
import secrets
import stat
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import config
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    _CacheLocator,
)
from numba.core.runtime.nrt import rtsys

# s between tries to list code on Windows, which replaces no list while another process reads it.
_PAUSES_S = (0.01, 0.03, 0.1, 0.3)
_CONSTANTS = Path(__file__).parent / "scene" / "falloff.py"  # constants that kernels inline
_numba: Any = config  # which creates its attributes dynamically
_lost = False  # whether code of this process could not be kept


def are_kept() -> bool:
    """Return whether all kernels of this process are on the disk, for later ones."""
    return not _lost


def cached(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate by numba's njit with these options; machine code is kept in `folder()`.

    Where there is no such folder, each process compiles, and are_kept() is False.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        global _lost
        dispatcher: Any = njit(**options)(function)
        if folder() is None:
            _lost = True
        elif not _numba.DISABLE_JIT:  # which leaves functions as they are
            dispatcher._cache = KernelCache(function)
        return dispatcher

    return compiled


def folder() -> Path | None:
    """Return the folder for compiled code, or None where no such folder can be written.

    It is $NUMBA_CACHE_DIR, which may be one that can only be read. Without that variable it is
    `gauss2svg` in the user's folder for caches, or a private one among the temporary files.
    """
    return Path(_numba.CACHE_DIR) if _numba.CACHE_DIR else _folder_of_user()


@lru_cache
def _folder_of_user() -> Path | None:
    with suppress(OSError, RuntimeError):  # the second where no home is known
        caches = _caches()
        caches.mkdir(parents=True, exist_ok=True)
        if os.access(caches, os.W_OK):
            return caches
    with suppress(OSError):
        return _temporary()
    return None


def _caches() -> Path:
    """Return `gauss2svg` in the folder for caches that this system has for each user."""
    if sys.platform == "win32":
        caches = os.environ.get("LOCALAPPDATA") or "~/AppData/Local"
    elif sys.platform == "darwin":
        caches = "~/Library/Caches"
    else:
        caches = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(caches).expanduser() / "gauss2svg"


def _temporary() -> Path | None:
    """Return a folder among the temporary files that nobody else can write, or None.

    What is in it is executed, and others could have made a folder of its name before.
    """
    if sys.platform == "win32":
        return None  # temporary files are in the folder that has the caches
    user = os.getuid()
    private = Path(tempfile.gettempdir(), f"gauss2svg-{user}")
    private.mkdir(mode=0o700, exist_ok=True)
    status = private.lstat()
    is_private = status.st_uid == user and not status.st_mode & 0o077
    return private if stat.S_ISDIR(status.st_mode) and is_private else None


@lru_cache
def _digest(room: Path) -> str:
    """Return a digest of all modules that a kernel of a folder may inline."""
    digest = hashlib.sha256()
    for path in (*sorted(room.glob("*.py")), _CONSTANTS):
        digest.update(path.read_bytes())
    return digest.hexdigest()


class _Place(_CacheLocator):
    """The place of one function's files: a folder of `folder()` for each folder of modules."""

    def __init__(self, function: Callable[..., Any], module: str) -> None:
        self._line = function.__code__.co_firstlineno
        self._room = Path(module).parent
        self._path = os.path.join(folder() or "", self.get_suitable_cache_subpath(module))

    def ensure_cache_path(self) -> None:
        """Make the folder; saving says where that is not possible."""
        with suppress(OSError):
            os.makedirs(self._path, exist_ok=True)

    def get_cache_path(self) -> Any:
        """Return the folder."""
        return self._path

    def get_source_stamp(self) -> Any:
        """Return what code is compared by: kernels inline those of other files."""
        return _digest(self._room)

    def get_disambiguator(self) -> Any:
        """Return what tells functions of one name apart."""
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> _Place:
        """Return the place of a function."""
        return cls(py_func, py_file)


class _Code(CompileResultCacheImpl):
    """The form in which code is kept, and its place."""

    _locator_classes = (_Place,)


class KernelCache(FunctionCache):
    """The kept code of one function, loaded without what only a compilation needs.

    numba itself first imports and registers all that compiled code may call, SciPy's linear algebra
    among it, which takes a fifth of a run on a small picture (docs/decisions/start.md). A
    compilation does so by itself.
    """

    _impl_class = _Code

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        place = self._impl.locator
        self._cache_file = KernelFiles(
            place.get_cache_path(), self._impl.filename_base, place.get_source_stamp()
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the code for these types, None where it is not kept."""
        rtsys.initialize(target_context)  # the memory of arrays, which kept code links to
        with self._guard_against_spurious_io_errors():
            return self._load_overload(sig, target_context)


class KernelFiles(IndexDataCacheFile):
    """The files of one function: an index of argument types, and machine code for each of them.

    numba itself numbers the files of machine code, and two processes that compile for different
    types at once can take the same number: the one's code is then listed as the other's. Here every
    file has a name of its own, and is whole before it is listed. Of two lists written at once one
    is lost, and what it listed is compiled once more. No process ever waits for another.
    """

    def load(self, key: Any) -> Any:
        """Return the code for these types; None where there is none that can be read."""
        with suppress(OSError):
            return super().load(key)

    def save(self, key: Any, data: Any) -> None:
        """Keep the code for these types; a disk that is full costs the next process the time."""
        global _lost
        name = self._data_name(secrets.randbits(63))
        try:
            self._save_data(name, data)
            self._list(key, name)
        except OSError:
            _lost = True

    def _list(self, key: Any, name: str) -> None:
        """Add the file of these types to the list; on Windows try while another one reads it."""
        if sys.platform == "win32":
            for pause in _PAUSES_S:
                try:
                    return self._save_index({**self._load_index(), key: name})
                except PermissionError:
                    time.sleep(pause)
        return self._save_index({**self._load_index(), key: name})
