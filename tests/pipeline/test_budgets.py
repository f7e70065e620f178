"""A limit given alone is a budget: more of it is never worse, and a preset beside it is a cap."""

import gzip
import time
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from flat import vectorize

from gauss2svg.errors import InputError
from gauss2svg.fit.schedule import Clock
from gauss2svg.fit.session import FitSession
from gauss2svg.pipeline.budgets import TimeBudget
from gauss2svg.pipeline.export import Exporter
from gauss2svg.pipeline.limits import FULL, Limits
from gauss2svg.pipeline.options import Goal, Options
from gauss2svg.pipeline.outcome import Subject
from gauss2svg.pipeline.plan import BY_BYTES_UP_TO, MINIMAL_FROM, PRESETS, Plan
from gauss2svg.scene import Scene
from gauss2svg.svg.write import write_svg

DECIDED_BY_8_BITS = 50.0  # dB, from which the rounding of renderers decides: decisions/monotone.md


@pytest.fixture
def work_clock(monkeypatch):
    """Time passes with the steps of the fit alone, by their pixels and Gaussians: it repeats."""
    now, step = [0.0], FitSession._step

    def stepped(self, done):
        target = self.population.target
        now[0] += 2e-4 + 3e-8 * target.width * target.height + 6e-7 * len(self.state)
        step(self, done)

    monkeypatch.setattr(FitSession, "_step", stepped)
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])


def drawing() -> np.ndarray:
    """A disc and a bar of flat colours, antialiased."""
    y, x = np.mgrid[:288, :288] / 3
    picture = np.full((288, 288, 3), 0.9, np.float32)
    picture[np.hypot(x - 40, y - 44) < 25] = 0.8, 0.2, 0.1
    picture[(abs(x - y) < 6) & (x > 50)] = 0.1, 0.2, 0.6
    return picture.reshape(96, 3, 96, 3, 3).mean(axis=(1, 3))


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["photo", "drawing"])
def test_more_seconds_are_never_worse(kind, photo, work_clock):
    picture = photo if kind == "photo" else drawing()
    found = [
        vectorize(picture, time_limit=limit, tune="psnr").report for limit in (0.15, 0.3, 0.6, 1.2)
    ]
    psnr = [min(report["psnr_svg"], DECIDED_BY_8_BITS) for report in found]
    assert all(b > a - 0.1 for a, b in pairwise(psnr))
    assert psnr[-1] >= min(psnr[0] + 1, DECIDED_BY_8_BITS)
    assert found[0]["gaussians"] < found[-1]["gaussians"]


@pytest.mark.sweep
def test_a_later_stop_is_never_worse(photo):
    def stopped_after(steps: int) -> float:
        seen = []
        report = vectorize(
            photo, gaussians=300, tune="psnr", progress=seen.append,
            stop=lambda: sum(now.fit is not None for now in seen) >= steps,
        ).report  # fmt: skip
        assert report["stop_reason"] == "interrupted"
        return report["psnr_svg"]

    found = [stopped_after(steps) for steps in (30, 60, 90, 120, 150, 180)]
    assert all(b > a - 0.1 for a, b in pairwise(found))


def test_seconds_beyond_what_pays_are_not_taken(work_clock):
    picture = drawing()[::6, ::6]
    long, longer = (vectorize(picture, time_limit=limit).report for limit in (100, 200))
    assert long["psnr_svg"] == longer["psnr_svg"]
    assert long["stop_reason"] == longer["stop_reason"] != "time_limit"
    assert long["unreached"] == []


def test_a_preset_beside_a_limit_of_seconds_is_a_cap(photo, work_clock):
    alone = vectorize(photo, time_limit=1.0).report
    capped = vectorize(photo, time_limit=1.0, quality="draft").report
    draft = vectorize(photo, quality="draft").report
    assert capped["gaussians"] <= PRESETS["draft"].cap < alone["gaussians"]
    assert capped["psnr_svg"] == pytest.approx(draft["psnr_svg"], abs=0.3)


@pytest.mark.sweep
def test_a_preset_beside_a_limit_of_bytes_is_a_cap(photo):
    quick = {"iterations": 3, "max_bytes": "150k", "markup": "editable"}
    assert vectorize(photo, **quick, quality="draft").report["gaussians"] <= PRESETS["draft"].cap
    report = vectorize(photo, **quick).report
    assert report["gaussians"] > PRESETS["draft"].cap
    assert (report["quality"], vectorize(photo, iterations=2).report["quality"]) == (
        None, "balanced",
    )  # fmt: skip


@pytest.mark.parametrize(
    "given",
    [{"max_bytes": 9}, {"time_limit": 9}, {"max_bytes": 9, "time_limit": 9}],
)
def test_only_limits_alone_are_budgets(given):
    assert Goal(**given).is_budget
    for more in ({"quality": "max"}, {"gaussians": 9}, {"target_psnr": 30}):
        assert not Goal(**given, **more).is_budget
    assert not Goal().is_budget


