"""Densification policies: how many Gaussians a fit has.

A fit asks its policy after every round how many Gaussians the next one has, and a few times during
refinement whether the count should change. gauss2svg.pipeline.search.limits has the policy of a
count that adapts to the image.
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

ADJUST_AT = (0.45, 0.55, 0.65)  # progress of refinement at which a count may change


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
