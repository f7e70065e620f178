"""Vectorising a photo: reading, searching, measuring and reporting."""

from __future__ import annotations

import dataclasses
import math
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.areas.pixels import Sprite, areas_of_sprite, sprite_of
from gauss2svg.areas.texture import undoubled
from gauss2svg.errors import InputError, instance, refusal, required, several
from gauss2svg.files import SVG_ENDINGS, check_ending, write_atomically
from gauss2svg.fit import FitOptions, FitResult
from gauss2svg.measure import decibels
from gauss2svg.options import Field, file_name, flag_of
from gauss2svg.photo.load import ImageSource, load_focus, rereadable
from gauss2svg.photo.pixels import Header, Photo, Size, averaged, has_alpha, shrunk
from gauss2svg.pipeline.by_bytes import ByBytes
from gauss2svg.pipeline.by_count import ByCount
from gauss2svg.pipeline.options import Goal, Options, ProgressCallback, RunOptions, SvgOptions
from gauss2svg.pipeline.outcome import Exporter, Outcome, Subject, best_of
from gauss2svg.pipeline.paper import evened
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.progress_display import watched
from gauss2svg.pipeline.report import run_report
from gauss2svg.pipeline.run import STEPS, Load, Run, TimeBudget, load_of, size_that_fits
from gauss2svg.scene import ADD, Scene
from gauss2svg.scene.areas import AreaCounts
from gauss2svg.scene.inks import inks_in
from gauss2svg.svg import Document, Plotter, SvgFormat
from gauss2svg.svg.encode import outline_svg
from gauss2svg.svg.file import file_bytes, image, is_svgz
from gauss2svg.svg.plates import CUT_UNIT, Regions
from gauss2svg.svg.write import plate_svg, with_marks, write_svg

if TYPE_CHECKING:
    from gauss2svg.pipeline.plot import Plot

# With a time limit, areas are searched in a picture of so many pixels for each second.
AREA_PIXELS_A_SECOND = 40_000
# A drawing is not reduced if it has at most this many px, or this factor on the px of the preset's
# largest square, because thin lines lose their colour (docs/decisions/areas.md).
WHOLE_DRAWING, WHOLE_SHARE = 2**20, 2.0


