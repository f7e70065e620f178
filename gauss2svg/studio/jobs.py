"""Jobs: the queue of fits for the pool of worker processes, and the results of finished fits.

The process of a job writes its progress and its results as files into the job's folder
(`worker.py`). The server reads these files, so the two processes need no messages. All functions
here run in one event loop.
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
from gauss2svg.studio.worker import fit, warm

MOST_WAITING = 32  # limit of jobs in the queue
MOST_KEPT = 1000  # limit of finished jobs. The oldest are forgotten first
MOST_BYTES = 1 << 30  # limit of the bytes of all jobs' files
LOOK_S = 0.05  # seconds between two looks at a job that a request waits for
_RETRY = {"Retry-After": "5"}  # seconds after which a refused client may try again
_CANCEL_S = 0.2  # seconds that a canceled fit has to end by itself, before its process is killed
QUEUED, RUNNING, DONE, STOPPED = "queued", "running", "done", "stopped"
FAILED, CANCELED = "failed", "canceled"


@dataclass(eq=False)
class Job:
    """A photo to vectorise, and its results.

    folder   folder of the photo, and of the files that its process writes
    lines    command line and Python call that make the same file
    readers  number of clients that follow the job's events
    call     future of the pool. Until the job is submitted, a future that never runs
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
        """Progress that the job's process wrote last, or None as long as there is none."""
        return self._read("progress.json")

    @property
    def report(self) -> dict[str, Any] | None:
        """Report, or None as long as there is no SVG."""
        self._report = self._report or self._read("report.json")
        return self._report

    def _read(self, name: str) -> dict[str, Any] | None:
        with suppress(OSError):  # the file is not written yet
            return json.loads((self.folder / name).read_bytes())
        return None

    @property
    def state(self) -> str:
        """State: queued, running, done, stopped, failed or canceled."""
        has_ended = self.call.done()  # read before the report, because a job may end in between
        if self.report is not None:
            return STOPPED if self.report["stop_reason"] == "interrupted" else DONE
        if self.is_canceled:
            return CANCELED
        if has_ended:
            return FAILED
        return RUNNING if self.call.running() else QUEUED

    @property
    def is_over(self) -> bool:
        """Whether the job neither waits nor runs. Its process may still write further files."""
        return self.state not in (QUEUED, RUNNING)

    @property
    def error(self) -> str:
        """Reason why the job failed or lacks files, or ""."""
        if self.is_canceled or not self.call.done():
            return ""
        if (error := self.call.exception()) is not None:
            return f"its worker process was lost: {error}"
        return self.call.result().get("error", "")


async def wait_until(condition: Callable[[], object]) -> None:
    """Wait until a condition on a job is true."""
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
        # Nothing tells a mounted studio that the server ends. But when an event loop ends, it
        # cancels its tasks. So this task waits for that, and then ends the pool.
        self._task = asyncio.get_running_loop().create_task(asyncio.Event().wait())
        self._task.add_done_callback(lambda _: self._end(exit_stack))
        return exit_stack.enter_context(Pool(self.workers))

    def _end(self, exit_stack: ExitStack) -> None:
        """End the pool and forget all jobs. Another event loop may start a new pool."""
        exit_stack.close()
        del self._pool
        for job in tuple(self.by_id.values()):
            self.forget(job)

    def start(self) -> None:
        """Start the workers, and warm them up."""
        for _ in range(self.workers):
            self._pool.submit(warm)

    def make_space(self) -> None:
        """Forget the oldest finished jobs. Raise HTTPException if no other job can be accepted."""
        if len(self.queue()) >= MOST_WAITING:
            full = f"{MOST_WAITING} photos are waiting already; try again later"
            raise HTTPException(429, full, _RETRY)
        finished = [job for job in self.by_id.values() if job.call.done() and not job.readers]
        sizes = {job.id: _bytes_in(job.folder) for job in self.by_id.values()}
        while finished and (len(finished) >= MOST_KEPT or sum(sizes.values()) >= MOST_BYTES):
            del sizes[finished[0].id]
            self.forget(finished.pop(0))
        if sum(sizes.values()) >= MOST_BYTES:
            full = "the photos that wait take all the room; try again later"
            raise HTTPException(429, full, _RETRY)

    def queue(self) -> list[Job]:
        """Return the jobs that wait, first come first."""
        jobs = self.by_id.values()
        return [job for job in jobs if not job.call.done() and job.state == QUEUED]

    def new_folder(self) -> Path:
        """Make a folder for the files of a job, with a random name."""
        return Path(tempfile.mkdtemp(dir=self.folder))

    def submit(self, job: Job) -> None:
        """Queue a job, whose photo is in its folder already."""
        request = {name: getattr(job, name) for name in ("name", "folder", "options")}
        request |= {"workers": self.workers, "threads": self.threads}
        self.by_id[job.id] = job
        job.call = self._pool.submit(fit, request)

    def stop(self, job: Job) -> None:
        """End a fit, and keep the best result so far. Cancel a job that has not begun."""
        if job.state == QUEUED:
            self.cancel(job)
        elif not job.is_over:
            (job.folder / "stop").touch()

    def cancel(self, job: Job) -> None:
        """End a job without a result, or without the files after it. Its cores soon become free."""
        if job.call.done():
            return
        job.is_canceled = True
        if job.call.running():
            (job.folder / "cancel").touch()
            asyncio.get_running_loop().call_later(_CANCEL_S, job.call.cancel)
        else:
            job.call.cancel()

    def forget(self, job: Job) -> None:
        """Cancel a job, and remove its files once no worker writes them."""
        self.cancel(job)
        self.by_id.pop(job.id, None)
        job.call.add_done_callback(lambda _: shutil.rmtree(job.folder, ignore_errors=True))

    @contextmanager
    def reading(self, job: Job) -> Iterator[None]:
        """Count a reader of a job during the `with` block. When the last leaves, cancel the job."""
        job.readers += 1
        try:
            yield
        finally:
            job.readers -= 1
            if not job.readers and not job.is_over:
                self.cancel(job)


def _bytes_in(folder: Path) -> int:
    """Return the bytes of the files in a folder, or 0 if the folder was removed."""
    with suppress(OSError):
        return sum(file.stat().st_size for file in folder.iterdir())
    return 0
