"""Batches in processes: the command, a Dask scheduler with two workers, and what workers load."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import psutil
from batches import TINY_COMMAND

import gauss2svg

_ROOT = os.fspath(Path(gauss2svg.__file__).parents[1])
# Loaded by every Python that finds it: photos are held between their SVG and their mark.
_HELD = """
import os, sys, time
from pathlib import Path
if "gauss2svg.pool" in sys.orig_argv or "spawn_main" in " ".join(sys.orig_argv):
    from gauss2svg.batch import many
    sys.modules.pop("gauss2svg.pool")  # which is run as a program next
    write, here = many.write, Path(__file__).parent
    def held(root, name, data):
        photo = Path(name).name.partition(".")[0]
        write(root, name, data)
        while photo >= (here / "first").read_text():
            (here / f"{photo}-{os.getpid()}").touch()
            time.sleep(0.01)
    many.write = held
"""


def started(*command: str, cwd: Path, **options) -> subprocess.Popen:
    """A Python in a session of its own, whose batches are held."""
    path = os.pathsep.join([str(cwd / "held"), _ROOT])
    return subprocess.Popen(
        [sys.executable, "-P", "-m", *command],
        cwd=cwd,
        env={**os.environ, "PYTHONPATH": path},
        start_new_session=True,
        **options,
    )


class Local:
    """Two processes of the command's own."""

    options = ("--workers", "2")

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "held").mkdir()
        (folder / "held/sitecustomize.py").write_text(_HELD)

    def hold(self, first: str) -> None:
        """Let workers wait with the photos from this name on."""
        (self.folder / "held/first").write_text(first)
        for path in (self.folder / "held").glob("*-*"):
            path.unlink(missing_ok=True)

    def wait_held(self, name: str, *commands: subprocess.Popen) -> None:
        """Wait until as many workers as commands wait with this photo."""
        held = partial((self.folder / "held").glob, f"{name}-*")
        wait_until(lambda: len(list(held())) >= len(commands), *commands)

    def batch(self, out: Path, *photos: Path, local: bool = False) -> subprocess.Popen:
        """The command, under way. If `local`, it has processes of its own in any case."""
        words = ["batch", *map(str, photos), "-o", str(out), *TINY_COMMAND]
        words += Local.options if local else self.options
        return started("gauss2svg", *words, cwd=self.folder, stderr=subprocess.PIPE, text=True)

    def workers(self, command: subprocess.Popen) -> list[int]:
        """Return the process ids of the workers."""
        children = psutil.Process(command.pid).children()
        return [c.pid for c in children if "gauss2svg.pool" in c.cmdline()]


class Cluster(Local):
    """A scheduler and two workers, whose nannies start them again."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self.start()

    def start(self) -> None:
        """Start the processes."""
        where = self.folder / "scheduler.json"
        where.unlink(missing_ok=True)
        local = ("--no-dashboard", "--scheduler-file", str(where))
        self.scheduler = self._start("scheduler", "--host", "127.0.0.1", "--port", "0", *local)
        worker = ("--nthreads", "1", "--nworkers", "2", *local)
        self._nannies = self._start("worker", *worker, "--local-directory", str(self.folder))
        wait_until(lambda: where.exists() and where.read_text().endswith("}"), self.scheduler)
        self.options = ("--scheduler", json.loads(where.read_text())["address"])

    def _start(self, kind: str, *options: str) -> subprocess.Popen:
        module = f"distributed.cli.dask_{kind}"
        return started(module, *options, cwd=self.folder, stderr=subprocess.DEVNULL)

    def close(self) -> None:
        """Kill all processes."""
        for process in (self._nannies, self.scheduler):
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def ended(process: subprocess.Popen) -> tuple[int, list[str]]:
    """Exit status and lines of standard error."""
    said = process.communicate(timeout=300)[1]
    return process.returncode, (said or "").splitlines()


def wait_until(condition: Callable[[], bool], *running: subprocess.Popen) -> None:
    """Wait until a condition holds, for at most four minutes, while these commands run."""
    for _ in range(24_000):
        if condition():
            return
        assert all(one.poll() is None for one in running), [ended(one) for one in running]
        time.sleep(0.01)
    raise AssertionError("waited in vain")