@dataclass(frozen=True, eq=False)
class Result:
    """A vectorised photo. Notebooks show it as a picture.

    svg       text of the file
    scene     areas and fitted Gaussians on the photo's canvas, in the order of the file
    report    options and results of the run, ready for JSON (docs/reference/report.md)
    raster    rasterised SVG, (h, w, 3) float32 in 0..1. It may be smaller than the canvas. For a
              transparent photo it is (h, w, 4) with straight alpha
    photo     photo with which the raster was compared. It has the shape of the raster
    document  document settings of the file
    """

    svg: str
    scene: Scene
    report: dict[str, Any]
    raster: NDArray[np.float32]
    photo: NDArray[np.float32]
    document: Document

    def save(self, path: str | os.PathLike[str], gzip: bool | None = None) -> None:
        """Write the SVG to a file. If this fails, no incomplete file is left.

        gzip  whether to compress the file. None: it is compressed if the path ends in .svgz, or if
              the run had gzip=True
        Raise InputError if `path` is not a path or has the suffix of another format, and
        OutputError if the file cannot be written.
        """
        path = file_name("path", path)
        check_ending("path", path, SVG_ENDINGS)
        if gzip is None:
            gzip = is_svgz(path) or bool(self.report["gzip"])
        write_atomically(path, file_bytes(self.svg, Field("gzip", bool).checked(gzip)))

    def outline(self, cut: bool = False, trap: float = 0.0) -> str:
        """Return the text of an SVG with the outlines of the shapes (see gauss2svg.outline_svg).

        cut, trap  as in `plates`. With `cut` the outlines are those of each ink's region instead
        """
        scene = self.scene
        if cut:
            used = inks_in(scene, *self._printed).values()
            scene = self._regions.outlines({c for t in used for c in t if t[c]}, trap)
        return outline_svg(scene, self.document)

    def plot(self, plotter: Plotter | None = None) -> Plot:
        """Return the strokes of a pen plotter. Plot.svg is the text of an SVG with them.

        If the run had inks, each of them has a pen, and so has each ink of a sketch in several.
        """
        from gauss2svg.pipeline.plot import plot_of  # imported here because few runs need it

        return plot_of(
            self.scene, self.report, instance(plotter, "plotter", Plotter), self.document
        )

    def plates(self, cut: bool = False, trap: float = 0.0, marks: bool = False) -> dict[str, str]:
        """Return a dict that has an SVG for each ink, under the ink's #rrggbb.

        cut    whether a plate is the region in which its ink is seen, as closed paths without white
               ones over them. This needs the extra `cut`
        trap   width in mm by which regions spread below darker ones beside them. It needs `cut`
        marks  whether a plate has a margin with register marks, its number and its ink

        The SVG is the plate of the ink (see gauss2svg.plate_svg). The dict is in the order of the
        inks. The paper and inks that are not used have no plate. Raise InputError if the run had no
        inks or if `trap` is given without `cut`, and CutMissingError if `cut` needs a package that
        is not installed.
        """
        if trap and not cut:
            raise refusal("trap", "given with cut", f"{trap:g} alone", "cut=True")
        printed, regions = self._printed, self._regions if cut else None
        inks = printed[0].split(",")

        def plate(ink: str, tones: dict[str, float]) -> str:
            document = dataclasses.replace(self.document, title=f"{self.document.title}: {ink}")
            name = f"{inks.index(ink) + 1} of {len(inks)}: {ink}"
            if regions is None:
                svg = plate_svg(self.scene, tones, document)
            else:
                cut_format = SvgFormat(precision=CUT_UNIT)
                svg = write_svg(regions.plate(tones, trap), cut_format, document)
            return with_marks(svg, self.scene, document, name) if marks else svg

        return {ink: plate(ink, tones) for ink, tones in inks_in(self.scene, *printed).items()}

    @property
    def _printed(self) -> tuple[str, str | None, int | None]:
        """The inks, the paper and the tones of the run. Raise InputError if it had no inks."""
        inks, paper, tones = (self.report[key] for key in ("inks", "paper", "overprint"))
        if inks is None:
            raise InputError("inks must be given for plates; got none. Try FitOptions(inks=6)")
        return inks, paper, tones

    def thin_parts(self) -> int:
        """Return the number of parts thinner than 0.3 mm on paper, which no cutter can cut.

        In a cut file they belong to the ink beside them. Raise InputError and CutMissingError as
        `plates` does.
        """
        assert self._printed
        regions = self._regions
        regions.of(regions.colors)
        return regions.thin_parts

    @cached_property
    def _regions(self) -> Regions:
        return Regions(self.scene, self.document.mm_each(self.scene.width))

    def _repr_html_(self) -> str:
        alt = self.document.alt or self.document.title
        return image(self.svg.encode(), "image/svg+xml", alt)

    def __repr__(self) -> str:
        r = self.report
        counts = [str(AreaCounts.of(self.scene.areas))] * bool(self.scene.areas)
        counts += [several(r["gaussians"], "Gaussian")] * (r["gaussians"] > 0 or not counts)
        shapes = f"{r['width']}x{r['height']}, {', '.join(counts)}"
        closeness, size = decibels(r["psnr_svg"]), r["svg_bytes"]
        return f"<gauss2svg.Result {shapes}, {closeness}, {size} bytes>"


