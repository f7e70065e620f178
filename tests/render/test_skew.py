"""Laws of skewed shapes beside those of all (test_render.py): the formula, files and fits."""

import re

import numpy as np
import pytest
import torch
from both_renderers import drawn, tensors_of
from conftest import random_scene, random_skews
from flat import vectorize

from gauss2svg.measure.metrics import psnr
from gauss2svg.pipeline.quantize import quantize
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.render.reference import render_reference
from gauss2svg.scene import LEAST_SIGMA, MOST_SIGMA, Scene
from gauss2svg.scene.falloff import (
    LEAST_BETA,
    LEAST_SKEW,
    MOST_BETA,
    MOST_SKEW,
    SYMMETRIC_FROM,
    cut_radius,
    focal_radius,
)
from gauss2svg.svg.format import SvgFormat
from gauss2svg.svg.reader.read import read_svg
from gauss2svg.svg.snap import half_centers, snapped, with_falloffs
from gauss2svg.svg.write import outline_svg, write_svg


def test_radius_solves_the_equation_of_a_focal_gradient():
    rng = np.random.default_rng(0)
    for beta in (1.0, 1.7, 6.0):
        skew, v = random_skews(rng, 300), rng.normal(0, 1, (300, 2))
        t = focal_radius(v * cut_radius(beta), skew, beta) / cut_radius(beta)
        assert (t >= 0).all()
        np.testing.assert_allclose(np.hypot(*(v - (1 - t)[:, None] * skew).T), t, rtol=1e-9)
        inside = np.hypot(*v.T) < 1
        np.testing.assert_array_equal(t < 1, inside)
    straight = rng.normal(0, 2, (50, 2))
    np.testing.assert_allclose(focal_radius(straight, np.zeros(2)), np.hypot(*straight.T))


def test_no_skew_is_the_symmetric_shape_to_the_bit_in_the_kernels_and_the_reference():
    scene = random_scene(30, seed=2)
    even = scene.replace(skew=None)
    for dtype in (np.float32, np.float64):
        beside = even.concatenate(
            scene.select(scene.skew.any(axis=1)).replace(opacity=np.zeros(20))
        )
        np.testing.assert_array_equal(render(beside, dtype=dtype), render(even, dtype=dtype))
    # 1e-300 takes the loops of skewed shapes.
    near = even.replace(skew=np.full((30, 2), 1e-300))
    np.testing.assert_allclose(
        render(near, dtype=np.float64), render(even, dtype=np.float64), atol=1e-12
    )
    np.testing.assert_array_equal(render_reference(near).numpy(), render_reference(even).numpy())


@pytest.mark.parametrize("beta", [LEAST_BETA, 1.0, 3.0, MOST_BETA])
@pytest.mark.parametrize("sigma", [LEAST_SIGMA, 1e-3, 0.3, 30.0, MOST_SIGMA])
@pytest.mark.parametrize("length", [1e-12, MOST_SKEW])
def test_pictures_and_gradients_are_finite_at_the_ends(beta, sigma, length):
    # The focus of the first lies on a pixel's centre; the second is thin, the third far off.
    mean = np.array([[4.5, 3.5], [3.0, 3.0], [1e5, -1e5]])
    skew = length * np.array([[1.0, 0.0], [0.6, 0.8], [0.0, -1.0]])
    mean[0, 0] -= min(sigma * length * float(cut_radius(beta)), 1e6)
    scene = Scene(
        9, 7, mean, np.array([[sigma, sigma], [sigma, 0.3], [sigma, sigma]]), [0, 0.999, 0],
        np.eye(3), np.full(3, 0.9), beta=np.full(3, beta), skew=skew,
    )  # fmt: skip
    for fast, dtype in ((False, torch.float64), (True, torch.float32)):
        parts = tensors_of(scene, dtype)
        image = drawn(scene, parts, fast)
        (image**2).sum().backward()
        assert torch.isfinite(image).all()
        assert all(torch.isfinite(p.grad).all() for p in parts if p.grad is not None)


