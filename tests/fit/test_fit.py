"""Properties of the fit: PSNR that it reaches, determinism, bounds of the shapes, gradients."""

import dataclasses
import itertools

import numba
import numpy as np
import pytest
from conftest import random_scene
from flat import choices, fit_config, fit_in

from gauss2svg.fit import population as population_module
from gauss2svg.fit.adam import LEAST_SIGMA, gradients
from gauss2svg.fit.fit import fit
from gauss2svg.fit.placement import place
from gauss2svg.fit.population import LEAST_OPACITY
from gauss2svg.fit.schedule import rate, reduction, totals
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.state import STEPS, State
from gauss2svg.fit.target import Target
from gauss2svg.measure import metrics
from gauss2svg.render import render
from gauss2svg.render.cpu import squared_error
from gauss2svg.scene import Scene
from gauss2svg.scene.scene import STEPPED

DTYPES = (np.float32, np.float64)
PLACEMENTS, SCHEDULES = choices("init"), choices("schedule")


def quality_of(pixels, **options) -> float:
    return metrics.psnr(render(fit(pixels, fit_config(**options)).scene), pixels)


def test_more_gaussians_and_more_iterations_raise_psnr(photo):
    few, some, many = (quality_of(photo, gaussians=n, iterations=100) for n in (20, 100, 500))
    assert few + 2 < some
    assert max(some + 2, 26) < many
    assert quality_of(photo, gaussians=100, iterations=20) + 1 < some


@pytest.mark.parametrize(
    "options",
    [*({"loss": loss} for loss in choices("loss")),
     *({"init": init, "schedule": s} for init in PLACEMENTS for s in SCHEDULES)],
)  # fmt: skip
def test_every_loss_placement_and_schedule_fits_the_photo(photo, options):
    result = fit(photo[::2, ::2], fit_config(100, 61, **options))
    assert result.iterations == 61
    assert metrics.psnr(render(result.scene), photo[::2, ::2]) > 20 + 2 * ("loss" in options)


@pytest.mark.usefixtures("threads_given_back")
@pytest.mark.parametrize("dtype", DTYPES)
def test_same_seed_gives_the_same_bits_on_any_number_of_threads(photo, dtype):
    options = fit_config(150, 40, init="error", seed=3)
    scenes = []
    for threads in sorted({1, numba.config.NUMBA_NUM_THREADS}):
        numba.set_num_threads(threads)
        scenes += [fit_in(dtype, photo, options).scene for _ in range(2)]
    for scene in scenes[1:]:
        for name in ("mean", "sigma", "rho", "color", "opacity"):
            assert getattr(scene, name).tobytes() == getattr(scenes[0], name).tobytes()
    other = fit_in(dtype, photo, fit_config(150, 40, init="error", seed=4)).scene
    assert not np.array_equal(other.mean[: len(scene)], scene.mean[: len(other)])


def test_renderers_can_draw_every_fitted_gaussian(photo):
    scene = fit(photo, fit_config(800, 60)).scene
    assert (scene.ellipse_axes[0] >= LEAST_SIGMA * 0.999).all()
    assert (scene.opacity >= LEAST_OPACITY).all()
    assert (np.diff(scene.round_index) >= 0).all()
    levels = scene.background * 255
    np.testing.assert_allclose(levels, np.round(levels), atol=1e-9)


@pytest.mark.parametrize("shape", [(1, 1), (1, 40), (40, 1), (2, 2), (3, 3), (17, 16)])
def test_pictures_of_any_shape_are_fitted(shape):
    pixels = np.random.default_rng(0).random((*shape, 3)).astype(np.float32)
    scene = fit(pixels, fit_config(10, 30)).scene
    assert np.isfinite(render(scene)).all()
    assert (scene.width, scene.height) == (shape[1], shape[0])
    flat = np.full((*shape, 3), 0.5, np.float32)
    assert metrics.psnr(render(fit(flat, fit_config(10, 30)).scene), flat) > 45
    empty = fit(pixels, fit_config(0, 30))
    assert (len(empty.scene), empty.iterations) == (0, 0)
    mean = pixels.mean(axis=(0, 1))
    np.testing.assert_allclose(empty.scene.background, mean, atol=0.5 / 255)


