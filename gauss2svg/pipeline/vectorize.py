"""Vectorising a photo: load, fit, write, rasterise, measure."""

from __future__ import annotations

import dataclasses
import inspect
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numba import get_num_threads, set_num_threads
from numba.core import config
from numpy.typing import NDArray

from gauss2svg.errors import InputError, instance, must_be, shown, whole_number
from gauss2svg.files import check_outputs, reading
from gauss2svg.fit.options import DensifyOptions, FitOptions, FitProgress
from gauss2svg.measure.memory import held_bytes
from gauss2svg.measure.perceptual import Scores, perceptual_scores
from gauss2svg.measure.scores import Score
from gauss2svg.options import file_name
from gauss2svg.photo.alpha import matte_color, pixels_of, shrunk
from gauss2svg.photo.load import ImageSource, header_of, load_image, rereadable
from gauss2svg.pipeline.candidate import Exporter, Outcome
from gauss2svg.pipeline.checkpoint import Checkpoint, identity_of, resumed
from gauss2svg.pipeline.document import document_for
from gauss2svg.pipeline.kernels import COMPILED_S, compile_kernels, compile_reading
from gauss2svg.pipeline.memory_budget import Load, allowed, check_decoding, size_that_fits
from gauss2svg.pipeline.options import Goal, Options, RunOptions, SvgOptions
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.report import run_report
from gauss2svg.pipeline.result import Progress, ProgressCallback, Result
from gauss2svg.pipeline.search import CAP_FOR_TARGET, TargetSearch
from gauss2svg.pipeline.time_budget import TimeBudget, steps_for
from gauss2svg.pipeline.ways import closest, small_outcome
from gauss2svg.svg.document import Document
from gauss2svg.svg.encode import LARGEST_NUMBER

# Largest size of the fit per second of a time limit, seconds of it that the start takes, and that
# are left at least (docs/decisions/time.md).
_PIXELS_PER_SECOND, _START_S, _LEAST_S = 150_000, 0.5, 0.25
_MOST_REACH = 5  # canvas sides that a shape may extend to: sigma is at most 1, the cut-off is at 3


def vectorize(
    image: ImageSource,
    goal: Goal | None = None,
    *,
    quality: str | None = None,
    gaussians: int | str | None = None,
    target_psnr: float | None = None,
    target_ssimulacra2: float | None = None,
    max_bytes: int | str | None = None,
    time_limit: float | None = None,
    fit: FitOptions | None = None,
    densify: DensifyOptions | None = None,
    svg: SvgOptions | None = None,
    document: Document | None = None,
    run: RunOptions | None = None,
    progress: ProgressCallback | None = None,
    stop: Callable[[], bool] | None = None,
) -> Result:
    """Fit Gaussians to a photo, write them as an SVG, rasterise it and measure it.

    image     path, bytes, binary file, PIL image, numpy array or torch tensor
    goal      quality, gaussians, target_psnr, target_ssimulacra2, max_bytes and time_limit, which
              may also be given by these names: vectorize("photo.jpg", max_bytes="500k")
    fit, densify, svg, document, run
              less common options; each class documents its fields
    progress  called with a Progress at every step; nothing is printed
    stop      called after every step; True ends the run with the best result so far

    With a target, a given number of Gaussians is the largest allowed. The first limit reached ends
    the run and is the report's stop_reason; missed targets are in its `unreached`. The SVG has the
    photo's width and height even if the fit ran on a smaller image.
    Raises InputError for invalid input, RendererError for a missing renderer. Calls from several
    threads wait for each other; a forked child may call it as well.
    """
    given = {
        name: value
        for name, value in {
            "quality": quality,
            "gaussians": gaussians,
            "target_psnr": target_psnr,
            "target_ssimulacra2": target_ssimulacra2,
            "max_bytes": max_bytes,
            "time_limit": time_limit,
        }.items()
        if value is not None
    }
    options = Options(
        goal=dataclasses.replace(instance(goal, "goal", Goal), **given),
        fit=instance(fit, "fit", FitOptions),
        densify=instance(densify, "densify", DensifyOptions),
        svg=instance(svg, "svg", SvgOptions),
        document=instance(document, "document", Document),
        run=instance(run, "run", RunOptions),
    )
    return vectorize_by(options, image, progress=progress, stop=stop)


