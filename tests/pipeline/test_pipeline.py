"""Runs of the whole pipeline, composited and additive, and what their reports say."""

import gzip
import json

import numpy as np
import pytest
from conftest import needs
from flat import vectorize

from gauss2svg import quantize
from gauss2svg.errors import RendererError
from gauss2svg.measure import metrics
from gauss2svg.raster import rasterize
from gauss2svg.render import cpu
from gauss2svg.scene import ADD, OVER
from gauss2svg.svg.write import write_svg

QUICK = {"gaussians": 120, "iterations": 30}


@pytest.fixture(scope="module")
def photo(photo):
    """The photo of all tests at half its size: renderers take most of a short run."""
    return np.ascontiguousarray(photo[::2, ::2])


@pytest.fixture(scope="module")
def result(photo):
    return vectorize(photo, seed=0, **QUICK)


def test_report_measures_the_file_not_the_model_and_is_json(photo, result):
    report, raster = result.report, rasterize(result.svg, 64, 64)
    assert json.loads(json.dumps(report, allow_nan=False)) == report
    assert (result.raster == raster).all()
    assert report["psnr_svg"] == pytest.approx(metrics.psnr(raster, photo))
    assert report["ssim_svg"] == metrics.ssim(raster, photo)
    assert report["svg_bytes"] == len(result.svg.encode())
    packed = gzip.compress(result.svg.encode(), 9, mtime=0)
    assert report["svgz_bytes"] == len(packed) < report["svg_bytes"]
    assert report["gaussians"] == len(result.scene)
    assert 22 < report["psnr_svg"] > report["psnr_model"] - 0.5
    assert report["psnr_roundtrip"] > 38
    assert abs(report["bias_roundtrip"]) < 0.5


@pytest.mark.parametrize("change", [{"loss": "l1"}, {"seed": 1, "init": "random"}])
def test_every_option_reaches_the_fit(photo, change):
    less = dict(list(change.items())[1:])  # without the first option
    assert vectorize(photo, **QUICK, **change).svg != vectorize(photo, **QUICK, **less).svg


def test_the_report_has_the_palette_of_a_given_number_of_shapes(photo, result):
    assert result.report["palette"] is not None
    assert vectorize(photo, iterations=8).report["palette"] is None


def test_phases_come_in_order_on_the_threads_that_were_asked_for(photo, capfd):
    """And nothing is printed."""
    seen, before = [], cpu.threads
    report = vectorize(
        photo, threads=1, progress=lambda p: seen.append((p.phase, cpu.threads)), **QUICK
    ).report
    phases, threads = zip(*seen, strict=True)
    assert list(dict.fromkeys(phases)) == ["read", "fit", "write", "measure"]
    assert phases.count("fit") == QUICK["iterations"]
    assert set(threads[1:]) == {report["threads"]} == {1}
    assert cpu.threads == before
    assert capfd.readouterr() == ("", "")


def test_missing_renderer_is_reported_before_the_fit(photo, monkeypatch):
    from gauss2svg.raster import renderers

    def missing():
        raise RendererError("no cairo")

    monkeypatch.setattr(renderers, "cairosvg_module", missing)
    with pytest.raises(RendererError, match="no cairo"):
        vectorize(photo, renderer="cairo", progress=lambda p: pytest.fail(p.phase), **QUICK)


def test_saved_scene_writes_the_same_file(result, tmp_path):
    result.scene.save(tmp_path / "scene.npz")
    again = type(result.scene).load(tmp_path / "scene.npz")
    text = write_svg(quantize(again, palette=result.report["palette"]))
    assert len(text.encode()) == result.report["svg_bytes"]
    assert text == result.svg


SUMMED = {"gaussians": 150, "iterations": 60}


@pytest.fixture(scope="module")
def additive(photo):
    return vectorize(photo, blend=ADD, **SUMMED)


def test_an_additive_scene_is_rasterised_from_its_file_on_any_number_of_threads(photo, additive):
    report = additive.report
    assert additive.scene.blend == report["blend"] == ADD
    assert report["falloff"] == "gaussian"
    assert report["gaussians"] == len(additive.scene) == 150
    assert "mix-blend-mode" in additive.svg
    assert report["psnr_roundtrip"] > 42
    assert abs(report["psnr_svg"] - report["psnr_model"]) < 0.2
    assert vectorize(photo, blend=ADD, threads=1, **SUMMED).svg == additive.svg


def test_the_portable_form_is_composited_by_a_second_fit_and_drawn_by_all(photo, additive):
    needs("cairo")
    given = {**SUMMED, "falloff": "adaptive", "renderer": "cairo"}
    portable = vectorize(photo, blend=ADD, portable=True, **given)
    report = portable.report
    assert portable.scene.blend == OVER
    assert (report["blend"], report["portable"]) == (ADD, True)
    assert "mix-blend-mode" not in portable.svg
    assert report["psnr_roundtrip"] > 44
    assert report["iterations"] == 2 * additive.report["iterations"]
    assert report["pixel_pairs"] > 1.5 * additive.report["pixel_pairs"]
    assert report["psnr_model"] > vectorize(photo, **SUMMED).report["psnr_model"] - 0.3


@pytest.mark.sweep
@pytest.mark.parametrize("portable", [False, True])
def test_targets_and_presets_hold_for_additive_blending(photo, portable):
    options = {"blend": ADD, "portable": portable}
    draft = {**options, "quality": "draft", "iterations": 80}
    small = vectorize(photo, max_bytes="20k", **draft)
    assert len(small.svg.encode()) <= 20_000
    assert len(small.scene) > 50
    close = vectorize(photo, target_psnr=24, **draft)
    assert 23.95 <= close.report["psnr_svg"] < 26
    assert close.report["stop_reason"] == "target_psnr"
