"""Properties of the scores: known answers, slow twins, what is not measured and why."""

import ctypes
import dataclasses
import math
import sys

import numpy as np
import pytest
from PIL import Image
from skimage import data

from gauss2svg.cli.main import main
from gauss2svg.measure import PSNR, SSIMULACRA2, metrics
from gauss2svg.measure import perceptual as module
from gauss2svg.measure.perceptual import packages_missing, perceptual_scores
from gauss2svg.measure.roundtrip import score_of
from gauss2svg.photo.pixels import views

RNG = np.random.default_rng(1)
A = RNG.random((30, 40, 3)).astype(np.float32)
B = RNG.random((30, 40, 3)).astype(np.float32)


def test_psnr_is_that_of_the_definition_and_ssim_falls_with_noise():
    expected = -10 * math.log10(np.square(A.astype(np.float64) - B).mean())
    assert metrics.psnr(A, B) == pytest.approx(expected, abs=1e-9)
    assert metrics.psnr(A, A) == math.inf
    assert metrics.bias(A, B) == pytest.approx(255 * (A - B).mean(), abs=1e-4)
    assert metrics.largest_error(A, B) == pytest.approx(255 * np.abs(A - B).max())
    assert metrics.ssim(A, A) == pytest.approx(1)
    noisy = np.clip(A + 0.1 * (B - 0.5), 0, 1)
    assert metrics.ssim(A, noisy) == pytest.approx(metrics.ssim(noisy, A), abs=1e-6)
    assert metrics.ssim(A, B) < metrics.ssim(A, noisy) < 1


LACKING = (
    'SSIMULACRA2 and FLIP are not measured: not installed. Try pip install "gauss2svg[scores]"'
)


@pytest.fixture(scope="module")
def wide():
    """The least picture that SSIMULACRA2 measures."""
    side = SSIMULACRA2.least_side
    return np.ascontiguousarray(data.astronaut()[:side, 100 : 100 + side], np.float32) / 255


def noisy(picture, strength):
    noise = np.random.default_rng(0).normal(0, strength, picture.shape)
    return np.clip(picture + noise, 0, 1).astype(np.float32)


def test_scores_are_those_of_the_packages(wide, tmp_path):
    from flip_evaluator import evaluate
    from ssimulacra2 import compute_ssimulacra2

    other, names = noisy(wide, 0.05), [tmp_path / name for name in ("photo.png", "svg.png")]
    levels = [np.round(255 * one).astype(np.uint8) for one in (wide, other)]
    for name, pixels in zip(names, levels, strict=True):
        Image.fromarray(pixels).save(name)
    found = perceptual_scores(other, wide)
    assert found["ssimulacra2_svg"] == pytest.approx(compute_ssimulacra2(*names), abs=1e-6)
    rounded = [np.float32(one) / np.float32(255) for one in levels]
    assert found["flip_svg"] == pytest.approx(evaluate(*rounded, "LDR")[1], abs=1e-6)


@pytest.mark.parametrize("lower_wins", [False, True])
def test_transparent_pictures_have_the_worse_of_white_and_black(lower_wins):
    score = dataclasses.replace(PSNR, slug="largest_error", lower_wins=lower_wins)
    pictures = [np.dstack([one, alpha * one[:, :, 0]]) for one, alpha in ((A, 1), (B, 0.3))]
    both = [metrics.largest_error(*pair) for pair in zip(*map(views, pictures), strict=True)]
    assert both[0] != both[1]
    assert score_of(score, *pictures) == (max if lower_wins else min)(both)


def test_pictures_too_large_for_the_memory_and_failing_processes_have_a_reason(wide, monkeypatch):
    found = perceptual_scores(wide, wide, spare=10**6)
    first, _ = found["scores_missing"]
    assert (found["ssimulacra2_svg"], found["flip_svg"]) == (None, None)
    assert "needs 0.028 GB of memory for 225x225 px, and 0.001 GB are left" in first
    monkeypatch.setattr(module, "_flip", ctypes.string_at)  # of an address that is no memory
    monkeypatch.setattr(module, "_eight_bits", lambda _: 3)
    died = perceptual_scores(wide[:9], wide[:9])["scores_missing"][1]
    assert died.startswith("FLIP is not measured: its process ")


def test_missing_packages_are_one_line_of_check_and_an_error_where_asked_for(
    monkeypatch, tmp_path, capsys, refusal
):
    photo, svg = tmp_path / "photo.png", tmp_path / "blank.svg"
    Image.new("RGB", (8, 8)).save(photo)
    svg.write_text('<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1 1"/>')
    monkeypatch.setitem(sys.modules, "ssimulacra2", None)
    assert packages_missing() == (LACKING.replace("SSIMULACRA2 and FLIP are", "SSIMULACRA2 is"),)
    monkeypatch.setitem(sys.modules, "flip_evaluator", None)
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["check", str(photo), str(svg)]) == 0
    lines = [line.split(maxsplit=1) for line in capsys.readouterr().err.splitlines()]
    assert dict(lines)["scores"].rstrip() == LACKING
    line = "--scores must be given with ssimulacra2 or flip-evaluator installed; got none. Try pip "
    assert line in refusal(photo, "-o", tmp_path / "x.svg", "--scores")
    assert not (tmp_path / "x.svg").exists()
