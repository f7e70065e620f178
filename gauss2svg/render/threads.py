"""Threads that share the work of a kernel.

Kernels are compiled for one thread and release Python's global lock (`nogil`), so that ordinary
Python threads run them side by side. numba's own parallel loops take as long to run, but five
times as long to compile (docs/decisions/kernels.md).
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

# torch's OpenMP reads this when it is loaded. PASSIVE lets idle threads sleep. By default they spin
# on a core that a kernel could use. A value that the user has set is kept.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from numba import get_num_threads, njit

from gauss2svg.kernel_cache import cached

# Decorator of a kernel that Python calls. Kernels need no check for division by zero.
kernel = cached(nogil=True, error_model="numpy")
# Decorator of a function that only kernels call. It has no entry points for Python and no reference
# counts, which would only take time to compile.
_INSIDE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True, "_nrt": False}
tile_kernel = njit(nogil=True, error_model="numpy", **_INSIDE)

_pool: ThreadPoolExecutor | None = None


def in_shares(work: Callable[[int, int], None], max_shares: int) -> None:
    """Call work(share, shares) for share = 0, ..., shares - 1 at the same time, and wait for all.

    The number of shares is that of numba's threads (numba.set_num_threads), but in 1..max_shares.
    The calling thread does the first share, so one share needs no other thread.
    """
    global _pool
    shares = max(1, min(get_num_threads(), max_shares))
    if shares > 1 and _pool is None:
        # One thread less would do for one caller, but several may render at once.
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
