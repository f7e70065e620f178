"""Jobs: calls in the shared pool, in one line, and how long their results are kept.

The process of a job tells how it stands by files in its folder (`worker.py`). Who wants to know
looks at them, so that no message is sent between processes. All of this runs in one event loop.
"""

from __future__ import annotations

import asyncio
import json
import os
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

from gauss2svg.pool import Pool
from gauss2svg.studio.worker import fit, warm

MOST_WAITING = 32
MOST_KEPT = 1000  # finished jobs, of which the oldest are forgotten
MOST_BYTES = 1 << 30  # of the files of all jobs
UNWATCHED_S = 2.0  # after which a job whose last reader is gone is canceled
LOOK_S = 0.05  # between two looks at a job that somebody waits for
_CANCEL_S = 0.2  # in which a fit may end by itself, and its process stay warm
QUEUED, RUNNING, DONE, STOPPED = "queued", "running", "done", "stopped"
FAILED, CANCELED = "failed", "canceled"


class QueueFullError(Exception):
    """No more jobs are taken; the message says why."""


@dataclass(eq=False)
class Job:
    """A photo to vectorise, and what has become of it.

    folder  with the photo, and later the files of its process
    keep    whether it runs on without a reader
    call    of the pool; before it is submitted one that never runs
    """

    folder: Path
    name: str
    options: dict[str, Any]
    width: int
    height: int
    lines: dict[str, str]
    keep: bool = False
    id: str = field(default_factory=lambda: secrets.token_hex(8))
    readers: int = 0
    is_canceled: bool = False
    call: Future[dict[str, str]] = field(default_factory=Future)
    _report: dict[str, Any] | None = None

    @property
    def photo(self) -> Path:
        """The file of the photo."""
        return self.folder / "photo"

    @property
    def progress(self) -> dict[str, Any] | None:
        """What its process has told last."""
        return self._told("progress.json")

    @property
    def report(self) -> dict[str, Any] | None:
        """The report, once there is an SVG."""
        self._report = self._report or self._told("report.json")
        return self._report

    def _told(self, name: str) -> dict[str, Any] | None:
        with suppress(OSError):  # it is not there yet
            return json.loads((self.folder / name).read_bytes())
        return None

    @property
    def state(self) -> str:
        """One of the six states."""
        is_ready = self.is_ready  # before the report is looked for, which is written before
        if self.report is not None:
            return STOPPED if self.report["stop_reason"] == "interrupted" else DONE
        if self.is_canceled:
            return CANCELED
        if is_ready:
            return FAILED
        return RUNNING if self.call.running() else QUEUED

    @property
    def is_over(self) -> bool:
        """Whether it neither waits nor runs; some files may still be written."""
        return self.state not in (QUEUED, RUNNING)

    @property
    def is_ready(self) -> bool:
        """Whether all files are written, or no more will be."""
        return self.call.done()

    @property
    def problem(self) -> str:
        """Why it failed, or of a fit that is done why it lacks files."""
        if self.is_canceled or not self.call.done():
            return ""
        if (error := self.call.exception()) is not None:
            return f"its worker process was lost: {error}"
        return self.call.result().get("error", "")


async def until(true: Callable[[], object]) -> None:
    """Wait until a function of a job returns what is true."""
    while not true():
        await asyncio.sleep(LOOK_S)


class Jobs:
    """All jobs of a server, and its pool: how many fits run at once, and threads of each."""

    def __init__(self, workers: int, threads: int) -> None:
        self.workers, self.threads = workers, threads
        self.known: dict[str, Job] = {}
        self._line: list[Job] = []
        self._ending = ExitStack()

    @cached_property
    def folder(self) -> Path:
        """The private folder, which is removed by `close`."""
        made = tempfile.TemporaryDirectory(prefix="gauss2svg-studio-", ignore_cleanup_errors=True)
        return Path(self._ending.enter_context(made))

    @cached_property
    def _pool(self) -> Pool:
        _ = self.folder  # which is removed after the pool has ended
        # Where the studio is mounted nobody calls `close`, and Python waits for the pool's threads.
        self._task = asyncio.get_running_loop().create_task(self._close_with_loop())
        return self._ending.enter_context(Pool(self.workers))

    async def _close_with_loop(self) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            self.close()

    def start(self) -> None:
        """Start the workers, which get warm."""
        for _ in range(self.workers):
            self._pool.submit(warm, os.getpid())

    def close(self) -> None:
        """Cancel all jobs, end the workers, remove the folder."""
        self._ending.close()
        self.known.clear()
        for name in ("folder", "_pool"):  # another loop may begin anew
            vars(self).pop(name, None)

    def check_room(self) -> None:
        """Forget the oldest finished jobs; raise QueueFullError where no job can be taken."""
        if len(self.line()) >= MOST_WAITING:
            raise QueueFullError(f"{MOST_WAITING} photos are waiting already; try again later")
        over = [job for job in self.known.values() if job.is_ready and not job.readers]
        sizes = {job.id: _bytes_in(job.folder) for job in self.known.values()}
        while over and (len(over) >= MOST_KEPT or sum(sizes.values()) >= MOST_BYTES):
            del sizes[over[0].id]
            self.forget(over.pop(0))
        if sum(sizes.values()) >= MOST_BYTES:
            raise QueueFullError("the photos that wait take all the room; try again later")

    def line(self) -> list[Job]:
        """Return the jobs that wait, in their order."""
        self._line = [job for job in self._line if job.state == QUEUED]
        return self._line

    def new_folder(self) -> Path:
        """Make a folder for the files of a job; its name has nothing of the photo's."""
        return Path(tempfile.mkdtemp(dir=self.folder))

    def submit(self, job: Job) -> None:
        """Queue a job whose photo is in its folder."""
        request = {name: getattr(job, name) for name in ("photo", "name", "folder", "options")}
        request |= {"workers": self.workers, "threads": self.threads, "server": os.getpid()}
        self.known[job.id] = job
        self._line.append(job)
        job.call = self._pool.submit(fit, request)

    def stop(self, job: Job) -> None:
        """End a fit with the best so far; one that has not begun is canceled."""
        if job.state == QUEUED:
            self.cancel(job)
        elif not job.is_over:
            (job.folder / "stop").touch()

    def cancel(self, job: Job) -> None:
        """End a job without a result, or without the rest of its files; its core is soon free."""
        if job.is_ready:
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
        self.known.pop(job.id, None)
        job.call.add_done_callback(lambda _: shutil.rmtree(job.folder, ignore_errors=True))

    @contextmanager
    def reading(self, job: Job) -> Iterator[None]:
        """Inside there is a reader; a moment after the last is gone the job is canceled."""
        job.readers += 1
        try:
            yield
        finally:
            job.readers -= 1

            def if_unwatched() -> None:
                if not job.readers and not job.is_over and not job.keep:
                    self.cancel(job)

            asyncio.get_running_loop().call_later(UNWATCHED_S, if_unwatched)


def _bytes_in(folder: Path) -> int:
    """Return the bytes of the files of a folder; 0 where somebody has removed it."""
    with suppress(OSError):
        return sum(file.stat().st_size for file in folder.iterdir())
    return 0