def vectorize(
    image: ImageSource,
    goal: Goal | None = None,
    *,
    fit: FitOptions | None = None,
    svg: SvgOptions | None = None,
    document: Document | None = None,
    run: RunOptions | None = None,
    focus: ImageSource | None = None,
    start: Scene | None = None,
    progress: ProgressCallback | bool | None = None,
    stop: Callable[[], bool] | None = None,
    **options: Any,
) -> Result:
    """Fit Gaussians to a photo, write them as an SVG, and measure how close it is to the photo.

    image     path, bytes, binary file, PIL image, numpy array or torch tensor
    goal      targets and limits
    fit, svg, document, run
              less common options. Each class documents its fields
    focus     mask of the photo's proportions, like image: white where detail matters
    start     scene whose shapes are scaled to the photo and refined, in place of a new fit
    progress  function that is called with a Progress at every step. True shows a bar on a terminal,
              or the forming picture in a notebook. By default nothing is shown
    stop      function that is called at every step. If it returns True, the run ends with the
              best result so far
    options   fields of these classes by their names: vectorize("photo.jpg", max_bytes="500k")

    With a target, a given number of Gaussians is an upper bound. The first limit that is reached
    ends the run, and the report names it as stop_reason. Targets and limits that are missed are in
    the report's `unreached`. The SVG has the photo's width and height even if the fit ran on a
    smaller image.
    For the report and the targets, the SVG is measured at the size of the fit, or at 1 megapixel if
    that is larger. With RunOptions.full_size it is measured at the size of the photo.
    Raise InputError for invalid input or an unknown option, and RendererError for a missing
    renderer. If several threads call this function, they wait for each other. A forked process may
    call it too.
    """
    groups: Any = {"goal": goal, "fit": fit, "svg": svg, "document": document, "run": run}
    chosen = Options(**groups).changed(**options)
    with watched(progress) as callback:
        return vectorize_by(chosen, image, focus=focus, start=start, progress=callback, stop=stop)


def vectorize_by(
    options: Options,
    image: ImageSource,
    *,
    focus: ImageSource | None = None,
    start: Scene | None = None,
    progress: ProgressCallback | None = None,
    stop: Callable[[], bool] | None = None,
    started: float | None = None,
    may_reduce: bool = True,
) -> Result:
    """Vectorise a photo as `vectorize` does, with all options in one object.

    started     value of time.perf_counter() from which time_limit and the report's total_s are
                counted. None: now
    may_reduce  whether the fit may run on a smaller image if there is too little memory. If not,
                InputError is raised
    """
    if start is not None and required(start, "start", Scene).areas:
        from gauss2svg.areas.scenes import with_ellipses_as_areas  # few runs need it

        start = with_ellipses_as_areas(start)
    has_areas = start is not None and bool(start.areas)
    plan = Plan(options, starts=start is not None, has_areas=has_areas, has_focus=focus is not None)
    plan.check_renderer()
    plan = plan.on_paper()
    run = Run(options.run, progress, stop, started)
    if start is not None:
        _check_start(plan, start)
    image = rereadable(image)
    photo, load = _read(plan, run, image, may_reduce)
    strength, max_pixels = options.fit.focus_strength, options.run.max_pixels
    mask = None if focus is None else load_focus(focus, strength, photo, max_pixels)
    pixels = working = shrunk(photo.pixels, *load.measured[::-1], sharp=True)
    measured = dataclasses.replace(photo, pixels=pixels)
    if load.fit != load.measured:
        working = shrunk(photo.pixels, *load.fit[::-1], sharp=True)
    sketch = evened(pixels, working, options.fit.inks) if plan.may_even_paper else None
    if sketch is not None:
        pixels, working, inks = sketch
        plan = dataclasses.replace(plan, has_areas=True, sketch=inks)
    is_drawn = plan.may_be_exact and not plan.sketch
    sprite = _sprite(plan, run, image, photo) if is_drawn else None
    is_whole = _is_whole(run, load)
    whole = photo.pixels if is_whole else pixels
    plan = plan.for_picture(pixels, whole)
    if plan.in_areas and load.fit != photo.original_size and sketch is None:
        if is_whole and undoubled(whole) is whole:
            measured, pixels, working = photo, whole, whole
        else:
            # Outlines would follow the rings of the filter that keeps photos sharp.
            working = averaged(photo.pixels, *load.fit[::-1])
    subject = Subject(
        pixels, working, photo.original_size,
        document=options.document.of_photo(*photo.original_size, photo.dpi),
        focus=mask, start=start, sprite=sprite,
        bytes_of=lambda svg: len(file_bytes(svg, plan.counts_gzipped)),
    )  # fmt: skip
    del photo  # frees the photo's pixels, which may be many
    with run.threaded():
        outcome = best_of(_outcomes(plan, run, subject, load.fit), plan, run)
        file = outcome.file
        # Every search prunes its file until it is within the limit, or until no shapes are left.
        plan.check_limit(file.size)
        run.notify("measure")
        report = run_report(plan, measured, outcome, run)
    return Result(file.svg, file.scene, report, outcome.raster, pixels, subject.document)


