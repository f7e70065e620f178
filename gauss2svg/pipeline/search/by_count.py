"""The search by count: fit, write, rasterise, measure, and correct the number of Gaussians.

Targets apply to the rasterised SVG at the size at which the report measures it, so every correction
with a target rasterises the SVG. `Limits` decides the next count and the best file.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.options import FitConfig, FitProgress, FitResult
from gauss2svg.fit.session import DensificationPolicy, FitSession
from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.photo.alpha import over
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.pipeline.search.limits import Limits
from gauss2svg.pipeline.search.outcome import Export, Exporter, Outcome, Subject
from gauss2svg.render.cpu import kernel_lock
from gauss2svg.scene import ADD

# Corrections of a count (docs/decisions/monotone.md).
CORRECTIONS = 5  # largest number of corrections
CORRECTION_SHARE = 0.25  # share of a fit's iterations that a correction takes
LEAST_STEPS = 40  # fewest steps of a correction
ADDITIVE_SHARE = 0.35  # share of the time that the additive fit before a portable file takes


class ByCount:
    """A search for the number of Gaussians with which a file meets a plan."""

    def __init__(self, plan: Plan, subject: Subject, run: Run) -> None:
        self._plan, self._subject, self._run = plan, subject, run
        self._exporter = Exporter(plan, subject)
        self._limits = Limits(plan, self._exporter, run.budget, math.prod(subject.size))
        given = DensificationPolicy(plan.fit_config)
        self._policy = self._limits if plan.goal.count_adapts else given
        self._exports: list[Export] = []

    def run(self) -> Outcome:
        """Fit, write, and correct the count while it helps. Return the best file, measured."""
        plan, limits, run = self._plan, self._limits, self._run
        steps = max(LEAST_STEPS, round(CORRECTION_SHARE * (plan.fit_config.iterations or 0)))
        adapts = plan.goal.count_adapts
        with kernel_lock:
            session, before = self._fitted()
            self._export(session)
            while adapts and len(self._exports) <= CORRECTIONS and not self._ended(session):
                count = limits.corrected(len(session.state), self._exports)
                if count == len(session.state):
                    break
                session.resize(count, steps)
                self._export(session)
            best = self._pruned(limits.best(self._exports))
            run.notify("measure")
            photo, options = self._subject.photo, plan.options.run
            raster = self._exporter.raster(best.svg, photo)
            measured = round_trip(
                best.svg, best.scene, photo, options.renderer, plan.covering, raster
            )
        reason = limits.ended_by(best) if adapts else self._policy.stop_reason
        return Outcome(
            plan=plan,
            subject=self._subject,
            scene=best.scene,
            svg=best.svg,
            format=best.format,
            fitted=session.result().after(before, self._ended(session) or reason),
            measured=measured,
            corrections=len(self._exports) - 1,
            reached=math.nan if options.full_size else best.score,
        )

    def _fitted(self) -> tuple[FitSession, FitResult | None]:
        """Run the fit of the first export. Return it, and a portable file's additive fit before it.

        With only a time limit, few Gaussians are fitted on reduced pictures first, which is faster.
        """
        plan, limits, run, before = self._plan, self._limits, self._run, None
        run.stop()
        if plan.options.svg.portable:
            run.budget.begin_fit(limits.expected, ADDITIVE_SHARE)
            first = self._session("additive", over(self._subject.working), plan.config(ADD))
            first.fit()
            before, limits.is_additive = first.result(), False
        run.budget.begin_fit(limits.expected)
        config = plan.fit_config
        if plan.only_time_limits:
            config = dataclasses.replace(config, gaussians=limits.expected)
        session = self._session("fit", self._subject.working, config)
        if before is not None:
            session.adopt(before.scene, plan.fit_config.gaussians)
        session.fit()
        return session, before

    def _session(self, phase: str, pixels: NDArray[np.float32], config: FitConfig) -> FitSession:
        subject, run = self._subject, self._run

        def progress(now: FitProgress) -> None:
            target = session.population.target
            run.budget.stepped(target.width * target.height, now.gaussians, now.done)
            run.notify("correct" if self._exports else phase, now)
            run.stop()

        session = FitSession(
            pixels,
            config,
            self._policy,
            run.budget.fit_ends,
            progress,
            as_written=self._exporter.as_written if phase == "fit" else None,
            stop=lambda: run.ended,
            targets=subject.targets(self._plan.tune) if pixels is subject.working else None,
        )
        return session

    def _ended(self, session: FitSession) -> str:
        """Return the reason why the fit ended before its last step, or "" if it did not."""
        late = "time_limit" * session.clock.out_of_time
        return "interrupted" if self._run.ended else late

    def _export(self, session: FitSession) -> None:
        """Write the scene of the fit, and rasterise it if there is an aim."""
        self._run.notify("write")
        if self._plan.aim is not None:
            self._run.notify("measure")
        self._exports.append(self._exporter.export(session.scene()))

    def _pruned(self, best: Export) -> Export:
        """Return an export with Gaussians removed until it is within the limit of bytes."""
        limit = self._plan.goal.byte_limit
        if limit is None or best.size <= limit:
            return best
        order = self._subject.by_use(best.scene, self._plan.tune)
        return best.pruned_to(limit, self._exporter.empty_bytes, order)
