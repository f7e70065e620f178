"""Laws of the finish: what renderers draw comes nearer to the photo, and nothing else changes."""

import dataclasses

import numpy as np
import pytest
from conftest import random_scene
from hypothesis import given, settings
from hypothesis import strategies as st

from gauss2svg import finish as finish_module
from gauss2svg import metrics, vectorize
from gauss2svg.errors import InputError, RendererError
from gauss2svg.falloff import cut_radius
from gauss2svg.finish import ALL, FINISHES, claimed, finished, renderers_of
from gauss2svg.raster import chromium, rasterize
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.svg import Page, SvgOptions, write_svg
from gauss2svg.svg.layers import arranged, segment_of

OPTIONS = SvgOptions(palette=0)


@pytest.fixture(autouse=True)
def _few_drawings(monkeypatch):
    monkeypatch.setattr(finish_module, "_DRAWINGS", 9)


@pytest.fixture(scope="module")
def fitted(photo) -> Scene:
    return vectorize(photo, gaussians=400, iterations=80).scene


def drawn(scene, photo, renderer="resvg", page=None, options=OPTIONS):
    height, width = photo.shape[:2]
    return metrics.psnr(rasterize(write_svg(scene, options, page), width, height, renderer), photo)


def claimed_slowly(scene: Scene, order, height: int, width: int):
    """The same, one pixel and one shape at a time."""
    owner = np.full((height, width), -1)
    y, x = np.indices((height, width)) + 0.5
    for i in order:
        radius = min(float(cut_radius(scene.betas[i])), 1.7)
        if np.pi * radius**2 * scene.ellipse_axes[0][i].prod() > max(0.005 * height * width, 1):
            continue
        u, v = x - scene.mean[i, 0], y - scene.mean[i, 1]
        across, a, b = scene.whitening[i]
        mine = (across * u) ** 2 + (a * u + b * v) ** 2 < (radius + 0.3) ** 2
        # no further than the ellipse's box and 0.3 px more, by whole pixels
        reach = radius * np.sqrt(np.diagonal(scene.covariance[i])) + 0.3
        left, top = np.maximum(np.trunc(scene.mean[i] - reach), 0)
        right, bottom = np.trunc(scene.mean[i] + reach)
        mine &= (x > left) & (x < right + 1) & (y > top) & (y < bottom + 1)
        if (owner[mine] == -1).all():
            owner[mine] = i
    return owner


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_pixels_are_claimed_as_by_the_slow_twin(seed):
    scene = random_scene(60, 70, 50, seed, (0.3, 4))
    order = np.random.default_rng(seed).permutation(60)
    owner = claimed(scene, order, 50, 70)
    np.testing.assert_array_equal(owner, claimed_slowly(scene, order, 50, 70))


@pytest.mark.parametrize("renderer", ["resvg", "cairo"])
def test_drawn_picture_comes_nearer_and_gains_are_those_of_the_file(renderer, fitted, photo):
    finish = finished(fitted, OPTIONS, Page(), photo, renderer)
    before, after = finish.gains[renderer]
    assert before == pytest.approx(drawn(fitted, photo, renderer), abs=1e-4)
    assert after == pytest.approx(drawn(finish.scene, photo, renderer), abs=1e-4)
    assert after > before + 0.01
    assert finish.drawings <= 10


def test_colours_exponents_and_order_stay_and_nothing_gets_too_thin(fitted, photo):
    scene = finished(fitted, OPTIONS, Page(), photo, "resvg").scene
    for name in ("color", "betas", "rounds", "background"):
        np.testing.assert_array_equal(getattr(scene, name), getattr(fitted, name))
    assert np.abs(scene.mean - fitted.mean).max() < 2
    assert not (scene.mean == fitted.mean).all()
    thin = scene.ellipse_axes[0][:, 1]
    assert (thin >= np.minimum(0.35, fitted.ellipse_axes[0][:, 1]) - 1e-9).all()
    opaque = fitted.opacity >= 0.97
    np.testing.assert_array_equal(scene.opacity[opaque], fitted.opacity[opaque])


def test_same_scene_gives_the_same_finish(fitted, photo, monkeypatch):
    monkeypatch.setattr(finish_module, "_DRAWINGS", 3)
    one, same = (finished(fitted, OPTIONS, Page(), photo, "resvg").scene for _ in range(2))
    np.testing.assert_array_equal(one.mean, same.mean)
    np.testing.assert_array_equal(one.opacity, same.opacity)


