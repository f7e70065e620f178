"""Properties of exponents, of colours that shapes share, and of inks, in fit, file and raster."""

import numpy as np
import pytest
from common import flat_error
from flat import fit_config, vectorize
from pictures import antialiased_badge
from scipy.ndimage import maximum_filter, minimum_filter

from gauss2svg.fit.session import fit
from gauss2svg.measure import metrics
from gauss2svg.pipeline.palette import quantize
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.scene.inks import ink_colors
from gauss2svg.svg.forms import is_plain
from gauss2svg.svg.read import read_svg


def test_sharp_shapes_fit_a_drawing_that_gaussians_smear():
    picture = antialiased_badge(96)
    soft, sharp = (
        fit(picture, fit_config(40, 150, falloff=f)).scene for f in ("gaussian", "adaptive")
    )
    assert (soft.beta == 1).all()
    drawn = [render(scene) for scene in (soft, sharp)]
    assert metrics.psnr(drawn[1], picture) > metrics.psnr(drawn[0], picture) + 3
    assert flat_error(drawn[1], picture) < flat_error(drawn[0], picture)
    assert (sharp.beta > 2).mean() > 0.4


# The last steps, before which exponents and colours are quantized, may not come.
@pytest.mark.parametrize(
    "options",
    [
        *({"iterations": 40, "palette": palette} for palette in (None, 4)),
        {"iterations": 1, "palette": 16, "falloff": "gaussian"},
    ],
)  # fmt: skip
def test_file_draws_the_exponents_and_colours_that_the_scene_has(options):
    result = vectorize(antialiased_badge(96), gaussians=40, **options)
    scene = result.scene
    shaded = ~is_plain(scene)
    classes = np.array(BETA_CLASSES)
    assert np.abs(scene.beta[shaded, None] / classes - 1).min(axis=1).max(initial=0) < 1e-12
    assert options.get("falloff") != "gaussian" or (scene.beta == 1).all()
    again = quantize(scene)
    np.testing.assert_allclose(again.color, scene.color, atol=0.5 / 255)
    np.testing.assert_allclose(again.beta, scene.beta, rtol=1e-12)
    keys = np.column_stack([scene.beta, np.round(scene.color * 255)])[shaded]
    gradients = len(np.unique(np.round(keys, 6), axis=0))
    assert result.svg.count("<radialGradient") == result.report["gradients"] == gradients
    assert gradients <= (options["palette"] or 40)
    assert result.report["psnr_roundtrip"] > 44


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
    result = vectorize(picture, gaussians=40, iterations=80, inks=INKS, markup=markup)
    assert inks_seen(rasterize(result.svg, 480, 384)) <= set(INKS.split(","))
    assert metrics.psnr(rasterize(result.svg, 80, 64), picture) > 25
    assert "Gradient" not in result.svg
    assert "opacity" not in result.svg
    assert result.report["inks"] == INKS
    exact = (np.round(result.raster[:, :, None] * 255) == ink_colors(INKS) * 255).all(axis=3)
    shares = np.array(result.report["ink_shares"])
    assert shares.sum() == pytest.approx(1, abs=1e-3)
    assert (shares >= exact.mean(axis=(0, 1)) - 1e-4).all()
    np.testing.assert_array_equal(read_svg(result.svg).inks, result.scene.inks)
    changes = (np.diff(result.scene.color, axis=0) != 0).any(axis=1)
    assert changes.sum() == result.scene.round_index[-1]


def test_number_of_inks_is_chosen_for_the_picture_and_unseen_inks_are_named(picture):
    result = vectorize(picture, gaussians=20, iterations=20, inks=3)
    chosen = ink_colors(result.report["inks"])
    distance = np.abs(chosen[:, None] - ink_colors(INKS)).max(axis=2).min(axis=1)
    assert distance.max() < 0.1
    assert {tuple(c) for c in result.scene.inks} == {tuple(c) for c in chosen}
    more = vectorize(picture, gaussians=20, iterations=20, inks=f"#00ff00,#ff00ff,{INKS}")
    said = "not used: #00ff00, #ff00ff of the inks"
    assert any(note.startswith(said) for note in more.report["notes"])
