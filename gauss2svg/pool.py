"""A pool of processes. If a job crashes, takes too long or is cancelled, the other jobs continue.

Every process has its own pipes. If processes shared a pipe and its lock, killing one process would
make the jobs of other processes fail too (docs/decisions/batch.md).
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from itertools import islice
from typing import Any

from gauss2svg import processes
from gauss2svg.errors import Gauss2SvgError
from gauss2svg.processes import end_of, end_tree


class WorkerDiedError(Gauss2SvgError, RuntimeError):
    """A worker process that crashed or was killed during a job."""


class _Job(Future[Any]):
    """A job of a pool. If it is cancelled while it runs, its process is killed."""

    # When a job is done, its process may do another job. A job must not kill a process that already
    # belongs to another job. So all jobs share this one lock, and hold it while they take, give
    # back or kill a process.
    lock = threading.Lock()
    process: subprocess.Popen[bytes] | None = None
    reason: Exception | None = None  # reason why the process was killed

    def cancel(self) -> bool:
        return super().cancel() or self.end(CancelledError())

    def end(self, reason: Exception) -> bool:
        """Kill the process that works on the job, so that the job fails.

        Return whether there was such a process.
        """
        with self.lock:
            if self.process is not None:
                self.reason = reason
                end_tree(self.process.pid)
            return self.process is not None


class Pool:
    """A pool of up to `workers` processes. Use it in a with statement.

    A process is started when a job needs one. When the with block ends, all processes end.

    reuses  whether a process does several jobs, one after the other
    """

    def __init__(self, workers: int, reuses: bool = True) -> None:
        self.workers, self._reuses = workers, reuses
        self._threads = ThreadPoolExecutor(workers)
        self._idle: list[subprocess.Popen[bytes]] = []
        self._jobs: set[_Job] = set()
        self._is_closed = False

    def __enter__(self) -> Pool:
        return self

    def __exit__(self, *_: object) -> None:
        self._is_closed = True
        for job in tuple(self._jobs):
            job.cancel()
        self._threads.shutdown()
        for process in self._idle:
            _end(process)

    def submit(self, function: Callable[..., Any], *args: Any, timeout: float = 0.0) -> Future[Any]:
        """Queue a call of a function, and return its future.

        If the call takes more than `timeout` seconds, its process is killed. 0 means no limit.
        """
        job = _Job()
        self._jobs.add(job)
        request = pickle.dumps(pickle.dumps((function, args)))
        self._threads.submit(self._work, job, request, timeout)
        return job

    def _work(self, job: _Job, request: bytes, timeout: float) -> None:
        """Run a job in a process, and set its result.

        Each running job has a thread of its own, which waits here.
        """
        if job.set_running_or_notify_cancel():
            try:
                answer = self._answer(job, request, timeout)
            except OSError as error:
                answer = (False, WorkerDiedError(f"no process could be started: {error}"))
            (job.set_result if answer[0] else job.set_exception)(answer[1])
        self._jobs.discard(job)

    def _answer(self, job: _Job, request: bytes, timeout: float) -> tuple[bool, Any]:
        """Let a process do a job. Return (True, result) or (False, exception).

        Raise OSError if no process can be started.
        """
        with job.lock:
            process = self._idle.pop() if self._idle else _start()
            if process.poll() is not None:
                process = _start()
            job.process = process
        if self._is_closed:
            job.cancel()
        timer = threading.Timer(timeout, job.end, [TimeoutError("it took too long")])
        timer.daemon = True
        if timeout:
            timer.start()
        try:
            process.stdin.write(request)  # pyright: ignore[reportOptionalMemberAccess]
            process.stdin.flush()  # pyright: ignore[reportOptionalMemberAccess]
            answer = pickle.load(process.stdout)  # pyright: ignore[reportArgumentType]
        except Exception:  # the process has closed the pipe, or its answer is incomplete
            answer = (False, job.reason or WorkerDiedError(end_of(_end(process))))
        timer.cancel()
        with job.lock:
            job.process = None
            if self._reuses and job.reason is None and process.poll() is None:
                self._idle.append(process)
            else:
                _end(process)
        # The answer of a killed process is ignored, because it may be an error that killing the
        # process has caused.
        return answer if job.reason is None else (False, job.reason)


def completed(
    submit: Callable[[Any], Future[Any]],
    requests: Iterator[Any],
    width: int,
) -> Iterator[tuple[Any, Future[Any]]]:
    """Yield each request with its finished future, in the order in which jobs end.

    Closing the iterator cancels the remaining jobs.

    requests  iterator that is advanced only when a request can be submitted
    width     largest number of submitted requests that are unfinished at the same time
    """
    jobs: dict[Future[Any], Any] = {}
    try:
        while True:
            for request in islice(requests, width - len(jobs)):
                jobs[submit(request)] = request
            if not jobs:
                return
            # Windows handles Ctrl-C only between two waits.
            for job in wait(jobs, 1.0, FIRST_COMPLETED).done:
                yield jobs.pop(job), job
    finally:
        for job in jobs:
            job.cancel()


def _start() -> subprocess.Popen[bytes]:
    streams = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    command = processes.module_command("gauss2svg.pool")
    return processes.start(command, processes.python_environment(), **streams)


def _end(process: subprocess.Popen[bytes]) -> int:
    """Kill a process and all processes that it has started, and return its exit status."""
    end_tree(process.pid)
    # The with statement closes the pipes to the process. This raises BrokenPipeError if a pipe has
    # data that the process has not received.
    with suppress(BrokenPipeError), process:
        pass
    return process.wait()


def _serve() -> None:
    """Read requests from standard input, and write the answers to standard output.

    Return when one of these streams is closed.
    """
    processes.keep_freed_memory()
    answers = os.fdopen(os.dup(1), "wb")
    # Text that a job prints goes to standard error, so that it is not mixed with the answers.
    os.dup2(2, 1)
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
