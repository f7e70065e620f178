"""Additive blending as an option of the whole job, and its portable form."""

import re

import numpy as np
import pytest
from conftest import needs
from flat import fit_config, fit_in, vectorize
from PIL import Image

from gauss2svg.cli.main import main
from gauss2svg.fit.population import composited
from gauss2svg.fit.target import target_of
from gauss2svg.measure import metrics
from gauss2svg.render import render
from gauss2svg.scene import ADD, OVER

QUICK = {"gaussians": 150, "iterations": 60}


@pytest.fixture(scope="module")
def additive(photo):
    return vectorize(photo, blend=ADD, **QUICK)


@pytest.fixture(scope="module")
def portable(photo):
    return vectorize(photo, blend=ADD, portable=True, **QUICK)


def test_an_additive_scene_is_rasterised_from_its_file(additive):
    report = additive.report
    assert additive.scene.blend == ADD
    assert report["blend"] == ADD
    assert report["falloff"] == "gaussian"
    assert report["gaussians"] == len(additive.scene) == 150
    assert "mix-blend-mode" in additive.svg
    assert report["psnr_roundtrip"] > 42
    assert abs(report["psnr_svg"] - report["psnr_model"]) < 0.2


def test_the_additive_file_does_not_depend_on_the_threads(photo, additive):
    assert vectorize(photo, blend=ADD, threads=1, **QUICK).svg == additive.svg


def test_the_portable_form_is_composited_and_drawn_by_all(photo, portable):
    assert portable.scene.blend == OVER
    assert portable.report["blend"] == ADD
    assert portable.report["portable"] is True
    assert "mix-blend-mode" not in portable.svg
    needs("cairo")
    again = vectorize(photo, blend=ADD, portable=True, renderer="cairo", **QUICK)
    assert again.svg == portable.svg
    assert again.report["psnr_roundtrip"] > 44


def test_the_portable_form_matches_a_fit_composited_from_the_start(photo, portable):
    composited_only = vectorize(photo, **QUICK)
    assert portable.report["psnr_model"] > composited_only.report["psnr_model"] - 0.3


def test_the_portable_form_costs_both_fits(additive, portable):
    assert portable.report["iterations"] == 2 * additive.report["iterations"]
    assert portable.report["pixel_pairs"] > 1.5 * additive.report["pixel_pairs"]


def test_conversion_begins_with_the_additive_shapes_largest_first(photo, additive):
    state = composited(additive.scene, target_of(photo, np.float32, "psnr"), fit_config(150).fit)
    back = state.scene(additive.scene.background, additive.scene.width, additive.scene.height)
    area = np.sqrt(np.linalg.det(back.covariance))
    assert (np.diff(area) <= 1e-9).all()
    before = np.sqrt(np.linalg.det(additive.scene.covariance))
    np.testing.assert_allclose(np.sort(area), np.sort(before), rtol=1e-6)
    assert (np.diff(back.round_index) >= 0).all()
    assert len(np.unique(back.round_index)) == 6


@pytest.mark.sweep
@pytest.mark.parametrize("portable_form", [False, True])
def test_targets_hold_for_additive_blending(photo, portable_form):
    options = {"blend": ADD, "portable": portable_form, "quality": "draft", "iterations": 80}
    small = vectorize(photo, max_bytes="20k", **options)
    assert len(small.svg.encode()) <= 20_000
    assert len(small.scene) > 50
    close = vectorize(photo, target_psnr=24, **options)
    assert 23.95 <= close.report["psnr_svg"] < 26
    assert close.report["stop_reason"] == "target_psnr"


@pytest.mark.sweep
@pytest.mark.parametrize("portable_form", [False, True])
def test_the_adaptive_count_holds_for_additive_blending(photo, portable_form):
    few = vectorize(photo, blend=ADD, portable=portable_form, quality="draft")
    many = vectorize(photo, blend=ADD, portable=portable_form, quality="balanced")
    assert 20 < len(few.scene) < len(many.scene)
    flat = vectorize(np.full((32, 40, 3), 0.3), blend=ADD, portable=portable_form)
    assert len(flat.scene) == 0
    assert flat.report["psnr_svg"] > 48


def test_additive_gaussians_are_fitted_in_float64_too(photo):
    # Without relocation rounding decides nothing: its effect is small, but not zero.
    single, double = (
        fit_in(dtype, photo, fit_config(40, 20, blend=ADD, relocate=False)).scene
        for dtype in (np.float32, np.float64)
    )
    assert (single.mean != double.mean).any()
    psnr = [metrics.psnr(render(scene), photo) for scene in (single, double)]
    assert psnr[0] == pytest.approx(psnr[1], abs=0.05)


def test_the_portable_form_has_as_many_as_were_asked_for(photo):
    # Additive fits lose some invisible Gaussians: others replace them.
    pixels = photo[:64, :80]
    additive_only = vectorize(pixels, blend=ADD, gaussians=300, iterations=30, init="random")
    assert len(additive_only.scene) < 300
    result = vectorize(
        pixels, blend=ADD, portable=True, gaussians=300, iterations=30, init="random"
    )
    assert 280 < len(result.scene) <= 300
    assert (np.diff(result.scene.round_index) >= 0).all()
    assert result.report["rounds"] == 6


@pytest.mark.sweep
def test_the_portable_form_meets_the_preset(photo):
    composited_only, portable_form = (
        vectorize(photo, quality="fast", **options)
        for options in ({}, {"blend": ADD, "portable": True})
    )
    assert 0.6 < len(portable_form.scene) / len(composited_only.scene) < 1.5
    assert abs(portable_form.report["psnr_svg"] - composited_only.report["psnr_svg"]) < 1.5


@pytest.mark.sweep
def test_rounds_of_the_paper_reach_the_report(photo):
    result = vectorize(
        photo, gaussians=31, iterations=60, blend=ADD, init="live", per_round=16,
        round_iterations=8, relocate=False, loss="l1+ssim", ssim_weight=0.4,
    )  # fmt: skip
    report = result.report
    assert report["rounds"] == 5
    wanted = {
        "per_round": 16, "round_iterations": 8, "relocate": False, "ssim_weight": 0.4,
        "init": "live", "loss": "l1+ssim",
    }  # fmt: skip
    assert {name: report[name] for name in wanted} == wanted


def test_the_command_writes_additive_files_and_their_portable_form(
    photo, tmp_path, capsys, refusal
):
    out, photo_file = tmp_path / "out.svg", tmp_path / "photo.png"
    Image.fromarray(np.round(photo[:48, :64] * 255).astype(np.uint8)).save(photo_file)
    quick = ["--gaussians", "40", "--iterations", "20", "--blend", "add"]
    assert main([str(photo_file), "-o", str(out), *quick]) == 0
    assert "mix-blend-mode" in out.read_text()
    assert re.search(r"match\s+PSNR", capsys.readouterr().err)
    assert main([str(photo_file), "-o", str(out), *quick, "--portable", "--no-relocate"]) == 0
    assert "mix-blend-mode" not in out.read_text()
    before = out.read_text()
    outline = ["--outline", str(tmp_path / "outline.svg")]
    line = refusal(photo_file, "-o", out, *quick, *outline)
    assert "--outline must not be given with --blend add" in line
    assert out.read_text() == before
    assert main([str(photo_file), "-o", str(out), *quick, *outline, "--portable"]) == 0
    assert "--portable" in refusal(photo_file, "-o", out, *quick, "--renderer", "cairo")
