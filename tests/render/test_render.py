"""Laws of the two renderers, and that they are one."""

import itertools
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
import pytest
import torch
from conftest import random_scene
from hypothesis import given
from hypothesis import strategies as st

from gauss2svg.errors import InputError
from gauss2svg.render import render
from gauss2svg.render.autograd import fast_composite
from gauss2svg.render.cpu import moments_of_gradient, removal_cost, splats_of, squared_error
from gauss2svg.render.reference import composite, render_reference
from gauss2svg.render.tiles import LEAST_STEPPED, TILE_HEIGHT, TILE_WIDTH, find_pairs
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import RADIUS, cut_radius, focal_radius, profile

seeds = st.integers(0, 2**32 - 1)

# What the fast renderer computes in, and how far pictures and scaled gradients may be off:
# three and more times what is seen with exponents at the ends of their range.
in_both = pytest.mark.parametrize("dtype", [np.float32, np.float64], ids=["float32", "float64"])
OFF = {np.float32: 3e-5, np.float64: 1e-13}
GRADIENT_OFF = {np.float32: 1e-3, np.float64: 1e-12}
TORCH = {np.float32: torch.float32, np.float64: torch.float64}


def tensors_of(scene: Scene, dtype: torch.dtype = torch.float64) -> list[torch.Tensor]:
    names = ("mean", "sigma", "rho", "color", "opacity", "background", "beta", "skew")
    return [torch.tensor(getattr(scene, n), dtype=dtype).requires_grad_() for n in names]


def drawn(renderer, tensors, height: int, width: int) -> torch.Tensor:
    *others, beta, skew = tensors
    return renderer(*others, height, width, beta, skew)


def pairs_of_scene(scene: Scene, radius: np.ndarray, height: int, width: int):
    """`find_pairs` of copies, as renderers call it: a scene's own arrays are of another type,
    which cannot be written to, and for which it would be compiled once more.
    """
    shape = [array.copy() for array in (scene.mean, scene.sigma, scene.rho)]
    return find_pairs(*shape, radius, height, width)


def composite_by_numpy(scene: Scene) -> np.ndarray:
    """The formula once more, front to back in float64, from the conic: an oracle of its own."""
    y, x = np.mgrid[: int(scene.height), : int(scene.width)] + 0.5
    image = np.zeros((*x.shape, 3))
    transmittance = np.ones(x.shape)
    for k in range(len(scene) - 1, -1, -1):
        u = np.stack([x - scene.mean[k, 0], y - scene.mean[k, 1]], axis=-1)
        r = np.sqrt(np.einsum("yxi,ij,yxj->yx", u, scene.conic[k], u))
        if scene.skew[k].any():
            r = focal_radius(
                np.linalg.solve(scene.factor[k], u[..., None])[..., 0], scene.skew[k], scene.beta[k]
            )
        alpha = scene.opacity[k] * profile(r, scene.beta[k])
        image += (alpha * transmittance)[..., None] * scene.color[k]
        transmittance *= 1 - alpha
    return image + transmittance[..., None] * scene.background


@in_both
@given(seeds, st.integers(0, 30), st.integers(1, 50), st.integers(1, 40))
def test_reference_and_fast_renderer_draw_the_oracle(dtype, seed, count, width, height):
    scene = random_scene(count, width, height, seed)
    oracle = composite_by_numpy(scene)
    np.testing.assert_allclose(render_reference(scene).numpy(), oracle, atol=1e-9)
    image = render(scene, dtype=dtype)
    assert image.dtype == dtype
    np.testing.assert_allclose(image, oracle, atol=OFF[dtype])


