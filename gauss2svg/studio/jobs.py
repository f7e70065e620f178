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
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from gauss2svg.pool import Pool
from gauss2svg.studio.worker import fit, load

MOST_KEPT = 200  # largest number of finished jobs that are kept. The oldest are removed first


@dataclass(eq=False)
class Job:
    """A photo to vectorise, and its results.

    folder  folder of the photo, and of the files that the job's process writes
    lines   command line and Python call that make the same SVG
    call    future of the job, which the pool returns when the job is submitted. Until then, this is
            another future, which stays pending.
    """

    folder: Path
    name: str
    options: dict[str, Any]
    width: int
    height: int
    lines: dict[str, str]
    id: str = field(default_factory=lambda: secrets.token_hex(8))
    call: Future[dict[str, str]] = field(default_factory=Future)

    @property
    def progress(self) -> dict[str, Any] | None:
        """The latest progress that the job's process has written, or None if there is none yet."""
        return self._read("progress.json")

    @property
    def report(self) -> dict[str, Any] | None:
        """The report on the SVG, or None if there is no SVG yet."""
        return self._read("report.json")

    def _read(self, name: str) -> dict[str, Any] | None:
        with suppress(OSError):  # the process may not have written the file yet
            return json.loads((self.folder / name).read_bytes())
        return None

    @property
    def state(self) -> str:
        """State: queued, running, done or failed. A done job may still write further files."""
        # `has_ended` must be read before the report. If the report were read first, the job could
        # write its report and end between the two. The job would then seem to have ended without a
        # report, and so to have failed.
        has_ended = self.call.done()
        if self.report is not None:
            return "done"
        if has_ended:
            return "failed"
        return "running" if self.call.running() else "queued"

    @property
    def is_over(self) -> bool:
        """Whether the job is neither queued nor running."""
        return self.state in ("done", "failed")

    @property
    def error(self) -> str:
        """The reason why the job failed or why some of its files are missing, or ""."""
        if self.call.cancelled() or not self.call.done():
            return ""
        if (error := self.call.exception()) is not None:
            return f"its worker process was lost: {error}"
        return self.call.result().get("error", "")


async def wait_until(condition: Callable[[], object]) -> None:
    """Wait until `condition` returns a true value. It is called 20 times a second."""
    while not condition():
        await asyncio.sleep(0.05)


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
        pool = Pool(self.workers).__enter__()
        # A studio that is mounted in another application is not told when the server ends. But when
        # the event loop ends, it cancels its tasks. So this task does nothing but wait, and when it
        # is canceled, the pool is ended.
        self._task = asyncio.get_running_loop().create_task(asyncio.Event().wait())
        self._task.add_done_callback(pool.__exit__)
        return pool

    def start(self) -> None:
        """Start the workers, and let each of them load what it needs."""
        for _ in range(self.workers):
            self._pool.submit(load)

    def new_folder(self) -> Path:
        """Make a folder for the files of a job, with a random name."""
        return Path(tempfile.mkdtemp(dir=self.folder))

    def submit(self, job: Job) -> None:
        """Queue a job, whose photo must already be in its folder. Forget the oldest results."""
        finished = [old for old in self.by_id.values() if old.call.done()]
        for old in finished[:-MOST_KEPT]:
            self.forget(old)
        request = {name: getattr(job, name) for name in ("name", "folder", "options")}
        request |= {"workers": self.workers, "threads": self.threads}
        self.by_id[job.id] = job
        job.call = self._pool.submit(fit, request)

    def forget(self, job: Job) -> None:
        """End a job, and remove its files as soon as no worker writes them any more.

        If its fit runs, its process is killed, so that its cores become free at once.
        """
        self.by_id.pop(job.id, None)
        job.call.cancel()
        job.call.add_done_callback(lambda _: shutil.rmtree(job.folder, ignore_errors=True))
