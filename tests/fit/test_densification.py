"""Properties of the number of Gaussians that a fit has, and of the sizes at which it refines."""

import dataclasses
import itertools
import math
import time

import numpy as np
import pytest
from flat import fit_config

from gauss2svg.fit.population import Population
from gauss2svg.fit.schedule import FULL_FROM, GROWTH_SHARE, refinement_reduction
from gauss2svg.fit.session import STOP_REASONS, DensificationPolicy, FitSession, Snapshot
from gauss2svg.measure import metrics
from gauss2svg.pipeline.budgets import TimeBudget
from gauss2svg.pipeline.export import Exporter
from gauss2svg.pipeline.limits import (
    CONVERGES_ABOVE,
    CONVERGES_AFTER,
    GAIN_OF_A_ROUND,
    MOST_CHANGE,
    OVERFILL_GROWING,
    Limits,
)
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.outcome import Subject
from gauss2svg.pipeline.plan import PRESETS, USUAL_BYTES, Plan
from gauss2svg.render import render

KILOBYTES = USUAL_BYTES / 1000
BYTES = OVERFILL_GROWING * 10_000 / USUAL_BYTES  # shapes that fill 10 000 bytes while growing


def limits_of(gain=0.0, enough=math.inf, cap=10**6, **options) -> Limits:
    """The limits of a preset of these numbers, on a picture that is large enough for any count."""
    plan = Plan(Options.from_flat(options))
    preset = dataclasses.replace(PRESETS["balanced"], gain=gain, stop_psnr=enough, cap=cap)
    vars(plan)["preset"] = preset  # where a cached property keeps it
    exporter = Exporter(plan, Subject.of(np.zeros((1, 1, 3), np.float32)))
    return Limits(plan, exporter, TimeBudget(), 10**9)


def grown(psnr_at, policy):
    """Counts and stop reason of a growth whose PSNR is a function of the count."""
    counts = [0]
    while True:
        count = counts[-1]
        total = policy.grow(Snapshot(count, 0.1, lambda c=count: psnr_at(c), lambda: None))
        if total <= count:
            return counts[1:] + ([total] if total < count else []), policy.stop_reason
        counts.append(total)


def power_law(slope, start=10.0):
    """A doubling gains `slope` dB: an ideal scene that converges at once."""
    return lambda count: start + slope * math.log2(count) if count else start - slope


@pytest.mark.parametrize("gain", [0.2, 0.05, 0.0125])
def test_growth_stops_where_a_kilobyte_gains_no_more_than_the_limit(gain):
    counts, reason = grown(power_law(0.5), limits_of(gain))
    # s / (n ln 2 kilobytes) = gain, with the s that the policy extrapolates
    worth = 0.5 / GAIN_OF_A_ROUND / (math.log(2) * KILOBYTES * gain)
    assert reason == "gain"
    assert worth / 1.15 < counts[-1] <= worth + 1


@pytest.mark.parametrize(
    ("limits", "least", "most", "reason"),
    [
        ({"enough": 15.0}, 0.85 * 2**5, 1.15 * 2**5, "enough"),
        ({"cap": 1000}, 1000, 1000, "cap"),
        ({"cap": 1000, "gaussians": 100}, 100, 100, "gaussians"),
        ({"max_bytes": 10_000}, 0.9 * BYTES, BYTES, "max_bytes"),
    ],
)
def test_growth_at_most_doubles_and_stops_at_its_limit(limits, least, most, reason):
    counts, stopped_by = grown(power_law(3.0, 0.0), limits_of(**limits))
    assert stopped_by == reason
    assert least <= counts[-1] <= most
    assert counts[0] == 8
    assert all(a < b <= 2 * a for a, b in itertools.pairwise(counts))


def test_rounds_that_gain_nothing_lead_to_a_leap_that_is_rolled_back():
    assert grown(lambda _: math.inf, limits_of(enough=40.0, cap=100)) == ([], "enough")
    counts, reason = grown(lambda _: 12.0, limits_of(0.01, 40.0, 8000))
    assert counts == [8, 2000, 8]
    assert reason == "gain"


