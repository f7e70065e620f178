"""Transparent photos: how they are fitted, the file, its rasters, the report and the check."""

import numpy as np
import pytest
from flat import choices, vectorize
from hypothesis import given
from hypothesis import strategies as st
from scenes import extreme_scenes, random_areas, random_scene, rounding_of

import gauss2svg
from gauss2svg.fit.target import Target
from gauss2svg.measure import metrics
from gauss2svg.photo.pixels import BACKDROPS, BLACK, over, shrunk
from gauss2svg.raster import BROWSERS, rasterize
from gauss2svg.render import render, render_rgba
from gauss2svg.render.cpu import splats_of
from gauss2svg.scene import Scene

QUICK = {"gaussians": 150, "iterations": 80}
FEW = {"gaussians": 20, "iterations": 8}  # where two files are to be equal
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


def clear_scene(count, seed, **options):
    scene = random_scene(count, seed=seed, **options)
    return scene.replace(transparent=True, background=np.ones(3))


@pytest.mark.parametrize("loss", choices("loss"))
def test_gradient_over_both_backdrops_is_that_of_finite_differences(loss, cut_out):
    rgba, rng = shrunk(pixels_of(cut_out), 24, 24), np.random.default_rng(0)
    ground = Scene(24, 24, areas=random_areas(5, 6, (24, 24)))
    target = Target(rgba.astype(np.float64), "psnr", ground=ground)
    scene = clear_scene(5, 1, width=24, height=24, beta=(1.0, 4.0))
    scene = scene.replace(opacity=0.2 + 0.6 * scene.opacity, color=0.1 + 0.8 * scene.color)
    way = {
        name: rng.normal(size=getattr(scene, name).shape) for name in ("mean", "opacity", "color")
    }

    def value(step):
        moved = {name: getattr(scene, name) + step * by for name, by in way.items()}
        splats = splats_of(scene.replace(**moved))
        if loss == "mse":  # of which `evaluate` tells the value without the weight
            return target.weighted_squares(target.rendered(splats)) / 2
        return target.evaluate(splats, loss).loss

    moments = target.evaluate(splats_of(scene), loss).moments
    slopes = {
        "mean": np.linalg.solve(np.swapaxes(scene.factor, 1, 2), moments[:, :2, None])[:, :, 0],
        "opacity": moments[:, 5] / scene.opacity,
        "color": moments[:, 6:9],
    }
    expected = (value(1e-6) - value(-1e-6)) / 2e-6
    slope = sum(np.sum(slopes[name] * by) for name, by in way.items())
    assert slope == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("areas", [0, 5])
def test_losses_and_removal_costs_are_of_the_errors_over_white_and_over_black(areas, cut_out):
    rgba = shrunk(pixels_of(cut_out), 30, 40)
    scene = clear_scene(9, 2).replace(areas=random_areas(areas, 6))
    ground = scene.select([]) if areas else None
    target, splats = Target(rgba.astype(np.float64), "psnr", ground=ground), splats_of(scene)
    drawn = [render(scene.replace(background=np.full(3, b)), dtype=np.float64) for b in BACKDROPS]
    errors = [one - over(rgba, b) for one, b in zip(drawn, BACKDROPS, strict=True)]
    squares = np.sum(np.square(errors) * target.weight[:, :, None])
    before = target.weighted_squares(target.rendered(splats))
    rendered, cost = target.removal_cost(splats)
    assert before == pytest.approx(squares, rel=1e-6)
    assert before == pytest.approx(target.weighted_squares(rendered), rel=1e-9)
    for i in range(9):
        others = splats_of(scene.select(np.arange(9) != i))
        without = target.weighted_squares(target.rendered(others))
        assert cost[i, 0] == pytest.approx(without - before, abs=1e-6)


def test_every_renderer_draws_glass_as_glass_and_the_file_transparent_where_the_photo_is(
    renderer, result, cut_out
):
    drawn = rasterize(GLASS, 40, 30, renderer, alpha=True)
    np.testing.assert_allclose(drawn[5, 5], [0, 0x88 / 255, 1, 1], atol=0.006)
    np.testing.assert_allclose(drawn[20, 10], [1, 0x88 / 255, 0, 0.5], atol=0.006)
    assert drawn[5, 30, 3] == 0
    if renderer not in BROWSERS:  # test_renderers draws their white pages
        np.testing.assert_allclose(over(drawn), rasterize(GLASS, 40, 30, renderer), atol=0.006)
    drawn = rasterize(result.svg, 64, 64, renderer, alpha=True)
    white, black, alpha = psnrs(drawn, cut_out)
    assert min(white, black) > 27
    assert alpha > 32
    y, x = np.mgrid[:64, :64]
    distance = np.hypot(x - 31.5, y - 31.5)
    assert drawn[distance > 32, 3].mean() < 0.004
    assert drawn[distance < 23, 3].mean() > 0.99


def test_report_has_the_numbers_of_the_raster(result, cut_out, drawn_here):
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
    assert over_black.report["psnr_svg_black"] is over_black.report["psnr_svg_alpha"] is None
    assert over_black.report["psnr_svg"] < 15  # the SVG is composited over white


def test_opaque_alpha_is_no_alpha_and_colours_of_invisible_pixels_change_nothing(cut_out):
    opaque, other = cut_out.copy(), cut_out.copy()
    opaque[:, :, 3] = 255
    one, same = (vectorize(pixels, **FEW) for pixels in (opaque, opaque[:, :, :3]))
    assert one.svg == same.svg
    assert one.raster.shape == (64, 64, 3)
    assert one.report["psnr_svg_black"] is one.report["psnr_model_alpha"] is None
    other[cut_out[:, :, 3] == 0, :3] = [255, 0, 255]
    assert vectorize(other, **FEW).svg == vectorize(cut_out, **FEW).svg


ROUNDING = {np.float32: 6e-5, np.float64: 3e-7}  # of two renders, and of the float32 result


@pytest.mark.parametrize("dtype", ROUNDING, ids=["float32", "float64"])
@given(extreme_scenes().map(lambda scene: scene.replace(transparent=True)), st.floats(0, 1))
def test_over_any_backdrop_it_is_the_scene_on_that_background(dtype, scene, level):
    rgba, allowed = render_rgba(scene, dtype=dtype), ROUNDING[dtype] + 2 * rounding_of(scene)
    assert np.isfinite(rgba).all()
    assert 0 <= rgba.min() <= rgba.max() <= 1
    assert (rgba[rgba[:, :, 3] == 0] == 0).all()  # nothing has no colour
    color, alpha = rgba[:, :, :3].astype(np.float64), rgba[:, :, 3:].astype(np.float64)
    for backdrop in (*BACKDROPS, level):
        other = scene.replace(background=np.full(3, backdrop))
        assert render_rgba(other, dtype=dtype).tobytes() == rgba.tobytes()
        composited = color * alpha + (1 - alpha) * backdrop
        np.testing.assert_allclose(composited, render(other, dtype=dtype), atol=allowed)
