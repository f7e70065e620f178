"""Properties of blurred discs: the profile they draw, which shapes are drawn so, and by whom."""

import math
import re
from typing import get_args

import numpy as np
import pytest
from conftest import needs, random_scene
from flat import vectorize
from hypothesis import given
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter
from scipy.optimize import minimize

from gauss2svg.errors import RendererError
from gauss2svg.measure import metrics
from gauss2svg.pipeline.palette import quantize
from gauss2svg.raster import DRAW_ROTATED_BLURS, RENDERERS, rasterize
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import LEAST_BETA, MOST_BETA, cut_radius, half_radius, profile
from gauss2svg.svg import Form, SvgFormat
from gauss2svg.svg import forms as blurs
from gauss2svg.svg.forms import (
    BLUR,
    BLURS,
    CLEAR,
    blurred_disc,
    chosen_blurs,
    drawn_blurs,
    is_plain,
    snapped,
)
from gauss2svg.svg.write import write_svg

seeds = st.integers(0, 10**6)


def fitted_blur(ratio: float) -> tuple[float, ...]:
    """Deviation, exponent, scale and peak nearest to a blurred disc of `ratio` deviations."""
    r = np.arange(0.5, 500) / 500 * (1 + 6 / ratio)
    drawn = blurred_disc(r, ratio)

    def fitted(logs: np.ndarray) -> tuple[float, float]:
        """Squared error at sigma 1 px, save for a factor, and the peak."""
        sigma, beta = np.exp(logs)
        wanted = profile(r / sigma, min(max(beta, LEAST_BETA), MOST_BETA))
        peak = (r * wanted * drawn).sum() / (r * drawn * drawn).sum()
        return float((r * (peak * drawn - wanted) ** 2).sum() / sigma**2), float(peak)

    # A disc's variance is rho^2 / 4 + s^2; a crisp rim of it lies at sqrt 2 sigma.
    guess = np.log([math.sqrt(0.25 + ratio**-2), max(1.0, 0.55 * ratio)])
    best = minimize(
        lambda logs: fitted(logs)[0], guess, method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-14, "initial_simplex": guess + 0.1 * np.eye(3, 2)},
    )  # fmt: skip
    sigma, beta = np.exp(best.x)
    return 1 / ratio, float(beta), float(1 / sigma), fitted(best.x)[1]


def large_scene(count: int, seed: int) -> Scene:
    return random_scene(count, 90, 70, seed, (0.5, 25))


