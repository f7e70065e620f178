"""The search by count: fit, write, rasterise, measure, and correct the number of Gaussians.

Targets apply to the rasterised SVG, so every correction rasterises one. The search runs at the
size of the fit; the additional error of a larger reference is measured once and added. Kodak 20,
768 px wide and fitted at 384 px, with a target of 28 dB:

    Gaussians    PSNR at 384 px    PSNR against the photo
    195          28.24             26.14, measured: the photo has detail that the fit did not see
    299          29.00             26.59, by the squared error that the photo added before
    607          31.03             27.63
    759          32.23             28.14, and measured 28.13: reached

Each count is the last one doubled as often as the dB that lack up to 28.12 take, by the dB gained
per doubling: at first 3.2, as during the growth, then by the last two exports, at least 1.5.
"""

from __future__ import annotations

import dataclasses
import math
import time

from gauss2svg.fit import schedule
from gauss2svg.fit.options import FitProgress, FitResult
from gauss2svg.fit.session import DensificationPolicy, FitSession, Snapshot
from gauss2svg.measure.roundtrip import RoundTrip, measure_pixels
from gauss2svg.photo.alpha import over
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.search.correction import Corrections
from gauss2svg.pipeline.search.export import Export, Exporter
from gauss2svg.pipeline.search.limits import Cap, Limits, fewest
from gauss2svg.pipeline.search.outcome import Outcome, Subject, Watch
from gauss2svg.raster import rasterize_like
from gauss2svg.render.cpu import kernel_lock

# Number and length of corrections (docs/decisions/monotone.md).
CORRECTIONS = 5  # most corrections of a count
CALIBRATIONS = 2  # most calibrations of a search on a smaller image
CORRECTION_SHARE = 0.25  # share of a fit's iterations that a correction takes
LEAST_STEPS = 40  # fewest steps of a correction
ADDITIVE_SHARE = 0.35  # share of the time that the additive fit before a portable file takes
AT_THE_CAP = 0.95  # share of the largest count from which the cap ended the fit
BOUND = 0.93  # share of the allowed bytes from which they ended the fit


