"""The main job: photo in, faithful SVG out, with the numbers that say how faithful."""

from __future__ import annotations

import base64
import dataclasses
import html
import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import get_num_threads, set_num_threads
from numba.core import config
from numpy.typing import NDArray

from gauss2svg.alpha import matte_color, pixels_of, shrunk
from gauss2svg.atomic import write_atomically
from gauss2svg.checkpoint import EVERY_S, LONGEST_S, Checkpoint, identity_of, resumed
from gauss2svg.checks import number_within, whole_number
from gauss2svg.errors import InputError
from gauss2svg.fit import FitProgress
from gauss2svg.fit.losses import DEFAULT_LOSS
from gauss2svg.fit.options import DEFAULT_DTYPE
from gauss2svg.fit.placement import DEFAULT_PLACEMENT
from gauss2svg.fit.schedule import DEFAULT_SCHEDULE
from gauss2svg.image import DEFAULT_MAX_PIXELS, ImageSource, Photo, load_image
from gauss2svg.memory import Load, allowed, size_that_fits
from gauss2svg.presentation import page_for
from gauss2svg.pursuit import CAP_FOR_PSNR, Pursuit
from gauss2svg.quality import DEFAULT_QUALITY
from gauss2svg.raster import DEFAULT_RENDERER
from gauss2svg.reporting import decibels, run_report
from gauss2svg.request import Request
from gauss2svg.scene import OVER, Scene
from gauss2svg.svg import GRADIENT, Page, file_bytes, is_svgz, outline_svg
from gauss2svg.svg.encode import LARGEST_NUMBER
from gauss2svg.svg.page import DEFAULT_TITLE
from gauss2svg.targets import Targets, size_in_bytes
from gauss2svg.warmup import COMPILED_S, compile_kernels

# Under a time limit the fit runs on at most so many pixels for each second of it: drawing and
# measuring alone take 20 s for 12 megapixels.
PIXELS_A_SECOND = 150_000
# Canvases to which a shape may reach: its sigma is bounded by one, its cut lies at three.
_MOST_REACH = 5

ProgressCallback = Callable[["Progress"], None]


@dataclass(frozen=True)
class Progress:
    """What `vectorize` is doing: phase, and the state of the fit while that is the phase.

    phase  "read", "compile", with portable "sum", "fit", "write", "measure"; with targets
           "correct" may follow, and the last three again; last of all "finish", if it was asked
           for. fit is there at "sum", "fit", "correct" and "finish"
    """

    phase: str
    fit: FitProgress | None = None


@dataclass(frozen=True, eq=False)
class Result:
    """A vectorised photo; shows itself in a notebook.

    svg     the text of the file
    scene   the fitted Gaussians, on the photo's canvas, in the order of the file
    report  numbers of the run, ready for JSON; see the README for the keys
    raster  (h, w, 3) float32: the SVG as the renderer drew it; (h, w, 4), alpha not multiplied
            in, of a transparent photo
    page    how the file presents the picture
    """

    svg: str
    scene: Scene
    report: dict[str, Any]
    raster: NDArray[np.float32]
    page: Page

    def save(self, path: str | os.PathLike[str], gzip: bool | None = None) -> None:
        """Write the SVG, whole or not at all; raises OutputError if it cannot be written.

        gzip  None: where the path ends in .svgz, and where `vectorize` was told gzip=True
        """
        usual = is_svgz(path) or bool(self.report["gzip"])
        write_atomically(path, file_bytes(self.svg, usual if gzip is None else gzip))

    def outline(self) -> str:
        """The SVG text of the shapes as bare strokes; see gauss2svg.svg.outline_svg."""
        return outline_svg(self.scene, self.page)

    def _repr_html_(self) -> str:
        # As an image of its own: inline, the gradient ids of two results would clash.
        data = base64.b64encode(self.svg.encode()).decode()
        alt = html.escape(self.page.alt or self.page.title)
        return f'<img alt="{alt}" src="data:image/svg+xml;base64,{data}"/>'

    def __repr__(self) -> str:
        r = self.report
        return (
            f"<gauss2svg.Result {r['width']}x{r['height']}, {r['gaussians']} Gaussians, "
            f"{decibels(r['psnr_svg'])}, {r['svg_bytes']} bytes>"
        )


