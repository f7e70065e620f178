"""The search for areas. It finds the areas and lines of a picture, and writes a file of them.

Each byte of an area must save some squared error: the rate. With a limit of bytes, the rate is
raised in large steps until a file fits, and then bisected.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable

import numpy as np

from gauss2svg.areas.find import RATE, UNIT, FoundAreas, Progress, coarser, find_areas
from gauss2svg.fit import FitProgress, FitResult
from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.photo.pixels import has_alpha
from gauss2svg.pipeline.export import Export, Exporter
from gauss2svg.pipeline.outcome import Outcome, Subject
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.scene import Scene
from gauss2svg.scene.areas import AreaCounts
from gauss2svg.svg import LEAST_PRECISION, MOST_PRECISION

TRIES = 10  # largest number of rates that are tried for a limit of bytes
FULL = 0.95  # no more rates are tried if a file uses at least this share of the limit
# If a file is k times as large as the limit, the rate is multiplied by k ** STEEPNESS, but by at
# least LEAST_RAISE and at most MOST_RAISE.
STEEPNESS, LEAST_RAISE, MOST_RAISE = 8.0, 3.0, 300.0
BETWEEN = 0.2  # share of a search between two reports of its progress


class _StoppedError(Exception):
    """The function `stop` of a run has ended the search for areas."""


class ByAreas:
    """A search for the areas and lines of a picture, within the plan's limit of bytes."""

    def __init__(self, plan: Plan, subject: Subject, run: Run) -> None:
        scale = subject.canvas[0] / subject.size[0]  # px of the canvas for each px of the picture
        precision = plan.options.svg.precision
        if precision is None:
            precision = min(max(scale * UNIT, LEAST_PRECISION), MOST_PRECISION)
            plan = dataclasses.replace(plan, options=plan.options.changed(precision=precision))
        self._plan, self._subject, self._run = plan, subject, run
        self._unit, self._exporter = precision / scale, Exporter(plan, subject)
        self._tries = 0

    def run(self) -> Outcome:
        """Find areas, and return their file with its measurements."""
        plan, subject, run = self._plan, self._subject, self._run
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        found, export = self._within(plan.goal.byte_limit or math.inf)
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        reason = "interrupted" if run.ended else "gain" if self._tries == 1 else "max_bytes"
        fitted = FitResult(self._scene(found), 0, 0, wall_s, cpu_s, 0, reason)
        run.notify("measure")
        measured = round_trip(export.svg, export.scene, subject.photo, plan.options.run.renderer)
        return Outcome(
            plan, subject, export.scene, export.svg, export.format, fitted, measured,
            self._tries - 1, found=found,
        )  # fmt: skip

    def _within(self, limit: float) -> tuple[FoundAreas, Export]:
        """Return the areas of the lowest rate whose file has at most `limit` bytes.

        If no such file is found, return no areas.
        """
        nothing = self._nothing()
        best = nothing, self._exporter.unscored(self._scene(nothing))
        low, high, rate, raised = 0.0, math.inf, RATE, 1.0
        finest = None  # the areas of the highest rate whose file is too large
        while best[1].size <= limit and self._tries < TRIES and not self._run.ended:
            found = self._found(rate, finest)
            export = self._exporter.unscored(self._scene(found))
            if export.size <= limit:
                best, high = (found, export), rate
                if not low or export.size >= FULL * limit:
                    break
            else:
                low, finest, raised = rate, found, (export.size / limit) ** STEEPNESS
            raised = min(max(raised, LEAST_RAISE), MOST_RAISE)
            rate = low * raised if high == math.inf else math.sqrt(low * high)
        return best

    def _found(self, rate: float, finer: FoundAreas | None) -> FoundAreas:
        """Return the areas at a rate. If the run is stopped, return those that are found so far.

        finer  areas of a lower rate, whose nodes are merged. None to find areas in the picture
        """
        run, newest, begun = self._run, finer or self._nothing(), time.perf_counter()
        due = 0.0

        def progress(done: float, so_far: Callable[[], FoundAreas] | None) -> None:
            nonlocal newest, due
            # Until the first areas are found, there is nothing that a stopped run could write.
            ends = so_far is not None and run.stop()
            if done < due and not ends:
                return
            due, now = done + BETWEEN, None
            if so_far is not None:
                newest = so_far()
                scene, seconds = self._scene(newest), time.perf_counter() - begun
                left_s, counts = seconds / done * (1 - done), str(AreaCounts.of(newest.areas))
                psnr = newest.psnr
                now = FitProgress(1, 0, done, 0, psnr, seconds, left_s, lambda: scene, counts)
            run.notify("areas", now)
            if ends:
                raise _StoppedError

        self._tries += 1
        try:
            newest = self._searched(rate, finer, progress)
        except _StoppedError:
            return newest
        run.notify("write")
        return newest

    def _searched(self, rate: float, finer: FoundAreas | None, progress: Progress) -> FoundAreas:
        """Return areas of a rate: fewer than `finer` has, those of the start, or new ones."""
        subject, unit = self._subject, self._unit
        if finer is not None:
            return coarser(finer, rate, unit, progress)
        if (start := subject.start) is None:
            return find_areas(subject.working, rate, unit, progress)
        # Imported here because few runs have a start.
        from gauss2svg.areas.start import refined_areas

        width, height = subject.size
        areas = start.scaled(width / start.width, height / start.height).areas
        return refined_areas(subject.working, areas, start.background, rate, unit, progress)

    def _nothing(self) -> FoundAreas:
        """Return no areas, on the mean colour of the picture."""
        picture = self._subject.working
        background = None if has_alpha(picture) else tuple(picture.mean(axis=(0, 1)).tolist())
        return FoundAreas((), background, 0.0, 0.0, 0.0, 0.0)

    def _scene(self, found: FoundAreas) -> Scene:
        """Return a scene of the areas on the working canvas."""
        is_clear = found.background is None
        background = np.ones(3) if found.background is None else np.array(found.background)
        return Scene(
            *self._subject.size, background=background, transparent=is_clear, areas=found.areas
        )
