"""What a search aims at, a target of one of the scores, and what a written file misses of it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.losses import psnr_of
from gauss2svg.measure.perceptual import measured
from gauss2svg.measure.roundtrip import RoundTrip
from gauss2svg.measure.scores import PSNR, Score, Search
from gauss2svg.pipeline.options import Goal


@dataclass(frozen=True, kw_only=True)
class Aim(Search):
    """A target, and how closely a search meets it.

    Scores and the target count by the sign of the score here, so that more is better.

    of     the score
    value  the target
    """

    of: Score
    value: float

    @property
    def name(self) -> str:
        """The option, which is also the stop reason once it is reached."""
        return self.of.option

    def score(self, raster: NDArray[np.float32], photo: NDArray[np.float32]) -> float:
        """The score of a raster against a photo of its shape."""
        return self.of.sign * measured(self.of, raster, photo)

    def known(self, found: RoundTrip) -> float | None:
        """The score of a written file where its round trip has measured it, as it does PSNR."""
        return found.psnr_lowest if self.of is PSNR else None

    def with_detail(self, score: float, detail: float) -> float:
        """The score against the reference of a file whose score at the size of the fit is known."""
        error = self._error(score)
        # A negative detail from another export may exceed the error, of which some always remains.
        left = max(error + detail, error * 0.05)
        if self.of.best is None:
            return psnr_of(left)
        return self.of.sign * self.of.best - left

    def detail(self, at_photo: float, at_fit: float) -> float:
        """What measuring one file against the reference adds to its error."""
        return self._error(at_photo) - self._error(at_fit)

    def _error(self, score: float) -> float:
        """What adds up over sizes: the squared error of decibels, else what the best lacks."""
        if self.of.best is None:
            return 10 ** (-score / 10)
        return self.of.sign * self.of.best - score

    def reached(self, score: float) -> bool:
        """Whether a score counts as reached."""
        return score >= self.value - self.tolerance

    def reported(self, score: float | None) -> dict[str, float]:
        """A score by its name, as a report has it."""
        return {} if score is None else {self.of.slug: self.of.sign * score}

    def text(self, score: float, form: str) -> str:
        """A score with its unit, as a line of text has it."""
        return f"{self.of.sign * score:{form}}{self.of.unit and ' '}{self.of.unit}"


def aim_of(goal: Goal) -> Aim | None:
    """The target of a goal."""
    score = goal.target
    if score is None or score.search is None:
        return None
    value = score.sign * getattr(goal, score.option)
    numbers = {f.name: getattr(score.search, f.name) for f in dataclasses.fields(Search)}
    return Aim(of=score, value=value, **numbers)


def unreached(
    goal: Goal, reached: float | None, size: int, seconds: float, reason: str, gaussians: int
) -> list[str]:
    """One line for each target or limit that the written result of so many Gaussians misses.

    reached  its score by the goal's aim, None without one
    """
    lines = []
    aim = aim_of(goal)
    if aim is not None and reached is not None and not aim.reached(reached):
        reported = reason not in (aim.name, "interrupted")
        ended = f", stopped by {reason.replace('_', ' ')}" if reported else ""
        name = "" if aim.of.unit else f"{aim.of.name} "
        target = f"target of {name}{aim.text(aim.value, 'g')}"
        lines.append(
            f"{target} not reached: {aim.text(reached, f'.{max(2, aim.of.digits)}f')}{ended}"
        )
    if goal.byte_limit is not None and size > goal.byte_limit:
        lines.append(
            f"limit of {goal.max_bytes} bytes exceeded: the file has {size} even without Gaussians"
        )
    elif reason == "max_bytes" and not gaussians:
        lines.append(
            f"limit of {goal.max_bytes} bytes leaves no room for a Gaussian: the file has none. "
            "Try a larger --max-bytes"
        )
    limit = goal.time_limit
    if limit is not None and seconds > 1.05 * limit + 0.25:
        lines.append(
            f"time limit of {limit:.3g} s exceeded: {seconds:.1f} s. Try a smaller --max-size"
        )
    return lines
