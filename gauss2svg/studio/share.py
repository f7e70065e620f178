"""How the cores of a machine are shared out among fits."""

from __future__ import annotations

from gauss2svg.compare.machine import machine
from gauss2svg.errors import whole_number

# A fit on four threads takes 45 % of the time of one thread, on eight 36 %: more cores serve more
# fits (docs/decisions/studio.md).
_THREADS = 4


def workers_and_threads(jobs: int | None, threads: int | None) -> tuple[int, int]:
    """Fits at once, and threads of each; raises InputError for more than there are cores."""
    cores = machine()["cores"]
    if threads is not None:
        whole_number("threads", threads, 1, cores)
    if jobs is None:
        jobs = max(1, cores // (threads or _THREADS))
    whole_number("jobs", jobs, 1, cores)
    return jobs, threads or max(1, cores // jobs)
