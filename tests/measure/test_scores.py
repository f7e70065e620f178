"""Laws of the perceptual scores: known answers, what is not measured and why, where they appear."""

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from types import ModuleType

import numpy as np
import pytest
from flat import vectorize
from PIL import Image
from skimage import data

import gauss2svg
from gauss2svg.cli.main import main
from gauss2svg.compare.chart import COSTS, scatter
from gauss2svg.errors import InputError
from gauss2svg.measure import perceptual as module
from gauss2svg.measure.perceptual import (
    Scores,
    flip,
    packages_missing,
    perceptual_scores,
    ssimulacra2,
)
from gauss2svg.measure.scores import SCORES, SSIMULACRA2

KEYS = ("ssimulacra2_svg", "flip_svg", "scores_missing")
LACKING = (
    'SSIMULACRA2 and FLIP are not measured: not installed. Try pip install "gauss2svg[scores]"'
)
SMALL = "SSIMULACRA2 is not measured: it needs at least 225 px a side"
BLANK = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>'


@pytest.fixture(scope="module")
def wide():
    """The least picture that SSIMULACRA2 measures."""
    side = SSIMULACRA2.least_side
    return np.ascontiguousarray(data.astronaut()[:side, 100 : 100 + side], np.float32) / 255


def noisy(picture, strength):
    noise = np.random.default_rng(0).normal(0, strength, picture.shape)
    return np.clip(picture + noise, 0, 1).astype(np.float32)


def test_equal_pictures_have_100_and_0(wide):
    assert perceptual_scores(wide, wide) == Scores({"ssimulacra2": 100.0, "flip": 0.0})


@pytest.mark.sweep
def test_more_noise_is_worse(wide):
    found = [perceptual_scores(noisy(wide, s), wide) for s in (0.01, 0.05, 0.2)]
    similar = [one.ssimulacra2 for one in found]
    assert 100 > similar[0] > similar[1] > similar[2]
    different = [one.flip for one in found]
    assert 0 < different[0] < different[1] < different[2] < 1


def test_flip_is_that_of_the_package_and_in_its_order(wide):
    from flip_evaluator import evaluate

    levels = [np.round(one * 255).astype(np.float32) / np.float32(255) for one in
              (wide, noisy(wide, 0.1))]  # fmt: skip
    assert flip(levels[1], wide) == pytest.approx(evaluate(*levels, "LDR")[1], abs=1e-6)


def test_ssimulacra2_is_that_of_the_command_line(wide, tmp_path):
    names = [tmp_path / name for name in ("photo.png", "svg.png")]
    for name, pixels in zip(names, (wide, noisy(wide, 0.05)), strict=True):
        Image.fromarray(np.round(pixels * 255).astype(np.uint8)).save(name)
    code = "import sys; from ssimulacra2.cli import main; main()"
    command = [sys.executable, "-c", code, *map(str, names)]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert ssimulacra2(noisy(wide, 0.05), wide) == pytest.approx(float(told), abs=1e-6)


@pytest.mark.sweep
def test_transparent_pictures_have_the_worse_of_white_and_black(wide):
    alpha = np.full((*wide.shape[:2], 1), 0.5, np.float32)
    photo = np.dstack([wide, alpha])
    other = np.dstack([noisy(wide, 0.1), alpha])
    both = perceptual_scores(other, photo)
    for side in (0.0, 1.0):
        views = [p[:, :, :3] * 0.5 + 0.5 * side for p in (other, photo)]
        each = perceptual_scores(*(np.asarray(v, np.float32) for v in views))
        assert both.ssimulacra2 <= each.ssimulacra2 + 1e-9
        assert both.flip >= each.flip - 1e-9


def test_small_pictures_have_a_reason_and_a_flip(photo):
    found = perceptual_scores(noisy(photo, 0.1), photo)
    assert found.ssimulacra2 is None
    assert found.flip > 0
    assert found.missing == (SMALL,)
    assert flip(photo[:1, :1], photo[:1, :1]) == 0
    with pytest.raises(InputError, match="at least 225 px a side; got 128x128 px"):
        ssimulacra2(photo, photo)
    with pytest.raises(InputError, match=r"of one shape \(h, w, channels\)"):
        perceptual_scores(photo, photo[1:])


def test_pictures_too_large_for_the_memory_have_a_reason(wide, monkeypatch):
    found = perceptual_scores(wide, wide, spare=10**6)
    assert (found.ssimulacra2, found.flip) == (None, None)
    assert found.missing[0] == (
        "SSIMULACRA2 is not measured: it needs 0.028 GB of memory for 225x225 px, and 0.001 GB "
        "are left"
    )
    assert len(found.missing) == 2
    monkeypatch.setattr(module, "free_bytes", lambda: 10**6)
    assert perceptual_scores(wide, wide).flip is None
    monkeypatch.setattr(module, "DEFAULT_MAX_PIXELS", 100)
    assert "limited to 100 px" in perceptual_scores(wide, wide).missing[1]