def test_growth_continues_where_the_error_would_vanish_before_the_cap():
    # 2000 equal squares, each fitted by one Gaussian: next to nothing at first, all at last
    def squares(count):
        return 6 - 10 * math.log10(max(1 - count / 2000, 1e-4))

    def hopeless(count):
        return 6 - 10 * math.log10(1 - count / 200_000)

    assert 1800 < grown(squares, limits_of(0.05, 40.0, 8000))[0][-1] < 3000
    assert grown(hopeless, limits_of(0.05, 40.0, 8000))[0][-1] == 8


def test_refinement_corrects_the_count_by_the_slope():
    policy = limits_of(enough=30.0)
    policy.slope = 3.0

    def adjusted(psnr):
        return policy.adjust(Snapshot(1000, 0.55, lambda: psnr, lambda: None))

    assert adjusted(20.0) == math.ceil((1 + MOST_CHANGE) * 1000)
    assert adjusted(40.0) == math.ceil((1 - MOST_CHANGE) * 1000)
    assert 1000 < adjusted(29.4) < 1300
    rate = CONVERGES_AFTER[1]
    steady = 30.0 - rate * (30.0 - CONVERGES_ABOVE) / (1 + rate)
    assert adjusted(steady) == 1000


def test_fixed_count_follows_its_schedule_and_keeps_all():
    policy = DensificationPolicy(fit_config(60, 300, schedule="linear"))
    counts = [0]
    while (total := policy.grow(Snapshot(counts[-1], 0.1, lambda: 0.0, lambda: None))) > counts[-1]:
        counts.append(total)
    assert counts == [0, 10, 20, 30, 40, 50, 60]
    assert policy.least_gain == -math.inf


def test_gaussians_that_gain_less_than_asked_for_are_pruned(photo):
    config, counts = fit_config(60, 60), []
    for gain in (-math.inf, 0.2, 0.5):
        policy = DensificationPolicy(config)
        policy.least_gain = gain
        session = FitSession(photo, config, policy)
        session.fit()
        counts.append(len(session.state))
    assert counts[0] > counts[1] > counts[2] > 0


def fitted(pixels, limits, iterations=60) -> FitSession:
    session = FitSession(pixels, fit_config(0, iterations), limits)
    session.fit()
    assert session.result().stop_reason in STOP_REASONS
    return session


def test_simple_scenes_get_few_gaussians_and_rich_ones_many(photo):
    preset = PRESETS["balanced"]
    flat = np.full((64, 96, 3), 0.4, np.float32)
    ramp = np.float32(np.linspace(0.2, 0.8, 96)[None, :, None] * [1.0, 0.8, 0.4] + 0 * flat)
    noise = np.random.default_rng(0).random((64, 96, 3)).astype(np.float32)
    numbers = preset.gain, preset.stop_psnr, preset.cap
    counts = [len(fitted(p, limits_of(*numbers)).state) for p in (flat, ramp, photo)]
    assert counts[0] == 0
    assert 1 <= counts[1] <= 30
    assert counts[2] > 300
    assert len(fitted(noise, limits_of(0.5, 36.0, 2000)).state) < 10


def test_enough_is_about_what_the_fit_ends_at(photo):
    session = fitted(photo, limits_of(enough=28.0, cap=5000), 150)
    assert metrics.psnr(render(session.scene()), photo) == pytest.approx(28.0, abs=1.3)


def test_resized_fit_has_the_count_and_stays_a_good_fit(photo):
    session = fitted(photo, limits_of(enough=60.0, cap=400), 100)
    before = metrics.psnr(render(session.scene()), photo)
    session.resize(200, 40)
    fewer = metrics.psnr(render(session.scene()), photo)
    session.resize(400, 40)
    again = metrics.psnr(render(session.scene()), photo)
    assert fewer < before - 0.5
    # 0.4 to 0.7 dB under the first fit and 3.4 to 3.6 over the smaller one, over five CPUs.
    assert again > max(before - 1.5, fewer + 1)


