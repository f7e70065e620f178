"""Signals: the first ends a fit with the best result so far, the second quits at once."""

import ctypes
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from random import Random
from xml.etree import ElementTree

import pytest
from batches import PoolHere
from PIL import Image
from skimage import data

import gauss2svg
from gauss2svg.cli.main import main
from gauss2svg.cli.terminal import _ENDING, Interruption, handling
from gauss2svg.pipeline.run import Run
from gauss2svg.scene import Scene

STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143}
ENDED = "gauss2svg: interrupted; every file is whole or untouched\n"
PACKAGES = os.fspath(Path(gauss2svg.__file__).parents[1])
each_signal = pytest.mark.parametrize("number", STATUS)


@pytest.fixture
def command(tmp_path, monkeypatch):
    """A fit in a folder with a photo and an old output."""
    monkeypatch.chdir(tmp_path)
    Image.fromarray(data.coffee()[::8, ::8]).save("photo.png")
    Path("out.svg").write_text("old")
    words = "photo.png -o out.svg --gaussians 30 --iterations 60 --report report.json --quiet"
    return words.split()


@pytest.fixture
def after(monkeypatch):
    """Have signals come after these steps of a fit."""

    def arrange(number, *steps):
        asked, calls = Interruption.should_stop, itertools.count()  # once before the first step

        def and_a_signal(interruption):
            for _ in range(steps.count(next(calls))):
                signal.raise_signal(number)
            return asked(interruption)

        monkeypatch.setattr(Interruption, "should_stop", and_a_signal)

    return arrange


def report_of_the_file():
    """The report, after a look at whether the SVG is the one that it is about."""
    report = json.loads(Path("report.json").read_text())
    assert report["svg_bytes"] == Path("out.svg").stat().st_size
    return report


@each_signal
@pytest.mark.parametrize("step", [1, 59])
def test_first_signal_ends_the_fit_with_the_best_so_far(number, step, command, after, capfd):
    before = {one: signal.getsignal(one) for one in STATUS}
    after(number, step)
    assert main(command) == STATUS[number]
    assert {one: signal.getsignal(one) for one in STATUS} == before
    said = capfd.readouterr().err.splitlines()
    assert "interrupt again to quit at once" in said[0]
    assert f"interrupted after {step} optimiser steps. The best picture so far is in" in said[-1]
    report = report_of_the_file()
    assert (report["iterations"], report["stop_reason"]) == (step, "interrupted")
    assert report["gaussians"] > 0


@pytest.mark.parametrize("goal", ["--target-psnr 24", "--max-bytes 3k --markup editable"])
def test_an_interrupted_search_keeps_its_limit_and_makes_no_corrections(goal, command, after):
    after(signal.SIGINT, 15)
    assert main([*command, *goal.split()]) == STATUS[signal.SIGINT]
    report = report_of_the_file()
    assert (report["corrections"], report["iterations"]) == (0, 15)
    assert "--max-bytes" not in goal or report["svg_bytes"] <= 3000


@each_signal
def test_second_signal_ends_everything_and_leaves_the_old_file(number, command, after, capsys):
    after(number, 4, 4)
    assert main(command) == STATUS[number]
    assert "every file is whole or untouched" in capsys.readouterr().err
    assert Path("out.svg").read_text() == "old"
    assert sorted(os.listdir()) == ["out.svg", "photo.png"]


@each_signal
@pytest.mark.parametrize("phase", ["write", "measure"])
@pytest.mark.parametrize("times", [1, 2])
def test_a_finished_fit_is_written_and_measured_unless_a_second_signal_comes(
    times, phase, number, command, monkeypatch
):
    notify = Run.notify

    def and_signals(run, now, fit=None):
        notify(run, now, fit)
        for _ in range(times if now == phase else 0):
            signal.raise_signal(number)

    monkeypatch.setattr(Run, "notify", and_signals)
    assert main(command) == STATUS[number]
    if times == 2:
        assert Path("out.svg").read_text() == "old"
    else:
        assert report_of_the_file()["iterations"] == 60


