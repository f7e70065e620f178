"""What a run will give: by what presets promise, and by the runs of the photo so far."""

import math
import time
from pathlib import Path

import pytest
from skimage import data

from gauss2svg import RunOptions, vectorize
from gauss2svg.errors import InputError
from gauss2svg.pipeline.presets import PRESETS
from gauss2svg.studio.estimate import PROMISES, Figures, estimate_of
from gauss2svg.studio.jobs import DONE, FAILED, Job, Jobs
from gauss2svg.studio.options import options_of
from gauss2svg.studio.schemas import Estimate

# What scikit-image's coffee gave with each of these.
DRAFT = {
    "gaussians": 298, "svg_bytes": 46_619, "svgz_bytes": 7559, "total_s": 2.5, "psnr_svg": 26.09,
    "width": 600, "height": 400, "fit_width": 384, "fit_height": 256, "time_limit": None,
}  # fmt: skip
BALANCED = {
    "gaussians": 5347, "svg_bytes": 575_482, "svgz_bytes": 95_910, "total_s": 7.6,
    "psnr_svg": 35.42, "width": 600, "height": 400, "fit_width": 600, "fit_height": 400,
    "time_limit": None,
}  # fmt: skip

# And with the dearest presets, which would take half a minute more.
COFFEE = {
    "high": Figures(240_000, 11_890, 1_605_889, 242_303, seconds=11.8, psnr=40.06),
    "max": Figures(240_000, 28_425, 9_628_757, 932_434, seconds=33.4, psnr=45.09),
}


def ran(report: dict, digest: str = "coffee", state: str = DONE, **options) -> Job:
    job = Job(Path(), "p.png", options, report["width"], report["height"], digest=digest)
    job.change(state=state, report=report)
    return job


def estimated(
    width=768, height=512, *runs: Job, of: Job | None = None, threads=1, **options
) -> Estimate:
    jobs = Jobs(1, threads)
    jobs.known.update({job.id: job for job in runs})
    return estimate_of(width, height, options_of(options), jobs, of)


def test_estimates_grow_with_quality():
    presets = [estimated(quality=name) for name in PRESETS]
    for name in ("gaussians", "bytes", "gzip_bytes", "seconds", "psnr"):
        values = [getattr(found, name) for found in presets]
        assert values == sorted(set(values)), name


def test_estimates_keep_to_what_is_asked():
    assert estimated(gaussians=500).gaussians == 500
    assert estimated(max_bytes=50_000).bytes == 50_000
    assert estimated(max_bytes=50_000, gzip=True).gzip_bytes == 50_000
    assert estimated(time_limit=0.25).seconds == 0.25
    for psnr in (27.5, 33.0, 41.0):
        assert estimated(target_psnr=psnr).psnr == psnr
    assert estimated(40, 30, quality="max").gaussians <= 400
    hard = ran(BALANCED | {"gaussians": 300_000})
    assert estimated(600, 400, hard, of=hard, quality="draft").gaussians == PRESETS["draft"].cap
    assert estimated(max_bytes=3000).gaussians > 40  # of minimal markup


def test_few_gaussians_have_few_decibels():
    few = [estimated(gaussians=count).psnr for count in (1, 10, 100, 1000)]
    assert few == sorted(few)
    assert few[0] < 16 < 22 < few[2]


def test_larger_photos_take_longer_until_the_fit_is_reduced():
    seconds = [estimated(side, side, quality="fast").seconds for side in (100, 300, 768, 3000)]
    assert seconds[0] < seconds[1] < seconds[2] == seconds[3]


def test_threads_save_time_and_allow_more_in_a_time():
    one, four = (estimated(threads=threads) for threads in (1, 4))
    assert one.seconds / 4 < four.seconds < one.seconds / 2
    one, four = (estimated(threads=threads, time_limit=2).gaussians for threads in (1, 4))
    assert one < four


@pytest.mark.parametrize("size", [(0, 10), (10, -1), (None, 5), ("9", 9), (10**12, 1)])
def test_an_estimate_of_no_size_is_refused(size):
    with pytest.raises(InputError, match=r"width|height"):
        estimated(*size)


