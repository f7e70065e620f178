"""The search by count. It fits a scene, writes its file, and corrects the number of Gaussians.

The number of Gaussians is called the count. During a fit, each of these limits allows a count,
which is estimated from the fit and its files so far:

    psnr   count at which the wanted PSNR is reached, if each doubling of the count gains `slope` dB
    gain   largest count at which one more kilobyte still gains as many dB as the preset demands
    cap    largest count of the preset, or the count that the user gave
    bytes  count that fits into the limit of bytes, if later shapes take as many bytes as those so
           far
    time   count that can be fitted and written in the time that is left

Growth aims at the smallest of these counts, and the report names the limit that allows it as the
reason why growth stopped. docs/decisions/fit.md has the measurements behind the constants.

After the fit the count is corrected by the score of the rasterised SVG, or for presets by the PSNR
of the model. For example, Kodak 20 is 768 px wide. If it is fitted at 384 px with a target of
28 dB, the files are:

    Gaussians    PSNR at 384 px    PSNR against the photo
    195          28.24             26.14: the photo has detail that the fit at 384 px lacks
    299          29.00             26.59
    607          31.03             27.63
    759          32.23             28.13: reached

Corrections aim at 28.12 dB, which is the target plus a margin. The missing dB, divided by the dB
that a doubling gains, are the number of doublings to the next count. The first correction takes
the gain of a doubling from growth, where it was 3.2 dB. Later corrections take it from the last two
exports, but assume at least 1.5 dB.
"""

import dataclasses
import math
from bisect import bisect
from collections.abc import Sequence
from operator import attrgetter

from gauss2svg import portable
from gauss2svg.fit import FitConfig, FitProgress, FitResult, schedule
from gauss2svg.fit.session import ADJUST_AT, DensificationPolicy, FitSession
from gauss2svg.fit.target import Target
from gauss2svg.measure import PSNR, Search
from gauss2svg.photo.pixels import has_alpha, over
from gauss2svg.pipeline.outcome import FULL, Export, Exporter, Outcome, Subject
from gauss2svg.pipeline.plan import GZIP, USUAL_BYTES, Aim, Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.scene import Scene
from gauss2svg.scene.areas import AreaCounts

FIRST_ROUND = 8  # number of Gaussians in the first round of growth
# A round of growth has too few steps to converge. At its end, its new Gaussians have gained only
# this share of the dB that they will have gained when the fit ends.
GAIN_OF_A_ROUND = 0.72
# The fit still converges after a round of growth and after an adjustment. So the PSNR will rise
# until the fit ends, even if no Gaussians are added. The expected rise in dB is a factor times
# (present PSNR - CONVERGES_ABOVE). After a round of growth, the factor is CONVERGES_AFTER_ROUND.
# After the adjustments at ADJUST_AT, the factors are CONVERGES_AFTER, in the same order.
CONVERGES_ABOVE = 16.5  # dB
CONVERGES_AFTER_ROUND = 0.28
CONVERGES_AFTER = 0.055, 0.034, 0.029

# A file that is too large is pruned until it fits, but only if it has at most this multiple of the
# allowed bytes. Otherwise the fit goes on with fewer Gaussians, and another file is written.
TOO_LARGE = 1.1
# A preset aims at its stop_psnr, with these tolerances. The PSNRs of two presets differ by more
# than too_little + too_good, so a preset never accepts a result that is worse than one that a
# cheaper preset accepts (docs/decisions/monotone.md).
ENOUGH = Search(
    tolerance=0.8, margin=0.0, too_little=0.8, too_good=3.0, slope=None, slopes=(1.5, 12.0)
)


CORRECTION_SHARE = 0.25  # number of steps of a correction, as a share of the steps of the fit


