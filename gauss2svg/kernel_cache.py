"""Save compiled kernels on the disk for later processes.

Several processes may save kernels at the same time.
"""

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

# Modules whose constants and functions are compiled into kernels of other packages. If one of them
# changes, saved kernels are out of date.
_SHARED_MODULES = [Path(__file__).parent / m for m in ("scene/falloff.py", "render/coverage.py")]
_config: Any = config  # not typed, because numba creates its attributes at run time
_lost = False  # True once this process has failed to save the code of a kernel


def are_kept() -> bool:
    """Return whether later processes will find all kernels of this process on the disk."""
    return not _lost


def cached(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles with numba's njit and saves the machine code in `folder()`.

    If `folder()` is None, each process has to compile again, and are_kept() returns False.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        global _lost
        dispatcher: Any = numba.njit(**options)(function)
        cache_path = folder()
        if cache_path is None:
            _lost = True
        # If DISABLE_JIT is set, numba does not compile. njit then returns the function itself,
        # which has no cache.
        elif not _config.DISABLE_JIT:
            dispatcher._cache = KernelCache(function, cache_path, options.get("_nrt", True))
        return dispatcher

    return compiled


def folder() -> Path | None:
    """Return the folder for compiled code, or None if no folder can be written.

    If the environment variable NUMBA_CACHE_DIR is set, it names the folder. This folder is returned
    even if it is read-only. If the variable is not set, the folder is `gauss2svg` in the user's
    cache folder. If that cannot be written, it is a private temporary folder.
    """
    return Path(_config.CACHE_DIR) if _config.CACHE_DIR else _folder_of_user()


@lru_cache
def _folder_of_user() -> Path | None:
    with suppress(OSError, RuntimeError):  # expanduser() raises RuntimeError without a home folder
        caches = _user_cache()
        caches.mkdir(parents=True, exist_ok=True)
        if os.access(caches, os.W_OK):
            return caches
    with suppress(OSError):
        return _temporary_folder()
    return None


def _user_cache() -> Path:
    """Return gauss2svg's folder in the cache folder that this operating system has for a user."""
    if sys.platform == "win32":
        caches = os.environ.get("LOCALAPPDATA") or "~/AppData/Local"
    elif sys.platform == "darwin":
        caches = "~/Library/Caches"
    else:
        caches = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(caches).expanduser() / "gauss2svg"


def _temporary_folder() -> Path | None:
    """Return a temporary folder that only this user can read and write, or None.

    Code in the folder's files will be executed. So if another user owns a folder of this name, or
    has access to it, the folder is not used, and the result is None.
    """
    if sys.platform == "win32":
        # This function is called if the cache folder in %LOCALAPPDATA% cannot be written. On
        # Windows the temporary folder is in %LOCALAPPDATA% too, so there is no need to try it.
        return None
    user = os.getuid()
    private = Path(tempfile.gettempdir(), f"gauss2svg-{user}")
    private.mkdir(mode=0o700, exist_ok=True)
    status = private.lstat()
    is_private = status.st_uid == user and not status.st_mode & 0o077
    return private if stat.S_ISDIR(status.st_mode) and is_private else None


@lru_cache
def _digest(package: Path) -> str:
    """Return a digest of all modules whose code can be part of kernels in the folder `package`."""
    digest = hashlib.sha256()
    for path in (*sorted(package.glob("*.py")), *_SHARED_MODULES):
        digest.update(path.read_bytes())
    return digest.hexdigest()


class KernelCache:
    """Saved code of one function: a file for each combination of argument types and CPU.

    The name of a file contains a digest of everything on which the code depends. So if two
    processes write the same file at the same time, they write the same bytes. numba's own cache has
    an index file, which two processes could corrupt. Before numba's cache loads any code, it also
    imports all modules that compiled code may call, such as SciPy's linear algebra. In a run on a
    small picture, these imports take a fifth of the time (docs/decisions/start.md). With this
    class, the modules are imported only when a kernel is compiled.
    """

    def __init__(self, function: Callable[..., Any], cache_path: Path, allocates: bool) -> None:
        # A saved kernel is found by a digest of source files. This digest does not change if the
        # values in a closure change. The kernel with the old values would then be used, so a kernel
        # must not be a closure.
        assert function.__closure__ is None
        module = Path(function.__code__.co_filename)
        self._allocates = allocates
        self.cache_path = cache_path  # numba's statistics read this attribute
        self._name = f"{module.stem}.{function.__name__}"
        line = function.__code__.co_firstlineno
        self._stamp = f"{_digest(module.parent)} {line} {numba.__version__} {sys.version}"

    def load_overload(self, sig: Any, target_context: Any) -> CompileResult | None:
        """Return the saved code for these argument types, or None if no code can be read."""
        if self._allocates:
            rtsys.initialize(target_context)  # the kernel will need numba's array allocator
        try:
            fields = pickle.loads(self._file(sig, target_context.codegen()).read_bytes())
        except (OSError, EOFError, pickle.UnpicklingError):
            return None
        return CompileResult._rebuild(target_context, *fields)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the code for these argument types.

        If the code cannot be saved, the next process has to compile the function again.
        """
        global _lost
        # Code with dynamic globals cannot be saved: dynamic globals are pointers, and these are
        # invalid in other processes.
        assert not data.library.has_dynamic_globals
        path = self._file(sig, data.codegen)
        part = path.with_suffix(f".{secrets.token_hex(8)}")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            part.write_bytes(dumps(data._reduce()))
            os.replace(part, path)
        except OSError:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            # If the file exists, another process has written it. On Windows, it cannot be replaced
            # while that process uses it. It has the same bytes, so the code counts as saved.
            _lost |= not os.path.exists(path)

    def _file(self, sig: Any, codegen: Any) -> Path:
        key = f"{self._stamp} {sig} {codegen.magic_tuple()}"
        return self.cache_path / f"{self._name}-{hashlib.sha256(key.encode()).hexdigest()}.nbc"
