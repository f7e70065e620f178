"""Properties of fits in inks: their colours alone, crisp and opaque, in fit, file and raster."""

import numpy as np
import pytest
from conftest import random_scene
from flat import fit_config, vectorize
from scipy.ndimage import maximum_filter, minimum_filter

from gauss2svg.errors import InputError
from gauss2svg.fit.colors import Inks
from gauss2svg.fit.population import Population
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.state import State
from gauss2svg.fit.target import target_of
from gauss2svg.measure import metrics
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene.inks import ink_colors
from gauss2svg.svg.read import read_svg

INKS = "#f7c306,#c0322c,#17324d"


@pytest.fixture(scope="module")
def picture():
    """Yellow with a red disc and a blue bar, antialiased, and some noise."""
    y, x = np.mgrid[:256, :320] / 4
    entry = np.where(np.hypot(x - 30, y - 30) < 18, 1, np.where(np.abs(y - 52) < 5, 2, 0))
    fine = ink_colors(INKS)[entry]
    pixels = fine.reshape(64, 4, 80, 4, 3).mean(axis=(1, 3))
    noise = np.random.default_rng(1).normal(0, 0.02, pixels.shape)
    return np.clip(pixels + noise, 0, 1).astype(np.float32)


def inks_seen(raster) -> set:
    """Colours of the pixels that are as their neighbours."""
    levels = np.round(raster * 255).astype(int)
    flat = maximum_filter(levels, (3, 3, 1)) == minimum_filter(levels, (3, 3, 1))
    return {"#" + bytes(c.tolist()).hex() for c in levels[flat.all(axis=2)]}


@pytest.mark.parametrize("markup", ["editable", "minimal"])
def test_file_and_raster_have_no_other_colour_and_are_close(markup, picture):
    result = vectorize(picture, gaussians=40, iterations=150, inks=INKS, markup=markup)
    assert inks_seen(rasterize(result.svg, 480, 384)) <= set(INKS.split(","))
    assert metrics.psnr(rasterize(result.svg, 80, 64), picture) > 25
    assert "Gradient" not in result.svg
    assert "opacity" not in result.svg
    assert result.report["inks"] == INKS
    np.testing.assert_array_equal(read_svg(result.svg).inks, result.scene.inks)
    changes = (np.diff(result.scene.color, axis=0) != 0).any(axis=1)
    assert changes.sum() == result.scene.round_index[-1]


def test_number_of_inks_is_chosen_for_the_picture(picture):
    result = vectorize(picture, gaussians=20, iterations=20, inks=3)
    chosen = ink_colors(result.report["inks"])
    distance = np.abs(chosen[:, None] - ink_colors(INKS)).max(axis=2).min(axis=1)
    assert distance.max() < 0.1
    assert {tuple(c) for c in result.scene.inks} == {tuple(c) for c in chosen}


def test_bytes_and_psnr_are_held(picture):
    small = vectorize(picture, max_bytes=1500, inks=INKS)
    assert len(small.svg) <= 1500
    assert small.scene.inks is not None
    aimed = vectorize(picture, target_psnr=24, inks=INKS)
    assert not aimed.report["unreached"]
    assert aimed.report["psnr_svg"] > 23.9


def test_inks_that_are_seen_nowhere_are_named(picture):
    result = vectorize(picture, gaussians=20, iterations=20, inks=f"#00ff00,#ff00ff,{INKS}")
    said = "not used: #00ff00, #ff00ff of the inks"
    assert any(note.startswith(said) for note in result.report["notes"])


def test_progress_has_decibels_against_the_picture_not_against_its_inks(picture):
    inks, seen = INKS.split(",", 1)[1], []  # without the yellow of the most pixels

    def look(now) -> None:
        raster = render(now.scene())
        seen.append((now.psnr, metrics.psnr(raster, picture)))

    config = fit_config(gaussians=30, iterations=30, inks=inks)
    FitSession(picture, config, progress=look).fit()
    said, true = np.array(seen[-10:]).T
    assert said.max() < 12  # 20 and more against the picture in these inks
    np.testing.assert_allclose(said, true, atol=0.2)


def test_what_is_drawn_of_a_picture_does_not_depend_on_bands(picture, monkeypatch):
    inks, rng = Inks(ink_colors(INKS)), np.random.default_rng(2)
    pixels = np.dstack([picture, rng.random((*picture.shape[:2], 1), np.float32)])
    target = target_of(pixels, np.float32, "psnr")
    rendered = rng.random(target.planar.shape, np.float32)

    def found():
        return inks.inked(pixels), inks.reducible(target, rendered), inks.background(target)

    whole = found()
    monkeypatch.setattr("gauss2svg.fit.colors._BAND", 3 * picture.shape[1])
    for in_bands, at_once in zip(found(), whole, strict=True):
        np.testing.assert_array_equal(in_bands, at_once)


def test_transparent_picture_stays_transparent(picture):
    alpha = np.ones((*picture.shape[:2], 1), np.float32)
    alpha[:, 60:] = 0
    result = vectorize(np.dstack([picture, alpha]), gaussians=40, iterations=60, inks=INKS)
    assert result.scene.transparent
    assert (result.raster[:, 64:, 3] < 0.1).mean() > 0.95
    assert (result.raster[:, :56, 3] > 0.9).mean() > 0.9
    assert {tuple(c) for c in result.scene.inks} <= {tuple(c) for c in ink_colors(INKS)}


def test_reducible_error_is_what_another_ink_would_save(picture):
    target = target_of(picture, np.float32, "psnr")
    inks = Inks(ink_colors(INKS))
    rendered = np.full_like(target.planar, 0.5)
    residual = target.planar - inks.reducible(target, rendered)
    best = ((picture[:, :, None] - inks.color) ** 2).sum(axis=3).min(axis=2)
    saved = np.maximum(((picture - 0.5) ** 2).sum(axis=2) - best, 0)
    np.testing.assert_allclose((residual**2).sum(axis=0), saved, atol=1e-5)
    drawn = inks.nearest(picture.reshape(-1, 3)).reshape(picture.shape)
    closest = np.moveaxis(drawn, -1, 0).astype(np.float32)
    np.testing.assert_allclose(inks.reducible(target, closest), target.planar, atol=1e-6)


def test_exchange_lowers_the_error_and_keeps_to_the_inks(picture):
    population = Population(picture, fit_config(inks=INKS))
    inks, target = population.inks, population.target
    assert inks is not None
    scene = random_scene(50, 80, 64, 5, (1, 8), (1, 8)).replace(opacity=np.ones(50))
    state = State.of(scene.mean, np.zeros((50, 3)), 0, raw_opacity=np.full(50, 12.0))
    population.state = state = state.quantized(scene)
    state.color = inks.color[np.arange(50) % 3]
    before = target.squares(population.splats())[0]
    population.exchange(inks)
    assert target.squares(population.splats())[0] < before
    assert (state.color[:, None] == inks.color).all(axis=2).any(axis=1).all()


@pytest.mark.parametrize(
    "others",
    [
        {"blend": "add"}, {"falloff": "gaussian"}, {"form": "blur", "renderer": "chromium"},
        {"palette": 6}, {"stops": 8}, {"animate": 2.0}, {"fragments": True},
    ],
)  # fmt: skip
def test_what_inks_do_not_have_is_refused_beside_them(others, picture):
    with pytest.raises(InputError, match="must not be given with inks"):
        vectorize(picture, inks=INKS, **others)
