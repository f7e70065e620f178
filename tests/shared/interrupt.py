"""Laws of interrupted processes: `python tests/shared/interrupt.py`; short in test_interrupt.py.

A command on a small photo gets SIGINT or SIGTERM at a random moment, from its first import to its
end or just when it writes, with kernels compiled before or not. It ends with the status of the
signal, or with 0 where it had finished, and one line at most besides the note that it writes the
best so far. Every output is the old file or a whole new one, and nothing is left beside them.
Linux only: /proc tells when the signals are handled.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from functools import cache
from pathlib import Path
from random import Random
from typing import Any
from xml.etree import ElementTree

from PIL import Image
from skimage import data

import gauss2svg
from gauss2svg.cli.signals import _ENDING
from gauss2svg.scene import Scene

OLD = "<!-- written by gauss2svg -->"
LONGEST_S = 300.0  # of a command
_PACKAGES = os.fspath(Path(gauss2svg.__file__).parents[1])
_COMMAND = ["photo.png", "--quiet", "--gaussians", "40", "--iterations", "150"]
AFTER_FIT = (
    [],
    ["--renderer", "cairo"],
    ["--preview", "preview.png"],
    ["--report", "report.json"],
    ["--outline", "outline.svg", "-o", "out.svg"],
    ["--save-scene", "scene.npz", "--animate", "2"],
    ["--preview", "preview.png", "--report", "report.json", "--outline", "outline.svg"],
)


class Run:
    """A command in a folder of its own."""

    def __init__(self, options: list[str], kernels: Path) -> None:
        self.folder, self.temporary = Path(tempfile.mkdtemp()), Path(tempfile.mkdtemp())
        self.output = "out.svg" if "-o" in options else "photo.svg"
        self.names = {"photo.png", self.output}
        self.names |= {name for name in options if "." in name}
        Image.fromarray(data.coffee()[::8, ::8]).save(self.folder / "photo.png")
        (self.folder / self.output).write_text(OLD)
        self.signalled_before_output = False
        environment = {"NUMBA_CACHE_DIR": str(kernels), "TMPDIR": str(self.temporary)}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "gauss2svg", *_COMMAND, *options],
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": _PACKAGES, **environment},
            stderr=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            # As at a terminal, also where this is in the background of a shell, which ignores it.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )

    def __enter__(self) -> Run:
        """Wait until signals are handled."""
        while self.process.poll() is None and not self._handles(signal.SIGTERM):
            time.sleep(0.001)
        return self

    def _handles(self, number: int) -> bool:
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        caught = status.partition("SigCgt:")[2].split()
        return bool(caught) and bool(int(caught[0], 16) >> (number - 1) & 1)

    def wait_for_writing(self) -> None:
        """Wait until a file is begun beside the output, or all has ended."""
        while self.process.poll() is None:
            if any(name.startswith(".") for name in os.listdir(self.folder)):
                return

    def interrupt(self, number: int) -> None:
        """Send the signal."""
        self.process.send_signal(number)
        self.signalled_before_output = (self.folder / self.output).read_text() == OLD

    def ended(self) -> tuple[int, list[str]]:
        """Exit status, and lines on standard error besides the note."""
        said = self.process.communicate(timeout=LONGEST_S)[1]
        return self.process.returncode, said.replace(_ENDING, b"").decode().splitlines()

    def check(self, number: int | None) -> str:
        """What became of it; AssertionError for a broken law."""
        status, lines = self.ended()
        assert status in (0, None if number is None else 128 + number), f"status {status}: {lines}"
        assert status or not self.signalled_before_output, "the signal was ignored"
        assert len(lines) <= (status != 0), f"status {status}, lines {lines}"
        left = {os.fspath(p.relative_to(self.folder)) for p in self.folder.rglob("*")}
        assert left <= self.names, f"left beside: {sorted(left - self.names)}"
        assert not list(self.temporary.iterdir()), "temporary files are left"
        new = {name for name in left - {"photo.png"} if self._is_new(self.folder / name)}
        if status == 0 or "The best picture so far is in" in lines[0]:
            assert new == self.names - {"photo.png"}, f"not written: {sorted(self.names - new)}"
            return "finished" if status == 0 else "best so far"
        assert "every file is whole or untouched" in lines[0], lines
        return "quit, files written" if self.output in new else "quit"

    def _is_new(self, path: Path) -> bool:
        """Whether a file is a new one, which is read as a whole; False for the old one."""
        if path.suffix == ".svg":
            if path.read_text() == OLD:
                return False
            ElementTree.parse(path)
        elif path.suffix == ".png":
            Image.open(path).load()
        elif path.suffix == ".npz":
            Scene.load(path)
        else:
            json.loads(path.read_text())
        return True

    def __exit__(self, *_: Any) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        shutil.rmtree(self.folder)
        shutil.rmtree(self.temporary)


@cache
def duration(index: int, kernels: Path | None) -> float:
    """Seconds that a command takes with these kernels, or without any."""
    shortest = math.inf
    for _ in range(2):  # the first one fills the folder, as far as this is needed
        with (
            tempfile.TemporaryDirectory() as cold,
            Run(AFTER_FIT[index], Path(cold) if kernels is None else kernels) as run,
        ):
            began = time.monotonic()
            assert run.check(None) == "finished"
            shortest = min(shortest, time.monotonic() - began)
    return shortest


def interrupted(seed: int, number: int, kernels: Path) -> tuple[str, str]:
    """Outcome of an interruption, beginning with FINDING for a broken law, and what it was.

    kernels  a folder of compiled kernels
    """
    rng = Random(f"interrupt {seed} {number}")
    index, which = rng.randrange(len(AFTER_FIT)), rng.choice([signal.SIGINT, signal.SIGTERM])
    is_cold, is_writing = rng.random() < 0.2, rng.random() < 0.3
    # Cold commands differ in the kernels alone, so that one stands for all.
    usual = duration(0, None) if is_cold else duration(index, kernels)
    after = rng.random() * (0.01 if is_writing else usual)
    with (
        tempfile.TemporaryDirectory() as cold,
        Run(AFTER_FIT[index], Path(cold) if is_cold else kernels) as run,
    ):
        if is_writing:
            run.wait_for_writing()
        time.sleep(after)
        run.interrupt(which)
        said = f"{which.name} after {after:.3f} s of {'writing' if is_writing else f'{usual:.1f}'}"
        said += f", {'cold' if is_cold else 'warm'}, {' '.join(AFTER_FIT[index]) or 'plain'}"
        try:
            outcome = run.check(which)
        except (AssertionError, subprocess.TimeoutExpired, ValueError, OSError) as error:
            outcome = f"FINDING {type(error).__name__}: {error}"
    return outcome, said


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    kinds: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as kernels:
        for number in range(given.first, given.first + given.count):
            outcome, said = interrupted(given.seed, number, Path(kernels))
            kinds[outcome] += 1
            print(f"{number:4d}  {outcome}  ({said})", flush=True)
    for outcome, count in kinds.most_common():
        print(f"{count:7d}  {outcome}")
    return 1 if any(outcome.startswith("FINDING") for outcome in kinds) else 0


if __name__ == "__main__":
    sys.exit(main())
