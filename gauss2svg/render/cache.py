"""Kernels that are kept on disk between processes, any number of which may save them at once."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache, IndexDataCacheFile
from numba.core.runtime.nrt import rtsys


def cached(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate by numba's njit with these options; machine code is kept on disk.

    Where no folder can be written, functions are compiled in every process.
    """

    def compiled(function: Callable[..., Any]) -> Any:
        try:
            dispatcher = njit(cache=True, **options)(function)
        except RuntimeError:  # numba finds no folder that can be written
            return njit(**options)(function)
        # None where NUMBA_DISABLE_JIT is set, and where numba keeps its files in another way: then
        # two processes that compile at once may have to compile again.
        cache = getattr(dispatcher, "_cache", None)
        if type(cache) is FunctionCache:
            cache.__class__ = KernelCache
        files = getattr(cache, "_cache_file", None)
        if type(files) is IndexDataCacheFile:
            files.__class__ = KernelFiles
        return dispatcher

    return compiled


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

    def save(self, key: Any, data: Any) -> None:
        """Keep the code for these types; a disk that is full costs the next process the time."""
        name = self._data_name(secrets.randbits(63))
        with suppress(OSError):
            self._save_data(name, data)
            self._save_index({**self._load_index(), key: name})
