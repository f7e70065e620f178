"""Jobs: the queue of fits for the pool of worker processes, and the results of finished fits.

The process of a job writes its progress and its results as files into the job's folder
(`worker.py`). The server reads these files, so the two processes do not need to exchange messages.
All functions here run in the same event loop.
"""

from __future__ import annotations

import asyncio
import atexit
import json
import secrets
import shutil
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from starlette.exceptions import HTTPException

from gauss2svg.pool import Pool
from gauss2svg.studio.worker import fit, load

MOST_WAITING = 32  # largest number of jobs in the queue
MOST_KEPT = 1000  # largest number of finished jobs that are kept. The oldest are removed first
MOST_BYTES = 1 << 30  # largest size of the files of all jobs together, in bytes
LOOK_S = 0.05  # seconds between two checks of a job for which a request waits
_CANCEL_S = 0.2  # seconds in which a canceled fit can end by itself, before its process is killed


@dataclass(eq=False)
class Job:
    """A photo to vectorise, and its results.

    folder   folder of the photo, and of the files that the job's process writes
    lines    command line and Python call that make the same SVG
    readers  number of clients that follow the job's events
    call     future of the job, which the pool returns when the job is submitted. Until then, this
             is another future, which stays pending.
    """

    folder: Path
    name: str
    options: dict[str, Any]
    width: int
    height: int
    lines: dict[str, str]
    id: str = field(default_factory=lambda: secrets.token_hex(8))
    readers: int = 0
    is_canceled: bool = False
    call: Future[dict[str, str]] = field(default_factory=Future)
    _report: dict[str, Any] | None = None

    @property
    def progress(self) -> dict[str, Any] | None:
        """The latest progress that the job's process has written, or None if there is none yet."""
        return self._read("progress.json")

    @property
    def report(self) -> dict[str, Any] | None:
        """The report on the SVG, or None if there is no SVG yet."""
        self._report = self._report or self._read("report.json")
        return self._report

    def _read(self, name: str) -> dict[str, Any] | None:
        with suppress(OSError):  # the process may not have written the file yet
            return json.loads((self.folder / name).read_bytes())
        return None

    @property
    def state(self) -> str:
        """State: queued, running, done, stopped, failed or canceled."""
        # `has_ended` must be read before the report. If the report were read first, the job could
        # write its report and end between the two. The job would then seem to have ended without a
        # report, and so to have failed.
        has_ended = self.call.done()
        if self.report is not None:
            return "stopped" if self.report["stop_reason"] == "interrupted" else "done"
        if self.is_canceled:
            return "canceled"
        if has_ended:
            return "failed"
        return "running" if self.call.running() else "queued"

    @property
    def is_over(self) -> bool:
        """Whether the job is neither queued nor running.

        Its process may still write further files.
        """
        return self.state not in ("queued", "running")

    @property
    def error(self) -> str:
        """The reason why the job failed or why some of its files are missing, or ""."""
        if self.is_canceled or not self.call.done():
            return ""
        if (error := self.call.exception()) is not None:
            return f"its worker process was lost: {error}"
        return self.call.result().get("error", "")


async def wait_until(condition: Callable[[], object]) -> None:
    """Wait until `condition` returns a true value. It is called every LOOK_S seconds."""
    while not condition():
        await asyncio.sleep(LOOK_S)


