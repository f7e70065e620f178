"""Laws of the densification policies, which decide how many Gaussians a fit has."""

import dataclasses
import itertools
import math
import time

import numpy as np
import pytest
from flat import fit_config

from gauss2svg.fit.schedule import Clock
from gauss2svg.fit.session import STOP_REASONS, DensificationPolicy, FitSession, Snapshot
from gauss2svg.measure import metrics
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.presets import PRESETS, USUAL_BYTES
from gauss2svg.pipeline.search.limits import (
    CONVERGES_ABOVE,
    CONVERGES_AFTER,
    GAIN_OF_A_ROUND,
    MOST_CHANGE,
    OVERFILL_GROWING,
    Limits,
)
from gauss2svg.pipeline.search.outcome import Exporter, Subject
from gauss2svg.pipeline.time_budget import TimeBudget
from gauss2svg.render import render
from gauss2svg.render.cpu import removal_cost

KILOBYTES = USUAL_BYTES / 1000


def limits_of(gain=0.0, enough=math.inf, cap=10**6, **options) -> Limits:
    """The limits of a preset of these numbers, on a picture that is large enough for any count."""
    plan = Plan(Options.from_flat(options))
    preset = dataclasses.replace(PRESETS["balanced"], gain=gain, enough=enough, cap=cap)
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


def test_growth_stops_where_a_kilobyte_gains_no_more_than_the_limit():
    for gain in (0.2, 0.05, 0.0125):
        counts, reason = grown(power_law(0.5), limits_of(gain))
        # s / (n ln 2 kilobytes) = gain, with the s that the policy extrapolates
        worth = 0.5 / GAIN_OF_A_ROUND / (math.log(2) * KILOBYTES * gain)
        assert reason == "gain"
        assert worth / 1.15 < counts[-1] <= worth + 1


def test_half_the_gain_allows_twice_the_gaussians():
    ends = [grown(power_law(1.0), limits_of(g))[0][-1] for g in (0.02, 0.01)]
    assert 1.8 < ends[1] / ends[0] < 2.2


def test_growth_stops_where_enough_is_reached():
    counts, reason = grown(power_law(3.0, 0.0), limits_of(enough=15.0))
    assert reason == "enough"
    assert counts[-1] == pytest.approx(2 ** (15 / 3), rel=0.15)


def test_growth_stops_at_the_cap_and_names_it():
    for options, expected in (({}, (1000, "cap")), ({"gaussians": 100}, (100, "gaussians"))):
        policy = limits_of(cap=1000, **options)
        counts, reason = grown(power_law(3.0), policy)
        assert (counts[-1], reason) == expected


def test_rounds_never_more_than_double():
    counts, _ = grown(power_law(3.0), limits_of(cap=5000))
    assert counts[0] == 8
    assert all(a < b <= 2 * a for a, b in itertools.pairwise(counts))


def test_scene_that_is_exact_gets_none():
    assert grown(lambda _: math.inf, limits_of(enough=40.0, cap=100)) == ([], "enough")


def test_rounds_that_gain_nothing_lead_to_a_leap_that_is_rolled_back():
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
    # and from a pace that is under the gain, without a leap
    policy = limits_of(0.2, 60.0, 4000)
    for count, psnr in ((0, 6.0), (8, 7.0), (256, 7.2), (512, 8.5)):
        total = policy.grow(Snapshot(count, 0.1, lambda p=psnr: p, lambda: None))
    assert total > 512


def test_growth_stops_where_a_limit_of_bytes_is_full():
    counts, reason = grown(power_law(3.0), limits_of(max_bytes=10_000))
    assert reason == "max_bytes"
    assert 0.9 < counts[-1] * USUAL_BYTES / (OVERFILL_GROWING * 10_000) <= 1


def test_refinement_corrects_the_count_by_the_slope():
    policy = limits_of(enough=30.0)
    policy.slope = 3.0

    def adjusted(psnr):
        return policy.adjust(Snapshot(1000, 0.55, lambda: psnr, lambda: None))

    assert adjusted(20.0) == math.ceil((1 + MOST_CHANGE) * 1000)
    assert adjusted(40.0) == math.ceil((1 - MOST_CHANGE) * 1000)
    assert 1000 < adjusted(29.4) < 1300
    rate = CONVERGES_AFTER[0.55]
    steady = 30.0 - rate * (30.0 - CONVERGES_ABOVE) / (1 + rate)
    assert adjusted(steady) == 1000


