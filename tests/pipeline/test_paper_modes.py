"""The paper's modes: additive blending, its initialisations, its schedules, its losses."""

import itertools

import numpy as np
import pytest
from conftest import random_sum
from flat import choices, fit_config

from gauss2svg.errors import InputError
from gauss2svg.fit import FitOptions
from gauss2svg.fit.adam import blending_of
from gauss2svg.fit.fit import convert_additive, fit
from gauss2svg.fit.placement import place
from gauss2svg.fit.schedule import totals
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.target import Target
from gauss2svg.measure import metrics
from gauss2svg.render import render

PLACEMENTS, SCHEDULES = choices("init"), choices("schedule")
BOTH = pytest.mark.parametrize("blend", ["over", "add"])


def quality_of(pixels, **options) -> float:
    return metrics.psnr(render(fit(pixels, fit_config(**options)).scene), pixels)


@pytest.mark.parametrize("placement", PLACEMENTS)
@pytest.mark.parametrize("schedule", SCHEDULES)
def test_additive_gaussians_fit_the_photo_by_every_placement_and_schedule(
    photo, placement, schedule
):
    options = {"gaussians": 100, "iterations": 60, "init": placement, "schedule": schedule}
    assert quality_of(photo[::2, ::2], blend="add", **options) > 20


def test_a_fitted_additive_gaussian_has_eight_parameters(photo):
    scene = fit(photo, fit_config(100, 60, blend="add")).scene
    assert scene.blend == "add"
    assert (scene.opacity == 1).all()
    assert (scene.beta == 1).all()
    assert scene.color.min() < 0 < scene.color.max()
    assert np.abs(scene.color).max() <= blending_of(FitOptions(blend="add")).most_color


def test_more_additive_gaussians_raise_psnr(photo):
    few, some, many = (
        quality_of(photo, gaussians=n, iterations=100, blend="add") for n in (20, 100, 500)
    )
    assert few + 2 < some
    assert some + 1.5 < many


def test_an_additive_scene_is_recovered_from_its_render():
    scene = random_sum(3, 48, 40, 1)
    target = render(scene.replace(color=np.abs(scene.color) * 0.5, background=np.full(3, 0.2)))
    assert quality_of(target, gaussians=12, iterations=300, blend="add") > 45


def test_the_same_seed_gives_the_same_additive_scene_and_another_seed_another(photo):
    def scene(seed: int):
        return fit(
            photo, fit_config(50, 40, blend="add", init="random", seed=seed)
        ).scene  # fmt: skip

    one, again, other = scene(3), scene(3), scene(4)
    np.testing.assert_array_equal(one.color, again.color)
    np.testing.assert_array_equal(one.mean, again.mean)
    assert not np.isin(one.mean, other.mean).all()


def test_new_additive_gaussians_share_the_residual():
    # All at one bright place: if each added all of it, they would overshoot many times.
    pixels = np.zeros((64, 64, 3), np.float32)
    pixels[28:36, 28:36] = 1.0
    config = fit_config(60, 10, blend="add", init="error")
    population = FitSession(pixels, config).population
    population.background = np.zeros(3)
    population._add(np.zeros((3, 64, 64), np.float32), 60, 60)
    assert 0.7 < population.rendered().max() < 1.5


def blank(target: Target) -> np.ndarray:
    return np.full_like(target.planar, 0.25)


@pytest.mark.parametrize("placement", PLACEMENTS)
def test_new_additive_gaussians_have_the_residuals_colour_and_others_the_targets(placement):
    planar = np.zeros((3, 40, 60), np.float32)
    planar += np.array([1.0, 0.5, 0.0], np.float32)[:, None, None]
    target = Target(planar, "psnr")
    for blend, expected in (("over", [1.0, 0.5, 0.0]), ("add", [0.75, 0.25, -0.25])):
        rng = np.random.default_rng(0)
        new = place(placement, target, blank(target), 9, 9, rng, blend == "add")
        np.testing.assert_allclose(new.color, np.tile(expected, (9, 1)), atol=1e-6)


