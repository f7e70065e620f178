"""Scenes at the limits of the domain and beyond: renderers, files, round trip."""

import math
import re

from with_torch import torch  # isort: skip, for the next module needs it
import extremes
import numpy as np
import pytest
from conftest import random_scene
from extreme_scenes import picture, rounding_of, whitened

from gauss2svg.errors import InputError, SceneError
from gauss2svg.render import render
from gauss2svg.render.autograd import fast_composite
from gauss2svg.render.reference import composite, render_reference
from gauss2svg.scene import (
    LEAST_CANVAS,
    LEAST_SIGMA,
    MOST_CANVAS,
    MOST_MEAN,
    MOST_SIGNED,
    RHO_LIMIT,
    Scene,
)
from gauss2svg.svg.write import outline_svg, write_svg

pytestmark = pytest.mark.sweep

CASES = list(extremes.cases())
MANY = 1000  # from which on the reference is too slow for more than pictures
each_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
SINGLE, DOUBLE = torch.float32, torch.float64


@each_case
def test_pictures_at_the_extremes_are_those_of_the_formula_and_of_exact_arithmetic(case):
    scene, exact = case.scene, render_reference(case.scene).numpy()
    np.testing.assert_allclose(render(scene), exact, atol=case.single)
    np.testing.assert_allclose(render(scene, dtype=np.float64), exact, atol=case.double)
    if len(scene) <= MANY:
        plain = render_reference(scene, dtype=SINGLE).numpy()
        np.testing.assert_allclose(plain, exact, atol=case.plain)
    if len(scene) <= 300:  # exact arithmetic is slow
        oracle = picture(scene, whitened(scene))
        oracle = np.clip(oracle, 0, 1) if scene.blend == "add" else oracle
        np.testing.assert_allclose(exact, oracle, atol=rounding_of(scene))


@each_case
def test_gradients_at_the_extremes_are_those_of_the_reference(case):
    module, many = extremes, len(case.scene) >= MANY
    exact = module.gradients(case.scene, many, DOUBLE)
    found, worst = module.gradient_difference(module.gradients(case.scene, True, SINGLE), exact)
    assert found <= case.gradient, worst
    if not many:
        found, worst = module.gradient_difference(module.gradients(case.scene, True, DOUBLE), exact)
        assert found <= case.double_gradient, worst
        plain = module.gradients(case.scene, False, SINGLE)
        assert all(np.isfinite(values).all() for values in plain.values())
        assert module.gradient_difference(plain, exact)[0] <= case.plain_gradient


@pytest.mark.parametrize(
    "case",
    [case for case in CASES if len(case.scene) <= MANY or case.name == "10 000 identical"],
    ids=lambda case: case.name,
)
def test_files_at_the_extremes_draw_the_model_or_are_refused_with_advice(case):
    drawn = extremes.drawn_file(case.scene)
    if case.levels is None:
        assert isinstance(drawn, SceneError)
        assert "at most 8e+06 px" in str(drawn)
        assert "coarser precision" in str(drawn)
    else:
        assert not isinstance(drawn, SceneError), drawn
        assert drawn[1] <= case.levels


# Each parameter with a value just beyond its end, for tensors as for scenes.
BEYOND = {
    "sigma": 0.999 * LEAST_SIGMA, "rho": 1.0, "mean": -1.001 * MOST_MEAN, "opacity": -1e-6,
    "beta": 256.1, "color": 1.01 * MOST_SIGNED, "background": -1.01 * MOST_SIGNED,
}  # fmt: skip


@pytest.mark.parametrize("dtype", [SINGLE, DOUBLE], ids=str)
@pytest.mark.parametrize("draw", [composite, fast_composite])
@pytest.mark.parametrize("name", BEYOND)
def test_beyond_the_domain_tensors_are_refused_by_both_renderers(draw, dtype, name):
    scene = random_scene(4, 20, 18, 3)
    names = ("mean", "sigma", "rho", "color", "opacity", "background", "beta")
    for value in (BEYOND[name], math.nan, math.inf):
        arrays = {n: torch.tensor(getattr(scene, n), dtype=dtype) for n in names}
        arrays[name].view(-1)[-1] = value
        beta = arrays.pop("beta")
        with pytest.raises(InputError, match=rf"^{name}\[.* finite and in .* clamp"):
            draw(*arrays.values(), 18, 20, beta)


@pytest.mark.parametrize("side", ["width", "height"])
def test_canvases_have_ends_too(side):
    for value in (LEAST_CANVAS, MOST_CANVAS):
        assert np.isfinite(render(random_scene(3).replace(**{side: value}), 5, 4)).all()
    for value in (0.99 * LEAST_CANVAS, 1.01 * MOST_CANVAS, math.inf):
        with pytest.raises(SceneError, match=f"{side} must be .* scale"):
            random_scene(3).replace(**{side: value})


@pytest.mark.parametrize("draw", [composite, fast_composite])
def test_the_last_float32_before_one_is_drawn(draw):
    rho = torch.tensor([np.nextafter(np.float32(1), np.float32(0))])
    mean, sigma = torch.tensor([[6.5, 6.5]]), torch.tensor([[3.0, 3.0]])
    tensors = [t.requires_grad_() for t in (mean, sigma, rho)]
    image = draw(*tensors, torch.ones(1, 3), torch.ones(1), torch.zeros(3), 12, 12)
    image.sum().backward()
    assert image.max() > 0.99
    assert all(torch.isfinite(t.grad).all() for t in tensors)


@pytest.mark.parametrize("blend", ["over", "add"])
def test_shapes_off_the_canvas_and_beyond_the_numbers_of_a_file_are_left_out(blend):
    near = random_scene(4, 30, 20, 6, beta=(1, 1)).replace(round_index=None)
    if blend == "add":
        near = near.replace(blend=blend, opacity=np.ones(4))
    mean, sigma = [[1e9, 5], [5, -1e9], [-1e12, 1e12]], [[1e6, 1e6], [1e-6, 5e7], [1e9, 1]]
    far = near.select(slice(0, 3)).replace(mean=mean, sigma=sigma, rho=[0.5, -0.9, RHO_LIMIT])
    assert render(far).tobytes() == render(Scene(30, 20, background=far.background)).tobytes()
    both = far.concatenate(near).replace(round_index=None)
    written = [re.findall(r'transform="(.*?)"', write_svg(one)) for one in (both, near)]
    assert written[0] == written[1]
    assert len(written[0]) == 4
    if blend == "over":
        assert outline_svg(far).count("<ellipse") == 0
