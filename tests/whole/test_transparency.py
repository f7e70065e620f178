"""Transparent photos: how they are fitted, the file, its rasters, the report and the check."""

import json
from xml.etree import ElementTree

import numpy as np
import pytest
from conftest import random_scene
from extreme_scenes import extreme_scenes, rounding_of
from flat import choices, vectorize
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

import gauss2svg
from gauss2svg.cli.main import main
from gauss2svg.errors import InputError, SceneError
from gauss2svg.fit.adam import gradients
from gauss2svg.fit.placement import place
from gauss2svg.fit.target import target_of
from gauss2svg.measure import metrics
from gauss2svg.photo.pixels import BACKDROPS, BLACK, from_views, matte_color, over, shrunk, straight
from gauss2svg.pipeline.palette import quantize
from gauss2svg.raster import rasterize, rasterize_rgba
from gauss2svg.render import render, render_rgba
from gauss2svg.render.cpu import splats_of
from gauss2svg.scene import Scene
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import write_svg

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


def test_two_backdrops_determine_colour_and_alpha():
    rng = np.random.default_rng(0)
    alpha = rng.choice([0.0, 0.25, 1.0], (9, 7))
    rgba = straight(alpha[:, :, None] * rng.random((9, 7, 3)), alpha)
    np.testing.assert_allclose(from_views(over(rgba, 1.0), over(rgba, 0.0)), rgba, atol=1e-6)


def clear_scene(count, seed, **options):
    scene = random_scene(count, seed=seed, **options)
    return scene.replace(transparent=True, background=np.ones(3))


def test_gradient_over_both_backdrops_is_that_of_the_reference(cut_out):
    pytest.importorskip("torch")
    from gauss2svg.render.reference import render_reference

    rgba = shrunk(pixels_of(cut_out), 30, 40)
    scene = clear_scene(4, 3, beta=(1.0, 4.0))
    scene = scene.replace(opacity=0.2 + 0.6 * scene.opacity, color=0.1 + 0.8 * scene.color)
    target, splats = target_of(rgba, np.float64, "psnr"), splats_of(scene)
    gradient = gradients(target.evaluate(splats, "mse", None).moments, splats)
    by_mean = np.linalg.solve(np.swapaxes(scene.factor, 1, 2), gradient[:, :2, None])[:, :, 0]
    by_opacity = gradient[:, 5] / (scene.opacity * (1 - scene.opacity))

    def loss(name, at, step):
        """Half the weighted squared error over white and over black, by the reference."""
        values, total = getattr(scene, name).copy(), 0.0
        values[at] += step
        for backdrop in BACKDROPS:
            moved = scene.replace(**{name: values}, background=np.full(3, backdrop))
            error = render_reference(moved).numpy() - over(rgba, backdrop)
            total += 0.5 * float(np.sum(target.weight[:, :, None] * np.square(error)))
        return total

    for name, found in (("opacity", by_opacity), ("color", gradient[:, 6:9]), ("mean", by_mean)):
        for at in np.ndindex(found.shape):
            slope = (loss(name, at, 1e-5) - loss(name, at, -1e-5)) / 2e-5
            assert found[at] == pytest.approx(slope, rel=2e-3, abs=2e-4), (name, at)


@pytest.mark.parametrize("loss", choices("loss")[1:])
def test_gradients_of_other_losses_are_over_both_backdrops(cut_out, loss):
    step = 1e-6
    target = target_of(shrunk(pixels_of(cut_out), 24, 24), np.float64, "psnr")
    splats = splats_of(clear_scene(5, 1, width=24, height=24))

    def evaluated(i, c, by):
        moved = splats.opacity_color.copy()
        moved[i, 1 + c] += by
        return target.evaluate(splats._replace(opacity_color=moved), loss, 0.5)

    for i, c in np.ndindex(5, 3):
        slope = (evaluated(i, c, step).loss - evaluated(i, c, -step).loss) / (2 * step)
        moments = evaluated(i, c, 0).moments
        assert moments[i, 6 + c] == pytest.approx(slope, rel=1e-3, abs=1e-3)


def test_removal_costs_what_the_error_over_both_backdrops_grows_by(cut_out):
    target = target_of(shrunk(pixels_of(cut_out), 48, 48), np.float64, "psnr")
    scene = clear_scene(9, 2, width=48, height=48)
    before = target.squares(splats_of(scene))[0]
    rendered, cost = target.removal_cost(splats_of(scene))
    errors = np.square(rendered - target.planar) * target.weight
    assert before == pytest.approx(errors.sum(), rel=1e-9)
    for i in range(9):
        without = target.squares(splats_of(scene.select(np.arange(9) != i)))[0]
        assert cost[i, 0] == pytest.approx(without - before, abs=1e-6)


