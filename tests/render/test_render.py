"""Properties of the two renderers, and that they are one."""

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from both_renderers import (
    GRADIENT_OFF,
    OFF,
    TORCH,
    by_numpy,
    drawn,
    in_both,
    of_either_blend,
    planar,
    tensors_of,
)
from conftest import random_scene
from hypothesis import example, given
from hypothesis import strategies as st
from with_torch import torch

from gauss2svg.errors import InputError
from gauss2svg.render import FrameMaker, render
from gauss2svg.render.cpu import removal_cost, splats_of, squared_error
from gauss2svg.render.reference import render_reference
from gauss2svg.render.tiles import TILE_HEIGHT, TILE_WIDTH, find_pairs
from gauss2svg.scene import OVER, Scene
from gauss2svg.scene.falloff import cut_radius

seeds = st.integers(0, 2**32 - 1)


def pairs_of_scene(scene: Scene, radius: np.ndarray, height: int, width: int):
    """`find_pairs` of copies, as renderers call it: a scene's own arrays are of another type,
    which cannot be written to, and for which it would be compiled once more.
    """
    shape = [array.copy() for array in (scene.mean, scene.sigma, scene.rho)]
    return find_pairs(*shape, radius, height, width)


@of_either_blend
@in_both
@given(seeds, st.integers(0, 30), st.integers(1, 50), st.integers(1, 40))
@example(5, 40, 30, 20)  # a sum of which parts are under 0 and over 1
def test_reference_and_fast_renderer_draw_the_oracle(scene_of, dtype, seed, count, width, height):
    scene = scene_of(count, width, height, seed)
    oracle, off = by_numpy(scene), OFF[scene.blend][dtype]
    exact = drawn(scene, tensors_of(scene)).detach().numpy()
    np.testing.assert_allclose(exact, oracle, atol=1e-9)
    np.testing.assert_allclose(planar(scene, dtype), oracle, atol=off)
    clipped = np.clip(oracle, 0, 1)
    np.testing.assert_allclose(render_reference(scene).numpy(), clipped, atol=1e-9)
    image = render(scene, dtype=dtype)
    assert image.dtype == dtype
    np.testing.assert_allclose(image, clipped, atol=off)


@of_either_blend
@in_both
@given(seeds, st.integers(1, 12), st.sampled_from([None, None, 0.0, 1e-20, 1e-7, 1.0]))
@example(11, 6, 1.0)  # a division by 1 - alpha, which is not made, would show
def test_gradients_of_both_renderers_agree_for_any_loss(scene_of, dtype, seed, count, opacity):
    scene = scene_of(count, 37, 21, seed)
    if opacity is not None and scene.blend == OVER:
        scene = scene.replace(opacity=np.full(count, opacity))
    weights = torch.tensor(np.random.default_rng(seed).normal(size=(21, 37, 3)))

    def loss(image):
        return (weights * image.double()).sum() + (image.double() ** 3).sum()

    slow, fast = tensors_of(scene), tensors_of(scene, TORCH[dtype])
    loss(drawn(scene, slow)).backward()
    image = drawn(scene, fast, fast=True)
    assert image.dtype == TORCH[dtype]
    loss(image).backward()
    for a, b in zip(slow, fast, strict=True):
        scale = a.grad.abs().max() + 1e-3
        assert (b.grad.double() - a.grad).abs().max() / scale < GRADIENT_OFF[dtype]


@of_either_blend
@pytest.mark.parametrize("weighted", [False, True])
@in_both
def test_fused_squared_error_equals_the_torch_loss(scene_of, weighted, dtype):
    scene, rng = scene_of(15, 45, 33, 8), np.random.default_rng(2)
    target, weight = rng.random((3, 33, 45)).astype(dtype), rng.uniform(0.1, 2.0, (33, 45))
    image, loss, moments, rows = squared_error(
        splats_of(scene), target, weight if weighted else None
    )
    inputs = tensors_of(scene)
    rendered = drawn(scene, inputs)
    squares = (rendered - torch.tensor(np.moveaxis(target, 0, -1))) ** 2
    (0.5 * squares * (torch.tensor(weight)[:, :, None] if weighted else 1)).sum().backward()
    off = OFF[scene.blend][dtype]
    np.testing.assert_allclose(np.moveaxis(image, 0, -1), rendered.detach(), atol=off)
    assert loss == pytest.approx(squares.sum().item(), rel=3 * off)
    color_gradient = inputs[3].grad.numpy()
    scale = np.abs(color_gradient).max()
    assert np.abs(moments[:, 6:9] - color_gradient).max() / scale < GRADIENT_OFF[dtype]
    assert rows > 0


