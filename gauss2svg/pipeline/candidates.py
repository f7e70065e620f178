"""The candidates of a search: how many Gaussians the next one gets, and which is the best.

Targets apply to the rasterised SVG. A search runs at the size of the fit; the additional error of
a larger photo is measured once and added.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from gauss2svg.fit.densification import FIRST_ROUND
from gauss2svg.pipeline.candidate import Candidate
from gauss2svg.pipeline.plan import Plan

# PSNR (dB) from which more Gaussians do not show: an error of half a level of 255 has 54.1.
INDISTINGUISHABLE = 54.0
# Share of the allowed bytes from which a file counts as full, before and after one correction, and
# from which they are what ended the fit.
FULL, _NEARLY_FULL, BOUND = 0.985, 0.96, 0.93
# Times the allowed bytes from which a fit is corrected; fewer are lost by pruning.
_TOO_LARGE = 1.02
_PRUNED = 8.0  # dB for each halving of a file by pruning alone
# dB under and over the preset's PSNR up to which there is no correction. Together less than the
# presets lie apart, so that none ends under a cheaper one (docs/decisions/monotone.md).
_LESS_THAN_ENOUGH, _FAR_MORE = 0.8, 3.0
# Gaussians that are not removed for that: they are a kilobyte or two, and each shows.
_FEW = 16
_SAME = 0.004  # relative difference up to which counts are the same
_TELLING = 0.25  # doublings between two candidates from which a slope is derived
# Doublings of a reduction at most: many at once end worse than a few after one another.
_MOST_REDUCED = -0.5
_SLOPES = 1.5, 12.0  # dB per doubling; slopes are clipped to these


class Limit(NamedTuple):
    """The largest count, and the stop reason when it is reached."""

    gaussians: int
    name: str


def fewest(first: Limit, *others: Limit) -> Limit:
    """The smallest of these limits, the first of equal ones."""
    return min((first, *others), key=lambda limit: limit.gaussians)


class Correction(NamedTuple):
    """The count of the next candidate, and the stop reason once it is reached."""

    gaussians: int
    stop_reason: str


class Candidates:
    """The candidates of the search for the targets of a plan.

    A file without Gaussians has empty_bytes.

    made    candidates in order
    detail  what measuring at the photo's size adds to the score at the fit's, see Aim
    """

    def __init__(self, plan: Plan, empty_bytes: int) -> None:
        self.made: list[Candidate] = []
        self.detail = 0.0
        self._plan, self._empty = plan, empty_bytes
        self._max_bytes = plan.byte_limit
        self._aim = plan.aim

    def score(self, candidate: Candidate) -> float:
        """That of its rasterised SVG against the photo; -inf if it was not rasterised."""
        if self._aim is None or math.isnan(candidate.score):
            return -math.inf
        return self._aim.with_detail(candidate.score, self.detail)

    def correction(
        self, count: int, limit: Limit, stop_reason: str, usual_slope: float
    ) -> tuple[int | None, str]:
        """Count of the next candidate, None where no correction is needed; and the stop reason.

        count        the present count
        limit        the largest count, by the bytes of the last candidate too
        stop_reason  of the growth
        usual_slope  dB gained per doubling during growth
        """
        last, cap, aim = self.made[-1], limit.gaussians, self._aim
        if not count:
            lacking = aim is not None and not aim.reached(self.score(last))
            room = last.size < (self._max_bytes or math.inf)
            return (min(FIRST_ROUND, cap) if lacking and room and cap else None), stop_reason
        if self._max_bytes is not None:
            if last.size > _TOO_LARGE * self._max_bytes:
                return min(cap, count - 1), "max_bytes"
            if last.size > self._max_bytes and aim is None:  # a few are pruned
                return None, "max_bytes"
        wanted, slope = count, self._slope(usual_slope)
        if aim is not None:
            score = self.score(last)
            if not aim.value - aim.too_little <= score <= aim.value + aim.too_good:
                missing = (aim.value + aim.over - score) / slope
                wanted = min(round(count * 2 ** max(min(missing, 2.0), -2.0)), cap)
        else:
            wanted, stop_reason = self._enough(count, Limit(cap, limit.name), stop_reason, slope)
        return (wanted if abs(wanted - count) > _SAME * count else None), stop_reason

    def _enough(self, count: int, most: Limit, stop_reason: str, slope: float) -> Correction:
        """Count for the preset's PSNR, or with a limit of bytes as many as they allow."""
        last, limit = self.made[-1], self._max_bytes
        if limit is not None:
            enough = max(self._plan.preset.enough, INDISTINGUISHABLE)
            share = FULL if len(self.made) < 2 else _NEARLY_FULL
            full = last.size > share * limit or last.model >= enough
            wanted = count if full else min(4 * count, most.gaussians)
            return Correction(wanted, most.name if wanted > count else stop_reason)
        missing = self._plan.preset.enough - last.model
        given = self._plan.is_budget or self._plan.count is not None
        if given or -_FAR_MORE <= missing <= _LESS_THAN_ENOUGH:
            return Correction(count, stop_reason)
        if missing > 0 and stop_reason != "enough":
            return Correction(count, stop_reason)
        needed = count * 2 ** max(min(missing / slope, 2.0), _MOST_REDUCED)
        if missing < 0:
            needed = max(needed, min(count, _FEW))
        stop_reason = "enough" if needed < most.gaussians else most.name
        return Correction(min(math.ceil(needed), most.gaussians), stop_reason)

    def _slope(self, usual: float) -> float:
        """Score gained per doubling, by the last two candidates or by the growth.

        Without an aim, and in `usual`, the score is PSNR in dB.
        """
        aim = self._aim
        if aim is not None and aim.slope is not None:
            usual = aim.slope
        slope = usual
        if len(self.made) >= 2:
            before, last = self.made[-2:]
            doublings = math.log2(len(last.scene) / max(len(before.scene), 1))
            if abs(doublings) > _TELLING:
                rise = last.model - before.model
                if aim is not None:
                    rise = self.score(last) - self.score(before)
                slope = rise / doublings
        least, most = _SLOPES if aim is None else aim.slopes
        if slope <= 0:  # of fits that scatter or diverge
            slope = usual
        return min(max(slope, least), most)

    def _pruning(self, candidate: Candidate) -> float:
        """About what pruning a candidate to its bytes costs, in dB."""
        over = candidate.size / self._max_bytes if self._max_bytes else 0.0
        return _PRUNED * math.log2(over) if over > 1 else 0.0

    def best(self) -> Candidate:
        """The smallest file that meets every target, else the nearest one."""
        limit = self._max_bytes or math.inf
        tolerated = limit if self._aim is not None else _TOO_LARGE * limit  # pruned to it
        small = [c for c in self.made if c.size <= tolerated]
        if not small:
            return min(self.made, key=lambda c: c.size)
        aim = self._aim
        if aim is None:
            if self._plan.count is not None or limit < math.inf or self._plan.is_budget:
                return max(small, key=lambda c: c.model - self._pruning(c))
            enough = self._plan.preset.enough
            return _nearest(small, lambda c: c.model - enough, _LESS_THAN_ENOUGH, _FAR_MORE)
        return _nearest(small, lambda c: self.score(c) - aim.value, aim.tolerance, aim.too_good)


def _nearest(
    candidates: list[Candidate], over: Callable[[Candidate], float], little: float, much: float
) -> Candidate:
    """The smallest file of those that are `little` under the goal to `much` over it.

    Otherwise the smallest of those beyond, otherwise the nearest one below.
    """
    good = [c for c in candidates if over(c) >= -little]
    close = [c for c in good if over(c) <= much]
    return min(close or good, key=lambda c: c.size) if good else max(candidates, key=over)
