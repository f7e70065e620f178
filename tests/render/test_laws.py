"""Properties that hold for all scenes of the domain, in both renderers and precisions."""

import numpy as np
from both_renderers import TORCH, drawn, in_both, tensors_of
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scenes import extreme_scenes, rounding_of
from with_torch import below_one, render_reference, torch

from gauss2svg.render import render
from gauss2svg.render.cpu import splats_of, squared_error
from gauss2svg.scene import ADD, OVER, Scene

blends = st.sampled_from([OVER, ADD])
ROUNDING = {np.float32: 3e-5, np.float64: 0.0}  # on top of rounding_of


def allowed(scene: Scene, dtype: type) -> float:
    strong = max(1.0, np.abs(scene.color).max(initial=0.0)) * max(1, len(scene))
    return rounding_of(scene) + ROUNDING[dtype] * (strong if scene.blend == ADD else 1)


@in_both
@settings(max_examples=8)
@given(st.data(), blends)
def test_pictures_and_gradients_are_finite(dtype, data, blend):
    scene = data.draw(extreme_scenes(blend))
    most = below_one(TORCH[dtype])
    for fast in (False, True):
        inputs = tensors_of(scene, TORCH[dtype])
        inputs[2] = inputs[2].detach().clamp(-most, most).requires_grad_()  # rho
        image = drawn(scene, inputs, fast)
        assert torch.isfinite(image).all()
        found = torch.autograd.grad(
            (image**2).sum(), inputs, allow_unused=True, materialize_grads=True
        )
        assert all(torch.isfinite(gradient).all() for gradient in found)
    target = np.zeros((3, round(scene.height), round(scene.width)), dtype)
    _, loss, moments, _ = squared_error(splats_of(scene), target)
    assert np.isfinite(loss)
    assert np.isfinite(moments).all()


@in_both
@settings(max_examples=8)
@given(st.data(), blends)
def test_a_scaled_scene_is_the_scene_rendered_larger(dtype, data, blend):
    scene = data.draw(extreme_scenes(blend, size=(14, 12)))
    assume((scene.sigma < 3e8).all())
    assume((np.abs(scene.mean) < 3e11).all())
    larger, size = scene.scaled(3), (3 * round(scene.width), 3 * round(scene.height))
    assert render(larger, dtype=dtype).tobytes() == render(scene, *size, dtype=dtype).tobytes()
    # The middle pixel of nine has its centre where the one pixel has it.
    one, nine = render(scene, dtype=dtype), render(larger, dtype=dtype)
    np.testing.assert_allclose(nine[1::3, 1::3], one, atol=allowed(scene, dtype))
    exact = render_reference(scene, *size).numpy()[1::3, 1::3]
    np.testing.assert_allclose(exact, render_reference(scene).numpy(), atol=rounding_of(scene))


@given(st.data(), blends)
def test_both_renderers_draw_the_same(data, blend):
    scene = data.draw(extreme_scenes(blend))
    exact = render_reference(scene).numpy()
    # A peak of beta < 1 has no slope: there the fast falloff differs by up to (1e-14)^beta.
    peak = float((1e-14 ** scene.beta[scene.beta < 1]).sum())
    for dtype in TORCH:
        off = allowed(scene, dtype) + peak
        np.testing.assert_allclose(render(scene, dtype=dtype), exact, atol=off)
