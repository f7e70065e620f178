"""Properties of additive files: the range of their sums, and what renderers draw of them."""

import re

import numpy as np
import pytest
from scenes import random_sum

from gauss2svg.measure.metrics import psnr
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.scene import Scene
from gauss2svg.svg import SvgFormat
from gauss2svg.svg.write import write_svg

EXACT = SvgFormat(stops=8, precision=0.01)


def scene_with(seed: int = 0, count: int = 60, **changes) -> Scene:
    return random_sum(count, 60, 44, seed).replace(**changes)


def one_sign(sign: int, background: float) -> Scene:
    scene = scene_with(3, background=np.full(3, background))
    return scene.replace(color=sign * np.abs(scene.color) / 4)


def crowded() -> Scene:
    """Sharp Gaussians that peak between the pixels."""
    corner = np.stack([np.arange(100) % 50 + 5, np.arange(100) % 37 + 4], axis=-1)
    scene = random_sum(100, 60, 44, 18)
    return scene.replace(mean=corner, sigma=np.full((100, 2), 0.35), rho=np.zeros(100))


def broad() -> Scene:
    scene = random_sum(60, 120, 88, 5)
    return scene.replace(sigma=scene.sigma + 2)


@pytest.mark.parametrize(
    ("scene", "factor", "least"),
    [
        *((one_sign(sign, grey), 1, 40) for sign, grey in ((-1, 1.0), (1, 0.0), (1, 0.5))),
        (scene_with(3), 1, 40),
        (scene_with(1, 0, background=np.array([0.2, 0.503, 1.0])), 1, 50),
        (scene_with(1, 1), 1, 50),
        (scene_with(6).replace(width=59.4, height=43.7), 1, 38),
        *((broad(), factor, 37) for factor in (0.5, 3.7)),
        *((crowded(), factor, 40) for factor in (1, 4)),
    ],
)  # fmt: skip
def test_resvg_draws_the_model_at_any_size(scene, factor, least):
    width, height = round(scene.width * factor), round(scene.height * factor)
    drawn, model = rasterize(write_svg(scene, EXACT), width, height), render(scene, width, height)
    assert psnr(drawn, model) > least
    assert factor == 1 or np.abs(drawn - model).max() < 0.1


def test_every_renderer_but_cairo_draws_a_sum(renderer):
    scene = scene_with(7)
    if renderer != "cairo":  # which refuses it
        assert psnr(rasterize(write_svg(scene, EXACT), 60, 44, renderer), render(scene)) > 36


def test_two_sums_in_one_page_keep_their_own_filters():
    first, second = (write_svg(scene_with(seed, 90), EXACT) for seed in (14, 1))
    for pattern in (r'id="(transfer-\w+)"', r'id="(additive-\w+)"'):
        one, other = re.findall(pattern, first), re.findall(pattern, second)
        assert len(one) == len(other) == 1
        assert one != other
