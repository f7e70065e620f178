"""The way to a scene that meets its targets: fit, write, draw, measure, correct.

Targets hold for the drawn SVG, so every round of corrections draws one. Search is done
at the size that the fit runs on; for a larger photo the difference is measured once and
carried along.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import metrics
from gauss2svg.alpha import over, views
from gauss2svg.attempt import Attempt, Outcome, finished_attempt, measured, trimmed
from gauss2svg.checkpoint import FIT, Checkpoint, damaged
from gauss2svg.checks import number_within, whole_number
from gauss2svg.correction import AIM, FILL, FULL, TOO_GOOD, Attempts
from gauss2svg.finish import Finish
from gauss2svg.fit.options import FitProgress, FitResult
from gauss2svg.fit.rules import (
    Demand,
    FixedCount,
    Revise,
    Rule,
    SceneDecides,
    Snapshot,
    as_demanded,
)
from gauss2svg.fit.run import Run
from gauss2svg.fit.schedule import GROWTH_SHARE
from gauss2svg.raster import rasterize_like
from gauss2svg.rehearsal import seconds_after
from gauss2svg.render.cpu import kernel_lock
from gauss2svg.request import Request
from gauss2svg.roundtrip import RoundTrip, model_psnr
from gauss2svg.scene import Scene
from gauss2svg.svg import SvgOptions, arranged, file_bytes, settled, write_svg
from gauss2svg.svg.layers import segment_at
from gauss2svg.targets import TOLERANCE

# Of a file, a Gaussian, palette included: fast writes 0.116, balanced 0.106, draft 0.189, its
# palette being a larger share (mean of three photos, examples/renderers.py). Replaced by the
# file's own where bytes are limited.
KILOBYTES_A_GAUSSIAN = 0.12
# A target of PSNR lifts the quality's cap to this.
CAP_FOR_PSNR = 50000
_GZIPPED = 0.17  # share of the bytes that is left then, until a file tells
_LEAST_MEASURED = 200  # Gaussians from which a file tells the bytes of one
_CORRECTIONS = 5
_CALIBRATIONS = 2  # of a search that ran on a smaller picture
_CORRECTION_SHARE = 0.25  # of the iterations of a fit, but not under
_LEAST_STEPS = 40
_WRITING_LOSS = 0.06  # of the model's error that the file is expected to add at first
_RESERVE_SHARE = 0.3  # of the time left, for what follows the fit, until it is measured
_SUM_SHARE = 0.35  # of the time, for the sum that a portable form begins with
_REHEARSE_AT = 0.4  # share of the fit done
_MOST_RESERVED = 0.6  # share of the time left then for what follows; with more, Gaussians go
_AT_THE_CAP = 0.95


class Pursuit:
    """One run towards the targets of a request.

    photo     (h, w, 3) float32 in 0..1, or (h, w, 4), what is measured against
    working   the same, perhaps smaller: what the fit runs on
    deadline  as time.perf_counter() counts, in s, or None
    tell      is called with "fit", "correct", "write" or "measure", and a fit's progress
    stop      asked after every step: True ends the run with what it has
    checkpoint  is offered where the run stands after every step of a fit; resumed is what one
              kept, from which to go on
    """

    def __init__(
        self,
        photo: NDArray[np.float32],
        working: NDArray[np.float32],
        request: Request,
        deadline: float | None,
        tell: Callable[[str, FitProgress | None], None],
        stop: Callable[[], bool] | None = None,
        checkpoint: Checkpoint | None = None,
        resumed: dict[str, Any] | None = None,
    ) -> None:
        self._photo = photo
        self._working = working
        self._request = request
        self._targets = request.targets
        self._deadline = deadline
        self._tell = tell
        self._stop = stop or (lambda: False)
        self._ended = False
        self._checkpoint = checkpoint
        self._resumed = resumed or {}
        self._phase = "fit"
        self._bytes_each = KILOBYTES_A_GAUSSIAN * 1000 * (_GZIPPED if request.gzip else 1)
        self._bytes_known = False
        self._rehearsed = deadline is None
        self._attempts = Attempts(request)
        self._sum: FitResult | None = None
        self._most = 0, "gaussians"
        self._rule = self._rule_asked_for(as_demanded if request.portable else self._revise)
        if not request.portable:
            self._begin()

    def _begin(self) -> None:
        """A run of the fit that is written, in the time that is left."""
        labels = self._request.page.segments
        self._run = Run(
            self._working, self._request.fit_options, self._rule, self._fit_deadline(),
            self._on_step, self._as_written,
            segment_at=None if labels is None else partial(segment_at, labels),
            stop=self._is_ended,
        )  # fmt: skip
        self._recall("fit", self._run)

    def _fit_deadline(self, share: float = 1 - _RESERVE_SHARE) -> float | None:
        """When the fit is to end that may use this share of the time left."""
        if self._deadline is None:
            return None
        now = time.perf_counter()
        return now + share * max(self._deadline - now, 0.0)

    def run(self) -> Outcome:
        """Fit, then correct until the targets are met or out of reach."""
        with kernel_lock:
            self._ended = self._stop()
            if self._request.portable:
                self._begin_with_a_sum()
            elif self._resumed and self._resumed["stage"] != FIT:
                raise damaged("the checkpoint", ValueError("it is of a sum"))
            self._run.fit()
            if not self._ended:  # what was kept then is before its hasty end
                self._keep("fit", self._run, due=True)
            if self._most[1] == "time_limit":  # told too late for the rule to be asked again
                self._run.trim(self._most[0])
            self._attempts.made.append(self._attempt())
            best, found = self._search()
            for _ in range(_CALIBRATIONS):
                if self._ended or not self._calibrate(best, found):
                    break
                best, found = self._search()
            finish = None
            if self._request.finish is not None and not self._ended:
                best, finish = self._finished(best, self._request.finish)
                self._tell("measure", None)
                found = self._measured(best)
        reason = self._stop_reason(best, found.psnr_lowest)
        fitted = self._run.result().after(self._sum, reason)
        return Outcome(
            scene=best.scene,
            svg=best.svg,
            svg_options=self._svg_options(len(best.scene), None),
            fitted=fitted,
            measured=found,
            corrections=len(self._attempts.made) - 1,
            finish=finish,
        )

    def _begin_with_a_sum(self) -> None:
        """Fit a sum, and go on with its Gaussians painted over each other."""
        run = Run(
            over(self._working), self._request.sum_options, self._rule,
            self._fit_deadline(_SUM_SHARE), lambda progress: self._on_step_of_sum(run, progress),
            stop=self._is_ended,
        )  # fmt: skip
        if self._resumed.get("stage") != "fit":
            self._recall("sum", run)
            run.fit()
            self._sum = run.result()
        if isinstance(self._rule, SceneDecides):  # what rounds of the sum bought still tells
            self._rule.revise = self._revise
        self._begin()
        if self._resumed.get("stage") != "fit":
            assert self._sum is not None  # it was fitted above
            asked = 0 if self._request.scene_decides else self._request.fit_options.gaussians
            self._run.adopt(self._sum.scene, asked)

    def _recall(self, stage: str, run: Run) -> None:
        """Put a run where a checkpoint of this stage left it."""
        memory = self._resumed
        if memory.get("stage") != stage:
            return
        try:
            run.recall(memory["fit"])
            self._bytes_each = number_within("bytes_each", memory["bytes_each"], 1e-3, 1e9)
            self._bytes_known = bool(memory["bytes_known"])
            most, named = memory["most"]
            self._most = whole_number("most", most, 0, 2**62), str(named)
            if memory["sum"] is not None:  # of which its costs alone are asked
                self._sum = FitResult(scene=run.scene(), **memory["sum"])
        except (MemoryError, AssertionError):
            raise
        except Exception as error:  # whatever its values are, they are no run's
            raise damaged("the checkpoint", error) from error

    def _memory(self, stage: str, run: Run) -> dict[str, Any]:
        costs = None
        if self._sum is not None:
            names = (f.name for f in dataclasses.fields(FitResult) if f.name != "scene")
            costs = {name: getattr(self._sum, name) for name in names}
        return {
            "stage": stage,
            "fit": run.memory(),
            "sum": costs,
            "bytes_each": self._bytes_each,
            "bytes_known": self._bytes_known,
            "most": list(self._most),
        }

    def _keep(self, stage: str, run: Run, due: bool = False) -> None:
        if self._checkpoint is not None and self._phase != "correct":
            self._checkpoint.offer(partial(self._memory, stage, run), due)

    def _is_ended(self) -> bool:
        return self._ended

    def _on_step_of_sum(self, run: Run, progress: FitProgress) -> None:
        self._tell("sum", progress)
        self._after_step("sum", run)

    def _after_step(self, stage: str, run: Run) -> None:
        self._ended = self._ended or self._stop()
        self._keep(stage, run, due=self._ended)

    def _finished(self, best: Attempt, name: str) -> tuple[Attempt, Finish]:
        limit = self._targets.max_bytes or math.inf
        tell = partial(self._tell, "finish")
        return finished_attempt(best, self._photo, self._working, name, limit, tell)

    def _search(self) -> tuple[Attempt, RoundTrip]:
        self._correct()
        best = self._attempts.best()
        if self._targets.max_bytes is not None:
            best = trimmed(best, self._targets.max_bytes, self._working)
        self._tell("measure", None)
        return best, self._measured(best)

    def _rule_asked_for(self, revise: Revise) -> Rule:
        request, options = self._request, self._request.fit_options
        if request.count is not None and not request.scene_decides:
            return FixedCount(
                request.schedule, request.count, options.iterations, options.per_round
            )
        preset, height, width = request.preset, *self._working.shape[:2]
        # Nine numbers a Gaussian, three a pixel: more would be no model of the picture.
        cap = min(preset.cap, max(1, width * height // 3))
        demand = Demand(preset.gain, KILOBYTES_A_GAUSSIAN, preset.enough, cap)
        if request.count is not None:
            demand = Demand(
                0.0, KILOBYTES_A_GAUSSIAN, math.inf, request.count, cap_named="gaussians"
            )
        if self._targets.psnr is not None:
            wanted = self._targets.psnr + AIM + 10 * math.log10(1 + _WRITING_LOSS)
            cap = demand.cap
            if request.count is None:
                cap = max(cap, min(CAP_FOR_PSNR, width * height))
            demand = dataclasses.replace(
                demand, gain=0.0, psnr=wanted, psnr_named="target_psnr", cap=cap
            )
        self._most = demand.cap, demand.cap_named
        return SceneDecides(demand, revise)

    def _revise(self, demand: Demand, now: Snapshot) -> Demand:
        """The demand with as many Gaussians as the bytes and the time allow."""
        most, named = self._most
        limit = self._targets.max_bytes
        if limit is not None:
            refining = now.done > GROWTH_SHARE
            if now.count >= _LEAST_MEASURED and (refining or not self._bytes_known):
                self._bytes_known = True
                svg = self._write(now.scene(), now.psnr)
                self._bytes_each = len(file_bytes(svg, self._request.gzip)) / now.count
            if limit * FILL / self._bytes_each < most:
                most, named = int(limit * FILL / self._bytes_each), "max_bytes"
        if self._run.clock.growth_is_late and now.done <= GROWTH_SHARE and now.count < most:
            most, named = max(now.count, 1), "time_limit"
        return dataclasses.replace(demand, cap=most, cap_named=named)

    def _on_step(self, progress: FitProgress) -> None:
        self._tell(self._phase, progress)
        self._after_step("fit", self._run)
        if not self._rehearsed and progress.done > _REHEARSE_AT and self._deadline is not None:
            self._rehearsed = True
            write = partial(self._write, psnr=progress.psnr)
            reserve = seconds_after(self._run.scene(), write, self._working, self._request.renderer)
            most = min(_MOST_RESERVED * self._time_left() / reserve, 1.0)
            if most < 1:
                self._most = max(1, int(progress.gaussians * most)), "time_limit"
            self._run.clock.deadline = self._deadline - most * reserve

    def _time_left(self) -> float:
        return math.inf if self._deadline is None else self._deadline - time.perf_counter()

    def _on_photo(self, scene: Scene) -> Scene:
        height, width = self._photo.shape[:2]
        scaled = scene.scaled(width / self._working.shape[1], height / self._working.shape[0])
        return scaled.replace(width=width, height=height)

    def _as_written(self, scene: Scene, psnr: float) -> Scene:
        options = self._svg_options(len(scene), 10 ** (-psnr / 10))
        photo = settled(self._on_photo(scene), options)
        return photo.scaled(scene.width / photo.width, scene.height / photo.height)

    def _write(self, scene: Scene, psnr: float) -> str:
        """The file of a scene on the working canvas, before its colours are settled."""
        options = self._svg_options(len(scene), 10 ** (-psnr / 10))
        return write_svg(self._on_photo(scene), options, self._request.page)

    def _svg_options(self, count: int, error: float | None) -> SvgOptions:
        options = self._request.svg_options(count, error)
        if self._ended and self._targets.max_bytes is None:
            # No steps are left that would make up for a palette: all colours are written.
            return dataclasses.replace(options, palette=0, color_error=0.0)
        return options

    def _attempt(self) -> Attempt:
        self._tell("write", None)
        scene = self._run.scene()
        model = model_psnr(scene, self._working)
        # Its colours are those of the palette already, save for plain ellipses that no longer are.
        options = self._svg_options(len(scene), None)
        page = self._request.page
        scaled = arranged(settled(self._on_photo(scene), options), page.segments)
        options = options.every_color
        svg = write_svg(scaled, options, page)
        error = math.nan
        if self._targets.psnr is not None:
            self._tell("measure", None)
            drawn = views(rasterize_like(svg, self._working, self._request.renderer))
            error = max(map(metrics.mean_squared_error, drawn, views(self._working)))
        return Attempt(scaled, svg, options, page, self._request.gzip, model, error)

    def _correct(self) -> None:
        """Change the count and refine until the last attempt needs no correction."""
        iterations = self._request.fit_options.iterations or self._request.preset.iterations
        steps = max(_LEAST_STEPS, round(_CORRECTION_SHARE * iterations))
        for _ in range(_CORRECTIONS):
            if self._ended or self._run.clock.out_of_time:
                break
            if not isinstance(self._rule, SceneDecides):
                break
            count = len(self._run.state)
            wanted = self._attempts.correction(self._rule, count, self._most)
            if wanted is None:
                break
            self._phase = "correct"
            self._run.resize(wanted, steps)
            self._attempts.made.append(self._attempt())

    def _measured(self, best: Attempt) -> RoundTrip:
        renderer = self._request.renderer
        return measured(best, self._photo, self._working, renderer, self._deadline)

    def _calibrate(self, best: Attempt, measured: RoundTrip) -> bool:
        """Whether the photo's own size tells another PSNR than the search went by."""
        target = self._targets.psnr
        smaller = self._photo.shape != self._working.shape
        if target is None or not smaller or measured.raster.shape != self._photo.shape:
            return False
        if math.isnan(best.error):  # trimmed to its bytes: nothing is left to search for
            return False
        if target - TOLERANCE <= measured.psnr_lowest <= target + TOO_GOOD:
            return False
        before = self._attempts.detail
        self._attempts.detail = 10 ** (-measured.psnr_lowest / 10) - best.error
        return self._attempts.detail != before

    def _stop_reason(self, best: Attempt, psnr: float) -> str:
        limit, target = self._targets.max_bytes, self._targets.psnr
        if target is not None and psnr >= target - TOLERANCE:
            return "target_psnr"
        if self._ended:
            return "interrupted"
        if self._run.clock.out_of_time:
            return "time_limit"
        if limit is not None and best.size > FULL * limit:
            return "max_bytes"
        reason = self._rule.stop_reason
        if reason != "target_psnr":
            return reason
        # The rule thought that it was there, and the corrections have run out.
        most, named = self._most
        return named if len(best.scene) > _AT_THE_CAP * most else "iterations"
