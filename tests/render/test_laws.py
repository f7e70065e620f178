"""Laws that hold for all scenes of the domain, by property, in both renderers and precisions."""

import math
from xml.etree import ElementTree

import numba
import numpy as np
import pytest
from both_renderers import TORCH, drawn, in_both, tensors_of
from extreme_scenes import extreme_scenes, rounding_of, whitened
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from with_torch import torch

from gauss2svg.errors import SceneError
from gauss2svg.render import render
from gauss2svg.render.cpu import splats_of, squared_error
from gauss2svg.render.reference import below_one, render_reference
from gauss2svg.scene import ADD, OVER, Scene
from gauss2svg.svg.document import SvgFormat
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import write_svg

blends = st.sampled_from([OVER, ADD])
ROUNDING = {np.float32: 3e-5, np.float64: 0.0}  # on top of rounding_of
REACHES, NUMBERS = 8e6, 1e8  # px and user units that a file may have
SVG = "{http://www.w3.org/2000/svg}"


def drawings(scene: Scene, dtype: type) -> list[NDArray]:
    """The scene by both renderers."""
    return [render(scene, dtype=dtype), render_reference(scene, dtype=TORCH[dtype]).numpy()]


def allowed(scene: Scene, dtype: type) -> float:
    strong = max(1.0, np.abs(scene.color).max(initial=0.0)) * max(1, len(scene))
    return rounding_of(scene) + ROUNDING[dtype] * (strong if scene.blend == ADD else 1)


@in_both
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
@given(st.data())
def test_values_lie_between_the_darkest_and_the_brightest_colour(dtype, data):
    scene = data.draw(extreme_scenes())
    colors = np.concatenate([scene.color, scene.background[None]])
    slack = {np.float32: 2e-6, np.float64: 1e-14}[dtype]
    for image in drawings(scene, dtype):
        assert (image >= colors.min(axis=0) - slack).all()
        assert (image <= colors.max(axis=0) + slack).all()


@in_both
@given(st.data())
def test_opacity_zero_changes_no_pixel(dtype, data):
    scene, ghost = (data.draw(extreme_scenes(least=1)) for _ in range(2))
    shape = np.zeros(len(ghost))
    joined = scene.concatenate(ghost.replace(opacity=shape))
    below = ghost.replace(
        opacity=shape, width=scene.width, height=scene.height, background=scene.background
    ).concatenate(scene)
    for other in (joined, below):
        for image, same in zip(drawings(scene, dtype), drawings(other, dtype), strict=True):
            assert image.tobytes() == same.tobytes()


@in_both
@given(st.data())
def test_order_of_disjoint_gaussians_does_not_matter(dtype, data):
    scene = data.draw(extreme_scenes(most=8, least=2))
    dark = {"color": np.ones((1, 3)), "opacity": [1.0], "background": np.zeros(3)}
    taken = np.zeros((round(scene.height), round(scene.width)), bool)
    apart = []
    for k in range(len(scene)):
        alone = scene.select(np.array([k])).replace(**dark)
        seen = np.any([one[:, :, 0] > 0 for one in drawings(alone, dtype)], axis=0)
        if not (seen & taken).any():
            apart.append(k)
            taken |= seen
    one = scene.select(np.array(apart))
    other = one.select(np.array(data.draw(st.permutations(range(len(apart))))))
    for image, same in zip(drawings(one, dtype), drawings(other, dtype), strict=True):
        assert image.tobytes() == same.tobytes()


