"""Edges of drawings: the files of presets stay crisp when they are enlarged."""

import numpy as np
import pytest

from gauss2svg import vectorize
from gauss2svg.measure.metrics import psnr
from gauss2svg.photo.alpha import shrunk
from gauss2svg.pipeline import plan as plans
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.raster import rasterize

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


def test_the_file_of_a_drawing_is_closer_and_crisper_when_it_is_enlarged(monkeypatch):
    truth = badge()
    photo = shrunk(truth, SIDE, SIDE)
    crisp = rasterize(vectorize(photo).svg, SIDE * UP, SIDE * UP)
    monkeypatch.setattr(plans, "has_edges", lambda _: False)
    soft = rasterize(vectorize(photo).svg, SIDE * UP, SIDE * UP)
    assert psnr(crisp, truth) > psnr(soft, truth) + 1

    def between(raster):  # share of the pixels that have none of the colours
        colors = np.unique(truth.reshape(-1, 3), axis=0)
        return (np.abs(raster[:, :, None] - colors).max(axis=3).min(axis=2) > 0.1).mean()

    assert between(crisp) < 0.7 * between(soft)


def test_edges_are_those_of_antialiased_drawings_that_a_preset_decides_about():
    truth = badge()
    photo = shrunk(truth, SIDE, SIDE)
    noise = np.random.default_rng(1).random((SIDE, SIDE, 3)).astype(np.float32)
    assert covering(photo)
    assert not covering(truth)  # whole pixels
    assert not covering(noise)


@pytest.mark.parametrize(
    "given",
    [
        {"gaussians": 50},
        {"target_psnr": 30},
        {"max_bytes": 5000},
        {"time_limit": 2},
        {"falloff": "gaussian"},
        {"blend": "add"},
        {"form": "blur", "renderer": "chromium"},
        {"inks": "#fff,#000"},
    ],
)
def test_what_asks_for_the_picture_at_its_size_or_another_model_keeps_its_falloffs(given):
    assert not covering(shrunk(badge(), SIDE, SIDE), **given)
