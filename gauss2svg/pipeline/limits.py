"""The counts that the limits of a goal allow, estimated from the fit and its files so far.

    psnr   count that reaches the PSNR, if each doubling gains `slope` dB
    gain   largest count at which one more kilobyte still gains what the preset asks for
    cap    count that the preset allows, or the count that the user gave
    bytes  count that fits into the bytes, by the bytes of the shapes so far
    time   count that can be fitted and written in the time that is left

The smallest of these is the next count, and its limit is the reason why growth stops.
docs/decisions/fit.md has the figures of the constants.

The count is corrected by the score of the rasterised SVG, or for presets by the PSNR of the
model. Kodak 20 is 768 px wide. Fitted at 384 px with a target of 28 dB, it has:

    Gaussians    PSNR at 384 px    PSNR against the photo
    195          28.24             26.14: the photo has detail that the fit at 384 px lacks
    299          29.00             26.59
    607          31.03             27.63
    759          32.23             28.13: reached

Corrections aim at 28.12 dB. The number of doublings to the next count is the missing dB divided by
the dB gained per doubling. At first a doubling counts as 3.2 dB, as in growth, and later as much as
between the last two exports, but at least 1.5 dB.
"""

from __future__ import annotations

import math
from bisect import bisect
from collections.abc import Sequence
from operator import attrgetter

from gauss2svg.fit import schedule
from gauss2svg.fit.session import ADJUST_AT, DensificationPolicy, Snapshot
from gauss2svg.measure import PSNR, Search
from gauss2svg.pipeline.budgets import TimeBudget
from gauss2svg.pipeline.export import Export, Exporter
from gauss2svg.pipeline.plan import (
    BYTES_IN_INKS,
    CAP_FOR_TARGET,
    GZIPPED_SHARE,
    USUAL_BYTES,
    Aim,
    Plan,
)

FIRST_ROUND = 8  # number of Gaussians in the first round
# Share of a doubling's final gain that is reached when its round of growth ends. The round has too
# few steps to converge.
GAIN_OF_A_ROUND = 0.72
CONVERGES_ABOVE = 16.5  # dB, PSNR above which convergence still adds some PSNR
# Share of the dB above CONVERGES_ABOVE that convergence adds after a round of growth.
CONVERGES_AFTER_ROUND = 0.28
CONVERGES_AFTER = 0.055, 0.034, 0.029  # shares of these dB, added after each of ADJUST_AT
MOST_CHANGE = 0.3  # largest change of the count at one adjustment, as a share of the count
# Refinement removes Gaussians if the count is above this multiple of the largest count for which
# there is time.
TOO_MANY = 2.0
LEAST_CHANGE = 0.02  # smallest adjustment that is made, as a share of the count
LEAST_ROUND = 1.1  # smallest ratio of the wanted to the present count at which a round begins
WHOLE_ROUND = 0.6  # number of doublings in a round above which the slope is computed from the round
LEAP = 4  # least ratio of the next to the present count in a leap
FLATTEST, STEEPEST = 0.5, 8.0  # dB per doubling, bounds of plausible slopes of growth

# Gaussians that fit into a limit of bytes (docs/decisions/markup.md).
MEASURED_FROM = 200  # number of Gaussians from which the bytes of a growing fit are measured
# Multiple of the allowed bytes that growth aims at. The least useful Gaussians are pruned later.
OVERFILL_GROWING = 1.25
OVERFILL_REFINING = 1.03  # multiple of the bytes that refinement aims at until its last steps
# Excess over the allowed bytes that the last steps aim at: this share of the bytes, divided by the
# root of the count. Pruning a few shapes then fills the file.
SPARE = 0.4
BYTES_SAVED = 0.15  # share of a shape's bytes that refinement saves, per unit of progress left
# Least number of pixels per Gaussian, without a budget of bytes or seconds and with one. Three
# pixels have nine values, as many as a Gaussian has numbers.
LEAST_PIXELS_EACH = 3
LEAST_PIXELS_EACH_OF_BUDGET = 2
WRITING_LOSS = 0.06  # share of the scene's error that writing is expected to add

