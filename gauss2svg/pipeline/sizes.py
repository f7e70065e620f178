"""The sizes of a run in px: of the photo, of the fit, and of the pictures that are compared."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gauss2svg.photo.photo import Header
from gauss2svg.photo.reduce import Size
from gauss2svg.pipeline.memory_budget import MEASURED_PIXELS, Load, size_that_fits
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.presets import CAP_FOR_TARGET
from gauss2svg.pipeline.search.enlarged import may_enlarge

# The size of a fit within a time limit (docs/decisions/time.md).
PIXELS_PER_SECOND = 150_000  # most pixels of the fit for each second of the limit
START_S = 0.5  # seconds of the limit that the start takes
LEAST_S = 0.25  # fewest seconds of the limit that are left


@dataclass(frozen=True)
class Sizes:
    """Width and height of the fit, of what is measured and of what is decoded.

    measured  that of the fit or of MEASURED_PIXELS, whichever is larger, or the photo's
    decoded   that measured, or the photo's where it is to be reduced by Lanczos' filter
    note      where memory is the reason for that of the fit
    """

    fit: Size
    measured: Size
    decoded: Size
    note: str | None = None


def sizes_of(plan: Plan, photo: Header, most_bytes: int, may_reduce: bool = True) -> Sizes:
    """The sizes for a photo: the preset's, smaller for lack of time or of memory.

    may_reduce  whether lack of memory may reduce the fit
    Raises InputError for too little memory.
    """
    load = load_of(plan, photo)
    asked = plan.options.run.max_size is not None or not may_reduce
    width, height, note = size_that_fits(load, most_bytes, asked=asked)
    load = replace(load, fit_width=width, fit_height=height)
    return Sizes((width, height), load.measured, load.decoded, note)


def load_of(plan: Plan, photo: Header) -> Load:
    """What determines the memory of a run on a photo."""
    goal, run = plan.options.goal, plan.options.run
    width, height = photo.width, photo.height
    scale = min(1.0, plan.side / max(width, height))
    if goal.time_limit is not None and run.max_size is None:
        seconds = max(goal.time_limit - START_S, LEAST_S)
        pixels = PIXELS_PER_SECOND * seconds
        scale = min(scale, math.sqrt(pixels / (width * height)))
    fit_width, fit_height = (max(1, round(side * scale)) for side in (width, height))
    most = plan.preset.cap if plan.aim is None else CAP_FOR_TARGET
    return Load(
        width,
        height,
        fit_width,
        fit_height,
        gaussians=most if plan.count is None else plan.count,
        adapts=plan.count is None,
        loss=plan.options.fit.loss,
        blend=plan.options.fit.blend,
        has_alpha=photo.has_alpha,
        scoring=0 if goal.target is None else goal.target.pixel_bytes,
        least_measured=None if run.full_size else MEASURED_PIXELS,
        reduced_bytes=photo.reduced_bytes,
        in_inks=plan.in_inks,
        may_enlarge=may_enlarge(width, height) and plan.may_enlarge,
    )