@in_both
@given(st.data(), blends, st.integers(-9, 9), st.integers(-9, 9))
def test_translation_by_whole_pixels_translates_the_picture(dtype, data, blend, right, down):
    scene = data.draw(extreme_scenes(blend))
    assume(not (np.abs(scene.mean) > 5e11).any())  # nowhere to go
    moved = scene.replace(mean=scene.mean + [right, down])
    h, w = round(scene.height), round(scene.width)
    overlap = slice(max(0, down), h + min(0, down)), slice(max(0, right), w + min(0, right))
    before = slice(max(0, -down), h + min(0, -down)), slice(max(0, -right), w + min(0, -right))
    for one, other in zip(drawings(scene, dtype), drawings(moved, dtype), strict=True):
        if one[before].size and other[overlap].size and TORCH[dtype] == torch.float64:
            np.testing.assert_allclose(other[overlap], one[before], atol=allowed(scene, dtype))
    one, other = render(scene, dtype=dtype), render(moved, dtype=dtype)
    if one[before].size and other[overlap].size:
        np.testing.assert_allclose(other[overlap], one[before], atol=allowed(scene, dtype))


@in_both
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


@in_both
@given(st.data(), blends)
def test_thread_count_changes_no_bit(dtype, data, blend):
    scene = data.draw(extreme_scenes(blend, size=(70, 50)))
    target = np.random.default_rng(0).random((3, round(scene.height), round(scene.width)))
    results = []
    before = numba.get_num_threads()
    try:
        for threads in (1, 2):
            numba.set_num_threads(threads)
            results.append(squared_error(splats_of(scene), target.astype(dtype)))
    finally:
        numba.set_num_threads(before)
    one, two = results
    assert one[0].tobytes() == two[0].tobytes()
    assert one[1] == two[1]
    assert one[2].tobytes() == two[2].tobytes()


@given(st.data(), blends)
def test_both_renderers_draw_the_same(data, blend):
    scene = data.draw(extreme_scenes(blend))
    exact = render_reference(scene).numpy()
    # A peak of beta < 1 has no slope: there the fast falloff differs by up to (1e-14)^beta.
    peak = float((1e-14 ** scene.beta[scene.beta < 1]).sum())
    for dtype in TORCH:
        off = allowed(scene, dtype) + peak
        np.testing.assert_allclose(render(scene, dtype=dtype), exact, atol=off)


# An independent reader of the file: matrices, gradients and colours by the arithmetic of SVG.


def cut_of(beta: float) -> float:
    """sqrt(2 4.5^(1/beta)): where (r^2 / 2)^beta is 4.5."""
    return math.sqrt(2 * 4.5 ** (1 / beta))


def covered_radius(beta: float) -> float:
    """Of the ellipse whose area is the integral of the falloff, at sigma 1."""
    r = (np.arange(20000) + 0.5) / 20000 * cut_of(beta)
    rim = math.exp(-4.5)
    f = (np.exp(-((r * r / 2) ** beta)) - rim) / (1 - rim)
    return math.sqrt(float((f * 2 * r).sum() * cut_of(beta) / 20000))


def parsed(text: str) -> tuple[list[dict], NDArray, float]:
    """Circles of an SVG as drawn, the background, px a user unit."""
    root = ElementTree.fromstring(text.encode())
    view = [float(v) for v in root.get("viewBox", "").split()]
    unit = float(root.get("width", "nan")) / view[2]
    gradients = {
        g.get("id"): (float(g.get("r", "nan")), g[0].get("stop-color"))
        for g in root.iter(SVG + "radialGradient")
    }
    circles = []
    for circle in root.iter(SVG + "circle"):
        fill, matrix = circle.get("fill", ""), circle.get("transform", "")
        a, b, c, d, e, f = (float(v) for v in matrix[len("matrix(") : -1].split())
        assert np.isfinite([a, b, c, d, e, f]).all()
        plain = fill.startswith("#")
        radius, color = (float(circle.get("r", "nan")), fill) if plain else gradients[fill[5:-1]]
        circles.append(
            {"linear": unit * radius * np.array([[a, c], [b, d]]), "plain": plain,
             "mean": unit * np.array([e, f]), "color": levels(color), "unit": unit * radius,
             "opacity": float(circle.get("fill-opacity", "1"))}
        )  # fmt: skip
    return circles, levels(root.findall(SVG + "rect")[0].get("fill", "")), unit


def levels(text: str) -> NDArray:
    digits = text[1:] if len(text) == 7 else "".join(2 * v for v in text[1:])
    return np.array([int(digits[k : k + 2], 16) for k in (0, 2, 4)])