def vectorize(
    image: ImageSource,
    *,
    gaussians: int | str | None = None,
    target_psnr: float | None = None,
    max_bytes: int | str | None = None,
    time_limit: float | None = None,
    quality: str = DEFAULT_QUALITY,
    iterations: int | None = None,
    init: str = DEFAULT_PLACEMENT,
    schedule: str = DEFAULT_SCHEDULE,
    loss: str = DEFAULT_LOSS,
    ssim_weight: float | None = None,
    per_round: int | None = None,
    round_iterations: int | None = None,
    relocate: bool = True,
    blend: str = OVER,
    portable: bool = False,
    falloff: str | None = None,
    max_size: int | None = None,
    max_memory: int | str | None = None,
    form: str = GRADIENT,
    palette: int | None = None,
    stops: int | None = None,
    precision: float | None = None,
    seed: int = 0,
    dtype: str = DEFAULT_DTYPE,
    threads: int | None = None,
    renderer: str = DEFAULT_RENDERER,
    finish: str | None = None,
    title: str = DEFAULT_TITLE,
    alt: str | None = None,
    size: str | None = None,
    aspect: str | None = None,
    segments: int | str | os.PathLike[str] | NDArray[np.integer] | None = None,
    animate: float | None = None,
    fragments: bool = False,
    gzip: bool = False,
    learning_rate: float = 1.0,
    checkpoint: str | os.PathLike[str] | None = None,
    checkpoint_every: float = EVERY_S,
    resume: str | os.PathLike[str] | None = None,
    max_pixels: int = DEFAULT_MAX_PIXELS,
    matte: str | None = None,
    progress: ProgressCallback | None = None,
    stop: Callable[[], bool] | None = None,
    started: float | None = None,
) -> Result:
    """Fit Gaussians to a photo, write them as an SVG, draw it and measure it.

    image       path, bytes, binary file, PIL image, numpy array or torch tensor
    gaussians   how many, >= 0; "auto" or None: as many as the scene is worth
    target_psnr dB of the drawn SVG; as few Gaussians as reach it
    max_bytes   of the file: 150000, "150k", "1.5M"
    time_limit  seconds for all of it, > 0; the fit takes the time that there is
    quality     a preset of gauss2svg.quality: draft, fast, balanced, high, max
    iterations  optimiser steps, >= 1; max_size: longest side in px that the fit runs on,
                >= 1; palette: most gradients in the file, 0 for all; stops: of a gradient,
                5, 6, 8, 10 or 12; precision: of coordinates in px, 0.001..1;
                None: the quality's
    max_memory  bytes that the process may take, such as "2G", by gauss2svg.memory's estimate;
                None: 80 % of what is free. Over it the fit runs on fewer pixels, unless
                max_size was given
    form        of shapes in the file: gradient, for every renderer; blur or hybrid, for those
                of gauss2svg.raster.DRAW_TURNED_BLURS
    init        placement selective, error or random; live: the paper's selective one
    schedule    of a given count: exponential, linear or all-at-once
    loss        mse, l1, mse+ssim or l1+ssim; ssim_weight: of 1 - SSIM in the
                latter two, 0..1; None: 0.2
    per_round   the paper's rounds: exponential ones add min(2^i, per_round), linear ones
                per_round each; round_iterations: of each
    relocate    whether the fit places anew, on the way, what is missed least
    blend       over: painted over each other; add: the paper's sum of Gaussians of eight
                parameters, in a file for the renderers of gauss2svg.raster.DRAW_BLENDS
    portable    the sum is converted to shapes painted over each other, for every renderer
    falloff     gaussian: the paper's; adaptive: each shape learns how crisp its rim is; None:
                that, save in a sum
    seed        >= 0; the same seed gives the same SVG, whatever the number of threads,
                except under a time limit
                (selective placement hardly draws at random: seeds differ little there)
    dtype       float32 or float64, of what the kernels compute
    threads     CPU threads, None: one a core
    renderer    one of gauss2svg.raster.RENDERERS, for the measuring
    title, alt  name and description of the picture, for screen readers
    size        width on paper, such as "120mm" or "5in"; "photo": by its resolution tag;
                None: its px. aspect: preserveAspectRatio, such as "xMidYMid slice"
    segments    layers inside of the rounds: about how many superpixels, the path of a label
                image of the photo's size, or its labels as an array (h, w) of whole numbers
    animate     seconds in which the rounds fade in, where motion is welcome; up to an hour
    fragments   the file, opened as out.svg#round-3, shows the picture up to that round
    gzip        the file is to be gzipped: max_bytes holds for that, and save does it
    max_pixels  most pixels of the photo, told by its header before it is decoded; up to
                gauss2svg.image.MOST_PIXELS
    finish      resvg, cairo, chromium or all: last changes by what they really draw, which
                takes some thirty drawings of each; not with time_limit
    learning_rate  times the usual sizes of all steps of the fit, 1e-6..1e6; one that runs away
                goes back to its best state and on in smaller steps, and the report says so
    checkpoint  path of a file in which the fit keeps where it stands, every checkpoint_every
                seconds, 0..86400; not with time_limit
    resume      path of such a file, of the same photo and options: the fit goes on from there,
                to the same result, bit for bit
    matte       colour over which a transparent photo is shown first: "white", "black", "#fa0",
                "#ffaa00"; None: the SVG is transparent where the photo was
    progress    called with a Progress at every step; nothing is ever printed
    stop        called after every step: True ends the run with the best so far
    started     time.perf_counter() from which time_limit and total_s count; None: now

    With targets a given count is the most there may be. The first bound that binds ends
    the run and is the report's stop_reason; what was not reached is in its `unreached`.
    The SVG has the photo's width and height also where the fit ran on a smaller picture.
    Raises InputError for bad input, RendererError for a renderer that is missing. Calls
    from several threads wait for each other; in a forked child of a process that has
    fitted already numba's OpenMP refuses to work: start children by spawn.
    """
    begun = time.perf_counter() if started is None else started
    targets = Targets(
        target_psnr, None if max_bytes is None else size_in_bytes(max_bytes), time_limit
    )
    request = Request(
        gaussians, quality, iterations, init, schedule, loss, blend, max_size, form,
        palette, stops, precision, seed, dtype, falloff, renderer, finish, targets,
        portable, per_round, round_iterations, ssim_weight, relocate, gzip, learning_rate, matte,
    )  # fmt: skip
    most_bytes = allowed(max_memory)
    for name, given in (("checkpoint", checkpoint), ("resume", resume)):
        if given is not None and time_limit is not None:
            raise InputError(
                f"{name} and time_limit are both given; needed is one of them, for a run against "
                "the clock never repeats itself: give --iterations in place of the limit"
            )
    tell = progress or (lambda _: None)

    tell(Progress("read"))
    photo = load_image(
        image, max_pixels=max_pixels, matte=None if matte is None else matte_color(matte)
    )
    request.check_alpha(photo)
    _check_precision(max(photo.width, photo.height), request)
    width, height, note = _working_size(photo, request, most_bytes)
    if note is not None:
        photo = dataclasses.replace(photo, notes=(*photo.notes, note))
    pixels = pixels_of(photo)
    working = shrunk(pixels, height, width)
    page = page_for(
        photo, working, title=title, alt=alt, size=size, aspect=aspect, segments=segments,
        animate=animate, fragments=fragments,
    )  # fmt: skip
    request = dataclasses.replace(request, page=page)
    every_s = number_within("checkpoint_every", checkpoint_every, 0, LONGEST_S)
    keeper = memory = None
    if checkpoint is not None or resume is not None:
        identity = identity_of(request, pixels, working)
        keeper = None if checkpoint is None else Checkpoint(checkpoint, every_s, identity)
        memory = None if resume is None else resumed(resume, identity)
    with _threads(threads) as thread_count:
        tell(Progress("compile"))
        compile_s = compile_kernels(dtype, blend)
        deadline = None
        if time_limit is not None:
            # A compilation, once in a machine's life, does not count.
            deadline = begun + time_limit + (compile_s if compile_s > COMPILED_S else 0.0)
        outcome = Pursuit(
            pixels,
            working,
            request,
            deadline,
            lambda phase, fitting: tell(Progress(phase, fitting)),
            stop,
            keeper,
            memory,
        ).run()
    report = run_report(
        request, photo, outcome, (width, height), threads=thread_count, compile_s=compile_s,
        total_s=time.perf_counter() - begun,
    )  # fmt: skip
    report["checkpoint_trouble"] = None if keeper is None else keeper.trouble
    return Result(outcome.svg, outcome.scene, report, outcome.measured.raster, page)


