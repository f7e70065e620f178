"""The search for a scene that meets the targets: fit, write, rasterise, measure, correct.

Targets apply to the rasterised SVG, so every correction rasterises one. The search runs at the
size of the fit; the additional error of a larger photo is measured once and added.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from functools import partial
from typing import Any

from gauss2svg.errors import number_within, whole_number
from gauss2svg.fit.densification import (
    FIRST_ROUND,
    AdaptiveCount,
    DensificationPolicy,
    GrowthLimits,
    Revise,
    Snapshot,
    as_given,
)
from gauss2svg.fit.fit import fixed_count
from gauss2svg.fit.losses import psnr_of
from gauss2svg.fit.options import FitProgress, FitResult
from gauss2svg.fit.schedule import GROWTH_SHARE, QUANTIZED_FROM, ROUNDS
from gauss2svg.fit.session import FitSession
from gauss2svg.measure.roundtrip import RoundTrip
from gauss2svg.photo.alpha import over
from gauss2svg.pipeline.candidate import Candidate, Exporter, Outcome, pruned_to_size
from gauss2svg.pipeline.candidates import BOUND, INDISTINGUISHABLE, Candidates, Limit, fewest
from gauss2svg.pipeline.checkpoint import ADDITIVE, FIT, Checkpoint, damaged
from gauss2svg.pipeline.export_time import estimate_export_seconds
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.time_budget import TimeBudget
from gauss2svg.render.cpu import kernel_lock
from gauss2svg.svg.layers import segment_at

# Of the file, palette included (docs/decisions/numbers.md); measured if the bytes are limited.
KILOBYTES_PER_GAUSSIAN = 0.12
CAP_FOR_TARGET = 50000  # largest number of Gaussians for a target, whatever the preset
_GZIPPED = 0.17  # compressed share of the bytes, until it is measured
_LEAST_MEASURED = 200  # Gaussians from which the bytes of one are measured
# Times the allowed bytes that growth aims at, and refinement until its last steps: the least useful
# shapes go then (docs/decisions/markup.md).
_OVERFILL = 1.25, 1.03
# Times the allowed bytes beyond 1, over the root of the count, that the last steps begin with: the
# file is then full, and a few shapes more are pruned.
_SPARE = 0.4
_BYTES_TO_COME = 0.25  # share by which a shape's bytes, its colour's above all, grow in refinement
_PIXELS_EACH, _PIXELS_EACH_OF_BUDGET = 3, 2  # at least, for each Gaussian
_CORRECTIONS = 5
_CALIBRATIONS = 2  # of a search on a smaller image
_CORRECTION_SHARE = 0.25  # of the iterations of a fit
_LEAST_STEPS = 40
_WRITING_LOSS = 0.06  # share of the scene's error that writing is expected to add
_ADDITIVE_SHARE = 0.35  # of the time, for the additive fit before a portable file
_AT_THE_CAP = 0.95


class TargetSearch:
    """One run towards the targets of a plan.

    exporter    writes candidates; has the photo and the image that the fit runs on
    budget      of time
    report      called with "additive", "fit", "correct", "write" or "measure", and the progress of
                the fit
    stop        called after every step; True ends the run with the best result so far
    checkpoint  is offered the state of the run after every step of a fit
    resumed     the state in a checkpoint, from which to continue
    """

    def __init__(
        self,
        plan: Plan,
        exporter: Exporter,
        budget: TimeBudget,
        report: Callable[[str, FitProgress | None], None],
        stop: Callable[[], bool] | None = None,
        checkpoint: Checkpoint | None = None,
        resumed: dict[str, Any] | None = None,
    ) -> None:
        self._plan = plan
        self._exporter = exporter
        self._budget = budget
        self._report = report
        self._stop = stop or (lambda: False)
        self._ended = False
        self._checkpoint = checkpoint
        self._resumed = resumed or {}
        self._phase = "fit"
        self._aim = plan.aim
        self._max_bytes = plan.byte_limit
        self._bytes_each = KILOBYTES_PER_GAUSSIAN * 1000 * (_GZIPPED if plan.counts_gzipped else 1)
        self._bytes_known = False
        self._candidates = Candidates(plan, exporter.empty_bytes if self._max_bytes else 0)
        self._additive: FitResult | None = None
        self._limit = Limit(0, "gaussians")
        self._expected: int | None = None  # count, of a fit that is limited by time alone
        portable = plan.options.svg.portable
        self._policy = self._policy_for(as_given if portable else self._revise)
        if not portable:
            self._begin()

    def run(self) -> Outcome:
        """Fit, then correct until the targets are met or unreachable."""
        with kernel_lock:
            self._look_for_stop()
            if self._plan.options.svg.portable:
                self._begin_with_additive()
            elif self._resumed and self._resumed["stage"] != FIT:
                raise damaged("the checkpoint", ValueError("it is of an additive fit"))
            self._session.fit()
            if not self._ended:  # else the checkpoint is of the interrupted fit
                self._save(FIT, self._session, due=True)
            if self._limit.name == "time_limit":  # found after growth ended
                self._session.prune_to(self._limit.gaussians)
            if self._limit.name == "cap" and self._aim is not None:
                self._limit = Limit(self._cap_for_target, "cap")
            self._add_candidate()
            best, found, reached = self._corrected()
            for _ in range(_CALIBRATIONS):
                if self._ended or not self._calibrate(best, found, reached):
                    break
                best, found, reached = self._corrected()
        reason = self._stop_reason(best, reached)
        return Outcome(
            scene=best.scene,
            svg=best.svg,
            format=best.format,
            quantization=self._plan.quantization(len(best.scene), None),
            reached=reached,
            fitted=self._session.result().after(self._additive, reason),
            measured=found,
            corrections=len(self._candidates.made) - 1,
        )

    def _begin(self) -> None:
        """Create the session of the fit that is written, in the time that is left."""
        labels, exporter = self._exporter.document.labels, self._exporter
        config = self._plan.fit_config
        if self._expected is not None:  # few are fitted on reduced pictures first
            config = dataclasses.replace(config, gaussians=self._expected)
        deadline = self._budget.fit_deadline(self._expected or self._limit.gaussians)
        self._session = FitSession(
            exporter.working, config, self._policy, deadline, self._on_step, exporter.as_written,
            segment_at=None if labels is None else partial(segment_at, labels),
            stop=self._is_ended,
        )  # fmt: skip
        self._restore(FIT, self._session)

    def _begin_with_additive(self) -> None:
        """Fit additively, and continue with the same Gaussians alpha-composited."""
        session = FitSession(
            over(self._exporter.working), self._plan.additive_config, self._policy,
            self._budget.fit_deadline(self._expected or self._limit.gaussians, _ADDITIVE_SHARE),
            lambda progress: self._after_step(ADDITIVE, session, progress),
            stop=self._is_ended,
        )  # fmt: skip
        continues = self._resumed.get("stage") == FIT
        if not continues:
            self._restore(ADDITIVE, session)
            session.fit()
            self._additive = session.result()
        if isinstance(self._policy, AdaptiveCount):  # it keeps the gains of the additive rounds
            self._policy.revise = self._revise
        self._begin()
        if self._additive is not None and not continues:
            self._session.adopt(self._additive.scene, self._plan.fit_config.gaussians)

    def _policy_for(self, revise: Revise) -> DensificationPolicy:
        plan, config = self._plan, self._plan.fit_config
        if plan.count is not None and not plan.count_adapts:
            return fixed_count(config)
        preset, (height, width) = plan.preset, self._exporter.working.shape[:2]
        # Nine numbers per Gaussian, three per pixel: more would exceed the image itself.
        each = _PIXELS_EACH_OF_BUDGET if plan.is_budget else _PIXELS_EACH
        cap = min(preset.cap, max(1, width * height // each))
        limits = GrowthLimits(preset.gain, KILOBYTES_PER_GAUSSIAN, preset.enough, cap)
        if self._max_bytes is not None:  # the best that fits, not what the preset calls enough
            enough = max(preset.enough, INDISTINGUISHABLE)
            limits = dataclasses.replace(limits, gain=0.0, psnr=enough)
        if plan.count is not None:
            limits = GrowthLimits(
                0.0, KILOBYTES_PER_GAUSSIAN, math.inf, plan.count, cap_named="gaussians"
            )
        aim = self._aim
        self._cap_for_target = limits.cap
        if aim is not None:
            if plan.count is None:
                self._cap_for_target = max(cap, min(CAP_FOR_TARGET, width * height))
            limits = dataclasses.replace(limits, gain=0.0)
            if aim.slope is None:  # that of the growth, which can aim at it
                wanted = aim.value + aim.over + 10 * math.log10(1 + _WRITING_LOSS)
                limits = dataclasses.replace(
                    limits, psnr=wanted, psnr_named=aim.name, cap=self._cap_for_target
                )
            # Else growth ends at what the preset calls enough, and corrections find the score.
        self._limit = Limit(limits.cap, limits.cap_named)
        if not plan.only_time_limits:
            return AdaptiveCount(limits, revise)
        expected = min(limits.cap, self._budget.most_gaussians(0, 0.0))
        self._expected = expected
        first = max(FIRST_ROUND, expected >> (ROUNDS - 1))
        return AdaptiveCount(dataclasses.replace(limits, cap=expected), revise, first)

    def _revise(self, limits: GrowthLimits, now: Snapshot) -> GrowthLimits:
        """The limits, capped by the bytes and the time."""
        most = self._limit
        if self._max_bytes is not None:
            by_bytes = self._most_by_bytes(now)
            most = fewest(most, Limit(by_bytes, "max_bytes"))
        if self._budget.deadline is not None:
            most = fewest(most, Limit(self._most_by_time(now, most.gaussians), "time_limit"))
        return dataclasses.replace(limits, cap=most.gaussians, cap_named=most.name)

    def _most_by_bytes(self, now: Snapshot) -> int:
        """The count that fills the limit; before the last steps a few more, of which some go."""
        assert self._max_bytes is not None
        exporter, refining = self._exporter, now.done > GROWTH_SHARE
        share = _OVERFILL[refining]
        if now.done >= QUANTIZED_FROM:
            share = 1 + _SPARE / math.sqrt(max(now.count, 1))
        if now.done >= 1 or self._aim is not None:  # what is over is not pruned
            share = 1.0
        room = max(self._max_bytes * share - exporter.empty_bytes, 0)
        known = self._bytes_known and not refining
        if now.count >= (1 if refining else _LEAST_MEASURED) and not known:
            self._bytes_known = True
            to_come = _BYTES_TO_COME * max(QUANTIZED_FROM - now.done, 0) if refining else 0.0
            psnr = now.psnr
            if self._session.population.reduction > 1:
                psnr = psnr_of(self._session.population.error())
            self._bytes_each = (1 + to_come) * exporter.bytes_each(now.scene(), psnr, room)
        return int(room / self._bytes_each)

    def _most_by_time(self, now: Snapshot, most: int) -> int:
        if self._plan.only_time_limits:
            return self._budget.most_gaussians(now.count, now.done)
        late = self._session.clock.growth_is_late and now.done <= GROWTH_SHARE
        return max(now.count, 1) if late else most

    def _on_step(self, progress: FitProgress) -> None:
        target = self._session.population.target
        growing = progress.done <= GROWTH_SHARE
        self._budget.stepped(target.width * target.height, progress.gaussians, growing)
        self._after_step(FIT, self._session, progress)
        reserved = self._budget.reserve(
            progress.done, progress.gaussians, lambda: self._export_seconds(progress.psnr)
        )
        if reserved is not None:
            self._session.clock.deadline, most = reserved
            if most is not None:
                self._limit = fewest(self._limit, Limit(most, "time_limit"))

    def _after_step(self, stage: str, session: FitSession, progress: FitProgress) -> None:
        self._report(stage if stage == ADDITIVE else self._phase, progress)
        self._look_for_stop()
        self._save(stage, session, due=self._ended)

    def _look_for_stop(self) -> None:
        self._ended = self._ended or self._stop()

    def _export_seconds(self, psnr: float) -> float:
        exporter = self._exporter
        return estimate_export_seconds(
            self._session.scene(), partial(exporter.write, psnr=psnr), exporter.working,
            self._plan.options.run.renderer,
        )  # fmt: skip

    def _is_ended(self) -> bool:
        return self._ended

    def _add_candidate(self) -> None:
        self._report("write", None)
        if self._aim is not None:
            self._report("measure", None)
        self._candidates.made.append(self._exporter.candidate(self._session.scene()))

    def _corrected(self) -> tuple[Candidate, RoundTrip, float | None]:
        """The best candidate after corrections of the count, its measurement, and its score."""
        self._correct()
        best = self._candidates.best()
        if self._max_bytes is not None:
            exporter, tune = self._exporter, self._plan.options.fit.tuned
            best = pruned_to_size(
                best, self._max_bytes, exporter.empty_bytes, exporter.working, tune
            )
        self._report("measure", None)
        found = self._exporter.measured(best, self._budget.measures_small)
        return best, found, self._reached(best, found)

    def _correct(self) -> None:
        """Change the count and refine until the last candidate needs no correction."""
        iterations = self._plan.fit_config.iterations or self._plan.iterations
        steps = max(_LEAST_STEPS, round(_CORRECTION_SHARE * iterations))
        policy = self._policy
        for _ in range(_CORRECTIONS):
            if self._ended or self._session.clock.out_of_time:
                break
            if not isinstance(policy, AdaptiveCount):
                break
            wanted, policy.stop_reason = self._candidates.correction(
                len(self._session.state), self._most_now(), policy.stop_reason, policy.slope
            )
            if wanted is None:
                break
            self._phase = "correct"
            self._session.resize(wanted, steps)
            self._add_candidate()

    def _most_now(self) -> Limit:
        """The largest count, also by the bytes of the last candidate."""
        if self._max_bytes is None:
            return self._limit
        scene, model = self._session.scene(), self._candidates.made[-1].model
        now = Snapshot(len(scene), 1.0, lambda: model, lambda: scene)
        return fewest(self._limit, Limit(self._most_by_bytes(now), "max_bytes"))

    def _calibrate(self, best: Candidate, measured: RoundTrip, reached: float | None) -> bool:
        """Correct the scores by that at the photo's size; False if there is no need."""
        aim, photo = self._aim, self._exporter.photo
        smaller = photo.shape != self._exporter.working.shape
        if aim is None or reached is None or not smaller or measured.raster.shape != photo.shape:
            return False
        if math.isnan(best.score):  # it was pruned to its bytes
            return False
        if aim.reached(reached) and reached <= aim.value + aim.too_good:
            return False
        before = self._candidates.detail
        self._candidates.detail = aim.detail(reached, best.score)
        return self._candidates.detail != before

    def _reached(self, best: Candidate, measured: RoundTrip) -> float | None:
        """The score of a measured file by the aim, if there is one."""
        if self._aim is None:
            return None
        if (known := self._aim.known(measured)) is not None:
            return known
        exporter, shape = self._exporter, measured.raster.shape
        if shape == exporter.working.shape and not math.isnan(best.score):
            return best.score  # of the same raster
        photo = exporter.photo if shape == exporter.photo.shape else exporter.working
        return self._aim.score(measured.raster, photo)

    def _stop_reason(self, best: Candidate, reached: float | None) -> str:
        aim = self._aim
        if aim is not None and reached is not None and aim.reached(reached):
            return aim.name
        if self._ended or self._session.clock.out_of_time:
            return "interrupted" if self._ended else "time_limit"
        bound = BOUND * (self._max_bytes or math.inf)
        if best.size > bound or (aim is not None and self._policy.stop_reason == "max_bytes"):
            return "max_bytes"
        if aim is None or not len(best.scene):
            return self._policy.stop_reason
        # Whatever ended the growth, corrections did not reach the target.
        full = len(best.scene) > _AT_THE_CAP * self._limit.gaussians
        return self._limit.name if full else "iterations"

    def _save(self, stage: str, session: FitSession, due: bool = False) -> None:
        if self._checkpoint is not None and self._phase != "correct":
            self._checkpoint.offer(partial(self._state_dict, stage, session), due)

    def _state_dict(self, stage: str, session: FitSession) -> dict[str, Any]:
        costs = None
        if self._additive is not None:
            names = (f.name for f in dataclasses.fields(FitResult) if f.name != "scene")
            costs = {name: getattr(self._additive, name) for name in names}
        return {
            "stage": stage,
            "fit": session.state_dict(),
            "additive": costs,
            "bytes_each": self._bytes_each,
            "bytes_known": self._bytes_known,
            "limit": list(self._limit),
            "seen": self._exporter.seen,
        }

    def _restore(self, stage: str, session: FitSession) -> None:
        """Load the state of a checkpoint of this stage into a session."""
        saved = self._resumed
        if saved.get("stage") != stage:
            return
        try:
            session.load_state_dict(saved["fit"])
            self._bytes_each = number_within("bytes_each", saved["bytes_each"], 1e-3, 1e9)
            self._bytes_known = bool(saved["bytes_known"])
            most, named = saved["limit"]
            self._limit = Limit(whole_number("limit", most, 0, 2**62), str(named))
            self._exporter.seen = number_within("seen", saved["seen"], -math.inf, math.inf)
            if saved["additive"] is not None:  # only its costs are used
                self._additive = FitResult(scene=session.scene(), **saved["additive"])
        except (MemoryError, AssertionError):
            raise
        except Exception as error:  # invalid values raise anything
            raise damaged("the checkpoint", error) from error