@given(st.data(), st.sampled_from([0.2, 0.04, 0.001]))
def test_the_file_gives_the_scene_back_within_the_rounding(data, precision):
    scene = data.draw(extreme_scenes(betas=(1.0, 1.0, 1.7, 6.0, 64.0), most=8))
    options = SvgFormat(precision=precision, opacity_decimals=3)
    factor = scene.factor
    try:
        text = write_svg(scene, options)
    except SceneError:
        extent = 4 * scene.sigma.max(axis=1)
        reach = np.abs(scene.mean).max(axis=1) + extent
        number = np.maximum(np.abs(scene.mean).max(axis=1), extent) / precision
        assert ((reach > REACHES) | (number > NUMBERS)).any()
        return
    circles, background, unit = parsed(text)
    assert unit == pytest.approx(precision)
    np.testing.assert_allclose(background, scene.background * 255, atol=0.5 + 1e-9)
    left = list(circles)
    step = 0.5 * precision * (1 + 1e-6) + 1e-9
    for i in range(len(scene)):
        beta = scene.beta[i]
        if left and is_shape(left[0], scene, factor[i], i, step):
            circle = left.pop(0)
            np.testing.assert_allclose(circle["color"], scene.color[i] * 255, atol=0.5 + 1e-9)
            continue
        extent = covered_radius(beta) * factor[i].diagonal()
        nothing = (extent <= step).any() or scene.opacity[i] < 0.00051
        off = np.maximum(-scene.mean[i], scene.mean[i] - [scene.width, scene.height])
        assert nothing or (off > cut_of(beta) * scene.sigma[i]).any()
    assert not left
    assert np.isfinite(read_svg(text).covariance).all()


def is_shape(circle: dict, scene: Scene, factor: NDArray, i: int, step: float) -> bool:
    """Whether a circle is the i-th shape, within the rounding."""
    beta = scene.beta[i]
    radius = covered_radius(beta) if circle["plain"] else cut_of(beta)
    return bool(
        np.allclose(circle["linear"], radius * factor, rtol=2e-6, atol=step)
        and np.allclose(circle["mean"], scene.mean[i], rtol=1e-12, atol=step)
        and abs(circle["opacity"] - scene.opacity[i]) <= 0.0005 + 1e-9
    )


@pytest.mark.sweep
@given(st.data())
def test_the_file_of_an_additive_scene_holds_finite_numbers_or_is_refused(data):
    scene = data.draw(extreme_scenes(ADD))
    try:
        text = write_svg(scene, SvgFormat())
    except SceneError:
        assert (np.abs(scene.mean) + 4 * scene.sigma).max() > 2e6
        return
    root = ElementTree.fromstring(text.encode())
    circles = [c.get("transform", "") for c in root.iter(SVG + "circle")]
    assert len(circles) <= len(scene)
    for matrix in circles:
        assert np.isfinite([float(v) for v in matrix[len("matrix(") : -1].split()]).all()
    mapped = [e for e in root.iter() if "feFunc" in e.tag]
    assert np.isfinite(
        [float(e.get(k, "nan")) for e in mapped for k in ("slope", "intercept")]
    ).all()


def test_the_strategy_reaches_what_it_is_for():
    # scenes that show nothing would fulfil any law
    seen = []

    @settings(max_examples=60, database=None)
    @given(extreme_scenes(least=1))
    def collect(scene):
        z = whitened(scene)
        shown = (np.hypot(z[..., 0], z[..., 1]) < 1).any(axis=(1, 2))
        seen.extend(np.column_stack([shown, scene.sigma, scene.rho]))

    collect()
    rows = np.array(seen)
    visible = rows[rows[:, 0] == 1]
    assert len(visible) > 0.3 * len(rows)
    assert visible[:, 1:3].max() >= 1e6
    assert visible[:, 1:3].min() <= 1e-6
    assert np.abs(visible[:, 3]).max() == math.nextafter(1, 0)
