"""Laws of a run in which one call fails: every file is the old one or the complete new one.

Every read and write of the run's own files is a place where a fault is put, one after the other:
an error of the device, a full disk, or a Ctrl-C just before or just after it. What is fitted,
rasterised and measured between reading and writing is the same in all runs, and so done once.
"""

import builtins
import errno
import io
import os
import tempfile

import numpy as np
import pytest
from PIL import Image

from gauss2svg import files
from gauss2svg.cli.main import main
from gauss2svg.pipeline.search.outcome import best_of

pytestmark = pytest.mark.process

OUTPUTS = ("o.svg", "r.json", "p.png", "s.npz", "l.svg")
FAULTS = {
    "EIO": OSError(errno.EIO, os.strerror(errno.EIO)),
    "ENOSPC": OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)),
    "interrupt before": KeyboardInterrupt(),
    "interrupt after": KeyboardInterrupt(),
}


class Faults:
    """Counts the calls that concern a folder, and lets the one of a number fail."""

    def __init__(self, monkeypatch, folder):
        self.calls, self.at, self.fault, self.after = [], None, None, False
        self._folder, self._own, self._inside = str(folder), set(), False
        for name in ("open", "write", "fsync", "close", "replace", "rename", "chmod", "unlink"):
            monkeypatch.setattr(os, name, self._faulty(f"os.{name}", getattr(os, name)))
        for name in ("TemporaryFile", "NamedTemporaryFile"):
            monkeypatch.setattr(tempfile, name, self._faulty(name, getattr(tempfile, name)))
        for module in (builtins, io):
            monkeypatch.setattr(module, "open", self._faulty("open", self._opened(io.open)))

    def _faulty(self, name, call):
        def faulty(*args, **options):
            if self._inside or not self._concerns(args, options):
                return call(*args, **options)
            hit = len(self.calls) == self.at
            self.calls.append(name)
            if hit and not self.after:
                raise self.fault
            self._inside = name.endswith("TemporaryFile")  # it has ways round a fault of its own
            try:
                result = call(*args, **options)
            finally:
                self._inside = False
            if name == "os.open":
                self._own.add(result)
            elif name == "os.close":
                self._own.discard(args[0])
            if hit:
                if name in ("TemporaryFile", "NamedTemporaryFile", "open"):
                    result.close()
                elif name == "os.open":
                    os.close(result)
                raise self.fault
            return result

        return faulty

    def _opened(self, real):
        """Files of the folder whose reads are places as well."""

        def opened(*args, **options):
            file = real(*args, **options)
            if not self._concerns(args, options) or "b" not in file.mode:
                return file
            return io.BufferedReader(_Reads(self, file)) if "r" in file.mode else file

        return opened

    def _concerns(self, args, options):
        first = args[0] if args else options.get("dir")
        if isinstance(first, int):
            return first in self._own
        try:
            return os.fspath(first).startswith(self._folder)
        except TypeError:
            return False


class _Reads(io.RawIOBase):
    def __init__(self, faults, file):
        self._faults, self._file = faults, file
        raw = getattr(file, "raw", file)
        self._readinto = faults._faulty("read", lambda _, buffer: raw.readinto(buffer))

    def readable(self):
        return True

    def seekable(self):
        return True

    def seek(self, *args):
        return self._file.seek(*args)

    def tell(self):
        return self._file.tell()

    def readinto(self, buffer):
        return self._readinto(self._faults._folder, buffer)

    def close(self):
        self._file.close()
        super().close()


def fitting(folder):
    words = [str(folder / "photo.png"), "-o", str(folder / OUTPUTS[0])]
    options = ("--report", "--preview", "--save-scene", "--outline")
    for option, name in zip(options, OUTPUTS[1:], strict=True):
        words += [option, str(folder / name)]
    return [*words, "--gaussians", "3", "--iterations", "2", "--quiet"]


def checking(folder):
    words = ["check", str(folder / "photo.png"), str(folder / "drawing.svg"), "--quiet"]
    for option, name in zip(("--report", "--preview", "--heatmap"), OUTPUTS[1:4], strict=True):
        words += [option, str(folder / name)]
    return words


def made(folder, old):
    """A folder with a photo, an SVG and old outputs, every other of which there is already."""
    folder.mkdir(parents=True)
    pixels = np.random.default_rng(3).integers(0, 255, (16, 16, 3), np.uint8)
    Image.fromarray(pixels).save(folder / "photo.png")
    drawing = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 8 8"/>'
    (folder / "drawing.svg").write_text(drawing)
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

    def once(outcomes, *goal):
        found.append(found[0] if found else best_of(outcomes, *goal))
        return found[-1]

    monkeypatch.setattr("gauss2svg.pipeline.vectorize.best_of", once)
    pixels = np.ones((16, 16, 3), np.float32)
    monkeypatch.setattr("gauss2svg.measure.check.draw", lambda *_: pixels)


@pytest.mark.parametrize("command", [fitting, checking])
@pytest.mark.parametrize("name", ["error", "interrupt before", "interrupt after"])
def test_each_file_is_the_old_one_or_the_whole_new_one(
    command, name, tmp_path, monkeypatch, capsys, one_search
):
    wholes, counts = [], []
    for old in (0, 1):  # without faults, to count the calls and to see what is made
        folder = made(tmp_path / f"whole{old}", old)
        with monkeypatch.context() as patch:
            faults = Faults(patch, folder)
            assert main(command(folder)) == 0
        wholes.append(content(folder))
        counts.append(faults.calls)
    assert {"open", "read", "os.open", "os.write", "os.fsync", "os.replace"} <= set(counts[0])
    capsys.readouterr()
    for place in range(max(map(len, counts))):
        old = place % 2
        folder = made(tmp_path / f"at{place}", old)
        before = content(folder)
        with monkeypatch.context() as patch:
            faults = Faults(patch, folder)
            # A full disk where something is written, a broken one where it is read or renamed.
            call = counts[old][place] if place < len(counts[old]) else ""
            error = "ENOSPC" if call in ("open", "os.open", "os.write", "os.fsync") else "EIO"
            which = error if name == "error" else name
            faults.at, faults.fault, faults.after = place, FAULTS[which], "after" in name
            status = main(command(folder))
        if len(faults.calls) <= place:
            assert status == 0
            continue
        at = f"{faults.calls[place]}, call {place}"
        err = capsys.readouterr().err
        after = content(folder)
        assert set(before) <= set(after) <= set(before) | set(wholes[old]), at
        for file, data in after.items():
            assert data == before.get(file) or same(file, data, wholes[old][file]), at
        if faults.calls[place] == "os.unlink":  # all is written by then, and renamed
            assert status in (0, 130), at
        else:
            assert status == (130 if "interrupt" in name else 2), at
        assert err.count("\n") == (0 if status == 0 else 1), (at, err)


def test_fault_at_every_rename_is_tried(tmp_path, monkeypatch):
    # The laws above would say nothing of calls that they do not see.
    folder = made(tmp_path / "folder", 0)
    with monkeypatch.context() as patch:
        faults = Faults(patch, folder)
        files.write_all_atomically({folder / name: b"new" for name in OUTPUTS})
    assert faults.calls.count("os.replace") == len(OUTPUTS)
    assert faults.calls.count("os.fsync") == len(OUTPUTS)
    assert faults.calls.count("os.chmod") == len(OUTPUTS[::2])
