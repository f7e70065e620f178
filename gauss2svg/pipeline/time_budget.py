"""The time budget of a run: how many Gaussians and how long a fit its time limit allows.

What a step and the export cost is predicted by a rule, in seconds of one thread of the machine that
it was measured on, and corrected by the speed of the steps so far (docs/decisions/time.md).
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit import schedule
from gauss2svg.pipeline.drawings import is_drawing
from gauss2svg.pipeline.plan import Plan
from gauss2svg.raster import DEFAULT_RENDERER


@dataclass(frozen=True)
class TimeTuning:
    """What steps and the export cost, in s of one thread, and how time is spent.

    docs/decisions/time.md

    step                 s of a step of the fit at least
    step_pixel_growing   s of a step in growth for each pixel
    step_pixel_refining  the same after growth
    step_gaussian        s of a step for each Gaussian
    export               s of writing, rasterising and measuring at least
    export_pixel         s of these for each pixel that is measured
    export_gaussian      s of these for each Gaussian
    slow_picture         times the predicted seconds that steps of some pictures take
    second_thread        what each further thread adds to the speed of the first, pixels alone
    steps                steps that a fit should have: with fewer it gains more from time than from
                         Gaussians
    steps_of_drawing     the same for a drawing
    growing              share of growth in these steps, at the cost of the last round
    prior_s              predicted seconds of steps that count as taken before any is
    too_late             times the predicted seconds that are left in refinement, under which
                         Gaussians are removed; up to the next one it has fewer or more steps
    too_early            times the same, over which some are added
    at_once              share of the Gaussians that is kept at least, where some are removed
    estimate_at          share of the fit that is over when the export is predicted for its count
    most_measuring       share of the time left, for measuring at the reference's size
    least_fit_s          s of a fit at least, else what a limit too short has is hardly a picture
    most_reserved        share of the time left, for the export; if that needs more, Gaussians are
                         removed
    fewest               Gaussians, however short the time is: fewer steps then do
    """

    step: float = 5e-4
    step_pixel_growing: float = 1.6e-8
    step_pixel_refining: float = 3.3e-8
    step_gaussian: float = 8e-7
    export: float = 0.05
    export_pixel: float = 1.8e-6
    export_gaussian: float = 1.8e-4
    slow_picture: float = 1.4
    second_thread: float = 0.8
    steps: int = 100
    steps_of_drawing: int = 180
    growing: float = 0.2
    prior_s: float = 0.03
    too_late: float = 0.5
    too_early: float = 1.5
    at_once: float = 0.7
    estimate_at: float = 0.4
    most_measuring: float = 0.2
    least_fit_s: float = 0.15
    most_reserved: float = 0.6
    fewest: int = 150


TUNING = TimeTuning()


def steps_for(plan: Plan, image: NDArray[np.float32]) -> int:
    """Steps that a fit to an image should have where time is limited, those given first."""
    given = plan.options.fit.iterations
    if given is not None or plan.options.goal.time_limit is None:
        return given or TUNING.steps
    return TUNING.steps_of_drawing if is_drawing(image) else TUNING.steps


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
        self.measures_small = (
            deadline is not None
            and TUNING.export_pixel * measured
            > TUNING.most_measuring * (deadline - time.perf_counter())
        )
        self._size = size
        self._measured = size[0] * size[1] if self.measures_small else measured
        self._threaded = 1 + TUNING.second_thread * (threads - 1)
        self._steps = steps or TUNING.steps
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
        if done > schedule.TUNING.growth_share:
            needed = self._needed_s(count, done)
            if (
                done >= schedule.TUNING.quantized_from
                or TUNING.too_late * needed <= left <= TUNING.too_early * needed
            ):
                return count
            least = int(TUNING.at_once * count)
        low, high = TUNING.fewest, 2 * TUNING.fewest
        while self._needed_s(high, done) <= left:
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if self._needed_s(middle, done) <= left else (low, middle)
        return max(low, least)

    @property
    def is_over(self) -> bool:
        """Whether what is left is needed to write and measure a small file."""
        return self.deadline is not None and self._left_s() < self._export_s(TUNING.fewest)

    def fit_deadline(self, count: int, share: float = 1.0) -> float | None:
        """End of a fit of so many Gaussians, or of this share of it; None without a limit."""
        if self.deadline is None:
            return None
        left = self._left_s()
        reserved = min(self._export_s(count), TUNING.most_reserved * left)
        return time.perf_counter() + max(share * (left - reserved), TUNING.least_fit_s)

    def reserve(
        self, done: float, count: int, estimate_s: Callable[[], float]
    ) -> tuple[float, int | None] | None:
        """Once in a fit, its new deadline, and the largest count to export in time or None.

        done        share of the fit that is over
        count       of Gaussians
        estimate_s  measures on a sample how long writing, rasterising and measuring will take, by a
                    renderer that the rule is not for
        """
        if self.deadline is None or self._estimated or done <= TUNING.estimate_at:
            return None
        self._estimated = True
        reserve = self._export_s(count)
        if self._renderer != DEFAULT_RENDERER:
            reserve = estimate_s()
            self._last = None  # the sample was no step
        share = min(TUNING.most_reserved * max(self._left_s(), TUNING.least_fit_s) / reserve, 1.0)
        most = min(count, max(TUNING.fewest, int(count * share))) if share < 1 else None
        return self.deadline - share * reserve, most

    @property
    def _slowness(self) -> float:
        """Seconds that a predicted second takes; the first few steps say little of that."""
        return (self._taken + TUNING.prior_s) / (self._predicted + TUNING.prior_s)

    def _left_s(self) -> float:
        assert self.deadline is not None
        return max(self.deadline - time.perf_counter(), 0.0)

    def _needed_s(self, count: int, done: float) -> float:
        """Predicted seconds of the rest of a fit of so many Gaussians, and of its export."""
        pixels = self._size[0] * self._size[1]
        grown = schedule.TUNING.growth_share
        growing = max(1 - done / grown, 0.0) * TUNING.growing
        refining = min(1 - done, 1 - grown)
        factor = schedule.refinement_reduction(max(done, grown), count, *self._size)
        reduced = schedule.TUNING.reduced_steps if factor > 1 else 0.0
        refined = (1 - reduced + reduced / factor**2) * pixels
        steps = growing * self._step(pixels, count, True)
        steps += refining * self._step(refined, count, False)
        return self._slowness * self._steps * steps + self._export_s(count)

    def _step(self, pixels: float, count: int, growing: bool) -> float:
        each = TUNING.step_pixel_growing if growing else TUNING.step_pixel_refining
        return TUNING.step + each * pixels / self._threaded + TUNING.step_gaussian * count

    def _export_s(self, count: int) -> float:
        """Seconds that an export takes: more on a slow machine, not after a fit of slow steps."""
        machine = max(self._slowness / TUNING.slow_picture, 1.0)
        return machine * (
            TUNING.export + TUNING.export_pixel * self._measured + TUNING.export_gaussian * count
        )