def test_fit_takes_the_time_until_its_deadline_and_no_more(photo, monkeypatch):
    ticks = itertools.count()
    # A clock that counts how often it is read, so that no machine is too slow or too fast.
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))

    def steps(limit: int, most: int | None) -> int:
        begun = next(ticks)
        session = FitSession(photo, fit_config(60, most), deadline=lambda: float(begun + limit))
        session.fit()
        assert session.result().stop_reason == "time_limit"
        assert len(session.state) == 60
        assert next(ticks) - begun < limit + 20
        return session.result().iterations

    for most in (None, 2000):
        assert steps(300, most) * 1.5 < steps(900, most)
    session = FitSession(photo, fit_config(0, None), limits_of(), deadline=lambda: -1.0)
    session.fit()
    assert (session.result().stop_reason, session.result().iterations) == ("time_limit", 0)


def large(count, iterations=60, config=None):
    """A session on a picture large enough for reduced refinement, and the sizes of its steps."""
    y, x = np.mgrid[:256, :320] / 256
    stripes = 0.5 + 0.3 * np.sin(17 * x * (1 + y)) * np.cos(9 * y)
    pixels = np.stack([stripes, x / 1.25, 1 - y], axis=-1).astype(np.float32)
    policy = DensificationPolicy(fit_config(count, iterations))
    config = config or fit_config(count, iterations)
    sizes: list[tuple[float, int]] = []
    session = FitSession(
        pixels, config, policy,
        progress=lambda now: sizes.append((now.done, session.population.reduction)),
    )  # fmt: skip
    return session, sizes


@pytest.mark.parametrize("goal", [{}, {"target_psnr": 60.0}, {"max_bytes": 10**6}])
def test_refinement_ends_at_full_size_and_is_all_at_it_where_the_count_adapts(goal):
    options = Options.from_flat({"gaussians": 40, "iterations": 60, **goal})
    session, sizes = large(40, config=Plan(options).fit_config)
    session.fit()
    early = [size for done, size in sizes if GROWTH_SHARE < done < FULL_FROM]
    late = [size for done, size in sizes if done >= FULL_FROM]
    assert len(early) > 10
    assert len(late) > 10
    assert set(late) == {session.population.reduction} == {1}
    assert all(size == 1 if goal else size > 1 for size in early)


def test_moments_change_with_the_size_of_refinement_as_squared_gradients_do(monkeypatch):
    session, _ = large(40)
    reduce_to, shares = Population.reduce_to, []

    def and_compare(population, factor, **given):
        wanted = population.state.adam_v.sum() * (population.reduction / factor) ** 4
        reduce_to(population, factor, **given)
        if is_refining(session):
            shares.append(population.state.adam_v.sum() / wanted)

    monkeypatch.setattr(Population, "reduce_to", and_compare)
    session.fit()
    assert shares == [pytest.approx(1)]


def test_refinement_is_reduced_only_while_gaussians_keep_their_pixels():
    factors = [refinement_reduction(0.3, n, 768, 512) for n in (1, 682, 683, 2730, 2731, 10_000)]
    assert factors == [4, 4, 2, 2, 1, 1]
    assert [refinement_reduction(d, 256, 768, 512) for d in (0.3, 0.5, 0.55, 1)] == [4, 2, 1, 1]
    assert refinement_reduction(0.3, 1, 255, 512) == 1
    configs = [fit_config(n, 200, extend=True) for n in (0, 256, 2731)]
    assert [config.steps(768, 512) for config in configs] == [200, 400, 200]


def is_refining(session) -> bool:
    """Whether growth has ended, which no public attribute says."""
    return session.clock._steps is not None


def test_an_interrupted_reduced_refinement_ends_at_full_size():
    session, _ = large(40)
    session.clock._stop = lambda: session.population.reduction > 1 and is_refining(session)
    session.fit()
    assert session.clock.stopped
    assert session.population.reduction == 1
    assert session.scene().mean.max() > 160