@pytest.mark.parametrize(
    ("limit", "markup", "least"),
    [
        (30_000, "editable", FULL),
        pytest.param(100_000, "editable", FULL, marks=pytest.mark.sweep),
        (60_000, "minimal", FULL),
        # A shape is half a percent.
        pytest.param(9_000, "minimal", 0.97, marks=pytest.mark.sweep),
    ],
)
def test_a_limit_of_bytes_is_used_where_more_shapes_help(photo, limit, markup, least):
    report = vectorize(photo, max_bytes=limit, markup=markup, iterations=40).report
    assert least * limit <= report["svg_bytes"] <= limit


@pytest.mark.parametrize("count", [300, 600, 900])
def test_the_bytes_of_a_shape_are_known_under_masks_by_gradients_and_between(count):
    plan = Plan(Options.from_flat({"max_bytes": "40k", "markup": "minimal"}))
    exporter = Exporter(plan, Subject.of(np.zeros((200, 200, 3), "f4")))
    rng = np.random.default_rng(0)
    scene = Scene(
        200, 200, rng.uniform(0, 200, (count, 2)), rng.uniform(4, 20, (count, 2)),
        np.zeros(count), rng.random((count, 3)), rng.uniform(0.2, 1, count),
    )  # fmt: skip
    quantized = exporter.quantized(scene, 25.0)
    size = len(write_svg(quantized, plan.format_at(25.0)))
    each = exporter.bytes_each(quantized, size)
    assert each * count == pytest.approx(size - exporter.empty_bytes, rel=0.1)


@pytest.mark.sweep
def test_more_bytes_are_never_worse_across_markups(photo):
    part, last = photo[:48, 48:96], BY_BYTES_UP_TO
    found = [
        vectorize(part, max_bytes=limit, tune="psnr", iterations=20).report["psnr_svg"]
        for limit in (3_000, MINIMAL_FROM, last, last + 1)
    ]
    assert all(b > a - 0.1 for a, b in pairwise(found))


def test_a_limit_of_gzipped_bytes_is_on_what_travels(photo):
    result = vectorize(photo, max_bytes=6_000, count_gzipped=True, iterations=15)
    travels = len(gzip.compress(result.svg.encode(), 9))
    assert 0.95 * 6_000 <= travels <= 6_000 < len(result.svg)
    plain = vectorize(photo, max_bytes=6_000, iterations=15)
    assert result.report["psnr_svg"] > plain.report["psnr_svg"] + 1
    with pytest.raises(InputError, match="count_gzipped must be given with max_bytes"):
        Plan(Options.from_flat({"count_gzipped": True}))