def test_relocation_raises_psnr(photo, monkeypatch):
    relocated = quality_of(photo, gaussians=400, iterations=120)
    monkeypatch.setattr(population_module, "RELOCATED", 0.0)
    assert relocated > quality_of(photo, gaussians=400, iterations=120) + 0.2


def test_what_renderers_would_not_draw_is_pruned(photo):
    session = FitSession(photo, fit_config(4))
    session.population.state = state_of(
        Scene(
            128, 128, np.array([[60, 60], [60, 60], [-500, 60]]), np.full((3, 2), 5.0),
            np.zeros(3), np.ones((3, 3)), np.array([0.5, LEAST_OPACITY / 2, 0.5]),
        )
    )  # fmt: skip
    session.population.prune_invisible()
    assert len(session.state) == 1


def test_early_rounds_run_on_a_reduced_target():
    counts = totals("exponential", 5000, 300)
    assert [reduction(n, 768, 512) for n in counts] == [8, 4, 4, 2, 2, 1]


def test_new_gaussians_lie_along_the_edge():
    planar = np.zeros((3, 40, 60), np.float32)
    planar[:, :, 30:] = 1  # a vertical edge
    target = Target(planar, "psnr")
    blank = np.full_like(planar, 0.5)
    blank[:, :, 28:32] = 0.0
    new = place("error", target, blank, 20, 20, np.random.default_rng(0))
    near = np.abs(new.mean[:, 0] - 30) < 3
    assert near.any()
    assert (new.factor[near, 2] > 1.5 * new.factor[near, 0]).all()


def test_progress_reports_every_iteration_and_ends_with_none_left(photo):
    seen = []
    result = fit(photo, fit_config(64, 30), seen.append)
    assert [p.iteration for p in seen] == list(range(1, 31))
    assert all(a.done <= b.done for a, b in itertools.pairwise(seen))
    assert seen[-1].done > 0.9
    assert seen[-1].remaining_s < seen[-1].elapsed_s
    assert seen[-1].round == result.rounds
    assert seen[-1].psnr > seen[0].psnr
    assert all(a.gaussians <= b.gaussians for a, b in itertools.pairwise(seen))


@pytest.mark.parametrize("schedule", SCHEDULES)
def test_rounds_grow_to_the_count(schedule):
    for count, iterations in itertools.product((1, 2, 7, 5000), (1, 5, 300)):
        rounds = totals(schedule, count, iterations)
        assert rounds[-1] == count
        assert all(a < b for a, b in itertools.pairwise(rounds))
        assert len(rounds) <= iterations


def test_learning_rate_decays_from_full_to_a_fiftieth():
    rates = [rate(i / 300) for i in range(300)]
    assert rates[0] == 1
    assert rates[-1] == pytest.approx(0.02)
    assert (np.diff(rates) <= 0).all()


def state_of(scene) -> State:
    f = scene.factor
    raw = {raw.name: raw.inverse(getattr(scene, p.name)).copy() for p, raw in STEPPED}
    return State.of(scene.mean, f[:, [0, 1, 1], [0, 0, 1]], 0, **raw)


def test_state_activates_to_the_scene_it_came_from():
    scene = random_scene(20, seed=1)
    back = state_of(scene).scene(scene.background, scene.width, scene.height)
    for name in ("mean", "sigma", "rho", "color", "opacity", "beta"):
        np.testing.assert_allclose(getattr(back, name), getattr(scene, name), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("dtype", "off"), [(np.float32, 2e-3), (np.float64, 1e-12)])
