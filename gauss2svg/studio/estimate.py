"""What a run will give: what the photo's last run gave, else what presets promise."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

import numpy as np

from gauss2svg.errors import whole_number
from gauss2svg.photo.formats import MOST_PIXELS
from gauss2svg.photo.photo import Header
from gauss2svg.photo.reduce import Size
from gauss2svg.pipeline import bytes_each
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.presets import DEFAULT_PRESET
from gauss2svg.pipeline.search import cap
from gauss2svg.pipeline.sizes import load_of
from gauss2svg.pipeline.time_budget import gaussians_within
from gauss2svg.studio.jobs import DONE, Job, Jobs
from gauss2svg.studio.options import options_of
from gauss2svg.studio.schemas import Estimate
from gauss2svg.svg.format import MINIMAL


class Figures(NamedTuple):
    """What a run gives: px of its fit, psnr in dB, seconds."""

    pixels: float
    gaussians: float
    bytes: float
    gzip_bytes: float
    seconds: float
    psnr: float


# What presets give scikit-image's chelsea and coffee on one thread: geometric means, of PSNR the
# mean. A sweep test holds them against runs (docs/decisions/studio.md).
PROMISES = {
    "draft": Figures(98_000, 222, 39_400, 6110, 1.1, 26.8),
    "fast": Figures(180_000, 1160, 137_500, 22_700, 1.7, 31.4),
    "balanced": Figures(180_000, 3260, 391_000, 61_800, 2.8, 35.5),
    "high": Figures(180_000, 6890, 1_028_000, 147_000, 7.0, 39.9),
    "max": Figures(180_000, 15_400, 5_500_000, 523_000, 17.7, 44.7),
}
_BY_PIXELS = 0.25  # power of the pixels by which Gaussians grow
_SECOND_THREAD = 0.6  # what each further thread adds to the speed of the first


def estimate_of(width: Any, height: Any, options: Options, jobs: Jobs, of: Job | None) -> Estimate:
    """Figures of a run on a photo of so many px.

    of  a job of the same photo, or None

    A run of the photo with the same options says it all. With others its last run says how many
    Gaussians it needs for its dB. What was run last, of any photo, says how fast the machine is.
    Raises InputError for sides that are no numbers of px.
    """
    width = whole_number("width", width, 1, MOST_PIXELS)
    height = whole_number("height", height, 1, MOST_PIXELS)
    ran = [(j, j.report) for j in jobs.known.values() if j.state == DONE and j.report is not None]
    same = [(job, report) for job, report in ran if of is not None and job.digest == of.digest]
    for job, report in reversed(same):
        if options_of(job.options) == options:
            return _estimate(_given(report), "runs")
    hardness = _hardness(same[-1][1]) if same else 1.0
    found = _promised(options, (width, height), hardness, jobs.threads)
    seconds = found.seconds
    for job, report in [run for run in ran if run[1]["time_limit"] is None][-1:]:
        size = report["width"], report["height"]
        its = _promised(options_of(job.options), size, _hardness(report), jobs.threads)
        seconds *= report["total_s"] / its.seconds
    seconds = min(seconds, options.goal.time_limit or math.inf)
    return _estimate(found._replace(seconds=seconds), "runs" if same else "rule")


def _estimate(found: Figures, based_on: Literal["rule", "runs"]) -> Estimate:
    return Estimate(
        gaussians=round(found.gaussians),
        bytes=round(found.bytes),
        gzip_bytes=round(found.gzip_bytes),
        seconds=round(found.seconds, 2),
        psnr=round(found.psnr, 1) if found.gaussians and math.isfinite(found.psnr) else None,
        based_on=based_on,
    )


def _given(report: dict[str, Any]) -> Figures:
    pixels = report["fit_width"] * report["fit_height"]
    names = ("gaussians", "svg_bytes", "svgz_bytes", "total_s")
    equal = math.inf  # PSNR of a raster that is the photo
    return Figures(pixels, *(report[name] for name in names), psnr=report["psnr_svg"] or equal)


def _promised(options: Options, size: Size, hardness: float, threads: int) -> Figures:
    """Figures by the table, for a photo that needs so many times the Gaussians for its dB."""
    plan, goal = Plan(options), options.goal
    row = PROMISES[plan.quality or DEFAULT_PRESET]
    load = load_of(plan, Header(*size, has_alpha=False))
    pixels = load.fit_width * load.fit_height
    needed = hardness * pixels**_BY_PIXELS
    each, each_gzipped = row.bytes / row.gaussians, row.gzip_bytes / row.gaussians
    if plan.markup == MINIMAL:
        each, each_gzipped = bytes_each.MINIMAL[0], bytes_each.MINIMAL_GZIPPED[0]
    if goal.target_psnr is not None:
        count = needed * _shared(goal.target_psnr)
    elif goal.byte_limit is not None:
        count = goal.byte_limit / (each_gzipped if plan.counts_gzipped else each)
    elif plan.only_time_limits and goal.time_limit is not None:
        fit = load.fit_width, load.fit_height
        count = gaussians_within(goal.time_limit, fit, math.prod(load.measured), threads)
    else:
        count = needed * row.gaussians / row.pixels**_BY_PIXELS
    if plan.count is not None and not plan.count_adapts:
        count = plan.count
    else:
        count = min(count, load.gaussians, pixels / cap.TUNING.pixels_each)
    # Half of the time goes by the pixels, half by the Gaussians.
    work = pixels / row.pixels * (1 + count / row.gaussians) / 2
    return Figures(
        pixels=pixels,
        gaussians=count,
        bytes=each * count,
        gzip_bytes=each_gzipped * count,
        seconds=row.seconds * work / (1 + _SECOND_THREAD * (threads - 1)),
        psnr=_reached(count / needed),
    )


def _hardness(report: dict[str, Any]) -> float:
    """Times the Gaussians of the table that a run had for its dB."""
    given = _given(report)
    return max(given.gaussians, 1) / (given.pixels**_BY_PIXELS * _shared(given.psnr))


def _curve() -> tuple[list[float], list[float]]:
    """PSNR (dB) of the table over doublings of Gaussians, shared by photos of all sizes.

    Under the first preset it is a straight line, down to one Gaussian of a fit like its.
    """
    rows = list(PROMISES.values())
    decibels = [row.psnr for row in rows]
    doublings = [math.log2(row.gaussians / row.pixels**_BY_PIXELS) for row in rows]
    down = math.log2(rows[0].gaussians)
    slope = (decibels[1] - decibels[0]) / (doublings[1] - doublings[0])
    return [decibels[0] - slope * down, *decibels], [doublings[0] - down, *doublings]


_DECIBELS, _DOUBLINGS = _curve()


def _shared(psnr: float) -> float:
    """Gaussians for a PSNR, over the power of the pixels."""
    return 2.0 ** float(np.interp(psnr, _DECIBELS, _DOUBLINGS))


def _reached(shared: float) -> float:
    """PSNR in dB that Gaussians over the power of the pixels reach: the inverse of `_shared`."""
    return float(np.interp(math.log2(max(shared, 2.0 ** _DOUBLINGS[0])), _DOUBLINGS, _DECIBELS))
