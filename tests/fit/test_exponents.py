"""Properties of the falloff exponent in a fit and in its file, and of colours that shapes share."""

import numpy as np
import pytest
from conftest import random_scene
from flat import fit_config, vectorize

from gauss2svg.fit import FitOptions
from gauss2svg.fit.adam import blending_of, gradients
from gauss2svg.fit.colors import SharedColors
from gauss2svg.fit.fit import fit
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.state import State
from gauss2svg.measure import metrics
from gauss2svg.pipeline.palette import quantize
from gauss2svg.render import render
from gauss2svg.render.cpu import removal_cost, squared_error
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES, half_radius
from gauss2svg.svg.forms import is_plain

QUICK = {"iterations": 60}


def drawing(side: int = 96) -> np.ndarray:
    """A disc and a bar with antialiased edges on a light ground, (side, side, 3) float32."""
    y, x = (np.mgrid[: 4 * side, : 4 * side] + 0.5) / (4 * side)
    picture = np.full((4 * side, 4 * side, 3), 0.93)
    picture[np.hypot(x - 0.4, y - 0.45) < 0.27] = (0.9, 0.6, 0.1)
    picture[(abs(x - 0.7) < 0.2) & (abs(y - 0.75) < 0.09)] = (0.1, 0.2, 0.5)
    small = picture.reshape(side, 4, side, 4, 3).mean(axis=(1, 3))
    return (np.round(small * 255) / 255).astype(np.float32)


def test_sharp_shapes_fit_a_drawing_that_gaussians_smear():
    picture = drawing()
    soft, sharp = (
        fit(picture, fit_config(24, 150, falloff=f)).scene for f in ("gaussian", "adaptive")
    )
    assert (soft.beta == 1).all()
    psnr = [metrics.psnr(render(scene), picture) for scene in (soft, sharp)]
    assert psnr[1] > psnr[0] + 6
    assert metrics.flat_error(render(sharp), picture) < metrics.flat_error(render(soft), picture)
    assert (sharp.beta > 2).mean() > 0.4


def test_smooth_scene_keeps_its_gaussians():
    y, x = np.mgrid[:64, :64] / 63
    ramp = np.stack([x, 0.5 * (x + y), 1 - y], axis=-1).astype(np.float32)
    shares = [
        (vectorize(p, gaussians=24, **QUICK).scene.beta == 1).mean() for p in (ramp, drawing())
    ]
    assert shares[0] >= 0.5
    assert shares[1] < shares[0] - 0.1


# The last steps, before which exponents and colours are quantized, may not come.
@pytest.mark.parametrize(
    "options",
    [
        *({"iterations": 60, "palette": palette} for palette in (None, 4, 0)),
        {"iterations": 1, "palette": 16, "falloff": "gaussian"}, {"iterations": 7, "palette": 16},
        {"time_limit": 0.2, "target_psnr": 26.0, "palette": 16},
    ],
)  # fmt: skip
def test_file_draws_the_exponents_and_colours_that_the_scene_has(options):
    result = vectorize(drawing(), gaussians=40, **options)
    scene = result.scene
    shaded = ~is_plain(scene)
    classes = np.array(BETA_CLASSES)
    assert np.abs(scene.beta[shaded, None] / classes - 1).min(axis=1).max(initial=0) < 1e-12
    assert options.get("falloff") != "gaussian" or (scene.beta == 1).all()
    again = quantize(scene)
    np.testing.assert_allclose(again.color, scene.color, atol=0.5 / 255)
    np.testing.assert_allclose(again.beta, scene.beta, rtol=1e-12)
    keys = np.column_stack([scene.beta, np.round(scene.color * 255)])[shaded]
    gradients = len(np.unique(np.round(keys, 6), axis=0))
    assert result.svg.count("<radialGradient") == result.report["gradients"] == gradients
    assert gradients <= (options["palette"] or 40)
    if "time_limit" not in options:  # the clock decides how many shapes that fit has
        assert result.report["psnr_roundtrip"] > 44


def test_quantization_changes_nothing_but_exponents_extents_and_colours():
    scene = random_scene(60, 120, 90, 7, sigma=(1.0, 20.0))
    once = quantize(scene, palette=12)
    for name in ("mean", "rho", "opacity", "round_index"):
        assert (getattr(once, name) == getattr(scene, name)).all()
    shaded = ~is_plain(scene)
    assert (once.beta[~shaded] == scene.beta[~shaded]).all()
    expected = scene.sigma * (half_radius(scene.beta) / half_radius(once.beta))[:, None]
    np.testing.assert_allclose(once.sigma, expected)
    assert len(np.unique(np.column_stack([once.beta, once.color])[shaded], axis=0)) <= 12
    assert metrics.psnr(render(once), render(scene)) > 25