@pytest.mark.parametrize("placement", choices("init"))
def test_new_gaussians_are_placed_on_visible_pixels_in_visible_colours(placement):
    rgba = np.dstack([np.full((40, 60, 3), [1.0, 0.0, 1.0]), np.zeros((40, 60))])
    rgba[10:30, 20:40] = [0.0, 0.5, 0.25, 0.6]
    target = target_of(rgba, np.float32, "psnr")
    spot = {"color": [[0, 0, 0]], "opacity": [0.9]}  # where nothing should be
    far = Scene(60, 40, mean=[[52, 34]], sigma=[[3, 3]], rho=[0], transparent=True, **spot)
    rendered = target.rendered(splats_of(far))
    new = place(placement, target, rendered, 30, 30, np.random.default_rng(0))
    x, y = new.mean.T
    assert ((x >= 19) & (x <= 41) & (y >= 9) & (y <= 31)).all()
    np.testing.assert_allclose(new.color, np.tile([0.0, 0.5, 0.25], (30, 1)), atol=1e-6)


def test_new_gaussians_go_where_alpha_is_too_low_and_not_where_it_is_too_high():
    target = target_of(np.full((32, 64, 4), 0.5), np.float32, "psnr")
    covered = np.where(np.arange(64) < 32, 0.8, 0.2) * np.ones((32, 1))
    rendered = np.concatenate([[0.5 * covered + (1 - covered) * b] * 3 for b in BACKDROPS])
    errors = np.square(target.planar - rendered).sum(axis=0)
    assert errors[:, :32].sum() == pytest.approx(errors[:, 32:].sum(), rel=1e-4)
    rng = np.random.default_rng(0)
    new = place("error", target, rendered.astype(np.float32), 100, 100, rng)
    assert (new.mean[:, 0] > 32).mean() > 0.85


def test_mattes_are_colours_and_others_are_refused():
    for text, color in {"white": (1, 1, 1), "Black": (0, 0, 0), "#369": (0.2, 0.4, 0.6)}.items():
        assert matte_color(text) == pytest.approx(color)
    for text in ("", "glass", "#12", "#12345", "#ggg", "rgb(1,2,3)", "#fff "):
        with pytest.raises(InputError, match="white, black"):
            matte_color(text)


def test_every_renderer_draws_glass_as_glass_and_the_file_transparent_where_the_photo_is(
    renderer, result, cut_out
):
    drawn = rasterize_rgba(GLASS, 40, 30, renderer)
    np.testing.assert_allclose(drawn[5, 5], [0, 0x88 / 255, 1, 1], atol=0.006)
    np.testing.assert_allclose(drawn[20, 10], [1, 0x88 / 255, 0, 0.5], atol=0.006)
    assert drawn[5, 30, 3] == 0
    np.testing.assert_allclose(over(drawn), rasterize(GLASS, 40, 30, renderer), atol=0.006)
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
    svg = [report[key] for key in ("psnr_svg", "psnr_svg_black", "psnr_svg_alpha")]
    assert svg == pytest.approx(psnrs(result.raster, cut_out), abs=1e-4)
    model = [report[key] for key in ("psnr_model", "psnr_model_black", "psnr_model_alpha")]
    assert model == pytest.approx(svg, abs=0.5)
    checked = gauss2svg.check(cut_out, result.svg)
    for key in ("psnr_svg", "psnr_svg_black", "psnr_svg_alpha", "ssim_svg", "transparent"):
        assert checked.report[key] == pytest.approx(report[key], abs=1e-4), key
    over_black = gauss2svg.check(cut_out, result.svg, matte="black")
    assert over_black.psnr_black is over_black.report["psnr_svg_alpha"] is None
    assert over_black.psnr < 15  # the SVG is composited over white


def test_opaque_alpha_is_no_alpha_and_colours_of_invisible_pixels_change_nothing(cut_out, result):
    opaque, other = cut_out.copy(), cut_out.copy()
    opaque[:, :, 3] = 255
    one, same = (vectorize(pixels, **QUICK) for pixels in (opaque, opaque[:, :, :3]))
    assert one.svg == same.svg
    assert one.raster.shape == (64, 64, 3)
    assert one.report["psnr_svg_black"] is one.report["psnr_model_alpha"] is None
    other[cut_out[:, :, 3] == 0, :3] = [255, 0, 255]
    assert vectorize(other, **QUICK).svg == result.svg


