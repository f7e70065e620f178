"""Transparent photos from end to end: the file, its rasters, the report, the check."""

import io
import json

import numpy as np
import pytest
from flat import vectorize
from PIL import Image

import gauss2svg
from gauss2svg.cli.main import main
from gauss2svg.measure import metrics
from gauss2svg.photo.pixels import BLACK, over, shrunk
from gauss2svg.raster import rasterize, rasterize_rgba

QUICK = {"gaussians": 150, "iterations": 80}
GLASS = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 40 30" width="40" height="30">'
    '<rect width="20" height="30" fill="#f80" fill-opacity=".5"/>'
    '<rect width="10" height="10" fill="#08f"/></svg>'
)


@pytest.fixture(scope="module")
def cut_out(photo):
    """64 px of a face, in a disc with an edge of 2 px; uint8 (64, 64, 4)."""
    y, x = np.mgrid[:64, :64]
    alpha = np.clip((27 - np.hypot(x - 31.5, y - 31.5)) / 2, 0, 1)
    return np.round(255 * np.dstack([shrunk(photo, 64, 64), alpha])).astype(np.uint8)


@pytest.fixture(scope="module")
def result(cut_out):
    return vectorize(cut_out, **QUICK)


def pixels_of(picture):
    return picture.astype(np.float32) / 255


def psnrs(drawn, cut_out):
    """Over white, over black, of alpha."""
    photo = pixels_of(cut_out)
    pairs = [(over(drawn), over(photo)), (over(drawn, BLACK), over(photo, BLACK))]
    return [metrics.psnr(*pair) for pair in [*pairs, (drawn[:, :, 3:], photo[:, :, 3:])]]


def test_every_renderer_draws_glass_as_glass(renderer):
    drawn = rasterize_rgba(GLASS, 40, 30, renderer)
    np.testing.assert_allclose(drawn[5, 5], [0, 0x88 / 255, 1, 1], atol=0.006)
    np.testing.assert_allclose(drawn[20, 10], [1, 0x88 / 255, 0, 0.5], atol=0.006)
    assert drawn[5, 30, 3] == 0
    np.testing.assert_allclose(over(drawn), rasterize(GLASS, 40, 30, renderer), atol=0.006)


def test_every_renderer_draws_the_file_transparent_where_the_photo_is(renderer, result, cut_out):
    drawn = rasterize_rgba(result.svg, 64, 64, renderer)
    white, black, alpha = psnrs(drawn, cut_out)
    assert min(white, black) > 27
    assert alpha > 32
    y, x = np.mgrid[:64, :64]
    distance = np.hypot(x - 31.5, y - 31.5)
    assert drawn[distance > 32, 3].mean() < 0.004
    assert drawn[distance < 23, 3].mean() > 0.99


def test_report_has_the_numbers_of_the_raster(result, cut_out):
    report = result.report
    assert report["transparent"]
    assert result.raster.shape == (64, 64, 4)
    svg = [report[key] for key in ("psnr_svg", "psnr_svg_black", "psnr_svg_alpha")]
    assert svg == pytest.approx(psnrs(result.raster, cut_out), abs=1e-4)
    model = [report[key] for key in ("psnr_model", "psnr_model_black", "psnr_model_alpha")]
    assert model == pytest.approx(svg, abs=0.5)
    assert result.scene.transparent
    assert "<rect" not in result.svg


def test_opaque_alpha_is_no_alpha(cut_out):
    opaque = cut_out.copy()
    opaque[:, :, 3] = 255
    one, same = (vectorize(pixels, **QUICK) for pixels in (opaque, opaque[:, :, :3]))
    assert one.svg == same.svg
    assert not one.report["transparent"]
    assert one.raster.shape == (64, 64, 3)
    for key in ("psnr_svg_black", "psnr_svg_alpha", "psnr_model_black", "psnr_model_alpha"):
        assert one.report[key] is None


def test_matte_flattens_before_anything_else(cut_out):
    alpha = cut_out[:, :, 3:].astype(np.float32) / 255
    backdrop = np.float32([0x20, 0x40, 0x60]) / 255
    flat = pixels_of(cut_out)[:, :, :3] * alpha + (1 - alpha) * backdrop
    one, same = vectorize(cut_out, matte="#204060", **QUICK), vectorize(flat, **QUICK)
    assert one.svg == same.svg
    assert not one.scene.transparent
    assert one.report["matte"] == "#204060"
    assert "composited over #204060" in one.report["notes"]


def test_invisible_photo_is_an_empty_file():
    clear = np.full((20, 30, 4), [200, 10, 10, 0], np.uint8)
    for options in ({}, {"gaussians": 20}, {"target_psnr": 40}):
        result = vectorize(clear, **options)
        assert result.report["gaussians"] == 0
        assert "<circle" not in result.svg
        assert (rasterize_rgba(result.svg, 30, 20)[:, :, 3] == 0).all()
        assert result.report["psnr_svg"] is result.report["psnr_svg_alpha"] is None


def test_target_holds_over_both_backdrops(cut_out):
    report = vectorize(cut_out, target_psnr=27, quality="fast").report
    assert report["stop_reason"] == "target_psnr"
    assert min(report["psnr_svg"], report["psnr_svg_black"]) >= 26.95


@pytest.mark.sweep
def test_check_compares_alpha_too(result, cut_out):
    checked = gauss2svg.check(cut_out, result.svg)
    for key in ("psnr_svg", "psnr_svg_black", "psnr_svg_alpha", "ssim_svg", "transparent"):
        assert checked.report[key] == pytest.approx(result.report[key], abs=1e-4), key
    assert checked.raster.shape == checked.photo.shape == (64, 64, 4)
    with Image.open(io.BytesIO(checked.heatmap())) as picture:
        assert picture.width == 64
    over_black = gauss2svg.check(cut_out, result.svg, matte="black")
    assert over_black.psnr_black is over_black.report["psnr_svg_alpha"] is None
    assert over_black.psnr < 15  # the SVG is composited over white


@pytest.mark.sweep
def test_command_writes_a_transparent_preview_and_prints_all_three(
    cut_out, tmp_path, capsys, refusal
):
    source, out, seen, written = (tmp_path / name for name in ("i.png", "o.svg", "p.png", "r.json"))
    Image.fromarray(cut_out).save(source)
    command = [str(source), "-o", str(out), "--gaussians", "60", "--iterations", "30"]
    assert main([*command, "--preview", str(seen), "--report", str(written)]) == 0
    said = " ".join(capsys.readouterr().err.split())
    report = json.loads(written.read_text())
    for key, where in (("psnr_svg_black", "over black"), ("psnr_svg_alpha", "of alpha")):
        assert f"{report[key]:.2f} dB {where}" in said
    with Image.open(seen) as picture:
        assert picture.mode == "RGBA"
        assert picture.getpixel((0, 0))[3] == 0
    assert main(["check", str(source), str(out), "--preview", str(seen)]) == 0
    assert "over black" in capsys.readouterr().err
    assert "--matte white" in refusal(*command, "--blend", "add")
