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
from gauss2svg.fit.densification import AdaptiveCount, GrowthLimits, Snapshot, as_given
from gauss2svg.fit.options import FitProgress, FitResult
from gauss2svg.fit.session import FitSession
from gauss2svg.measure.roundtrip import RoundTrip, measure_pixels
from gauss2svg.photo.alpha import over
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.search.cap import Cap, Growth, fewest
from gauss2svg.pipeline.search.correction import Corrections
from gauss2svg.pipeline.search.export import Export, Exporter
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
        self._budget, self._report = watch.budget, watch.report
        self._ended = False
        self._phase = "fit"
        self._exporter = Exporter(plan, subject)
        self._corrections = Corrections(plan)
        self._additive: FitResult | None = None
        self._portable = plan.options.svg.portable
        pixels = math.prod(subject.size)
        self._growth = Growth(plan, self._exporter, watch.budget, pixels)
        self._policy = self._growth.policy(as_given if self._portable else self._revise)
        if not self._portable:
            self._begin()

    def run(self) -> Outcome:
        """Fit, then correct until the targets are met or unreachable."""
        with kernel_lock:
            self._fit()
            self._export()
            best, found, reached = self._corrected()
            for _ in range(CALIBRATIONS):
                if self._ended or not self._calibrate(best, found, reached):
                    break
                best, found, reached = self._corrected()
        reason = self._stop_reason(best, reached)
        return Outcome(
            plan=self._plan,
            working=self._subject.working,
            scene=best.scene,
            svg=best.svg,
            format=best.format,
            reached=reached,
            fitted=self._session.result().after(self._additive, reason),
            measured=found,
            corrections=len(self._corrections.made) - 1,
        )

    def _fit(self) -> None:
        """The fit of the first export; of a portable file both fits."""
        self._look_for_stop()
        if self._portable:
            self._begin_with_additive()
        self._session.fit()
        cap = self._growth.cap
        if cap.name == "time_limit":  # found after growth ended
            self._session.prune_to(cap.gaussians)
        # A preset's cap is of what is worth its bytes; a target may need more.
        if cap.name == "cap" and self._plan.aim is not None:
            self._growth.cap = Cap(self._growth.for_target, "cap")

    def _begin(self) -> None:
        """Create the session of the fit that is written, in the time that is left."""
        subject, config = self._subject, self._plan.fit_config
        if self._growth.expected is not None:  # few are fitted on reduced pictures first
            config = dataclasses.replace(config, gaussians=self._growth.expected)
        self._budget.begin_fit(self._growth.count)
        self._session = FitSession(
            subject.working, config, self._policy, self._budget.fit_ends,
            self._on_step, self._exporter.as_written,
            stop=self._is_ended, targets=subject.targets(self._plan.tune),
        )  # fmt: skip

    def _begin_with_additive(self) -> None:
        """Fit additively, and continue with the same Gaussians alpha-composited."""
        subject = self._subject
        white = over(subject.working)
        self._budget.begin_fit(self._growth.count, ADDITIVE_SHARE)
        session = FitSession(
            white, self._plan.additive_config, self._policy, self._budget.fit_ends,
            lambda progress: self._after_step("additive", progress),
            stop=self._is_ended,
            targets=subject.targets(self._plan.tune) if white is subject.working else None,
        )  # fmt: skip
        session.fit()
        self._additive = session.result()
        if isinstance(self._policy, AdaptiveCount):  # it keeps the gains of the additive rounds
            self._policy.revise = self._revise
        self._begin()
        self._session.adopt(self._additive.scene, self._plan.fit_config.gaussians)

    def _revise(self, limits: GrowthLimits, now: Snapshot) -> GrowthLimits:
        return self._growth.revised(limits, now)

    def _on_step(self, progress: FitProgress) -> None:
        target = self._session.population.target
        growing = progress.done <= schedule.GROWTH_SHARE
        self._budget.stepped(target.width * target.height, progress.gaussians, growing)
        self._after_step(self._phase, progress)
        most = self._budget.reserve(
            progress.done, progress.gaussians, lambda: self._export_seconds(progress.psnr)
        )
        if most is not None:
            self._growth.cap = fewest(self._growth.cap, Cap(most, "time_limit"))

    def _after_step(self, phase: str, progress: FitProgress) -> None:
        self._report(phase, progress)
        self._look_for_stop()

    def _look_for_stop(self) -> None:
        self._ended = self._ended or self._watch.stop()

    def _is_ended(self) -> bool:
        return self._ended

    def _export_seconds(self, psnr: float) -> float:
        """Seconds of writing, rasterising and measuring the scene as it is."""
        begun = time.perf_counter()
        svg = self._exporter.write(self._session.scene(), psnr)
        image = self._subject.working
        measure_pixels(rasterize_like(svg, image, self._plan.options.run.renderer), image)
        return time.perf_counter() - begun

    def _export(self) -> None:
        """Write the scene of the fit, and rasterise it if there is an aim."""
        self._report("write", None)
        if self._plan.aim is not None:
            self._report("measure", None)
        self._corrections.made.append(self._exporter.export(self._session.scene()))

    def _corrected(self) -> tuple[Export, RoundTrip, float | None]:
        """The best export after corrections of the count, its measurement, and its score."""
        self._correct()
        best, limit = self._corrections.best(), self._plan.byte_limit
        if limit is not None:
            target = self._subject.target(self._plan.tune)
            best = best.pruned_to(limit, self._exporter.empty_bytes, target)
        self._report("measure", None)
        found = self._exporter.measured(best, self._budget.measures_small)
        return best, found, self._reached(best, found)

    def _correct(self) -> None:
        """Change the count and refine until the last export needs no correction."""
        policy = self._policy
        if not isinstance(policy, AdaptiveCount):
            return
        iterations = self._plan.fit_config.iterations or self._plan.iterations
        steps = max(LEAST_STEPS, round(CORRECTION_SHARE * iterations))
        for _ in range(CORRECTIONS):
            if self._ended or self._session.clock.out_of_time:
                break
            count, cap = len(self._session.state), self._cap_now()
            wanted, policy.stop_reason = self._corrections.next(
                count, cap, policy.stop_reason, policy.slope
            )
            if wanted == count:
                break
            self._phase = "correct"
            self._session.resize(wanted, steps)
            self._export()

    def _cap_now(self) -> Cap:
        """The largest count, also by the bytes of the last export."""
        session, last = self._session, self._corrections.made[-1]
        now = Snapshot(len(session.state), 1.0, lambda: last.model, session.scene)
        return self._growth.by_bytes(now, last.size)

    def _calibrate(self, best: Export, measured: RoundTrip, reached: float | None) -> bool:
        """Correct the scores by that against the reference; False if there is no need."""
        aim, photo = self._plan.aim, self._subject.photo
        smaller = photo.shape != self._subject.working.shape
        # Without time the file is measured at the size of the fit, which tells nothing new.
        if aim is None or reached is None or not smaller or measured.raster.shape != photo.shape:
            return False
        if math.isnan(best.score):  # it was pruned to its bytes
            return False
        if aim.reached(reached) and reached <= aim.value + aim.too_good:
            return False
        before = self._corrections.detail
        self._corrections.detail = aim.detail(reached, best.score)
        return self._corrections.detail != before

    def _reached(self, best: Export, measured: RoundTrip) -> float | None:
        """The score of a measured file by the aim, if there is one."""
        aim, photo, working = self._plan.aim, self._subject.photo, self._subject.working
        if aim is None:
            return None
        shape = measured.raster.shape
        if aim.known(measured) is None and shape == working.shape and not math.isnan(best.score):
            return best.score  # of the same raster
        return aim.of_file(measured, photo, working)

    def _stop_reason(self, best: Export, reached: float | None) -> str:
        aim, limit = self._plan.aim, self._plan.byte_limit or math.inf
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
        cap = self._growth.cap
        return cap.name if len(best.scene) > AT_THE_CAP * cap.gaussians else "iterations"
