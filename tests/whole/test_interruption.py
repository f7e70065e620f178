"""Signals: the first ends a fit with the best result so far, the second quits at once."""

import ctypes
import itertools
import json
import signal

import pytest
from batches import PoolHere
from PIL import Image
from skimage import data

from gauss2svg.cli.main import main
from gauss2svg.cli.terminal import Interruption, handling
from gauss2svg.pipeline.run import Run

STATUS = {signal.SIGINT: 130, signal.SIGTERM: 143}


@pytest.fixture
def command(tmp_path):
    photo = tmp_path / "photo.png"
    Image.fromarray(data.coffee()[::8, ::8]).save(photo)
    (tmp_path / "out.svg").write_text("old")
    return [
        str(photo), "-o", str(tmp_path / "out.svg"), "--gaussians", "30", "--iterations", "60",
        "--report", str(tmp_path / "report.json"), "--quiet",
    ]  # fmt: skip


@pytest.fixture
def after(monkeypatch):
    """Have signals come after these steps of a fit."""

    def arrange(number, *steps):
        asked, calls = Interruption.asked, itertools.count()  # once before the first step

        def and_a_signal(interruption):
            for _ in range(steps.count(next(calls))):
                signal.raise_signal(number)
            return asked(interruption)

        monkeypatch.setattr(Interruption, "asked", and_a_signal)

    return arrange


@pytest.mark.parametrize("number", STATUS)
@pytest.mark.parametrize("step", [1, 59])
def test_first_signal_ends_the_fit_with_the_best_so_far(
    number, step, command, after, tmp_path, capfd
):
    after(number, step)
    assert main(command) == STATUS[number]
    said = capfd.readouterr().err.splitlines()
    assert "interrupt again to quit at once" in said[0]
    assert f"interrupted after {step} optimiser steps. The best picture so far is in" in said[-1]
    report = json.loads((tmp_path / "report.json").read_text())
    assert (report["iterations"], report["stop_reason"]) == (step, "interrupted")
    assert (tmp_path / "out.svg").read_text().startswith("<?xml")
    assert report["svg_bytes"] == (tmp_path / "out.svg").stat().st_size
    assert report["gaussians"] > 0


@pytest.mark.parametrize(
    "goal", [("--target-psnr", "24"), ("--max-bytes", "3k", "--markup", "editable")]
)
def test_an_interrupted_search_keeps_its_limit_and_makes_no_corrections(
    goal, command, after, tmp_path
):
    after(signal.SIGINT, 15)
    assert main([*command, *goal]) == STATUS[signal.SIGINT]
    report = json.loads((tmp_path / "report.json").read_text())
    assert (report["corrections"], report["iterations"]) == (0, 15)
    assert "--max-bytes" not in goal or report["svg_bytes"] <= 3000


@pytest.mark.parametrize("number", STATUS)
def test_second_signal_ends_everything_and_leaves_the_old_file(
    number, command, after, tmp_path, capsys
):
    after(number, 4, 4)
    assert main(command) == STATUS[number]
    assert "every file is whole or untouched" in capsys.readouterr().err
    assert (tmp_path / "out.svg").read_text() == "old"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["out.svg", "photo.png"]


@pytest.mark.parametrize("number", STATUS)
@pytest.mark.parametrize("phase", ["write", "measure"])
@pytest.mark.parametrize("times", [1, 2])
def test_a_finished_fit_is_written_and_measured_unless_a_second_signal_comes(
    times, phase, number, command, tmp_path, monkeypatch, capsys
):
    notify = Run.notify

    def and_signals(run, now, fit=None):
        notify(run, now, fit)
        for _ in range(times if now == phase else 0):
            signal.raise_signal(number)

    monkeypatch.setattr(Run, "notify", and_signals)
    assert main(command) == STATUS[number]
    said = capsys.readouterr().err
    if times == 2:
        assert "every file is whole or untouched" in said
        assert (tmp_path / "out.svg").read_text() == "old"
        return
    assert "The best picture so far is in" in said
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["iterations"] == 60
    assert report["svg_bytes"] == (tmp_path / "out.svg").stat().st_size


def lose(number):
    """Get a signal in a callback of C code, as llvmlite's: what it raises is reported and lost."""
    ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(number))()


ENDED = "gauss2svg: interrupted; every file is whole or untouched\n"


@pytest.mark.parametrize("number", STATUS)
def test_signal_that_a_callback_loses_before_the_fit_ends_everything(
    number, command, tmp_path, monkeypatch, capsys
):
    def lost(*_):
        lose(number)
        return 0.0

    monkeypatch.setattr("gauss2svg.pipeline.run.compile_kernels", lost)
    assert main(command) == STATUS[number]
    assert capsys.readouterr().err == ENDED
    assert (tmp_path / "out.svg").read_text() == "old"


@pytest.mark.parametrize("number", STATUS)
def test_signal_that_a_callback_loses_ends_a_benchmark_with_tables_before_its_next_run(
    number, command, tmp_path, monkeypatch, capsys
):
    asked = []

    def answer(request):
        asked.append(request["settings"])
        lose(number)
        return {"error": "unlucky"}

    monkeypatch.setattr("gauss2svg.compare.table.Pool", PoolHere)
    monkeypatch.setattr("gauss2svg.compare.table.measure_alone", answer)
    axes = ["--axis", "gaussians=5,6", "--quiet"]
    assert main(["bench", command[0], "-o", str(tmp_path / "out"), *axes]) == STATUS[number]
    (row,) = json.loads((tmp_path / "out/bench.json").read_text())["rows"]
    assert asked == [row["settings"]] == [{"gaussians": 5}]
    assert capsys.readouterr().err == ENDED


@pytest.mark.parametrize("number", STATUS)
def test_signal_that_a_callback_loses_is_the_status_of_any_command(
    number, command, tmp_path, drawn_here, monkeypatch, capsys
):
    (tmp_path / "out.svg").write_text('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9"/>')
    monkeypatch.setattr("gauss2svg.cli.summary.print_check", lambda *_: lose(number))
    assert main(["check", command[0], command[2]]) == STATUS[number]
    assert capsys.readouterr().err == ENDED


def test_signals_that_were_ignored_at_the_start_stay_ignored(monkeypatch):
    # As by nohup, or in the background of a shell without job control.
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with handling():
            signal.raise_signal(signal.SIGINT)
            assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
            assert signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL
    finally:
        signal.signal(signal.SIGINT, before)


def test_handlers_are_as_they_were_afterwards(command, after):
    before = {number: signal.getsignal(number) for number in STATUS}
    after(signal.SIGINT, 3)
    main(command)
    assert {number: signal.getsignal(number) for number in STATUS} == before
