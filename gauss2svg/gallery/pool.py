"""A pool of worker processes: one that dies fails its own request only, and is replaced."""

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

from gauss2svg.bench.process import end_of, last_line
from gauss2svg.bench.rows import one_line

# -P: the current folder is not on the module path.
_COMMAND = (sys.executable, "-P", "-m", "gauss2svg.gallery.worker")
_GRACE_S = 10.0  # time for a worker to end its own children before it is killed
Answer = dict[str, Any]
_INTERRUPTED = {"error": "interrupted"}


class WorkerPool:
    """Up to `jobs` workers; leaving its with statement ends them all."""

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
        for thread in self._threads:  # each waits for its worker, which ends now
            if thread.is_alive():  # an interruption may come before it is started
                thread.join()
        for worker in workers:
            worker.end()

    def run(self, requests: Sequence[Mapping[str, Any]]) -> Iterator[tuple[int, Answer | None]]:
        """Yields (index, None) when a request begins and (index, answer) when it is done."""
        waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
        events: queue.SimpleQueue[tuple[int, Answer | Exception | None]] = queue.SimpleQueue()
        for index in range(len(requests)):
            waiting.put(index)

        def serve() -> None:
            while not self._closed:
                try:
                    index = waiting.get_nowait()
                except queue.Empty:
                    return
                events.put((index, None))
                try:
                    events.put((index, self._answer(requests[index])))
                except Exception as error:  # a bug of ours: raised by the consumer
                    events.put((index, error))

        threads = [threading.Thread(target=serve) for _ in range(min(self._jobs, len(requests)))]
        self._threads += threads
        for thread in threads:
            thread.start()
        left = len(requests)
        while left:
            index, answer = events.get()
            if isinstance(answer, Exception):
                raise answer
            left -= answer is not None
            yield index, answer

    def _answer(self, request: Mapping[str, Any]) -> Answer:
        with self._lock:
            if self._closed:
                return _INTERRUPTED
            try:
                worker = self._ready()
            except OSError as error:  # too many processes or open files
                return {"error": one_line(f"cannot start a worker: {error}. Try fewer --jobs")}
        answer = worker.answer(request)
        with self._lock:
            if worker.is_alive():
                self._idle.append(worker)
            else:
                self._all.discard(worker)
                worker.end()
        return answer

    def _ready(self) -> _Worker:
        """An idle worker that is alive, or a new one."""
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
    """A process and its pipes."""

    def __init__(self) -> None:
        self._terminated = False
        self._killer: threading.Timer | None = None
        with ExitStack() as stack:
            self._stderr: IO[bytes] = stack.enter_context(tempfile.TemporaryFile())
            # In a new session, so that a Ctrl-C at the terminal reaches this process alone.
            self._process = subprocess.Popen(
                _COMMAND,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._stderr,
                start_new_session=True,
                text=True,
            )
            stack.pop_all()  # end() closes it

    def answer(self, request: Mapping[str, Any]) -> Answer:
        """Its answer, or an error where it ended without one."""
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(json.dumps(request) + "\n")
            process.stdin.flush()
            line = process.stdout.readline()
        except (OSError, ValueError):  # a broken pipe: the exit status says why
            line = ""
        if line.endswith("\n"):  # complete
            return json.loads(line)
        if self._terminated:
            return _INTERRUPTED
        try:
            status = process.wait(_GRACE_S)
        except subprocess.TimeoutExpired:  # it has only closed its output
            process.kill()
            status = process.wait()
        return {"error": one_line(f"worker {end_of(status)}: {last_line(self._stderr)}")}

    def is_alive(self) -> bool:
        """Whether the process is running."""
        return self._process.poll() is None

    def terminate(self) -> None:
        """Send SIGTERM, and kill it if it still runs after a while."""
        self._terminated = True
        if self.is_alive():
            self._process.terminate()
            self._killer = threading.Timer(_GRACE_S, self._process.kill)
            self._killer.daemon = True
            self._killer.start()

    def end(self) -> None:
        """Wait for it to end, and close its pipes."""
        self._process.wait()
        if self._killer is not None:
            self._killer.cancel()
        for stream in (self._process.stdin, self._process.stdout, self._stderr):
            try:
                if stream is not None:
                    stream.close()
            except OSError:  # unflushed data that nobody will read
                continue