@of_either_blend
@pytest.mark.parametrize("weighted", [False, True])
@in_both
def test_removal_cost_is_what_removal_costs_and_mass_is_its_curvature_in_the_colour(
    scene_of, weighted, dtype
):
    scene, rng = scene_of(12, 40, 30, 9), np.random.default_rng(3)
    target = rng.random((30, 40, 3))
    weight = rng.uniform(0.1, 2.0, (30, 40)) if weighted else np.ones((30, 40))
    planar = np.ascontiguousarray(np.moveaxis(target, -1, 0), dtype)
    found = removal_cost(splats_of(scene), planar, weight.astype(dtype) if weighted else None)[1]

    def error(one):
        return (weight[:, :, None] * np.square(by_numpy(one) - target)).sum()

    whole, off = error(scene), GRADIENT_OFF[dtype]
    for k in range(12):
        expected = error(scene.select(np.arange(12) != k)) - whole
        assert found[k, 0] == pytest.approx(expected, abs=off * whole)
        alone = scene.replace(color=np.eye(12)[:, [k] * 3], background=np.zeros(3))
        mass = (weight * np.square(by_numpy(alone)[:, :, 0])).sum()
        assert found[k, 1] == pytest.approx(mass, rel=off, abs=0.1 * OFF[scene.blend][dtype])


@given(seeds, st.integers(1, 20), st.integers(1, 70), st.integers(1, 70))
def test_pairs_are_exactly_the_rows_that_a_gaussian_reaches(seed, count, width, height):
    scene = random_scene(count, width, height, seed)
    thinnest = np.sign(scene.rho) * (1 - 1e-9)  # whose rows are told without steps
    scene = scene.replace(rho=np.where(np.arange(count) % 3, scene.rho, thinnest))
    radius = cut_radius(scene.beta)
    offset, gaussian, rows, start, order, _ = pairs_of_scene(scene, radius, height, width)
    columns = -(-width // TILE_WIDTH)
    listed = set()
    for tile in range(len(start) - 1):
        for p in order[start[tile] : start[tile + 1]]:
            for y in range(*rows[p]):
                assert y // TILE_HEIGHT == tile // columns
                listed.add((int(gaussian[p]), int(y), tile % columns))
    y, x = np.mgrid[:height, :width] + 0.5
    reached = set()
    for k in range(count):
        u = np.stack([x - scene.mean[k, 0], y - scene.mean[k, 1]], axis=-1)
        q = np.einsum("yxi,ij,yxj->yx", u, scene.conic[k], u)
        for row, column in np.argwhere(q < radius[k] ** 2 - 1e-9):
            reached.add((k, int(row), int(column) // TILE_WIDTH))
    assert reached <= listed
    # a row is also listed where only the strip's rim touches it, never more
    assert len(listed) <= len(reached) + 4 * len(gaussian) + 4
    assert (np.diff(offset) >= 0).all()


def test_python_threads_may_render_at_once():
    scenes = [random_scene(200, 90, 70, seed) for seed in range(4)]
    expected = [render(scene) for scene in scenes]
    with ThreadPoolExecutor(4) as pool:
        for image, one in zip(pool.map(render, scenes * 3), expected * 3, strict=True):
            assert (image == one).all()


def test_empty_scene_is_its_background():
    scene = Scene(5, 4, background=np.array([0.25, 0.5, 0.75]))
    assert (render(scene) == np.float32([0.25, 0.5, 0.75])).all()
    assert (render_reference(scene).numpy() == [0.25, 0.5, 0.75]).all()


@pytest.mark.parametrize(
    ("size", "dtype", "message"),
    [
        ((0, 4), np.float32, "width must be a whole number.*; got 0"),
        ((10.5, 4), np.float32, "width must be a whole number.*; got 10.5"),
        ((4, "4"), np.float32, "height must be a whole number.*; got '4'"),
        ((10**6, 10**6), np.float32, "size must be at most .* px; got 1000000x1000000"),
        ((4, 4), np.float16, "image must be float32 or float64.*got float16"),
    ],
)
def test_sizes_and_types_that_no_image_has_are_refused(size, dtype, message):
    with pytest.raises(InputError, match=message):
        render(Scene(4, 4), *size, dtype=dtype)
    if dtype == np.float32:
        with pytest.raises(InputError, match=message):
            render_reference(Scene(4, 4), *size)


def test_frames_of_a_fit_take_a_small_share_of_its_cpu_time(monkeypatch):
    cpu_s, frames, maker = 0.0, 0, FrameMaker(most_a_second=1e9)
    monkeypatch.setattr(time, "process_time", lambda: cpu_s)

    def scene():
        nonlocal cpu_s, frames
        cpu_s, frames = cpu_s + 6, frames + 1
        return Scene(4, 4)

    for _ in range(30):
        maker.frame(scene)
        cpu_s += 10
    assert 0.04 < 6 * frames / cpu_s < 0.08