def _check_start(plan: Plan, start: Scene) -> None:
    """Raise InputError if the file cannot have shapes like those of a scene to start with."""
    blend, counts = plan.options.fit.blend, str(AreaCounts.of(start.areas))
    if ADD in (start.blend, blend):
        got = f"a scene of {start.blend} for a file of {blend}"
        raise refusal("start", "alpha-composited, like the file", got, "--blend over for both")
    if start.areas and not (plan.in_areas and plan.allows_areas):
        advice = "--areas auto without --gaussians, --blend and --falloff"
        raise refusal("start", "a scene without areas", counts, advice)
    if plan.in_areas and not start.areas:
        got = several(len(start), "Gaussian")
        raise refusal("start", "a scene that has areas", got, "--areas auto")


def _read(plan: Plan, run: Run, image: ImageSource, may_reduce: bool) -> tuple[Photo, Load]:
    """Read and check the photo, and return it with the load of the run.

    The returned photo may already be reduced to load.measured, because some formats are reduced
    while they are decoded.
    """
    asked = plan.options.run.max_size is not None or not may_reduce

    def sizes(width: int, height: int, has_alpha: bool = False) -> tuple[Load, str | None]:
        # A photo counts as opaque until it is decoded, because only its pixels show whether it is.
        load = load_of(plan, Header(width, height, has_alpha, run.reduced_bytes))
        return size_that_fits(load, run.most_bytes, asked)

    def size_needed(width: int, height: int) -> Size:
        load = sizes(width, height)[0]
        return (width, height) if _is_whole(run, load) else load.measured

    photo = run.read(image, size_needed, plan.options.svg.matte)
    if has_alpha(photo.pixels) and plan.options.written_blend == ADD:
        advice = "--matte white, or --portable"
        raise refusal("the photo", "opaque for additive blending", "a transparent one", advice)
    load, note = sizes(*photo.original_size, has_alpha=has_alpha(photo.pixels))
    if note is not None:
        photo = dataclasses.replace(photo, notes=(*photo.notes, note))
    (width, height), score = load.measured, plan.goal.target
    if score is not None and min(width, height) < score.least_side:
        needed = f"at least {score.least_side} px a side where {score.name} is measured"
        larger = "--full-size, or " if min(photo.original_size) >= score.least_side else ""
        advice = f"{larger}another target than {flag_of(score.option)}"
        raise refusal("the photo", needed, f"{width}x{height} px", advice)
    return photo, load


def _sprite(plan: Plan, run: Run, image: ImageSource, photo: Photo) -> Sprite | None:
    """Return the cells of a photo that is pixel art, None for any other.

    A reduced picture may be an enlarged sprite if most of its pixels equal their neighbours. If it
    had at most 4 megapixels, it is then read again at its own size.
    """
    width, height = photo.original_size
    if (photo.width, photo.height) == (width, height):
        return sprite_of(photo.pixels)
    is_flat = (photo.pixels[:, 1:, :3] == photo.pixels[:, :-1, :3]).all(axis=2).mean() > 0.5
    if not is_flat or width * height > 2**22:
        return None
    return sprite_of(run.read(image, lambda *size: size, plan.options.svg.matte).pixels)