# Corrections of a count (docs/decisions/monotone.md and numbers.md).
FULL = 0.985  # smallest share of the allowed bytes at which a file is full
TOO_LARGE = 1.1  # multiple of the allowed bytes up to which a file is pruned, not fitted again
PRUNED = 8.0  # dB that an export loses by pruning, for each halving of its bytes
# Tolerances of a preset's PSNR. The PSNRs of two presets differ by more than too_little + too_good,
# so that no preset ends below a cheaper preset.
ENOUGH = Search(
    tolerance=0.8, margin=0.0, too_little=0.8, too_good=3.0, slope=None, slopes=(1.5, 12.0)
)
# Least count to which a preset reduces a fit. 16 shapes take a kilobyte or two, each visible.
LEAST_REDUCED = 16
SAME_COUNT = 0.004  # largest relative difference of two counts that are the same
TELLING = 0.25  # number of doublings between two exports above which the slope follows from them
# Largest change of a count in doublings, and largest reduction for a preset. One large change ends
# worse than several small changes.
MOST_CORRECTED, MOST_REDUCED = 2.0, 0.5
# Largest ratio of the last to the first count for a drawing with edges that plain ellipses draw
# (docs/decisions/enlarged.md).
FOR_EDGES = 1.4


class Limits(DensificationPolicy):
    """A policy that doubles the count in each round until a limit is met, and then corrects it.

    If a doubling gains s dB and a Gaussian has k kilobytes, a kilobyte gains s / (n k ln 2) dB at n
    Gaussians. Growth aims at the n where this falls to the preset's gain. If this n is small,
    growth leaps once to a fourth of the smallest limit, because the first squares of a checkerboard
    gain next to nothing, and the last everything. If the leap pays, growth goes on to the count at
    which the squared error would vanish if it fell at the leap's rate. If the leap does not pay,
    growth goes back to the count before it.

    expected     largest count that the fit may end with, as known before the fit
    slope        dB gained by a doubling of the count
    is_additive  whether the additive fit before a portable file runs. Bytes are then unknown
    """

    def __init__(self, plan: Plan, exporter: Exporter, budget: TimeBudget, pixels: int) -> None:
        self._plan, self._exporter, self._budget = plan, exporter, budget
        goal, aim = plan.goal, plan.aim
        usual = BYTES_IN_INKS if plan.in_inks else USUAL_BYTES
        self._bytes_each = usual * (GZIPPED_SHARE if plan.counts_gzipped else 1.0)
        each = LEAST_PIXELS_EACH_OF_BUDGET if plan.is_budget else LEAST_PIXELS_EACH
        cap = min(plan.preset.cap, max(1, pixels // each))
        # Largest count that corrections may reach. Growth may only reach `expected`.
        self._most = cap if aim is None else max(cap, min(CAP_FOR_TARGET, pixels))
        self._cap_reason, self._psnr_reason, self._psnr = "cap", "enough", plan.stop_psnr
        if goal.count is not None:
            cap = self._most = goal.count
            self._cap_reason, self._psnr = "gaussians", math.inf
        if aim is not None and aim.search.slope is None:  # the score is PSNR, as in growth
            writing = 10 * math.log10(1 + WRITING_LOSS)
            self._psnr_reason, cap = aim.of.option, self._most
            self._psnr = aim.value + aim.search.margin + writing
        # For another score, growth ends at the preset's PSNR, and corrections find the score.
        self.expected, self._first = cap, FIRST_ROUND
        is_limited = plan.is_budget or goal.byte_limit is not None or goal.count is not None
        # Whether the best picture within a limit, or with a given count, is wanted.
        self._wants_best = aim is None and is_limited
        # dB that a Gaussian must gain. Only a preset that is given alone asks for a gain.
        self.least_gain = 0.0 if aim or is_limited else plan.preset.gain * (usual / 1000)
        if plan.only_time_limits:
            self.expected = int(min(cap, budget.most_gaussians(0.0)))
            self._first = max(FIRST_ROUND, self.expected >> (schedule.ROUNDS - 1))
        # The leap takes one more round.
        self.rounds = max(1, math.ceil(math.log2(max(self.expected, 1) / self._first)) + 2)
        self.stop_reason = "cap"
        self.slope = 3.0
        self.is_additive = plan.options.svg.portable
        self._last: Snapshot | None = None
        self._before_leap: Snapshot | None = None
        self._is_measured = False  # whether growth has measured the bytes of a shape
        self._paying_count = math.inf
        self._aim = aim or Aim(PSNR, plan.stop_psnr, ENOUGH)  # score that corrections aim at

    def grow(self, now: Snapshot) -> int:
        """Return the next count: twice the present, fewer if a limit allows fewer, or a leap."""
        in_time, psnr = math.inf, now.psnr
        if self._plan.only_time_limits:
            in_time = self._budget.most_gaussians(now.done)
        elif now.late:
            in_time = max(now.count, 1)
        counts = self._counts(now, in_time)
        last, self._last = self._last, now
        if last is not None:
            psnr += CONVERGES_AFTER_ROUND * max(psnr - CONVERGES_ABOVE, 0.0)
            self._learn(now, last)
        wanted = self._wanted(now.count, psnr, counts)
        if wanted >= LEAST_ROUND * now.count and wanted:
            return min(math.ceil(wanted), max(2 * now.count, self._first))
        if self.stop_reason == "gain":
            if last is not None and last == self._before_leap:
                self._paying_count = last.count
                return last.count
            leap = int(min(counts.values())) // 4
            if self._before_leap is None and leap > LEAP * now.count:
                self._before_leap = now
                return leap
        return now.count

    def adjust(self, now: Snapshot) -> int:
        """Return the count that the limits ask for at the fit's end, at most MOST_CHANGE away."""
        least, most = (1 - MOST_CHANGE) * now.count, (1 + MOST_CHANGE) * now.count
        in_time = max(TOO_MANY * self._budget.most_gaussians(now.done), least)
        if self._plan.only_time_limits:
            in_time = min(in_time, now.count)
        counts = self._counts(now, in_time)
        rate = CONVERGES_AFTER[max(bisect(ADJUST_AT, now.done) - 1, 0)]
        psnr = now.psnr + rate * max(now.psnr - CONVERGES_ABOVE, 0.0)
        wanted = self._wanted(now.count, psnr, counts)
        if abs(wanted - now.count) <= LEAST_CHANGE * now.count:
            return now.count
        return int(min(math.ceil(min(max(wanted, least), most)), *counts.values()))

    def max_count(self, now: Snapshot) -> int:
        """Return the largest count that cap, bytes and time allow."""
        # Growth with a target or a preset ignores how many Gaussians there is time for.
        done, colors = (1.0, False) if self._plan.only_time_limits else (now.done, True)
        return int(min(self._counts(now, self._budget.most_gaussians(done, colors)).values()))

    def _counts(self, now: Snapshot, in_time: float) -> dict[str, float]:
        """Return the counts that cap, time and bytes allow, by their stop reasons.

        If bytes are limited, first measure a shape's bytes: once in growth, always in refinement.
        """
        counts, limit = {self._cap_reason: float(self.expected)}, self._plan.goal.byte_limit
        if self.is_additive:
            return counts
        counts["time_limit"] = in_time
        if limit is not None:
            refines = now.done > schedule.GROWTH_SHARE
            share = OVERFILL_REFINING if refines else OVERFILL_GROWING
            if now.done >= schedule.QUANTIZED_FROM:
                share = 1 + SPARE / math.sqrt(max(now.count, 1))
            if self._plan.aim is not None:  # a target allows no excess to prune
                share = 1.0
            if refines or (now.count >= MEASURED_FROM and not self._is_measured):
                self._is_measured = True
                saved = BYTES_SAVED * (1 - now.done) if refines else 0.0
                scene = self._exporter.quantized(now.scene(), now.psnr)
                each = self._exporter.bytes_each(scene, share * limit, now.psnr)
                self._bytes_each = (1 - saved) * each
            counts["max_bytes"] = self._in_bytes(share * limit)
        return counts

    def _in_bytes(self, size: float) -> int:
        """Return the count that fills `size` bytes."""
        return int(max(size - self._exporter.empty_bytes, 0) / self._bytes_each)

    def _learn(self, now: Snapshot, last: Snapshot) -> None:
        """Set the slope and the paying count by the gain of the last round."""
        gain = max(now.psnr - last.psnr, 0.0) / GAIN_OF_A_ROUND
        added = now.count - last.count
        doublings = math.log2(now.count / last.count) if last.count else 1.0
        rise = gain / doublings
        if doublings > WHOLE_ROUND:  # convergence distorts the gain of a smaller round
            self.slope = min(max(rise, FLATTEST), STEEPEST)
        if self.least_gain:
            # Count at which one more kilobyte gains just what the preset asks for.
            self._paying_count = rise / (self.least_gain * math.log(2))
            if last == self._before_leap and gain >= self.least_gain * added:
                self._paying_count = last.count + added / (1 - 10 ** (-gain / 10))

    def _wanted(self, count: int, psnr: float, counts: dict[str, float]) -> float:
        """Return the smallest count that a limit allows, and set `stop_reason` to that limit."""
        needed = 0.0 if psnr >= self._psnr else math.inf
        if count:
            needed = count * 2 ** min((self._psnr - psnr) / self.slope, 60.0)
        counts = {self._psnr_reason: needed, **counts, "gain": self._paying_count}
        self.stop_reason = min(counts, key=counts.__getitem__)
        return counts[self.stop_reason]

    def corrected(self, count: int, exports: Sequence[Export]) -> int:
        """Return the count of the next export, or the present count if no correction is needed.

        Set `stop_reason` to the limit that decides.
        """
        last, plan, limit = exports[-1], self._plan, self._plan.goal.byte_limit
        # A smaller count saves no time, because it is fitted and written again.
        in_time = max(self._budget.most_gaussians(1.0), count)
        counts = {self._cap_reason: float(self._most), "time_limit": in_time}
        if plan.covering and not self._wants_best:
            # Ellipses at edges cost PSNR that more shapes do not regain, so the count is bounded.
            counts["gain"] = math.ceil(FOR_EDGES * len(exports[0].scene))
        if limit is not None:
            counts["max_bytes"] = self._filling(limit, count, exports)
            is_full = plan.aim is None and last.size > FULL * limit
            if count and (is_full or last.size > TOO_LARGE * limit):
                self.stop_reason = "max_bytes"
                is_pruned = last.size <= TOO_LARGE * limit
                return count if is_pruned else int(min(counts["max_bytes"], count - 1))
        if not count:
            is_met = plan.aim is None or plan.aim.is_met_by(last.score)
            return 0 if is_met else int(min(FIRST_ROUND, *counts.values()))
        needed = self._needed(count, exports)
        if needed == count:
            if limit is not None and last.size > limit:  # the export will be pruned
                self.stop_reason = "max_bytes"
            return count
        counts = {"enough" if plan.aim is None else "iterations": needed, **counts}
        self.stop_reason = min(counts, key=counts.__getitem__)
        wanted = int(counts[self.stop_reason])
        if abs(wanted - count) <= SAME_COUNT * count:
            return count
        if self._budget.must_export:
            self.stop_reason = "time_limit"
            return count
        return wanted

    def _needed(self, count: int, exports: Sequence[Export]) -> int:
        """Return the count that the wanted score needs, without regard to limits."""
        search, is_aim = self._aim.search, self._plan.aim is not None
        excess = exports[-1].score - self._aim.value
        if self._wants_best:  # only a limit of bytes is filled, until more Gaussians are invisible
            fills = self._plan.goal.byte_limit is not None and excess < 0
            return 4 * count if fills else count
        ended_before = excess < 0 and not is_aim and self.stop_reason != "enough"
        if ended_before or -search.too_little <= excess <= search.too_good:
            return count
        doublings = (search.margin - excess) / self._slope(exports)
        doublings = max(doublings, -MOST_CORRECTED if is_aim else -MOST_REDUCED)
        needed = count * 2 ** min(doublings, MOST_CORRECTED)
        return round(needed) if is_aim else math.ceil(max(needed, min(count, LEAST_REDUCED)))

    def _filling(self, limit: int, count: int, exports: Sequence[Export]) -> int:
        """Return the count that fills the limit of bytes, interpolated between two files.

        If no file is below the limit, or none above, measure the bytes of the last file's shapes.
        """
        size = attrgetter("size")
        below = max((e for e in exports if e.size <= limit), key=size, default=None)
        above = min((e for e in exports if e.size > limit), key=size, default=None)
        if below is not None and above is not None and len(below.scene) < len(above.scene):
            share = (limit - below.size) / (above.size - below.size)
            return int(len(below.scene) + share * (len(above.scene) - len(below.scene)))
        if count:
            self._bytes_each = self._exporter.bytes_each(exports[-1].scene, limit)
        return self._in_bytes(limit)

    def _slope(self, exports: Sequence[Export]) -> float:
        """Return the score gained per doubling, from the last two exports or from growth."""
        search = self._aim.search
        slope, (least, most) = self.slope if search.slope is None else search.slope, search.slopes
        if len(exports) >= 2:
            before, last = exports[-2:]
            doublings = math.log2(len(last.scene) / max(len(before.scene), 1))
            rise = last.score - before.score
            if abs(doublings) > TELLING and rise / doublings > 0:  # otherwise the rise is chance
                slope = rise / doublings
        return min(max(slope, least), most)

    def best(self, exports: Sequence[Export]) -> Export:
        """Return the export to write.

        With a target or a preset, it is the smallest file with a score within the tolerances. If
        there is none, it is the smallest file above them, or else the file with the highest score.
        With a limit or a given count, it is the file with the highest expected score after
        pruning. If all files are too large, it is the smallest.
        """
        limit = self._plan.goal.byte_limit or math.inf
        largest = limit if self._plan.aim is not None else TOO_LARGE * limit
        small = [e for e in exports if e.size <= largest]
        if not small:
            return min(exports, key=attrgetter("size"))
        if self._wants_best:
            return max(small, key=lambda e: e.score - PRUNED * math.log2(max(e.size / limit, 1)))
        met = [e for e in small if self._aim.is_met_by(e.score)]
        close = [e for e in met if e.score <= self._aim.value + self._aim.search.too_good]
        if not met:
            return max(small, key=attrgetter("score"))
        return min(close or met, key=attrgetter("size"))
