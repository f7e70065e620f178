"""The counts that the limits of a goal allow, by what a fit and its files gain and cost.

    psnr   count that reaches the PSNR, where each doubling gains `slope` dB
    gain   count up to which a kilobyte gains what the preset asks for
    cap    count that the preset allows, or the given count
    bytes  count that fits into the bytes, by the bytes of the shapes so far
    time   count that can be fitted and written in the time left

The smallest of these is the next count, and its limit is the reason why growth stops. Constants:
docs/decisions/fit.md.

Files are corrected by the score of the rasterised SVG. Kodak 20 is 768 px wide. Fitted at 384 px
with a target of 28 dB, it has:

    Gaussians    PSNR at 384 px    PSNR against the photo
    195          28.24             26.14: the photo has detail that the fit did not see
    299          29.00             26.59
    607          31.03             27.63
    759          32.23             28.13: reached

Corrections aim at 28.12 dB. The number of doublings to the next count is the missing dB divided by
the dB gained per doubling. A doubling gains 3.2 dB at first, as in growth. Later it gains as much
as between the last two exports, but at least 1.5 dB.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import NamedTuple

from gauss2svg.fit import schedule
from gauss2svg.fit.session import ADJUST_AT, DensificationPolicy, Snapshot
from gauss2svg.pipeline import presets
from gauss2svg.pipeline.plan import Aim, Plan
from gauss2svg.pipeline.search.outcome import Export, Exporter
from gauss2svg.pipeline.time_budget import TimeBudget

FIRST_ROUND = 8  # Gaussians of the first round
# Share of a doubling's final gain that a round of growth shows, because it has too few steps to
# converge.
GAIN_OF_A_ROUND = 0.72
CONVERGES_ABOVE = 16.5  # dB of PSNR above which convergence still adds some
# Share of the dB above CONVERGES_ABOVE that convergence adds after a round of growth.
CONVERGES_AFTER_ROUND = 0.28
CONVERGES_AFTER = dict(zip(ADJUST_AT, (0.055, 0.034, 0.029), strict=True))  # the same in refinement
MOST_CHANGE = 0.3  # largest change of the count at one adjustment, as a share of it
# Ratio of the count to the count for which there is time, above which refinement removes some.
TOO_MANY = 2.0
LEAST_CHANGE = 0.02  # share of the count below which an adjustment is not made
LEAST_ROUND = 1.1  # ratio of the wanted to the present count, below which no round begins
WHOLE_ROUND = 0.6  # fewest doublings of a round from which a slope is derived
# Ratio of a doubling's gain to the one before that marks a drawing. Photos stay under 1.5.
ACCELERATING = 1.7
LEAP = 4  # ratio of the next count to the present one, from which a round is a leap
FLATTEST = 0.5  # least plausible slope, dB for each doubling
STEEPEST = 8.0  # largest plausible slope, dB for each doubling

# Gaussians that fit into a limit of bytes (docs/decisions/markup.md).
LEAST_MEASURED = 200  # fewest Gaussians from which the bytes of a shape are measured
# Multiple of the allowed bytes that growth aims at. The least useful are pruned later.
OVERFILL_GROWING = 1.25
OVERFILL_REFINING = 1.03  # the same for refinement until its last steps
# Share by which the last steps may exceed the allowed bytes, times the root of the count. The file
# is then full after a few shapes are pruned.
SPARE = 0.4
# Share of a shape's bytes that refinement saves, for each unit of progress that is left.
BYTES_SAVED = 0.15
# Fewest pixels for each Gaussian. Fewer pixels have fewer values than a Gaussian's nine numbers.
PIXELS_EACH = 3
PIXELS_EACH_OF_BUDGET = 2  # the same for a budget of bytes or seconds
WRITING_LOSS = 0.06  # share of the scene's error that writing is expected to add

# Corrections of a count (docs/decisions/monotone.md and numbers.md).
FULL = 0.985  # share of the allowed bytes from which a file is full
NEARLY_FULL = 0.97  # the same after one correction
# Multiple of the allowed bytes from which a fit is corrected. A smaller excess is pruned.
TOO_LARGE = 1.1
PRUNED = 8.0  # dB that pruning alone loses for each halving of the bytes
# dB under the preset's PSNR up to which there is no correction. LESS_THAN_ENOUGH + FAR_MORE is less
# than the presets' PSNRs differ, so that no preset ends under a cheaper one.
LESS_THAN_ENOUGH = 0.8
FAR_MORE = 3.0  # dB over the preset's PSNR up to which there is no correction
# Fewest Gaussians after a reduction for FAR_MORE. They take a kilobyte or two, and each is visible.
FEW = 16
SAME = 0.004  # relative difference up to which two counts are the same
TELLING = 0.25  # least doublings between two exports from which a slope is derived
AT_THE_CAP = 0.95  # share of the largest count above which the cap is the stop reason
BOUND = 0.93  # share of the allowed bytes above which they are the stop reason
# Largest reduction of a count, in doublings. A large one ends worse than several small ones.
MOST_REDUCED = -0.5
# Largest ratio of the last to the first count for a drawing whose edges are ellipses
# (docs/decisions/enlarged.md).
FOR_EDGES = 1.4
SLOPES = 1.5, 12.0  # least and largest plausible slope in dB for each doubling


class Cap(NamedTuple):
    """The largest count, and the stop reason when it is reached."""

    gaussians: float
    name: str


def fewest(first: Cap, *others: Cap) -> Cap:
    """Return the smallest of these caps, the first of equal ones."""
    return min((first, *others), key=attrgetter("gaussians"))


class Limits(DensificationPolicy):
    """A policy that doubles the count in each round until a limit is met, and then corrects it.

    If a doubling gains s dB and a Gaussian has k kilobytes, a kilobyte gains s / (n k ln 2) dB at n
    Gaussians. Growth aims at the n where this falls to the preset's gain. It goes on beyond n while
    the gains of rounds accelerate, if the squared error would vanish before the cap at the last
    round's rate. The first squares of a checkerboard gain next to nothing, and the last everything.
    For the same reason, growth that does not pay at a small count leaps once to a fourth of the
    cap. It returns if the leap does not pay either.

    expected     largest count that the fit may end with, as known before the fit
    slope        dB gained by a doubling of the count
    is_additive  whether the additive fit before a portable file runs, from which no bytes follow
    """

    def __init__(self, plan: Plan, exporter: Exporter, budget: TimeBudget, pixels: int) -> None:
        self._plan, self._exporter, self._budget = plan, exporter, budget
        goal, aim = plan.goal, plan.aim
        usual = presets.BYTES_IN_INKS if plan.in_inks else presets.USUAL_BYTES
        self._bytes_each = usual * (presets.GZIPPED_SHARE if plan.counts_gzipped else 1.0)
        self._bytes_known = False
        each = PIXELS_EACH_OF_BUDGET if plan.is_budget else PIXELS_EACH
        self._cap = Cap(min(plan.preset.cap, max(1, pixels // each)), "cap")
        self._cap_for_target = Cap(
            max(self._cap.gaussians, min(presets.CAP_FOR_TARGET, pixels)), "cap"
        )
        self._psnr = Cap(plan.stop_psnr, "enough")
        if goal.count is not None:
            self._cap = self._cap_for_target = Cap(goal.count, "gaussians")
            self._psnr = Cap(math.inf, "enough")
        if aim is not None and aim.search.slope is None:  # growth itself aims at PSNR
            writing = 10 * math.log10(1 + WRITING_LOSS)
            self._psnr = Cap(aim.value + aim.search.over + writing, aim.name)
            self._cap = self._cap_for_target
        # For another score, growth ends at the preset's PSNR, and corrections find the score.
        by_gain = goal.count is None and goal.byte_limit is None and aim is None
        # dB that each Gaussian must gain, 0 if the best picture is wanted.
        self._price = plan.preset.gain * (usual / 1000) if by_gain else 0.0
        self.expected, first = int(self._cap.gaussians), FIRST_ROUND
        if plan.only_time_limits:
            self.expected = int(min(self.expected, budget.most_gaussians(0.0)))
            first = max(FIRST_ROUND, self.expected >> (schedule.ROUNDS - 1))
        self._allowed, self._first = Cap(self.expected, self._cap.name), first
        # The leap takes one more round.
        self.rounds = max(1, math.ceil(math.log2(max(self.expected, 1) / first)) + 2)
        self.stop_reason = "cap"
        self.slope = 3.0
        self.is_additive = plan.options.svg.portable
        self._last: Snapshot | None = None
        self._before_leap: Snapshot | None = None
        self._paying = self._rise = math.inf

    def grow(self, now: Snapshot) -> int:
        """Return the next count: twice the present, less if a limit allows less, or a leap."""
        in_time = math.inf
        if self._plan.only_time_limits:
            in_time = self._budget.most_gaussians(now.done)
        elif now.late:
            in_time = max(now.count, 1)
        self._allow(now, in_time)
        last, self._last = self._last, now
        converged = now.psnr
        if last is not None:
            converged += CONVERGES_AFTER_ROUND * _converging(now)
            self._learn(now, last)
        wanted, self.stop_reason = self._wanted(now.count, converged)
        if self.stop_reason == "gain" and wanted < LEAST_ROUND * now.count:
            if last is not None and last == self._before_leap:
                self._paying = last.count
                return last.count
            leap = self._allowed.gaussians // 4
            if self._before_leap is None and leap > LEAP * now.count:
                self._before_leap = now
                return int(leap)
        if wanted < LEAST_ROUND * now.count or not wanted:
            return now.count
        return min(math.ceil(wanted), max(2 * now.count, self._first))

    def adjust(self, now: Snapshot) -> int:
        """Return another count if the extrapolated PSNR or file size misses its limit."""
        least, most = (1 - MOST_CHANGE) * now.count, (1 + MOST_CHANGE) * now.count
        in_time = max(TOO_MANY * self._budget.most_gaussians(now.done), least)
        if self._plan.only_time_limits:
            in_time = min(in_time, now.count)
        self._allow(now, in_time)
        rate = min(CONVERGES_AFTER.items(), key=lambda item: abs(item[0] - now.done))[1]
        psnr = now.psnr + rate * _converging(now)
        wanted, self.stop_reason = self._wanted(now.count, psnr)
        if abs(wanted - now.count) <= LEAST_CHANGE * now.count:
            return now.count
        return int(min(math.ceil(min(max(wanted, least), most)), self._allowed.gaussians))

    def most(self, now: Snapshot) -> int:
        """Return the largest count that fits into the bytes and can be written in time."""
        # With a target or a preset, growth has not considered the time.
        done, colors = (1.0, False) if self._plan.only_time_limits else (now.done, True)
        self._allow(now, self._budget.most_gaussians(done, colors))
        return int(self._allowed.gaussians)

    def least_gain(self) -> float:
        """Return the gain in dB that the bytes of a Gaussian must bring."""
        return self._price

    def _allow(self, now: Snapshot, in_time: float) -> None:
        """Set the largest count, by the bytes of shapes so far and the count that time allows."""
        if self.is_additive:
            return
        limit, refining = self._plan.goal.byte_limit, now.done > schedule.GROWTH_SHARE
        self._allowed = fewest(self._cap, Cap(in_time, "time_limit"))
        if limit is None:
            return
        share = OVERFILL_REFINING if refining else OVERFILL_GROWING
        if now.done >= schedule.QUANTIZED_FROM:
            share = 1 + SPARE / math.sqrt(max(now.count, 1))
        if self._plan.aim is not None:  # an excess is not pruned for a target
            share = 1.0
        if refining or (now.count >= LEAST_MEASURED and not self._bytes_known):
            self._bytes_known = True
            saved = BYTES_SAVED * (1 - now.done) if refining else 0.0
            scene, written = self._exporter.formatted(now.scene(), now.psnr)
            size = max(share * limit - self._exporter.empty_bytes, 0)
            self._bytes_each = (1 - saved) * self._exporter.bytes_each(scene, written, size)
        self._allowed = fewest(self._allowed, self._in_bytes(share * limit))

    def _in_bytes(self, size: float) -> Cap:
        """Return the count that fills `size` bytes."""
        shapes = max(size - self._exporter.empty_bytes, 0)
        return Cap(int(shapes / self._bytes_each), "max_bytes")

    def _learn(self, now: Snapshot, last: Snapshot) -> None:
        """Extrapolate from the last round to the rounds to come."""
        gain = max(now.psnr - last.psnr, 0.0) / GAIN_OF_A_ROUND
        added = now.count - last.count
        doublings = math.log2(now.count / last.count) if last.count else 1.0
        rise, before, self._rise = gain / doublings, self._rise, gain / doublings
        # Count at which a kilobyte gains just what the preset asks for.
        self._paying = rise / (self._price * math.log(2)) if self._price else math.inf
        if last == self._before_leap:
            pays = gain >= self._price * added
        else:
            pays = rise > ACCELERATING * before
        share = 1 - 10 ** (-gain / 10)
        exact = last.count + added / share if share > 0 else math.inf
        if pays and exact <= self._allowed.gaussians:
            self._paying = max(self._paying, exact)
        if doublings > WHOLE_ROUND:  # a smaller round gains more by convergence
            self.slope = min(max(rise, FLATTEST), STEEPEST)

    def _wanted(self, count: int, converged: float) -> Cap:
        """Return the smallest count that a limit allows, and that limit."""
        psnr, name = self._psnr
        if not count:
            return Cap(0, name) if converged >= psnr else self._allowed
        needed = count * 2 ** min((psnr - converged) / self.slope, 60.0)
        return fewest(Cap(needed, name), self._allowed, Cap(self._paying, "gain"))

    def corrected(self, count: int, exports: Sequence[Export]) -> int:
        """Return the count of the next export, or the present count if no correction is needed.

        Set `stop_reason` to the limit that decides.
        """
        last, aim, limit = exports[-1], self._plan.aim, self._plan.goal.byte_limit
        cap = self._cap if aim is None else self._cap_for_target
        # A smaller count saves no time, because it is fitted and written again.
        in_time = max(self._budget.most_gaussians(1.0), count)
        cap = fewest(cap, Cap(in_time, "time_limit"))
        if limit is not None:
            if count:
                size = max(limit - self._exporter.empty_bytes, 0)
                self._bytes_each = self._exporter.bytes_each(last.scene, last.format, size)
            cap = fewest(cap, self._in_bytes(limit))
        if not count:
            lacks = aim is not None and not aim.reached(last.score)
            return int(min(FIRST_ROUND, cap.gaussians)) if lacks else 0
        if limit is not None and last.size > limit:
            is_pruned = last.size <= TOO_LARGE * limit
            if not is_pruned or aim is None:
                self.stop_reason = "max_bytes"
                return count if is_pruned else min(_filling(limit, cap, exports), count - 1)
        if aim is not None:
            wanted = self._aimed(aim, count, cap, exports)
        elif limit is not None:
            wanted = self._filled(limit, count, cap, exports)
        else:
            wanted = self._enough(count, cap, exports)
        if abs(wanted - count) <= SAME * count:
            return count
        if self._budget.is_over:
            self.stop_reason = "time_limit"
            return count
        return wanted

    def _aimed(self, aim: Aim, count: int, cap: Cap, exports: Sequence[Export]) -> int:
        """Return the next count for a target."""
        over, search = exports[-1].score - aim.value, aim.search
        if -search.too_little <= over <= search.too_good:
            return count
        missing = (search.over - over) / self._slope(exports)
        return int(min(round(count * 2 ** max(min(missing, 2.0), -2.0)), cap.gaussians))

    def _filled(self, limit: int, count: int, cap: Cap, exports: Sequence[Export]) -> int:
        """Return the next count for a limit of bytes, which is filled until more do not show."""
        last, share = exports[-1], FULL if len(exports) < 2 else NEARLY_FULL
        if last.size > share * limit or last.model >= self._plan.stop_psnr:
            return count
        wanted = min(4 * count, _filling(limit, cap, exports))
        if wanted > count:
            self.stop_reason = cap.name
        return wanted

    def _enough(self, count: int, cap: Cap, exports: Sequence[Export]) -> int:
        """Return the next count for the preset's PSNR."""
        missing = self._plan.stop_psnr - exports[-1].model
        given = self._plan.is_budget or self._plan.goal.count is not None
        too_few = missing > 0 and self.stop_reason != "enough"
        if given or too_few or -FAR_MORE <= missing <= LESS_THAN_ENOUGH:
            return count
        needed = count * 2 ** max(min(missing / self._slope(exports), 2.0), MOST_REDUCED)
        if self._plan.covering:  # more shapes do not regain what edges lose as ellipses
            cap = fewest(cap, Cap(math.ceil(FOR_EDGES * len(exports[0].scene)), "gain"))
        if missing < 0:
            needed = max(needed, min(count, FEW))
        self.stop_reason = "enough" if needed < cap.gaussians else cap.name
        return int(min(math.ceil(needed), cap.gaussians))

    def _slope(self, exports: Sequence[Export]) -> float:
        """Return the score gained per doubling, by the last two exports or by the growth.

        Without an aim the score is PSNR in dB.
        """
        search = None if self._plan.aim is None else self._plan.aim.search
        slope = self.slope if search is None or search.slope is None else search.slope
        least, most = SLOPES if search is None else search.slopes
        if len(exports) >= 2:
            before, last = exports[-2:]
            doublings = math.log2(len(last.scene) / max(len(before.scene), 1))
            rise = last.model - before.model if search is None else last.score - before.score
            if abs(doublings) > TELLING and rise / doublings > 0:  # no chance or divergence
                slope = rise / doublings
        return min(max(slope, least), most)

    def best(self, exports: Sequence[Export]) -> Export:
        """Return the smallest file that meets the goal, or the closest for a budget or count."""
        aim, limit = self._plan.aim, self._plan.goal.byte_limit or math.inf
        tolerated = limit if aim is not None else TOO_LARGE * limit  # rest is pruned
        small = [e for e in exports if e.size <= tolerated]
        if not small:
            return min(exports, key=attrgetter("size"))
        if aim is not None:
            by = aim.search
            return _nearest(small, lambda e: e.score - aim.value, by.tolerance, by.too_good)
        if self._plan.goal.count is not None or limit < math.inf or self._plan.is_budget:
            # Pruning to the limit loses some dB for each halving of the bytes.
            return max(small, key=lambda e: e.model - PRUNED * math.log2(max(e.size / limit, 1)))
        stop_psnr = self._plan.stop_psnr
        return _nearest(small, lambda e: e.model - stop_psnr, LESS_THAN_ENOUGH, FAR_MORE)

    def ended_by(self, best: Export) -> str:
        """Return the stop reason, which is the limit that allows no better file."""
        aim, limit = self._plan.aim, self._plan.goal.byte_limit or math.inf
        by_bytes = aim is not None and self.stop_reason == "max_bytes"
        if best.size > BOUND * limit or by_bytes:
            return "max_bytes"
        if aim is None or not len(best.scene):
            return self.stop_reason
        # Whatever ended the growth, corrections did not reach the target.
        count, name = self._cap_for_target
        return name if len(best.scene) > AT_THE_CAP * count else "iterations"


def _converging(now: Snapshot) -> float:
    return max(now.psnr - CONVERGES_ABOVE, 0.0)


def _filling(limit: int, cap: Cap, exports: Sequence[Export]) -> int:
    """Return the count that fills the limit of bytes, interpolated between files around it."""
    size = attrgetter("size")
    below = max((e for e in exports if e.size <= limit), key=size, default=None)
    above = min((e for e in exports if e.size > limit), key=size, default=None)
    if below is None or above is None or len(below.scene) >= len(above.scene):
        return int(cap.gaussians)
    share = (limit - below.size) / (above.size - below.size)
    return int(len(below.scene) + share * (len(above.scene) - len(below.scene)))


def _nearest(
    exports: Sequence[Export], over: Callable[[Export], float], little: float, much: float
) -> Export:
    """Return the smallest file that is at most `little` under the goal and `much` over it.

    If there is none, return the smallest file over the goal. If there is none, return the nearest
    one under it.
    """
    good = [e for e in exports if over(e) >= -little]
    close = [e for e in good if over(e) <= much]
    return min(close or good, key=attrgetter("size")) if good else max(exports, key=over)