def _is_whole(run: Run, load: Load) -> bool:
    """Return whether the photo is not reduced if it is a drawing.

    If shapes alone are fitted after all, their fit has the size of the load.
    """
    plan, size = load.plan, load.photo.size
    asked = plan.options.run
    if asked.max_size is not None:
        return False
    if plan.goal.time_limit is not None and load.measured != size:
        return False
    most = max(WHOLE_DRAWING, WHOLE_SHARE * plan.preset.max_size**2)
    return math.prod(size) <= most and dataclasses.replace(load, fit=size).bytes <= run.most_bytes


def _exact(plan: Plan, subject: Subject, run: Run) -> Outcome | None:
    """Return the exact file of pixel art, or None if it is larger than the limit of bytes.

    Its areas draw each pixel. Nothing is searched or fitted. If the file is too large, it is tried
    without overlaps. Also return None for any other picture.
    """
    sprite, inks = subject.sprite, plan.options.fit.inks
    if sprite is None:
        return None
    # Imported here because few pictures are pixel art.
    from gauss2svg.areas.find import FoundAreas
    from gauss2svg.pipeline.found import sprite_in_inks

    if isinstance(inks, str):
        sprite = sprite_in_inks(sprite, inks)
    exporter, limit = Exporter(plan, subject), plan.goal.byte_limit
    (width, height), (rows, columns) = subject.canvas, sprite.cells.shape
    scale = width / (columns * sprite.side), height / (rows * sprite.side)
    for overlap in (True, False):
        run.notify("areas")
        wall_s, cpu_s = time.perf_counter(), time.process_time()
        areas, ground = areas_of_sprite(sprite, overlap)
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
        scene = Scene(
            width, height, background=np.ones(3) if ground is None else np.array(ground),
            transparent=ground is None, areas=tuple(area.scaled(*scale) for area in areas),
        )  # fmt: skip
        run.notify("write")
        file = exporter.written(scene, _exact_format(plan, scene))
        if file.size <= limit:
            fitted = FitResult(scene, 0, 0, wall_s, cpu_s, 0, "gain")
            found = FoundAreas(areas, ground, 1.0, math.inf, wall_s, 0.0)
            return exporter.outcome(file, fitted, 0, found)
    return None


def _exact_format(plan: Plan, scene: Scene) -> SvgFormat:
    """Return the format of a file whose user unit is as large as the outlines allow."""
    # With 3 decimals, opacities of 8 bits are off by an eighth of a level.
    svg_format = dataclasses.replace(plan.format, opacity_decimals=3)
    if plan.options.svg.precision is not None:
        return svg_format
    points = np.array([p for area in scene.areas for one in area.outlines for p in one.points])
    units = (unit for unit in (1.0, 0.5) if (points % unit == 0).all())
    return dataclasses.replace(svg_format, precision=next(units, svg_format.precision))


def _outcomes(plan: Plan, run: Run, subject: Subject, fit: Size) -> Iterator[Outcome]:
    """Start the time budget. Then run the searches of the plan, and yield the outcome of each.

    The exact file of pixel art comes before all others. Only a search for areas runs on an image
    of more pixels than the size `fit`.
    """
    if (limit := plan.goal.time_limit) is not None:
        if plan.in_areas:
            subject = subject.reduced(AREA_PIXELS_A_SECOND * limit)
        sizes = math.prod(subject.size), math.prod(subject.photo.shape[:2])
        steps = plan.options.fit.iterations or STEPS
        run.budget = TimeBudget(run.started + limit, *sizes, run.threads, steps)
    if (outcome := _exact(plan, subject, run)) is not None:
        yield outcome
    for one in plan.searches():
        if one.in_areas:
            from gauss2svg.pipeline.by_areas import ByAreas  # loads the kernels of areas

            yield ByAreas(one, subject, run).run()
        else:
            search = ByBytes if one.by_bytes else ByCount
            yield search(one, subject.reduced(math.prod(fit)), run).run()