@pytest.mark.parametrize("ratio", [1.4, 3.4, 12.0])
def test_profile_is_that_of_a_picture_of_a_disc_blurred(ratio):
    disc_px, side = 60, 451
    y, x = np.indices((side, side)) - side // 2
    distance = np.hypot(x, y)
    blurred = gaussian_filter(np.clip(disc_px + 0.5 - distance, 0, 1), disc_px / ratio, truncate=6)
    r = distance[side // 2, side // 2 :] / disc_px
    np.testing.assert_allclose(blurred_disc(r, ratio), blurred[side // 2, side // 2 :], atol=4e-3)


# Exponent, opacity and error over the disc, by its radius in deviations (docs/decisions/svg.md).
STATED = {
    1.4: (1.01, 0.63, 0.004), 2.0: (1.15, 0.86, 0.004), 2.6: (1.36, 0.96, 0.0045),
    3.4: (1.74, 1.0, 0.0065), 5.0: (2.61, 1.0, 0.012), 8.0: (4.32, 1.0, 0.0165),
    12.0: (6.64, 1.0, 0.0185),
}  # fmt: skip


@pytest.mark.parametrize(("ratio", "blur"), list(zip(STATED, BLURS, strict=True)))
def test_the_table_is_what_is_fitted_and_stated(ratio, blur):
    assert tuple(blur) == pytest.approx(fitted_blur(ratio), rel=1e-5)
    beta, most, error = STATED[ratio]
    assert blur.beta == pytest.approx(beta, abs=0.007)
    assert min(1, 1 / blur.peak) == pytest.approx(most, abs=0.006)
    r = (np.arange(800) + 0.5) / 800 * float(cut_radius(blur.beta))  # in sigmas
    missed = blur.peak * blurred_disc(r / blur.radius, ratio) - profile(r, blur.beta)
    assert np.sqrt(np.average(missed**2, weights=r)) < error
    # A filter ends where less than half a level is left.
    assert blur.peak * blurred_disc(np.array([1 + CLEAR / ratio]), ratio)[0] < 0.5 / 255


@given(seeds, st.sampled_from(get_args(Form)), st.sampled_from([0, 12]))
def test_quantized_scenes_stay_as_they_are(seed, form, palette):
    scene = quantize(large_scene(12, seed), form, palette)
    again = snapped(scene, form)
    # Save for shapes that got an exponent from the palette which a disc is like.
    same = (drawn_blurs(again) == drawn_blurs(scene)) | is_plain(scene)
    assert same.mean() > 0.7
    for name in ("sigma", "beta", "color"):
        mine, theirs = getattr(again, name)[same], getattr(scene, name)[same]
        np.testing.assert_allclose(mine, theirs, rtol=1e-12)
    assert np.abs(again.color - scene.color).max() < 1e-12
    assert np.abs(render(again) - render(scene)).max() < 0.1


@given(seeds, st.sampled_from([0, 12]))
def test_blurred_shapes_are_large_keep_their_colours_and_share_their_filters(seed, palette):
    scene = large_scene(15, seed)
    index = chosen_blurs(scene, BLUR)
    blurred = index >= 0
    half = scene.ellipse_axes[0][:, 1] * half_radius(scene.beta)
    assert (half[blurred] >= blurs.LEAST_HALF_WIDTH).all()
    full = scene.opacity[blurred] * [BLURS[k].peak for k in index[blurred]]
    assert (full <= 1.001 + blurs.OVERFULL).all()
    assert not (blurred & is_plain(scene)).any()
    kept = snapped(quantize(scene, BLUR, palette), BLUR)
    svg = write_svg(kept, SvgFormat(form=BLUR, precision=0.001, opacity_decimals=4))
    used = re.findall(r'filter="url\(#(\w+)\)"', svg)
    assert len(used) == np.count_nonzero((drawn_blurs(kept) >= 0) & ~is_plain(kept))
    assert set(used) == set(re.findall(r'<filter[^>]* id="(\w+)"', svg))
    ids = re.findall(r' id="([^"]+)"', svg)
    assert len(set(ids)) == len(ids)
    assert "filter" not in write_svg(scene)
    if palette:
        first = drawn_blurs(snapped(scene, BLUR)) >= 0
        np.testing.assert_allclose(kept.color[first], scene.color[first], atol=0.51 / 255)
        assert svg.count("<radialGradient") <= palette


@pytest.mark.parametrize(
    ("beta", "opacity", "blurred"),
    [(1, 0.3, True), (1, 1, False), (1.74, 1, True), (4.3, 1, True), (16, 1, False)]
    + [(beta, opacity, None) for beta in (0.6, 1.3, 2.2, 6.6, 9, 128) for opacity in (0.1, 0.9)],
)
def test_blurring_changes_little_or_is_not_done(beta, opacity, blurred):
    one = np.ones(1)
    scene = Scene(
        200, 200, mean=np.full((1, 2), 100.0), sigma=np.full((1, 2), 20.0), rho=0 * one,
        color=np.ones((1, 3)), opacity=opacity * one, background=np.zeros(3), beta=beta * one,
    )  # fmt: skip
    index = int(chosen_blurs(scene, BLUR)[0])
    assert blurred in (None, index >= 0)
    if index < 0:
        return
    blur, r = BLURS[index], np.linspace(0, 4, 300)
    sigmas = r * half_radius(blur.beta) / half_radius(beta)
    drawn = blur.peak * blurred_disc(sigmas / blur.radius, 1 / blur.deviation)
    differing = opacity * np.abs(drawn - profile(r, beta)).max()
    assert differing <= 0.09
    assert np.abs(render(snapped(scene, BLUR)) - render(scene)).max() <= differing + 0.03


@pytest.mark.parametrize("renderer", sorted(set(RENDERERS) - set(DRAW_ROTATED_BLURS)))
def test_renderer_that_cannot_draw_blurs_is_refused_before_the_fit(renderer, photo):
    steps = []
    with pytest.raises(RendererError, match="--renderer chromium"):
        vectorize(photo, form=BLUR, renderer=renderer, progress=steps.append)
    assert not steps
    with pytest.raises(RendererError, match="must be one of chromium"):
        rasterize(write_svg(large_scene(40, 3), SvgFormat(form=BLUR)), 90, 70, renderer)


@pytest.mark.parametrize("renderer", DRAW_ROTATED_BLURS)
def test_blurred_scene_is_drawn_as_the_model_has_it(renderer):
    needs(renderer)
    scene = snapped(random_scene(60, 200, 160, 4, (1, 40), (0.7, 8)), BLUR)
    assert (drawn_blurs(scene) >= 0).sum() > 10
    svg = write_svg(scene, SvgFormat(form=BLUR, precision=0.01, opacity_decimals=3))
    assert metrics.psnr(rasterize(svg, 200, 160, renderer), render(scene)) > 37
