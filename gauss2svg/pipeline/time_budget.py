"""The time budget of a run: how many Gaussians and how long a fit its time limit allows.

What a step and the export cost is predicted by a rule, in seconds of one thread of the machine that
it was measured on, and corrected by the speed of the steps so far (docs/decisions/time.md).
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit import schedule
from gauss2svg.pipeline.drawings import is_drawing
from gauss2svg.pipeline.plan import Plan
from gauss2svg.raster import DEFAULT_RENDERER

# Cost of steps and of the export, in s of one thread, and how time is spent
# (docs/decisions/time.md).
STEP = 5e-4  # least s of a step of the fit
STEP_PIXEL_GROWING = 1.6e-8  # s of a step for each pixel in growth
STEP_PIXEL_REFINING = 3.3e-8  # s of a step for each pixel after growth
STEP_GAUSSIAN = 8e-7  # s of a step for each Gaussian
EXPORT = 0.05  # least s of writing, rasterising and measuring
EXPORT_PIXEL = 1.8e-6  # s of an export for each pixel that is measured
EXPORT_GAUSSIAN = 1.8e-4  # s of an export for each Gaussian
SLOW_PICTURE = 1.4  # ratio of the longest to the predicted s of steps
SECOND_THREAD = 0.8  # speed that each further thread adds to that of the first, pixels alone
# Fewest steps of a fit. With fewer it gains more from time than from Gaussians.
STEPS = 100
STEPS_OF_DRAWING = 180  # fewest steps of the fit of a drawing
GROWING = 0.2  # share of these steps that is growth, at the cost of the last round
PRIOR_S = 0.03  # predicted s of steps that count as taken before any is
# Ratio of the time left to the predicted s of refinement, below which Gaussians are removed. Up
# to TOO_EARLY the number of steps changes.
TOO_LATE = 0.5
TOO_EARLY = 1.5  # ratio above which Gaussians are added
AT_ONCE = 0.7  # least share of the Gaussians that is kept at one removal
ESTIMATE_AT = 0.4  # progress of the fit at which the export is predicted for its count
MOST_MEASURING = 0.2  # largest share of the time left for measuring at the reference's size
# Fewest s of a fit. Within less a limit has hardly a picture.
LEAST_FIT_S = 0.15
# Largest share of the time left for the export. If that needs more, Gaussians are removed.
MOST_RESERVED = 0.6
FEWEST = 150  # fewest Gaussians, however short the time; there are fewer steps then


def steps_for(plan: Plan, image: NDArray[np.float32]) -> int:
    """Steps that a fit to an image should have where time is limited, those given first."""
    given = plan.options.fit.iterations
    if given is not None or plan.options.goal.time_limit is None:
        return given or STEPS
    return STEPS_OF_DRAWING if is_drawing(image) else STEPS


class TimeBudget:
    """The time left, and how much of it the fit may use.

    deadline  by time.perf_counter() in s, or None without a limit
    size      width and height in px of the image that the fit runs on
    measured  pixels of the reference, at whose size the file is measured if there is time
    threads   of the fit
    steps     that the fit should have; None: those of a photo
    renderer  that rasterises the file
    """

    def __init__(
        self,
        deadline: float | None = None,
        size: tuple[int, int] = (1, 1),
        measured: int = 1,
        threads: int = 1,
        steps: int | None = None,
        renderer: str = DEFAULT_RENDERER,
    ) -> None:
        self.deadline = deadline
        # Where time is short the file is measured at the size of the fit.
        self.measures_small = deadline is not None and EXPORT_PIXEL * measured > MOST_MEASURING * (
            deadline - time.perf_counter()
        )
        self._size = size
        self._measured = size[0] * size[1] if self.measures_small else measured
        self._threaded = 1 + SECOND_THREAD * (threads - 1)
        self._steps = steps or STEPS
        self._predicted = self._taken = 0.0
        self._last: float | None = None  # end of the last step, None if something else came after
        self._renderer = renderer
        self._estimated = deadline is None
        self._fit_ends: float | None = None

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
        if done > schedule.GROWTH_SHARE:
            needed = self._needed_s(count, done)
            if done >= schedule.QUANTIZED_FROM or TOO_LATE * needed <= left <= TOO_EARLY * needed:
                return count
            least = int(AT_ONCE * count)
        low, high = FEWEST, 2 * FEWEST
        while self._needed_s(high, done) <= left:
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self._needed_s(middle, done) <= left else (low, middle)
        return max(low, least)

    @property
    def is_over(self) -> bool:
        """Whether what is left is needed to write and measure a small file."""
        return self.deadline is not None and self._left_s() < self._export_s(FEWEST)

    def begin_fit(self, count: int, share: float = 1.0) -> None:
        """Let a fit of so many Gaussians begin, or one that has this share of the time."""
        if self.deadline is not None:
            left = self._left_s()
            reserved = min(self._export_s(count), MOST_RESERVED * left)
            self._fit_ends = time.perf_counter() + max(share * (left - reserved), LEAST_FIT_S)

    def fit_ends(self) -> float | None:
        """Return the end of the fit by time.perf_counter(), None without a limit."""
        return self._fit_ends

    def reserve(self, done: float, count: int, estimate_s: Callable[[], float]) -> int | None:
        """Reserve the time of the export, once in a fit; the largest count for it, None for any.

        done        share of the fit that is over
        count       of Gaussians
        estimate_s  measures how long writing, rasterising and measuring will take, by a renderer
                    that the rule is not for
        """
        if self.deadline is None or self._estimated or done <= ESTIMATE_AT:
            return None
        self._estimated = True
        reserve = self._export_s(count)
        if self._renderer != DEFAULT_RENDERER:
            reserve = estimate_s()
            self._last = None  # the sample was no step
        share = min(MOST_RESERVED * max(self._left_s(), LEAST_FIT_S) / reserve, 1.0)
        self._fit_ends = self.deadline - share * reserve
        return min(count, max(FEWEST, int(count * share))) if share < 1 else None

    @property
    def _slowness(self) -> float:
        """Seconds that a predicted second takes; the first few steps say little of that."""
        return (self._taken + PRIOR_S) / (self._predicted + PRIOR_S)

    def _left_s(self) -> float:
        assert self.deadline is not None
        return max(self.deadline - time.perf_counter(), 0.0)

    def _needed_s(self, count: int, done: float) -> float:
        """Predicted seconds of the rest of a fit of so many Gaussians, and of its export."""
        pixels = self._size[0] * self._size[1]
        grown = schedule.GROWTH_SHARE
        growing = max(1 - done / grown, 0.0) * GROWING
        refining = min(1 - done, 1 - grown)
        factor = schedule.refinement_reduction(max(done, grown), count, *self._size)
        reduced = schedule.REDUCED_STEPS if factor > 1 else 0.0
        refined = (1 - reduced + reduced / factor**2) * pixels
        steps = growing * self._step(pixels, count, True)
        steps += refining * self._step(refined, count, False)
        return self._slowness * self._steps * steps + self._export_s(count)

    def _step(self, pixels: float, count: int, growing: bool) -> float:
        each = STEP_PIXEL_GROWING if growing else STEP_PIXEL_REFINING
        return STEP + each * pixels / self._threaded + STEP_GAUSSIAN * count

    def _export_s(self, count: int) -> float:
        """Seconds that an export takes: more on a slow machine, not after a fit of slow steps."""
        machine = max(self._slowness / SLOW_PICTURE, 1.0)
        return machine * (EXPORT + EXPORT_PIXEL * self._measured + EXPORT_GAUSSIAN * count)
