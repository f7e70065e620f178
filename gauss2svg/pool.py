"""Jobs of many processes: a death, a time limit or a cancellation fails one job and no other.

Every process has pipes of its own. A pool whose processes share a pipe and its lock loses more than
a job where one is killed (docs/decisions/batch.md).
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from itertools import islice
from typing import Any

import psutil

from gauss2svg import processes
from gauss2svg.errors import Gauss2SvgError
from gauss2svg.processes import end_of, end_tree, end_with_parent

_WATCH_S = 0.1  # between two looks at the time and the memory of jobs
_IDLE_S = 1.0  # after which the width is asked for again


class WorkerDiedError(Gauss2SvgError, RuntimeError):
    """A process that crashed or was killed at a job."""


class _Job(Future[Any]):
    """A job whose cancellation ends the process that works on it."""

    lock = threading.Lock()  # of the process, which another job may have next
    process: subprocess.Popen[bytes] | None = None
    ends_at = float("inf")
    reason: Exception | None = None  # for which the process was killed

    def cancel(self) -> bool:
        return super().cancel() or self.end(CancelledError())

    def end(self, reason: Exception) -> bool:
        """Kill the process of this job, which fails with the reason; return whether it had one."""
        with self.lock:
            if self.process is not None:
                self.reason = reason
                end_tree(self.process.pid)
            return self.process is not None


class Pool:
    """Up to `workers` processes, started as jobs need them; its with statement kills them all.

    memory  bytes of a process, above which it is killed; None: no limit
    """

    def __init__(self, workers: int, memory: int | None = None) -> None:
        self.workers, self._memory = workers, memory
        self._threads = ThreadPoolExecutor(workers)
        self._idle: list[subprocess.Popen[bytes]] = []
        self._jobs: set[_Job] = set()
        self._is_closed = threading.Event()

    def __enter__(self) -> Pool:
        threading.Thread(target=self._watch, daemon=True).start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_closed.set()
        for job in tuple(self._jobs):
            job.cancel()
        self._threads.shutdown()
        for process in self._idle:
            _end(process)

    def submit(self, function: Callable[..., Any], *args: Any, timeout: float = 0.0) -> Future[Any]:
        """Return the future of a call, which is killed after `timeout` seconds of work if not 0."""
        job = _Job()
        self._jobs.add(job)
        request = pickle.dumps(pickle.dumps((function, args)))
        self._threads.submit(self._work, job, request, timeout or float("inf"))
        return job

    def _work(self, job: _Job, request: bytes, timeout: float) -> None:
        """Have a process do a job; runs in a thread of its own."""
        if job.set_running_or_notify_cancel():
            try:
                answer = self._answered(job, request, timeout)
            except OSError as error:
                answer = (False, WorkerDiedError(f"no process could be started: {error}"))
            (job.set_result if answer[0] else job.set_exception)(answer[1])
        self._jobs.discard(job)

    def _answered(self, job: _Job, request: bytes, timeout: float) -> tuple[bool, Any]:
        """Return (True, result) or (False, exception) of a job; raise OSError without a process."""
        with job.lock:
            process = self._idle.pop() if self._idle else _started()
            if process.poll() is not None:
                process = _started()
            job.process, job.ends_at = process, time.monotonic() + timeout
        if self._is_closed.is_set():
            job.cancel()
        try:
            process.stdin.write(request)  # pyright: ignore[reportOptionalMemberAccess]
            process.stdin.flush()  # pyright: ignore[reportOptionalMemberAccess]
            answer = pickle.load(process.stdout)  # pyright: ignore[reportArgumentType]
        except Exception:  # of a pipe that is closed, or of an answer that is cut
            answer = (False, job.reason or WorkerDiedError(end_of(_end(process))))
        with job.lock:
            job.process = None
            if job.reason is None and process.poll() is None:
                self._idle.append(process)
            else:
                _end(process)
        # An answer that the job's own processes gave as they were killed does not count.
        return answer if job.reason is None else (False, job.reason)

    def _watch(self) -> None:
        """End jobs that take more time than they may, or more memory than a process may."""
        while not self._is_closed.wait(_WATCH_S):
            for job in tuple(self._jobs):
                if time.monotonic() > job.ends_at:
                    job.end(TimeoutError("it took too long"))
                with suppress(psutil.NoSuchProcess):
                    if self._memory and (process := job.process) is not None:
                        held = psutil.Process(process.pid).memory_info().rss
                        if held > self._memory:
                            job.end(WorkerDiedError(f"it took {held / 1e6:.0f} MB of memory"))


def completed(
    submit: Callable[[Any], Future[Any]],
    requests: Iterator[Any],
    width: Callable[[], int],
) -> Iterator[tuple[Any, Future[Any]]]:
    """Yield (request, its ended future) as jobs end; cancel the others when the iterator is closed.

    requests  are taken as they can be submitted
    width     how many may be submitted at once
    """
    jobs: dict[Future[Any], Any] = {}
    try:
        while True:
            processes.pending()
            for request in islice(requests, max(0, width() - len(jobs))):
                jobs[submit(request)] = request
            if not jobs:
                return
            for job in wait(jobs, _IDLE_S, FIRST_COMPLETED).done:
                yield jobs.pop(job), job
    finally:
        for job in jobs:
            job.cancel()


def _started() -> subprocess.Popen[bytes]:
    command, pipe = processes.module_command("gauss2svg.pool"), subprocess.PIPE
    return subprocess.Popen(
        command,
        stdin=pipe,
        stdout=pipe,
        env={**os.environ, **processes.module_path()},
        start_new_session=True,
        creationflags=processes.NEW_GROUP,
    )


def _end(process: subprocess.Popen[bytes]) -> int:
    """Kill a process with what it has started, and return its exit status."""
    end_tree(process.pid)
    with suppress(BrokenPipeError), process:  # closes its pipes
        pass
    return process.wait()


def _serve() -> None:
    """Answer requests of standard input on standard output, until the pool closes them or ends."""
    end_with_parent(os.getppid())
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a job prints is no answer
    with suppress(EOFError, BrokenPipeError):
        while True:
            request = pickle.load(sys.stdin.buffer)
            try:
                function, args = pickle.loads(request)
                answer = pickle.dumps((True, function(*args)))
            except BaseException as error:
                answer = pickle.dumps((False, error))
            answers.write(answer)
            answers.flush()


if __name__ == "__main__":
    _serve()
