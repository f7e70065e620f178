"""Batches in processes: the command, a Dask scheduler with two workers, and what workers load."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import psutil
from batches import TINY_COMMAND

import gauss2svg

_ROOT = os.fspath(Path(gauss2svg.__file__).parents[1])
# Loaded by every Python that finds it: photos take a while, so that there is a middle, and some
# kill who works on them.
_SLOW = """
import ctypes, sys, time
from pathlib import Path
if "gauss2svg.pool" in sys.orig_argv or "spawn_main" in " ".join(sys.orig_argv):
    from gauss2svg.batch import worker
    vectorize_by = worker.vectorize_by
    def slowly(options, image, **given):
        name = Path(image).stem
        if name.startswith("crash"):
            ctypes.string_at(0)
        time.sleep(0.2)
        return vectorize_by(options, image, **given)
    worker.vectorize_by = slowly
"""


def started(*command: str, cwd: Path, **options) -> subprocess.Popen:
    """A Python in a session of its own, whose batches are slow."""
    if not (cwd / "slow").exists():  # a worker that is started again may just read it
        (cwd / "slow").mkdir()
        (cwd / "slow/sitecustomize.py").write_text(_SLOW)
    path = os.pathsep.join([str(cwd / "slow"), _ROOT])
    return subprocess.Popen(
        [sys.executable, "-P", "-m", *command],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": path},
        start_new_session=True,
        **options,
    )


class Local:
    """Two processes of the command's own."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.options = folder, ("--workers", "2")

    def workers(self, command: subprocess.Popen) -> list[int]:
        """Return the process ids of the workers."""
        with suppress(psutil.NoSuchProcess):
            children = psutil.Process(command.pid).children()
            return [c.pid for c in children if "gauss2svg.pool" in c.cmdline()]
        return []


class Cluster:
    """A scheduler and two workers, whose nannies start them again."""

    def __init__(self, folder: Path) -> None:
        self.folder, where = folder, folder / "scheduler.json"
        local = ("--no-dashboard", "--scheduler-file", str(where))
        scheduler = ("--host", "127.0.0.1", "--port", "0", *local)
        self.scheduler = self._start("scheduler", *scheduler)
        worker = ("--nthreads", "1", "--nworkers", "2", *local)
        self._nannies = self._start("worker", *worker, "--local-directory", str(folder))
        while not where.exists():
            assert self.scheduler.poll() is None
            time.sleep(0.05)
        from distributed import Client

        with Client(scheduler_file=str(where), set_as_default=False) as client:
            client.wait_for_workers(2)
            self.options = ("--scheduler", client.scheduler.address)

    def _start(self, kind: str, *options: str) -> subprocess.Popen:
        module = f"distributed.cli.dask_{kind}"
        return started(module, *options, cwd=self.folder, stderr=subprocess.DEVNULL)

    def workers(self, _: subprocess.Popen) -> list[int]:
        """Return the process ids of the workers."""
        children = psutil.Process(self._nannies.pid).children()
        return [c.pid for c in children if "spawn_main" in " ".join(c.cmdline())]

    def close(self) -> None:
        """Kill all processes."""
        for process in (self._nannies, self.scheduler):
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def batch(photos: Path, out: Path, *options: object, cwd: Path) -> subprocess.Popen:
    """The command, under way."""
    command = ["gauss2svg", "batch", str(photos), "-o", str(out), *map(str, options)]
    return started(*command, *TINY_COMMAND, cwd=cwd, stderr=subprocess.PIPE, text=True)


def ended(process: subprocess.Popen) -> tuple[int, list[str]]:
    """Exit status and lines of standard error."""
    said = process.communicate(timeout=300)[1]
    return process.returncode, said.splitlines()


def wait_for(process: subprocess.Popen, out: Path, count: int) -> None:
    """Wait until so many SVGs are there."""
    for _ in range(12_000):
        if sum(1 for _ in out.rglob("*.svg")) >= count:
            return
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.02)
    raise AssertionError(f"{out} never had {count} SVGs")
