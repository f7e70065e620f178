"""More is not worse: presets, limits of bytes, and why plain drawings do not diverge."""

from types import SimpleNamespace

import numpy as np
import pytest
from flat import fit_config, vectorize

from gauss2svg.fit import FitOptions, adam
from gauss2svg.fit.adam import DivergenceGuard, blending_of
from gauss2svg.fit.fit import fit
from gauss2svg.fit.population import Population
from gauss2svg.fit.state import STEPS, State
from gauss2svg.pipeline.budgets import TimeBudget
from gauss2svg.pipeline.export import Exporter
from gauss2svg.pipeline.limits import Limits
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.outcome import Subject
from gauss2svg.pipeline.plan import PRESETS, Plan

_SIDE, _FINER = 96, 4


@pytest.fixture(scope="module")
def smile() -> np.ndarray:
    """A face of flat colours, antialiased."""
    y, x = np.mgrid[: _SIDE * _FINER, : _SIDE * _FINER] * (128 / _SIDE / _FINER)
    r = np.hypot(x - 64, y - 64)
    picture = np.ones((*r.shape, 3), np.float32)
    picture[r < 54] = 0.2, 0.15, 0.05
    picture[r < 50] = 1.0, 0.8, 0.2
    for eye in (45, 83):
        picture[np.hypot(x - eye, 0.7 * (y - 50)) < 6] = 0.2, 0.15, 0.05
    mouth = (np.abs(np.hypot(x - 64, y - 66) - 30) < 3) & (y > 74)
    picture[mouth] = 0.7, 0.1, 0.1
    return picture.reshape(_SIDE, _FINER, _SIDE, _FINER, 3).mean(axis=(1, 3))


@pytest.mark.sweep
def test_dearer_preset_is_not_worse(smile):
    found = [
        vectorize(smile, quality=quality).report["psnr_svg"]
        for quality in ("draft", "fast", "balanced")
    ]
    assert found == sorted(found)


@pytest.mark.sweep
def test_plain_drawing_does_not_diverge(smile):
    assert vectorize(smile, gaussians=256).report["rollbacks"] == 0


def test_crisp_shapes_move_less_because_their_rims_are_narrower():
    moved = []
    for beta in (1.0, 3.0, 30.0):
        state = State.of(
            np.full((1, 2), 20.0), np.array([[5.0, 0.0, 5.0]]), 0, raw_beta=np.log([beta])
        )
        adam.step(state, np.ones((1, STEPS)), blending_of(FitOptions()), 40.0, 0.01)
        moved.append(20.0 - state.mean[0, 0])
    assert moved[0] > 1.3 * moved[1] > 1.3**3 * moved[2] > 0


@pytest.mark.sweep
def test_interrupted_run_has_the_palette_of_a_finished_one(photo):
    last = []
    whole = vectorize(photo, quality="fast").report
    for share in (0.3, 0.6, 0.9):
        report = vectorize(
            photo, quality="fast",
            progress=lambda progress: last.append(progress.fit),
            stop=lambda: bool(last and last[-1] and last[-1].done >= share),  # noqa: B023
        ).report  # fmt: skip
        assert report["stop_reason"] == "interrupted"
        each, usual = (r["svg_bytes"] / r["gaussians"] for r in (report, whole))
        assert each < 1.3 * usual
        last.clear()


def test_small_picture_gets_no_fewer_steps_than_by_a_cheaper_preset():
    fast = Options.from_flat({"quality": "fast"})
    preset, cheaper = PRESETS["fast"], PRESETS["draft"]
    assert cheaper.iterations > preset.iterations
    for side, steps in ((cheaper.max_size, cheaper), (preset.max_size, preset), (None, preset)):
        assert Plan(fast, fit_side=side).fit_config.iterations == steps.iterations


@pytest.mark.parametrize(
    ("found", "best"),
    [
        ([(70, 34.3), (59, 28.4), (50, 24.0)], 59),  # near the goal of 28 dB, also if larger
        ([(70, 30.9), (59, 27.3)], 59),  # the smaller of two that are near
        ([(90, 43.0), (70, 34.3), (50, 24.0)], 70),  # the smaller of those beyond
        ([(50, 24.0), (40, 23.0)], 50),  # the nearest below
    ],
)
def test_best_export_is_the_smallest_near_the_goal(found, best):
    plan = Plan(Options.from_flat({"quality": "draft"}))
    limits = Limits(plan, Exporter(plan, Subject.of(np.zeros((1, 1, 3)))), TimeBudget(), 10**5)
    exports = [SimpleNamespace(size=size, score=score) for size, score in found]
    assert limits.best(exports).size == best  # pyright: ignore[reportArgumentType]


def test_finished_fit_continues_in_small_steps_that_grow():
    guard = DivergenceGuard()
    guard.begin_gently()
    rates = [guard.rate]
    while guard.rate < 1 and len(rates) < 50:
        assert guard.accepts(1.0, 1.0, object)
        rates.append(guard.rate)
    assert rates[0] == adam.GENTLE
    assert rates == sorted(rates)
    assert 10 < len(rates) < 20


@pytest.mark.parametrize(("contrast", "relocates"), [(0.2, True), (1e-3, False)])
def test_nothing_is_relocated_where_the_error_does_not_show(contrast, relocates, monkeypatch):
    calls = []
    monkeypatch.setattr(Population, "relocate", lambda self: calls.append(len(self)))
    noise = np.random.default_rng(0).random((40, 40, 3)).astype(np.float32)
    fit(0.4 + np.float32(contrast) * noise, fit_config(40, 60))
    assert bool(calls) == relocates
