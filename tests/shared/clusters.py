"""A real cluster on this machine: `dask scheduler` and `dask worker` processes, and a driver."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path

import psutil
from batches import TINY_COMMAND
from distributed import Client

import gauss2svg
from gauss2svg.cli.main import main

NOBODY = "tcp://127.0.0.1:9"  # a scheduler that does not answer
_ROOT = os.fspath(Path(gauss2svg.__file__).parents[1])
# Loaded by workers: photos take a while, so that there is a middle, and some kill them.
_PRELOAD = """
import ctypes, time
from pathlib import Path
from gauss2svg.batch import worker
vectorize_by = __import__("gauss2svg.pipeline.vectorize").pipeline.vectorize.vectorize_by
def slowly(options, image, **given):
    name = Path(image).stem
    if name.startswith("greedy"):
        held = []
        while True:
            held.append(b"x" * (1 << 25)); time.sleep(0.01)
    if name.startswith("crash"):
        ctypes.string_at(0)
    time.sleep(0.2)
    return vectorize_by(options, image, **given)
worker.vectorize_by = slowly
"""


def preload(folder: Path) -> str:
    """The path of that module."""
    path = folder / "preload.py"
    path.write_text(_PRELOAD)
    return str(path)


def environment(**variables: str) -> dict[str, str]:
    """Of processes that use this package, also where another is installed."""
    return {**os.environ, "PYTHONPATH": _ROOT, "DASK_LOGGING__DISTRIBUTED": "error", **variables}


def started(*command: str, cwd: Path, variables: dict[str, str], **options) -> subprocess.Popen:
    """A process in a session of its own."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", *command],
        cwd=cwd,
        env=environment(**variables),
        start_new_session=True,
        **options,
    )


class Cluster:
    """A scheduler and two workers, whose nannies start them again."""

    def __init__(self, folder: Path, memory: str = "600MB") -> None:
        self._folder = folder
        self._processes = []
        self._file = folder / "scheduler.json"
        self.scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
            "--scheduler-file", str(self._file),
        )  # fmt: skip
        self._nannies = self._start(
            "worker", "--scheduler-file", str(self._file), "--nthreads", "1", "--nworkers", "2",
            "--no-dashboard", "--memory-limit", memory, "--preload", preload(folder),
            "--local-directory", str(folder),
        )  # fmt: skip
        while not self._file.exists():
            assert self.scheduler.poll() is None
            time.sleep(0.05)
        with Client(scheduler_file=str(self._file), set_as_default=False) as client:
            client.wait_for_workers(2)
            self.address = client.scheduler.address

    def _start(self, kind: str, *options: str) -> subprocess.Popen:
        module = f"distributed.cli.dask_{kind}"
        process = started(
            module, *options, cwd=self._folder, variables={}, stderr=subprocess.DEVNULL
        )
        self._processes.append(process)
        return process

    def workers(self) -> list[int]:
        """Process ids of the workers themselves, which their nannies have started."""
        children = psutil.Process(self._nannies.pid).children()
        return [c.pid for c in children if "spawn_main" in " ".join(c.cmdline())]

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        for process in reversed(self._processes):
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def batch(*arguments: object, cwd: Path, **variables: str) -> subprocess.Popen:
    """The command, under way, with variables of its environment."""
    command = ["gauss2svg", "batch", *map(str, arguments), *TINY_COMMAND]
    return started(*command, cwd=cwd, variables=variables, stderr=subprocess.PIPE, text=True)


def batch_here(*arguments: object) -> int:
    """The exit status of the command, run in this process, which has all its modules."""
    return main(["batch", *map(str, arguments), *TINY_COMMAND])


@contextmanager
def under_way(*arguments: object) -> Iterator[Future[int]]:
    """The same in a thread."""
    with ThreadPoolExecutor(1) as thread:
        yield thread.submit(batch_here, *arguments)


def wait_for(has_ended: Callable[[], object], out: Path, count: int) -> None:
    """Wait until so many outputs are there."""
    for _ in range(12_000):
        if sum(1 for _ in out.rglob("*.svg")) >= count:
            return
        assert not has_ended()
        time.sleep(0.02)
    raise AssertionError(f"{out} never had {count} SVGs")


def ended(process: subprocess.Popen, within_s: float = 600.0) -> tuple[int, list[str]]:
    """Exit status and lines of standard error."""
    said = process.communicate(timeout=within_s)[1]
    return process.returncode, said.splitlines()
