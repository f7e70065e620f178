"""The fit: PSNR that it reaches, determinism, bounds, gradients, and the modes of the paper."""

import itertools

import numpy as np
import pytest
from flat import choices, fit_config, session_of
from scenes import random_areas, random_scene

from gauss2svg.errors import InputError
from gauss2svg.fit import PSNR, FitOptions
from gauss2svg.fit.placement import place
from gauss2svg.fit.session import FitSession, convert_additive, fit
from gauss2svg.fit.state import COLUMN_COUNT, FIRST_DECAY, State, columns_of, step
from gauss2svg.fit.target import Target
from gauss2svg.measure import metrics
from gauss2svg.photo.pixels import stacked
from gauss2svg.render import cpu, render, render_rgba
from gauss2svg.render.cpu import squared_error
from gauss2svg.scene import BLENDS, Scene
from gauss2svg.scene.scene import STEPPED

PLACEMENTS = choices("init")


def quality_of(pixels, **options) -> float:
    return metrics.psnr(render(fit(pixels, fit_config(**options)).scene), pixels)


@pytest.mark.parametrize(("blend", "gain"), [("over", 2), ("add", 1.5)])
def test_more_gaussians_and_more_iterations_raise_psnr(photo, blend, gain):
    few, some, many = (
        quality_of(photo, gaussians=n, iterations=60, blend=blend) for n in (20, 100, 500)
    )
    assert few + 2 < some
    assert max(some + gain, 26 if blend == "over" else 0) < many
    assert quality_of(photo, gaussians=100, iterations=15, blend=blend) + 1 < some


@pytest.mark.parametrize(
    "options",
    [*({"loss": loss} for loss in choices("loss")),
     *({"init": init, "blend": blend} for init in PLACEMENTS for blend in BLENDS),
     {"round_totals": (20, 60, 100)}],
)  # fmt: skip
def test_every_loss_placement_and_list_of_rounds_fits_the_photo(photo, options):
    result = fit(photo[::2, ::2], fit_config(100, 41, **options))
    assert result.iterations == 41
    assert metrics.psnr(render(result.scene), photo[::2, ::2]) > 20 + 2 * ("loss" in options)


@pytest.mark.parametrize("blend", BLENDS)
def test_same_seed_gives_the_same_bits_on_any_number_of_threads(photo, blend, monkeypatch):
    scenes = []
    for threads, seed in ((1, 3), (2, 3), (2, 4)):
        monkeypatch.setattr(cpu, "threads", threads)
        scenes.append(fit(photo, fit_config(150, 20, seed=seed, init="error", blend=blend)).scene)
    one, same, other = scenes
    for name in ("mean", "sigma", "rho", "color", "opacity"):
        assert getattr(one, name).tobytes() == getattr(same, name).tobytes()
    assert not np.array_equal(other.mean[: len(one)], one.mean[: len(other)])


def test_relocation_raises_psnr(photo):
    without, relocated = (
        quality_of(photo, gaussians=300, iterations=80, relocate=on) for on in (False, True)
    )
    assert relocated > without + 0.2


@pytest.mark.parametrize("clear", [False, True])
@pytest.mark.parametrize("count", [1, 40])
def test_a_fit_above_areas_begins_at_their_error_and_stays_at_a_picture_of_them(count, clear):
    ground = Scene(80, 60, areas=random_areas(6, 8, (80, 60)), transparent=clear)
    picture = (render_rgba if clear else render)(ground)
    spot = np.exp(-0.02 * np.square(np.mgrid[:60, :80].T - [20, 50]).sum(axis=-1).T)
    spotted = (1 - 0.6 * spot[:, :, None] * [1, 1, 1, 0][: picture.shape[2]]) * picture
    for target in (picture, spotted.astype(np.float32)):
        fitted = Target(target, PSNR, ground=ground)
        session = FitSession(fitted, fit_config(count, 60))
        before = metrics.psnr(stacked(picture), stacked(target))
        assert session.population.psnr() == pytest.approx(before, abs=0.01) or before > 120
        session.fit()
        scene = session.scene()
        assert scene.areas == ground.areas
        after = metrics.psnr(stacked((render_rgba if clear else render)(scene)), stacked(target))
        assert after > (60 if target is picture else before + 3)


def test_progress_reports_every_iteration_and_ends_with_none_left(photo):
    seen = []
    result = fit(photo, fit_config(64, 30), seen.append)
    assert [p.iteration for p in seen] == list(range(1, 31))
    for a, b in itertools.pairwise(seen):
        assert a.done <= b.done
        assert a.gaussians <= b.gaussians
    last = seen[-1]
    assert last.done > 0.9
    assert last.remaining_s < last.elapsed_s
    assert last.round == result.rounds
    assert last.psnr > seen[0].psnr


def state_of(scene) -> State:
    f = scene.factor
    raw = {raw.name: raw.inverse(getattr(scene, p.name)).copy() for p, raw in STEPPED}
    return State.of(scene.mean, f[:, [0, 1, 1], [0, 0, 1]], 0, **raw)


