"""Extreme images: the fit stays finite and is no worse than the mean colour or an empty file."""

import json
import math

import numpy as np
import pytest
from flat import vectorize

from gauss2svg.measure import metrics
from gauss2svg.photo.pixels import stacked
from gauss2svg.render import render, render_rgba

pytestmark = pytest.mark.sweep

RNG = np.random.default_rng(0)


def grey(values) -> np.ndarray:
    return np.repeat(np.asarray(values, np.float32)[:, :, None], 3, axis=2)


def with_one_pixel(value, other) -> np.ndarray:
    levels = np.full((40, 40), value, np.float32)
    levels[20, 13] = other
    return levels


SHAPES = [(1, 1), (1, 5000), (5000, 1), (2, 2), (3, 3), (40, 40)]
PICTURES = {f"{h}x{w}": RNG.random((h, w, 3), np.float32) for h, w in SHAPES} | {
    "black": grey(np.zeros((40, 40))),
    "white": grey(np.ones((40, 40))),
    "one white pixel": grey(with_one_pixel(0, 1)),
    "one pixel a level off": grey(with_one_pixel(0.5, 0.5 + 1 / 255)),
    "checkerboard": grey(np.indices((40, 40)).sum(axis=0) % 2),
    "step": grey(np.tile(np.arange(40) > 19, (40, 1))),
    "ramp of a level": grey(np.tile(0.5 + np.linspace(0, 1, 40) / 255, (40, 1))),
}
COLORS = RNG.random((40, 40, 3), np.float32)
DISTANCE = np.hypot(*(np.mgrid[:40, :40] - 19.5))
# Alpha of COLORS, on the uint8 grid as files have it.
ALPHAS = {
    "soft disc": np.clip((16 - DISTANCE) / 4, 0, 1),
    "stripes": np.repeat((np.arange(40) % 2)[None], 40, axis=0),
    **{f"{level} everywhere": np.full((40, 40), level / 255) for level in (0, 1, 3, 254)},
    "one opaque pixel": with_one_pixel(0, 1),
    "one faint pixel": with_one_pixel(0, 3 / 255),
    "1x1": np.array([[0.5]]),
}
OPTIONS = {
    "usual": {},
    "more than pixels": {"gaussians": 400, "iterations": 12},
    "additive": {"gaussians": 30, "iterations": 30, "blend": "add"},
    "portable": {"gaussians": 30, "iterations": 30, "blend": "add", "portable": True},
    "by error": {"gaussians": 30, "iterations": 30, "init": "error"},
    "ssim": {"gaussians": 10, "iterations": 12, "loss": "l1+ssim"},
}


@pytest.mark.parametrize("how", OPTIONS)
@pytest.mark.parametrize("name", PICTURES)
def test_every_picture_is_written_and_not_worse_than_its_mean_colour(name, how):
    picture = PICTURES[name]
    result = vectorize(picture, **OPTIONS[how])
    json.dumps(result.report, allow_nan=False)
    assert_not_worse_than_the_mean(result.scene, picture, result.raster)


def assert_not_worse_than_the_mean(scene, picture, *rasters) -> None:
    """The scene has the picture's size and finite values; it and the rasters have some fidelity."""
    assert (scene.width, scene.height) == picture.shape[1::-1]
    assert_finite(scene)
    flat = np.round(picture.mean(axis=(0, 1), dtype=np.float64) * 255) / 255
    error = metrics.mean_squared_error(np.broadcast_to(flat, picture.shape), picture)
    # Some pictures differ from it by one level only; 12 steps of other losses leave 3 % elsewhere.
    for image in (np.clip(render(scene), 0, 1), *rasters):
        found = metrics.mean_squared_error(image, picture)
        assert found <= (1.03 * math.sqrt(error) + 2 / 255) ** 2


def assert_finite(scene) -> None:
    for values in (scene.mean, scene.sigma, scene.rho, scene.color, scene.opacity, scene.beta):
        assert np.isfinite(values).all()


@pytest.mark.parametrize("how", ["usual", "more than pixels", "by error"])
@pytest.mark.parametrize("name", ALPHAS)
def test_every_transparent_picture_is_written_and_not_worse_than_an_empty_file(name, how):
    alpha = ALPHAS[name]
    height, width = alpha.shape
    levels = np.round(255 * np.dstack([COLORS[:height, :width], alpha])).astype(np.uint8)
    picture = levels.astype(np.float32) / 255
    result = vectorize(levels, **OPTIONS[how])
    scene = result.scene
    assert scene.transparent
    assert "<rect" not in result.svg
    assert_finite(scene)
    json.dumps(result.report, allow_nan=False)
    empty = "the SVG is empty, because the photo is too transparent to be visible"
    assert (empty in result.report["notes"]) == (len(scene) == 0 and alpha.any())
    if name in ("0 everywhere", "1 everywhere", "3 everywhere"):
        assert len(scene) == 0
    assert result.raster.shape == (height, width, 4)
    for drawn in (result.raster, render_rgba(scene)):
        assert np.isfinite(drawn).all()
        error, before = (
            metrics.mean_squared_error(stacked(one), stacked(picture))
            for one in (drawn, np.zeros_like(picture))
        )
        assert error <= (1.03 * math.sqrt(before) + 2 / 255) ** 2