def test_steps_promise_what_the_error_of_the_model_falls_by(fitted, photo):
    missed = render(fitted) - photo
    steps = finish_module._steps(fitted, missed[None], [fitted.background], OPTIONS)

    def error(scene):
        return 0.5 * np.sum(np.square(render(scene, dtype=np.float64) - photo))

    before, told = error(fitted), []
    for i in range(0, 400, 9):
        for kind in range(3):
            if kind == 2 and not steps.fade[i]:
                continue
            small = dataclasses.replace(
                steps, shift=steps.shift / 10, stretch=steps.stretch / 10, fade=steps.fade / 10
            )
            tried = finish_module._changed(fitted, small, np.array([i]), np.full(400, kind))
            if tried.ellipse_axes[0][i, 1] != fitted.ellipse_axes[0][i, 1] or kind != 1:
                told.append((steps.gain[i, kind], 10 * (before - error(tried))))
    promised, kept = np.array(told).T
    assert len(promised) > 60
    assert (promised >= 0).all()
    assert np.corrcoef(promised, kept)[0, 1] > 0.98
    assert np.polyfit(promised, kept, 1)[0] == pytest.approx(1, abs=0.15)


def test_scene_is_returned_as_it_was_where_nothing_is_gained(fitted, photo, monkeypatch):
    def undone(scene, *_):  # every change is for the worse
        return scene.replace(opacity=np.full(len(scene), 0.5))

    monkeypatch.setattr(finish_module, "_changed", undone)
    monkeypatch.setattr(finish_module, "_with", lambda scene, tried, kept: tried)
    finish = finished(fitted, OPTIONS, Page(), photo, "resvg")
    assert finish.scene is fitted
    assert finish.gains["resvg"][0] == finish.gains["resvg"][1]


def test_segments_and_with_them_the_order_of_the_file_stay(fitted, photo):
    labels = np.arange(128 * 128).reshape(128, 128)  # every pixel: many would move out of theirs
    page, scene = Page(segments=labels), arranged(fitted, labels)
    finish = finished(scene, OPTIONS, page, photo, "resvg")
    np.testing.assert_array_equal(segment_of(finish.scene, labels), segment_of(scene, labels))
    assert finish.gains["resvg"][1] == pytest.approx(
        drawn(finish.scene, photo, page=page), abs=1e-4
    )


def test_report_tells_the_finish_and_bytes_stay_within_their_limit(photo):
    result = vectorize(photo, max_bytes=30_000, iterations=60, finish="resvg")
    report = result.report
    assert len(result.svg.encode()) == report["svg_bytes"] <= 30_000
    assert report["finish"] == "resvg"
    assert report["finish_drawings"] > 2
    before, after = report["finish_gains"]["resvg"]
    assert after > before
    assert report["psnr_svg"] == pytest.approx(after, abs=1e-4)
    plain = vectorize(photo, gaussians=0).report
    assert (plain["finish"], plain["finish_drawings"], plain["finish_gains"]) == (None,) * 3


@pytest.mark.parametrize("count", [0, 1])
def test_hardly_any_shapes_can_be_finished(count, photo):
    result = vectorize(photo, gaussians=count, iterations=5, finish="resvg")
    assert len(result.scene) == count
    before, after = result.report["finish_gains"]["resvg"]
    assert after >= before


def test_finish_for_all_gains_in_sum(fitted, photo, monkeypatch, browser):
    monkeypatch.setattr(finish_module, "_DRAWINGS", 4)
    gains = finished(fitted, OPTIONS, Page(), photo, ALL).gains
    assert tuple(gains) == renderers_of(ALL) == FINISHES[:-1]
    before, after = (sum(10 ** (-gain[k] / 10) for gain in gains.values()) for k in (0, 1))
    assert after < before


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"finish": "librsvg"}, "needed is one of resvg, cairo, chromium, all"),
        ({"finish": "resvg", "time_limit": 3}, "give --iterations in place"),
    ],
)
def test_finish_that_cannot_be_is_refused(wrong, message, photo):
    with pytest.raises(InputError, match=message):
        vectorize(photo, **wrong)


@pytest.mark.parametrize("finish", ["chromium", ALL])
def test_finish_needs_its_renderers_before_the_fit(finish, photo, monkeypatch):
    monkeypatch.setenv(chromium.PROGRAM_VARIABLE, "/nowhere")
    steps = []
    with pytest.raises(RendererError, match=r"nowhere|Playwright"):
        vectorize(photo, finish=finish, progress=steps.append)
    assert not steps


def test_finish_does_not_draw_a_form_by_those_who_cannot(photo, browser):
    with pytest.raises(RendererError, match=r"finish all draws by resvg.*--finish chromium"):
        vectorize(photo, form="blur", renderer="chromium", finish=ALL)


def test_finish_of_a_coarse_file_moves_by_its_unit(fitted, photo):
    options = dataclasses.replace(OPTIONS, precision=0.25)
    finish = finished(fitted, options, Page(), photo, "resvg")
    assert finish.gains["resvg"][1] > finish.gains["resvg"][0] + 0.02
    assert (np.hypot(*(finish.scene.mean - fitted.mean).T) > 0.2).any()