@in_both
def test_one_gaussian_is_drawn_as_its_profile_and_not_beyond_its_cut(dtype):
    mean, sigma = np.array([[100.3, 80.1]]), np.array([[31.0, 24.0]])
    scene = Scene(200, 160, mean, sigma, [0.0], np.ones((1, 3)), [1.0], np.zeros(3))
    y, x = np.mgrid[:160, :200] + 0.5
    r = np.hypot((x - 100.3) / 31, (y - 80.1) / 24)
    image = render(scene, dtype=dtype)[:, :, 0]
    np.testing.assert_allclose(image, profile(r), atol=0.1 * OFF[dtype])
    assert (image[r > RADIUS + 1e-9] == 0).all()


@in_both
@given(seeds, st.integers(1, 12))
def test_gradients_of_both_renderers_agree_for_any_loss(dtype, seed, count):
    scene = random_scene(count, 37, 21, seed)
    weights = torch.tensor(np.random.default_rng(seed).normal(size=(21, 37, 3)))

    def loss(image):
        return (weights * image.double()).sum() + (image.double() ** 3).sum()

    slow, fast = tensors_of(scene), tensors_of(scene, TORCH[dtype])
    loss(drawn(composite, slow, 21, 37)).backward()
    image = drawn(fast_composite, fast, 21, 37)
    assert image.dtype == TORCH[dtype]
    loss(image).backward()
    assert_same_gradients(fast, slow, dtype)


def assert_same_gradients(fast: list, slow: list, dtype: type) -> None:
    for a, b in zip(slow, fast, strict=True):
        scale = a.grad.abs().max() + 1e-3
        off = (b.grad.double() - a.grad).abs().max() / scale
        assert off < GRADIENT_OFF[dtype]


@in_both
@pytest.mark.parametrize("opacity", [0.0, 1e-20, 1e-7, 0.5, 1.0])
def test_gradients_are_exact_at_every_opacity(opacity, dtype):
    # the division by 1 - alpha that is not made would show at opacity 1
    scene = random_scene(6, 20, 20, 11).replace(opacity=np.full(6, opacity))
    slow, fast = tensors_of(scene), tensors_of(scene, TORCH[dtype])
    (drawn(composite, slow, 20, 20) ** 2).sum().backward()
    (drawn(fast_composite, fast, 20, 20).double() ** 2).sum().backward()
    assert_same_gradients(fast, slow, dtype)


@pytest.mark.sweep
def test_reference_gradients_match_finite_differences():
    # sigma large enough that no pixel centre crosses the cut within the difference
    scene = random_scene(4, 9, 7, 2, sigma=(4.0, 9.0))
    inputs = tensors_of(scene)
    assert torch.autograd.gradcheck(
        lambda *t: drawn(composite, t, 7, 9), inputs, atol=1e-5, eps=1e-7
    )


@pytest.mark.parametrize(("dtype", "off"), [(np.float32, 1e-3), (np.float64, 1e-8)])
def test_fast_gradients_match_float64_finite_differences(dtype, off):
    scene = random_scene(5, 24, 18, 4, sigma=(2.0, 7.0))
    target = torch.tensor(np.random.default_rng(1).random((18, 24, 3)))
    fast, exact = tensors_of(scene, TORCH[dtype]), tensors_of(scene)
    ((drawn(fast_composite, fast, 18, 24).double() - target) ** 2).sum().backward()
    for which, tensor in enumerate(fast):
        difference = np.zeros(tensor.shape)
        for place in np.ndindex(*tensor.shape):
            values = []
            for step in (1e-5, -1e-5):
                moved = [t.detach().clone() for t in exact]
                moved[which][place] += step
                values.append(((drawn(composite, moved, 18, 24) - target) ** 2).sum().item())
            difference[place] = (values[0] - values[1]) / 2e-5
        scale = np.abs(difference).max()
        np.testing.assert_allclose(tensor.grad.numpy() / scale, difference / scale, atol=off)