def test_matte_flattens_before_anything_else(cut_out):
    alpha = pixels_of(cut_out)[:, :, 3:]
    backdrop = np.float32(matte_color("#204060"))
    flat = pixels_of(cut_out)[:, :, :3] * alpha + (1 - alpha) * backdrop
    one = vectorize(cut_out, matte="#204060", **QUICK)
    assert one.svg == vectorize(flat, **QUICK).svg
    assert one.report["matte"] == "#204060"


def test_invisible_photo_is_an_empty_file():
    clear = np.full((20, 30, 4), [200, 10, 10, 0], np.uint8)
    for options in ({}, {"gaussians": 20}, {"target_psnr": 40}):
        result = vectorize(clear, **options)
        assert (rasterize_rgba(result.svg, 30, 20)[:, :, 3] == 0).all()
        assert result.report["psnr_svg"] is result.report["psnr_svg_alpha"] is None
        assert result.report["gaussians"] == 0


def test_target_holds_over_both_backdrops(cut_out):
    report = vectorize(cut_out, target_psnr=27, quality="fast").report
    assert report["stop_reason"] == "target_psnr"
    assert min(report["psnr_svg"], report["psnr_svg_black"]) >= 26.95


ROUNDING = {np.float32: 6e-5, np.float64: 3e-7}  # of two renders, and of the float32 result
in_both = pytest.mark.parametrize("dtype", ROUNDING, ids=["float32", "float64"])
clear_scenes = extreme_scenes().map(lambda scene: scene.replace(transparent=True))
SVG = "{http://www.w3.org/2000/svg}"


@in_both
@given(clear_scenes, st.floats(0, 1))
def test_over_any_backdrop_it_is_the_scene_on_that_background(dtype, scene, level):
    pytest.importorskip("torch")
    from gauss2svg.render.reference import render_reference

    rgba, allowed = render_rgba(scene, dtype=dtype), ROUNDING[dtype] + 2 * rounding_of(scene)
    assert np.isfinite(rgba).all()
    assert 0 <= rgba.min() <= rgba.max() <= 1
    assert (rgba[rgba[:, :, 3] == 0] == 0).all()  # nothing has no colour
    color, alpha = rgba[:, :, :3].astype(np.float64), rgba[:, :, 3:].astype(np.float64)
    for backdrop in (*BACKDROPS, level):
        other = scene.replace(background=np.full(3, backdrop))
        assert render_rgba(other, dtype=dtype).tobytes() == rgba.tobytes()
        for expected in (render(other, dtype=dtype), render_reference(other).numpy()):
            np.testing.assert_allclose(
                color * alpha + (1 - alpha) * backdrop, expected, atol=allowed
            )


@given(extreme_scenes(betas=(1.0, 1.0, 1.7, 6.0, 64.0)), st.sampled_from([0, 6]))
def test_its_file_has_no_background_and_is_read_back_transparent(scene, palette):
    scene = quantize(scene, palette=palette)
    try:
        opaque = write_svg(scene)
    except SceneError:
        with pytest.raises(SceneError):
            write_svg(scene.replace(transparent=True))
        return
    text = write_svg(scene.replace(transparent=True))
    before, after = (ElementTree.fromstring(one.encode()) for one in (opaque, text))
    assert len(list(before.iter(SVG + "rect"))) == 1
    assert not list(after.iter(SVG + "rect"))
    shapes = [[e.attrib for e in root.iter(SVG + "circle")] for root in (before, after)]
    assert shapes[0] == shapes[1]
    back, same = read_svg(text), read_svg(opaque)
    assert back.transparent
    assert not same.transparent
    for name in ("mean", "sigma", "rho", "color", "opacity", "beta"):
        assert getattr(back, name).tobytes() == getattr(same, name).tobytes()


@pytest.mark.sweep
def test_the_command_writes_a_transparent_preview_and_says_all_three(cut_out, tmp_path, capsys):
    photo, out, seen, written = (tmp_path / name for name in ("i.png", "o.svg", "p.png", "r"))
    Image.fromarray(cut_out).save(photo)
    for words in ([photo, "-o", out, "--gaussians", "60"], ["check", photo, out]):
        assert main([*map(str, words), "--preview", str(seen), "--report", str(written)]) == 0
        said, report = " ".join(capsys.readouterr().err.split()), json.loads(written.read_text())
        for key, where in (("black", "over black"), ("alpha", "of alpha")):
            assert f"{report[f'psnr_svg_{key}']:.2f} dB {where}" in said
        with Image.open(seen) as picture:
            assert picture.getpixel((0, 0))[3] == 0
