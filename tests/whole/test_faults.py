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
from galleries import BLANK
from PIL import Image

from gauss2svg.cli.main import main
from gauss2svg.pipeline.outcome import best_of

pytestmark = pytest.mark.process

OUTPUTS = ("o.svg", "r.json", "p.png", "s.npz", "h.png", "l.svg")
CALLS = {"open", "os.rename", "os.chmod", "os.remove", "tempfile.mkstemp"}
COMMANDS = [
    "photo.png -o o.svg --report r.json --preview p.png --save-scene s.npz --outline l.svg "
    "--gaussians 3 --iterations 2 --quiet",
    "check photo.png drawing.svg --report r.json --preview p.png --heatmap h.png --quiet",
]


class Faults:
    """A hook of Python's audit events that counts calls and raises an exception at one of them."""

    def __init__(self):
        self.folder, self.calls, self.at, self.fault = None, [], None, None
        sys.addaudithook(self._hear)  # for ever

    def run(self, folder, command, at=None, fault=None):
        """The status of a command in a folder, and how many calls it came to."""
        self.folder, self.calls, self.at, self.fault = str(folder), [], at, fault
        os.chdir(folder)
        status, self.folder = main(command.split()), None
        return status, len(self.calls)

    def _hear(self, call, arguments):
        if self.folder is None or call not in CALLS or isinstance(arguments[0], int):
            return
        if os.path.abspath(os.fsdecode(arguments[0])).startswith(self.folder):
            self.calls.append(call)
            if len(self.calls) - 1 == self.at:
                raise self.fault


@pytest.fixture(scope="module")
def faults():
    return Faults()


def made(folder, old):
    """A folder with a photo, an SVG and old outputs, every other of which there is already."""
    folder.mkdir()
    pixels = np.random.default_rng(3).integers(0, 255, (16, 16, 3), np.uint8)
    Image.fromarray(pixels).save(folder / "photo.png")
    (folder / "drawing.svg").write_text(BLANK)
    for name in OUTPUTS[old::2]:
        (folder / name).write_bytes(b"old " + name.encode())
        (folder / name).chmod(0o640)
    return folder


def content(folder):
    """The files of a folder; of a report, which has seconds, only whether it is whole."""
    found = {path.name: path.read_bytes() for path in folder.iterdir()}
    whole = [name for name, data in found.items() if data[:1] == b"{" and data[-2:] == b"}\n"]
    return found | dict.fromkeys(whole, b"a report")


@pytest.fixture
def one_search(monkeypatch, unscored, tmp_path):
    """All runs have what the first has found and drawn."""
    monkeypatch.chdir(tmp_path)
    found = []
    monkeypatch.setattr(os, "fsync", lambda _: None)  # slow, and no fault is put there

    def once(*given):
        found.append(found[0] if found else best_of(*given))
        return found[-1]

    monkeypatch.setattr("gauss2svg.pipeline.vectorize.best_of", once)
    pixels = np.ones((16, 16, 3), np.float32)
    monkeypatch.setattr("gauss2svg.measure.check.draw", lambda *_: (pixels, []))


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("fault", [OSError(errno.EIO, "broken"), KeyboardInterrupt()], ids=repr)
def test_each_file_is_the_old_one_or_the_whole_new_one(
    command, fault, faults, tmp_path, capsys, one_search
):
    folders = [made(tmp_path / f"whole{old}", old) for old in (0, 1)]
    ran = [faults.run(folder, command) for folder in folders]  # without faults
    wholes, calls = [content(folder) for folder in folders], max(count for _, count in ran)
    assert ({status for status, _ in ran}, calls > 15) == ({0}, True)
    capsys.readouterr()
    for place in range(calls):
        whole, folder = wholes[place % 2], made(tmp_path / f"at{place}", place % 2)
        before = content(folder)
        status, count = faults.run(folder, command, place, fault)
        err, after = capsys.readouterr().err, content(folder)
        at = f"call {place}: {faults.calls[place:]}, {err}"
        if status == 0:  # no call, or one that has a way round, or that only cleans up
            assert (after, err) == (whole, ""), at
            continue
        assert count > place
        assert status == (130 if isinstance(fault, KeyboardInterrupt) else 2), at
        assert err.count("\n") == 1, at
        assert set(before) <= set(after), at
        for file, data in after.items():
            assert data in (before.get(file), whole.get(file)), at
