"""Laws of additive Gaussians: the scene, both renderers, their gradients."""

import math

import numba
import numpy as np
import pytest
import torch
from conftest import random_sum
from hypothesis import given
from hypothesis import strategies as st

from gauss2svg.errors import SceneError
from gauss2svg.render import render
from gauss2svg.render.autograd import fast_accumulate
from gauss2svg.render.cpu import removal_cost, render_planar, splats_of, squared_error
from gauss2svg.render.reference import accumulate, render_reference
from gauss2svg.scene import MOST_SIGNED, Scene, peaks_of
from gauss2svg.scene.falloff import profile

seeds = st.integers(0, 2**32 - 1)
in_both = pytest.mark.parametrize("dtype", [np.float32, np.float64], ids=["float32", "float64"])
# Of renders whose parts add up to a few times 1.
OFF = {np.float32: 1e-4, np.float64: 1e-12}
GRADIENT_OFF = {np.float32: 1e-3, np.float64: 1e-12}
TORCH = {np.float32: torch.float32, np.float64: torch.float64}
NAMES = ("mean", "sigma", "rho", "color", "background")


def added_by_numpy(scene: Scene) -> np.ndarray:
    """The formula once more, from the conic: an oracle of its own."""
    y, x = np.mgrid[: int(scene.height), : int(scene.width)] + 0.5
    image = np.broadcast_to(scene.background, (*x.shape, 3)).copy()
    for k in range(len(scene)):
        u = np.stack([x - scene.mean[k, 0], y - scene.mean[k, 1]], axis=-1)
        r = np.sqrt(np.einsum("yxi,ij,yxj->yx", u, scene.conic[k], u))
        image += profile(r)[..., None] * scene.color[k]
    return image


def planar(scene: Scene, dtype: type) -> np.ndarray:
    image = render_planar(splats_of(scene), int(scene.height), int(scene.width), dtype)
    return np.moveaxis(image, 0, -1)


def tensors_of(scene: Scene, dtype: torch.dtype = torch.float64) -> list[torch.Tensor]:
    return [torch.tensor(getattr(scene, n), dtype=dtype).requires_grad_() for n in NAMES]


@in_both
@given(seeds, st.integers(0, 30), st.integers(1, 50), st.integers(1, 40))
def test_both_renderers_add_as_the_oracle_does(dtype, seed, count, width, height):
    scene = random_sum(count, width, height, seed)
    oracle = added_by_numpy(scene)
    added = accumulate(*tensors_of(scene), height, width).detach().numpy()
    np.testing.assert_allclose(added, oracle, atol=1e-9)
    np.testing.assert_allclose(planar(scene, dtype), oracle, atol=OFF[dtype])


@in_both
def test_additive_renders_are_clipped_once_at_the_end(dtype):
    scene = random_sum(40, 30, 20, 5)
    oracle = added_by_numpy(scene)
    assert oracle.min() < -0.1
    assert oracle.max() > 1.1
    shown = render(scene, dtype=dtype)
    np.testing.assert_allclose(shown, np.clip(oracle, 0, 1), atol=OFF[dtype])
    np.testing.assert_allclose(render_reference(scene).numpy(), np.clip(oracle, 0, 1), atol=1e-9)


@given(seeds)
def test_order_does_not_matter_in_additive_blending(seed):
    scene = random_sum(20, 33, 17, seed).replace(round_index=None)
    turned = scene.select(np.random.default_rng(seed).permutation(20))
    np.testing.assert_allclose(planar(turned, np.float64), planar(scene, np.float64), atol=1e-12)


@in_both
@given(seeds, st.integers(1, 12))
def test_gradients_of_both_renderers_agree_for_any_loss(dtype, seed, count):
    scene = random_sum(count, 37, 21, seed)
    weights = torch.tensor(np.random.default_rng(seed).normal(size=(21, 37, 3)))

    def loss(image):
        return (weights * image.double()).sum() + (image.double() ** 3).sum()

    slow, fast = tensors_of(scene), tensors_of(scene, TORCH[dtype])
    loss(accumulate(*slow, 21, 37)).backward()
    image = fast_accumulate(*fast, 21, 37)
    assert image.dtype == TORCH[dtype]
    loss(image).backward()
    for a, b in zip(slow, fast, strict=True):
        off = (b.grad.double() - a.grad).abs().max() / (a.grad.abs().max() + 1e-3)
        assert off < GRADIENT_OFF[dtype]


def test_gradients_match_finite_differences():
    scene = random_sum(5, 19, 13, 8)
    weights = torch.tensor(np.random.default_rng(1).normal(size=(13, 19, 3)))

    def loss(renderer, tensors):
        return (weights * renderer(*tensors, 13, 19) ** 2).sum()

    tensors = tensors_of(scene)
    loss(fast_accumulate, tensors).backward()
    values = [t.detach().clone() for t in tensors]
    for which, tensor in enumerate(tensors):
        flat = values[which].view(-1)
        for i in range(len(flat)):
            before, sides = float(flat[i]), []
            for change in (1e-6, -1e-6):
                flat[i] = before + change
                sides.append(float(loss(accumulate, values)))
            flat[i] = before
            slope = (sides[0] - sides[1]) / 2e-6
            # The falloff has a kink at its cut, where a pixel may come or go.
            assert float(tensor.grad.view(-1)[i]) == pytest.approx(slope, rel=1e-3, abs=1e-3)


