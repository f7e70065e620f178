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
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg import metrics
from gauss2svg.fit.options import FitProgress, FitResult
from gauss2svg.fit.rules import Demand, FixedCount, Rule, SceneDecides, Snapshot
from gauss2svg.fit.run import Run
from gauss2svg.fit.schedule import GROWTH_SHARE
from gauss2svg.raster import rasterize
from gauss2svg.render import render
from gauss2svg.render.cpu import kernel_lock, removal_cost, splats_of
from gauss2svg.request import Request
from gauss2svg.roundtrip import RoundTrip, measure_pixels, round_trip
from gauss2svg.scene import Scene
from gauss2svg.svg import SvgOptions, write_svg
from gauss2svg.targets import TOLERANCE

# Of a file, a Gaussian: mean over the development photos from 1000 to 8000 Gaussians,
# palette included. Replaced by the file's own where bytes are limited.
KILOBYTES_A_GAUSSIAN = 0.12
# A target of PSNR lifts the quality's cap to this.
CAP_FOR_PSNR = 50000
_AIM = 0.12  # dB over the target that a correction aims at
_TOO_LITTLE = 0.02  # dB under the target from which some are added
_TOO_GOOD = 0.35  # dB over the target from which Gaussians are taken away again
_FILL = 0.975  # share of the bytes allowed that a fit aims at
_FULL = 0.93  # share from which a file counts as full
_LEAST_MEASURED = 200  # Gaussians from which a file tells the bytes of one
_CORRECTIONS = 5
_LESS_SPARE = 0.8  # of the colours that would fill the bytes, where they were too many
_CALIBRATIONS = 2  # of a search that ran on a smaller picture
_CORRECTION_SHARE = 0.25  # of the iterations of a fit, but not under
_LEAST_STEPS = 40
_WRITING_LOSS = 0.06  # of the model's error that the file is expected to add at first
# Every Gaussian in so many is written and drawn to see how long all will take.
_SAMPLE = 8
_SLACK_S = 0.1  # for what is not measured: the report, saving, the end of the process
_RESERVE_SHARE = 0.3  # of the time left, for what follows the fit, until it is measured
_REHEARSE_AT = 0.4  # share of the fit done
_MOST_RESERVED = 0.6  # share of the time left then for what follows; with more, Gaussians go
_STRIPS = 4  # the picture is measured on one of so many strips to see how long all will take
_SAME = 0.004  # a count that differs by a smaller share is the same
_TELLING = 0.25  # doublings between two attempts that tell a slope
_SLOPES = 1.5, 6.0  # dB a doubling, the flattest and steepest that are believed


@dataclass(frozen=True, eq=False)
class Outcome:
    """A fitted, written and measured scene, on the photo's canvas.

    corrections  how often the count was changed after the fit
    """

    scene: Scene
    svg: str
    svg_options: SvgOptions
    fitted: FitResult
    measured: RoundTrip
    corrections: int


@dataclass(frozen=True, eq=False)
class _Attempt:
    """A scene as written; error is the drawn SVG's on the working picture, if it was drawn."""

    scene: Scene
    svg: str
    options: SvgOptions
    error: float

    @property
    def size(self) -> int:
        return len(self.svg.encode())


