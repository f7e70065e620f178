"""Worker processes that share out work: one that dies costs what it was at, and is replaced."""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from typing import IO, Any

from gauss2svg.bench.rows import one_line
from gauss2svg.bench.runner import end_of, last_line

# -P: no module of the folder that it is started in.
_COMMAND = (sys.executable, "-P", "-m", "gauss2svg.gallery.worker")
_TO_END_S = 10.0  # for a worker to end what it has started, before it is killed
Answer = dict[str, Any]
_INTERRUPTED = {"error": "interrupted"}


class WorkerPool:
    """Up to `jobs` workers; use it in a with statement, at the end of which none is left."""

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._idle: list[_Worker] = []
        self._all: set[_Worker] = set()
        self._threads: list[threading.Thread] = []
        self._lock = threading.Lock()
        self._closed = False

    def __enter__(self) -> WorkerPool:
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._closed = True
            workers = list(self._all)
        for worker in workers:
            worker.terminate()
        for thread in self._threads:  # each waits for its worker, which is ending
            if thread.is_alive():  # and was started before an interruption
                thread.join()
        for worker in workers:
            worker.end()

    def run(self, works: Sequence[Mapping[str, Any]]) -> Iterator[tuple[int, Answer | None]]:
        """(index, None) when a piece of work begins and (index, answer) when it is done."""
        waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
        events: queue.SimpleQueue[tuple[int, Answer | Exception | None]] = queue.SimpleQueue()
        for index in range(len(works)):
            waiting.put(index)

        def serve() -> None:
            while not self._closed:
                try:
                    index = waiting.get_nowait()
                except queue.Empty:
                    return
                events.put((index, None))
                try:
                    events.put((index, self._answer(works[index])))
                except Exception as error:  # a fault of ours: raised where it is waited for
                    events.put((index, error))

        threads = [threading.Thread(target=serve) for _ in range(min(self._jobs, len(works)))]
        self._threads += threads
        for thread in threads:
            thread.start()
        left = len(works)
        while left:
            index, answer = events.get()
            if isinstance(answer, Exception):
                raise answer
            left -= answer is not None
            yield index, answer

    def _answer(self, work: Mapping[str, Any]) -> Answer:
        with self._lock:
            if self._closed:
                return _INTERRUPTED
            try:
                worker = self._ready()
            except OSError as error:  # no process or no file more can be had
                return {"error": one_line(f"cannot start a worker: {error}; try fewer --jobs")}
        answer = worker.answer(work)
        with self._lock:
            if worker.is_alive():
                self._idle.append(worker)
            else:
                self._all.discard(worker)
                worker.end()
        return answer

    def _ready(self) -> _Worker:
        """One that has nothing to do, and lives."""
        while self._idle:
            worker = self._idle.pop()
            if worker.is_alive():
                return worker
            self._all.discard(worker)
            worker.end()
        worker = _Worker()
        self._all.add(worker)
        return worker


class _Worker:
    """One process, and its pipes."""

    def __init__(self) -> None:
        self._told_to_end = False
        self._killer: threading.Timer | None = None
        with ExitStack() as stack:
            self._chatter: IO[bytes] = stack.enter_context(tempfile.TemporaryFile())
            # A session of its own: a Ctrl-C at the terminal is for this process to pass on.
            self._process = subprocess.Popen(
                _COMMAND,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._chatter,
                start_new_session=True,
                text=True,
            )
            stack.pop_all()  # it is closed by end()

    def answer(self, work: Mapping[str, Any]) -> Answer:
        """What it says, or how it ended without an answer."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(json.dumps(work) + "\n")
            process.stdin.flush()
            line = process.stdout.readline()
        except (OSError, ValueError):  # its pipe is broken or closed: its status says why
            line = ""
        if line.endswith("\n"):  # and was not cut short
            return json.loads(line)
        if self._told_to_end:
            return _INTERRUPTED
        try:
            status = process.wait(_TO_END_S)
        except subprocess.TimeoutExpired:  # it only closed its output
            process.kill()
            status = process.wait()
        return {"error": one_line(f"worker {end_of(status)}: {last_line(self._chatter)}")}

    def is_alive(self) -> bool:
        """Whether it can take more work."""
        return self._process.poll() is None

    def terminate(self) -> None:
        """Ask it to end; one that does not is killed after a while."""
        self._told_to_end = True
        if self.is_alive():
            self._process.terminate()
            self._killer = threading.Timer(_TO_END_S, self._process.kill)
            self._killer.daemon = True
            self._killer.start()

    def end(self) -> None:
        """Wait for its end, which was asked for, and close its pipes."""
        self._process.wait()
        if self._killer is not None:
            self._killer.cancel()
        for stream in (self._process.stdin, self._process.stdout, self._chatter):
            try:
                if stream is not None:
                    stream.close()
            except OSError:  # what was not flushed has nobody left to read it
                continue