def test_a_run_with_the_same_options_is_what_is_shown():
    earlier, last = ran(BALANCED | {"gaussians": 9}), ran(BALANCED, seed=0)  # 0 is the default
    found = estimated(600, 400, earlier, last, ran(DRAFT, quality="draft"), of=earlier)
    expected = {
        "gaussians": 5347, "bytes": 575_482, "gzip_bytes": 95_910, "seconds": 7.6, "psnr": 35.4,
    }  # fmt: skip
    assert found == Estimate(**expected, based_on="runs")


def test_with_other_options_the_last_run_says_how_hard_the_photo_is():
    rule = estimated(600, 400, quality="high")
    assert rule.based_on == "rule"
    easy = BALANCED | {"gaussians": 1000}
    found = [estimated(600, 400, job := ran(r), of=job, quality="high") for r in (easy, BALANCED)]
    assert [one.based_on for one in found] == ["runs", "runs"]
    assert found[0].gaussians < rule.gaussians < found[1].gaussians
    fixed = [
        estimated(600, 400, job := ran(r), of=job, gaussians=3000).psnr for r in (easy, BALANCED)
    ]
    assert fixed[0] > fixed[1] + 3


def test_runs_of_other_photos_say_how_fast_the_machine_is_and_nothing_else():
    rule, slow = estimated(quality="high"), ran(BALANCED | {"total_s": 1000.0}, "another")
    found = estimated(768, 512, slow, of=ran(BALANCED), quality="high")
    assert found.seconds > 20 * rule.seconds
    assert found.model_copy(update={"seconds": rule.seconds}) == rule


def test_runs_that_failed_or_had_limited_time_say_nothing_of_speed():
    rule = estimated(quality="high")
    limited = ran(BALANCED | {"total_s": 1000.0, "time_limit": 1000.0}, time_limit=1000)
    assert estimated(768, 512, limited, quality="high") == rule
    failed = ran(BALANCED, state=FAILED)
    assert estimated(768, 512, failed, of=failed, quality="high") == rule


def test_a_photo_that_is_drawn_without_error_has_no_decibels():
    flat = ran(BALANCED | {"gaussians": 0, "psnr_svg": None})
    assert estimated(600, 400, flat, of=flat).psnr is None
    assert estimated(600, 400, flat, of=flat, quality="high").gaussians < 10


@pytest.mark.parametrize(
    "preset",
    [
        pytest.param(name, marks=pytest.mark.nightly if name in COFFEE else pytest.mark.sweep)
        for name in PRESETS
    ],
)
def test_what_a_preset_promises_is_what_it_gives(preset):
    figures = [COFFEE[preset]] if preset in COFFEE else []
    for name in ("chelsea",) if preset in COFFEE else ("chelsea", "coffee"):
        photo, begun = getattr(data, name)(), time.process_time()
        report = vectorize(photo, quality=preset, run=RunOptions(threads=1)).report
        seconds = time.process_time() - begun
        pixels = report["fit_width"] * report["fit_height"]
        found = (report[key] for key in ("gaussians", "svg_bytes", "svgz_bytes"))
        figures.append(Figures(pixels, *found, seconds=seconds, psnr=report["psnr_svg"]))
        job = ran(report, quality=preset)
        again = estimated(*photo.shape[1::-1], job, of=job, quality=preset)
        assert (again.gaussians, again.bytes) == (report["gaussians"], report["svg_bytes"])
    given = Figures(
        *(math.prod(column) ** (1 / len(column)) for column in zip(*figures, strict=True))
    )
    given = given._replace(psnr=sum(one.psnr for one in figures) / len(figures))
    promised = PROMISES[preset]
    near = 0.05 if preset in COFFEE else 0.1  # as near for each photo that is run
    for name in ("pixels", "gaussians", "bytes", "gzip_bytes"):
        assert getattr(promised, name) == pytest.approx(getattr(given, name), rel=near), given
    assert promised.psnr == pytest.approx(given.psnr, abs=3 * near), given
    assert given.seconds / 3 < promised.seconds < 3 * given.seconds, given
