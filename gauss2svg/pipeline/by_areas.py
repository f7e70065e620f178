"""The search for areas, with Gaussians above them. It writes a file of both.

    picture -> areas -> would a few Gaussians above them save more than they cost? -> fewer areas
    and such Gaussians, if that is better -> a search by count that fits Gaussians above the areas
    -> the closer one of the files with and without Gaussians

The currency is squared error for bytes. Without a limit, each byte of an area or of a Gaussian must
save the rate. With a limit of bytes, the rate is raised until the file of the areas fits, and
Gaussians fill what is left.

For example, a ball with a soft shadow on a plain ground becomes 12 areas, of which 9 are strips of
the shadow. A trial of 24 Gaussians leaves a 20th of the squared error, so the picture is shaded.
Without its shading there are 3 areas, below which Gaussians draw the shadow in fewer bytes.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gauss2svg import portable
from gauss2svg.areas import clean, find, ringing
from gauss2svg.areas.arrays import Floats, filtered
from gauss2svg.areas.find import RATE, UNIT, FoundAreas, NoDrawingError, Progress
from gauss2svg.areas.scenes import as_rasterized, refined_areas
from gauss2svg.areas.texture import is_between_tones, is_flat, is_shaded, is_small, undoubled
from gauss2svg.fit import FitProgress, FitResult
from gauss2svg.measure.roundtrip import model_psnr
from gauss2svg.pipeline import found as changes
from gauss2svg.pipeline.by_count import ENOUGH, ByCount
from gauss2svg.pipeline.found import SEEN_UP_TO, Trial, Trials, nothing, scene_of
from gauss2svg.pipeline.outcome import Exporter, Outcome, Subject, filled, scaled_to
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.run import Run
from gauss2svg.raster import rasterize_like
from gauss2svg.render import render, render_rgba
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.scene.areas import Area, AreaCounts
from gauss2svg.svg import LEAST_PRECISION, MINIMAL, MOST_PRECISION, Document, SvgFormat
from gauss2svg.svg.write import ordered_svg

# Factor on RATE for each unit of noise, 2.5 for a level of 255, because nodes that follow the noise
# that is left along outlines save squared error too.
PRICE_OF_NOISE = 2.5 * 255
PRICE_OF_SKETCH = 4.0  # the same for sketches, because grain and stairs of pixels are left
STEPS_OF_RATE = 24  # largest number of times that a limit of bytes doubles the rate
# A picture is searched without its shading only if it then has less than this share of the areas. A
# start keeps its nodes unless its file without those that do not pay has less than this share of
# the bytes, as after a tracer.
FEWER = 0.8
# Share of the squared steps between pixels that areas leave if shapes may be better. Where areas
# are crisp, shapes lose more between the pixels. Areas of icons and logos leave .04 or less, those
# of photos .08 or more. In between are drawings with more detail than pixels.
FAR = 0.035
# Mean squared error of 7 x 7 px at which areas miss a part of a picture of at most TINY pixels. It
# is .011 or less in logos that are better so, and .012 or more where a face lost its mouth.
LOST, TINY = 0.011, 2**12
TOO_FAR = 26.0  # dB of areas of a larger picture if shapes may be closer
FAR_IF_SOFT = 34.0  # the same of a soft picture of any size, if the areas are made as soft
MANY = 100  # areas of a search that takes too long to be made again, for .1 dB
STRIPS = 1.8  # the edges of strips of shading look worse than their squared error by this factor
_ANEW = (
    "the start differs from the picture, so its areas were found anew, and edits may be lost. Edit "
    "the file of this run, or give the picture that the edit shows"
)


class _StoppedError(Exception):
    """The search for areas ends: the run has to end, or areas would only be strips of shading."""


class ByAreas:
    """A search for the areas and lines of a picture, and for Gaussians above them."""

    def __init__(self, plan: Plan, subject: Subject, run: Run) -> None:
        small = undoubled(subject.working)
        is_doubled = small is not subject.working
        subject = dataclasses.replace(subject, working=small)
        scale = subject.canvas[0] / subject.size[0]  # px of the canvas for each px of the picture
        precision = plan.options.svg.precision
        if precision is None:
            # Cairo, and with it librsvg and CairoSVG, draws linear gradients as one colour where
            # coordinates reach 2^15 units.
            least = max(LEAST_PRECISION, max(subject.canvas) / 20480)
            precision = min(max(scale * UNIT, least), MOST_PRECISION)
            plan = dataclasses.replace(plan, options=plan.options.changed(precision=precision))
        self._noisy = working = subject.working
        self._noise, self._quality = clean.noise_of(working), None
        if self._noise:
            self._quality = clean.quality_of(working)
            working = clean.cleaned(working, self._noise)
        self._is_shaded = is_shaded(working)  # areas that imitate glows make a picture flat
        # Whether the picture may have been reduced by a filter that overshoots
        is_known = not self._noise or self._quality is not None
        self._is_rung = is_known and not plan.sketch and ringing.is_rung(self._noisy)
        if self._is_rung and not self._noise:
            working = ringing.without_bands(working)
        # Whether areas match the photo itself
        self._is_as_given = not (is_doubled or self._noise or plan.sketch or plan.in_inks)
        start = subject.start
        if start is not None and plan.in_inks:
            areas = changes.areas_in_inks(start.areas, str(plan.options.fit.inks))
            start = start.select([]).replace(areas=areas)
        self._rate = RATE * max(PRICE_OF_SKETCH if plan.sketch else 1, PRICE_OF_NOISE * self._noise)
        subject = dataclasses.replace(subject, working=working, start=start)
        self._plan, self._subject, self._run = plan, subject, run
        # Scene on the working canvas whose unchanged areas stay as they are
        self._start = None if start is None else scaled_to(start, subject.size)
        self._unit, self._exporter = precision / scale, Exporter(plan, subject)
        self._limit, self._tries = plan.goal.byte_limit, 0
        self._is_cut = self._is_late = self._is_anew = False
        self._is_hurried = False  # whether areas would be closer in more time
        self._has_strips = False  # whether areas without Gaussians would only imitate the picture
        self._is_lost = False  # whether the file gets no areas
        self._so_far: FoundAreas | None = None  # areas before the picture was drawn in inks
        self._inks = plan.sketch  # inks that all areas get, "" if they have any colours
        # A picture with more even cores is no drawing. A smaller one may have fewer of them.
        most = min(3200, max(working[..., 0].size // 100, 100))
        self._most_cores = None if plan.prefers_areas else most

    def run(self) -> Outcome:
        """Find areas, fit Gaussians above them, and return the file with its measurements.

        If the file of a start is closer than what is made of it, that is returned.
        """
        outcome = self._search()
        notes = (_ANEW,) if self._is_anew else ()
        unsure = self._is_lost or outcome.unsure or self._is_unsure(outcome)
        outcome = dataclasses.replace(outcome, unsure=unsure, notes=notes)
        if self._start is None or (file := self._exporter.unscored(self._start)).size > self._limit:
            return outcome
        fitted, raster = outcome.fitted.after("start"), self._exporter.raster(file.svg)
        own = dataclasses.replace(outcome, file=file, raster=raster, fitted=fitted, notes=())
        return max(outcome, own, key=attrgetter("psnr"))

    def _is_unsure(self, outcome: Outcome) -> bool:
        """Return whether shapes alone may be better than the areas of an outcome."""
        if self._plan.prefers_areas or self._run.ended:
            return False
        goal, found = self._plan.goal, outcome.found
        is_soft, psnr = found is not None and found.window is not None, self._psnr(outcome)
        error = self._trials.error_at(psnr)
        if goal.byte_limit < math.inf or self._plan.aim is not None:
            # Crisp areas of a soft picture have fewer dB, which are then what counts.
            is_soft &= self._is_as_given
            # With a time limit, no time is left for two searches.
            has_time = not goal.time_limit
            return is_soft or (has_time and self._trials.shapes_win(outcome.file.size, error))
        if goal.time_limit:
            return False
        is_far = psnr < SEEN_UP_TO and error > FAR * find.steps_of(self._subject.working)
        if is_small(self._subject.working) and not self._inks:
            errors = self._errors(outcome.file.scene, found)
            is_far |= errors.size <= TINY and ndimage.uniform_filter(errors, 7).max() > LOST
            return is_far or len(outcome.file.scene) > 0
        if is_soft:
            return is_far and psnr < FAR_IF_SOFT and not self._inks
        enough = self._plan.preset.stop_psnr - ENOUGH.too_little
        if psnr < enough and self._trials.shapes_win(outcome.file.size, error):
            return True
        return outcome.psnr < enough and self._may_be_soft(psnr)

    def _search(self) -> Outcome:
        run, wall_s, cpu_s = self._run, time.perf_counter(), time.process_time()
        if self._quality is not None or self._is_rung:
            self._decode()
        if self._plan.in_inks and not self._inks:
            self._ink(str(self._plan.options.fit.inks))
        plan = dataclasses.replace(self._plan, rate=self._rate)
        self._trials = Trials(plan, self._subject, self._exporter, self._is_over)
        # If the search for shapes alone is stopped at once, the shapes of a short fit are the file.
        trial, subject = self._best() or self._trials.in_short(), self._subject
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        is_short = self._is_late or self._is_hurried
        reason = "time_limit" if is_short else "max_bytes" if self._is_cut else "gain"
        fitted = FitResult(trial.ground, 0, 0, wall_s, cpu_s, 0, reason)
        final = self._steady(self._rastered(trial))
        alone = self._exporter.outcome(final, fitted, max(self._tries - 1, 0), final.found)
        aim = plan.aim
        is_met = aim and aim.is_met_by(aim.score(alone.raster, subject.photo))
        if self._ends() or is_met or not self._trials.wants_gaussians(trial):
            return alone
        start = subject.start
        start = None if start is None else start.select(start.level == ABOVE) or None
        above = dataclasses.replace(subject, ground=trial.ground, start=start)
        if (most := self._trials.most_above(trial)) < math.inf:
            options = plan.options.changed(gaussians=int(most))
            plan = dataclasses.replace(plan, options=options)
        both = ByCount(plan, above, run).run()
        is_closer = self._psnr(both) >= self._psnr(alone) + 0.02 or aim is not None
        if alone.file.size <= self._limit and not is_closer:
            return dataclasses.replace(alone, fitted=fitted.after(reason, both.fitted))
        reason, goal = both.fitted.stop_reason, self._plan.goal
        reason = "cap" if reason == "gaussians" and goal.count is None else reason
        reason = "time_limit" if self._is_hurried else reason
        # Shapes alone may reach a target that is missed with areas.
        is_open = not (goal.is_limited or self._plan.prefers_areas)
        return dataclasses.replace(
            both, found=trial.found, fitted=both.fitted.after(reason, fitted),
            corrections=both.corrections + alone.corrections,
            unsure=is_open and aim is not None and not aim.is_met_by(both.file.score),
        )  # fmt: skip

    def _decode(self) -> None:
        """Take out of the picture what JPEG and a filter changed, as its areas tell."""
        noise, noisy, quality = 0.45 * self._noise, self._noisy, self._quality
        code = None if quality is None else lambda drawn: clean.coded(drawn, quality, noisy)
        for k in range(2):  # the areas of what is left are closer
            found = self._found(self._areas())
            if self._ends() or found.drawing is None:
                return
            working = None
            if self._is_rung:
                working = ringing.unrung(noisy, found.areas, found.background, code)
                self._is_rung = k > 0 or working is not None
            if working is None and quality is not None:
                working = clean.decoded(noisy, find.whole_raster(found.drawing), quality)
            if working is None:
                break
            if noise:
                working = clean.cleaned(working, noise, clean.UNBLED)
            else:
                working = ringing.without_bands(working, ringing.LEFT)
            self._subject = dataclasses.replace(self._subject, working=working)
            self._rate = RATE * max(1.0, PRICE_OF_NOISE * noise)
            if len(found.areas) > MANY:
                break
        if self._is_rung:
            self._is_as_given, self._quality = False, None
        elif not noise:
            self._subject = dataclasses.replace(self._subject, working=noisy)
        self._tries = 0

    def _ink(self, inks: str) -> None:
        """Draw the picture in inks, in which areas are then found.

        A picture of which areas draw less than nine tenths, such as a photo in a drawing, gets no
        areas, because it would have bands.
        """
        width, height = self._subject.size
        found = self._so_far = self._found(self._areas())
        self._is_lost |= found.explained < 0.9 and self._most_cores is not None
        if not self._is_lost:
            picture = changes.picture_in_inks(found, inks, width, height)
            self._subject = dataclasses.replace(self._subject, working=picture)
        self._inks, self._quality, self._tries = inks, None, 0

    def _psnr(self, outcome: Outcome) -> float:
        """Return the PSNR (dB) of an outcome against the picture in which areas were searched."""
        if outcome.found is not None and outcome.found.window is not None:
            return self._model_psnr(outcome.file.scene, outcome.found)
        return outcome.psnr if self._is_as_given else self._model_psnr(outcome.file.scene)

    def _model_psnr(self, scene: Scene, found: FoundAreas | None = None) -> float:
        """Return the PSNR (dB) of a scene against the picture in which areas were searched.

        If `found` has a window, the picture is soft. Then the scene is made as soft by this window.
        """
        working = self._subject.working
        if found is None or found.window is None:
            return model_psnr(scene, working, self._subject.weight(working))
        return -10 * portable.log10(max(float(self._errors(scene, found).mean()), 1e-12))

    def _errors(self, scene: Scene, found: FoundAreas | None) -> Floats:
        """Return the mean squared errors (h, w) of a scene that is as soft as the picture."""
        picture, size = find.channels_of(self._subject.working), self._subject.size
        is_opaque = picture.shape[2] == 3
        drawn = render(scene, *size) if is_opaque else find.both_views(render_rgba(scene, *size))
        if found is not None and found.window is not None:
            drawn = filtered(drawn, found.window)
        return ((drawn - picture) ** 2).mean(axis=2, dtype=np.float64)

    def _may_be_soft(self, psnr: float) -> bool:
        """Return whether areas of this PSNR in dB are too far from a picture, or it is glossy.

        In a flat picture, pixels between two tones are thin lines. In a JPEG or with few inks,
        areas are surely better.
        """
        if self._quality is not None or self._inks:
            return False
        return psnr < TOO_FAR or (
            not is_flat(self._noisy) and is_between_tones(self._subject.working)
        )

    def _glance(self, error: float, edges: int) -> None:
        """End the search for areas if shapes alone may be closer before outlines are found."""
        # Refined areas have .4 of the error, and take 4 bytes for each px of their edges.
        self._has_strips = self._trials.shapes_win(4.0 * edges, 0.4 * error)
        if self._has_strips:
            raise _StoppedError

    def _rastered(self, trial: Trial) -> Trial:
        """Return a trial whose areas are fitted to what resvg draws.

        If it has Gaussians too, they go if the areas alone are then closer.
        """
        found, renderer = trial.found, self._plan.options.run.renderer
        has_shapes, ground = len(trial.ground) > 0, trial.ground.select([])
        # Other renderers take too long for a step of a fit.
        is_fast = renderer == "resvg" and found.areas and not self._ends()
        if not is_fast or found.window is not None or (has_shapes and not self._is_as_given):
            return trial

        def rasterize(areas: tuple[Area, ...]) -> NDArray[np.float32]:
            file = SvgFormat(markup=MINIMAL, precision=self._unit)
            svg = ordered_svg(ground.replace(areas=areas), file, Document())
            return rasterize_like(svg, self._subject.working, renderer)

        quality, picture = self._quality, self._noisy if self._quality else self._subject.working
        code = None if quality is None else lambda raster: clean.coded(raster, quality, picture)
        areas = as_rasterized(picture, found.areas, found.background, rasterize, code)
        if areas is found.areas:
            return trial
        new = self._with_areas(trial, areas)
        worse = has_shapes and self._raster_psnr(new.svg) < self._raster_psnr(trial.svg)
        return trial if worse or new.size > self._limit else new

    def _with_areas(self, trial: Trial, areas: tuple[Area, ...]) -> Trial:
        """Return a trial with other areas, and without Gaussians."""
        scene = trial.ground.select([]).replace(areas=areas)
        return dataclasses.replace(trial, ground=scene, **vars(self._exporter.unscored(scene)))

    def _steady(self, trial: Trial) -> Trial:
        """Return a trial whose areas are those of the start where these draw the same."""
        start, ground, photo = self._start, trial.ground, self._subject.photo
        if start is None or len(ground) or len(start) or self._ends():
            return trial

        def error_of(areas: tuple[Area, ...]) -> float:
            export = self._exporter.unscored(ground.replace(areas=areas))
            error = portable.power(10, -self._raster_psnr(export.svg) / 10)
            return math.inf if export.size > self._limit else 3 * photo[..., 0].size * error

        return self._with_areas(trial, changes.kept(ground.areas, start.areas, error_of))

    def _raster_psnr(self, svg: str) -> float:
        """Return the PSNR (dB) of the raster of a file against the photo."""
        return self._subject.psnr(self._exporter.raster(svg), self._subject.photo)

    def _best(self) -> Trial | None:
        """Return the trial whose areas the file gets, or None if it gets no areas."""
        first, start = self._found(self._searched, self._so_far), self._start
        if start is not None and not self._ends():
            start = start.replace(areas=first.areas)
            if self._model_psnr(start, first) < SEEN_UP_TO:
                # Much has moved, as between two frames of a film, so areas are found anew.
                self._subject, self._is_anew = dataclasses.replace(self._subject, start=None), True
                first = self._found(self._searched, first)
        self._is_lost |= self._has_strips and self._ends()
        if self._is_lost:
            return None
        if self._has_strips:
            shaded = self._trials.trial(self._found(self._areas(shaded=True)))
            return shaded if shaded.size <= self._limit else self._cut(shaded, True)
        trials = [self._trials.trial(first)]
        # At a PSNR below 25 dB, narrow bands of inks seem to be a gradient of one.
        if self._plan.in_inks and trials[0].error > self._trials.error_at(25):
            self._is_lost = True
            return None
        has_start = self._subject.start is not None
        if has_start and not self._ends():
            merged = self._trials.trial(self._coarser(first, self._rate))
            if merged.size < FEWER * trials[0].size:
                trials.append(merged)
        if self._limit == math.inf:
            # Only fewer areas would go on from the drawing, which takes much memory.
            found = dataclasses.replace(first, drawing=None)
            trials[0] = dataclasses.replace(trials[0], found=found)
        shaded = trials[0].shaded or self._is_shaded
        if shaded and not has_start and not self._ends():
            few = FEWER * len(first.areas)
            found = self._found(self._areas(shaded=True), first, lambda one: len(one.areas) > few)
            if len(found.areas) <= few:
                trial = self._trials.trial(found)
                trials.append(dataclasses.replace(trial, cost=trial.cost / STRIPS))
        within = [trial for trial in trials if trial.size <= self._limit]
        if within:
            return min(within, key=lambda trial: trial.cost)
        finest = min(trials, key=lambda trial: trial.size)
        return self._cut(finest, finest is not trials[0])

    def _cut(self, finest: Trial, shaded: bool) -> Trial:
        """Return a trial that fills the limit of bytes, which `finest` exceeds.

        Areas are found anew at each rate, because more thin parts are lines if bytes are dear. Only
        the areas of a start are kept.

        shaded  whether shading was left to Gaussians when `finest` was found
        """
        self._is_cut, last = True, self._tries + 6

        def write(step: int) -> Trial:
            if not step or self._ends():
                return self._trials.in_short() if self._ends() else self._trials.blank()
            rate, found = self._rate * 2.0 ** (STEPS_OF_RATE - step), finest.found
            if self._subject.start is not None:
                found = self._coarser(found, rate)
            else:
                found = self._found(self._areas(rate, shaded), found)
            return self._trials.trial(found, 0)

        def goes_on() -> bool:
            return self._tries < last and not self._ends()

        empty, whole = (0, self._exporter.empty_bytes), (STEPS_OF_RATE, finest)
        best = filled(write, empty, whole, self._limit, goes_on)
        return self._trials.trial(best.found) if best.found.areas else best

    def _coarser(self, found: FoundAreas, rate: float) -> FoundAreas:
        drawing, taken = found.drawing, (found.find_s, found.refine_s)
        assert drawing is not None
        return self._found(lambda p: find.refined(drawing, rate, self._unit, p, 0, *taken), found)

    def _is_over(self) -> bool:
        """Return whether the run has to end: it is stopped, or its time for fitting is over."""
        self._is_late = time.perf_counter() > self._run.budget.fit_ends()
        return self._run.stop() or self._is_late

    def _ends(self) -> bool:
        return self._run.ended or self._is_late or self._is_lost

    def _found(
        self, search: Callable[[Progress], FoundAreas], so_far: FoundAreas | None = None,
        ends_with: Callable[[FoundAreas], bool] | None = None,
    ) -> FoundAreas:  # fmt: skip
        """Return the areas of a search. If the run has to end, return those that are found so far.

        so_far  areas before the search. None if there are none
        ends_with  function that tells of the first areas whether the search ends with them
        """
        run, newest, begun = self._run, so_far, time.perf_counter()
        # The first areas must be found in half of the time for fitting.
        due, latest, is_first = 0.0, begun + 0.5 * (run.budget.fit_ends() - begun), True

        def progress(done: float, present: Callable[[], FoundAreas] | None) -> None:
            nonlocal newest, due, is_first
            # The areas of a small picture are found so fast that a stopped run waits for them.
            waits = newest is None and math.prod(self._subject.size) <= 256 * 256
            ends = self._is_over() and (self._is_late or not waits)
            ends |= newest is None and time.perf_counter() > latest
            self._is_hurried |= ends
            if done < due and not ends:
                return
            due, now = done + 0.2, None
            if present is not None:
                newest = present()
                if is_first and ends_with is not None and not ends:
                    ends = ends_with(newest)
                is_first = False
                scene, seconds = scene_of(self._subject, newest), time.perf_counter() - begun
                left_s, counts = seconds / done * (1 - done), str(AreaCounts.of(newest.areas))
                psnr = newest.psnr
                now = FitProgress(1, 0, done, 0, psnr, seconds, left_s, lambda: scene, counts)
            run.notify("areas", now)
            if ends:
                self._is_lost |= newest is None
                raise _StoppedError

        self._tries += 1
        try:
            newest = search(progress)
            run.notify("write")
        except _StoppedError:
            pass
        except NoDrawingError:
            self._is_lost = True
        found = newest or nothing(self._subject.working)
        if self._inks:
            return changes.found_in_inks(found, self._inks)
        return changes.with_shared_colors(found, bool(self._noise))

    def _searched(self, progress: Progress) -> FoundAreas:
        """Return the areas of the picture, or those of the start, at the usual rate."""
        if self._subject.start is None or self._start is None:
            return self._areas(glance=self._glance)(progress)
        # Its nodes are kept, and Gaussians draw the shading if it has any.
        start, picture = self._start, self._subject.working
        areas, ground, shaded = start.areas, start.background, len(start) > 0
        return refined_areas(picture, areas, ground, 0.0, self._unit, progress, shaded)

    def _areas(
        self, rate: float | None = None, shaded: bool = False,
        glance: find.Glance = lambda error, edges: None,
    ) -> Callable[[Progress], FoundAreas]:  # fmt: skip
        """Return a function that searches for the areas of the picture, and takes a Progress.

        rate  None: that of the run
        """
        picture, rate = self._subject.working, self._rate if rate is None else rate
        return lambda progress: find.find_areas(
            picture, rate, self._unit, progress, shaded, self._most_cores, glance,
            self._subject.weight(picture), not (self._noise or self._is_rung),
        )  # fmt: skip