@each_signal
def test_signal_that_a_callback_loses_ends_a_command_before_what_comes_next(
    number, command, drawn_here, monkeypatch, capsys
):
    def lose(*_):
        """Get a signal in a callback of C code, which reports and loses what is raised there."""
        ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(number))()
        return 0.0

    monkeypatch.setattr("gauss2svg.pipeline.run.compile_kernels", lose)
    assert main(command) == STATUS[number]
    assert capsys.readouterr().err == ENDED
    assert Path("out.svg").read_text() == "old"

    Path("out.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"/>')
    monkeypatch.setattr("gauss2svg.cli.summary.print_check", lose)
    assert main(["check", "photo.png", "out.svg"]) == STATUS[number]
    assert capsys.readouterr().err == ENDED

    monkeypatch.setattr("gauss2svg.compare.table.Pool", PoolHere)
    monkeypatch.setattr(
        "gauss2svg.compare.table.measure_alone", lambda request: lose() or {"error": "unlucky"}
    )
    words = "bench photo.png -o out --axis gaussians=5,6 --quiet"
    assert main(words.split()) == STATUS[number]
    (row,) = json.loads(Path("out/bench.json").read_text())["rows"]
    assert row["settings"] == {"gaussians": 5}


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


NEW = {
    "out.svg": ElementTree.parse, "outline.svg": ElementTree.parse, "scene.npz": Scene.load,
    "preview.png": lambda path: Image.open(path).load(),
    "report.json": lambda path: json.loads(path.read_text()),
}  # fmt: skip


@pytest.mark.process
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("is_cold", [False, True])
def test_a_process_that_is_interrupted_at_any_moment_leaves_whole_files(seed, is_cold, command):
    rng, number = Random(seed), [signal.SIGINT, signal.SIGTERM][seed]
    options = ["--outline", "outline.svg", "--save-scene", "scene.npz", "--preview", "preview.png"]
    Path("temporary").mkdir()
    environment = {"PYTHONPATH": PACKAGES, "TMPDIR": str(Path("temporary").absolute())}
    if is_cold:
        environment["NUMBA_CACHE_DIR"] = str(Path("temporary").absolute().parent / "cold")
    process = subprocess.Popen(
        [sys.executable, "-m", "gauss2svg", *command, *options],
        env=os.environ | environment, stderr=subprocess.PIPE,
    )  # fmt: skip
    is_ready = False
    while process.poll() is None and not is_ready:  # until it handles signals
        caught = Path(f"/proc/{process.pid}/status").read_text().partition("SigCgt:")[2].split()
        is_ready = caught and int(caught[0], 16) >> (signal.SIGTERM - 1) & 1
    time.sleep(3 * rng.random())
    process.send_signal(number)
    was_old = Path("out.svg").read_text() == "old"
    lines = process.communicate()[1].replace(_ENDING, b"").decode().splitlines()
    assert process.returncode == 128 + number or (process.returncode, was_old) == (0, False), lines
    assert len(lines) == (process.returncode != 0), lines
    assert set(os.listdir()) <= NEW.keys() | {"photo.png", "temporary", "cold"}
    assert not os.listdir("temporary")
    found = [name for name in NEW if Path(name).exists() and Path(name).read_bytes() != b"old"]
    for name in found:
        NEW[name](Path(name))
    if process.returncode == 0 or "The best picture so far is in" in lines[0]:
        assert found == list(NEW)
    else:
        assert "every file is whole or untouched" in lines[0]


@pytest.mark.process
def test_the_status_is_that_of_the_command_also_if_the_signal_fell_into_exec(tmp_path, monkeypatch):
    """As where numba compiles; `python -m` would end by SIGINT."""
    code = (
        "def main():\n    try:\n        exec('raise KeyboardInterrupt')\n"
        "    except KeyboardInterrupt:\n        return 130\n"
        "from gauss2svg.cli import main as module; module.main = main; module.run()"
    )
    monkeypatch.chdir(tmp_path)
    Path("command.py").write_text(code)
    environment = os.environ | {"PYTHONPATH": PACKAGES}
    assert subprocess.run([sys.executable, "-m", "command"], env=environment).returncode == 130
