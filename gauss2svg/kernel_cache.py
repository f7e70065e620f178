"""Compiled kernels, saved on disk for later processes. Several processes may save at once."""

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

_CONSTANTS_MODULE = Path(__file__).parent / "scene" / "falloff.py"  # kernels inline its constants
_config: Any = config  # not typed, because numba creates its attributes at run time
_lost = False  # whether some code of this process could not be saved


def are_kept() -> bool:
    """Return whether later processes will find all kernels of this process on the disk."""
    return not _lost


def cached(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles by numba's njit and saves the machine code in `folder()`.

    If there is no such folder, each process compiles anew, and are_kept() is False.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        global _lost
        dispatcher: Any = numba.njit(**options)(function)
        cache_path = folder()
        if cache_path is None:
            _lost = True
        elif not _config.DISABLE_JIT:  # otherwise njit returns the function itself
            dispatcher._cache = KernelCache(function, cache_path, options.get("_nrt", True))
        return dispatcher

    return compiled


def folder() -> Path | None:
    """Return the folder for compiled code, or None if no folder can be written.

    The folder is $NUMBA_CACHE_DIR, which may be read-only. Without that variable it is `gauss2svg`
    in the user's cache folder, or else a private temporary folder.
    """
    return Path(_config.CACHE_DIR) if _config.CACHE_DIR else _folder_of_user()


@lru_cache
def _folder_of_user() -> Path | None:
    with suppress(OSError, RuntimeError):  # RuntimeError if no home folder is known
        caches = _user_cache()
        caches.mkdir(parents=True, exist_ok=True)
        if os.access(caches, os.W_OK):
            return caches
    with suppress(OSError):
        return _temporary_folder()
    return None


def _user_cache() -> Path:
    """Return `gauss2svg` in the user's cache folder on this system."""
    if sys.platform == "win32":
        caches = os.environ.get("LOCALAPPDATA") or "~/AppData/Local"
    elif sys.platform == "darwin":
        caches = "~/Library/Caches"
    else:
        caches = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(caches).expanduser() / "gauss2svg"


def _temporary_folder() -> Path | None:
    """Return a temporary folder that only this user can write, or None.

    The files in it are executed. So a folder of this name that others made or can write is refused.
    """
    if sys.platform == "win32":
        return None  # temporary files are in %LOCALAPPDATA% too, which failed
    user = os.getuid()
    private = Path(tempfile.gettempdir(), f"gauss2svg-{user}")
    private.mkdir(mode=0o700, exist_ok=True)
    status = private.lstat()
    is_private = status.st_uid == user and not status.st_mode & 0o077
    return private if stat.S_ISDIR(status.st_mode) and is_private else None


@lru_cache
def _digest(package: Path) -> str:
    """Return a digest of all modules from which kernels in the folder `package` may inline code."""
    digest = hashlib.sha256()
    for path in (*sorted(package.glob("*.py")), _CONSTANTS_MODULE):
        digest.update(path.read_bytes())
    return digest.hexdigest()


class KernelCache:
    """Saved code of one function: a file for each combination of argument types and CPU.

    The name of a file contains a digest of all that its code depends on. So if two processes write
    a file at once, they write equal bytes. numba's own cache has an index file, which they could
    corrupt. Before it loads any code, numba's cache also imports all modules that compiled code may
    call, such as SciPy's linear algebra. Those imports take a fifth of a run on a small picture
    (docs/decisions/start.md). With this class, only a compilation imports these modules.
    """

    def __init__(self, function: Callable[..., Any], cache_path: Path, allocates: bool) -> None:
        assert function.__closure__ is None  # the digest covers files, not values of a closure
        module = Path(function.__code__.co_filename)
        self._allocates = allocates
        self.cache_path = cache_path  # numba's statistics read this attribute
        self._name = f"{module.stem}.{function.__name__}"
        line = function.__code__.co_firstlineno
        self._stamp = f"{_digest(module.parent)} {line} {numba.__version__} {sys.version}"

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """Return the saved code for these argument types, or None if no code can be read."""
        if self._allocates:
            rtsys.initialize(target_context)  # numba's array allocator, to which saved code links
        try:
            fields = pickle.loads(self._file(sig, target_context.codegen()).read_bytes())
        except (OSError, EOFError, pickle.UnpicklingError):
            return None
        return CompileResult._rebuild(target_context, *fields)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the code for these argument types. If that fails, the next process compiles anew."""
        global _lost
        assert not data.library.has_dynamic_globals  # pointers are invalid in other processes
        path = self._file(sig, data.codegen)
        part = path.with_suffix(f".{secrets.token_hex(8)}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part.write_bytes(dumps(data._reduce()))
            os.replace(part, path)
        except OSError:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            _lost |= not os.path.exists(path)  # an equal file may be there, which Windows keeps

    def _file(self, sig: Any, codegen: Any) -> Path:
        key = f"{self._stamp} {sig} {codegen.magic_tuple()}"
        return self.cache_path / f"{self._name}-{hashlib.sha256(key.encode()).hexdigest()}.nbc"
