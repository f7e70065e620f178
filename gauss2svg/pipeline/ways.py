"""The ways in which a plan may be carried out, of which the closest file is written."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.options import FitProgress, FitResult
from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.pipeline.candidate import Outcome
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.small import EXACT, SmallSearch
from gauss2svg.pipeline.time_budget import TimeBudget
from gauss2svg.svg.document import Document


def closest(
    ways: Sequence[Plan], found: Callable[[Plan], tuple[Outcome, NDArray[np.float32]]]
) -> tuple[Plan, Outcome, NDArray[np.float32]]:
    """The plan whose file is closest to the photo, its outcome with the costs of all, its image.

    found  carries out a plan; no further one is begun once it has been interrupted
    """
    tried: list[tuple[Plan, Outcome, NDArray[np.float32]]] = []
    for plan in ways:
        tried.append((plan, *found(plan)))
        if tried[-1][1].fitted.stop_reason == "interrupted":
            break
    plan, outcome, image = max(tried, key=lambda one: one[1].measured.psnr_lowest)
    fitted = outcome.fitted
    reason = tried[-1][1].fitted.stop_reason
    for _, other, _ in tried:
        if other is not outcome:
            ended = "interrupted" if reason == "interrupted" else fitted.stop_reason
            fitted = fitted.after(other.fitted, ended)
    return plan, dataclasses.replace(outcome, fitted=fitted), image


def small_outcome(
    plan: Plan,
    photo: NDArray[np.float32],
    canvas: tuple[int, int],
    document: Document,
    budget: TimeBudget,
    report: Callable[[str, FitProgress | None], None],
    stop: Callable[[], bool] | None = None,
) -> tuple[Outcome, NDArray[np.float32]]:
    """The outcome of a run with a plan that is_small, and the working picture; see SmallSearch.

    canvas  width and height in px of the file
    budget  of time
    report  called with "fit" or "measure", and the progress of the fit
    stop    polled at every step; True ends with the best so far
    """
    options, ended = plan.options, ""
    limit, quality = options.goal.max_bytes, options.goal.quality
    assert isinstance(limit, int)  # the plan is small
    caps = [plan.count] if plan.count is not None else []
    caps += [plan.preset.cap] if quality is not None else []

    def is_ended() -> bool:
        nonlocal ended
        if not ended and stop is not None and stop():
            ended = "interrupted"
        if not ended and search.fits and budget.is_over:  # the first fit makes a file
            ended = "time_limit"
        return bool(ended)

    search = SmallSearch(
        photo, limit, canvas=canvas, document=document, gzipped=plan.counts_gzipped,
        most=min(caps, default=None), options=options.fit, renderer=options.run.renderer,
        max_size=options.run.max_size, progress=lambda now: report("fit", now), stop=is_ended,
    )  # fmt: skip
    found = search.run()
    report("measure", None)
    reason = ended or "max_bytes"
    if not ended and found.error < EXACT:
        reason = "enough"
    elif not ended and len(found.scene) == plan.count:
        reason = "gaussians"
    costs = FitResult(found.scene, 0, 0, 0.0, 0.0, 0, reason)
    for fitted in search.fits:
        costs = dataclasses.replace(fitted.after(costs, reason), rounds=fitted.rounds)
    image = search.working if budget.measures_small else photo
    outcome = Outcome(
        scene=found.scene,
        svg=found.svg,
        format=plan.svg_format,
        quantization=plan.quantization(len(found.scene), None),
        reached=None,
        fitted=costs,
        measured=round_trip(found.svg, found.scene, image, options.run.renderer),
        corrections=max(len(search.fits) - 1, 0),
    )
    return outcome, search.working
