"""The search for areas, with Gaussians above them. It writes a file of both.

    picture -> areas, if each byte saves enough squared error -> do a few Gaussians above them save
    more? -> fewer areas and these Gaussians, as long as that is better -> a search by count that
    fits Gaussians above the areas -> the closer one of the files with and without Gaussians

The currency is squared error for bytes. Without a limit, each byte of an area or a Gaussian must
save the rate. With a limit of bytes, the areas are those with which the squared error is expected
to be least once Gaussians have filled the limit. With a target, they are those of the highest rate
that reaches it alone, if there are such.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gauss2svg.areas.find import RATE, UNIT, FoundAreas, Progress, coarser, find_areas
from gauss2svg.fit import GAUSSIAN, PSNR, FitConfig, FitOptions, FitProgress, FitResult
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.target import TargetPyramid
from gauss2svg.measure.roundtrip import round_trip
from gauss2svg.photo.pixels import has_alpha, shrunk
from gauss2svg.pipeline.by_count import ByCount
from gauss2svg.pipeline.export import Export, Exporter
from gauss2svg.pipeline.outcome import Outcome, Subject
from gauss2svg.pipeline.plan import SHAPE_BYTES, Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.scene import Scene
from gauss2svg.scene.areas import AreaCounts
from gauss2svg.svg import LEAST_PRECISION, MOST_PRECISION

TRIES = 6  # largest number of rates that are tried
FULL = 0.9  # no rates between two others are tried if a file uses at least this share of the limit
# If a file is k times as large as the limit, the rate is multiplied by k ** STEEPNESS, but by at
# least LEAST_RAISE and at most MOST_RAISE.
STEEPNESS, LEAST_RAISE, MOST_RAISE = 8.0, 3.0, 300.0
BETWEEN = 0.2  # share of a search between two reports of its progress
# A trial fits this many Gaussians in so many steps, to a picture of at most so many px a side.
TRIED, TRIAL_STEPS, TRIAL_SIDE = 24, 80, 256
# If a trial leaves less than this share of the squared error, the picture has shading that no area
# draws. Then fewer areas are tried too, because those that imitate the shading are not needed.
SHADED = 0.6
COARSER = 30.0  # factor on the rate from one trial to the next
# dB. A file with Gaussians is written if its raster is closer by this.
LEAST_GAIN = 0.02
# Shapes alone are tried if a trial of them leaves less than this multiple of the squared error.
SHAPES_ALONE = 3.0


class _StoppedError(Exception):
    """The function `stop` of a run has ended the search for areas."""


@dataclass(frozen=True, eq=False)
class _Trial:
    """Areas, their file, and the squared error with and without a few Gaussians above them.

    error  squared error that is expected once Gaussians are added, summed over pixels and channels
    cost   the value by which trials are compared. Lower is better
    """

    found: FoundAreas
    export: Export
    alone: float
    error: float
    cost: float


class ByAreas:
    """A search for the areas and lines of a picture, with Gaussians above them."""

    def __init__(self, plan: Plan, subject: Subject, run: Run) -> None:
        scale = subject.canvas[0] / subject.size[0]  # px of the canvas for each px of the picture
        precision = plan.options.svg.precision
        if precision is None:
            precision = min(max(scale * UNIT, LEAST_PRECISION), MOST_PRECISION)
            plan = dataclasses.replace(plan, options=plan.options.changed(precision=precision))
        self._plan, self._subject, self._run = plan, subject, run
        self._unit, self._exporter = precision / scale, Exporter(plan, subject)
        self._limit = plan.goal.byte_limit or math.inf
        self._each = plan.shape_bytes
        self._tries = 0
        height, width = subject.working.shape[:2]
        share = min(1.0, TRIAL_SIDE / max(height, width))
        size = max(1, round(share * height)), max(1, round(share * width))
        self._small = shrunk(subject.working, *size)
        # Squared error at the size of the working picture, for one of the small picture.
        self._times = height * width / (size[0] * size[1])

    def run(self) -> Outcome:
        """Find areas, fit Gaussians above them, and return the file with its measurements."""
        plan, subject, run = self._plan, self._subject, self._run
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        trial = self._best()
        found, export = trial.found, trial.export
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        reason = "interrupted" if run.ended else "max_bytes" if self._is_cut else "gain"
        fitted = FitResult(self._scene(found), 0, 0, wall_s, cpu_s, 0, reason)
        run.notify("measure")
        raster = self._exporter.raster(export.svg)
        renderer = plan.options.run.renderer
        measured = round_trip(export.svg, export.scene, subject.photo, renderer, raster=raster)
        alone = Outcome(
            plan, subject, export.scene, export.svg, export.format, fitted, measured,
            self._tries - 1, found=found, is_cut=self._is_cut and self._loses(trial),
        )  # fmt: skip
        if run.ended or not self._wants_shapes(trial, alone):
            return alone
        start = subject.start if subject.start is not None and len(subject.start) else None
        ground = self._scene(found)
        above = dataclasses.replace(subject, ground=ground, start=start)
        both = ByCount(dataclasses.replace(plan, rate=RATE), above, run).run()
        both = dataclasses.replace(
            both, is_cut=alone.is_cut, subject=subject, found=found, corrections=both.corrections + alone.corrections,
            fitted=both.fitted.after(fitted, both.fitted.stop_reason),
        )  # fmt: skip
        above.release()
        is_closer = both.psnr >= alone.psnr + LEAST_GAIN or alone.size > self._limit
        return both if is_closer and len(both.scene) else alone

    def _wants_shapes(self, trial: _Trial, alone: Outcome) -> bool:
        """Return whether Gaussians are fitted above the areas of a trial."""
        plan = self._plan
        if (aim := plan.aim) is not None:
            return not aim.is_met_by(aim.score(alone.measured.raster, self._subject.photo))
        if self._limit < math.inf:
            return alone.size > self._limit or self._limit - alone.size > 2 * self._each
        return self._pays(trial)

    def _is_shaded(self, trial: _Trial) -> bool:
        """Return whether a picture has shading that areas only imitate."""
        return trial.error < SHADED * trial.alone and self._pays(trial)

    def _loses(self, trial: _Trial) -> bool:
        """Return whether shapes alone may be closer than areas that were cut to a limit."""
        count = int(self._limit / SHAPE_BYTES[2])
        return self._trial(self._nothing(), count).error < SHAPES_ALONE * trial.cost

    def _pays(self, trial: _Trial) -> bool:
        return trial.alone - trial.error > RATE * TRIED * self._each

    @property
    def _is_cut(self) -> bool:
        return self._low > 0

    def _best(self) -> _Trial:
        """Return the areas of the best rate, with which the search by count goes on."""
        aim, limit = self._plan.aim, self._limit
        self._low, high, rate, best, finer = 0.0, math.inf, RATE, None, None
        while self._tries < TRIES and not self._run.ended:
            found = self._found(rate, finer)
            trial = self._trial(found)
            size, is_shaded = trial.export.size, self._is_shaded(trial)
            is_met = aim is not None and aim.is_met_by(
                aim.score(self._exporter.raster(trial.export.svg), self._subject.photo)
            )
            if size > limit:
                self._low, finer = rate, found
                least = COARSER if is_shaded else LEAST_RAISE
                raised = min(max((size / limit) ** STEEPNESS, least), MOST_RAISE)
                rate = rate * raised if high == math.inf else math.sqrt(rate * high)
                continue
            is_better = best is None or is_met or trial.cost < best.cost
            best = trial if is_better else best
            if self._low and is_better and size < FULL * limit and not is_shaded:
                high, rate = rate, math.sqrt(self._low * rate)
            elif is_better and (is_met or (aim is None and is_shaded and high == math.inf)):
                finer, rate = found, rate * COARSER
            else:
                break
        return self._trial(self._nothing()) if best is None else best

    def _trial(self, found: FoundAreas, count: int = TRIED) -> _Trial:
        """Return areas with what `count` Gaussians above them are expected to save."""
        export, limit = self._exporter.export(scene := self._scene(found)), self._limit
        count = min(count, self._small.shape[0] * self._small.shape[1] // 3)
        targets = TargetPyramid(self._small, PSNR, ground=scene)
        options = FitOptions(tune=PSNR, falloff=GAUSSIAN)
        session = FitSession(
            self._small, FitConfig(gaussians=count, iterations=TRIAL_STEPS, fit=options),
            stop=self._run.stop, targets=targets,
        )  # fmt: skip
        target = session.population.target
        values = target.planar.size * self._times * 3 / len(target.planar)
        alone = target.error(session.population.splats()) * values
        if count:
            session.fit()
        error = min(alone, 10 ** (-session.population.psnr() / 10) * values)
        saved, price = alone - error, RATE * count * self._each
        if limit < math.inf:
            share = min(max(limit - export.size, 0) / (count * self._each + 1), 1.0)
            cost = alone - math.sqrt(share) * saved
        else:
            cost = alone - max(saved - price, 0.0) + RATE * export.size
        return _Trial(found, export, alone, error, cost)

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