def test_the_count_follows_from_the_seconds_that_are_left_and_the_speed(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    pixels = 768 * 512
    counts = [TimeBudget(limit, pixels, pixels).most_gaussians(0.0) for limit in (4, 8, 16)]
    assert counts == sorted(set(counts))
    slow = TimeBudget(16, pixels, pixels)
    for _ in range(40):
        slow.stepped(pixels, 1000, done=0.1)
        now[0] += 0.02
    left = TimeBudget(16, pixels, pixels)
    assert 150 < slow.most_gaussians(0.1) < 0.7 * left.most_gaussians(0.1)


def test_what_follows_a_question_for_the_count_is_no_step(monkeypatch):
    now, pixels = [0.0], 768 * 512
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    budgets = [TimeBudget(1000, pixels, pixels) for _ in range(2)]
    for seconds, budget in zip((0, 500), budgets, strict=True):
        now[0] = 0.0
        for step in range(40):
            now[0] += 0.02
            if step == 20:
                budget.most_gaussians(0.1)
                now[0] += seconds  # finding the colours, while the clock of the fit is paused
            budget.stepped(pixels, 1000, done=0.1)
        now[0] = 800.0
    straight, paused = (budget.most_gaussians(0.1) for budget in budgets)
    assert paused == pytest.approx(straight, rel=1e-6)


@pytest.mark.parametrize("left_s", [0.01, 0.1])
def test_shapes_are_not_removed_because_a_correction_has_little_time(left_s, photo, monkeypatch):
    plan = Plan(Options.from_flat({"target_psnr": 40, "time_limit": 3}))
    monkeypatch.setattr(time, "perf_counter", lambda: 0.0)
    exporter = Exporter(plan, Subject.of(photo))
    limits = Limits(plan, exporter, TimeBudget(left_s), 10**5)
    far = SimpleNamespace(size=10**5, score=30.0)
    assert limits.corrected(3430, [far]) == 3430  # pyright: ignore[reportArgumentType]


def test_bytes_end_a_search_whose_file_is_pruned_though_it_met_the_target(photo):
    plan = Plan(Options.from_flat({"target_psnr": 30, "max_bytes": 10**5, "markup": "editable"}))
    limits = Limits(plan, Exporter(plan, Subject.of(photo)), TimeBudget(), 10**5)
    met = SimpleNamespace(size=105_000, score=30.1, scene=Scene(9, 9))
    limits.stop_reason, limits._filling = "target_psnr", lambda *_: 900  # pyright: ignore
    assert limits.corrected(900, [met]) == 900  # pyright: ignore[reportArgumentType]
    assert limits.stop_reason == "max_bytes"


def test_a_large_photo_on_which_a_small_fit_runs_is_no_small_photo():
    plan = Plan(Options.from_flat({"max_size": 256, "max_bytes": "100k"}), fit_side=256)
    large, small = (plan.for_picture(np.zeros((side, side, 3), "f4")) for side in (1000, 256))
    assert not any(search.by_bytes for search in large.searches())
    assert any(search.by_bytes for search in small.searches())


def test_a_renderer_that_is_slow_to_start_leaves_less_time_than_one_that_is_not():
    resvg, cairo, chromium = (
        TimeBudget(time.perf_counter() + 1000, renderer=name).fit_ends()
        for name in ("resvg", "cairo", "chromium")
    )
    assert cairo == pytest.approx(resvg, abs=0.1)
    assert chromium < resvg - 1


@pytest.mark.parametrize("given", [{}, {"target_psnr": 90}])
def test_a_stop_between_searches_leaves_the_first_ones_file(photo, given):
    phases = []
    report = vectorize(
        photo[:64, :64], max_bytes=20_000, iterations=5, **given,
        progress=lambda now: phases.append(now.phase),
        stop=lambda: "measure" in phases and phases[-1] != "measure",
    ).report  # fmt: skip
    assert report["stop_reason"] == "interrupted"
    assert report["gaussians"] > 0
    assert report["svg_bytes"] <= 20_000


def test_more_seconds_never_allow_fewer_gaussians_however_large_the_photo(monkeypatch):
    monkeypatch.setattr(time, "perf_counter", lambda: 0.0)
    for size in ((768, 512), (1920, 1280), (4000, 3000), (8000, 6000)):
        counts = []
        for limit in (1, 2, 3, 4, 6, 10, 20, 30, 60):
            shrunk = min(1.0, (150_000 * max(limit - 0.5, 0.25) / (size[0] * size[1])) ** 0.5)
            fit = round(size[0] * shrunk) * round(size[1] * shrunk)
            budget = TimeBudget(limit, fit, fit)
            counts.append(budget.most_gaussians(0.0))
        assert counts == sorted(counts), size
        assert counts[4] > 2000


def test_a_given_count_is_the_largest_beside_a_limit_of_seconds(photo, work_clock):
    assert vectorize(photo, gaussians=50, time_limit=0.05).report["gaussians"] <= 50


def test_a_small_file_within_seconds_has_shapes_and_is_not_interrupted(photo):
    report = vectorize(np.tile(photo, (8, 8, 1)), max_bytes=5000, time_limit=0.3).report
    assert report["stop_reason"] == "time_limit"
    assert report["gaussians"] > 0
    assert report["svg_bytes"] <= 5000


def test_memory_of_a_budget_is_that_of_as_many_shapes_as_the_fit_can_have():
    from gauss2svg.photo.pixels import Header
    from gauss2svg.pipeline.budgets import load_of

    for given in ({"time_limit": 60}, {"max_bytes": "10M"}):
        assert load_of(Plan(Options.from_flat(given)), Header(3000, 2000, False)).bytes < 3e9


def test_a_limit_of_bytes_beside_a_target_has_the_fit_and_the_memory_of_the_limit_alone():
    from gauss2svg.photo.pixels import Header
    from gauss2svg.pipeline.budgets import load_of

    alone, both = (
        load_of(Plan(Options.from_flat({"max_bytes": "5M", **more})), Header(4000, 3000, False))
        for more in ({}, {"target_psnr": 90})
    )
    assert both.fit == alone.fit
    assert both.bytes >= alone.bytes


def test_a_pause_takes_no_share_of_the_fit(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    clock = Clock(None, 1, lambda: 10.0)
    clock.begin_refinement(None, 0.3)
    now[0] = 4.0
    before = clock.refinement_progress()
    with clock.paused():
        now[0] = 7.0
    assert clock.refinement_progress() == pytest.approx(before)
    now[0] = 12.9
    assert clock.refinement_progress() < 1
    now[0] = 13.0
    assert clock.refinement_progress() == 1
    clock.begin_refinement(None, 0.3)  # a correction has no time left
    assert clock.refinement_progress() == 1
