"""When a call to the file system fails, every file is the old one or the complete new one.

Each call that opens, renames, changes or removes one of the run's own files is a place where a
fault is put, one after the other: an error of the device or a Ctrl-C. What is fitted,
rasterised and measured between reading and writing is the same in all runs, and so done once.
"""

import errno
import os
import sys

import numpy as np
import pytest
from odd_options import SVG
from PIL import Image

from gauss2svg.cli.main import main
from gauss2svg.pipeline.outcome import best_of

pytestmark = pytest.mark.process

OUTPUTS = ("o.svg", "r.json", "p.png", "s.npz", "l.svg")
CALLS = {"open", "os.rename", "os.chmod", "os.remove", "tempfile.mkstemp"}


class Faults:
    """A hook of Python's audit events that counts calls and raises an exception at one of them."""

    def __init__(self):
        self.folder, self.calls, self.at, self.fault = None, [], None, None
        sys.addaudithook(self._hear)  # for ever

    def begin(self, folder, at=None, fault=None):
        self.folder, self.calls, self.at, self.fault = str(folder), [], at, fault

    def _hear(self, call, arguments):
        if self.folder is None or call not in CALLS or isinstance(arguments[0], int):
            return
        if os.fsdecode(arguments[0]).startswith(self.folder):
            self.calls.append(call)
            if len(self.calls) - 1 == self.at:
                raise self.fault


@pytest.fixture(scope="module")
def faults():
    one = Faults()
    yield one
    one.folder = None


COMMANDS = [
    "photo.png -o o.svg --report r.json --preview p.png --save-scene s.npz --outline l.svg "
    "--gaussians 3 --iterations 2 --quiet",
    "check photo.png drawing.svg --report r.json --preview p.png --heatmap s.npz --quiet",
]


def words_in(folder, command):
    return [str(folder / word) if "." in word else word for word in command.split()]


def made(folder, old):
    """A folder with a photo, an SVG and old outputs, every other of which there is already."""
    folder.mkdir(parents=True)
    pixels = np.random.default_rng(3).integers(0, 255, (16, 16, 3), np.uint8)
    Image.fromarray(pixels).save(folder / "photo.png")
    (folder / "drawing.svg").write_text(SVG)
    for name in OUTPUTS[old::2]:
        (folder / name).write_bytes(b"old " + name.encode())
        (folder / name).chmod(0o640)
    return folder


def content(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def same(name, data, other):
    """Whether two files are equal but for seconds and versions of a report."""
    if name.endswith(".json"):
        return data.startswith(b"{") and data.endswith(b"}\n") and other.startswith(b"{")
    return data == other


@pytest.fixture
def one_search(monkeypatch, unscored):
    """All runs have what the first has found and drawn."""
    found = []

    def once(outcomes, plan):
        found.append(found[0] if found else best_of(outcomes, plan))
        return found[-1]

    monkeypatch.setattr("gauss2svg.pipeline.vectorize.best_of", once)
    pixels = np.ones((16, 16, 3), np.float32)
    monkeypatch.setattr("gauss2svg.measure.check.draw", lambda *_: pixels)


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("fault", [errno.EIO, KeyboardInterrupt()], ids=repr)
def test_each_file_is_the_old_one_or_the_whole_new_one(
    command, fault, faults, tmp_path, capsys, one_search
):
    if isinstance(fault, int):
        fault = OSError(fault, os.strerror(fault))
    wholes, counts = [], []
    for old in (0, 1):  # without faults, to count the calls and to see what is made
        folder = made(tmp_path / f"whole{old}", old)
        faults.begin(folder)
        assert main(words_in(folder, command)) == 0
        counts.append(len(faults.calls))
        faults.folder = None
        wholes.append(content(folder))
    assert min(counts) > 15
    capsys.readouterr()
    for place in range(max(counts)):
        old = place % 2
        folder = made(tmp_path / f"at{place}", old)
        before = content(folder)
        faults.begin(folder, place, fault)
        status = main(words_in(folder, command))
        faults.folder = None
        if len(faults.calls) <= place:
            assert status == 0
            continue
        at = f"{faults.calls[place]}, call {place}"
        err, after = capsys.readouterr().err, content(folder)
        assert set(before) <= set(after) <= set(before) | set(wholes[old]), at
        for file, data in after.items():
            assert data == before.get(file) or same(file, data, wholes[old][file]), at
        if status == 0:  # after a call that has a way round, or that only cleans up
            new = {file for file, data in after.items() if same(file, data, wholes[old][file])}
            assert new == set(wholes[old]), at
        else:
            assert status == (130 if isinstance(fault, KeyboardInterrupt) else 2), at
        assert err.count("\n") == (0 if status == 0 else 1), (at, err)