@in_both
def test_fused_squared_error_is_that_of_the_picture(dtype):
    scene = random_sum(25, 37, 21, 3)
    rng = np.random.default_rng(0)
    target = rng.random((3, 21, 37)).astype(dtype)
    weight = rng.uniform(1, 9, (21, 37)).astype(dtype)
    image, squares, moments, _ = squared_error(splats_of(scene), target, weight)
    tensors = tensors_of(scene)
    residual = accumulate(*tensors, 21, 37) - torch.tensor(np.moveaxis(target, 0, -1)).double()
    (0.5 * torch.tensor(weight)[:, :, None] * residual**2).sum().backward()
    np.testing.assert_allclose(np.moveaxis(image, 0, -1), added_by_numpy(scene), atol=OFF[dtype])
    assert squares == pytest.approx(float((residual**2).sum().detach()), rel=1e-5)
    by_color = tensors[3].grad.numpy()
    np.testing.assert_allclose(moments[:, 6:9], by_color, atol=1e-4 * np.abs(by_color).max())


@in_both
def test_removal_cost_is_what_removal_costs(dtype):
    scene = random_sum(12, 37, 21, 4)  # 37: the last tile ends beyond the picture
    target = np.random.default_rng(0).random((3, 21, 37)).astype(dtype)
    weight = np.random.default_rng(1).uniform(0.1, 2.0, (21, 37)).astype(dtype)
    _, cost = removal_cost(splats_of(scene), target, weight)

    def error(one: Scene) -> float:
        off = added_by_numpy(one) - np.moveaxis(target, 0, -1)
        return float(np.sum(weight[:, :, None] * off**2))

    for k in range(12):
        without = scene.select(np.arange(12) != k)
        assert cost[k, 0] == pytest.approx(error(without) - error(scene), rel=1e-3, abs=1e-3)
        alone = scene.select(np.array([k])).replace(color=np.ones((1, 3)), background=np.zeros(3))
        mass = np.sum(weight * added_by_numpy(alone)[:, :, 0] ** 2)
        assert cost[k, 1] == pytest.approx(mass, rel=1e-4, abs=1e-9)


@pytest.mark.parametrize("threads", [1, 2])
@in_both
def test_thread_count_changes_no_bit(threads, dtype):
    scene = random_sum(300, 200, 150, 7)
    target = np.random.default_rng(0).random((3, 150, 200)).astype(dtype)
    image, squares, moments, _ = squared_error(splats_of(scene), target)
    before = numba.get_num_threads()
    numba.set_num_threads(min(threads, numba.config.NUMBA_NUM_THREADS))
    try:
        again = squared_error(splats_of(scene), target)
    finally:
        numba.set_num_threads(before)
    np.testing.assert_array_equal(image, again[0])
    assert squares == again[1]
    np.testing.assert_array_equal(moments, again[2])


def test_densities_are_the_papers_coefficients():
    scene = random_sum(6, 30, 30, 1)
    for k in range(6):
        determinant = float(np.linalg.det(scene.covariance[k]))
        phi = 1 / (2 * math.pi * math.sqrt(determinant))  # the normal density at its mean
        np.testing.assert_allclose(scene.densities[k] * phi, scene.color[k], rtol=1e-9)
    back = peaks_of(scene.densities, scene.sigma, scene.rho)
    np.testing.assert_allclose(back, scene.color, rtol=1e-12)


def test_bad_additive_scenes_are_refused():
    scene = random_sum(3, 20, 20, 2)
    with pytest.raises(SceneError, match=r"opacity.* additive"):
        scene.replace(opacity=np.array([1.0, 0.5, 1.0]))
    with pytest.raises(SceneError, match=r"beta.* additive"):
        scene.replace(beta=np.full(3, 2.0))
    with pytest.raises(SceneError, match="color"):
        scene.replace(color=np.full((3, 3), 1.01 * MOST_SIGNED))
    with pytest.raises(SceneError, match=r"color.*0\.\.1"):
        scene.replace(color=np.full((3, 3), -0.1), blend="over")
    with pytest.raises(SceneError, match=r"blend (as|of)"):
        scene.concatenate(Scene(20, 20))


def test_an_additive_scene_is_saved_and_loaded_bit_for_bit(tmp_path):
    scene = random_sum(9, 20, 10, 3)
    scene.save(tmp_path / "additive.npz")
    back = Scene.load(tmp_path / "additive.npz")
    assert back.blend == "add"
    np.testing.assert_array_equal(back.color, scene.color)
    np.testing.assert_array_equal(render(back), render(scene))
