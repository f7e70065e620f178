"""Densification policies: how many Gaussians a fit has, a fixed count or as the image needs.

A fit asks its policy after every round how many Gaussians the next one has, and a few times during
refinement whether the count should change.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

from gauss2svg.fit.options import FitConfig
from gauss2svg.scene import Scene

# Why a fit ended. iterations: all steps are done; gaussians: the count is 0; gain: another round
# would gain less than the preset asks for; enough: the preset's PSNR is reached; cap: the maximum
# number of Gaussians is reached; interrupted: the caller stopped it; the others: the limits of
# that name. The targets of scores join them.
STOP_REASONS = (
    "iterations", "gaussians", "gain", "enough", "cap", "max_bytes", "time_limit", "interrupted",
)  # fmt: skip

# dB that convergence still brings by the progress of the refinement, for each dB of PSNR above
# CONVERGES_ABOVE (docs/decisions/fit.md).
_CONVERGES_AFTER = {0.45: 0.055, 0.55: 0.034, 0.65: 0.029}
ADJUST_AT = tuple(_CONVERGES_AFTER)


# Growth of a count that adapts to the image (docs/decisions/fit.md).
FIRST_ROUND = 8  # Gaussians of the first round
# Share of a doubling's final gain that a round of growth shows, because it has too few steps to
# converge.
GAIN_OF_A_ROUND = 0.72
CONVERGES_ABOVE = 16.5  # dB of PSNR above which convergence still brings something
# Share of the dB above CONVERGES_ABOVE that convergence brings after a round of growth.
CONVERGES_AFTER_ROUND = 0.28
MOST_CHANGE = 0.3  # largest change of the count at one adjustment, as a share of it
LEAST_CHANGE = 0.02  # share of the count below which an adjustment is not made
LEAST_ROUND = 1.1  # ratio of the wanted to the present count, below which no round begins
WHOLE_ROUND = 0.6  # doublings from which a round says enough about the slope
# Ratio of a doubling's gain to the one before that marks a drawing. Photos stay under 1.5.
ACCELERATING = 1.7
LEAP = 4  # ratio of the next count to the present one, from which a round is a leap
FLATTEST = 0.5  # least plausible slope, dB for each doubling
STEEPEST = 8.0  # largest plausible slope, dB for each doubling


@dataclass
class Snapshot:
    """A fit as its policy sees it: number of Gaussians and progress in 0..1.

    measure() gives the PSNR, scene() the Gaussians on the working canvas, late says whether growth
    has used its share of the time. Snapshots are equal if both numbers are.
    """

    count: int
    done: float
    measure: Callable[[], float] = dataclasses.field(compare=False)
    scene: Callable[[], Scene] = dataclasses.field(compare=False)
    late: bool = dataclasses.field(default=False, compare=False)

    @cached_property
    def psnr(self) -> float:
        """PSNR in dB of the model on the working image, measured on first use."""
        return self.measure()


class DensificationPolicy(Protocol):
    """Decides the number of Gaussians; stop_reason says why growth ended, once it has."""

    rounds: int
    stop_reason: str

    def grow(self, now: Snapshot) -> int:
        """Number of Gaussians after the next round; the present count ends the growth."""
        ...

    def adjust(self, now: Snapshot) -> int:
        """Number of Gaussians from now on, asked during refinement at each of ADJUST_AT."""
        ...

    def least_gain(self) -> float:
        """Gain in dB under which a Gaussian is pruned before the last steps."""
        ...

    def most(self, now: Snapshot) -> int:
        """Largest number of Gaussians to write, asked before the last steps."""
        ...


class FixedCount:
    """The number of Gaussians of a config, reached by its schedule."""

    def __init__(self, config: FitConfig) -> None:
        self._totals = config.totals
        self.rounds = len(self._totals)
        self.stop_reason = "iterations" if config.gaussians else "gaussians"

    def grow(self, now: Snapshot) -> int:
        """The smallest total of the schedule that exceeds the present count."""
        return next((total for total in self._totals if total > now.count), now.count)

    def adjust(self, now: Snapshot) -> int:
        """The present count."""
        return now.count

    def most(self, now: Snapshot) -> int:
        """The present count."""
        return now.count

    def least_gain(self) -> float:
        """Minus infinity: none is pruned."""
        return -math.inf


@dataclass(frozen=True)
class GrowthLimits:
    """The limits at which growth ends.

    gain        least gain of PSNR in dB for a kilobyte of the file; 0 for no such limit
    kilobytes   of the file for each Gaussian
    psnr        PSNR of the model in dB at which growth ends; infinity for no such limit
    cap         maximum number of Gaussians
    psnr_named, cap_named  what the last two are called in STOP_REASONS
    """

    gain: float
    kilobytes: float
    psnr: float
    cap: int
    psnr_named: str = "enough"
    cap_named: str = "cap"


Revise = Callable[[GrowthLimits, Snapshot], GrowthLimits]


def as_given(limits: GrowthLimits, now: Snapshot) -> GrowthLimits:
    """Return the limits unchanged."""
    return limits


class AdaptiveCount:
    """Doubles the count in each round, until a limit is met or another round would not pay.

    If a doubling gains s dB, a kilobyte gains s / (n ln 2 kilobytes) dB at n Gaussians: growth
    aims at the n where that falls to the limit's gain. It continues beyond while the gains of
    rounds accelerate and the squared error, falling in proportion to the last round's, would
    vanish before the cap: a checkerboard's first squares gain next to nothing, its last ones
    everything. For the same reason growth that does not pay at a small count leaps once to a
    fourth of the cap, and returns if that did not pay either.

    revise(limits, now) may replace the limits at every decision; it may be replaced itself.
    first is the count of the first round, by default first_round.
    """

    def __init__(
        self, limits: GrowthLimits, revise: Revise = as_given, first: int | None = None
    ) -> None:
        self.limits = limits
        self._first = first = FIRST_ROUND if first is None else first
        # One more for the leap.
        self.rounds = max(1, math.ceil(math.log2(max(limits.cap, 1) / first)) + 2)
        self.stop_reason = "cap"
        self.slope = 3.0  # dB a doubling
        self.revise = revise
        self._last: Snapshot | None = None
        self._before_leap: Snapshot | None = None
        self._paying = math.inf
        self._rise = math.inf

    def grow(self, now: Snapshot) -> int:
        """Twice the count, or less where a limit asks for less."""
        self.limits = self.revise(self.limits, now)
        last, self._last = self._last, now
        converged = now.psnr
        if last is not None:
            converged += CONVERGES_AFTER_ROUND * self._converging(now)
            self._learn(now, last)
        wanted = self._wanted(now.count, converged)
        if self.stop_reason == "gain" and wanted < LEAST_ROUND * now.count:
            if last is not None and last == self._before_leap:
                self._paying = last.count
                return last.count
            leap = self.limits.cap // 4
            if self._before_leap is None and leap > LEAP * now.count:
                self._before_leap = now
                return leap
        if wanted < LEAST_ROUND * now.count or not wanted:
            return now.count
        return min(math.ceil(wanted), max(2 * now.count, self._first))

    def _learn(self, now: Snapshot, last: Snapshot) -> None:
        """Extrapolate from the last round to the rounds to come."""
        gain = max(now.psnr - last.psnr, 0.0) / GAIN_OF_A_ROUND
        added = now.count - last.count
        doublings = math.log2(now.count / last.count) if last.count else 1.0
        rise, before, self._rise = gain / doublings, self._rise, gain / doublings
        self._paying = self._worth(rise)
        if last == self._before_leap:
            pays = gain >= self.least_gain() * added
        else:
            pays = rise > ACCELERATING * before
        share = 1 - 10 ** (-gain / 10)
        exact = last.count + added / share if share > 0 else math.inf
        if pays and exact <= self.limits.cap:
            self._paying = max(self._paying, exact)
        if doublings > WHOLE_ROUND:  # a smaller one gains more by convergence
            self.slope = min(max(rise, FLATTEST), STEEPEST)

    def adjust(self, now: Snapshot) -> int:
        """More or fewer where the extrapolated PSNR or file size is off the limits."""
        self.limits = self.revise(self.limits, now)
        rate = min(_CONVERGES_AFTER.items(), key=lambda item: abs(item[0] - now.done))[1]
        converged = now.psnr + rate * self._converging(now)
        wanted = self._wanted(now.count, converged)
        if abs(wanted - now.count) <= LEAST_CHANGE * now.count:
            return now.count
        change = MOST_CHANGE
        bounds = (1 - change) * now.count, (1 + change) * now.count
        return min(math.ceil(min(max(wanted, bounds[0]), bounds[1])), self.limits.cap)

    @staticmethod
    def _converging(now: Snapshot) -> float:
        return max(now.psnr - CONVERGES_ABOVE, 0.0)

    def most(self, now: Snapshot) -> int:
        """The largest number that the limits allow."""
        self.limits = self.revise(self.limits, now)
        return self.limits.cap

    def least_gain(self) -> float:
        """The gain that its bytes must bring."""
        return self.limits.gain * self.limits.kilobytes

    def _wanted(self, count: int, converged: float) -> float:
        """The least count that a limit allows, which becomes the stop_reason."""
        if converged >= self.limits.psnr and not count:
            self.stop_reason = self.limits.psnr_named
            return 0
        lacking = self.limits.psnr - converged
        needed = count * 2 ** min(lacking / self.slope, 60.0) if count else math.inf
        bounds = (
            (needed, self.limits.psnr_named),
            (float(self.limits.cap), self.limits.cap_named),
            (self._paying, "gain"),
        )
        wanted, self.stop_reason = min(bounds)
        return wanted

    def _worth(self, rise: float) -> float:
        """Count at which a kilobyte gains no more than the limit, at `rise` dB a doubling."""
        price = self.limits.gain * self.limits.kilobytes * math.log(2)
        return rise / price if price else math.inf
