"""Kernels that are kept on disk between processes, any number of which may save them at once."""

from __future__ import annotations

import hashlib
import os
import secrets
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

from numba import njit
from numba.core import config
from numba.core.caching import CacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.runtime.nrt import rtsys

# s between tries to list code on Windows, which replaces no list while another process reads it.
_PAUSES_S = (0.01, 0.03, 0.1, 0.3)
_numba: Any = config  # which creates its attributes dynamically
_lost = False  # whether code of this process could not be kept


def are_kept() -> bool:
    """Whether all kernels of this process are on the disk, for later ones."""
    return not _lost


def cached(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate by numba's njit with these options; machine code is kept on disk.

    It is kept in the first of these folders that can be written: $NUMBA_CACHE_DIR, __pycache__
    beside the module, the user's cache ($XDG_CACHE_HOME on Linux), one of the user's own in the
    folder for temporary files. What __pycache__ has is read also where it cannot be written, as in
    an image of a container. Where no folder can be written, functions are compiled in every
    process, and are_kept() is False.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        global _lost
        for folder in (_usual, _temporary, _read_only):
            with folder(Path(function.__code__.co_filename).parent) as can_be:
                try:
                    dispatcher = njit(cache=True, **options)(function) if can_be else None
                except RuntimeError:  # numba finds no folder that can be written
                    dispatcher = None
            if dispatcher is not None:
                break
        else:
            _lost = True
            return njit(**options)(function)
        # None where NUMBA_DISABLE_JIT is set, and where numba keeps its files in another way: then
        # two processes that compile at once may have to compile again.
        cache = getattr(dispatcher, "_cache", None)
        if type(cache) is FunctionCache:
            cache.__class__ = KernelCache
        files = getattr(cache, "_cache_file", None)
        if type(files) is IndexDataCacheFile:
            files.__class__ = KernelFiles
            module = Path(function.__code__.co_filename)
            vars(files)["beside"] = str(module.with_name("__pycache__"))
            # Kernels inline those of other files, whose changes numba itself does not see.
            vars(files)["_source_stamp"] = vars(files)["_source_stamp"], _digest(module.parent)
        return dispatcher

    return compiled


@lru_cache
def _digest(room: Path) -> str:
    digest = hashlib.sha256()
    for path in sorted(room.glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@contextmanager
def _usual(module: Path) -> Iterator[bool]:
    """Let numba keep code where it does by itself; False where that is nowhere."""
    has_home = bool(os.environ.get("XDG_CACHE_HOME")) or os.path.isabs(os.path.expanduser("~"))
    # Without a home numba would make a folder named ~ in the current one.
    yield has_home or bool(_numba.CACHE_DIR) or os.access(module, os.W_OK)


@contextmanager
def _temporary(_: Path) -> Iterator[bool]:
    """Let numba keep code among the temporary files; False where there is no place for it."""
    folder, before = temporary_folder(), _numba.CACHE_DIR
    _numba.CACHE_DIR = folder or before
    try:
        yield folder is not None
    finally:
        _numba.CACHE_DIR = before


@contextmanager
def _read_only(_: Path) -> Iterator[bool]:
    """Let numba read code beside the modules, and keep none."""
    before = CacheImpl._locator_classes
    named = [kind for kind in before if kind.__name__.endswith("InTreeCacheLocator")]
    CacheImpl._locator_classes = [
        type("ReadOnly", (kind,), {"ensure_cache_path": lambda _: None}) for kind in named
    ]
    try:
        yield bool(named)
    finally:
        CacheImpl._locator_classes = before


def temporary_folder() -> str | None:
    """A folder for code among the temporary files, which nobody else can write; None for none.

    What is in it is executed, and others could have made a folder of its name before.
    """
    user = os.getuid() if hasattr(os, "getuid") else None  # Windows has no such numbers
    try:
        parent = os.path.realpath(tempfile.gettempdir())
        if not _keeps_others_out(parent, user):
            return None
        # The current folder, where no other can be written; but that may be /tmp.
        if os.path.samefile(parent, os.curdir) and not os.stat(parent).st_mode & stat.S_ISVTX:
            return None
        folder = os.path.join(parent, f"gauss2svg-kernels-{user or 0}")
        os.makedirs(folder, mode=0o700, exist_ok=True)
        found = os.lstat(folder)
    except OSError:
        return None
    is_private = user is None or (found.st_uid == user and not found.st_mode & 0o077)
    return folder if stat.S_ISDIR(found.st_mode) and is_private else None


def _keeps_others_out(folder: str, user: int | None) -> bool:
    """Whether only this user and the system's can rename and replace what is in a folder.

    user  its number; None on Windows, where the folders of a user are private
    """
    if user is None:
        homes = [os.environ.get(name) for name in ("LOCALAPPDATA", "USERPROFILE")]
        return any(Path(folder).is_relative_to(os.path.realpath(home)) for home in homes if home)
    found = os.stat(folder)
    # In a sticky folder, as /tmp is, each user may rename what is theirs alone.
    is_shared = found.st_mode & 0o022 and not found.st_mode & stat.S_ISVTX
    return found.st_uid in (0, user) and not is_shared


class KernelCache(FunctionCache):
    """The kept code of one function, loaded without what only a compilation needs.

    numba itself first imports and registers all that compiled code may call, SciPy's linear algebra
    among it, which takes a fifth of a run on a small picture (docs/decisions/start.md). A
    compilation does so by itself.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for these types, None where it is not kept."""
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

    beside: str | None = None  # another folder, which is read

    def load(self, key: Any) -> Any:
        """The code for these types; None where there is none."""
        found = super().load(key)
        if found is None and self.beside is not None and self.beside != self._cache_path:
            base = self._index_name.removesuffix(".nbi")
            with suppress(PermissionError):  # files of another user
                return IndexDataCacheFile(self.beside, base, self._source_stamp).load(key)
        return found

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
