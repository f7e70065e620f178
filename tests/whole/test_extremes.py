"""Scenes at the limits of the domain and beyond: renderers, files, round trip."""

import math
import re

from with_torch import torch  # isort: skip, for the next module needs it
import extremes
import numpy as np
import pytest
from conftest import random_scene
from extreme_scenes import picture, rounding_of, whitened

from gauss2svg.errors import Gauss2SvgError, InputError, SceneError
from gauss2svg.render import render
from gauss2svg.render.autograd import fast_composite
from gauss2svg.render.reference import composite, render_reference
from gauss2svg.scene import (
    LEAST_CANVAS,
    LEAST_SIGMA,
    MOST_CANVAS,
    MOST_MEAN,
    MOST_SIGMA,
    MOST_SIGNED,
    RHO_LIMIT,
    Scene,
)
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import outline_svg, write_svg

pytestmark = pytest.mark.sweep

CASES = list(extremes.cases())
MANY = 1000  # from which on the reference is too slow for more than pictures
each_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)


def cases_of(most: int, *others: str):
    """The cases of at most so many Gaussians, and others by their names."""
    chosen = [case for case in CASES if len(case.scene) <= most or case.name in others]
    return pytest.mark.parametrize("case", chosen, ids=lambda case: case.name)


SINGLE, DOUBLE = torch.float32, torch.float64


@each_case
def test_pictures_at_the_extremes_are_those_of_the_formula(case):
    scene, exact = case.scene, render_reference(case.scene).numpy()
    np.testing.assert_allclose(render(scene), exact, atol=case.single)
    np.testing.assert_allclose(render(scene, dtype=np.float64), exact, atol=case.double)
    if len(scene) <= MANY:
        plain = render_reference(scene, dtype=SINGLE).numpy()
        np.testing.assert_allclose(plain, exact, atol=case.plain)


@cases_of(300)  # exact arithmetic is slow
def test_pictures_at_the_extremes_are_those_of_exact_arithmetic(case):
    scene = case.scene
    exact = picture(scene, whitened(scene))
    exact = np.clip(exact, 0, 1) if scene.blend == "add" else exact
    allowed = rounding_of(scene)
    np.testing.assert_allclose(render_reference(scene).numpy(), exact, atol=allowed)
    np.testing.assert_allclose(render(scene, dtype=np.float64), exact, atol=allowed)
    np.testing.assert_allclose(render(scene), exact, atol=3e-5 + allowed)


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


@cases_of(MANY, "10 000 identical")
def test_files_at_the_extremes_draw_the_model_or_are_refused_with_advice(case):
    drawn = extremes.drawn_file(case.scene)
    if case.levels is None:
        assert isinstance(drawn, SceneError)
        assert "at most 8e+06 px" in str(drawn)
        assert "coarser precision" in str(drawn)
    else:
        assert not isinstance(drawn, SceneError), drawn
        assert drawn[1] <= case.levels


# Each parameter with its ends and what is just beyond them, in float64.
EDGES = {
    "sigma": ([LEAST_SIGMA, MOST_SIGMA], [0.0, -1.0, 0.999 * LEAST_SIGMA, 1.001 * MOST_SIGMA]),
    "rho": ([-RHO_LIMIT, 0.0, RHO_LIMIT], [-1.0, 1.0, math.nextafter(1, 2)]),
    "mean": ([-MOST_MEAN, MOST_MEAN], [-1.001 * MOST_MEAN, 1.001 * MOST_MEAN]),
    "opacity": ([0.0, 1e-7, 1 - 1e-7, 1.0], [-1e-9, math.nextafter(1, 2)]),
    "beta": ([0.5, 256.0], [0.4999, 256.1]),
    "color": ([0.0, 1.0], [-1e-9, math.nextafter(1, 2)]),
    "background": ([0.0, 1.0], [-1e-9, math.nextafter(1, 2)]),
}
outside = [(name, value) for name, (_, values) in EDGES.items() for value in values]
nowhere = [(name, value) for name in EDGES for value in (math.nan, math.inf, -math.inf)]


def changed(scene: Scene, name: str, value: float) -> dict:
    """The scene's parameter with one value of another."""
    array = getattr(scene, name).copy()
    array.flat[-1] = value
    return {name: array}


@pytest.mark.parametrize(("name", "value"), outside + nowhere)
def test_beyond_the_domain_a_scene_is_refused_with_its_value_its_range_and_advice(name, value):
    scene = random_scene(4, 20, 18, 3)
    got = rf"{name}\[.*\] must be finite .* got {value}"
    with pytest.raises(SceneError, match=got):
        scene.replace(**changed(scene, name, value))


