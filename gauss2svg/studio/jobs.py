"""Jobs: a bounded queue before the workers, states, and how long results are kept.

`Worker` is a worker process as the server sees it. Everything here runs in one event loop, so
nothing needs a lock.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import secrets
import shutil
import tempfile
import time
from collections import deque
from collections.abc import AsyncIterator, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gauss2svg.processes import end_of, end_tree, module_command, module_path, own_group

MOST_WAITING = 32
MOST_KEPT = 1000  # finished jobs, of which the oldest are forgotten
MOST_WHOLE = 50  # of them; older ones lose what is only looked at
_LOOKED_AT = ("photo.png", "errors.png", "outlines.svg")
MOST_BYTES = 1 << 30  # of the files of all jobs
_CANCEL_S = 0.2  # in which a worker may end its fit by itself, and stay warm
UNWATCHED_S = 2.0  # after which a job whose last reader is gone is canceled
QUEUED, RUNNING, DONE, STOPPED = "queued", "running", "done", "stopped"
FAILED, CANCELED = "failed", "canceled"


class QueueFullError(Exception):
    """No more jobs are taken; the message says why."""


@dataclass(eq=False)
class Job:
    """A photo to vectorise, and what has become of it.

    folder  with the photo, and later what the worker writes
    keep    whether it runs on without a reader
    place   of a queued job, from 1; 0 once it runs
    frame   newest picture of the fit, JPEG, and how many there were
    ready   whether all files are written, or no more will be
    flaw    why some were not, of a fit that is done
    """

    folder: Path
    name: str
    options: dict[str, Any]
    width: int | None
    height: int | None
    keep: bool = False
    id: str = field(default_factory=lambda: secrets.token_hex(8))
    lines: dict[str, str] = field(default_factory=dict)
    state: str = QUEUED
    place: int = 0
    progress: dict[str, Any] | None = None
    report: dict[str, Any] | None = None
    error: str | None = None
    flaw: str = ""
    frame: bytes = b""
    frames: int = 0
    ready: bool = False
    version: int = 0
    readers: int = 0
    worker: Worker | None = None
    _news: asyncio.Event = field(default_factory=asyncio.Event)

    @property
    def photo(self) -> Path:
        """The file of the photo."""
        return self.folder / "photo"

    @property
    def is_over(self) -> bool:
        """Whether it neither waits nor runs."""
        return self.state not in (QUEUED, RUNNING)

    @property
    def is_zipped(self) -> bool:
        """Whether the command would write its SVG gzipped."""
        return bool(self.report and self.report["gzip"])

    def change(self, **values: Any) -> None:
        """Set attributes and wake all who wait for news."""
        for name, value in values.items():
            setattr(self, name, value)
        self.version += 1
        self._news.set()
        self._news = asyncio.Event()

    async def news(self, seen: int) -> int:
        """Wait until there is more than the version seen; returns the newest."""
        while self.version == seen:
            await self._news.wait()
        return self.version

    async def when(self, ready: bool = False, framed: bool = False) -> None:
        """Wait until it is over, until its files are there, or until it has a frame."""
        while not (self.ready if ready else self.is_over or (framed and self.frame)):
            await self.news(self.version)


class Jobs:
    """All jobs of a server, and its workers.

    workers, threads  how many fits run at once, and threads of each
    """

    def __init__(self, workers: int, threads: int, most_waiting: int = MOST_WAITING) -> None:
        self.workers, self.threads = workers, threads
        self.most_waiting = most_waiting
        self.known: dict[str, Job] = {}
        self._waiting: deque[Job] = deque()
        self._arrived = asyncio.Event()
        self._tasks: list[asyncio.Task[None]] = []
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._seconds = 5.0  # of recent fits, smoothed

    @property
    def folder(self) -> Path:
        """The private folder; removed by `close`, with the process, or by orphaned workers."""
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(
                prefix="gauss2svg-studio-", ignore_cleanup_errors=True
            )
        return Path(self._folder.name)

    def start(self) -> None:
        """Start the workers in the running loop, unless they are there."""
        if not self._tasks:
            self._tasks = [asyncio.create_task(self._serve()) for _ in range(self.workers)]

    async def close(self) -> None:
        """Cancel all jobs, end the workers, remove the folder."""
        for job in list(self.known.values()):
            self.cancel(job)
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tasks = []
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    def check_room(self) -> None:
        """Raise QueueFullError where no job would be taken."""
        if len(self._waiting) >= self.most_waiting:
            raise QueueFullError(
                f"{len(self._waiting)} photos are waiting already; try again later"
            )

    @property
    def wait_s(self) -> int:
        """Seconds after which there is probably room."""
        return max(1, round(self._seconds / self.workers))

    def new_folder(self) -> Path:
        """A folder for the files of a job; its name has nothing of the photo's."""
        path = self.folder / secrets.token_hex(8)
        path.mkdir(parents=True)
        return path

    def submit(self, job: Job) -> None:
        """Queue a job whose photo is in its folder; raises QueueFullError."""
        self.check_room()
        self._make_room()
        self.start()
        self.known[job.id] = job
        self._waiting.append(job)
        self._tell_places()
        self._arrived.set()

    def stop(self, job: Job) -> None:
        """End a fit with the best so far; one that has not begun is canceled."""
        if job.state == QUEUED:
            self.cancel(job)
        elif job.worker is not None:
            job.worker.send({"job": job.id, "stop": True})

    def cancel(self, job: Job) -> None:
        """End a job without a result, or without the rest of its files; its core is soon free."""
        if job.state == QUEUED:
            self._waiting.remove(job)
            job.change(state=CANCELED, ready=True, place=0)
            self._tell_places()
        elif job.worker is not None:
            worker = job.worker
            worker.send({"job": job.id, "cancel": True})

            def insist() -> None:
                if job.worker is worker:
                    worker.kill()

            asyncio.get_running_loop().call_later(_CANCEL_S, insist)
            if not job.is_over:
                job.change(state=CANCELED)

    def forget(self, job: Job) -> None:
        """Cancel a job, and remove its files once no worker writes them."""
        self.cancel(job)
        if self.known.pop(job.id, None) is not None and job.ready:
            shutil.rmtree(job.folder, ignore_errors=True)

    @contextlib.contextmanager
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

    def _make_room(self) -> None:
        """Forget the oldest finished jobs that nobody reads, after what is only looked at."""
        over = [job for job in self.known.values() if job.ready and not job.readers]
        for job in over[:-MOST_WHOLE]:
            if job.frame:
                job.frame, job.flaw = b"", "it was forgotten for newer ones"
                for name in _LOOKED_AT:
                    (job.folder / name).unlink(missing_ok=True)
        sizes = {job.id: _bytes_in(job.folder) for job in self.known.values()}
        for job in over:
            if len(over) < MOST_KEPT and sum(sizes.values()) < MOST_BYTES:
                return
            over = over[1:]
            del sizes[job.id], self.known[job.id]
            shutil.rmtree(job.folder, ignore_errors=True)
        if sum(sizes.values()) >= MOST_BYTES:
            raise QueueFullError("the photos that wait take all the room; try again later")

    def _tell_places(self) -> None:
        for place, job in enumerate(self._waiting, 1):
            if job.place != place:
                job.change(place=place)

    async def _serve(self) -> None:
        """One worker, replaced where it dies, and one job after the other."""
        worker: Worker | None = None
        try:
            while True:
                failure = ""
                if worker is not None and not worker.is_alive:
                    await worker.end()
                    worker = None
                if worker is None:
                    try:
                        worker = await Worker.started(self.folder)
                    except WorkerDiedError as error:
                        failure = f"no worker could be started: one {error}"
                while not self._waiting:
                    self._arrived.clear()
                    await self._arrived.wait()
                if worker is not None and not worker.is_alive:
                    continue  # it died idle, which costs no job
                job = self._waiting.popleft()
                self._tell_places()
                if worker is None:
                    job.change(state=FAILED, error=failure, ready=True, place=0)
                    continue
                await self._run(worker, job)
        finally:
            if worker is not None:
                await worker.end()

    async def _run(self, worker: Worker, job: Job) -> None:
        begun = time.monotonic()
        job.change(state=RUNNING, place=0, worker=worker)
        request = {
            "job": job.id,
            "name": job.name,
            "photo": str(job.photo),
            "folder": str(job.folder),
            "options": job.options,
            "workers": self.workers,
            "threads": self.threads,
        }
        worker.send(request)
        try:
            async for message, data in worker.messages(job.id):
                if job.state == CANCELED:
                    continue
                if message["kind"] == "progress":
                    if data:
                        job.frame, job.frames = data, job.frames + 1
                    job.change(progress={**message["progress"], "frame": job.frames})
                elif message["kind"] == "done":
                    report = json.loads((job.folder / "report.json").read_bytes())
                    self._seconds += 0.3 * (time.monotonic() - begun - self._seconds)
                    stopped = report["stop_reason"] == "interrupted"
                    job.change(state=STOPPED if stopped else DONE, report=report)
                else:
                    self._fail(job, message["error"])
        except WorkerDiedError as error:
            self._fail(job, f"its worker process was lost: {error}")
        except (OSError, ValueError) as error:
            await worker.end()  # it may be in the midst of messages, which are not the next job's
            self._fail(job, f"its files were lost: {error}")
        finally:
            job.change(ready=True, worker=None)
            if job.id not in self.known:
                shutil.rmtree(job.folder, ignore_errors=True)

    @staticmethod
    def _fail(job: Job, line: str) -> None:
        """A fit that is done stays so: it only lacks files."""
        if not job.is_over:
            job.change(state=FAILED, error=line)
        elif job.report is not None:
            job.flaw = line


