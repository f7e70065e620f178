"""Properties of the two renderers, and that they are one."""

import numpy as np
import pytest
from both_renderers import GRADIENT_OFF, OFF, TORCH, drawn, in_both, of_either_blend, tensors_of
from hypothesis import example, given, settings
from hypothesis import strategies as st
from with_torch import render_reference, torch

from gauss2svg.errors import InputError
from gauss2svg.render import render
from gauss2svg.render.autograd import torch_loss
from gauss2svg.render.cpu import removal_cost, splats_of, squared_error
from gauss2svg.scene import ADD, OVER, Scene

seeds = st.integers(0, 2**32 - 1)


@of_either_blend
@in_both
@settings(max_examples=8)
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


def over_a_picture(scene, dtype):
    """Return the splats of a scene over a random picture, and its tensors over the same."""
    height, width = round(scene.height), round(scene.width)
    ground = np.random.default_rng(4).random((3, height, width)).astype(dtype)
    tensors = tensors_of(scene)
    tensors[4 if scene.blend == ADD else 5] = torch.tensor(np.moveaxis(ground, 0, -1)).double()
    return splats_of(scene)._replace(ground=ground), tensors


@of_either_blend
@pytest.mark.parametrize(("over_picture", "weighted"), [(False, False), (True, True)])
@in_both
def test_fused_squared_error_equals_the_torch_loss(scene_of, weighted, over_picture, dtype):
    scene, rng = scene_of(15, 45, 33, 8), np.random.default_rng(2)
    target, weight = rng.random((3, 33, 45)).astype(dtype), rng.uniform(0.1, 2.0, (33, 45))
    splats, inputs = splats_of(scene), tensors_of(scene)
    if over_picture:
        splats, inputs = over_a_picture(scene, dtype)
    image, loss, moments, rows = squared_error(splats, target, weight if weighted else None)
    rendered = drawn(scene, inputs)
    squares = (rendered - torch.tensor(np.moveaxis(target, 0, -1))) ** 2
    (0.5 * squares * (torch.tensor(weight)[:, :, None] if weighted else 1)).sum().backward()
    off = OFF[scene.blend][dtype]
    np.testing.assert_allclose(np.moveaxis(image, 0, -1), rendered.detach(), atol=off)
    assert loss == pytest.approx(squares.sum().item(), rel=3 * off)
    color_gradient = inputs[3].grad.numpy()
    scale = np.abs(color_gradient).max()
    assert np.abs(moments[:, 6:9] - color_gradient).max() / scale < GRADIENT_OFF[dtype]
    if scene.blend == OVER:  # moment 5 is the gradient of the logarithm of the opacity
        gradient = inputs[4].grad.numpy() * scene.opacity
        assert np.abs(moments[:, 5] - gradient).max() < GRADIENT_OFF[dtype] * np.abs(gradient).max()
    assert rows > 0


@of_either_blend
@pytest.mark.parametrize(("over_picture", "weighted"), [(False, False), (True, True)])
@in_both
def test_removal_cost_is_what_removal_costs_and_mass_is_its_curvature_in_the_colour(
    scene_of, weighted, over_picture, dtype
):
    count = 6
    scene, rng = scene_of(count, 40, 30, 9), np.random.default_rng(3)
    target = rng.random((30, 40, 3))
    weight = rng.uniform(0.1, 2.0, (30, 40)) if weighted else np.ones((30, 40))
    planar = np.ascontiguousarray(np.moveaxis(target, -1, 0), dtype)
    splats = over_a_picture(scene, dtype)[0] if over_picture else splats_of(scene)
    found = removal_cost(splats, planar, weight.astype(dtype) if weighted else None)[1]

    def picture(one, tensors):
        return drawn(one, tensors).detach().numpy()

    def error(one):
        tensors = over_a_picture(one, dtype)[1] if over_picture else tensors_of(one)
        return (weight[:, :, None] * np.square(picture(one, tensors) - target)).sum()

    whole, off = error(scene), GRADIENT_OFF[dtype]
    for k in range(count):
        expected = error(scene.select(np.arange(count) != k)) - whole
        assert found[k, 0] == pytest.approx(expected, abs=off * whole)
        alone = scene.replace(color=np.eye(count)[:, [k] * 3], background=np.zeros(3))
        mass = (weight * np.square(picture(alone, tensors_of(alone))[:, :, 0])).sum()
        assert found[k, 1] == pytest.approx(mass, rel=off, abs=0.1 * OFF[scene.blend][dtype])


@of_either_blend
def test_gradients_of_the_reference_are_those_of_finite_differences(scene_of):
    scene = scene_of(2, 4, 3, 3, sigma=(0.8, 3.0))
    assert torch.autograd.gradcheck(lambda *tensors: drawn(scene, tensors), tensors_of(scene))


@pytest.mark.parametrize(
    ("size", "dtype", "message"),
    [
        ((0, 4), np.float32, "width must be a whole number.*; got 0"),
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


@pytest.mark.parametrize(
    "function",
    [
        lambda render, target: (render - target) ** 2,
        lambda render, target: (render - target).mean().detach(),
        lambda render, target: 1.0,
    ],
)
def test_a_torch_loss_is_a_scalar_that_depends_on_the_render(function):
    pixels = np.zeros((6, 9, 3), np.float32)
    with pytest.raises(InputError, match=r"loss must be a scalar .* Try .mean\(\), without"):
        torch_loss(function)(pixels, pixels)
