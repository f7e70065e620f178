"""What a run will give, before it runs: by a measured rule, corrected by the runs so far.

The rule's numbers are in docs/decisions/studio.md.
"""

from __future__ import annotations

import math
from statistics import median
from typing import Any

import numpy as np

from gauss2svg.errors import whole_number
from gauss2svg.photo.limits import MOST_PIXELS
from gauss2svg.photo.photo import Header
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.presets import DEFAULT_PRESET, PRESETS
from gauss2svg.pipeline.sizes import load_of
from gauss2svg.pipeline.time_budget import gaussians_within
from gauss2svg.studio.answers import Estimate
from gauss2svg.studio.form import options_of
from gauss2svg.studio.jobs import DONE, Job, Jobs
from gauss2svg.svg.format import MINIMAL

# PSNR in dB and Gaussians of the presets, means of the eight Kodak photos.
_PSNR = (24.0, 28.4, 32.6, 37.2, 41.5)
_GAUSSIANS = (400, 1250, 3780, 9900, 22500)
_OF_PIXELS = 768 * 512
_BY_PIXELS = 0.25  # power of the pixels by which they grow
# Bytes of a file without shapes, of a shape, and gzipped.
_EMPTY = 900
_EACH = dict(zip(PRESETS, [(130, 20), (130, 20), (130, 20), (150, 24), (250, 30)], strict=True))
_EACH_MINIMAL = (75, 17)
# CPU seconds of a step: for a pixel, for a Gaussian. And afterwards, once.
_STEP_PIXEL, _STEP_GAUSSIAN, _AFTER_PIXEL, _AFTER_GAUSSIAN = 8.3e-8, 1.9e-6, 1.4e-6, 2.4e-4
_SECOND_THREAD = 0.6  # what each further thread adds to the speed of the first


class Estimator:
    """Estimates, the closer the more has run."""

    def __init__(self, queue: Jobs) -> None:
        self._queue = queue

    def estimate(self, width: Any, height: Any, options: Options, of: Job | None) -> Estimate:
        """Gaussians, bytes, gzipped bytes, seconds, PSNR in dB, and what they are based on.

        of  a job of the same photo, or None
        Raises InputError for sides that are no numbers of px.
        """
        width = whole_number("width", width, 1, MOST_PIXELS)
        height = whole_number("height", height, 1, MOST_PIXELS)
        ran = [(job, job.report) for job in self._queue.known.values() if job.report]
        ran = [(job, report) for job, report in ran if job.state == DONE]
        same = [one for one in ran if of is not None and one[0].digest == of.digest]
        reports = [report for _, report in same]
        shift = _middle([r["psnr_svg"] - _psnr_of(r) for r in reports if r["psnr_svg"]], 0.0)
        count = self._count(width, height, options, shift)
        if _adapts(options):
            adapted = [r for job, r in same if _adapts(options_of(job.options))]
            count *= _middle([r["gaussians"] / self._count_of(r) for r in adapted])
        found = self._figures(width, height, options, count)
        for key, of_report, runs in (
            ("bytes", "svg_bytes", same),
            ("gzip_bytes", "svgz_bytes", same),
            ("seconds", "total_s", same or ran),
        ):
            # Of the rule for as many Gaussians.
            rules = [
                self._figures(r["width"], r["height"], options_of(job.options), r["gaussians"])
                for job, r in runs
            ]
            ratios = zip(runs, rules, strict=True)
            found[key] *= _middle([run[1][of_report] / rule[key] for run, rule in ratios])
        limit = options.goal.byte_limit
        if limit is not None:
            key = "gzip_bytes" if Plan(options).counts_gzipped else "bytes"
            found[key] = min(found[key], limit)
        if options.goal.time_limit is not None:
            found["seconds"] = min(found["seconds"], options.goal.time_limit)
        return {
            "gaussians": round(count),
            "bytes": round(found["bytes"]),
            "gzip_bytes": round(found["gzip_bytes"]),
            "seconds": round(found["seconds"], 2),
            "psnr": round(found["psnr"] + shift, 1) if count else None,
            "based_on": "runs" if same else "rule",
        }

    def _count_of(self, report: dict[str, Any]) -> float:
        options = options_of({"quality": report["quality"] or DEFAULT_PRESET})
        return max(1.0, self._count(report["width"], report["height"], options, 0.0))

    def _count(self, width: int, height: int, options: Options, shift: float) -> float:
        """Gaussians by the rule; shift: by how many dB the photo is easier than those of it."""
        plan, goal = Plan(options), options.goal
        load = load_of(plan, Header(width, height, has_alpha=False))
        pixels = load.fit_width * load.fit_height
        grown = _grown(pixels)
        if goal.target_psnr is not None:
            curve = np.interp(goal.target_psnr - shift, _PSNR, np.log2(_GAUSSIANS))
            count = 2.0 ** float(curve) * grown
        elif goal.byte_limit is not None:
            count = (goal.byte_limit - _EMPTY / 2) / _each(plan)[plan.counts_gzipped]
        elif plan.only_time_limits and goal.time_limit is not None:
            size, threads = (load.fit_width, load.fit_height), self._queue.threads
            count = gaussians_within(goal.time_limit, size, math.prod(load.measured), threads)
        else:
            count = _GAUSSIANS[list(PRESETS).index(plan.quality or DEFAULT_PRESET)] * grown
        if goal.count is not None:
            count = min(count, goal.count) if plan.count_adapts else goal.count
        else:
            count = min(count, load.gaussians)
        return max(0.0, min(count, pixels / 3) if _adapts(options) else count)

    def _figures(self, width: int, height: int, options: Options, count: float) -> dict[str, float]:
        """Bytes, gzipped bytes, seconds and dB of so many Gaussians by the rule."""
        plan = Plan(options)
        load, each = load_of(plan, Header(width, height, has_alpha=False)), _each(plan)
        pixels = load.fit_width * load.fit_height
        steps = plan.fit_config.steps(load.fit_width, load.fit_height) or plan.iterations
        work = steps * (_STEP_PIXEL * pixels + _STEP_GAUSSIAN * count)
        work += _AFTER_PIXEL * math.prod(load.measured) + _AFTER_GAUSSIAN * count
        return {
            "bytes": _EMPTY + each[0] * count,
            "gzip_bytes": _EMPTY / 2 + each[1] * count,
            "seconds": work / (1 + _SECOND_THREAD * (self._queue.threads - 1)),
            "psnr": _on_curve(count / _grown(pixels)),
        }


def _adapts(options: Options) -> bool:
    """Whether the preset alone decides the number of Gaussians."""
    goal = options.goal
    given = (goal.gaussians, goal.max_bytes, goal.target, goal.time_limit)
    return all(one is None for one in given)


def _each(plan: Plan) -> tuple[int, int]:
    """Bytes of a shape, and gzipped."""
    return _EACH_MINIMAL if plan.markup == MINIMAL else _EACH[plan.quality or DEFAULT_PRESET]


def _grown(pixels: float) -> float:
    return (pixels / _OF_PIXELS) ** _BY_PIXELS


def _on_curve(count: float) -> float:
    return float(np.interp(math.log2(max(count, 1)), np.log2(_GAUSSIANS), _PSNR))


def _psnr_of(report: dict[str, Any]) -> float:
    return _on_curve(report["gaussians"] / _grown(report["fit_width"] * report["fit_height"]))


def _middle(values: list[float], otherwise: float = 1.0) -> float:
    return median(values or [otherwise])
