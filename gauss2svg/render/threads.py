"""Threads that share the work of a kernel.

Kernels are compiled for one thread and release Python's global lock (`nogil`), so that ordinary
Python threads run them side by side. numba's own parallel loops take as long to run, but five
times as long to compile (docs/decisions/kernels.md).
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

# Read by OpenMP, which torch uses, when it is loaded: idle threads sleep. By default they spin, on
# a core that a kernel could use. A value that the user has set is kept.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from numba import get_num_threads, njit

from gauss2svg.kernel_cache import cached

# A kernel that Python calls. No kernel divides by zero, so Python's check for it is left out.
kernel = cached(nogil=True, error_model="numpy")
# A function that only kernels call: compiled into each of them, without entries from Python and
# without reference counts, which would only take time to compile.
_INSIDE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": False}
tile_kernel = njit(nogil=True, error_model="numpy", **_INSIDE)

_pool: ThreadPoolExecutor | None = None


def in_shares(work: Callable[[int, int], None], most: int) -> None:
    """Call work(share, shares) for share = 0, ..., shares - 1 at the same time; wait for all.

    There is one share for each numba thread (numba.set_num_threads), but at most `most`, and at
    least one. The calling thread does the first share, so one share needs no other thread.
    """
    global _pool
    shares = max(1, min(get_num_threads(), most))
    if shares > 1 and _pool is None:
        # One thread fewer than CPUs would do, but several Python threads may render at once.
        _pool = ThreadPoolExecutor(os.cpu_count(), "gauss2svg-kernel")
    others = [_pool.submit(work, share, shares) for share in range(1, shares)] if _pool else []
    try:
        work(0, shares)
    finally:
        wait(others)
    for other in others:
        other.result()


def _forget_pool() -> None:
    global _pool
    _pool = None


# Threads do not survive a fork: the child starts its own.
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_pool)