def test_exponents_stay_and_colours_stay_shared_once_they_are_quantized(photo):
    seen = []

    def as_written(scene, psnr):
        seen.append(quantize(scene, palette=8))
        return seen[-1]

    session = FitSession(photo, fit_config(60, 80), as_written=as_written)
    session.fit()
    assert len(seen) == 1
    last = session.scene()
    pairs = [{*zip(s.beta, *s.color.T.round(9), strict=True)} for s in (seen[0], last)]
    assert len(pairs[1]) <= len(pairs[0])
    assert set(last.beta.round(9)) <= set(seen[0].beta.round(9))
    assert not np.isin(last.color, seen[0].color).all()  # but as one they moved on
    assert not np.isin(last.mean, seen[0].mean).any()  # the rest moved on


@pytest.mark.parametrize(
    ("sigma", "beta", "plain"),
    [([20, 20], 64, True), ([200, 200], 64, False), ([60, 60], 64, False), ([200, 20], 64, False),
     ([1, 1], 2, False), ([20, 20], 2, False), ([90, 90], 16, False)],
)  # fmt: skip
def test_plain_are_crisp_shapes_and_no_others(sigma, beta, plain):
    scene = Scene(99, 99, [[50, 50]], [sigma], [0], np.zeros((1, 3)), [1], beta=[beta])
    assert is_plain(scene).tolist() == [plain]


COUNT = 60


def state_of(scene) -> State:
    raw_opacity = np.log(scene.opacity / (1 - scene.opacity))
    state = State.of(scene.mean, np.zeros((len(scene), 3)), 0, raw_opacity=raw_opacity)
    return state.quantized(scene)


@pytest.fixture
def session():
    """A session on noise whose shapes share twelve colours, and those."""
    pixels = np.random.default_rng(1).random((45, 60, 3)).astype(np.float32)
    session = FitSession(pixels, fit_config(COUNT, 10))
    session.population.state = state_of(
        quantize(random_scene(COUNT, 60, 45, 5, (1, 8), (1, 8)), palette=12)
    )
    return session


def error_of(session, state=None) -> float:
    splats = (state or session.state).splats(session.population.background)
    return squared_error(splats, session.population.target.planar)[1]


def test_step_keeps_shared_colours_shared_and_goes_down(session):
    state, target = session.state, session.population.target.planar
    shared = SharedColors.of(state, blending_of(FitOptions()))
    before, error = state.color.copy(), error_of(session)
    for _ in range(10):
        splats = state.splats(session.population.background)
        shared.step(state, gradients(squared_error(splats, target)[2], splats), 1.0)
    assert error_of(session) < error
    for entry in np.unique(shared.entry):
        of_entry = state.color[shared.entry == entry]
        assert (of_entry == of_entry[0]).all()
    assert (state.color != before).any(axis=1).mean() > 0.9


def test_exchanged_colours_leave_the_least_error_if_the_others_stay(session):
    state, target = session.state, session.population.target.planar
    shared = SharedColors.of(state, blending_of(FitOptions()))
    splats = state.splats(session.population.background)
    mass = removal_cost(splats, target)[1][:, 1]
    wanted = shared.best(state, squared_error(splats, target)[2], mass)
    for i in np.flatnonzero(mass > 1.0):
        errors = {}
        for k in np.unique(shared.entry[state.raw_beta == state.raw_beta[i]]):
            trial = state.copy()
            trial.color[i] = state.color[shared.entry == k][0]
            errors[k] = error_of(session, trial)
        assert errors[wanted[i]] == pytest.approx(min(errors.values()), rel=1e-6)
    assert np.count_nonzero(wanted != shared.entry) > 5
    errors = [error_of(session)]
    for _ in range(4):
        session.population.exchange(shared)
        errors.append(error_of(session))
    assert (np.diff(errors) <= 1e-6).all()
    assert errors[-1] < errors[0]


def test_nearly_opaque_shapes_become_opaque_at_quantization(photo):
    seen = []

    def as_written(scene, _):
        seen.append(scene.opacity)
        return quantize(scene, palette=50)

    config = fit_config(150, 60)
    FitSession(photo, config, as_written=as_written).fit()
    opacity = seen[0]
    assert not ((opacity > 0.954) & (opacity < 0.9999)).any()
    assert (opacity > 0.9999).any()
