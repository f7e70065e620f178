"""Signals: the first ends a fit with the best result so far, the second quits at once."""

import itertools
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest
from PIL import Image
from skimage import data

from gauss2svg.cli.main import main
from gauss2svg.cli.terminal import Interruption, handling
from gauss2svg.pipeline.run import Run
from gauss2svg.scene import Scene

STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143}
UNTOUCHED = "gauss2svg: interrupted; every file is whole or untouched"


def in_turn(*moments):
    """Each moment with one of the signals, whose handler is the same."""
    pairs = list(zip(itertools.cycle(STATUS), moments, strict=False))
    return pytest.mark.parametrize(("number", "moment"), pairs)


@pytest.fixture
def command(tmp_path, monkeypatch):
    """A fit in a folder with a photo and an old output."""
    monkeypatch.chdir(tmp_path)
    Image.fromarray(data.coffee()[::16, ::16]).save("photo.png")
    Path("out.svg").write_text("old")
    words = "photo.png -o out.svg --gaussians 30 --iterations 20 --report report.json --quiet"
    return words.split()


@pytest.fixture
def at(monkeypatch):
    """Have signals come after steps of a fit, or as phases of a run begin."""

    def arrange(number, *moments):
        asked, calls, notify = Interruption.should_stop, itertools.count(), Run.notify

        def and_signals(now):
            for _ in range(moments.count(now)):
                signal.raise_signal(number)

        def step(interruption):
            and_signals(next(calls))  # once before the first step
            return asked(interruption)

        def phase(run, now, fit=None):
            notify(run, now, fit)
            and_signals(now)

        monkeypatch.setattr(Interruption, "should_stop", step)
        monkeypatch.setattr(Run, "notify", phase)

    return arrange


def report_of_the_file():
    """The report, after a look at whether the SVG is the one that it is about."""
    report = json.loads(Path("report.json").read_text())
    assert report["svg_bytes"] == Path("out.svg").stat().st_size
    return report


@in_turn(19, "write")
def test_first_signal_ends_the_fit_with_the_best_so_far(number, moment, command, at, capfd):
    before = {one: signal.getsignal(one) for one in STATUS}
    at(number, moment)
    assert main(command) == STATUS[number]
    assert {one: signal.getsignal(one) for one in STATUS} == before
    said, report = capfd.readouterr().err.splitlines(), report_of_the_file()
    assert "interrupt again to quit at once" in said[0]
    if moment in ("write", "measure"):
        assert report["iterations"] == 20
    else:
        assert f"after {moment} steps of the fit. The best picture so far is in" in said[-1]
        assert (report["iterations"], report["stop_reason"]) == (moment, "interrupted")
    assert report["gaussians"] > 0


def test_an_interrupted_search_keeps_its_limit_and_makes_no_corrections(command, at):
    at(signal.SIGINT, 15)
    words = [*command, "--max-bytes", "3k", "--markup", "editable"]
    assert main(words) == STATUS[signal.SIGINT]
    report = report_of_the_file()
    assert (report["corrections"], report["iterations"]) == (0, 15)
    assert report["svg_bytes"] <= 3000


@in_turn(4, "write")
def test_second_signal_ends_everything_and_leaves_the_old_file(
    number, moment, command, at, capfd, monkeypatch
):
    monkeypatch.setattr("gauss2svg.cli.terminal.SAME_MOMENT_S", -1.0)
    at(number, moment, moment)
    assert main(command) == STATUS[number]
    assert UNTOUCHED in capfd.readouterr().err
    assert Path("out.svg").read_text() == "old"
    assert sorted(os.listdir()) == ["out.svg", "photo.png"]


def test_a_signal_that_comes_twice_at_one_moment_is_one(command, at, monkeypatch):
    """The program `timeout` sends it to the process, and to the group of the process."""
    monkeypatch.setattr("gauss2svg.cli.terminal.SAME_MOMENT_S", 1e9)
    at(signal.SIGTERM, 4, 4)
    assert main(command) == STATUS[signal.SIGTERM]
    assert report_of_the_file()["iterations"] == 4


def test_signals_that_were_ignored_at_the_start_stay_ignored():
    # As by nohup, or in the background of a shell without job control.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with handling():
            signal.raise_signal(signal.SIGINT)
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
            assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    finally:
        signal.signal(signal.SIGINT, before)


WHOLE = {
    "out.svg": ElementTree.parse, "outline.svg": ElementTree.parse, "scene.npz": Scene.load,
    "preview.png": lambda path: Image.open(path).load(),
    "report.json": lambda path: json.loads(path.read_text()),
}  # fmt: skip


def handles_signals(process):
    """Whether a process has a handler of SIGTERM."""
    said = Path(f"/proc/{process.pid}/status").read_text()
    return int(said.partition("SigCgt:")[2].split()[0], 16) >> (signal.SIGTERM - 1) & 1


@pytest.mark.process
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("number", STATUS)
def test_a_process_that_only_a_signal_ends_leaves_whole_files(number, command, tmp_path):
    command[command.index("20")] = "1000000"
    options = ["--outline", "outline.svg", "--save-scene", "scene.npz", "--preview", "preview.png"]
    Path("temporary").mkdir()
    environment = os.environ | {"TMPDIR": str(tmp_path / "temporary")}
    words = [sys.executable, "-P", "-m", "gauss2svg", *command, *options]
    with subprocess.Popen(words, env=environment, stderr=subprocess.PIPE, text=True) as process:
        while not handles_signals(process):
            with pytest.raises(subprocess.TimeoutExpired):
                process.wait(0.01)
        process.send_signal(number)
        line = process.communicate()[1].splitlines()[-1]
    assert process.returncode == STATUS[number]
    assert not os.listdir("temporary")
    new = [name for name in WHOLE if Path(name).exists() and Path(name).read_bytes() != b"old"]
    assert new == ([] if line == UNTOUCHED else list(WHOLE))
    for name in new:
        WHOLE[name](Path(name))
    assert set(os.listdir()) <= WHOLE.keys() | {"photo.png", "temporary"}
