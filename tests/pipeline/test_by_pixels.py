"""Properties of runs on pixel art: the file is exact, small, read again, and within limits."""

import numpy as np
import pytest
from flat import vectorize
from skimage import data

from gauss2svg import read_svg
from gauss2svg.photo.pixels import over
from gauss2svg.raster import rasterize, rasterize_rgba

RANDOM = np.random.default_rng(0)
CELLS = RANDOM.integers(0, 4, (24, 24)).repeat(2, axis=0).repeat(2, axis=1)
COLORS = np.array([[20, 12, 28], [208, 70, 72], [109, 170, 44], [222, 238, 214]], np.uint8)
SPRITE = COLORS[CELLS]
CLEAR = np.dstack([SPRITE, np.where(CELLS == 3, 0, 255).astype(np.uint8)])


@pytest.mark.parametrize("markup", ["editable", "minimal"])
def test_a_sprite_is_exact_in_few_bytes_and_its_file_is_read_again(markup):
    result = vectorize(SPRITE, markup=markup)
    assert (result.raster == result.photo).all()
    assert (len(result.scene.areas), len(result.scene)) == (3, 0)
    # vtracer has 28 kB, by polygons that are not exact.
    assert result.report["svg_bytes"] < 5000
    again = read_svg(result.svg)
    assert [area.paint for area in again.areas] == [area.paint for area in result.scene.areas]
    assert (rasterize(result.svg, 48, 48) == SPRITE / np.float32(255)).all()


@pytest.mark.parametrize("limit", [None, 8000])
def test_a_sprite_with_alpha_is_exact(limit):
    result = vectorize(CLEAR, max_bytes=limit)
    drawn = rasterize_rgba(result.svg, 48, 48)
    assert (over(drawn) == over(CLEAR / np.float32(255))).all()
    assert result.scene.transparent


def test_a_file_within_the_limit_is_exact_and_another_one_has_what_fits():
    whole = vectorize(SPRITE, markup="minimal").report["svg_bytes"]
    for limit, is_exact in ((whole, True), (whole - 300, True), (800, False)):
        result = vectorize(SPRITE, max_bytes=limit)
        assert result.report["svg_bytes"] <= limit
        assert (result.report["psnr_svg"] is None) == is_exact


def test_a_sprite_of_over_a_megapixel_is_exact():
    large = SPRITE[::2, ::2].repeat(48, axis=0).repeat(48, axis=1)
    result = vectorize(large)
    assert result.photo.shape[0] < 1152
    assert (rasterize(result.svg, 1152, 1152) == large / np.float32(255)).all()


def test_a_silhouette_has_fewer_bytes_than_by_other_tools():
    horse = data.horse().astype(np.uint8) * 255
    report = vectorize(horse).report
    assert report["psnr_svg"] is None
    assert report["svg_bytes"] < 4000  # vtracer has 10.9 kB


def test_options_that_ask_for_gaussians_draw_a_sprite_by_gaussians():
    for options in ({"areas": "never"}, {"gaussians": 20}, {"inks": 3, "target_psnr": 10}):
        result = vectorize(SPRITE, iterations=2, **options)
        assert not result.scene.areas
        assert len(result.scene)