@in_both
def test_fused_squared_error_equals_the_torch_loss(dtype):
    scene = random_scene(15, 45, 33, 8)
    target = np.random.default_rng(2).random((3, 33, 45)).astype(dtype)
    image, loss, moments, rows = squared_error(splats_of(scene), target)
    inputs = tensors_of(scene)
    rendered = drawn(composite, inputs, 33, 45)
    expected = ((rendered - torch.tensor(np.moveaxis(target, 0, -1))) ** 2).sum()
    (0.5 * expected).backward()
    np.testing.assert_allclose(np.moveaxis(image, 0, -1), rendered.detach(), atol=OFF[dtype])
    assert loss == pytest.approx(expected.item(), rel=3 * OFF[dtype])
    color_gradient = inputs[3].grad.numpy()
    scale = np.abs(color_gradient).max()
    off = np.abs(moments[:, 6:9] - color_gradient).max() / scale
    assert off < GRADIENT_OFF[dtype]
    assert rows > 0


@pytest.mark.parametrize("weighted", [False, True])
@in_both
def test_removal_cost_is_what_removal_costs(dtype, weighted):
    scene, rng = random_scene(12, 40, 30, 9), np.random.default_rng(3)
    target = rng.random((30, 40, 3))
    weight = rng.uniform(0.1, 2.0, (30, 40)) if weighted else np.ones((30, 40))
    planar = np.ascontiguousarray(np.moveaxis(target, -1, 0), dtype)
    given = weight.astype(dtype) if weighted else None
    _, cost = removal_cost(splats_of(scene), planar, given)

    def error(one):
        return (weight[:, :, None] * np.square(composite_by_numpy(one) - target)).sum()

    whole = error(scene)
    for k in range(12):
        expected = error(scene.select(np.arange(12) != k)) - whole
        assert cost[k, 0] == pytest.approx(expected, abs=GRADIENT_OFF[dtype] * whole)


@in_both
def test_removal_mass_is_the_curvature_of_the_error_in_the_colour(dtype):
    scene = random_scene(5, 40, 30, 10)
    blank = np.zeros((3, 30, 40), dtype)
    weight = np.random.default_rng(4).uniform(0.1, 2.0, (30, 40)).astype(dtype)
    mass = removal_cost(splats_of(scene), blank, weight)[1][:, 1]
    for k in range(5):
        color = np.zeros((5, 3))
        color[k] = 1
        alone = composite_by_numpy(scene.replace(color=color, background=np.zeros(3)))
        expected = (weight * np.square(alone[:, :, 0])).sum()
        assert mass[k] == pytest.approx(expected, rel=GRADIENT_OFF[dtype], abs=0.1 * OFF[dtype])


@given(seeds, st.integers(1, 20), st.integers(1, 70), st.integers(1, 70))
def test_pairs_are_exactly_the_rows_that_a_gaussian_reaches(seed, count, width, height):
    scene = random_scene(count, width, height, seed)
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


def test_the_thinnest_shapes_are_pairs_of_one_row_and_reach_the_same_rows():
    def pairs_of(width: float):
        rho = np.array([-np.sqrt(1 - (width / 7) ** 2)])
        shape = np.array([[30.3, 20.6]]), np.array([[9.0, 7.0]]), rho, np.array([3.0])
        _, _, rows, start, order, most = find_pairs(*shape, 48, 64)
        listed = [
            (tile, int(y))
            for tile, (first, end) in enumerate(itertools.pairwise(start))
            for p in order[first:end]
            for y in range(*rows[p])
        ]
        return sorted(listed), rows[:, 1] - rows[:, 0], most

    thin, ones, thin_most = pairs_of(0.99 * LEAST_STEPPED)
    wide, heights, wide_most = pairs_of(1.01 * LEAST_STEPPED)
    assert len(thin) == len(set(thin)) > 30
    assert thin == wide
    assert thin_most == wide_most
    assert (ones == 1).all()
    assert heights.max() > 1


def test_tile_lists_run_from_front_to_back():
    scene = random_scene(40, 64, 48, 12)
    _, gaussian, _, start, order, _ = pairs_of_scene(scene, cut_radius(scene.beta), 48, 64)
    for tile in range(len(start) - 1):
        assert (np.diff(gaussian[order[start[tile] : start[tile + 1]]]) < 0).all()


