"""Extreme images: the fit stays finite and is no worse than the mean colour or an empty file."""

import json
import math

import numpy as np
import pytest
from flat import vectorize

from gauss2svg.measure.metrics import LEAST_SIDE_FOR_SSIM
from gauss2svg.photo.pixels import stacked
from gauss2svg.render import render, render_rgba
from gauss2svg.scene.scene import PARAMETERS

pytestmark = pytest.mark.sweep

RNG = np.random.default_rng(0)


def grey(values) -> np.ndarray:
    return np.repeat(np.asarray(values, np.float32)[:, :, None], 3, axis=2)


def with_one_pixel(value, other) -> np.ndarray:
    levels = np.full((40, 40), value, np.float32)
    levels[20, 13] = other
    return levels


SHAPES = [(1, 1), (1, 5000), (5000, 1), (2, 2), (3, 3), (40, 40)]
COLORS = RNG.random((40, 40, 3), np.float32)
DISTANCE = np.hypot(*(np.mgrid[:40, :40] - 19.5))
# Alpha of COLORS.
ALPHAS = {
    "soft disc": np.clip((16 - DISTANCE) / 4, 0, 1),
    "stripes": np.repeat((np.arange(40) % 2)[None], 40, axis=0),
    **{f"{level} everywhere": np.full((40, 40), level / 255) for level in (0, 1, 3, 254)},
    "one opaque pixel": with_one_pixel(0, 1),
    "one faint pixel": with_one_pixel(0, 3 / 255),
    "1x1 half clear": np.array([[0.5]]),
}
PICTURES = {
    **{f"{h}x{w}": RNG.random((h, w, 3), np.float32) for h, w in SHAPES},
    "black": grey(np.zeros((40, 40))),
    "white": grey(np.ones((40, 40))),
    "one white pixel": grey(with_one_pixel(0, 1)),
    "one pixel a level off": grey(with_one_pixel(0.5, 0.5 + 1 / 255)),
    "checkerboard": grey(np.indices((40, 40)).sum(axis=0) % 2),
    "step": grey(np.tile(np.arange(40) > 19, (40, 1))),
    "ramp of a level": grey(np.tile(0.5 + np.linspace(0, 1, 40) / 255, (40, 1))),
    **{name: np.dstack([COLORS[: len(one), : len(one)], one]) for name, one in ALPHAS.items()},
}
OPTIONS = {
    "usual": {},
    "more than pixels": {"gaussians": 400, "iterations": 12},
    "by error": {"gaussians": 30, "iterations": 30, "init": "error"},
    "additive": {"gaussians": 30, "iterations": 30, "blend": "add"},
    "portable": {"gaussians": 30, "iterations": 30, "blend": "add", "portable": True},
    "ssim": {"gaussians": 10, "iterations": 12, "loss": "l1+ssim"},
}
CASES = [(n, how) for n in PICTURES for how in list(OPTIONS)[: 3 if n in ALPHAS else None]]


@pytest.mark.parametrize(("name", "how"), CASES)
def test_every_picture_is_written_and_not_worse_than_its_mean_colour_or_an_empty_file(name, how):
    levels = np.round(255 * PICTURES[name].astype(np.float64))
    picture = (levels / 255).astype(np.float32) if name in ALPHAS else PICTURES[name]
    result = vectorize(levels.astype(np.uint8) if name in ALPHAS else picture, **OPTIONS[how])
    scene, report = result.scene, result.report
    json.dumps(report, allow_nan=False)
    assert (report["ssim_svg"] is None) == (min(picture.shape[:2]) < LEAST_SIDE_FOR_SSIM)
    assert (scene.width, scene.height) == picture.shape[1::-1]
    assert all(np.isfinite(getattr(scene, parameter.name)).all() for parameter in PARAMETERS)
    assert scene.transparent == (name in ALPHAS) == ("<rect" not in result.svg)
    if scene.transparent:
        empty = "the SVG is empty, because the photo is too transparent to be visible"
        is_empty = len(scene) == 0 and not scene.areas
        assert (empty in report["notes"]) == is_empty
        assert len(scene) == 0 or name not in ("0 everywhere", "1 everywhere", "3 everywhere")
        plain, drawn = np.zeros_like(picture), render_rgba(scene)
    else:
        flat = np.round(picture.mean(axis=(0, 1), dtype=np.float64) * 255) / 255
        plain, drawn = np.broadcast_to(flat, picture.shape), np.clip(render(scene), 0, 1)
    before = np.square(stacked(plain) - stacked(picture)).mean()
    # Some pictures differ from it by one level only; 12 steps of other losses leave 3 % elsewhere.
    for image in (drawn, result.raster):
        assert image.shape == picture.shape
        error = np.square(stacked(image) - stacked(picture)).mean()
        assert error <= (1.07 * math.sqrt(before) + 2 / 255) ** 2
