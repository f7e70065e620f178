"""The time budget of a run: how many Gaussians and how long a fit its time limit allows.

What a step and the export cost is predicted by a rule, in seconds of one thread of the machine that
it was measured on, and corrected by the speed of the steps so far (docs/decisions/time.md).
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.schedule import GROWTH_SHARE, QUANTIZED_FROM, REDUCED_STEPS, refinement_reduction
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.small import is_drawing
from gauss2svg.raster import DEFAULT_RENDERER

# Of a step of the fit: at least, for a pixel in growth and after it, and for a Gaussian. And once,
# afterwards, for writing, rasterising and measuring.
_STEP, _STEP_PIXEL, _STEP_GAUSSIAN = 5e-4, (1.6e-8, 3.3e-8), 8e-7
_EXPORT, _EXPORT_PIXEL, _EXPORT_GAUSSIAN = 0.05, 1.8e-6, 1.8e-4
_SLOW_PICTURE = 1.4  # times the predicted seconds that steps of some pictures take
_SECOND_THREAD = 0.8  # what each further thread adds to the speed of the first, pixels alone
# Steps that a fit should have, to a photo and to a drawing: with fewer it gains more from time than
# from Gaussians. And of them those of growth, at the cost of the last round.
STEPS, STEPS_OF_DRAWING, _GROWING = 100, 180, 0.2
_PRIOR_S = 0.03  # predicted seconds of steps that count as taken before any is
# Times the predicted seconds that are left in refinement, under which Gaussians are removed and
# over which some are added; in between it has fewer or more steps.
_TOO_LATE, _TOO_EARLY = 0.5, 1.5
_AT_ONCE = 0.7  # share of the Gaussians that is kept
_ESTIMATE_AT = 0.4  # share of the fit done when the export is predicted for its count
_MOST_MEASURING = 0.2  # of the time left, for measuring at the photo's size
_LEAST_FIT_S = 0.15  # else what a limit too short has is hardly a picture
_MOST_RESERVED = 0.6  # of the time left; if the export needs more, Gaussians are removed
_FEWEST = 150  # Gaussians, however short the time is: fewer steps then do


def steps_for(plan: Plan, image: NDArray[np.float32]) -> int:
    """Steps that a fit to an image should have where time is limited, those given first."""
    given = plan.options.fit.iterations
    if given is not None or plan.options.goal.time_limit is None:
        return given or STEPS
    return STEPS_OF_DRAWING if is_drawing(image) else STEPS


def gaussians_within(limit_s: float, size: tuple[int, int], measured: int, threads: int = 1) -> int:
    """The count that so many seconds allow, before any step shows how fast they are."""
    budget = TimeBudget(time.perf_counter() + limit_s, size, measured, threads)
    return budget.most_gaussians(0, 0.0)


class TimeBudget:
    """The time left, and how much of it the fit may use.

    deadline  by time.perf_counter() in s, or None without a limit
    size      width and height in px of the image that the fit runs on
    measured  pixels of the photo, at whose size the file is measured if there is time
    threads   of the fit
    steps     that the fit should have
    renderer  that rasterises the file
    """

    def __init__(
        self,
        deadline: float | None,
        size: tuple[int, int],
        measured: int,
        threads: int = 1,
        steps: int = STEPS,
        renderer: str = DEFAULT_RENDERER,
    ) -> None:
        self.deadline = deadline
        # Where time is short the file is measured at the size of the fit.
        self.measures_small = (
            deadline is not None
            and _EXPORT_PIXEL * measured > _MOST_MEASURING * (deadline - time.perf_counter())
        )
        self._size = size
        self._measured = size[0] * size[1] if self.measures_small else measured
        self._threaded = 1 + _SECOND_THREAD * (threads - 1)
        self._steps = steps
        self._predicted = self._taken = 0.0
        self._last: float | None = None  # end of the last step, None if something else came after
        self._estimated = deadline is None
        self._renderer = renderer

    def stepped(self, pixels: int, count: int, growing: bool) -> None:
        """Note that a step with so many Gaussians on a target of so many pixels is over."""
        if self.deadline is None:
            return
        now = time.perf_counter()
        if self._last is not None:
            self._taken += now - self._last
            self._predicted += self._step(pixels, count, growing)
        self._last = now

    def most_gaussians(self, count: int, done: float) -> int:
        """The largest count that leaves time for its steps and its export.

        count, done  the present count, and the progress of the fit in 0..1

        In refinement the present count, unless it is far off.
        """
        self._last = None
        left, least = self._left_s(), 1
        if done > GROWTH_SHARE:
            needed = self._needed_s(count, done)
            if done >= QUANTIZED_FROM or _TOO_LATE * needed <= left <= _TOO_EARLY * needed:
                return count
            least = int(_AT_ONCE * count)
        low, high = _FEWEST, 2 * _FEWEST
        while self._needed_s(high, done) <= left:
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self._needed_s(middle, done) <= left else (low, middle)
        return max(low, least)

    @property
    def is_over(self) -> bool:
        """Whether what is left is needed to write and measure a small file."""
        return self.deadline is not None and self._left_s() < self._export_s(_FEWEST)

    def fit_deadline(self, count: int, share: float = 1.0) -> float | None:
        """End of a fit of so many Gaussians, or of this share of it; None without a limit."""
        if self.deadline is None:
            return None
        left = self._left_s()
        reserved = min(self._export_s(count), _MOST_RESERVED * left)
        return time.perf_counter() + max(share * (left - reserved), _LEAST_FIT_S)

    def reserve(
        self, done: float, count: int, estimate_s: Callable[[], float]
    ) -> tuple[float, int | None] | None:
        """Once in a fit, its new deadline, and the largest count to export in time or None.

        done        share of the fit that is over
        count       of Gaussians
        estimate_s  measures on a sample how long writing, rasterising and measuring will take, by a
                    renderer that the rule is not for
        """
        if self.deadline is None or self._estimated or done <= _ESTIMATE_AT:
            return None
        self._estimated = True
        reserve = self._export_s(count)
        if self._renderer != DEFAULT_RENDERER:
            reserve = estimate_s()
            self._last = None  # the sample was no step
        share = min(_MOST_RESERVED * max(self._left_s(), _LEAST_FIT_S) / reserve, 1.0)
        most = min(count, max(_FEWEST, int(count * share))) if share < 1 else None
        return self.deadline - share * reserve, most

    @property
    def _slowness(self) -> float:
        """Seconds that a predicted second takes; the first few steps say little of that."""
        return (self._taken + _PRIOR_S) / (self._predicted + _PRIOR_S)

    def _left_s(self) -> float:
        assert self.deadline is not None
        return max(self.deadline - time.perf_counter(), 0.0)

    def _needed_s(self, count: int, done: float) -> float:
        """Predicted seconds of the rest of a fit of so many Gaussians, and of its export."""
        pixels = self._size[0] * self._size[1]
        growing = max(1 - done / GROWTH_SHARE, 0.0) * _GROWING
        refining = min(1 - done, 1 - GROWTH_SHARE)
        factor = refinement_reduction(max(done, GROWTH_SHARE), count, *self._size)
        reduced = REDUCED_STEPS if factor > 1 else 0.0
        refined = (1 - reduced + reduced / factor**2) * pixels
        steps = growing * self._step(pixels, count, True)
        steps += refining * self._step(refined, count, False)
        return self._slowness * self._steps * steps + self._export_s(count)

    def _step(self, pixels: float, count: int, growing: bool) -> float:
        by_pixels = _STEP_PIXEL[not growing] * pixels / self._threaded
        return _STEP + by_pixels + _STEP_GAUSSIAN * count

    def _export_s(self, count: int) -> float:
        """Seconds of the export: those of a slow machine, not of a picture whose steps are slow."""
        machine = max(self._slowness / _SLOW_PICTURE, 1.0)
        return machine * (_EXPORT + _EXPORT_PIXEL * self._measured + _EXPORT_GAUSSIAN * count)