def _bytes_in(folder: Path) -> int:
    """Bytes of the files of a folder; 0 where somebody has removed it."""
    with contextlib.suppress(OSError):
        return sum(file.stat().st_size for file in folder.iterdir())
    return 0


_LONGEST_LINE = 1 << 20


class WorkerDiedError(Exception):
    """The worker process ended by itself, or was killed; the message says how."""


class Worker:
    """A process that fits one photo at a time; made by `started`."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    @classmethod
    async def started(cls, folder: Path) -> Worker:
        """A worker that is warm: kernels loaded, one tiny fit done. Raises WorkerDiedError."""
        try:
            process = await asyncio.create_subprocess_exec(
                *module_command("gauss2svg.studio.worker_process", str(folder)),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                limit=_LONGEST_LINE,
                env={**os.environ, **module_path()},
                # A Ctrl-C at the terminal is the server's; what a worker starts is killed with it.
                **own_group(),
            )
        except NotImplementedError as error:  # a selector's loop on Windows, where it is mounted
            line = "this asyncio loop starts no processes; on Windows its ProactorEventLoop does"
            raise WorkerDiedError(f"could not begin ({line})") from error
        except OSError as error:
            raise WorkerDiedError(f"could not begin ({error.strerror or error})") from error
        worker = cls(process)
        try:
            await worker.receive()
        except BaseException:
            await worker.end()
            raise
        return worker

    @property
    def is_alive(self) -> bool:
        """Whether the process has not ended."""
        return self._process.returncode is None

    def send(self, message: dict[str, Any]) -> None:
        """Send a request; a worker that is dead is found by `receive`."""
        stdin = self._process.stdin
        assert stdin is not None
        with contextlib.suppress(ConnectionError, RuntimeError):
            stdin.write(json.dumps(message).encode() + b"\n")

    async def receive(self) -> tuple[dict[str, Any], bytes]:
        """The next message and its bytes; raises WorkerDiedError where none can come."""
        stdout = self._process.stdout
        assert stdout is not None
        try:
            head = json.loads(await stdout.readuntil(b"\n"))
            return head, await stdout.readexactly(head["bytes"])
        except (asyncio.IncompleteReadError, ConnectionError) as error:
            raise WorkerDiedError(end_of(await self._process.wait())) from error
        except (asyncio.LimitOverrunError, ValueError) as error:
            # What comes next cannot be told from what is left of this.
            await self.end()
            raise WorkerDiedError("sent what is no message") from error

    async def messages(self, job: str) -> AsyncIterator[tuple[dict[str, Any], bytes]]:
        """Messages about a job, until it has ended; raises WorkerDiedError."""
        while True:
            head, data = await self.receive()
            if head["job"] == job:
                if head["kind"] == "ended":
                    return
                yield head, data

    def kill(self) -> None:
        """End the process, and what it has started, at once."""
        if self.is_alive:
            end_tree(self._process.pid)

    async def end(self) -> None:
        """Kill it and wait for its end."""
        self.kill()
        transport = getattr(self._process, "_transport", None)
        # So that none is left for a loop that is closed; and a pipe that is full has no end.
        if transport is not None:
            transport.close()
        await self._process.wait()