def test_gradients_in_the_gaussians_frame_are_those_of_autograd(dtype, off):
    torch = pytest.importorskip("torch")
    from gauss2svg.render.reference import composite

    scene = random_scene(6, 40, 30, seed=2, sigma=(2.0, 7.0))
    # a Gaussian proper leaves out what the exponent's gradient needs
    scene = scene.replace(beta=np.maximum(scene.beta, 1 + 1e-9))
    target = np.random.default_rng(0).random((3, 30, 40)).astype(dtype)
    # a copy, as fits have it: what cannot be written to is another type, to be compiled for itself
    splats = state_of(scene).splats(scene.background.copy())
    fast = gradients(squared_error(splats, target)[2], splats)

    step = torch.zeros((6, STEPS), dtype=torch.float64, requires_grad=True)
    factor = torch.tensor(scene.factor)
    mean = torch.tensor(scene.mean) + torch.einsum("nij,nj->ni", factor, step[:, :2])
    a11, a12, a22 = step[:, 2], step[:, 3], step[:, 4]
    grow = torch.stack([torch.stack([a11, a12], -1), torch.stack([a12, a22], -1)], -2)
    moved = factor @ torch.matrix_exp(grow)
    covariance = moved @ moved.transpose(1, 2)
    sigma = torch.sqrt(torch.diagonal(covariance, dim1=1, dim2=2))
    rho = covariance[:, 0, 1] / (sigma[:, 0] * sigma[:, 1])
    opacity = torch.sigmoid(torch.logit(torch.tensor(scene.opacity)) + step[:, 5])
    color = torch.tensor(scene.color) + step[:, 6:9]
    beta = torch.tensor(scene.beta) * torch.exp(step[:, 9])
    ground = torch.tensor(scene.background)
    image = composite(mean, sigma, rho, color, opacity, ground, 30, 40, beta)
    (0.5 * (image - torch.tensor(np.moveaxis(target, 0, -1))) ** 2).sum().backward()
    assert step.grad is not None
    for column in range(STEPS):
        slow = step.grad[:, column].numpy()
        scale = np.abs(slow).max()
        np.testing.assert_allclose(fast[:, column] / scale, slow / scale, atol=off)


@pytest.mark.parametrize("placement", PLACEMENTS)
def test_new_gaussians_lie_on_the_canvas_with_valid_shapes(photo, placement):
    target = Target(np.ascontiguousarray(np.moveaxis(photo, -1, 0)), "psnr")
    blank = np.zeros_like(target.planar)
    new = place(placement, target, blank, 77, 100, np.random.default_rng(0))
    assert new.mean.shape == (77, 2)
    assert ((new.mean >= 0) & (new.mean <= [target.width, target.height])).all()
    assert (new.factor[:, [0, 2]] > 0).all()
    assert ((new.color >= 0) & (new.color <= 1)).all()


def test_new_gaussians_go_where_the_error_is_selective_ones_with_its_area_and_colour():
    planar = np.zeros((3, 40, 60), np.float32)
    planar[1, 10:20, 30:45] = 0.75
    blank = np.zeros_like(planar)
    x, y = place("error", Target(planar, "psnr"), blank, 1, 1, np.random.default_rng(0)).mean[0]
    assert (26 < x < 49, 6 < y < 24) == (True, True)
    new = place("selective", Target(planar, "psnr"), blank, 1, 1, np.random.default_rng(0))
    np.testing.assert_allclose(new.mean[0], [37.5, 15])
    # 15 x 10 px: area and aspect of the rectangle, lying along x
    sigma = 0.5 * np.sqrt(150 / np.pi) * np.sqrt([1.5, 1 / 1.5])
    np.testing.assert_allclose(new.factor[0], [sigma[0], 0, sigma[1]], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(new.color[0], [0, 0.75, 0])


@pytest.mark.parametrize("times", [2, 4])
def test_the_gradient_at_two_sizes_is_that_of_finite_differences(photo, times):
    config = dataclasses.replace(fit_config(12, 20), enlarged=times)
    session = FitSession(np.ascontiguousarray(photo[:64, :64]), config)
    session.fit()
    population, state = session.population, session.state
    population.reduce_to(1)
    state.mean += np.random.default_rng(0).normal(scale=2.0, size=state.mean.shape)

    def loss():
        """Half the mean of both weighted squared errors, as if each were of the larger size."""
        own = state.scaled(1 / times, 1 / times).splats(population.background)
        small, _ = population._pyramid.reduced(times).squares(own)
        large, _ = population.target.squares(population.splats())
        return (large + times**2 * small) / 4

    # Only the optimiser sees the gradient, and steps by it at once.
    splats = population.splats()
    analytic = gradients(population.evaluate(splats, True).moments, splats)
    numeric = np.zeros((len(state), 2))
    for i, factor in enumerate(state.factor):
        mean = state.mean[i].copy()
        for axis, direction in enumerate(([factor[0], factor[1]], [0.0, factor[2]])):
            moved = []
            for sign in (1, -1):
                state.mean[i] = mean + sign * 0.02 * np.array(direction)
                moved.append(loss())
            numeric[i, axis] = (moved[0] - moved[1]) / (2 * 0.02)
        state.mean[i] = mean
    assert np.linalg.norm(numeric - analytic[:, :2]) < 0.02 * np.linalg.norm(numeric)