class ByCount:
    """A search for the number of Gaussians with which a file is what a plan asks for."""

    def __init__(self, plan: Plan, subject: Subject, watch: Watch) -> None:
        self._plan, self._subject, self._watch = plan, subject, watch
        self._ended = False
        self._exporter = Exporter(plan, subject)
        self._limits = Limits(plan, self._exporter, watch.budget, math.prod(subject.size))
        given = DensificationPolicy(plan.fit_config)
        self._policy = self._limits if plan.goal.count_adapts else given
        self._corrections = Corrections(plan, self._limits)
        self._additive: FitResult | None = None

    def run(self) -> Outcome:
        """Fit, write and measure; correct the count until the targets are met or unreachable."""
        iterations = self._plan.fit_config.iterations or self._plan.iterations
        steps = max(LEAST_STEPS, round(CORRECTION_SHARE * iterations))
        with kernel_lock:
            session = self._session = self._fitted()
            self._export()
            calibrations = 0
            while True:
                for _ in range(CORRECTIONS):
                    count = self._next_count()
                    if count == len(session.state):
                        break
                    session.resize(count, steps)
                    self._export()
                best = self._best()
                self._watch.report("measure", None)
                measured = self._exporter.measured(best, self._watch.budget.measures_small)
                reached = self._reached(best, measured)
                if calibrations == CALIBRATIONS or not self._calibrate(best, measured, reached):
                    break
                calibrations += 1
        return Outcome(
            plan=self._plan,
            subject=self._subject,
            scene=best.scene,
            svg=best.svg,
            format=best.format,
            reached=reached,
            fitted=session.result().after(self._additive, self._stop_reason(best, reached)),
            measured=measured,
            corrections=len(self._corrections.made) - 1,
        )

    def _fitted(self) -> FitSession:
        """Return the fit of the first export, after an additive one for a portable file."""
        plan, subject, limits = self._plan, self._subject, self._limits
        config = plan.fit_config
        self._look_for_stop()
        if plan.options.svg.portable:
            white = over(subject.working)
            targets = subject.targets(plan.tune) if white is subject.working else None
            self._watch.budget.begin_fit(self._expected, ADDITIVE_SHARE)
            first = FitSession(
                white, plan.additive_config, self._policy, self._watch.budget.fit_ends,
                lambda now: self._after_step("additive", now), stop=self._is_ended,
                targets=targets,
            )  # fmt: skip
            first.fit()
            self._additive = first.result()
            limits.is_additive = False
        if limits.expected is not None:  # few are fitted on reduced pictures first
            config = dataclasses.replace(config, gaussians=limits.expected)
        self._watch.budget.begin_fit(self._expected)
        self._session = session = FitSession(
            subject.working, config, self._policy, self._watch.budget.fit_ends, self._on_step,
            self._exporter.as_written, self._is_ended, subject.targets(plan.tune),
        )  # fmt: skip
        if self._additive is not None:
            session.adopt(self._additive.scene, plan.fit_config.gaussians)
        session.fit()
        if limits.cap.name == "time_limit":  # found after growth ended
            session.prune_to(limits.cap.gaussians)
        limits.allow_for_target()
        return session

    @property
    def _expected(self) -> int:
        """Largest count that the fit may end with, as far as it is known before."""
        return self._limits.expected or self._limits.cap.gaussians

    def _on_step(self, now: FitProgress) -> None:
        target, budget = self._session.population.target, self._watch.budget
        growing = now.done <= schedule.GROWTH_SHARE
        budget.stepped(target.width * target.height, now.gaussians, growing)
        self._after_step("correct" if self._corrections.made else "fit", now)
        most = budget.reserve(now.done, now.gaussians, lambda: self._export_seconds(now.psnr))
        if most is not None:
            self._limits.cap = fewest(self._limits.cap, Cap(most, "time_limit"))

    def _after_step(self, phase: str, now: FitProgress) -> None:
        self._watch.report(phase, now)
        self._look_for_stop()

    def _look_for_stop(self) -> None:
        self._ended = self._ended or self._watch.stop()

    def _is_ended(self) -> bool:
        return self._ended

    def _export_seconds(self, psnr: float) -> float:
        """Return the seconds that writing, rasterising and measuring the scene takes."""
        begun = time.perf_counter()
        svg = self._exporter.write(self._session.scene(), psnr)
        image = self._subject.working
        measure_pixels(rasterize_like(svg, image, self._plan.options.run.renderer), image)
        return time.perf_counter() - begun

    def _export(self) -> None:
        """Write the scene of the fit, and rasterise it if there is an aim."""
        self._watch.report("write", None)
        if self._plan.aim is not None:
            self._watch.report("measure", None)
        self._corrections.made.append(self._exporter.export(self._session.scene()))

    def _next_count(self) -> int:
        """Return the count of the next export, the present one if no correction is needed."""
        session, last = self._session, self._corrections.made[-1]
        count = len(session.state)
        if self._policy is not self._limits or self._ended or session.clock.out_of_time:
            return count
        now = Snapshot(count, 1.0, lambda: last.model, session.scene)
        return self._corrections.next(count, self._limits.within_bytes(now, last.size))

    def _best(self) -> Export:
        """Return the best export, within the limit of bytes."""
        best, limit = self._corrections.best(), self._plan.goal.byte_limit
        if limit is None:
            return best
        target = self._subject.target(self._plan.tune)
        return best.pruned_to(limit, self._exporter.empty_bytes, target)

    def _calibrate(self, best: Export, measured: RoundTrip, reached: float | None) -> bool:
        """Correct the scores by that against the reference; return whether they have changed."""
        aim, photo, corrections = self._plan.aim, self._subject.photo, self._corrections
        smaller = photo.shape != self._subject.working.shape
        # Without time the file is measured at the size of the fit, which tells nothing new.
        if aim is None or reached is None or not smaller or measured.raster.shape != photo.shape:
            return False
        if self._ended or math.isnan(best.score):  # it was pruned to its bytes
            return False
        if aim.reached(reached) and reached <= aim.value + aim.too_good:
            return False
        before, corrections.detail = corrections.detail, aim.detail(reached, best.score)
        return corrections.detail != before

    def _reached(self, best: Export, measured: RoundTrip) -> float | None:
        """Return the score of a measured file by the aim, None without one."""
        aim, photo, working = self._plan.aim, self._subject.photo, self._subject.working
        if aim is None:
            return None
        shape = measured.raster.shape
        if aim.known(measured) is None and shape == working.shape and not math.isnan(best.score):
            return best.score  # of the same raster
        return aim.of_file(measured, photo, working)

    def _stop_reason(self, best: Export, reached: float | None) -> str:
        aim, limit = self._plan.aim, self._plan.goal.byte_limit or math.inf
        if aim is not None and reached is not None and aim.reached(reached):
            return aim.name
        if self._ended or self._session.clock.out_of_time:
            return "interrupted" if self._ended else "time_limit"
        by_bytes = aim is not None and self._policy.stop_reason == "max_bytes"
        if best.size > BOUND * limit or by_bytes:
            return "max_bytes"
        if aim is None or not len(best.scene):
            return self._policy.stop_reason
        # Whatever ended the growth, corrections did not reach the target.
        cap = self._limits.cap
        return cap.name if len(best.scene) > AT_THE_CAP * cap.gaussians else "iterations"
