"""How many Gaussians a search by count may have: by the plan, by its bytes, by its seconds."""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

from gauss2svg.fit import densification, schedule
from gauss2svg.fit.densification import (
    AdaptiveCount,
    DensificationPolicy,
    FixedCount,
    GrowthLimits,
    Revise,
    Snapshot,
)
from gauss2svg.pipeline import presets
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.presets import CAP_FOR_TARGET
from gauss2svg.pipeline.search.export import Exporter
from gauss2svg.pipeline.time_budget import TimeBudget

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
    """The smallest of these caps, the first of equal ones."""
    return min((first, *others), key=lambda cap: cap.gaussians)


class Growth:
    """The end of a fit's growth, revised as the fit shows what its shapes cost.

    cap         the largest count so far
    for_target  cap of the corrections towards a target
    expected    count of a fit that is limited by time alone, else None
    """

    def __init__(self, plan: Plan, exporter: Exporter, budget: TimeBudget, pixels: int) -> None:
        self._plan, self._exporter, self._budget = plan, exporter, budget
        self._usual = presets.BYTES_IN_INKS if plan.in_inks else presets.USUAL_BYTES
        self._bytes_each = self._usual * (presets.GZIPPED_SHARE if plan.counts_gzipped else 1.0)
        self._bytes_known = False
        self.for_target = 0
        self.expected: int | None = None
        self.cap = Cap(0, "gaussians")
        self._first: GrowthLimits | None = None  # of a count that adapts
        if plan.count_adapts:
            self._first = self._first_limits(pixels)
            self.cap = Cap(self._first.cap, self._first.cap_named)
            if plan.only_time_limits:
                self.expected = min(self._first.cap, budget.most_gaussians(0, 0.0))

    def policy(self, revise: Revise) -> DensificationPolicy:
        """The policy of a fit that begins."""
        if self._first is None:
            return FixedCount(self._plan.fit_config)
        if self.expected is None:
            return AdaptiveCount(self._first, revise)
        last_round = self.expected >> (schedule.ROUNDS - 1)
        first = max(densification.FIRST_ROUND, last_round)
        return AdaptiveCount(dataclasses.replace(self._first, cap=self.expected), revise, first)

    @property
    def count(self) -> int:
        """About the count that the fit ends with, at most."""
        return self.expected or self.cap.gaussians

    def _first_limits(self, pixels: int) -> GrowthLimits:
        plan, aim, kilobytes = self._plan, self._plan.aim, self._usual / 1000
        each = PIXELS_EACH_OF_BUDGET if plan.is_budget else PIXELS_EACH
        if plan.count is None:
            cap = min(plan.preset.cap, max(1, pixels // each))
            limits = GrowthLimits(plan.preset.gain, kilobytes, plan.enough, cap)
            self.for_target = max(cap, min(CAP_FOR_TARGET, pixels))
        else:
            self.for_target = cap = plan.count
            limits = GrowthLimits(0.0, kilobytes, math.inf, cap, cap_named="gaussians")
        if plan.byte_limit is not None or aim is not None:  # the best, not what is worth its bytes
            limits = dataclasses.replace(limits, gain=0.0)
        if aim is not None and aim.slope is None:  # that of the growth, which can aim at it
            wanted = aim.value + aim.over + 10 * math.log10(1 + WRITING_LOSS)
            limits = dataclasses.replace(
                limits, psnr=wanted, psnr_named=aim.name, cap=self.for_target
            )
        # Else growth ends at what the preset calls enough, and corrections find the score.
        return limits

    def revised(self, limits: GrowthLimits, now: Snapshot) -> GrowthLimits:
        """The limits of a fit, capped by the bytes and the time."""
        cap = self.by_bytes(now)
        if self._budget.deadline is not None:
            most = self._by_time(now, cap.gaussians)
            cap = fewest(cap, Cap(most, "time_limit"))
        return dataclasses.replace(limits, cap=cap.gaussians, cap_named=cap.name)

    def by_bytes(self, now: Snapshot, size: int | None = None) -> Cap:
        """Return the largest count so far, or the one that fills the limit of bytes.

        Before the last steps it is a little more than that, because some shapes go.
        size  bytes of the scene's file, once it has been written
        """
        limit, exporter = self._plan.byte_limit, self._exporter
        refining = now.done > schedule.GROWTH_SHARE
        if limit is None:
            return self.cap
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

    def _by_time(self, now: Snapshot, most: int) -> int:
        if self._plan.only_time_limits:
            return self._budget.most_gaussians(now.count, now.done)
        return max(now.count, 1) if now.late else most