def test_translation_by_whole_tiles_translates_every_bit():
    scene = random_scene(20, 64, 64, 13).replace(mean=random_scene(20).mean % 16 + 16)
    moved = scene.replace(mean=scene.mean + [TILE_WIDTH, TILE_HEIGHT])
    one, other = render(scene), render(moved)
    assert (one[:-TILE_HEIGHT, :-TILE_WIDTH] == other[TILE_HEIGHT:, TILE_WIDTH:]).all()


def test_second_derivatives_are_refused_not_wrong():
    inputs = tensors_of(random_scene(3, 20, 16, 1))
    loss = (drawn(fast_composite, inputs, 16, 20) ** 2).sum()
    first = torch.autograd.grad(loss, inputs[1], create_graph=True)[0]
    with pytest.raises(RuntimeError, match="once_differentiable"):
        first.sum().backward()


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


def test_later_gaussians_cover_earlier_ones():
    wide = np.full((2, 2), 1e6)
    scene = Scene(
        3, 3, np.full((2, 2), 1.5), wide, np.zeros(2), np.array([[1, 0, 0], [0, 0, 1]]), np.ones(2)
    )
    np.testing.assert_allclose(render(scene), np.broadcast_to([0, 0, 1], (3, 3, 3)), atol=1e-6)


@in_both
@pytest.mark.usefixtures("threads_given_back")
@pytest.mark.parametrize("threads", [1, 2])
def test_thread_count_changes_no_bit(threads, dtype):
    splats = splats_of(random_scene(300, 150, 90, 14))
    target = np.random.default_rng(4).random((3, 90, 150)).astype(dtype)
    numba.set_num_threads(1)
    image, loss, moments, _ = squared_error(splats, target)
    cost = removal_cost(splats, target)[1]
    numba.set_num_threads(threads)
    again = squared_error(splats, target)
    assert (again[0] == image).all()
    assert again[1] == loss
    assert (again[2] == moments).all()
    assert (removal_cost(splats, target)[1] == cost).all()


def test_reference_renders_in_float32_too():
    scene = random_scene(10, 20, 16, 15)
    single = render_reference(scene, dtype=torch.float32)
    assert single.dtype == torch.float32
    np.testing.assert_allclose(single.numpy(), render_reference(scene).numpy(), atol=1e-5)


@pytest.mark.parametrize("draw", [render, render_reference])
@pytest.mark.parametrize(
    ("size", "message"),
    [
        ((0, 4), "width must be a whole number.*; got 0"),
        ((10.5, 4), "width must be a whole number.*; got 10.5"),
        ((4, "4"), "height must be a whole number.*; got '4'"),
        ((10**6, 10**6), "size must be at most .* px; got 1000000x1000000"),
    ],
)
def test_size_that_no_image_has_is_refused(draw, size, message):
    with pytest.raises(InputError, match=message):
        draw(Scene(4, 4), *size)


@pytest.mark.parametrize("dtype", [np.float16, np.int64, np.complex128])
def test_other_dtypes_are_refused(dtype):
    needed = f"image must be float32 or float64.*got {np.dtype(dtype)}"
    with pytest.raises(InputError, match=needed):
        render(Scene(4, 4), dtype=dtype)


@in_both
def test_weight_scales_the_gradient_and_leaves_the_sum(dtype):
    scene = random_scene(10, 45, 33, 8)
    rng = np.random.default_rng(2)
    target = rng.random((3, 33, 45)).astype(dtype)
    weight = rng.uniform(1, 5, (33, 45)).astype(dtype)
    splats = splats_of(scene)
    image, plain, _, _ = squared_error(splats, target)
    _, weighted, moments, _ = squared_error(splats, target, weight)
    assert weighted == plain
    expected = moments_of_gradient(splats, weight * (image - target))
    off = np.abs(moments - expected).max() / np.abs(expected).max()
    assert off < 0.1 * GRADIENT_OFF[dtype]
