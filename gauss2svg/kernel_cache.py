"""Kernels that are kept on disk between processes, any number of which may save them at once."""

from __future__ import annotations

import hashlib
import os
import pickle
import secrets
import stat
import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import Any

import numba
from numba.core import config
from numba.core.compiler import CompileResult
from numba.core.runtime.nrt import rtsys
from numba.core.serialize import dumps

_CONSTANTS = Path(__file__).parent / "scene" / "falloff.py"  # constants that kernels inline
_config: Any = config  # which creates its attributes dynamically
_lost = False  # whether code of this process could not be kept


def are_kept() -> bool:
    """Return whether all kernels of this process are on the disk, for later ones."""
    return not _lost


def cached(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a function of a module by numba's njit; machine code is kept in `folder()`.

    Where there is no such folder, each process compiles, and are_kept() is False.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        global _lost
        dispatcher: Any = numba.njit(**options)(function)
        place = folder()
        if place is None:
            _lost = True
        elif not _config.DISABLE_JIT:  # which leaves functions as they are
            dispatcher._cache = KernelCache(function, place)
        return dispatcher

    return compiled


def folder() -> Path | None:
    """Return the folder for compiled code, or None where no such folder can be written.

    It is $NUMBA_CACHE_DIR, which may be one that can only be read. Without that variable it is
    `gauss2svg` in the user's folder for caches, or a private one among the temporary files.
    """
    return Path(_config.CACHE_DIR) if _config.CACHE_DIR else _folder_of_user()


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


class KernelCache:
    """The kept code of one function: a file for each combination of argument types and CPU.

    The name of a file has a digest of all that its code depends on, so files that two processes
    write at once are the same. numba's own cache has an index, which processes can mix up, and
    first imports all that compiled code may call, SciPy's linear algebra among it, which takes a
    fifth of a run on a small picture (docs/decisions/start.md). A compilation does so by itself.
    """

    def __init__(self, function: Callable[..., Any], place: Path) -> None:
        assert function.__closure__ is None  # the digest knows files, not values
        module = Path(function.__code__.co_filename)
        self.cache_path = place  # numba's statistics have it
        self._name = f"{module.stem}.{function.__name__}"
        line = function.__code__.co_firstlineno
        self._stamp = f"{_digest(module.parent)} {line} {numba.__version__} {sys.version}"

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """Return the code for these types, or None where none can be read."""
        rtsys.initialize(target_context)  # the memory of arrays, which kept code links to
        try:
            kept = pickle.loads(self._file(sig, target_context.codegen()).read_bytes())
        except (OSError, EOFError, pickle.UnpicklingError):
            return None
        return CompileResult._rebuild(target_context, *kept)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code for these types; a disk that is full costs the next process the time."""
        global _lost
        assert not data.library.has_dynamic_globals  # addresses, which no later process has
        path = self._file(sig, data.codegen)
        part = path.with_suffix(f".{secrets.token_hex(8)}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part.write_bytes(dumps(data._reduce()))
            os.replace(part, path)
        except OSError:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            _lost |= not os.path.exists(path)  # on Windows another process may be reading it

    def _file(self, sig: Any, codegen: Any) -> Path:
        key = f"{self._stamp} {sig} {codegen.magic_tuple()}"
        return self.cache_path / f"{self._name}-{hashlib.sha256(key.encode()).hexdigest()}.nbc"
