"""How many Gaussians the limits of a goal allow, as a fit shows what they gain, take and cost.

    psnr   as many as reach it, where each doubling gains `slope` dB
    gain   as many as still gain what the preset asks for each kilobyte
    cap    the preset's or the given number
    bytes  as many as fit in, by the bytes of the shapes so far
    time   as many as can be fitted and written in what is left

The smallest of these is the next count, and its limit the reason why growth stops. Constants:
docs/decisions/fit.md.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from gauss2svg.fit import schedule
from gauss2svg.fit.session import ADJUST_AT, DensificationPolicy, Snapshot
from gauss2svg.pipeline import presets
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.search.export import Exporter
from gauss2svg.pipeline.time_budget import TimeBudget

FIRST_ROUND = 8  # Gaussians of the first round
# Share of a doubling's final gain that a round of growth shows, because it has too few steps to
# converge.
GAIN_OF_A_ROUND = 0.72
CONVERGES_ABOVE = 16.5  # dB of PSNR above which convergence still brings something
# Share of the dB above CONVERGES_ABOVE that convergence brings after a round of growth.
CONVERGES_AFTER_ROUND = 0.28
CONVERGES_AFTER = dict(zip(ADJUST_AT, (0.055, 0.034, 0.029), strict=True))  # and in refinement
MOST_CHANGE = 0.3  # largest change of the count at one adjustment, as a share of it
LEAST_CHANGE = 0.02  # share of the count below which an adjustment is not made
LEAST_ROUND = 1.1  # ratio of the wanted to the present count, below which no round begins
WHOLE_ROUND = 0.6  # doublings from which a round says enough about the slope
# Ratio of a doubling's gain to the one before that marks a drawing. Photos stay under 1.5.
ACCELERATING = 1.7
LEAP = 4  # ratio of the next count to the present one, from which a round is a leap
FLATTEST = 0.5  # least plausible slope, dB for each doubling
STEEPEST = 8.0  # largest plausible slope, dB for each doubling

# Gaussians that fit into a limit of bytes (docs/decisions/markup.md).
LEAST_MEASURED = 200  # gaussians from which the bytes of one are measured
# Multiple of the allowed bytes that growth aims at. The least useful shapes go afterwards.
OVERFILL_GROWING = 1.25
OVERFILL_REFINING = 1.03  # the same for refinement until its last steps
# Excess over the allowed bytes, times the root of the count, that the last steps begin with: the
# file is then full, and a few shapes more are pruned.
SPARE = 0.4
# Share of a shape's bytes that refinement saves, for each unit of progress that is left.
BYTES_SAVED = 0.15
# Fewest pixels for each Gaussian. Nine numbers would exceed its share of the image.
PIXELS_EACH = 3
PIXELS_EACH_OF_BUDGET = 2  # fewest pixels where the best in some bytes or seconds is wanted
WRITING_LOSS = 0.06  # share of the scene's error that writing is expected to add


class Cap(NamedTuple):
    """The largest count, and the stop reason when it is reached."""

    gaussians: int
    name: str


def fewest(first: Cap, *others: Cap) -> Cap:
    """Return the smallest of these caps, the first of equal ones."""
    return min((first, *others), key=lambda cap: cap.gaussians)


class Limits(DensificationPolicy):
    """A policy that doubles the count in each round, until a limit is met.

    If a doubling gains s dB, a kilobyte gains s / (n ln 2 kilobytes) dB at n Gaussians: growth
    aims at the n where that falls to the preset's gain. It continues beyond while the gains of
    rounds accelerate and the squared error, falling in proportion to the last round's, would
    vanish before the cap: a checkerboard's first squares gain next to nothing, its last ones
    everything. For the same reason growth that does not pay at a small count leaps once to a
    fourth of the cap, and returns if that did not pay either.

    cap          the largest count without limits of bytes and of seconds
    expected     count of a fit that is limited by time alone, else None
    slope        dB a doubling
    is_additive  whether the fit is one before that of the file, which tells no bytes
    """

    def __init__(self, plan: Plan, exporter: Exporter, budget: TimeBudget, pixels: int) -> None:
        self._plan, self._exporter, self._budget = plan, exporter, budget
        aim = plan.aim
        usual = presets.BYTES_IN_INKS if plan.in_inks else presets.USUAL_BYTES
        self._bytes_each = usual * (presets.GZIPPED_SHARE if plan.counts_gzipped else 1.0)
        self._bytes_known = False
        gain, self._psnr, self._psnr_named = plan.preset.gain, plan.enough, "enough"
        if plan.goal.count is None:
            each = PIXELS_EACH_OF_BUDGET if plan.is_budget else PIXELS_EACH
            self.cap = Cap(min(plan.preset.cap, max(1, pixels // each)), "cap")
            most = max(self.cap.gaussians, min(presets.CAP_FOR_TARGET, pixels))
        else:
            gain, self._psnr = 0.0, math.inf
            self.cap, most = Cap(plan.goal.count, "gaussians"), plan.goal.count
        self._cap_for_target = Cap(most, self.cap.name)
        if (
            plan.goal.byte_limit is not None or aim is not None
        ):  # the best, not what is worth its bytes
            gain = 0.0
        if aim is not None and aim.slope is None:  # that of the growth, which can aim at it
            self._psnr = aim.value + aim.over + 10 * math.log10(1 + WRITING_LOSS)
            self._psnr_named, self.cap = aim.name, self._cap_for_target
        # Else growth ends at what the preset calls enough, and corrections find the score.
        self._price = gain * (usual / 1000)  # dB that each Gaussian must gain
        self._allowed, self._first = self.cap, FIRST_ROUND
        self.expected: int | None = None
        if plan.only_time_limits:
            self.expected = min(self.cap.gaussians, budget.most_gaussians(0, 0.0))
            self._allowed = Cap(self.expected, self.cap.name)
            self._first = max(FIRST_ROUND, self.expected >> (schedule.ROUNDS - 1))
        # One more for the leap.
        doublings = math.log2(max(self._allowed.gaussians, 1) / self._first)
        self.rounds = max(1, math.ceil(doublings) + 2)
        self.stop_reason = "cap"
        self.slope = 3.0
        self.is_additive = plan.options.svg.portable
        self._last: Snapshot | None = None
        self._before_leap: Snapshot | None = None
        self._paying = self._rise = math.inf

    def grow(self, now: Snapshot) -> int:
        """Return twice the count, or less if a limit allows less."""
        self._revise(now)
        last, self._last = self._last, now
        converged = now.psnr
        if last is not None:
            converged += CONVERGES_AFTER_ROUND * _converging(now)
            self._learn(now, last)
        wanted = self._wanted(now.count, converged)
        if self.stop_reason == "gain" and wanted < LEAST_ROUND * now.count:
            if last is not None and last == self._before_leap:
                self._paying = last.count
                return last.count
            leap = self._allowed.gaussians // 4
            if self._before_leap is None and leap > LEAP * now.count:
                self._before_leap = now
                return leap
        if wanted < LEAST_ROUND * now.count or not wanted:
            return now.count
        return min(math.ceil(wanted), max(2 * now.count, self._first))

    def adjust(self, now: Snapshot) -> int:
        """Return more or fewer if the extrapolated PSNR or file size is off the limits."""
        self._revise(now)
        rate = min(CONVERGES_AFTER.items(), key=lambda item: abs(item[0] - now.done))[1]
        wanted = self._wanted(now.count, now.psnr + rate * _converging(now))
        if abs(wanted - now.count) <= LEAST_CHANGE * now.count:
            return now.count
        bounds = (1 - MOST_CHANGE) * now.count, (1 + MOST_CHANGE) * now.count
        return min(math.ceil(min(max(wanted, bounds[0]), bounds[1])), self._allowed.gaussians)

    def most(self, now: Snapshot) -> int:
        """Return the largest number that the limits allow."""
        self._revise(now)
        return self._allowed.gaussians

    def least_gain(self) -> float:
        """Return the gain in dB that the bytes of a Gaussian must bring."""
        return self._price

    def allow_for_target(self) -> None:
        """Let corrections exceed the preset's cap, which is of what is worth its bytes."""
        if self.cap.name == "cap" and self._plan.aim is not None:
            self.cap = self._cap_for_target

    def within_bytes(self, now: Snapshot, size: int | None = None) -> Cap:
        """Return the largest count so far, or the one that fills the limit of bytes.

        Before the last steps it is a little more than that, because some shapes go.
        size  bytes of the scene's file, once it has been written
        """
        limit, exporter = self._plan.goal.byte_limit, self._exporter
        if limit is None:
            return self.cap
        refining = now.done > schedule.GROWTH_SHARE
        share = OVERFILL_REFINING if refining else OVERFILL_GROWING
        if now.done >= schedule.QUANTIZED_FROM:
            share = 1 + SPARE / math.sqrt(max(now.count, 1))
        if now.done >= 1 or self._plan.aim is not None:  # what is over is not pruned
            share = 1.0
        room = max(limit * share - exporter.empty_bytes, 0)
        known = self._bytes_known and not refining
        if now.count >= (1 if refining else LEAST_MEASURED) and not known:
            self._bytes_known = True
            saved = BYTES_SAVED * (1 - now.done) if refining else 0.0
            each = exporter.bytes_each(now.scene(), now.psnr, room, size)
            self._bytes_each = (1 - saved) * each
        return fewest(self.cap, Cap(int(room / self._bytes_each), "max_bytes"))

    def _revise(self, now: Snapshot) -> None:
        """Set the largest count by the bytes and the time."""
        if self.is_additive:
            return
        self._allowed = cap = self.within_bytes(now)
        if self._budget.deadline is not None:
            most = cap.gaussians
            if self._plan.only_time_limits:
                most = self._budget.most_gaussians(now.count, now.done)
            elif now.late:
                most = max(now.count, 1)
            self._allowed = fewest(cap, Cap(most, "time_limit"))

    def _learn(self, now: Snapshot, last: Snapshot) -> None:
        """Extrapolate from the last round to the rounds to come."""
        gain = max(now.psnr - last.psnr, 0.0) / GAIN_OF_A_ROUND
        added = now.count - last.count
        doublings = math.log2(now.count / last.count) if last.count else 1.0
        rise, before, self._rise = gain / doublings, self._rise, gain / doublings
        # The count at which a kilobyte gains no more than the limit.
        self._paying = rise / (self._price * math.log(2)) if self._price else math.inf
        if last == self._before_leap:
            pays = gain >= self._price * added
        else:
            pays = rise > ACCELERATING * before
        share = 1 - 10 ** (-gain / 10)
        exact = last.count + added / share if share > 0 else math.inf
        if pays and exact <= self._allowed.gaussians:
            self._paying = max(self._paying, exact)
        if doublings > WHOLE_ROUND:  # a smaller one gains more by convergence
            self.slope = min(max(rise, FLATTEST), STEEPEST)

    def _wanted(self, count: int, converged: float) -> float:
        """Return the smallest count that a limit allows, and set `stop_reason` to that limit."""
        if converged >= self._psnr and not count:
            self.stop_reason = self._psnr_named
            return 0
        lacking = self._psnr - converged
        needed = count * 2 ** min(lacking / self.slope, 60.0) if count else math.inf
        wanted, self.stop_reason = min(
            (needed, self._psnr_named),
            (float(self._allowed.gaussians), self._allowed.name),
            (self._paying, "gain"),
        )
        return wanted


def _converging(now: Snapshot) -> float:
    return max(now.psnr - CONVERGES_ABOVE, 0.0)
