"""Corrections of a search by count: how many Gaussians the next export gets, and which is best.

Targets apply to the rasterised SVG. A search runs at the size of the fit; the additional error of
a larger reference is measured once and added.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from gauss2svg.pipeline.plan import Aim, Plan
from gauss2svg.pipeline.search.export import Export
from gauss2svg.pipeline.search.limits import FIRST_ROUND, Cap, Limits, fewest

# Corrections of a count (docs/decisions/monotone.md and numbers.md).
FULL = 0.985  # share of the allowed bytes from which a file is full
NEARLY_FULL = 0.97  # that share after one correction
# Multiple of the allowed bytes from which a fit is corrected. A smaller excess is pruned.
TOO_LARGE = 1.1
PRUNED = 8.0  # dB that are lost for each halving of the count by pruning alone
# dB under the preset's PSNR up to which there is no correction. LESS_THAN_ENOUGH and FAR_MORE
# together are less than the presets lie apart, so that none ends under a cheaper one.
LESS_THAN_ENOUGH = 0.8
FAR_MORE = 3.0  # dB over the preset's PSNR up to which there is no correction
# Gaussians that are not removed for FAR_MORE. They are a kilobyte or two, and each shows.
FEW = 16
SAME = 0.004  # relative difference up to which two counts are the same
TELLING = 0.25  # least doublings between two exports from which a slope is derived
# Largest reduction in doublings. Many at once end worse than a few after one another.
MOST_REDUCED = -0.5
# Ratio of the last to the first count, up to which a fit of a drawing whose edges are ellipses
# grows (docs/decisions/enlarged.md).
FOR_EDGES = 1.4
FLATTEST = 1.5  # least slope in dB for each doubling
STEEPEST = 12.0  # largest slope in dB for each doubling


class Corrections:
    """The exports of a search for what a plan asks for, and how to correct their count.

    made    exports in order
    detail  what measuring against the reference adds to the score at the fit's, see Aim
    """

    def __init__(self, plan: Plan, limits: Limits) -> None:
        self.made: list[Export] = []
        self.detail = 0.0
        self._plan, self._limits = plan, limits
        self._aim, self._limit = plan.aim, plan.goal.byte_limit

    def score(self, export: Export) -> float:
        """Score of an export's rasterised SVG against the photo; -inf if it was not rasterised."""
        if self._aim is None or math.isnan(export.score):
            return -math.inf
        return self._aim.with_detail(export.score, self.detail)

    def next(self, count: int, cap: Cap) -> int:
        """Return the count of the next export, the present one if no correction is needed.

        cap  the largest count, by the bytes of the last export too

        Set the stop reason of the limits to the one that decides.
        """
        last, aim, limits = self.made[-1], self._aim, self._limits
        if not count:
            lacking = aim is not None and not aim.reached(self.score(last))
            room = last.size < (self._limit or math.inf)
            return min(FIRST_ROUND, cap.gaussians) if lacking and room else 0
        if self._limit is not None:
            if last.size > TOO_LARGE * self._limit:
                limits.stop_reason = "max_bytes"
                return min(self._filling(cap), count - 1)
            if last.size > self._limit and aim is None:  # a few are pruned
                limits.stop_reason = "max_bytes"
                return count
        if aim is not None:
            wanted = self._aimed(aim, count, cap)
        elif self._limit is not None:
            wanted = self._filled(count, cap, self._limit)
        else:
            wanted = self._enough(count, cap)
        return count if abs(wanted - count) <= SAME * count else wanted

    def _aimed(self, aim: Aim, count: int, cap: Cap) -> int:
        """Return the count for a target."""
        score = self.score(self.made[-1])
        if aim.value - aim.too_little <= score <= aim.value + aim.too_good:
            return count
        missing = (aim.value + aim.over - score) / self._slope()
        return min(round(count * 2 ** max(min(missing, 2.0), -2.0)), cap.gaussians)

    def _filled(self, count: int, cap: Cap, limit: int) -> int:
        """Return the count for a limit of bytes: as many as it allows, until no more show."""
        last = self.made[-1]
        share = FULL if len(self.made) < 2 else NEARLY_FULL
        if last.size > share * limit or last.model >= self._plan.enough:
            return count
        wanted = min(4 * count, self._filling(cap))
        if wanted > count:
            self._limits.stop_reason = cap.name
        return wanted

    def _enough(self, count: int, cap: Cap) -> int:
        """Return the count for the preset's PSNR."""
        missing = self._plan.enough - self.made[-1].model
        given = self._plan.is_budget or self._plan.goal.count is not None
        too_few = missing > 0 and self._limits.stop_reason != "enough"
        if given or too_few or -FAR_MORE <= missing <= LESS_THAN_ENOUGH:
            return count
        needed = count * 2 ** max(min(missing / self._slope(), 2.0), MOST_REDUCED)
        if self._plan.covering:  # what a fit loses where soft shapes become edges, few regain
            most = math.ceil(FOR_EDGES * len(self.made[0].scene))
            cap = fewest(cap, Cap(most, "gain"))
        if missing < 0:
            needed = max(needed, min(count, FEW))
        self._limits.stop_reason = "enough" if needed < cap.gaussians else cap.name
        return min(math.ceil(needed), cap.gaussians)

    def _filling(self, cap: Cap) -> int:
        """Return the count that fills the limit of bytes, between files on both sides of it."""
        assert self._limit is not None
        below = max((e for e in self.made if e.size <= self._limit), key=_size, default=None)
        above = min((e for e in self.made if e.size > self._limit), key=_size, default=None)
        if below is None or above is None or len(below.scene) >= len(above.scene):
            return cap.gaussians
        share = (self._limit - below.size) / (above.size - below.size)
        return int(len(below.scene) + share * (len(above.scene) - len(below.scene)))

    def _slope(self) -> float:
        """Score gained per doubling, by the last two exports or by the growth.

        Without an aim the score is PSNR in dB.
        """
        aim, usual = self._aim, self._limits.slope
        if aim is not None and aim.slope is not None:
            usual = aim.slope
        slope = usual
        if len(self.made) >= 2:
            before, last = self.made[-2:]
            doublings = math.log2(len(last.scene) / max(len(before.scene), 1))
            if abs(doublings) > TELLING:
                rise = last.model - before.model
                if aim is not None:
                    rise = self.score(last) - self.score(before)
                slope = rise / doublings
        least, most = (FLATTEST, STEEPEST) if aim is None else aim.slopes
        if slope <= 0:  # of fits that scatter or diverge
            slope = usual
        return min(max(slope, least), most)

    def _pruning(self, export: Export) -> float:
        """Return about what pruning an export to its bytes costs, in dB."""
        if not self._limit or export.size <= self._limit:
            return 0.0
        count = len(export.scene)
        kept = count * self._limit / export.size
        below = [e for e in self.made if e.size <= self._limit and len(e.scene) < count]
        if below:  # where masks give way to gradients a shape takes several times the usual bytes
            nearest = max(below, key=_size)
            share = (self._limit - nearest.size) / (export.size - nearest.size)
            kept = len(nearest.scene) + share * (count - len(nearest.scene))
        return PRUNED * math.log2(count / max(kept, 1))

    def best(self) -> Export:
        """The smallest file that meets every target, else the nearest one."""
        limit, aim = self._limit or math.inf, self._aim
        tolerated = limit if aim is not None else TOO_LARGE * limit  # pruned to it
        small = [e for e in self.made if e.size <= tolerated]
        if not small:
            return min(self.made, key=lambda e: e.size)
        if aim is not None:
            return _nearest(small, lambda e: self.score(e) - aim.value, aim.tolerance, aim.too_good)
        if self._plan.goal.count is not None or limit < math.inf or self._plan.is_budget:
            return max(small, key=lambda e: e.model - self._pruning(e))
        enough = self._plan.enough
        return _nearest(small, lambda e: e.model - enough, LESS_THAN_ENOUGH, FAR_MORE)


def _size(export: Export) -> int:
    return export.size


def _nearest(
    exports: list[Export], over: Callable[[Export], float], little: float, much: float
) -> Export:
    """The smallest file of those that are `little` under the goal to `much` over it.

    Otherwise the smallest of those beyond, otherwise the nearest one below.
    """
    good = [e for e in exports if over(e) >= -little]
    close = [e for e in good if over(e) <= much]
    return min(close or good, key=lambda e: e.size) if good else max(exports, key=over)
