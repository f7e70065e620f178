"""Batches in processes: whatever dies, files are those of a quiet run."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest
from batches import TINY_COMMAND, marks, outputs, rows, save_photos, tiny
from conftest import has_ended

import gauss2svg
from gauss2svg.batch.many import TABLE
from gauss2svg.pipeline.vectorize import vectorize_by

pytestmark = pytest.mark.process
NAMES = [f"{number:02}.png" for number in range(12)]
ROOT = os.fspath(Path(gauss2svg.__file__).parents[1])
# Loaded by every Python that finds it: photos are held between their SVG and their mark.
HELD = """
import os, sys, time
from pathlib import Path
if "gauss2svg.pool" in sys.orig_argv:
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


class Batches:
    """Commands with two workers each, which wait where a test says."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "held"
        self.folder.mkdir()
        (self.folder / "sitecustomize.py").write_text(HELD)

    def hold(self, first: str) -> None:
        """Let workers wait with the photos from this name on."""
        (self.folder / "first").write_text(first)
        for path in self.folder.glob("*-*"):
            path.unlink(missing_ok=True)

    def wait_held(self, name: str, *commands: subprocess.Popen) -> None:
        """Wait until as many workers as commands wait with this photo."""
        for _ in range(24_000):
            if len(list(self.folder.glob(f"{name}-*"))) >= len(commands):
                return
            assert all(one.poll() is None for one in commands), [ended(one) for one in commands]
            time.sleep(0.01)
        raise AssertionError("waited in vain")

    def start(self, out: Path, photos: Path) -> subprocess.Popen:
        """Start the command."""
        words = ["batch", str(photos), "-o", str(out), *TINY_COMMAND, "--workers", "2"]
        return subprocess.Popen(
            [sys.executable, "-P", "-m", "gauss2svg", *words],
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(self.folder), ROOT])},
            start_new_session=True, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip


@pytest.fixture
def batches(tmp_path):
    return Batches(tmp_path)


def workers_of(command: subprocess.Popen) -> list[int]:
    """Return the process ids of the workers."""
    children = psutil.Process(command.pid).children()
    return [child.pid for child in children if "gauss2svg.pool" in child.cmdline()]


def ended(command: subprocess.Popen) -> tuple[int, list[str]]:
    """Exit status and lines of standard error."""
    said = command.communicate(timeout=300)[1]
    return command.returncode, said.splitlines()


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    return save_photos(tmp_path_factory.mktemp("batch") / "photos", NAMES)


@pytest.fixture(scope="module")
def quiet(photos):
    """The outputs of a run without a fault."""
    return {
        f"{path.stem}.svg": vectorize_by(tiny(), path).svg.encode() for path in photos.iterdir()
    }


def check_whole(out, quiet):
    """What is there is whole, and a photo that is marked has its SVG."""
    assert outputs(out).items() <= quiet.items()
    assert marks(out).keys() <= outputs(out).keys()


def errors_in(out):
    """The codes of errors in the table, "" of those that are done, by outputs."""
    return {name: row["error_code"] for name, row in rows(out).items()}


def test_interrupted_and_killed_and_run_again_is_run_once(batches, photos, quiet, tmp_path):
    """The command by a signal, then at once, then a worker."""
    out = tmp_path / "out"
    batches.hold("06")
    command = batches.start(out, photos)
    batches.wait_held("06", command)
    os.killpg(command.pid, signal.SIGINT)  # as at a terminal, which sends it to all processes
    status, (see, interrupted) = ended(command)
    assert status == 128 + signal.SIGINT
    assert see.startswith(f"gauss2svg: see {out / TABLE}")
    done = sum(not code for code in errors_in(out).values())
    begins = f"gauss2svg: interrupted; {done} of {len(NAMES)} photos are done, and the same command"
    assert interrupted.startswith(begins)
    assert 0 < len(errors_in(out)) <= len(outputs(out)) < len(NAMES)
    check_whole(out, quiet)
    batches.hold("08")
    command = batches.start(out, photos)
    batches.wait_held("08", command)
    workers = workers_of(command)
    command.kill()
    batches.hold("none")  # workers end once they have their photo
    assert ended(command)[0] == -signal.SIGKILL
    assert all(map(has_ended, workers))
    check_whole(out, quiet)
    batches.hold("10")
    command = batches.start(out, photos)
    batches.wait_held("10", command)
    os.kill(workers_of(command)[0], signal.SIGKILL)
    batches.hold("none")
    assert ended(command)[0] == 1
    assert sorted(errors_in(out).values()) == [*[""] * (len(quiet) - 1), "WorkerDied"]
    assert ended(batches.start(out, photos))[0] == 0
    assert outputs(out) == quiet
    assert errors_in(out) == dict.fromkeys(quiet, "")


def test_two_runs_at_once_lose_nothing(batches, photos, quiet, tmp_path):
    out = tmp_path / "out"
    batches.hold("04")
    runs = [batches.start(out, photos) for _ in range(2)]
    batches.wait_held("04", *runs)  # both have begun
    batches.hold("none")
    assert [ended(run)[0] for run in runs] == [0, 0]
    assert outputs(out) == quiet
    assert marks(out).keys() == quiet.keys()
