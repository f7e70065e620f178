"""Laws of the paper's kernels: where a window ends, and what that costs."""

import math

import numpy as np
import pytest
import torch
from conftest import random_sum
from hypothesis import given
from hypothesis import strategies as st
from paper.kernel_window import edge_values, reaches, sum_in_windows

from gauss2svg.errors import InputError

NAMES = ("mean", "sigma", "rho", "color", "background")
seeds = st.integers(0, 2**32 - 1)
sizes = st.floats(4, 60)
either = pytest.mark.parametrize("adaptive", [False, True], ids=["fixed", "adaptive"])
WIDTH, HEIGHT = 50, 40
AT_2_5_SIGMA = math.exp(-(2.5**2) / 2)


def tensors_of(scene) -> list[torch.Tensor]:
    return [torch.tensor(getattr(scene, name)).requires_grad_() for name in NAMES]


def drawn(scene, kernel_size: float, adaptive: bool) -> np.ndarray:
    tensors = tensors_of(scene)
    image = sum_in_windows(*tensors, HEIGHT, WIDTH, kernel_size, adaptive)
    return image.detach().numpy()


def uncropped(scene) -> np.ndarray:
    """The sum by numpy, from the conic, on no window: an oracle of its own."""
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    image = np.broadcast_to(scene.background, (HEIGHT, WIDTH, 3)).copy()
    for k in range(len(scene)):
        u = np.stack([x - scene.mean[k, 0], y - scene.mean[k, 1]], axis=-1)
        squared = np.einsum("yxi,ij,yxj->yx", u, scene.conic[k], u)
        image += np.exp(-squared / 2)[..., None] * scene.color[k]
    return image


def single(sigma, rho=0.0, color=(1.0, -0.5, 0.25), mean=(25.5, 20.5)):
    return random_sum(1, WIDTH, HEIGHT, 0).replace(
        mean=np.array([mean]), sigma=np.array([sigma]), rho=np.array([rho]),
        color=np.array([color]), background=np.zeros(3),
    )  # fmt: skip


@given(seeds, sizes)
def test_windows_agree_where_no_sigma_is_above_two_units(seed, kernel_size):
    scene = random_sum(12, WIDTH, HEIGHT, seed)
    scene = scene.replace(sigma=np.minimum(scene.sigma, 2 * kernel_size / 10))
    fixed, adaptive = (drawn(scene, kernel_size, adaptive) for adaptive in (False, True))
    np.testing.assert_array_equal(fixed, adaptive)


@given(seeds, sizes)
def test_an_adaptive_window_leaves_out_no_more_than_the_tail_beyond_2_5_sigma(seed, kernel_size):
    scene = random_sum(12, WIDTH, HEIGHT, seed).replace(round_index=None)
    missed = np.abs(drawn(scene, kernel_size, adaptive=True) - uncropped(scene))
    assert (missed <= AT_2_5_SIGMA * np.abs(scene.color).sum(axis=0) + 1e-12).all()
    assert (edge_values(torch.tensor(scene.sigma), kernel_size, True) <= AT_2_5_SIGMA + 1e-12).all()


@given(sizes, st.floats(0.5, 40), st.floats(0.5, 40), st.floats(-0.9, 0.9))
def test_a_fixed_window_is_the_bell_inside_and_nothing_outside(kernel_size, sx, sy, rho):
    scene = single((sx, sy), rho, mean=(24.2, 20.9))
    y, x = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    inside = np.maximum(np.abs(x - 24.2), np.abs(y - 20.9)) <= kernel_size / 2
    image = drawn(scene, kernel_size, adaptive=False)
    assert (image[~inside] == 0).all()
    np.testing.assert_allclose(image[inside], uncropped(scene)[inside], atol=1e-12)


def test_a_fixed_window_crops_where_an_adaptive_one_has_grown():
    scene = single((12.0, 3.0))  # units of 2 px: 6 of them
    fixed, adaptive = (drawn(scene, 20.0, adaptive) for adaptive in (False, True))
    assert fixed[20, 35, 0] > 0.7  # 10 px right of the mean, on the edge
    assert fixed[20, 36, 0] == 0
    assert adaptive[20, 36, 0] > 0.6
    assert float(reaches(torch.tensor(scene.sigma), 20.0, True)[0]) == pytest.approx(30.0)
    np.testing.assert_allclose(adaptive[:, :, 0], uncropped(scene)[:, :, 0], atol=AT_2_5_SIGMA)