@BOTH
def test_live_begins_on_the_largest_components_as_the_paper_says(blend):
    planar = np.full((3, 60, 80), 0.25, np.float32)
    planar[:, 10:30, 8:28] = 1.0  # 400 px around (18, 20)
    planar[:, 40:50, 50:60] = 1.0  # 100 px around (55, 45)
    planar[:, 5, 70] = 0.3  # under the threshold
    target = Target(planar, "psnr")
    new = place(
        "live",
        target,
        blank(target),
        6,
        6,
        np.random.default_rng(0),
        blend == "add",
    )
    np.testing.assert_allclose(new.mean[:2], [[18, 20], [55, 45]])
    # sigma = sqrt(A / (r s^2)) units of s / 10 px, r = 0.07, whatever the kernel size s
    for k, area in enumerate((400, 100)):
        for kernel_size in (21, 101):
            sigma = np.sqrt(area / (0.07 * kernel_size**2)) * kernel_size / 10
            np.testing.assert_allclose(new.factor[k], [sigma, 0, sigma])
    assert len(new.mean) == 6  # the rest at random
    assert len(np.unique(new.mean[2:], axis=0)) == 4


def test_live_separates_bins_of_the_residual():
    planar = np.full((3, 40, 40), 0.25, np.float32)
    planar[:, 5:35, 5:35] = 0.6  # a frame of one bin around a square of another
    planar[:, 15:25, 15:25] = 1.0
    target = Target(planar, "psnr")
    rng = np.random.default_rng(0)
    new = place("live", target, blank(target), 2, 2, rng, additive=True)
    areas = [900 - 100, 100]
    np.testing.assert_allclose(new.factor[:, 0] ** 2 * 7, areas)


def test_random_begins_anywhere_with_every_shape():
    target = Target(np.random.default_rng(1).random((3, 50, 90)).astype(np.float32), "psnr")
    rng = np.random.default_rng(0)
    new = place("random", target, blank(target), 2000, 2000, rng, additive=True)
    assert (new.mean.min(axis=0) < [2, 2]).all()
    assert (new.mean.max(axis=0) > [88, 48]).all()
    sigma_y = np.hypot(new.factor[:, 1], new.factor[:, 2])
    rho = new.factor[:, 1] / sigma_y
    assert rho.min() < -0.9
    assert rho.max() > 0.9
    assert np.abs(rho).max() < 1
    sigma = np.stack([new.factor[:, 0], sigma_y], axis=1)
    unit = np.sqrt(50 * 90 / (2000 * np.pi))  # of a disc with each one's share of the area
    assert sigma.max() <= max(unit, 0.8)
    few = place("random", target, blank(target), 40, 40, rng, additive=True)
    sigma = np.stack([few.factor[:, 0], np.hypot(few.factor[:, 1], few.factor[:, 2])], axis=1)
    unit = np.sqrt(50 * 90 / (40 * np.pi))
    assert 0.8 * unit < sigma.max() <= unit
    assert sigma.min() < 0.25 * unit


@pytest.mark.parametrize(
    ("schedule", "gaussians", "per_round", "expected"),
    [
        ("exponential", 127, 64, [1, 3, 7, 15, 31, 63, 127]),
        ("exponential", 127, 16, [1, 3, 7, 15, 31, 47, 63, 79, 95, 111, 127]),
        ("exponential", 9, 100, [1, 3, 7, 9]),
        ("linear", 100, 30, [30, 60, 90, 100]),
        ("linear", 7, 7, [7]),
        ("exponential", 0, 4, []),
    ],
)
def test_rounds_add_as_the_papers_schedules_do(schedule, gaussians, per_round, expected):
    assert totals(schedule, gaussians, 300, per_round) == expected
    assert fit_config(gaussians, 300, schedule=schedule, per_round=per_round).totals == expected


def test_every_round_has_its_iterations(photo):
    options = fit_config(
        15, 60, blend="add", schedule="exponential", per_round=8, round_iterations=10
    )
    counts = []
    fit(photo, options, lambda p: counts.append(p.gaussians))
    assert counts == [1] * 10 + [3] * 10 + [7] * 10 + [15] * 30


