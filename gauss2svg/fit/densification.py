"""Rules that say how many Gaussians a fit has: a count asked for, or what the scene asks for.

A fit asks its policy at the end of every round how many the next one shall have, and a
few times later, while all are refined, whether the count should change.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

from gauss2svg.fit.schedule import totals
from gauss2svg.scene import Scene

# What ended a fit. iterations: the steps asked for are done; gaussians: none were asked
# for; gain: another round would buy less than the quality's gain; enough: the quality's
# PSNR is reached; cap: the most Gaussians allowed; interrupted: whoever ran it wanted it to
# end; the others: the targets of that name.
STOP_REASONS = (
    "iterations", "gaussians", "gain", "enough", "cap", "target_psnr", "max_bytes", "time_limit",
    "interrupted",
)  # fmt: skip

FIRST_ROUND = 8
# A round has too few steps to settle: it gains about this share of what the same Gaussians
# buy in the end (0.57 to 0.76 on Kodak 04, 07 and 13 from 2048 to 4096).
_UNSETTLED_GAIN = 0.72
# dB that settling still brings, for each dB above 16.5: at the end of a round of growth,
# and at some points of the refinement. Read off traces of seven pictures, within about half.
_SETTLES_FROM = 16.5
_SETTLES_AFTER_ROUND = 0.28
_SETTLES_AFTER = {0.45: 0.055, 0.55: 0.034, 0.65: 0.029}
ADJUST_AT = tuple(_SETTLES_AFTER)
_MOST_CHANGE = 0.3  # of the count, at one of these points
_CLOSE_ENOUGH = 0.02  # a wanted count nearer to the present one than this changes nothing
_WORTH_A_ROUND = 1.1  # times the present count: a smaller round is not begun
_A_WHOLE_ROUND = 0.6  # doublings
_ACCELERATING = 1.7  # times what the round before bought a doubling; photos stay at 1.5
_LEAP = 4  # times the present count, at least
_SLOPES = 0.5, 8.0  # dB a doubling, the flattest and steepest that are believed


@dataclass
class Snapshot:
    """A fit as its policy sees it: Gaussians, share done in 0..1, how to measure and see it.

    scene() gives the Gaussians on the working canvas.
    """

    count: int
    done: float
    measure: Callable[[], float]
    scene: Callable[[], Scene]

    @classmethod
    def of_old(cls, count: int, done: float, psnr: float) -> Snapshot:
        """Of a round gone by, of which no more is known."""

        def scene() -> Scene:
            raise AssertionError("the scene of a round gone by is not kept")

        return cls(count, done, lambda: psnr, scene)

    @cached_property
    def psnr(self) -> float:
        """PSNR of the model on the working picture in dB, measured when first asked for."""
        return self.measure()


class DensificationPolicy(Protocol):
    """How many Gaussians; stop_reason says what ended the growth, once it has ended."""

    rounds: int
    stop_reason: str

    def grow(self, now: Snapshot) -> int:
        """Total of the next round; the present count ends the growth."""
        ...

    def adjust(self, now: Snapshot) -> int:
        """Total from now on, while all are refined; asked at each of ADJUST_AT."""
        ...

    def least_gain(self) -> float:
        """What a Gaussian must be worth, in dB, not to be removed before the last steps."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """What `load_state_dict` needs, for a checkpoint."""
        ...

    def load_state_dict(self, memory: dict[str, Any]) -> None:
        """Become as a policy for the same was that gave this memory."""
        ...


class FixedCount:
    """A count asked for, reached by a schedule of gauss2svg.fit.schedule."""

    def __init__(
        self,
        schedule: str,
        gaussians: int,
        iterations: int | None,
        per_round: int | None = None,
    ) -> None:
        self._totals = totals(schedule, gaussians, iterations, per_round)
        self.rounds = len(self._totals)
        self.stop_reason = "iterations" if gaussians else "gaussians"

    def grow(self, now: Snapshot) -> int:
        """The smallest total of the schedule above the present count."""
        return next((total for total in self._totals if total > now.count), now.count)

    def adjust(self, now: Snapshot) -> int:
        """As many as there are."""
        return now.count

    def least_gain(self) -> float:
        """Minus infinity: all are kept."""
        return -math.inf

    def state_dict(self) -> dict[str, Any]:
        """Nothing: it has not changed."""
        return {}

    def load_state_dict(self, memory: dict[str, Any]) -> None:
        """Nothing."""


@dataclass(frozen=True)
class GrowthLimits:
    """What growth is for.

    gain        dB that a kilobyte must buy; 0 for no such bound
    kilobytes   of the file, a Gaussian
    psnr        dB of the model that are enough; infinity for no such bound
    cap         most Gaussians
    psnr_named, cap_named  the bounds' names among STOP_REASONS
    """

    gain: float
    kilobytes: float
    psnr: float
    cap: int
    psnr_named: str = "enough"
    cap_named: str = "cap"


Revise = Callable[[GrowthLimits, Snapshot], GrowthLimits]


def as_given(limits: GrowthLimits, now: Snapshot) -> GrowthLimits:
    """The limits, unchanged."""
    return limits


class AdaptiveCount:
    """Rounds that double, until the limits are met or another round would not pay.

    If a doubling buys s dB, a kilobyte buys s / (n ln 2 kilobytes) dB at n Gaussians:
    growth aims at the n where that falls to the gain. It goes on nevertheless while rounds
    buy more and more, and the error, falling in proportion as in the last one, would be gone
    before the cap: a checkerboard's first squares buy next to nothing, its last ones
    everything. For the same reason growth that does not pay while Gaussians are few leaps
    once to a fourth of the cap, and comes back if that did not pay either.

    revise(limits, now) may put other limits in place at every question; it may be replaced.
    """

    def __init__(self, limits: GrowthLimits, revise: Revise = as_given) -> None:
        self.limits = limits
        # One for the leap.
        self.rounds = max(1, math.ceil(math.log2(max(limits.cap, 1) / FIRST_ROUND)) + 2)
        self.stop_reason = "cap"
        self.slope = 3.0  # dB a doubling
        self.revise = revise
        self._last: Snapshot | None = None
        self._before_leap: Snapshot | None = None
        self._paying = math.inf
        self._rise = math.inf

    def grow(self, now: Snapshot) -> int:
        """Twice as many, or as many as are still needed."""
        self.limits = self.revise(self.limits, now)
        last, self._last = self._last, now
        settled = now.psnr
        if last is not None:
            settled += _SETTLES_AFTER_ROUND * max(now.psnr - _SETTLES_FROM, 0.0)
            self._learn(now, last)
        wanted = self._wanted(now.count, settled)
        if self.stop_reason == "gain" and wanted < _WORTH_A_ROUND * now.count:
            if last is not None and last is self._before_leap:
                self._paying = last.count
                return last.count
            leap = self.limits.cap // 4
            if self._before_leap is None and leap > _LEAP * now.count:
                self._before_leap = now
                return leap
        if wanted < _WORTH_A_ROUND * now.count or not wanted:
            return now.count
        return min(math.ceil(wanted), max(2 * now.count, FIRST_ROUND))

    def _learn(self, now: Snapshot, last: Snapshot) -> None:
        """What the last round says of rounds to come."""
        bought = max(now.psnr - last.psnr, 0.0) / _UNSETTLED_GAIN
        added = now.count - last.count
        doublings = math.log2(now.count / last.count) if last.count else 1.0
        rise, before, self._rise = bought / doublings, self._rise, bought / doublings
        self._paying = self._worth(rise)
        if last is self._before_leap:
            pays = bought >= self.least_gain() * added
        else:
            pays = rise > _ACCELERATING * before
        share = 1 - 10 ** (-bought / 10)
        gone = last.count + added / share if share > 0 else math.inf
        if pays and gone <= self.limits.cap:
            self._paying = max(self._paying, gone)
        if doublings > _A_WHOLE_ROUND:  # a smaller one settles more than it adds
            self.slope = min(max(rise, _SLOPES[0]), _SLOPES[1])

    def adjust(self, now: Snapshot) -> int:
        """More or fewer where the PSNR it will settle at, or the file, is off the limits."""
        self.limits = self.revise(self.limits, now)
        rate = min(_SETTLES_AFTER.items(), key=lambda item: abs(item[0] - now.done))[1]
        settled = now.psnr + rate * max(now.psnr - _SETTLES_FROM, 0.0)
        wanted = self._wanted(now.count, settled)
        if abs(wanted - now.count) <= _CLOSE_ENOUGH * now.count:
            return now.count
        bounds = (1 - _MOST_CHANGE) * now.count, (1 + _MOST_CHANGE) * now.count
        return min(math.ceil(min(max(wanted, bounds[0]), bounds[1])), self.limits.cap)

    def least_gain(self) -> float:
        """What its bytes are worth."""
        return self.limits.gain * self.limits.kilobytes

    def state_dict(self) -> dict[str, Any]:
        """All that changes, and what the snapshots of rounds gone by told."""
        rounds = [None if s is None else [s.count, s.done, s.psnr] for s in self._snapshots()]
        return {
            "limits": dataclasses.asdict(self.limits),
            "stop_reason": self.stop_reason,
            "slope": self.slope,
            "paying": self._paying,
            "rise": self._rise,
            "rounds": rounds,
            "leaps": self._last is self._before_leap,
        }

    def load_state_dict(self, memory: dict[str, Any]) -> None:
        """Become as one was that gave this memory."""
        self.limits = GrowthLimits(**memory["limits"])
        self.stop_reason, self.slope = memory["stop_reason"], memory["slope"]
        self._paying, self._rise = memory["paying"], memory["rise"]
        self._last, self._before_leap = (
            None if r is None else Snapshot.of_old(*r) for r in memory["rounds"]
        )
        if memory["leaps"]:
            self._before_leap = self._last

    def _snapshots(self) -> tuple[Snapshot | None, Snapshot | None]:
        return self._last, self._before_leap

    def _wanted(self, count: int, settled: float) -> float:
        """The least of the counts that the bounds allow; says which bound that is."""
        if settled >= self.limits.psnr and not count:
            self.stop_reason = self.limits.psnr_named
            return 0
        missing = self.limits.psnr - settled
        needed = count * 2 ** min(missing / self.slope, 60.0) if count else math.inf
        bounds = (
            (needed, self.limits.psnr_named),
            (float(self.limits.cap), self.limits.cap_named),
            (self._paying, "gain"),
        )
        wanted, self.stop_reason = min(bounds)
        return wanted

    def _worth(self, rise: float) -> float:
        """Count at which a kilobyte buys no more than the gain, at `rise` dB a doubling."""
        price = self.limits.gain * self.limits.kilobytes * math.log(2)
        return rise / price if price else math.inf
