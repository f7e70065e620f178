"""What a run will give, before it runs: by a measured rule, corrected by the runs so far.

The rule's numbers are in docs/decisions/studio.md.
"""

from __future__ import annotations

import math
from statistics import median
from typing import Any

import numpy as np

from gauss2svg.errors import whole_number
from gauss2svg.photo.formats import MOST_PIXELS
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.vectorize import load_of
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
_EACH = {"draft": (130, 20), "fast": (130, 20), "balanced": (130, 20), "high": (150, 24)}
_EACH_MINIMAL, _EACH_MAX = (75, 17), (250, 30)
# CPU seconds of a step: for a pixel, for a Gaussian. And afterwards, once.
_STEP_PIXEL, _STEP_GAUSSIAN, _AFTER_PIXEL, _AFTER_GAUSSIAN = 8.3e-8, 1.9e-6, 1.4e-6, 2.4e-4
_SECOND_THREAD = 0.6  # what each further thread adds to the speed of the first


class Estimator:
    """Estimates, the closer the more has run."""

    def __init__(self, queue: Jobs) -> None:
        self._queue = queue

    def estimate(self, width: Any, height: Any, options: Options, of: Job | None) -> dict[str, Any]:
        """Gaussians, bytes, gzipped bytes, seconds, PSNR in dB, and what they are based on.

        of  a job of the same photo, or None
        Raises InputError for sides that are no numbers of px.
        """
        width = whole_number("width", width, 1, MOST_PIXELS)
        height = whole_number("height", height, 1, MOST_PIXELS)
        ran = [job for job in self._queue.known.values() if job.state == DONE and job.report]
        pairs = [(job, job.report or {}, self._rule_of(job)) for job in ran]
        same = [p for p in pairs if of is not None and p[0].digest == of.digest]
        shift = median([r["psnr_svg"] - _psnr_of(r) for _, r, _ in same if r["psnr_svg"]] or [0.0])
        found = self._rule(width, height, options, shift)
        if _adapts(options):
            adapted = [p for p in same if _adapts(options_of(p[0].options))]
            factor = _factor(adapted, "gaussians", "gaussians")
            found = self._rule(width, height, options, shift, factor)
        found["bytes"] *= _factor(same, "bytes", "svg_bytes")
        found["gzip_bytes"] *= _factor(same, "gzip_bytes", "svgz_bytes")
        found["seconds"] *= _factor(same or pairs, "seconds", "total_s")
        limit = options.goal.max_bytes
        if isinstance(limit, int):
            key = "gzip_bytes" if options.svg.gzip else "bytes"
            found[key] = min(found[key], limit)
        if options.goal.time_limit is not None:
            found["seconds"] = min(found["seconds"], options.goal.time_limit)
        return {
            "gaussians": round(found["gaussians"]),
            "bytes": round(found["bytes"]),
            "gzip_bytes": round(found["gzip_bytes"]),
            "seconds": round(found["seconds"], 2),
            "psnr": round(found["psnr"], 1) if found["gaussians"] else None,
            "based_on": "runs" if same else "rule",
        }

    def _rule_of(self, job: Job) -> dict[str, float]:
        report = job.report or {}
        return self._rule(report["width"], report["height"], options_of(job.options))

    def _rule(
        self, width: int, height: int, options: Options, shift: float = 0.0, factor: float = 1.0
    ) -> dict[str, float]:
        """Figures of a photo of that size; shift of its PSNR in dB, factor of its Gaussians."""
        plan, goal = Plan(options), options.goal
        load = load_of(plan, width, height, has_alpha=False)
        pixels = load.fit_width * load.fit_height
        each = _EACH_MAX if goal.quality == "max" else _EACH[goal.quality]
        each = _EACH_MINIMAL if plan.markup == MINIMAL else each
        grown = (pixels / _OF_PIXELS) ** _BY_PIXELS
        if goal.target_psnr is not None:
            curve = np.interp(goal.target_psnr - shift, _PSNR, np.log2(_GAUSSIANS))
            count = 2.0 ** float(curve) * grown
        elif isinstance(goal.max_bytes, int):
            count = (goal.max_bytes - _EMPTY / 2) / each[1 if options.svg.gzip else 0]
        else:
            at = list(_EACH).index(goal.quality) if goal.quality in _EACH else len(_EACH)
            count = _GAUSSIANS[at] * grown * factor
        if isinstance(goal.gaussians, int):
            count = min(count, goal.gaussians) if plan.count_adapts else goal.gaussians
        else:
            count = min(count, load.gaussians)
        count = max(0.0, min(count, pixels / 3 if _adapts(options) else count))
        steps = plan.fit_config.steps(load.fit_width, load.fit_height) or plan.iterations
        work = steps * (_STEP_PIXEL * pixels + _STEP_GAUSSIAN * count)
        work += _AFTER_PIXEL * width * height + _AFTER_GAUSSIAN * count
        return {
            "gaussians": count,
            "bytes": _EMPTY + each[0] * count,
            "gzip_bytes": _EMPTY / 2 + each[1] * count,
            "seconds": work / (1 + _SECOND_THREAD * (self._queue.threads - 1)),
            "psnr": _on_curve(count / grown) + shift,
        }


def _adapts(options: Options) -> bool:
    """Whether the preset alone decides the number of Gaussians."""
    goal = options.goal
    given = (goal.gaussians, goal.max_bytes, goal.target_psnr, goal.target_ssimulacra2)
    return all(one is None for one in given)


def _on_curve(count: float) -> float:
    return float(np.interp(math.log2(max(count, 1)), np.log2(_GAUSSIANS), _PSNR))


def _psnr_of(report: dict[str, Any]) -> float:
    grown = (report["fit_width"] * report["fit_height"] / _OF_PIXELS) ** _BY_PIXELS
    return _on_curve(report["gaussians"] / grown)


def _factor(runs: list[tuple[Job, dict[str, Any], dict[str, float]]], key: str, of: str) -> float:
    """What the rule's figure has to be multiplied by, as the runs were."""
    return median([max(report[of], 1e-3) / max(rule[key], 1e-3) for _, report, rule in runs] or [1])