@pytest.mark.parametrize("schedule", ["exponential", "all-at-once"])
def test_no_step_is_added_where_rounds_take_all(photo, schedule):
    per_round = 8 if schedule == "exponential" else None
    each = 10 if schedule == "exponential" else 40
    options = fit_config(
        15, 40, schedule=schedule, per_round=per_round, round_iterations=each, blend="add"
    )
    assert fit(photo, options).iterations == 40


def test_conversion_keeps_the_render_of_an_additive_scene(photo):
    additive = fit(photo, fit_config(80, 60, blend="add")).scene
    shown = render(additive)
    composited = convert_additive(additive, config=fit_config(iterations=80)).scene
    assert composited.blend == "over"
    assert len(composited) <= 80
    assert metrics.psnr(render(composited), shown) > 28
    by_photo = convert_additive(additive, photo, fit_config(iterations=80)).scene
    of_the_photo = metrics.psnr(render(by_photo), photo)
    assert of_the_photo > quality_of(photo, gaussians=80, iterations=80) - 0.3
    assert of_the_photo > metrics.psnr(shown, photo)


def test_conversion_refuses_scenes_and_configs_of_the_other_blending(photo):
    composited = fit(photo, fit_config(5, 5)).scene
    sums = random_sum(3, 20, 20, 1)
    for scene, config in ((composited, fit_config()), (sums, fit_config(blend="add"))):
        with pytest.raises(
            InputError, match="the scene must be additive, and fitted by a config of blend 'over'"
        ):
            convert_additive(scene, config=config)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"blend": "add", "falloff": "adaptive"}, "gaussian with additive blending; got 'adapt"),
        ({"per_round": 4, "schedule": "all-at-once"}, "exponential or linear .*; got 'all-at-once"),
        ({"per_round": 1, "schedule": "linear"}, "room for 5000 rounds of 1 or more; got 60"),
        ({"round_iterations": 40}, "room for 6 rounds of 40 or more; got 200"),
        ({"ssim_weight": 0.5}, "loss must be one with ssim if ssim_weight is given; got 'mse'"),
    ],
)
def test_bad_options_are_refused_with_their_name(change, message):
    with pytest.raises(InputError, match=message):
        fit_config(**change)


def test_falloff_follows_the_blending():
    assert fit_config().fit.learned_falloff
    assert not fit_config(blend="add").fit.learned_falloff
    assert not fit_config(falloff="gaussian").fit.learned_falloff


def test_without_relocation_no_gaussian_is_replaced(photo):
    def moved(relocate: bool) -> int:
        ages = []
        config = fit_config(60, 80, blend="add", relocate=relocate)
        session = FitSession(
            photo,
            config,
            progress=lambda _: ages.append(session.state.age.copy()),
        )
        session.fit()
        full = [age for age in ages if len(age) == 60]
        return sum(int((b < a).sum()) for a, b in itertools.pairwise(full))

    assert moved(True) > 0
    assert moved(False) == 0


def test_rounds_run_at_full_size_without_reduce(photo):
    def sizes(reduce: bool) -> set[int]:
        seen = set()
        config = fit_config(64, 40, blend="add", reduce=reduce)
        session = FitSession(
            photo,
            config,
            progress=lambda _: seen.add(session.population.target.width),
        )
        session.fit()
        return seen

    assert sizes(False) == {128}
    assert min(sizes(True)) < 128


@pytest.mark.sweep
def test_a_heavier_ssim_keeps_more_structure(photo):
    options = {"gaussians": 200, "iterations": 80, "loss": "mse+ssim"}
    scores = []
    for weight in (0.0, 0.5):
        drawn = render(fit(photo, fit_config(ssim_weight=weight, **options)).scene)
        scores.append((metrics.psnr(drawn, photo), metrics.ssim(drawn, photo)))
    (psnr, ssim), (psnr_structure, ssim_structure) = scores
    assert ssim_structure > ssim + 0.01
    assert psnr_structure < psnr