def test_fixed_count_follows_its_schedule_and_keeps_all():
    policy = DensificationPolicy(fit_config(60, 300, schedule="linear"))
    counts = [0]
    while (total := policy.grow(Snapshot(counts[-1], 0.1, lambda: 0.0, lambda: None))) > counts[-1]:
        counts.append(total)
    assert counts == [0, 10, 20, 30, 40, 50, 60]
    assert policy.least_gain() == -math.inf


def fitted(pixels, limits, iterations=60) -> FitSession:
    session = FitSession(pixels, fit_config(0, iterations), limits)
    session.fit()
    assert session.result().stop_reason in STOP_REASONS
    return session


def ramp() -> np.ndarray:
    pixels = np.zeros((64, 96, 3), np.float32)
    pixels[...] = np.linspace(0.2, 0.8, 96)[:, None] * [1.0, 0.8, 0.4]
    return pixels


def test_simple_scenes_get_few_gaussians_and_rich_ones_many(photo):
    preset = PRESETS["balanced"]
    flat = np.full((64, 96, 3), 0.4, np.float32)
    noise = np.random.default_rng(0).random((64, 96, 3)).astype(np.float32)
    numbers = preset.gain, preset.enough, preset.cap
    counts = [len(fitted(p, limits_of(*numbers)).state) for p in (flat, ramp(), photo)]
    assert counts[0] == 0
    assert 1 <= counts[1] <= 30
    assert counts[2] > 300
    assert len(fitted(noise, limits_of(0.5, 36.0, 2000)).state) < 10


def test_enough_is_about_what_the_fit_ends_at(photo):
    session = fitted(photo, limits_of(enough=28.0, cap=5000), 150)
    assert metrics.psnr(render(session.scene()), photo) == pytest.approx(28.0, abs=1.3)


def test_gaussians_that_gain_too_little_are_pruned_before_the_last_steps(photo):
    dear, cheap = (limits_of(g, 60.0, 600) for g in (0.5, 0.0))
    kept = fitted(photo, dear)
    target = np.ascontiguousarray(np.moveaxis(photo, -1, 0))
    image, cost = removal_cost(kept.state.splats(kept.population.background), target)
    error = np.sum((image - target) ** 2, dtype=np.float64)
    worth = 10 * np.log10(1 + np.maximum(cost[:, 0], 0) / error)
    assert np.median(worth) > dear.least_gain()
    assert len(kept.state) < len(fitted(photo, cheap).state)


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


def test_clock_goes_by_whichever_is_further():
    ends = None
    clock = Clock(100, 5, lambda: ends)
    assert not clock.round_is_over(0)
    clock.iteration = 6
    assert clock.round_is_over(0)
    assert not clock.round_is_over(1)
    clock.iteration = 30
    clock.begin_refinement(70, 0.3)
    assert clock.refinement_progress() == pytest.approx(0.3)
    clock.iteration = 65
    assert clock.refinement_progress() == pytest.approx(0.65)
    assert not clock.out_of_time
    ends = time.perf_counter() - 1
    assert clock.refinement_progress() == 1
    assert clock.out_of_time


def test_fit_without_time_ends_at_once(photo):
    policy, ends = limits_of(enough=60.0, cap=400), time.perf_counter() - 1
    session = FitSession(photo, fit_config(0, None), policy, deadline=lambda: ends)
    session.fit()
    assert session.result().stop_reason == "time_limit"
    assert session.result().iterations == 0


def test_fit_takes_the_time_until_its_deadline_and_no_more(photo, monkeypatch):
    ticks = itertools.count()
    # A clock that counts how often it is read, so that no machine is too slow or too fast.
    monkeypatch.setattr(time, "perf_counter", lambda: float(next(ticks)))

    def steps(limit: int) -> int:
        begun = next(ticks)
        session = FitSession(photo, fit_config(60, None), deadline=lambda: float(begun + limit))
        session.fit()
        assert session.result().stop_reason == "time_limit"
        assert len(session.state) == 60
        assert next(ticks) - begun < limit + 20
        return session.result().iterations

    assert steps(300) * 1.5 < steps(900)
