"""The long form of test_fuzz.py: `python tests/shared/fuzz.py --inputs 200000 --jobs 2 loader`.

Inputs follow from a seed and their number, so that each can be reproduced. A worker process reads
them one after the other, with 1 GB more memory than it takes to read every whole image or SVG
once, and 5 s of CPU time (60 s of wall time) per input, after which a signal ends it. An input that
does so, or raises anything but a refusal, is a finding: its bytes are stored, and the run
continues. Python warnings are findings as well, except those of Pillow, which are counted apart.
"""

from __future__ import annotations

import argparse
import json
import mmap
import signal
import subprocess
import sys
import traceback
from collections import Counter
from pathlib import Path
from random import Random

SPARE_BYTES = 1 << 30
CPU_S, WALL_S = 5, 60
_BLOCK = 10_000  # inputs of one worker process
_NOT_BEGUN = b"\xff" * 8
_KEPT = 3  # inputs of one kind of finding that are stored


def made(target: str, seed: int, number: int) -> bytes:
    """The input of that number."""
    from fuzzing import TARGETS

    return TARGETS[target][0](Random(f"{target} {seed} {number}"))


def work(target: str, seed: int, first: int, last: int, place: str) -> None:
    """Read inputs first..last - 1; the number of each is in the file `place` before it is read."""
    import resource  # which Windows has not

    from fuzzing import message_class, outcome, picture_seeds
    from svg_fuzzing import svg_seeds

    for whole in picture_seeds() if target == "loader" else svg_seeds():
        if target != "read":
            outcome(target, whole)
    limit = _size() + SPARE_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    with open(place, "r+b") as file, mmap.mmap(file.fileno(), 8) as at:
        for number in range(first, last):
            at[:] = number.to_bytes(8, "little")
            data = made(target, seed, number)
            signal.setitimer(signal.ITIMER_PROF, CPU_S)
            signal.setitimer(signal.ITIMER_REAL, WALL_S)
            findings, of_pillow = [], []
            try:
                said, warned, of_pillow = outcome(target, data)
                findings = [f"warning {message_class(w)}" for w in warned]
                kind = "accepted" if said == "accepted" else message_class(said)
            except BaseException as error:
                frames = traceback.extract_tb(error.__traceback__)
                ours = [f for f in frames if "gauss2svg" in f.filename] or frames
                where = f"{Path(ours[-1].filename).name}:{ours[-1].lineno}"
                kind = f"{type(error).__name__} at {where}: {message_class(str(error))}"
                findings = [kind]
            signal.setitimer(signal.ITIMER_PROF, 0)
            signal.setitimer(signal.ITIMER_REAL, 0)
            of_pillow = [message_class(w) for w in of_pillow]
            print(json.dumps([number, kind, findings, of_pillow]), flush=True)


def _size() -> int:
    """Bytes of this process's address space."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmSize:"):
            return int(line.split()[1]) * 1024
    raise SystemExit("fuzz.py needs /proc/self/status")


class Tally:
    """What became of the inputs, and the bytes of findings in a folder."""

    def __init__(self, target: str, seed: int, folder: Path) -> None:
        self.kinds: Counter[str] = Counter()
        self.findings: Counter[str] = Counter()
        self.warned: Counter[str] = Counter()  # by Pillow
        self.inputs = 0
        self._target, self._seed, self._folder = target, seed, folder

    def add(self, number: int, kind: str, findings: list[str], warned: list[str]) -> None:
        self.inputs += 1
        self.kinds[kind] += 1
        self.warned.update(warned)
        for finding in findings:
            self.findings[finding] += 1
            if self.findings[finding] <= _KEPT:
                name = "".join(c if c.isalnum() else "_" for c in finding)[:80]
                self._folder.mkdir(parents=True, exist_ok=True)
                path = self._folder / f"{self._target}-{name}-{self._seed}-{number}"
                path.write_bytes(made(self._target, self._seed, number))

    def __str__(self) -> str:
        refused = self.inputs - self.kinds["accepted"]
        lines = [
            f"{self._target}, seed {self._seed}: {self.inputs} inputs, "
            f"{self.kinds['accepted']} accepted, {refused} refused or found, "
            f"{sum(self.findings.values())} findings of {len(self.findings)} kinds, "
            f"{sum(self.warned.values())} warnings of Pillow's"
        ]
        lines += [f"{count:8d}  {kind}" for kind, count in self.kinds.most_common(40)]
        lines += [f"warned {count:7d}  {kind}" for kind, count in self.warned.most_common()]
        lines += [f"FINDING {count:6d}  {kind}" for kind, count in self.findings.most_common()]
        return "\n".join(lines)


def run(target: str, seed: int, inputs: int, jobs: int, start: int, folder: Path) -> Tally:
    """Share the inputs among so many workers at a time, in blocks."""
    tally, pending, running = Tally(target, seed, folder), [], []
    pending = [(b, min(b + _BLOCK, start + inputs)) for b in range(start, start + inputs, _BLOCK)]
    folder.mkdir(parents=True, exist_ok=True)
    pending.reverse()
    while pending or running:
        while pending and len(running) < jobs:
            first, last = pending.pop()
            place = folder / f".at-{target}-{seed}-{first}"
            place.write_bytes(_NOT_BEGUN)
            words = [target, str(seed), str(first), str(last), str(place)]
            said = (folder / f".said-{target}-{seed}-{first}").open("w+")
            process = subprocess.Popen(
                [sys.executable, __file__, "--work", *words], stdout=said, stderr=subprocess.DEVNULL
            )
            running.append((process, place, said, first, last))
        process, place, said, first, last = running.pop(0)
        status = process.wait()
        said.seek(0)
        done = [json.loads(line) for line in said if line.endswith("\n")]
        said.close()
        for row in done:
            tally.add(*row)
        if first + len(done) < last:  # ended by a signal, or by an exit
            if place.read_bytes() == _NOT_BEGUN:
                raise SystemExit(f"a worker ended with status {status} before its first input")
            at = int.from_bytes(place.read_bytes(), "little")
            how = signal.Signals(-status).name if status < 0 else f"exit {status}"
            if at == first + len(done):
                tally.add(at, f"ended by {how}", [f"ended by {how}"], [])
                at += 1
            if at < last:
                pending.append((at, last))
        place.unlink()
        Path(said.name).unlink()
    return tally


def main() -> int:
    sys.path.append(str(Path(__file__).parents[1]))  # of conftest.py, which makes scenes
    if sys.argv[1:2] == ["--work"]:
        target, seed, first, last, place = sys.argv[2:]
        work(target, int(seed), int(first), int(last), place)
        return 0
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("targets", nargs="+", choices=["loader", "svg", "read"])
    parser.add_argument("--inputs", type=int, default=200_000, help="of each target")
    parser.add_argument("--start", type=int, default=0, help="number of the first")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--folder", type=Path, default=Path("findings"))
    given = parser.parse_args()
    found = 0
    for target in given.targets:
        tally = run(target, given.seed, given.inputs, given.jobs, given.start, given.folder)
        print(tally, flush=True)
        found += len(tally.findings)
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
