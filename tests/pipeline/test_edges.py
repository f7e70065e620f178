"""Edges of drawings: the files of presets stay crisp when they are enlarged."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from skimage import data

from gauss2svg import vectorize
from gauss2svg.measure.metrics import psnr
from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.photo.pixels import shrunk
from gauss2svg.pipeline import plan as plans
from gauss2svg.pipeline.budgets import TimeBudget
from gauss2svg.pipeline.export import Exporter
from gauss2svg.pipeline.limits import Limits
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.outcome import Subject
from gauss2svg.pipeline.plan import Plan
from gauss2svg.raster import rasterize
from gauss2svg.scene import PLAIN, SOFT, Scene
from gauss2svg.scene.falloff import half_radius
from gauss2svg.svg.forms import with_plain_edges

SIDE, UP = 64, 4


def badge():
    """A disc, a bar and a ring of flat colours, 256 px wide."""
    y, x = np.mgrid[: SIDE * UP, : SIDE * UP] / UP + 0.5 / UP
    picture = np.full((*x.shape, 3), 0.95, np.float32)
    picture[np.hypot(x - 24, y - 26) < 17] = 0.1, 0.3, 0.7
    picture[(np.abs(x - y - 20) < 4) & (x + y < 100)] = 0.9, 0.2, 0.1
    picture[np.abs(np.hypot(x - 44, y - 44) - 11) < 3] = 0.1, 0.6, 0.3
    return picture


def covering(picture, **options):
    return Plan(Options().changed(**options)).for_picture(picture).covering


def test_the_files_of_drawings_are_closer_and_crisper_when_they_are_enlarged(monkeypatch):
    drawings = [badge(), badge()[::-1], badge()[:, ::-1], np.rot90(badge())]
    colors = np.unique(badge().reshape(-1, 3), axis=0)

    def scores(truth):
        """PSNR of the enlarged file, and the share of its pixels that have none of the colours."""
        raster = rasterize(vectorize(shrunk(truth, SIDE, SIDE)).svg, SIDE * UP, SIDE * UP)
        distance = np.abs(raster[:, :, None] - colors).max(axis=3).min(axis=2)
        return psnr(raster, truth), (distance > 0.1).mean()

    crisp = np.mean([scores(truth) for truth in drawings], axis=0)
    monkeypatch.setattr(plans, "has_edges", lambda _: False)
    soft = np.mean([scores(truth) for truth in drawings], axis=0)
    # Over five CPUs one drawing gains 0.3 to 2.5 dB, the mean 1.0 to 1.8.
    assert crisp[0] > soft[0] + 0.5
    assert crisp[1] < 0.7 * soft[1]  # 0.38 to 0.47 of it


def test_edges_are_those_of_antialiased_drawings_that_a_preset_decides_about():
    truth = badge()
    photo = shrunk(truth, SIDE, SIDE)
    noise = np.random.default_rng(1).random((SIDE, SIDE, 3)).astype(np.float32)
    assert covering(photo)
    assert not covering(truth)  # whole pixels
    assert not covering(noise)


@pytest.mark.parametrize("name", ["astronaut", "chelsea", "coffee", "rocket"])
@pytest.mark.parametrize("is_cut_out", [False, True])
def test_a_photo_on_a_flat_ground_is_no_drawing(name, is_cut_out):
    photo = shrunk(getattr(data, name)().astype(np.float32) / 255, 120, 120)
    y, x = np.mgrid[:120, :120] - 59.5
    alpha = np.clip(45.5 - np.hypot(x, y), 0, 1)[:, :, None].astype(np.float32)
    on_white = 1 - alpha * (1 - photo)
    assert not covering(np.dstack([photo, alpha]) if is_cut_out else on_white)
    assert covering(1 - alpha * (1 - shrunk(badge(), 120, 120)))


@pytest.mark.parametrize(
    "given",
    [
        {"gaussians": 50},
        {"gaussians": 50, "time_limit": 9},
        {"gaussians": 50, "max_bytes": 90_000},
        {"target_psnr": 30},
        {"target_psnr": 30, "quality": "high"},
        {"max_bytes": 5000},
        {"time_limit": 2},
        {"falloff": "gaussian"},
        {"blend": "add"},
        {"blend": "add", "portable": True, "falloff": "adaptive"},
        {"form": "blur", "renderer": "chromium"},
        {"inks": "#fff,#000"},
    ],
)
def test_what_asks_for_the_picture_at_its_size_or_another_model_keeps_its_falloffs(given):
    assert not covering(shrunk(badge(), SIDE, SIDE), **given)


@pytest.mark.parametrize("limit", [{"max_bytes": 90_000}, {"time_limit": 9}])
def test_a_preset_with_a_limit_has_the_edges_of_the_preset(limit):
    assert covering(shrunk(badge(), SIDE, SIDE), quality="high", **limit)


def of_one(beta, minor, drawn=SOFT):
    """A shape three times as long as wide."""
    a = np.array
    return Scene(
        90, 90, a([[40.0, 50.0]]), a([[3 * minor, minor]]), a([0.0]), a([[0.2, 0.4, 0.6]]),
        a([1.0]), beta=a([beta]), drawn=a([drawn]),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("beta", "minor", "drawn"),
    [
        (4.0, 1.5, PLAIN),  # a rim of .8 px
        (4.0, 4.0, SOFT),  # of 2.2 px
        (1.0, 4.0, SOFT),
        (40.0, 0.8, PLAIN),  # drawn as an ellipse anyway
        (2.0, 0.4, SOFT),  # under a pixel to its edge
    ],
)
def test_crisp_shapes_that_are_wide_enough_become_ellipses(beta, minor, drawn):
    before = of_one(beta, minor)
    after = with_plain_edges(before)
    assert after.drawn.tolist() == [drawn]
    if drawn == SOFT:
        assert (after.beta, after.sigma.tolist()) == (before.beta, before.sigma.tolist())
    else:
        contours = [scene.sigma * half_radius(scene.beta)[:, None] for scene in (before, after)]
        np.testing.assert_allclose(*contours, rtol=1e-6)
        assert with_plain_edges(after).drawn.tolist() == [PLAIN]
    assert with_plain_edges(of_one(beta, minor, PLAIN)).drawn.tolist() == [PLAIN]


def test_count_grows_little_after_the_first_fit_and_says_that_it_would_gain_too_little():
    plan = Plan(Options().changed(quality="high"))
    export = SimpleNamespace(scene=range(100), size=1000, score=plan.stop_psnr - 6)
    wanted = {}
    for is_covering in (True, False):
        of_edges = dataclasses.replace(plan, has_edges=is_covering)
        exporter = Exporter(of_edges, Subject.of(badge()))
        limits = Limits(of_edges, exporter, TimeBudget(), 10**5)
        limits.stop_reason, limits.slope = "enough", 6.0
        wanted[is_covering] = limits.corrected(100, [export]), limits.stop_reason  # pyright: ignore[reportArgumentType]
    assert wanted == {True: (140, "gain"), False: (200, "enough")}


def test_numbers_of_the_report_are_those_of_what_was_fitted_and_of_the_file():
    photo = shrunk(badge(), SIDE, SIDE)
    result = vectorize(photo)
    report = result.report
    by_area, at_centres = (
        round_trip(result.svg, result.scene, photo, covering=covers) for covers in (True, False)
    )
    assert report["psnr_svg"] == pytest.approx(by_area.psnr_svg)
    assert report["psnr_roundtrip"] == pytest.approx(by_area.psnr_roundtrip)
    assert report["psnr_model"] == pytest.approx(by_area.psnr_model)
    assert by_area.psnr_roundtrip > at_centres.psnr_roundtrip  # by 2.3 to 4.3 dB over CPUs


def test_a_count_is_corrected_by_what_the_file_shows():
    photo = shrunk(badge(), SIDE, SIDE)
    scene = vectorize(photo, gaussians=20).scene
    for plan in (Plan(Options()), Plan(Options()).for_picture(photo)):
        export = Exporter(plan, Subject.of(photo)).export(scene)
        drawn = psnr(rasterize(export.svg, SIDE, SIDE), photo)
        assert (export.score == pytest.approx(drawn)) == plan.covering
