"""Properties of the perceptual scores: known answers, what is not measured and why."""

import json
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
from gauss2svg.errors import InputError
from gauss2svg.measure import SSIMULACRA2
from gauss2svg.measure import perceptual as module
from gauss2svg.measure.perceptual import (
    Scores,
    flip,
    packages_missing,
    perceptual_scores,
    ssimulacra2,
)

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
    both = perceptual_scores(np.dstack([noisy(wide, 0.1), alpha]), np.dstack([wide, alpha]))
    over = [
        perceptual_scores(*(0.5 * p + np.float32(0.5 * side) for p in (noisy(wide, 0.1), wide)))
        for side in (0, 1)
    ]
    assert both.ssimulacra2 == pytest.approx(min(one.ssimulacra2 for one in over), abs=1e-3)
    assert both.flip == pytest.approx(max(one.flip for one in over), abs=1e-4)


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
    assert (found.ssimulacra2, found.flip, len(found.missing)) == (None, None, 2)
    assert "needs 0.028 GB of memory for 225x225 px, and 0.001 GB are left" in found.missing[0]
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


def test_missing_packages_are_one_line_of_check_and_an_error_where_asked_for(
    monkeypatch, tmp_path, capsys, refusal
):
    photo, svg = tmp_path / "photo.png", tmp_path / "blank.svg"
    Image.new("RGB", (8, 8)).save(photo)
    svg.write_text(BLANK)
    monkeypatch.setitem(sys.modules, "ssimulacra2", None)
    assert packages_missing() == (LACKING.replace("SSIMULACRA2 and FLIP are", "SSIMULACRA2 is"),)
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["check", str(photo), str(svg)]) == 0
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().err.splitlines()]
    assert dict(lines)["scores"].rstrip() == LACKING
    assert refusal(photo, "-o", tmp_path / "x.svg", "--scores") == f"gauss2svg: {LACKING}\n"
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


def test_a_broken_package_costs_its_own_score_alone(monkeypatch):
    broken = ModuleType("ssimulacra2")
    broken.__spec__ = find_spec("ssimulacra2")
    monkeypatch.setitem(sys.modules, "ssimulacra2", broken)
    picture = np.zeros((230, 230, 3), np.float32)
    found = perceptual_scores(picture, picture)
    assert (found.ssimulacra2, found.flip) == (None, 0)
    (line,) = found.missing
    assert line.startswith("SSIMULACRA2 is not measured: SSIMULACRA2 cannot be imported")