def test_another_falloff_keeps_the_contour_of_half_height():
    scene = random_scene(40, 100, 80, 3, sigma=(3, 12), beta=(1, 6))
    rng = np.random.default_rng(0)
    other = with_falloffs(scene, np.exp(rng.uniform(0, 2, 40)), random_skews(rng, 40))
    np.testing.assert_allclose(
        other.mean + half_centers(other), scene.mean + half_centers(scene), atol=1e-9
    )
    near = with_falloffs(scene, scene.beta, 0.9 * scene.skew)
    far = scene.replace(skew=0.9 * scene.skew)
    assert psnr(render(near), render(scene)) > psnr(render(far), render(scene)) + 3


def test_outline_of_a_skewed_shape_goes_through_its_half_height():
    scene = Scene(100, 80, [[50, 40]], [[12, 8]], [0.4], [[0, 0, 0]], [1.0], skew=[[0.5, -0.6]])
    x, y = (float(outline_svg(scene).split(f'c{axis}="')[1].split('"')[0]) for axis in "xy")
    np.testing.assert_allclose([x, y], (scene.mean + half_centers(scene))[0], atol=0.006)


def test_files_have_no_skew_that_would_not_be_seen():
    scene = random_scene(200, 100, 80, 1, sigma=(1, 30), beta=(1, 200))
    length, beta = np.hypot(*snapped(scene, "gradient").skew.T), snapped(scene, "gradient").beta
    assert (length[beta >= SYMMETRIC_FROM] == 0).all()
    assert ((length == 0) | (length >= LEAST_SKEW - 1e-9)).all()
    assert (length > 0).any()


@pytest.mark.parametrize("renderer", ["resvg", "cairo"])
def test_renderers_draw_skews_as_the_model_has_them(renderer):
    scene = random_scene(60, 160, 120, 5, sigma=(4, 20), beta=(1, 6))
    scene = quantize(scene.replace(beta=np.where(scene.beta < 1, 1.0, scene.beta)))
    picture = rasterize(write_svg(scene), 160, 120, renderer)
    even = scene.replace(skew=None)
    plain = psnr(rasterize(write_svg(even), 160, 120, renderer), render(even))
    assert psnr(picture, render(scene)) > plain - 1.5
    assert psnr(picture, render(even)) < 30


@pytest.mark.parametrize(
    "given",
    [
        {"gaussians": 300}, {"gaussians": 300, "markup": "minimal"},
        {"gaussians": 80, "markup": "minimal"},
    ],
    ids=["editable", "gradients", "masks"],
)  # fmt: skip
def test_a_skewed_fit_learns_sides_and_its_file_is_the_same_again(photo, given):
    found = vectorize(photo[::2, ::2], **given, iterations=40, falloff="skewed")
    report = found.report
    assert report["falloff"] == "skewed"
    length = np.hypot(*found.scene.skew.T)
    assert (length > LEAST_SKEW / 2).mean() > 0.3
    back = read_svg(found.svg)
    np.testing.assert_allclose(np.hypot(*back.skew.T).mean(), length.mean(), atol=0.05)
    markup = report["markup"]
    once = write_svg(back, SvgFormat(markup=markup))
    assert write_svg(read_svg(once), SvgFormat(markup=markup)) == once


@pytest.mark.parametrize("falloff", [None, "adaptive", "gaussian"])
def test_other_fits_learn_no_sides(photo, falloff):
    found = vectorize(photo, gaussians=100, iterations=30, falloff=falloff)
    assert not found.scene.skew.any()
    assert found.report["falloff"] == (falloff or "adaptive")
    assert set(re.findall('fx="(.*?)"', found.svg)) <= {".001", ".1"}


def test_additive_scenes_have_no_skew(photo):
    assert not vectorize(photo, gaussians=60, iterations=20, blend="add").scene.skew.any()
