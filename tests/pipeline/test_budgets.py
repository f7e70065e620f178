"""Limits of bytes and seconds: budgets, the counts that limits allow, and the fits that follow."""

import gzip
import time
from itertools import count, pairwise

import numpy as np
import pytest
from flat import vectorize
from pictures import smile
from skimage import data

from gauss2svg.fit.session import FitSession

DECIDED_BY_8_BITS = 50.0  # dB, from which the rounding of renderers decides: decisions/monotone.md


@pytest.fixture
def work_clock(monkeypatch):
    """Time passes with the steps of the fit alone, by their pixels and Gaussians: it repeats."""
    now, step = [0.0], FitSession._step

    def stepped(self, done):
        target = self.population.target
        now[0] += 2e-4 + 3e-8 * target.width * target.height + 6e-7 * self.count
        step(self, done)

    monkeypatch.setattr(FitSession, "_step", stepped)
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])


@pytest.mark.sweep
@pytest.mark.parametrize("kind", ["photo", "drawing"])
def test_more_seconds_are_never_worse(kind, photo, work_clock):
    picture = photo[::2, ::2] if kind == "photo" else smile(96)
    given = {"tune": "psnr", "areas": "never"}
    found = [vectorize(picture, time_limit=limit, **given).report for limit in (0.15, 0.3, 0.6)]
    psnr = [min(report["psnr_svg"], DECIDED_BY_8_BITS) for report in found]
    assert all(b > a - 0.1 for a, b in pairwise(psnr))
    assert psnr[-1] >= min(psnr[0] + 1, DECIDED_BY_8_BITS)
    assert found[0]["gaussians"] < found[-1]["gaussians"]


@pytest.mark.sweep
def test_a_limit_of_bytes_is_full_where_masks_end():
    """Beyond 500 soft shapes, each one more costs the bytes of several."""
    picture = data.astronaut()[::2, ::2]
    for limit in (44_000, 52_000):
        size = vectorize(picture, max_bytes=limit, iterations=30).report["svg_bytes"]
        assert 0.97 * limit <= size <= limit


@pytest.mark.sweep
def test_a_limit_of_the_bytes_of_a_preset_is_not_worse_than_the_preset():
    """It is so for photos in many colours, of whose files gradients are a large part.

    If the bytes of later shapes are misjudged, the file loses many shapes, and 0.6 to 1.7 dB.
    """
    behind = []
    for picture in (data.astronaut()[:240, 80:400], data.coffee()[60:300, 140:460]):
        preset = vectorize(picture, tune="psnr", markup="editable").report
        limit = preset["svg_bytes"]
        within = vectorize(picture, tune="psnr", markup="editable", max_bytes=limit).report
        behind.append(preset["psnr_svg"] - within["psnr_svg"])
    assert max(behind) < 0.4
    assert np.mean(behind) < 0.2


def test_a_limit_of_gzipped_bytes_is_on_what_travels(photo):
    given = {"max_bytes": 1_500, "iterations": 8, "markup": "editable"}
    photo = photo[::2, ::2]
    result = vectorize(photo, count_gzipped=True, **given)
    assert 0.9 * 1_500 <= len(gzip.compress(result.svg.encode(), 9)) <= 1_500 < len(result.svg)
    assert result.report["psnr_svg"] > vectorize(photo, **given).report["psnr_svg"] + 1


def test_a_small_file_within_seconds_has_shapes_and_is_not_interrupted(photo, work_clock):
    report = vectorize(np.tile(photo, (8, 8, 1)), max_bytes=5000, time_limit=0.1).report
    assert report["stop_reason"] == "time_limit"
    assert report["gaussians"] > 0
    assert report["svg_bytes"] <= 5000


@pytest.mark.parametrize("step_s", [0.05, 0.2, 1.0])
def test_a_drawing_whose_areas_take_too_long_says_that_time_ended(step_s, monkeypatch):
    ticks = count()
    monkeypatch.setattr(time, "perf_counter", lambda: next(ticks) * step_s)
    assert vectorize(smile(96), time_limit=4).report["stop_reason"] == "time_limit"


def test_simple_scenes_get_few_gaussians_and_rich_ones_many(photo):
    flat = np.full((64, 96, 3), 0.4, np.float32)
    ramp = np.float32(np.linspace(0.2, 0.8, 96)[None, :, None] * [1.0, 0.8, 0.4] + 0 * flat)
    given = {"areas": "never", "iterations": 100}
    counts = [vectorize(p, **given).report["gaussians"] for p in (flat, ramp, photo)]
    assert counts[0] == 0
    assert 1 <= counts[1] <= 30
    assert counts[2] > 300