def _check_precision(side: int, request: Request) -> None:
    """Refuse a precision at which numbers of the file would be too large, before the fit."""
    least = side * _MOST_REACH / LARGEST_NUMBER
    if request.svg_options(0, None).precision < least:
        raise InputError(
            f"precision is {request.svg_options(0, None).precision:g} px for a photo of {side} px; "
            f"needed is at least {least:.4f}"
        )


def _working_size(photo: Photo, request: Request, most_bytes: int) -> tuple[int, int, str | None]:
    """Size in px that the fit runs on: the quality's, less where time or memory is short.

    And a note where it is memory. Raises InputError where there is too little of it.
    """
    width, height = photo.width, photo.height
    shrunk = min(1.0, request.side / max(width, height))
    limit = request.targets.time_limit_s
    if limit is not None and request.max_size is None:
        shrunk = min(shrunk, math.sqrt(PIXELS_A_SECOND * limit / (width * height)))
    most = request.preset.cap if request.targets.psnr is None else CAP_FOR_PSNR
    load = Load(
        width,
        height,
        max(1, round(width * shrunk)),
        max(1, round(height * shrunk)),
        gaussians=most if request.count is None else request.count,
        loss=request.loss,
        dtype=request.dtype,
        blend=request.blend,
        has_alpha=photo.alpha is not None,
    )
    return size_that_fits(load, most_bytes, asked=request.max_size is not None)


@contextmanager
def _threads(count: int | None) -> Iterator[int]:
    """Use so many numba threads inside; one for each core if None."""
    most = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]
    wanted = most if count is None else whole_number("threads", count, 1, most)
    before = get_num_threads()
    set_num_threads(wanted)
    try:
        yield wanted
    finally:
        set_num_threads(before)