@pytest.mark.sweep
def test_gradients_in_the_gaussians_frame_are_those_of_autograd():
    torch = pytest.importorskip("torch")
    from gauss2svg.render.reference import composite

    scene = random_scene(6, 40, 30, seed=2, sigma=(2.0, 7.0))
    # a Gaussian proper leaves out what the exponent's gradient needs
    scene = scene.replace(beta=np.maximum(scene.beta, 1 + 1e-9))
    target = np.random.default_rng(0).random((3, 30, 40))
    state = state_of(scene)
    splats = state.splats(scene.background)
    moments = squared_error(splats, target)[2]
    step(state, moments, splats, columns_of(FitOptions()), 40.0)
    fast = state.adam_m / (1 - FIRST_DECAY)  # Adam's first moment after one step

    along = torch.zeros((6, COLUMN_COUNT), dtype=torch.float64, requires_grad=True)
    factor = torch.tensor(scene.factor)
    mean = torch.tensor(scene.mean) + torch.einsum("nij,nj->ni", factor, along[:, :2])
    a11, a12, a22 = along[:, 2], along[:, 3], along[:, 4]
    grow = torch.stack([torch.stack([a11, a12], -1), torch.stack([a12, a22], -1)], -2)
    moved = factor @ torch.matrix_exp(grow)
    covariance = moved @ moved.transpose(1, 2)
    sigma = torch.sqrt(torch.diagonal(covariance, dim1=1, dim2=2))
    rho = covariance[:, 0, 1] / (sigma[:, 0] * sigma[:, 1])
    opacity = torch.sigmoid(torch.logit(torch.tensor(scene.opacity)) + along[:, 5])
    color = torch.tensor(scene.color) + along[:, 6:9]
    beta = torch.tensor(scene.beta) * torch.exp(along[:, 9])
    ground = torch.tensor(scene.background)
    image = composite(mean, sigma, rho, color, opacity, ground, 30, 40, beta)
    (0.5 * (image - torch.tensor(np.moveaxis(target, 0, -1))) ** 2).sum().backward()
    assert along.grad is not None
    for column in range(COLUMN_COUNT):
        slow = along.grad[:, column].numpy()
        scale = np.abs(slow).max()
        np.testing.assert_allclose(fast[:, column] / scale, slow / scale, atol=1e-12)


def test_live_begins_on_the_largest_components_of_the_bins_as_the_paper_says():
    picture = np.full((60, 80, 3), 0.25)
    picture[10:30, 8:28] = 1.0  # 400 px around (18, 20)
    picture[40:50, 50:60] = 1.0  # 100 px around (55, 45)
    picture[5, 70] = 0.3  # under the threshold
    target = Target(np.asarray(picture, np.float32), "psnr")
    drawn = np.full(target.planar.shape, np.float32(0.25))
    new = place("live", target, drawn, 6, 6, np.random.default_rng(0), additive=True)
    np.testing.assert_allclose(new.mean[:2], [[18, 20], [55, 45]])
    # sigma = sqrt(A / (r s^2)) units of s / 10 px, r = 0.07, whatever the kernel size s
    for k, area in enumerate((400, 100)):
        sigma = np.sqrt(area / 0.07) / 10
        np.testing.assert_allclose(new.factor[k], [sigma, 0, sigma])
    assert len(new.mean) == 6  # the rest at random
    assert len(np.unique(new.mean[2:], axis=0)) == 4


@pytest.mark.parametrize("iterations", [40, 60])
def test_every_round_has_its_iterations_and_the_last_the_rest(photo, iterations):
    options = fit_config(
        15, iterations, blend="add", round_totals=(1, 3, 7, 15), round_iterations=10
    )
    counts = []
    fit(photo, options, lambda p: counts.append(p.gaussians))
    assert counts == [1] * 10 + [3] * 10 + [7] * 10 + [15] * (iterations - 30)


def test_conversion_keeps_the_render_of_an_additive_scene(photo):
    additive = fit(photo, fit_config(80, 60, blend="add")).scene
    shown = render(additive)
    composited = convert_additive(additive, config=fit_config(iterations=80)).scene
    assert composited.blend == "over"
    assert len(composited) <= 80
    assert metrics.psnr(render(composited), shown) > 28
    for scene, blend in ((composited, "over"), (additive, "add")):
        with pytest.raises(InputError, match="the scene must be additive, and fitted by a config"):
            convert_additive(scene, config=fit_config(blend=blend))


@pytest.mark.parametrize("move", [(4, 0), (0, 4)])
def test_a_fit_that_begins_with_a_scene_moves_its_shapes_to_where_they_are_now(move):
    scene = random_scene(20, 64, 48)
    picture = render(scene.replace(mean=scene.mean + move)).clip(0, 1)
    session = session_of(picture, fit_config(20))
    session.population.begin_with(scene)
    psnr = metrics.psnr(render(session.scene()), picture)
    assert psnr > metrics.psnr(render(scene), picture) + 5
