"""Scenes at the limits of the domain and beyond: renderers, files, round trip."""

import math
import re

from with_torch import torch  # isort: skip, for the next module needs it
import extremes
import numpy as np
import pytest
from conftest import random_scene, random_sum
from extreme_scenes import picture, rounding_of, whitened

from gauss2svg.errors import Gauss2SvgError, InputError, SceneError
from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.pipeline.palette import quantize
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.render.autograd import fast_accumulate, fast_composite
from gauss2svg.render.cpu import render_planar, splats_of
from gauss2svg.render.reference import accumulate, composite, render_reference
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
from gauss2svg.svg.document import SvgFormat
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


def test_bounds_over_a_ten_thousandth_have_a_reason():
    for case in CASES:
        inexact = max(case.single, case.plain) > 1e-4 or case.gradient > 1e-3
        if inexact or (case.levels or 0) > 4:
            assert case.reason, case.name


@cases_of(MANY)
def test_round_trip_at_the_extremes_is_measured_in_finite_numbers_or_refused(case):
    scene = case.scene
    photo = np.zeros((round(scene.height), round(scene.width), 3), np.float32)
    if case.levels is None:
        with pytest.raises(SceneError, match="coarser precision"):
            write_svg(scene)
        return
    measured = round_trip(write_svg(scene), scene, photo)
    assert np.isfinite(measured.raster).all()
    numbers = [measured.psnr_model, measured.psnr_svg, measured.psnr_roundtrip, measured.bias_svg]
    assert not np.isnan(numbers).any()


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
inside = [(name, value) for name, (values, _) in EDGES.items() for value in values]
outside = [(name, value) for name, (_, values) in EDGES.items() for value in values]
nowhere = [(name, value) for name in EDGES for value in (math.nan, math.inf, -math.inf)]


def changed(scene: Scene, name: str, value: float) -> dict:
    """The scene's parameter with one value of another."""
    array = getattr(scene, name).copy()
    array.flat[-1] = value
    return {name: array}


@pytest.mark.parametrize(("name", "value"), inside)
def test_ends_of_the_domain_are_drawn_finite_in_both_precisions(name, value):
    scene = random_scene(4, 20, 18, 3)
    scene = scene.replace(**changed(scene, name, value))
    for dtype in (np.float32, np.float64):
        assert np.isfinite(render(scene, dtype=dtype)).all()
        assert np.isfinite(render(scene, 7, 900, dtype=dtype)).all()
    for kind in (SINGLE, DOUBLE):
        assert np.isfinite(render_reference(scene, dtype=kind).numpy()).all()
        assert np.isfinite(render_reference(scene, 7, 90, dtype=kind).numpy()).all()


@pytest.mark.parametrize(("name", "value"), outside + nowhere)
def test_beyond_the_domain_a_scene_is_refused_with_its_value_its_range_and_advice(name, value):
    scene = random_scene(4, 20, 18, 3)
    got = rf"{name}\[.*\] must be finite .* got {value}"
    with pytest.raises(SceneError, match=got):
        scene.replace(**changed(scene, name, value))


def test_the_limit_of_rho_is_written_to_the_last_digit():
    with pytest.raises(SceneError, match=r"-0\.9999999999999999\.\.0\.9999999999999999.* clip"):
        random_scene(1).replace(rho=[1.0])


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


@pytest.mark.parametrize("draw", [accumulate, fast_accumulate])
def test_additive_tensors_beyond_the_domain_are_refused_too(draw):
    scene = random_sum(3, 12, 10, 2)
    names = ("mean", "sigma", "rho", "color", "background")
    tensors = [torch.tensor(getattr(scene, n), dtype=SINGLE) for n in names]
    tensors[2][1] = 1.0
    with pytest.raises(InputError, match=r"rho\[1\] .*0\.9999999403953552.* clamp"):
        draw(*tensors, 10, 12)


@pytest.mark.parametrize("draw", [composite, fast_composite])
def test_the_last_float32_before_one_is_drawn(draw):
    rho = torch.tensor([np.nextafter(np.float32(1), np.float32(0))])
    mean, sigma = torch.tensor([[6.5, 6.5]]), torch.tensor([[3.0, 3.0]])
    tensors = [t.requires_grad_() for t in (mean, sigma, rho)]
    image = draw(*tensors, torch.ones(1, 3), torch.ones(1), torch.zeros(3), 12, 12)
    image.sum().backward()
    assert image.max() > 0.99
    assert all(torch.isfinite(t.grad).all() for t in tensors)


@pytest.mark.parametrize("scale", [1e-3, 1e-6, 1e3])
def test_a_scene_at_its_ends_is_drawn_at_any_size(scale):
    # a size that would lead out of the domain is no error: a scene has no resolution
    scene = random_scene(2, 8, 6).replace(sigma=[[LEAST_SIGMA, MOST_SIGMA], [1, 1]])
    wide = scene.replace(width=8 / scale, height=6 / scale)
    for image in (render(wide, 8, 6), render_reference(wide, 8, 6, dtype=SINGLE).numpy()):
        assert np.isfinite(image).all()
    with pytest.raises(SceneError, match="sigma"):
        scene.scaled(scale)


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


@pytest.mark.parametrize("blend", ["over", "add"])
def test_visible_shapes_too_large_for_a_file_are_refused_by_their_index(blend):
    scene = random_scene(3, 30, 20, 6, beta=(1, 1)).replace(round_index=None)
    if blend == "add":
        scene = scene.replace(blend=blend, opacity=np.ones(3))
    large = scene.replace(sigma=[[1, 1], [1e9, 3], [2, 2]])
    with pytest.raises(SceneError, match=r"Gaussian 1\b.* at most 8e\+06 px"):
        write_svg(large)
    if blend == "over":
        with pytest.raises(SceneError, match="Gaussian 1"):
            outline_svg(large)
    fine = SvgFormat(precision=0.001)
    with pytest.raises(SceneError, match="coarser precision"):
        write_svg(scene.replace(sigma=np.full((3, 2), 1e5)), fine)
    drawn = rasterize(write_svg(scene.replace(sigma=np.full((3, 2), 1e6))), 30, 20)
    assert np.isfinite(drawn).all()


def test_shapes_whose_sigma_quantization_would_take_over_a_limit_are_written():
    ends = random_scene(2, 9, 9, beta=(1, 1)).replace(beta=[0.5, 0.5], mean=[[1e9, 0], [4, 4]])
    for sigma in (LEAST_SIGMA, MOST_SIGMA):
        one = ends.select(slice(0, 1)).replace(sigma=[[sigma, LEAST_SIGMA]])
        kept = quantize(one)
        assert (kept.sigma >= LEAST_SIGMA).all()
        assert (kept.sigma <= MOST_SIGMA).all()
        assert "<circle" not in write_svg(one.replace(mean=[[-1e12, 0]]))


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


def test_ten_thousand_in_one_pixel_make_finite_pairs_and_moments():
    (case,) = (c for c in CASES if c.name == "10 000 in one pixel")
    image = render_planar(splats_of(case.scene), 9, 12)
    assert np.isfinite(image).all()
    colors = np.concatenate([case.scene.color, case.scene.background[None]])
    assert (np.moveaxis(image, 0, -1) >= colors.min(axis=0) - 1e-5).all()
    assert (np.moveaxis(image, 0, -1) <= colors.max(axis=0) + 1e-5).all()
