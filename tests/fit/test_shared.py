"""Laws of colours that shapes share: one step for all of them, and exchanges that gain."""

import numpy as np
import pytest
from conftest import random_scene
from flat import fit_config

from gauss2svg.fit.adam import blending_of, gradients
from gauss2svg.fit.options import FitOptions
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.shared import SharedColors
from gauss2svg.fit.state import COLOR, STEPS, State
from gauss2svg.pipeline.palette import quantize
from gauss2svg.render.cpu import removal_cost, squared_error

COUNT = 60


def state_of(scene) -> State:
    raw_opacity = np.log(scene.opacity / (1 - scene.opacity))
    state = State.of(scene.mean, np.zeros((len(scene), 3)), 0, raw_opacity=raw_opacity)
    return state.quantized(scene)


@pytest.fixture
def shared_state():
    scene = random_scene(COUNT, 60, 45, 5, (1, 8), (1, 8))
    return state_of(quantize(scene, palette=12))


@pytest.fixture
def target():
    return np.random.default_rng(1).random((3, 45, 60)).astype(np.float32)


def test_step_keeps_shared_colours_shared_and_goes_down(shared_state, target):
    state, background = shared_state, np.full(3, 0.5)
    shared = SharedColors.of(state, blending_of(FitOptions()))
    before = state.color.copy()
    error = squared_error(state.splats(background), target)[1]
    for _ in range(10):
        splats = state.splats(background)
        moments = squared_error(splats, target)[2]
        shared.step(state, gradients(moments, splats), 1.0)
    assert squared_error(state.splats(background), target)[1] < error
    for entry in np.unique(shared.entry):
        of_entry = state.color[shared.entry == entry]
        assert (of_entry == of_entry[0]).all()
    assert (state.color != before).any(axis=1).mean() > 0.9


def test_wanted_colour_leaves_the_least_error_if_the_others_stay(shared_state, target):
    state, background = shared_state, np.full(3, 0.5)
    shared = SharedColors.of(state, blending_of(FitOptions()))
    splats = state.splats(background)
    moments = squared_error(splats, target)[2]
    mass = removal_cost(splats, target)[1][:, 1]
    wanted = shared.best(state, moments, mass)
    palette = {k: state.color[shared.entry == k][0] for k in np.unique(shared.entry)}
    beta_of = {k: state.raw_beta[shared.entry == k][0] for k in palette}
    exchanged = 0
    for i in np.flatnonzero(mass > 1.0):
        errors = {}
        for k, color in palette.items():
            if beta_of[k] != state.raw_beta[i]:
                continue
            tried = state.color.copy()
            tried[i] = color
            trial = state.select(np.arange(COUNT))
            trial.color = tried
            errors[k] = squared_error(trial.splats(background), target)[1]
        assert errors[wanted[i]] == pytest.approx(min(errors.values()), rel=1e-6)
        assert beta_of[wanted[i]] == state.raw_beta[i]
        exchanged += wanted[i] != shared.entry[i]
    assert exchanged > 5


def test_exchange_never_makes_the_picture_worse_and_helps_this_one(shared_state, target):
    pixels = np.ascontiguousarray(np.moveaxis(target, 0, -1))
    config = fit_config(COUNT, 10)
    session = FitSession(pixels, config)
    session.population.state = shared_state
    shared = SharedColors.of(session.state, blending_of(FitOptions()))
    errors = [squared_error(session.state.splats(session.population.background), target)[1]]
    for _ in range(4):
        session.population.exchange(shared)
        errors.append(squared_error(session.state.splats(session.population.background), target)[1])
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


def test_weights_of_a_colour_sum_over_its_shapes(shared_state):
    state = shared_state
    shared = SharedColors.of(state, blending_of(FitOptions()))
    gradient = np.zeros((COUNT, STEPS))
    chosen = int(np.bincount(shared.entry).argmax())
    members = np.flatnonzero(shared.entry == chosen)
    before = state.color[members[0]].copy()
    # Opposite wishes of two shapes cancel: the shared colour stays.
    gradient[members[0], COLOR], gradient[members[1], COLOR] = 1.0, -1.0
    shared.step(state, gradient, 1.0)
    np.testing.assert_allclose(state.color[members], np.tile(before, (len(members), 1)))
