"""A real cluster on this machine: `dask scheduler` and `dask worker` processes, and a driver."""

from __future__ import annotations

import json
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
# Loaded by workers: photos take a while, so that there is a middle, and some kill them.
_PRELOAD = """
import ctypes, os, time
from pathlib import Path
from gauss2svg.batch import work
vectorize_by = __import__("gauss2svg.pipeline.vectorize").pipeline.vectorize.vectorize_by
def slowly(options, image, **given):
    name = Path(image).stem
    if name.startswith("greedy"):
        held = []
        while True:
            held.append(bytearray(os.urandom(1 << 20) * 32)); time.sleep(0.01)
    if name.startswith("crash"):
        ctypes.string_at(0)
    time.sleep({pause})
    return vectorize_by(options, image, **given)
work.vectorize_by = slowly
"""


def environment() -> dict[str, str]:
    """Of processes that use this package, also where another is installed."""
    return {**os.environ, "PYTHONPATH": _ROOT, "DASK_LOGGING__DISTRIBUTED": "error"}


def started(*command: str, cwd: Path, **options) -> subprocess.Popen:
    """A process in a session of its own, in which Ctrl-C is not ignored."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", *command],
        cwd=cwd,
        env=environment(),
        start_new_session=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        **options,
    )


class Cluster:
    """A scheduler and two workers, each with a nanny that starts it again."""

    def __init__(self, folder: Path, pause: float = 0.15, memory: str = "900MB") -> None:
        self._folder = folder
        self._processes = []
        (folder / "preload.py").write_text(_PRELOAD.replace("{pause}", str(pause)))
        self._file = folder / "scheduler.json"
        self.scheduler = self._start(
            "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
            "--scheduler-file", str(self._file),
        )  # fmt: skip
        for _ in range(2):
            self._start(
                "worker", "--scheduler-file", str(self._file), "--nthreads", "1", "--no-dashboard",
                "--memory-limit", memory, "--preload", str(folder / "preload.py"),
                "--local-directory", str(folder),
            )  # fmt: skip
        for _ in range(6000):
            with suppress(OSError, ValueError, KeyError):
                self.address = json.loads(self._file.read_text())["address"]
                break
            time.sleep(0.1)

    def _start(self, kind: str, *options: str) -> subprocess.Popen:
        module = f"distributed.cli.dask_{kind}"
        process = started(module, *options, cwd=self._folder, stderr=subprocess.DEVNULL)
        self._processes.append(process)
        return process

    def workers(self) -> list[int]:
        """Process ids of the workers themselves, which their nannies have started."""
        found = []
        for nanny in self._processes[1:]:
            with suppress(psutil.NoSuchProcess):
                children = psutil.Process(nanny.pid).children()
                found += [c.pid for c in children if "spawn_main" in " ".join(c.cmdline())]
        return found

    def __enter__(self) -> Cluster:
        return self

    def __exit__(self, *_: object) -> None:
        for process in reversed(self._processes):
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def batch(*arguments: object, cwd: Path, tiny: bool = True) -> subprocess.Popen:
    """The command, under way."""
    command = ["gauss2svg", "batch", *map(str, arguments), *(TINY_COMMAND if tiny else ())]
    return started(*command, cwd=cwd, stderr=subprocess.PIPE, text=True)


def wait_for(process: subprocess.Popen, out: Path, count: int) -> None:
    """Wait until so many outputs are there."""
    for _ in range(12_000):
        if sum(1 for _ in out.rglob("*.svg")) >= count:
            return
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.05)
    raise AssertionError(f"{out} never had {count} SVGs")


def ended(process: subprocess.Popen, within_s: float = 600.0) -> tuple[int, list[str]]:
    """Exit status and lines of standard error."""
    said = process.communicate(timeout=within_s)[1]
    return process.returncode, said.splitlines()