class Pursuit:
    """One run towards the targets of a request.

    photo     (h, w, 3) float32 in 0..1, what is measured against
    working   the same, perhaps smaller: what the fit runs on
    deadline  as time.perf_counter() counts, in s, or None
    tell      is called with "fit", "correct", "write" or "measure", and a fit's progress
    """

    def __init__(
        self,
        photo: NDArray[np.float32],
        working: NDArray[np.float32],
        request: Request,
        deadline: float | None,
        tell: Callable[[str, FitProgress | None], None],
    ) -> None:
        self._photo = photo
        self._working = working
        self._request = request
        self._targets = request.targets
        self._deadline = deadline
        self._tell = tell
        self._phase = "fit"
        self._detail = 0.0  # squared error of the photo that the working picture has not
        self._bytes_each = KILOBYTES_A_GAUSSIAN * 1000
        self._bytes_known = False
        self._rehearsed = deadline is None
        self._attempts: list[_Attempt] = []
        fit_deadline = None
        if deadline is not None:
            now = time.perf_counter()
            fit_deadline = deadline - _RESERVE_SHARE * max(deadline - now, 0.0)
        self._most = 0, "gaussians"
        self._rule = self._rule_asked_for()
        self._run = Run(working, request.fit_options, self._rule, fit_deadline, self._on_step)

    def run(self) -> Outcome:
        """Fit, then correct until the targets are met or out of reach."""
        with kernel_lock:
            self._run.fit()
            self._attempts.append(self._attempt())
            best, measured = self._search()
            for _ in range(_CALIBRATIONS):
                if not self._calibrate(best, measured):
                    break
                best, measured = self._search()
        fitted = dataclasses.replace(self._run.result(), stop_reason=self._stop_reason(best))
        return Outcome(
            scene=best.scene,
            svg=best.svg,
            svg_options=best.options,
            fitted=fitted,
            measured=measured,
            corrections=len(self._attempts) - 1,
        )

    def _search(self) -> tuple[_Attempt, RoundTrip]:
        self._correct()
        best = self._filled(self._trimmed(self._best()))
        self._tell("measure", None)
        return best, self._measure(best)

    def _rule_asked_for(self) -> Rule:
        request, options = self._request, self._request.fit_options
        if request.count is not None and not request.scene_decides:
            return FixedCount(request.schedule, request.count, options.iterations)
        preset, height, width = request.preset, *self._working.shape[:2]
        # Nine numbers a Gaussian, three a pixel: more would be no model of the picture.
        cap = min(preset.cap, max(1, width * height // 3))
        demand = Demand(preset.gain, KILOBYTES_A_GAUSSIAN, preset.enough, cap)
        if request.count is not None:
            demand = Demand(
                0.0, KILOBYTES_A_GAUSSIAN, math.inf, request.count, cap_named="gaussians"
            )
        if self._targets.psnr is not None:
            wanted = self._targets.psnr + _AIM + 10 * math.log10(1 + _WRITING_LOSS)
            cap = demand.cap
            if request.count is None:
                cap = max(cap, min(CAP_FOR_PSNR, width * height))
            demand = dataclasses.replace(
                demand, gain=0.0, psnr=wanted, psnr_named="target_psnr", cap=cap
            )
        self._most = demand.cap, demand.cap_named
        return SceneDecides(demand, self._revise)

    def _revise(self, demand: Demand, now: Snapshot) -> Demand:
        """The demand with as many Gaussians as the bytes and the time allow."""
        most, named = self._most
        limit = self._targets.max_bytes
        if limit is not None:
            refining = now.done > GROWTH_SHARE
            if now.count >= _LEAST_MEASURED and (refining or not self._bytes_known):
                self._bytes_known = True
                self._bytes_each = self._write(now.scene(), now.psnr)[0] / now.count
            if limit * _FILL / self._bytes_each < most:
                most, named = int(limit * _FILL / self._bytes_each), "max_bytes"
        if self._run.clock.growth_is_late and now.done <= GROWTH_SHARE and now.count < most:
            most, named = max(now.count, 1), "time_limit"
        return dataclasses.replace(demand, cap=most, cap_named=named)

    def _on_step(self, progress: FitProgress) -> None:
        self._tell(self._phase, progress)
        if not self._rehearsed and progress.done > _REHEARSE_AT and self._deadline is not None:
            self._rehearsed = True
            reserve = self._seconds_after(self._run.scene(), progress.psnr)
            self._run.clock.deadline = self._deadline - reserve
            most = _MOST_RESERVED * self._time_left() / reserve
            if most < 1:
                self._most = max(1, int(progress.gaussians * most)), "time_limit"

    def _seconds_after(self, scene: Scene, psnr: float) -> float:
        """How long writing, drawing and measuring will take, from a part of the Gaussians."""
        height, width = self._working.shape[:2]
        begun = time.perf_counter()
        part = scene.select(np.arange(0, len(scene), _SAMPLE))
        svg = self._write(part, psnr)[1]
        written = time.perf_counter()
        rasterize(svg, width, height, self._request.renderer)
        drawn = time.perf_counter()
        rasterize(write_svg(scene.select(np.arange(0))), width, height, self._request.renderer)
        blank = time.perf_counter()
        strip = self._working[: max(height // _STRIPS, 1)]
        measure_pixels(strip, strip)
        measured = time.perf_counter()
        draw_all = (blank - drawn) + _SAMPLE * max((drawn - written) - (blank - drawn), 0.0)
        write_all = _SAMPLE * (written - begun)
        return write_all + draw_all + _STRIPS * (measured - blank) + _SLACK_S

    def _time_left(self) -> float:
        return math.inf if self._deadline is None else self._deadline - time.perf_counter()

    def _on_photo(self, scene: Scene) -> Scene:
        height, width = self._photo.shape[:2]
        scaled = scene.scaled(width / self._working.shape[1], height / self._working.shape[0])
        return scaled.replace(width=width, height=height)

    def _write(self, scene: Scene, psnr: float) -> tuple[int, str, SvgOptions, Scene]:
        """Bytes, text and options of the file of a scene on the working canvas."""
        options = self._request.svg_options(len(scene), 10 ** (-psnr / 10))
        scene = self._on_photo(scene)
        svg = write_svg(scene, options)
        return len(svg.encode()), svg, options, scene

    def _attempt(self) -> _Attempt:
        self._tell("write", None)
        height, width = self._working.shape[:2]
        scene = self._run.scene()
        _, svg, options, scaled = self._write(scene, metrics.psnr(render(scene), self._working))
        error = math.nan
        if self._targets.psnr is not None:
            self._tell("measure", None)
            drawn = rasterize(svg, width, height, self._request.renderer)
            error = metrics.mean_squared_error(drawn, self._working)
        return _Attempt(scaled, svg, options, error)

    def _psnr(self, attempt: _Attempt) -> float:
        error = attempt.error + self._detail
        return -10 * math.log10(error) if error > 0 else math.inf

    def _correct(self) -> None:
        """Change the count and refine until the last attempt needs no correction."""
        iterations = self._request.fit_options.iterations or self._request.preset.iterations
        steps = max(_LEAST_STEPS, round(_CORRECTION_SHARE * iterations))
        for _ in range(_CORRECTIONS):
            wanted = self._correction()
            if wanted is None or self._run.clock.out_of_time:
                break
            self._phase = "correct"
            self._run.resize(wanted, steps)
            self._attempts.append(self._attempt())

    def _correction(self) -> int | None:
        """Count that the next attempt should have, None where nothing is left to correct."""
        last, count = self._attempts[-1], len(self._run.state)
        limit, target = self._targets.max_bytes, self._targets.psnr
        if not isinstance(self._rule, SceneDecides) or not count:
            return None
        most = self._most[0]
        if limit is not None:
            most = min(most, int(limit * _FILL * count / last.size))
            if last.size > limit:
                return min(most, count - 1)
        wanted = count
        if target is not None:
            psnr = self._psnr(last)
            if not target - _TOO_LITTLE <= psnr <= target + _TOO_GOOD:
                missing = (target + _AIM - psnr) / self._slope()
                wanted = min(round(count * 2 ** max(min(missing, 2.0), -2.0)), most)
        elif limit is not None and self._rule.stop_reason == "max_bytes":
            wanted = most if last.size < _FULL * limit else count
        return wanted if abs(wanted - count) > _SAME * count else None

    def _slope(self) -> float:
        """PSNR that a doubling buys: from the last two attempts, or from the growth."""
        if len(self._attempts) >= 2:
            before, last = self._attempts[-2:]
            doublings = math.log2(len(last.scene) / max(len(before.scene), 1))
            if abs(doublings) > _TELLING:
                slope = (self._psnr(last) - self._psnr(before)) / doublings
                return min(max(slope, _SLOPES[0]), _SLOPES[1])
        assert isinstance(self._rule, SceneDecides)
        return min(max(self._rule.slope, _SLOPES[0]), _SLOPES[1])

    def _best(self) -> _Attempt:
        """The fewest Gaussians that meet every target, or what comes nearest."""
        limit = self._targets.max_bytes or math.inf
        small = [a for a in self._attempts if a.size <= limit]
        if not small:
            return min(self._attempts, key=lambda a: a.size)
        target = self._targets.psnr
        if target is None:
            return small[-1]
        good = [a for a in small if self._psnr(a) >= target - TOLERANCE]
        if good:
            return min(good, key=lambda a: len(a.scene))
        return max(small, key=self._psnr)

    def _trimmed(self, attempt: _Attempt) -> _Attempt:
        """Without the least missed Gaussians, as many of them as the bytes ask for."""
        limit = self._targets.max_bytes
        while limit is not None and attempt.size > limit and len(attempt.scene):
            scene = attempt.scene
            height, width = self._working.shape[:2]
            planar = np.ascontiguousarray(np.moveaxis(self._working, -1, 0))
            splats = splats_of(scene.scaled(width / scene.width, height / scene.height))
            cost = removal_cost(splats, planar)[1][:, 0]
            kept = min(len(scene) - 1, int(len(scene) * limit / attempt.size))
            scene = scene.select(np.sort(np.argsort(-cost, kind="stable")[:kept]))
            attempt = dataclasses.replace(
                attempt, scene=scene, svg=write_svg(scene, attempt.options), error=math.nan
            )
        return attempt

    def _filled(self, attempt: _Attempt) -> _Attempt:
        """With more colours, where bytes are the bound and some are left."""
        limit, options = self._targets.max_bytes, attempt.options
        used = attempt.svg.count("<radialGradient")
        if limit is None or not used or self._request.palette is not None:
            return attempt
        if self._rule.stop_reason != "max_bytes" or attempt.size > _FULL * limit:
            return attempt
        gradients = attempt.svg.index("<radialGradient"), attempt.svg.rindex("</radialGradient>")
        each = (gradients[1] - gradients[0]) / used
        spare = (limit - attempt.size) / each
        while spare >= 1:
            richer = dataclasses.replace(options, palette=used + int(spare), color_error=0.0)
            svg = write_svg(attempt.scene, richer)
            if len(svg.encode()) <= limit:
                return dataclasses.replace(attempt, svg=svg, options=richer)
            spare *= _LESS_SPARE
        return attempt

    def _measure(self, best: _Attempt) -> RoundTrip:
        """At the photo's size; where time is short, at the size that the fit ran on."""
        renderer = self._request.renderer
        smaller = self._photo.shape != self._working.shape
        if smaller and self._deadline is not None:
            begun = time.perf_counter()
            height, width = self._working.shape[:2]
            scene = best.scene.scaled(width / best.scene.width, height / best.scene.height)
            measured = round_trip(best.svg, scene, self._working, renderer)
            needed = (time.perf_counter() - begun) * self._photo.size / self._working.size
            if needed > self._time_left():
                return measured
        return round_trip(best.svg, best.scene, self._photo, renderer)

    def _calibrate(self, best: _Attempt, measured: RoundTrip) -> bool:
        """Whether the photo's own size tells another PSNR than the search went by."""
        target = self._targets.psnr
        smaller = self._photo.shape != self._working.shape
        if target is None or not smaller or measured.raster.shape != self._photo.shape:
            return False
        if math.isnan(best.error):  # trimmed to its bytes: nothing is left to search for
            return False
        if target - TOLERANCE <= measured.psnr_svg <= target + _TOO_GOOD:
            return False
        before, self._detail = self._detail, 10 ** (-measured.psnr_svg / 10) - best.error
        return self._detail != before

    def _stop_reason(self, best: _Attempt) -> str:
        limit, target = self._targets.max_bytes, self._targets.psnr
        if target is not None and self._psnr(best) >= target - TOLERANCE:
            return "target_psnr"
        if self._run.clock.out_of_time:
            return "time_limit"
        if limit is not None and best.size > _FULL * limit:
            return "max_bytes"
        reason = self._rule.stop_reason
        return self._most[1] if reason == "target_psnr" else reason
