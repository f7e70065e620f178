"""The search by count. It fits a scene, writes its file, and corrects the number of Gaussians.

The search repeats this until a correction no longer helps. `Limits` decides the number of Gaussians
of the next file, and which of the files is the best. A target is a score of the rasterised SVG, at
the size at which the report measures it. So if there is a target, each file is rasterised before
the number of Gaussians is corrected.
"""

from __future__ import annotations

import dataclasses
import math
from operator import attrgetter

from gauss2svg import portable
from gauss2svg.fit import FitConfig, FitProgress, FitResult
from gauss2svg.fit.session import DensificationPolicy, FitSession
from gauss2svg.fit.target import Target
from gauss2svg.photo.pixels import has_alpha, over
from gauss2svg.pipeline.limits import Limits
from gauss2svg.pipeline.outcome import Export, Exporter, Outcome, Subject
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.scene import ADD, Scene
from gauss2svg.scene.areas import AreaCounts

CORRECTION_SHARE = 0.25  # number of steps of a correction, as a share of the steps of the fit


class ByCount:
    """A search for the number of Gaussians with which a file meets the targets of the plan."""

    def __init__(self, plan: Plan, subject: Subject, run: Run) -> None:
        self._plan, self._subject, self._run = plan, subject, run
        self._exporter = Exporter(plan, subject)
        self._limits = Limits(plan, self._exporter, run.budget, math.prod(subject.size))
        adapts = plan.goal.count_adapts
        self._policy = self._limits if adapts else DensificationPolicy(plan.fit_config)
        self._phase = "fit"
        # The file of Subject.start, if there is a limit of bytes and the file is within all limits.
        self._first = list[Export]()

    def run(self) -> Outcome:
        """Fit and write a scene, and correct its number of Gaussians as long as this helps.

        Return the best file with its measurements.
        """
        plan, limits, run = self._plan, self._limits, self._run
        exports = list[Export]()
        session, additive = self._fitted()
        self._phase = "correct"
        while True:
            run.notify("write")
            if plan.aim is not None:
                run.notify("measure")
            exports.append(self._exporter.export(session.scene()))
            count = len(session.state)
            # Above areas, which draw most of the picture, fewer corrections suffice.
            most = 2 if plan.rate and plan.aim is None and count >= 40 else 5
            ends = run.ended or session.clock.out_of_time
            if ends or not plan.goal.count_adapts or len(exports) > most:
                break
            if (wanted := limits.corrected(count, exports)) == count:
                break
            session.resize(wanted, self._steps(CORRECTION_SHARE))
        candidates, limit = [*self._first, *exports], plan.goal.byte_limit
        best = limits.best(candidates)
        if limit is not None and best.size > limit:
            within = [export for export in candidates if export.size <= limit]
            best = max([self._exporter.pruned(best, limit), *within], key=attrgetter("score"))
        fitted = session.result()
        if best in self._first:
            fitted = fitted.after(None, "start")
        fitted = fitted.after(additive, fitted.stop_reason)
        return self._exporter.outcome(best, fitted, len(exports) - 1)

    def _fitted(self) -> tuple[FitSession, FitResult | None]:
        """Run the fit whose scene the first file shows. Return this fit.

        For a portable file, an additive fit runs before it. Return the result of the additive fit
        too, or None if there is none. If a time limit alone decides how many steps the returned fit
        has, the fit begins with few Gaussians on reduced pictures, because its steps are then
        faster.
        """
        plan, limits, run, additive = self._plan, self._limits, self._run, None
        run.stop()
        if plan.options.svg.portable:
            run.budget.begin_fit(limits.expected, share=0.35)
            self._phase = "additive"
            working, target = self._subject.working, self._subject.target(plan.tune)
            if has_alpha(working):
                target = Target(over(working), plan.tune)
            first = self._session(target, plan.config(ADD))
            first.fit()
            additive, limits.is_additive, self._phase = first.result(), False, "fit"
        run.budget.begin_fit(limits.expected)
        config = plan.fit_config
        if plan.only_time_limits:
            config = dataclasses.replace(config, gaussians=limits.expected)
        session = self._session(self._subject.target(plan.tune), config)
        if additive is not None:
            session.adopt(additive.scene, plan.fit_config.gaussians)
        start = self._subject.start
        if start and not session.population.target.is_blank:
            self._refine(session, start)
        else:
            session.fit()
        return session, additive

    def _refine(self, session: FitSession, start: Scene) -> None:
        """Refine the shapes of the scene `start` in place of a fit with growth.

        Shapes are first added or removed until there are as many as the user asks for. If the user
        gives no number, the number of shapes stays the same, unless it is above the cap. The more
        the number changes, the more steps follow: all steps of the fit if the number doubles or
        halves, and a share CORRECTION_SHARE of them if it stays the same.
        """
        plan, limits, count = self._plan, self._limits, self._plan.fit_config.gaussians
        # Growth has time for `expected` shapes. The shapes of `start` exist already, so the time
        # suffices for all of them.
        if plan.only_time_limits and plan.goal.count is None:
            limits.expected = len(start)
        if plan.goal.count_adapts:
            count, limits.stop_reason = min(len(start), limits.expected), "start"
        doublings = abs(portable.log2(max(count, 1) / len(start)))
        session.begin_with(start)
        if (limit := plan.goal.byte_limit) is not None:
            first = self._exporter.export(session.scene())
            if first.size <= limit and len(session.state) == count:
                self._first = [first]
        # The bytes of shapes that are not yet quantised would mislead the search for the count.
        keeps = limit is None or bool(self._first)
        session.refine(count, self._steps(min(max(doublings, CORRECTION_SHARE), 1.0)), keeps)

    def _steps(self, share: float) -> int:
        return max(40, round(share * (self._plan.fit_config.iterations or 0)))

    def _session(self, target: Target, config: FitConfig) -> FitSession:
        """Return a fit that reports its progress under the present phase of the search."""
        run, ground = self._run, self._subject.ground
        areas = "" if ground is None else str(AreaCounts.of(ground.areas))

        def progress(now: FitProgress) -> None:
            target = session.population.target
            run.budget.note_step(target.width * target.height, now.gaussians, now.done)
            if ground is not None:
                gaussians = now.gaussians + len(ground)
                now = dataclasses.replace(now, gaussians=gaussians, areas=areas)
            run.notify(self._phase, now)
            run.stop()

        as_written = None if self._phase == "additive" else self._exporter.as_written
        session = FitSession(
            target, config, self._policy, run.budget.fit_ends, progress, as_written,
            stop=lambda: run.ended,
        )  # fmt: skip
        return session