@pytest.mark.parametrize("rho", [0.0, 0.6, -0.9])
@pytest.mark.parametrize("sigma", [(6.0, 3.0), (3.0, 6.0), (5.0, 5.0)])
@either
def test_the_jump_at_an_edge_is_what_the_exponential_has_there(sigma, rho, adaptive):
    sigmas = torch.tensor([sigma], dtype=torch.float64)
    share = float(edge_values(sigmas, 16.0, adaptive)[0])
    reach = float(reaches(sigmas, 16.0, adaptive)[0])
    along = np.linspace(-reach, reach, 4001)
    k = math.sqrt(1 - rho**2)
    sides = [(reach, along), (along, reach)]
    squares = [(u / sigma[0]) ** 2 + ((v / sigma[1] - rho * u / sigma[0]) / k) ** 2
               for u, v in sides]  # fmt: skip
    assert share == pytest.approx(max(np.exp(-0.5 * s).max() for s in squares), rel=1e-5)


def test_the_jump_in_the_picture_is_that_of_the_edge():
    # The last pixel centre inside lies on the edge, the next beyond it.
    scene = single((6.0, 6.0), color=(0.8, -0.4, 0.2))
    row = drawn(scene, 2 * 8.0, adaptive=False)[20, :, 0]
    jump = row[25 + 8] - row[25 + 9]
    expected = 0.8 * float(edge_values(torch.full((1, 2), 6.0), 16.0, adaptive=False)[0])
    assert jump == pytest.approx(expected, rel=1e-6)


@given(seeds, sizes, st.booleans())
def test_a_sum_is_the_sum_of_its_parts_in_any_order(seed, kernel_size, adaptive):
    scene = random_sum(8, WIDTH, HEIGHT, seed).replace(round_index=None)
    whole = drawn(scene, kernel_size, adaptive)
    black = scene.replace(background=np.zeros(3))
    parts = [drawn(black.select(np.array([k])), kernel_size, adaptive) for k in range(7, -1, -1)]
    np.testing.assert_allclose(whole, scene.background + np.sum(parts, axis=0), atol=1e-12)


@either
def test_coefficients_of_densities_integrate_to_themselves(adaptive):
    scene = single((2.5, 1.8), rho=0.4)
    total = drawn(scene, 40.0, adaptive).sum(axis=(0, 1))  # all but 1e-10 lies inside
    np.testing.assert_allclose(total, scene.densities[0], rtol=1e-6)


@either
def test_gradients_are_those_of_finite_differences(adaptive):
    scene = random_sum(4, WIDTH, HEIGHT, 3)
    # Sizes at which no pixel centre lies near a window's edge.
    weights = torch.tensor(np.random.default_rng(0).normal(size=(HEIGHT, WIDTH, 3)))

    def loss(tensors):
        return (weights * sum_in_windows(*tensors, HEIGHT, WIDTH, 23.4567, adaptive)).sum()

    tensors = tensors_of(scene)
    loss(tensors).backward()
    values = [tensor.detach().clone() for tensor in tensors]
    for which, tensor in enumerate(tensors):
        flat = values[which].view(-1)
        for i in range(len(flat)):
            before, ends = float(flat[i]), []
            for change in (1e-6, -1e-6):
                flat[i] = before + change
                ends.append(float(loss(values)))
            flat[i] = before
            slope = (ends[0] - ends[1]) / 2e-6
            assert float(tensor.grad.view(-1)[i]) == pytest.approx(slope, rel=1e-4, abs=1e-4)
        assert tensor.grad.abs().max() > 0


@pytest.mark.parametrize("kernel_size", [0, -3, math.nan])
def test_a_window_without_a_width_is_refused(kernel_size):
    with pytest.raises(InputError, match="kernel_size"):
        sum_in_windows(*tensors_of(single((2, 2))), HEIGHT, WIDTH, kernel_size, True)
