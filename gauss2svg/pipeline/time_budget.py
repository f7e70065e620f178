"""The time budget of a run: the Gaussians and the length of the fit that its time limit allows.

A rule predicts the seconds of steps and of the export on the machine on which it was measured. The
steps so far show how many times slower this machine is (docs/decisions/time.md).
"""

from __future__ import annotations

import math
import time

from gauss2svg.fit.schedule import GROWTH_SHARE
from gauss2svg.raster import DEFAULT_RENDERER

STEP = 5e-4  # s of a step of the fit, whatever its size
STEP_PIXEL = 3.3e-8  # s of a step for each pixel
STEP_GAUSSIAN = 8e-7  # s of a step for each Gaussian
GROWING = 0.5  # share of these seconds that a step takes during growth
SECOND_THREAD = 0.8  # speed that each further thread adds, relative to the first, for pixels
PRIOR_S = 0.03  # s that count as predicted and taken before the first step
EXPORT = 0.06  # s of an export: writing, rasterising and measuring
EXPORT_PIXEL = 1.3e-6  # s of an export for each pixel that is measured
EXPORT_GAUSSIAN = 5e-5  # s of an export for each Gaussian
COLORS_GAUSSIAN = 5e-5  # s of finding the colours of the file, for each Gaussian
STARTS = {"chromium": 2.0, "firefox": 2.0, "inkscape": 2.0}  # s until these programs rasterise
STEPS = 100  # steps of a fit. With fewer, it gains more from steps than from Gaussians
STEPS_OF_DRAWING = 180  # steps of the fit of a drawing
# Largest share of the time for the export. If that needs more, Gaussians are removed.
MOST_RESERVED = 0.6
LEAST_FIT_S = 0.15  # fewest s of a fit. A shorter fit hardly makes a picture
FEWEST = 150  # fewest Gaussians. If the time is too short for them, there are fewer steps


class TimeBudget:
    """The time left, and how much of it the fit may use.

    deadline  end of the run in s of time.perf_counter(), infinite without a limit
    pixels    number of pixels of the image that the fit runs on
    measured  number of pixels at which the file is measured
    threads   number of threads of the fit
    steps     number of steps that the fit should have
    renderer  the renderer that rasterises the file
    """

    def __init__(
        self,
        deadline: float = math.inf,
        pixels: int = 1,
        measured: int = 1,
        threads: int = 1,
        steps: int = STEPS,
        renderer: str = DEFAULT_RENDERER,
    ) -> None:
        self.deadline, self._steps = deadline, steps
        self._threaded = 1 + SECOND_THREAD * (threads - 1)
        self._step_s = STEP + STEP_PIXEL * pixels / self._threaded
        self._export_s = EXPORT + EXPORT_PIXEL * measured
        self._start_s = STARTS.get(renderer, 0.0)
        self._predicted = self._taken = PRIOR_S
        self._last = 0.0, -1  # time at which the last step ended, and its count
        self.begin_fit(0)

    def begin_fit(self, count: int, share: float = 1.0) -> None:
        """Begin a fit of about `count` Gaussians, which may take this share of the time."""
        self._begun, self._share, self._reserved_for = time.perf_counter(), share, count

    def stepped(self, pixels: int, count: int, done: float) -> None:
        """Note a step with `count` Gaussians on `pixels` pixels, at this progress of the fit.

        The first step with a new count, or after `most_gaussians`, is ignored, because its time
        includes other work.
        """
        now, growing = time.perf_counter(), done <= GROWTH_SHARE
        if count == self._last[1]:
            each_s = STEP + STEP_PIXEL * pixels / self._threaded + STEP_GAUSSIAN * count
            self._taken += now - self._last[0]
            self._predicted += (GROWING if growing else 1.0) * each_s
        self._last = now, count
        if not growing:
            self._reserved_for = count

    def most_gaussians(self, done: float, colors: bool = False) -> float:
        """Return the largest count for which the steps after `done` and the export have time.

        colors  whether the colours of the file must also be found in this time
        """
        self._last = 0.0, -1  # the caller's next work is not part of a step
        steps = self._steps * (1 - done)
        left = (self._left_s() - self._start_s) / self._slowness
        each = STEP_GAUSSIAN * steps + EXPORT_GAUSSIAN + colors * COLORS_GAUSSIAN
        return max(FEWEST, (left - self._step_s * steps - self._export_s) / each)

    @property
    def is_over(self) -> bool:
        """Whether all the time left is needed to write and measure a file."""
        return self._left_s() < self._reserved_s(max(self._reserved_for, FEWEST))

    def fit_ends(self) -> float:
        """Return the end of the fit in s of time.perf_counter(), infinite without a limit.

        Finding the colours pauses the fit and delays this end, and the time for it is reserved.
        """
        whole = self.deadline - self._begun
        fitting = whole - min(self._reserved_s(self._reserved_for), MOST_RESERVED * whole)
        return self._begun + max(self._share * fitting, LEAST_FIT_S)

    @property
    def _slowness(self) -> float:
        """Ratio of the seconds taken to those predicted. The first few steps change it little."""
        return self._taken / self._predicted

    def _left_s(self) -> float:
        return max(self.deadline - time.perf_counter(), 0.0)

    def _reserved_s(self, count: int) -> float:
        each = EXPORT_GAUSSIAN + COLORS_GAUSSIAN
        return self._start_s + self._slowness * (self._export_s + each * count)