class Jobs:
    """All jobs of a server, and the pool that runs them.

    workers  number of fits that run at the same time
    threads  number of CPU threads of each fit
    """

    def __init__(self, workers: int, threads: int) -> None:
        self.workers, self.threads = workers, threads
        self.by_id: dict[str, Job] = {}
        self.folder = Path(tempfile.mkdtemp(prefix="gauss2svg-studio-"))  # private to this user
        atexit.register(shutil.rmtree, self.folder, ignore_errors=True)

    @cached_property
    def _pool(self) -> Pool:
        exit_stack = ExitStack()
        # A studio that is mounted in another application is not told when the server ends. But when
        # the event loop ends, it cancels its tasks. So this task does nothing but wait, and when it
        # is canceled, the pool is ended.
        self._task = asyncio.get_running_loop().create_task(asyncio.Event().wait())
        self._task.add_done_callback(lambda _: self._end(exit_stack))
        return exit_stack.enter_context(Pool(self.workers))

    def _end(self, exit_stack: ExitStack) -> None:
        """End the pool and forget all jobs, so that another event loop can start a new pool."""
        exit_stack.close()
        del self._pool
        for job in tuple(self.by_id.values()):
            self.forget(job)

    def start(self) -> None:
        """Start the workers, and let each of them load what it needs."""
        for _ in range(self.workers):
            self._pool.submit(load)

    def make_space(self) -> None:
        """Make space for another job: forget the oldest finished jobs if there are too many.

        There are too many if their number reaches MOST_KEPT, or if the files of all jobs take
        MOST_BYTES. Raise HTTPException if the queue is full, or if there is still no space.
        """
        if len(self.queue()) >= MOST_WAITING:
            raise _full(f"{MOST_WAITING} photos are waiting already")
        finished = [job for job in self.by_id.values() if job.call.done() and not job.readers]
        sizes = {job.id: _bytes_in(job.folder) for job in self.by_id.values()}
        while finished and (len(finished) >= MOST_KEPT or sum(sizes.values()) >= MOST_BYTES):
            del sizes[finished[0].id]
            self.forget(finished.pop(0))
        if sum(sizes.values()) >= MOST_BYTES:
            raise _full("the photos that wait take all the room")

    def queue(self) -> list[Job]:
        """Return the jobs that wait, in the order in which they came."""
        jobs = self.by_id.values()
        return [job for job in jobs if not job.call.done() and job.state == "queued"]

    def new_folder(self) -> Path:
        """Make a folder for the files of a job, with a random name."""
        return Path(tempfile.mkdtemp(dir=self.folder))

    def submit(self, job: Job) -> None:
        """Queue a job. Its photo must already be in its folder."""
        request = {name: getattr(job, name) for name in ("name", "folder", "options")}
        request |= {"workers": self.workers, "threads": self.threads}
        self.by_id[job.id] = job
        job.call = self._pool.submit(fit, request)

    def stop(self, job: Job) -> None:
        """Tell the fit of a job to end with its best result so far.

        If the fit has not begun, cancel the job instead.
        """
        if job.state == "queued":
            self.cancel(job)
        elif not job.is_over:
            (job.folder / "stop").touch()

    def cancel(self, job: Job) -> None:
        """End a job soon, so that its cores become free.

        A running fit is told to end. If it does not end within _CANCEL_S seconds, its process is
        killed. The job then has no result, unless the SVG and the report had already been written.
        In that case the job counts as done, but further files may be missing.
        """
        if job.call.done():
            return
        job.is_canceled = True
        if job.call.running():
            (job.folder / "cancel").touch()
            asyncio.get_running_loop().call_later(_CANCEL_S, job.call.cancel)
        else:
            job.call.cancel()

    def forget(self, job: Job) -> None:
        """Cancel a job, and remove its files as soon as no worker writes them any more."""
        self.cancel(job)
        self.by_id.pop(job.id, None)
        job.call.add_done_callback(lambda _: shutil.rmtree(job.folder, ignore_errors=True))

    @contextmanager
    def reading(self, job: Job) -> Iterator[None]:
        """Count a client as a reader of a job during the with block.

        If the last reader leaves before the job is over, cancel the job.
        """
        job.readers += 1
        try:
            yield
        finally:
            job.readers -= 1
            if not job.readers and not job.is_over:
                self.cancel(job)


def _full(reason: str) -> HTTPException:
    return HTTPException(429, f"{reason}; try again later", {"Retry-After": "5"})


def _bytes_in(folder: Path) -> int:
    """Return the number of bytes of all files in a folder, or 0 if the folder was removed."""
    with suppress(OSError):
        return sum(file.stat().st_size for file in folder.iterdir())
    return 0