@pytest.mark.parametrize("side", ["width", "height"])
def test_canvases_have_ends_too(side):
    for value in (LEAST_CANVAS, MOST_CANVAS):
        scene = random_scene(3).replace(**{side: value})
        assert np.isfinite(render(scene, 5, 4)).all()
    for value in (0.99 * LEAST_CANVAS, 1.01 * MOST_CANVAS, math.inf):
        with pytest.raises(SceneError, match=f"{side} must be .* scale"):
            random_scene(3).replace(**{side: value})


@pytest.mark.parametrize("dtype", [SINGLE, DOUBLE], ids=str)
@pytest.mark.parametrize("draw", [composite, fast_composite])
@pytest.mark.parametrize(("name", "value"), outside + nowhere)
def test_beyond_the_domain_tensors_are_refused_by_both_renderers(draw, dtype, name, value):
    scene = random_scene(4, 20, 18, 3)
    names = ("mean", "sigma", "rho", "color", "opacity", "background", "beta")
    arrays = {n: torch.tensor(getattr(scene, n), dtype=dtype) for n in names}
    arrays[name] = arrays[name].clone()
    arrays[name].view(-1)[-1] = value
    if name in ("color", "background") and math.isfinite(value):
        # Signed in both blends: the limits are those of additive colours.
        arrays[name].view(-1)[-1] = math.copysign(1.01 * MOST_SIGNED, value)
    elif dtype == SINGLE and value == math.nextafter(1, 2):
        arrays[name].view(-1)[-1] = float(np.nextafter(np.float32(1), np.float32(2)))
    beta = arrays.pop("beta")
    with pytest.raises(InputError, match=rf"^{name}\[.* finite and in .* clamp"):
        draw(*arrays.values(), 18, 20, beta)


@pytest.mark.parametrize("draw", [composite, fast_composite])
def test_the_last_float32_before_one_is_drawn(draw):
    rho = torch.tensor([np.nextafter(np.float32(1), np.float32(0))])
    mean, sigma = torch.tensor([[6.5, 6.5]]), torch.tensor([[3.0, 3.0]])
    tensors = [t.requires_grad_() for t in (mean, sigma, rho)]
    image = draw(*tensors, torch.ones(1, 3), torch.ones(1), torch.zeros(3), 12, 12)
    image.sum().backward()
    assert image.max() > 0.99
    assert all(torch.isfinite(t.grad).all() for t in tensors)


FAR = [[1e9, 5], [5, -1e9], [-1e12, 1e12]]


@pytest.mark.parametrize("blend", ["over", "add"])
def test_shapes_off_the_canvas_and_beyond_the_numbers_of_a_file_are_left_out(blend):
    near = random_scene(4, 30, 20, 6, beta=(1, 1)).replace(round_index=None)
    if blend == "add":
        near = near.replace(blend=blend, opacity=np.ones(4))
    sigma = [[1e6, 1e6], [1e-6, 5e7], [1e9, 1]]
    far = near.select(slice(0, 3)).replace(mean=FAR, sigma=sigma, rho=[0.5, -0.9, RHO_LIMIT])
    assert render(far).tobytes() == render(Scene(30, 20, background=far.background)).tobytes()
    both = far.concatenate(near).replace(round_index=None)
    written = [re.findall(r'transform="(.*?)"', write_svg(one)) for one in (both, near)]
    assert written[0] == written[1]
    assert len(written[0]) == 4
    if blend == "over":
        assert outline_svg(far).count("<ellipse") == 0


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        ("1e-12 0 0 5 9 9", r"sigma\[0, 0\] must be finite and in 1e-09"),
        ("5 0 0 5e11 9 9", r"sigma\[0, 1\] must be finite"),
        ("5 0 0 5 9e13 9", r"mean\[0, 0\] must be finite"),
    ],
)
def test_files_beyond_the_domain_are_refused_with_its_limit(matrix, message):
    text = write_svg(Scene(20, 20, [[9, 9]], [[3, 3]], [0], [[1, 0, 0]], [1]))
    start, end = text.index("matrix(") + 7, text.index(")", text.index("matrix("))
    with pytest.raises(Gauss2SvgError, match=f"the SVG must be one of write_svg.*{message}"):
        read_svg(text[:start] + matrix + text[end:])