def vectorize_by(
    options: Options,
    image: ImageSource,
    *,
    progress: ProgressCallback | None = None,
    stop: Callable[[], bool] | None = None,
    started: float | None = None,
    may_reduce: bool = True,
) -> Result:
    """`vectorize` with all options in one object.

    may_reduce  whether the fit may run on a smaller image for lack of memory; InputError if not
    started     when time_limit and total_s begin, by time.perf_counter(); None: now
    """
    begun = time.perf_counter() if started is None else started
    plan, run = Plan(options), options.run
    plan.check_renderer()
    _check_callable("progress", progress, "a Progress")
    _check_callable("stop", stop)
    thread_count = _thread_count(run.threads)
    _check_checkpoints(options, image)
    most_bytes = allowed(run.max_memory)
    notify = (lambda _: None) if progress is None else progress

    notify(Progress("read"))
    image = rereadable(image)
    header = header_of(image, max_pixels=run.max_pixels)
    if header is not None:  # what cannot fit is refused before its pixels take memory
        _working_size(header.width, header.height, False, plan, most_bytes, may_reduce)
        check_decoding(header, most_bytes)
    compile_s = compile_reading()  # before it is needed, so that it does not count either
    matte = options.svg.matte
    photo = load_image(
        image, max_pixels=run.max_pixels, matte=None if matte is None else matte_color(matte)
    )
    plan.check_alpha(photo)
    _check_precision(max(photo.width, photo.height), plan)
    transparent = photo.alpha is not None
    width, height, note = _working_size(
        photo.width, photo.height, transparent, plan, most_bytes, may_reduce
    )
    if note is not None:
        photo = dataclasses.replace(photo, notes=(*photo.notes, note))
    _check_side(min(width, height), options.goal.target)
    plan = dataclasses.replace(plan, fit_side=max(width, height))
    pixels = pixels_of(photo)
    working = shrunk(pixels, height, width)
    document = document_for(photo, working, options.document)
    checkpoint = saved = None
    if run.checkpoint is not None or run.resume is not None:
        identity = identity_of(options, document, pixels, working)
        if run.checkpoint is not None:
            checkpoint = Checkpoint(run.checkpoint, run.checkpoint_every, identity)
        saved = None if run.resume is None else resumed(run.resume, identity)
    limit = options.goal.time_limit
    with _threads(thread_count):
        notify(Progress("compile"))
        compile_s += compile_kernels(blend=options.fit.blend)
        deadline = None
        if limit is not None:
            # The first compilation on a machine does not count.
            deadline = begun + limit + (compile_s if compile_s > COMPILED_S else 0.0)

        ways = plan.ways

        def found(way: Plan) -> tuple[Outcome, NDArray[np.float32]]:
            def report_phase(phase: str, fitting: FitProgress | None) -> None:
                # A signal between two ways must not lose the file that is found already.
                if fitting is not None or way is ways[-1]:
                    notify(Progress(phase, fitting))

            budget = TimeBudget(
                deadline, (width, height), pixels[:, :, 0].size, thread_count,
                steps_for(plan, working), run.renderer,
            )  # fmt: skip
            if way.is_small:
                return small_outcome(way, pixels, document, budget, report_phase, stop)
            exporter = Exporter(pixels, working, way, document)
            search = TargetSearch(way, exporter, budget, report_phase, stop, checkpoint, saved)
            return search.run(), working

        chosen, outcome, fitted_on = closest(ways, found)
    working = fitted_on
    height, width = working.shape[:2]
    raster = outcome.measured.raster
    reference = pixels if raster.shape == pixels.shape else working
    scores = Scores()
    if run.scores or (plan.aim is not None and not plan.aim.of.always):
        known = None if plan.aim is None else plan.aim.reported(outcome.reached)
        scores = perceptual_scores(raster, reference, most_bytes - held_bytes(), known)
    report = run_report(
        plan, chosen, document, photo, outcome, (width, height), scores, threads=thread_count,
        compile_s=compile_s, total_s=time.perf_counter() - begun,
    )  # fmt: skip
    report["checkpoint_trouble"] = None if checkpoint is None else checkpoint.trouble
    return Result(outcome.svg, outcome.scene, report, raster, reference, document)