def test_flip_whose_process_fails_has_a_reason(photo, monkeypatch):
    exits = [sys.executable, "-c", "import sys; sys.exit(3)"]
    monkeypatch.setattr(module, "module_command", lambda *_: exits)
    assert perceptual_scores(photo, photo).missing[1] == (
        "FLIP is not measured: its process ended with status 3: was there enough memory?"
    )


@pytest.mark.sweep
@pytest.mark.posix
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_child_of_a_process_that_measured_measures(photo):
    wanted = flip(noisy(photo, 0.1), photo)
    child = os.fork()
    if not child:
        os._exit(flip(noisy(photo, 0.1), photo) != wanted)
    assert os.waitpid(child, 0)[1] == 0


def absent(monkeypatch):
    """As if no package were installed."""
    for name in ("ssimulacra2", "flip_evaluator"):
        monkeypatch.setitem(sys.modules, name, None)


def test_missing_packages_are_one_line_of_check_and_an_error_where_asked_for(
    monkeypatch, tmp_path, capsys
):
    Image.new("RGB", (8, 8)).save(tmp_path / "photo.png")
    (tmp_path / "blank.svg").write_text(BLANK)
    arguments = [str(tmp_path / "photo.png"), "-o", str(tmp_path / "x.svg"), "--scores"]
    monkeypatch.setitem(sys.modules, "ssimulacra2", None)
    one = LACKING.replace("SSIMULACRA2 and FLIP are", "SSIMULACRA2 is")
    assert packages_missing() == (one,)
    absent(monkeypatch)
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["check", str(tmp_path / "photo.png"), str(tmp_path / "blank.svg")]) == 0
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().err.splitlines()]
    assert dict(lines)["scores"].rstrip() == LACKING
    assert main(arguments) == 2
    assert capsys.readouterr().err == f"gauss2svg: {LACKING}\n"
    assert not (tmp_path / "x.svg").exists()


def test_a_run_measures_them_where_asked_as_check_does(photo):
    plain = vectorize(photo, gaussians=9, iterations=2)
    assert [plain.report[key] for key in KEYS] == [None, None, []]
    scored = vectorize(photo, gaussians=9, iterations=2, scores=True)
    assert scored.svg == plain.svg
    np.testing.assert_array_equal(scored.photo, photo)
    checked = gauss2svg.check(photo, scored.svg)
    assert [scored.report[key] for key in KEYS] == [checked.report[key] for key in KEYS]
    assert scored.report["flip_svg"] == checked.scores.flip > 0
    assert checked.report["scores_missing"] == [SMALL]
    json.dumps(checked.report, allow_nan=False)
    with pytest.raises(InputError, match="scores must not be given with time_limit"):
        vectorize(photo, scores=True, time_limit=5)


@pytest.mark.parametrize("axis", SCORES, ids=lambda axis: axis.slug)
def test_better_is_higher_in_a_chart_and_no_tick_is_better_than_equal(axis):
    ends = {"psnr": (20, 41), "ssim": (0.2, 1), "ssimulacra2": (-300, 100), "flip": (0.31, 0)}
    worse, better = ends[axis.slug]
    points = [{"cost": cost, "score": score} for cost, score in ((1, worse), (9, better))]
    chart = scatter(points, COSTS[0], axis)
    high, low = (point["y"] for point in chart["points"])
    assert chart["frame"].top <= low < high <= chart["frame"].bottom
    ticks = [(y, float(text)) for y, text in chart["y_ticks"]]
    assert 3 <= len(ticks) <= 8
    assert [value for _, value in ticks] == sorted({v for _, v in ticks}, reverse=axis.falls)
    if axis.best is not None:
        assert axis.best == ticks[-1][1]
        assert ticks[-1][0] == low


def test_a_broken_package_costs_its_own_score_alone(monkeypatch):
    broken = ModuleType("ssimulacra2")
    broken.__spec__ = find_spec("ssimulacra2")
    monkeypatch.setitem(sys.modules, "ssimulacra2", broken)
    picture = np.zeros((230, 230, 3), np.float32)
    found = perceptual_scores(picture, picture)
    assert (found.ssimulacra2, found.flip) == (None, 0)
    (line,) = found.missing
    assert line.startswith("SSIMULACRA2 is not measured: SSIMULACRA2 cannot be imported")