class ByCount(DensificationPolicy):
    """A search for the number of Gaussians with which a file meets the targets of the plan.

    It is the policy of its fit: in each round it doubles the count until a limit is met.

    If a doubling of the count gains s dB, and a Gaussian takes k kilobytes, then one more kilobyte
    gains s / (n k ln 2) dB if there are n Gaussians. A preset demands a gain, and growth aims at
    the count n at which the gain falls to it.

    expected  largest count that the fit may end with, as far as it is known before the fit
    """

    def __init__(self, plan: Plan, subject: Subject, run: Run) -> None:
        self._plan, self._subject, self._run = plan, subject, run
        self._exporter, self._budget = Exporter(plan, subject), run.budget
        self._phase = "fit"
        # The file of Subject.start, if there is a limit of bytes and the file is within all limits.
        self._first_file = list[Export]()
        goal, aim, pixels = plan.goal, plan.aim, math.prod(subject.size)
        self._bytes_each = plan.shape_bytes / (GZIP if plan.counts_gzipped else 1)
        self.expected, self._most = plan.caps(pixels)
        self._cap_reason = "cap" if goal.count is None else "gaussians"
        self._psnr_reason, self._psnr = "enough", plan.stop_psnr if goal.count is None else math.inf
        if aim is not None and plan.grows_to_aim:
            # Writing the file is expected to raise the squared error of the scene by 6 %.
            writing = 10 * portable.log10(1.06)
            self._psnr_reason, self._psnr = aim.of.option, aim.value + aim.search.margin + writing
        self._first = FIRST_ROUND
        is_limited = plan.is_budget or goal.byte_limit < math.inf or goal.count is not None
        # Whether the goal is the best picture within a limit or with a given count.
        self._wants_best = aim is None and is_limited
        # Gaussians are added only as long as each one gains at least this many dB. It is 0 with a
        # target, a given count, a limit of bytes or a budget, because one of these alone then
        # decides the count.
        usual = plan.preset.gain * min(plan.shape_bytes, USUAL_BYTES) / 1000
        self.least_gain = self._gain = 0.0 if aim or is_limited else usual
        self._least_saved = plan.rate * plan.shape_bytes / (3 * pixels)
        if plan.only_time_limits:
            self.expected = int(min(self.expected, run.budget.most_gaussians(0.0)))
            self._first = max(FIRST_ROUND, self.expected >> (schedule.ROUNDS - 1))
        # Growth has a first round, one round for each doubling, and one to spare.
        self.rounds = max(1, math.ceil(portable.log2(max(self.expected, 1) / self._first)) + 2)
        self.stop_reason, self._slope = "cap", 3.0  # dB that a doubling of the count gains
        self._last: tuple[int, float] | None = None  # count and PSNR after the last round
        # Largest count at which one more kilobyte still gains as many dB as the preset demands.
        self._paying_count = math.inf
        self._converges_above = CONVERGES_ABOVE
        self._aim = aim or Aim(PSNR, plan.stop_psnr, ENOUGH)  # score that corrections aim at

    def run(self) -> Outcome:
        """Fit and write a scene, correct the count as long as this helps, and return the best."""
        plan, run, start, config = self._plan, self._run, self._subject.start, self._plan.fit_config
        exports = list[Export]()
        run.stop()
        additive = self._additive() if plan.options.svg.portable else None
        run.budget.begin_fit(self.expected)
        if plan.only_time_limits:
            # The fit begins with few Gaussians on reduced pictures, because its steps are faster.
            config = dataclasses.replace(config, gaussians=self.expected)
        session = self._session(self._exporter.target, config)
        if additive is not None:
            session.adopt(additive.scene, plan.fit_config.gaussians)
        if start and not session.population.target.is_blank:
            self._refine(session, start)
        else:
            session.fit()
        self._phase = "correct"
        while True:
            run.notify("write")
            if plan.aim is not None:
                run.notify("measure")
            exports.append(self._exporter.export(session.scene()))
            count = session.count
            # Above areas, which draw most of the picture, fewer corrections suffice.
            most = 2 if plan.rate and plan.aim is None and count >= 40 else 5
            ends = run.ended or session.clock.out_of_time
            if ends or not plan.goal.count_adapts or len(exports) > most:
                break
            if (wanted := self._corrected(count, exports)) == count:
                break
            session.resize(wanted, self._steps(CORRECTION_SHARE))
        candidates, limit = [*self._first_file, *exports], plan.goal.byte_limit
        best = self.best(candidates)
        if best.size > limit:
            within = [export for export in candidates if export.size <= limit]
            best = max([self._exporter.pruned(best, limit), *within], key=attrgetter("score"))
        fitted = session.result()
        reason = "start" if best in self._first_file else fitted.stop_reason
        fitted = fitted.after(reason, *([] if additive is None else [additive]))
        return self._exporter.outcome(best, fitted, len(exports) - 1)

    def _additive(self) -> FitResult:
        """Run the additive fit of a portable file, whose Gaussians the fit of the file adopts."""
        plan, working, config = self._plan, self._subject.working, self._plan.fit_config
        self._run.budget.begin_fit(self.expected, share=0.35)
        self._phase, target = "additive", self._exporter.target
        if has_alpha(working):
            target = Target(over(working), plan.tune)
        fit = dataclasses.replace(config.fit, blend="add", falloff=None)
        session = self._session(target, dataclasses.replace(config, fit=fit))
        session.fit()
        self._phase = "fit"
        return session.result()

    def _refine(self, session: FitSession, start: Scene) -> None:
        """Refine the shapes of the scene `start` in place of a fit with growth.

        Shapes are first added or removed until there are as many as the user asks for. If the user
        gives no number, the number of shapes stays the same, unless it is above the cap. The more
        the number changes, the more steps follow: all steps of the fit if the number doubles or
        halves, and a share CORRECTION_SHARE of them if it stays the same.
        """
        plan, count = self._plan, self._plan.fit_config.gaussians
        # Growth has time for `expected` shapes. The shapes of `start` exist already, so the time
        # suffices for all of them.
        if plan.only_time_limits and plan.goal.count is None:
            self.expected = len(start)
        if plan.goal.count_adapts:
            count, self.stop_reason = min(len(start), self.expected), "start"
        doublings = abs(portable.log2(max(count, 1) / len(start)))
        session.begin_with(start)
        if (limit := plan.goal.byte_limit) < math.inf:
            first = self._exporter.export(session.scene())
            if first.size <= limit and session.count == count:
                self._first_file = [first]
        # The bytes of shapes that are not yet quantised would mislead the search for the count.
        keeps = limit == math.inf or bool(self._first_file)
        session.refine(count, self._steps(min(max(doublings, CORRECTION_SHARE), 1.0)), keeps)

    def _steps(self, share: float) -> int:
        return max(40, round(share * self._plan.fit_config.iterations))

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
        policy, ends = self if self._plan.goal.count_adapts else None, run.budget.fit_ends
        session = FitSession(target, config, policy, ends, progress, as_written, lambda: run.ended)
        return session

    def grow(self, fit: FitSession) -> int:
        """Return the count for the next round of growth, or the present count if growth ends.

        The next count is twice the present one, or less if a limit does not allow so many
        Gaussians.
        """
        in_time, psnr = math.inf, fit.population.psnr()
        if self._plan.only_time_limits:
            in_time = self._budget.most_gaussians(fit.done)
        elif fit.clock.share_of_time() >= schedule.GROWTH_SHARE:
            in_time = max(fit.count, 1)
        counts = self._counts(fit, in_time, psnr)
        # Beyond the PSNR of the preset, a byte of a shape above areas must save as much squared
        # error as one of an area.
        if self.least_gain and self._least_saved and psnr > self._plan.preset.stop_psnr:
            saved = self._least_saved * portable.power(10, psnr / 10)
            self._gain = 10 * portable.log10(1 + saved)
        last, self._last = self._last, (fit.count, psnr)
        if last is None:
            # Only shapes converge. Areas are drawn from the first step on.
            self._converges_above = max(CONVERGES_ABOVE, psnr)
        else:
            self._learn(last, self._last)
            psnr += CONVERGES_AFTER_ROUND * max(psnr - self._converges_above, 0.0)
        wanted = self._wanted(fit.count, psnr, counts)
        if wanted >= 1.1 * fit.count and wanted:
            return min(math.ceil(wanted), max(2 * fit.count, self._first))
        return fit.count

    def adjust(self, fit: FitSession) -> int:
        """Return the count with which the fit goes on.

        This method estimates which count the limits will allow at the end of the fit, and moves the
        present count towards this estimate, by at most three tenths. The count is reduced by more
        only if it would otherwise exceed the cap or the limit of bytes.
        """
        least, most = 0.7 * fit.count, 1.3 * fit.count
        # Gaussians are removed for lack of time only if there are more than twice too many.
        in_time = max(2 * self._budget.most_gaussians(fit.done), least)
        if self._plan.only_time_limits:
            in_time = min(in_time, fit.count)
        rate = CONVERGES_AFTER[max(bisect(ADJUST_AT, fit.done) - 1, 0)]
        psnr = fit.population.psnr()
        psnr += rate * max(psnr - self._converges_above, 0.0)
        # The palette is chosen before it costs this loss, so at a PSNR that is higher by it.
        counts = self._counts(fit, in_time, psnr + self._plan.preset.color_loss)
        wanted = self._wanted(fit.count, psnr, counts)
        if abs(wanted - fit.count) <= 0.02 * fit.count:
            return fit.count
        return int(min(math.ceil(min(max(wanted, least), most)), *counts.values()))

    def max_count(self, fit: FitSession, is_quantized: bool) -> int:
        """Return the largest count that the cap, the time limit and the limit of bytes allow.

        Quantised Gaussians are not removed for lack of time, because this would save hardly any.
        """
        if is_quantized:
            return int(min(self._counts(fit, math.inf, None).values()))
        # If the time limit alone decides the steps, growth has already chosen a count for which the
        # time suffices for all steps, so that only the export still needs time. Otherwise growth
        # has chosen the count without regard to the time. The remaining steps and the search for
        # the file's colours then need time too.
        done, colors = (1.0, False) if self._plan.only_time_limits else (fit.done, True)
        in_time = self._budget.most_gaussians(done, colors)
        return int(min(self._counts(fit, in_time, fit.population.psnr()).values()))

    def _counts(self, fit: FitSession, in_time: float, psnr: float | None) -> dict[str, float]:
        """Return a dict of the counts that the cap, the time limit and the limit of bytes allow.

        Its keys are the names that these limits have as stop reasons in the report. If bytes are
        limited, this function also measures how many bytes a shape takes, from 200 shapes on.

        in_time  count that the time allows
        psnr     PSNR in dB that the fit will have when its palette is chosen, None if it has been
                 chosen. The higher it is, the more entries the palette has
        """
        counts, limit = {self._cap_reason: float(self.expected)}, self._plan.goal.byte_limit
        if self._phase == "additive":  # the bytes of its shapes in the file are unknown
            return counts
        counts["time_limit"] = in_time
        if limit < math.inf:
            refines = fit.done > schedule.GROWTH_SHARE
            # The fit has more shapes than the file may have, and the least useful ones are pruned
            # later. The bytes of a quantised scene hardly change in the last steps. With a target,
            # pruning after the fit would lower the score.
            is_last = psnr is None or self._plan.aim is not None
            share = 1.0 if is_last else 1.04 if refines else 1.25
            if refines or fit.count >= 200:
                scene = self._exporter.quantized(fit.scene(), psnr)
                self._bytes_each = self._exporter.bytes_each(scene, share * limit)
            counts["max_bytes"] = self._in_bytes(share * limit)
        return counts

    def _in_bytes(self, size: float) -> int:
        """Return the number of Gaussians that fill a file of `size` bytes."""
        return int(max(size - self._exporter.empty_bytes, 0) / self._bytes_each)

    def _learn(self, before: tuple[int, float], after: tuple[int, float]) -> None:
        """Compute `_slope` and `_paying_count` from the gain in PSNR of the last round.

        before, after  count and PSNR (dB) before and after that round
        """
        (last, last_psnr), (count, psnr) = before, after
        # New shapes may disturb the first few more than they gain in a round.
        if psnr < last_psnr and count <= 4 * FIRST_ROUND:
            return
        gain = max(psnr - last_psnr, 0.0) / GAIN_OF_A_ROUND
        doublings = portable.log2(count / last) if last else 1.0
        # In a smaller round, most of the gain comes from convergence and not from new Gaussians.
        if doublings > 0.6:
            self._slope = min(max(gain / doublings, 0.5), 8.0)
        if self._gain:
            # At this count, one more kilobyte gains exactly as many dB as the preset demands.
            self._paying_count = gain / doublings / (self._gain * portable.log(2))

    def _wanted(self, count: int, psnr: float, counts: dict[str, float]) -> float:
        """Return the count from which on no more Gaussians should be added.

        It is the smallest of those of the limits, of a PSNR that is high enough, and of a gain that
        is too small. The smallest one gives the `stop_reason`.

        count   present count, with which `psnr` dB are expected
        counts  counts that the limits allow
        """
        needed = 0.0 if psnr >= self._psnr else math.inf
        if count:
            needed = count * portable.power(2, min((self._psnr - psnr) / self._slope, 60.0))
        return self._least({self._psnr_reason: needed, **counts, "gain": self._paying_count})

    def _least(self, counts: dict[str, float]) -> float:
        """Return the smallest of several counts. Its reason is now the `stop_reason`."""
        self.stop_reason = min(counts, key=counts.__getitem__)
        return counts[self.stop_reason]

    def _corrected(self, count: int, exports: Sequence[Export]) -> int:
        """Return the count for the next file, which is the present one if it need not change.

        Set `stop_reason` to the limit that decides the count.
        """
        last, plan, limit = exports[-1], self._plan, self._plan.goal.byte_limit
        # The count is not reduced for lack of time here, because that would take still more time.
        in_time = max(self._budget.most_gaussians(1.0), count)
        counts = {self._cap_reason: float(self._most), "time_limit": in_time}
        if limit < math.inf:
            if count:
                self._bytes_each = self._exporter.bytes_each(last.scene, limit)
            counts["max_bytes"] = self._in_bytes(limit)
            if count and last.size > (TOO_LARGE if plan.aim else FULL) * limit:
                self.stop_reason = "max_bytes"
                # A file that is little too large will be pruned.
                is_pruned = last.size <= TOO_LARGE * limit
                return count if is_pruned else int(min(counts["max_bytes"], count - 1))
        if not count:
            is_met = plan.aim is None or plan.aim.is_met_by(last.score)
            return 0 if is_met else int(min(FIRST_ROUND, *counts.values()))
        needed = self._needed(count, exports)
        if needed == count:
            if last.size > limit:
                self.stop_reason = "max_bytes"
            return count
        counts = {"enough" if plan.aim is None else "iterations": needed, **counts}
        wanted = int(self._least(counts))
        if abs(wanted - count) <= 0.004 * count:
            return count
        if self._budget.must_export:
            self.stop_reason = "time_limit"
            return count
        return wanted

    def _needed(self, count: int, exports: Sequence[Export]) -> int:
        """Return the count at which the wanted score is expected, without regard to limits."""
        search, is_aim = self._aim.search, self._plan.aim is not None
        excess = exports[-1].score - self._aim.value
        if self._wants_best:
            # The count is raised only to fill a limit of bytes, and only as long as the PSNR is so
            # low that more Gaussians improve the picture visibly.
            fills = self._plan.goal.byte_limit < math.inf and excess < 0
            return 4 * count if fills else count
        ended_before = excess < 0 and not is_aim and self.stop_reason != "enough"
        if ended_before or -search.too_little <= excess <= search.too_good:
            return count
        # Several small changes of the count give a better result than a single large one
        # (docs/decisions/monotone.md).
        doublings = (search.margin - excess) / self._slope_of(exports)
        return round(count * portable.power(2, min(max(doublings, -2.0 if is_aim else -0.5), 2.0)))

    def _slope_of(self, exports: Sequence[Export]) -> float:
        """Return the gain of the score per doubling of the count.

        This gain is computed from the last two exports if their counts differ enough, and if the
        export with more Gaussians has the higher score. Otherwise it is the usual slope of the
        score. PSNR has no usual slope, so the slope that was measured during growth is taken.
        """
        search = self._aim.search
        slope, (least, most) = self._slope if search.slope is None else search.slope, search.slopes
        if len(exports) >= 2:
            before, last = exports[-2:]
            doublings = portable.log2(len(last.scene) / max(len(before.scene), 1))
            rise = last.score - before.score
            # If the counts differ by less, the difference of the scores is largely chance.
            if abs(doublings) > 0.25 and rise / doublings > 0:
                slope = rise / doublings
        return min(max(slope, least), most)

    def best(self, exports: Sequence[Export]) -> Export:
        """Return the export to write.

        With a target or a preset, it is the smallest file whose score is within the tolerances. If
        no score is within them, it is the smallest file whose score is above them. If no score is
        above them either, it is the file with the highest score.
        With a limit or a given count, it is the file with the highest score that is within the
        limit or so little beyond it that it will be pruned. If all files are too large, it is the
        smallest one.
        """
        limit = self._plan.goal.byte_limit
        largest = limit if self._plan.aim is not None else TOO_LARGE * limit
        small = [e for e in exports if e.size <= largest]
        if not small:
            return min(exports, key=attrgetter("size"))
        met = [e for e in small if self._aim.is_met_by(e.score)]
        close = [e for e in met if e.score <= self._aim.value + self._aim.search.too_good]
        if self._wants_best or not met:
            return max(small, key=attrgetter("score"))
        return min(close or met, key=attrgetter("size"))
