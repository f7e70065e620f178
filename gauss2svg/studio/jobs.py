"""Jobs: calls in the shared pool, in one line, and how long their results are kept.

The process of a job tells how it stands by files in its folder (`worker.py`). Who wants to know
looks at them, so that no message is sent between processes. All of this runs in one event loop.
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

MOST_WAITING = 32
MOST_KEPT = 1000  # finished jobs, of which the oldest are forgotten
MOST_BYTES = 1 << 30  # of the files of all jobs
LOOK_S = 0.05  # between two looks at a job that somebody waits for
_RETRY = {"Retry-After": "5"}  # seconds after which a client may ask again whether there is room
_CANCEL_S = 0.2  # in which a fit may end by itself, and its process stay warm
QUEUED, RUNNING, DONE, STOPPED = "queued", "running", "done", "stopped"
FAILED, CANCELED = "failed", "canceled"


@dataclass(eq=False)
class Job:
    """A photo to vectorise, and what has become of it.

    folder  with the photo, and later the files of its process
    call    of the pool; before it is submitted one that never runs
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
        is_ready = self.call.done()  # before the report is looked for, which is written before
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
    def error(self) -> str:
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
        self.folder = Path(tempfile.mkdtemp(prefix="gauss2svg-studio-"))  # which is private
        atexit.register(shutil.rmtree, self.folder, ignore_errors=True)

    @cached_property
    def _pool(self) -> Pool:
        ending = ExitStack()
        # A mounted studio is told by nobody that it ends; but a loop that ends cancels its tasks.
        self._task = asyncio.get_running_loop().create_task(asyncio.Event().wait())
        self._task.add_done_callback(lambda _: self._end(ending))
        return ending.enter_context(Pool(self.workers))

    def _end(self, ending: ExitStack) -> None:
        """End all jobs and their processes; another loop may begin anew."""
        ending.close()
        del self._pool
        for job in tuple(self.known.values()):
            self.forget(job)

    def start(self) -> None:
        """Start the workers, which get warm."""
        for _ in range(self.workers):
            self._pool.submit(warm)

    def check_room(self) -> None:
        """Forget the oldest finished jobs; raise HTTPException where none can be taken."""
        if len(self.line()) >= MOST_WAITING:
            full = f"{MOST_WAITING} photos are waiting already; try again later"
            raise HTTPException(429, full, _RETRY)
        over = [job for job in self.known.values() if job.call.done() and not job.readers]
        sizes = {job.id: _bytes_in(job.folder) for job in self.known.values()}
        while over and (len(over) >= MOST_KEPT or sum(sizes.values()) >= MOST_BYTES):
            del sizes[over[0].id]
            self.forget(over.pop(0))
        if sum(sizes.values()) >= MOST_BYTES:
            full = "the photos that wait take all the room; try again later"
            raise HTTPException(429, full, _RETRY)

    def line(self) -> list[Job]:
        """Return the jobs that wait, in their order."""
        jobs = self.known.values()
        return [job for job in jobs if not job.call.done() and job.state == QUEUED]

    def new_folder(self) -> Path:
        """Make a folder for the files of a job; its name has nothing of the photo's."""
        return Path(tempfile.mkdtemp(dir=self.folder))

    def submit(self, job: Job) -> None:
        """Queue a job whose photo is in its folder."""
        request = {name: getattr(job, name) for name in ("name", "folder", "options")}
        request |= {"workers": self.workers, "threads": self.threads}
        self.known[job.id] = job
        job.call = self._pool.submit(fit, request)

    def stop(self, job: Job) -> None:
        """End a fit with the best so far; one that has not begun is canceled."""
        if job.state == QUEUED:
            self.cancel(job)
        elif not job.is_over:
            (job.folder / "stop").touch()

    def cancel(self, job: Job) -> None:
        """End a job without a result, or without the rest of its files; its core is soon free."""
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
        self.known.pop(job.id, None)
        job.call.add_done_callback(lambda _: shutil.rmtree(job.folder, ignore_errors=True))

    @contextmanager
    def reading(self, job: Job) -> Iterator[None]:
        """Inside there is a reader; when the last is gone the job is canceled."""
        job.readers += 1
        try:
            yield
        finally:
            job.readers -= 1
            if not job.readers and not job.is_over:
                self.cancel(job)


def _bytes_in(folder: Path) -> int:
    """Return the bytes of the files of a folder; 0 where somebody has removed it."""
    with suppress(OSError):
        return sum(file.stat().st_size for file in folder.iterdir())
    return 0