def _check_callable(name: str, function: object, *arguments: str) -> None:
    """Raise InputError for what cannot be called with so many arguments; None is allowed."""
    if function is None:
        return
    try:
        if callable(function):
            inspect.signature(function).bind(*arguments)
            return
    except ValueError:  # a built-in function, whose arguments are not known
        return
    except TypeError:
        pass
    needed = f"a function of {' and '.join(arguments) or 'no arguments'}"
    raise InputError(must_be(name, needed, shown(type(function).__name__)))


def _check_checkpoints(options: Options, image: ImageSource) -> None:
    """Raise InputError or OutputError for checkpoints that cannot be read or written."""
    run = options.run
    if run.resume is not None:
        with reading(run.resume, "a file of --checkpoint"):
            pass
    if run.checkpoint is not None:
        Checkpoint(run.checkpoint, run.checkpoint_every, {})  # checks the path
        read = {"the photo": image, "the label image": options.document.segments}
        names = {
            file_name(what, source): what
            for what, source in read.items()
            if isinstance(source, (str, os.PathLike))
        }
        there = {name: what for name, what in names.items() if os.path.exists(name)}
        check_outputs(there, [Path(run.checkpoint)])


def _check_precision(side: int, plan: Plan) -> None:
    """Raise InputError for a precision at which numbers of the file would be too large."""
    least = side * _MOST_REACH / LARGEST_NUMBER
    if plan.svg_format.precision < least:
        got = shown(f"{plan.svg_format.precision:g}")
        raise InputError(must_be("precision", f"at least {least:.4f} for {side} px", got))


def _check_side(side: int, score: Score | None) -> None:
    """Raise InputError for a fit on an image that is too small for the score of its target."""
    if score is not None and side < score.least_side:
        needed = f"at least {score.least_side} px, at which {score.name} is measured"
        got = shown(f"{side} px")
        advice = "--target-psnr, or a larger --max-size"
        raise InputError(must_be("short side of the image that is fitted", needed, got, advice))


def load_of(plan: Plan, width: int, height: int, has_alpha: bool) -> Load:
    """What determines the memory of a run on a photo of that size in px."""
    goal, asked = plan.options.goal, plan.options.run.max_size is not None
    shrunk = min(1.0, plan.side / max(width, height))
    if goal.time_limit is not None and not asked:
        pixels = _PIXELS_PER_SECOND * max(goal.time_limit - _START_S, _LEAST_S)
        shrunk = min(shrunk, math.sqrt(pixels / (width * height)))
    fit_width, fit_height = (max(1, round(side * shrunk)) for side in (width, height))
    most = plan.preset.cap if plan.aim is None else CAP_FOR_TARGET
    return Load(
        width,
        height,
        fit_width,
        fit_height,
        gaussians=most if plan.count is None else plan.count,
        adapts=plan.count is None,
        loss=plan.options.fit.loss,
        blend=plan.options.fit.blend,
        has_alpha=has_alpha,
        scoring=0 if goal.target is None else goal.target.pixel_bytes,
    )


def _working_size(
    width: int, height: int, has_alpha: bool, plan: Plan, most_bytes: int, may_reduce: bool
) -> tuple[int, int, str | None]:
    """Width and height in px of the fit: the preset's, smaller for lack of time or memory.

    And a note if memory is the reason. Raises InputError for too little memory.
    """
    load = load_of(plan, width, height, has_alpha)
    asked = plan.options.run.max_size is not None or not may_reduce
    return size_that_fits(load, most_bytes, asked=asked)


def _thread_count(count: int | None) -> int:
    """That number, or one for each core if None; raises InputError for more than the cores."""
    most = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]
    return most if count is None else whole_number("threads", count, 1, most)


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Inside numba uses so many threads."""
    before = get_num_threads()
    set_num_threads(count)
    try:
        yield
    finally:
        set_num_threads(before)
