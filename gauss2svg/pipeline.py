"""The main job: photo in, faithful SVG out, with the numbers that say how faithful."""

from __future__ import annotations

import base64
import dataclasses
import math
import os
import platform
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
from numba import get_num_threads, set_num_threads
from numba.core import config
from numpy.typing import NDArray

from gauss2svg.atomic import write_atomically
from gauss2svg.checks import whole_number
from gauss2svg.fit import FitOptions, FitProgress, fit
from gauss2svg.fit.losses import DEFAULT_LOSS
from gauss2svg.fit.placement import DEFAULT_PLACEMENT
from gauss2svg.fit.schedule import DEFAULT_SCHEDULE
from gauss2svg.image import ImageSource, load_image, shrink
from gauss2svg.quality import DEFAULT_QUALITY, quality_named
from gauss2svg.raster import DEFAULT_RENDERER, renderer_version
from gauss2svg.roundtrip import round_trip
from gauss2svg.scene import Scene
from gauss2svg.svg import write_svg
from gauss2svg.version import __version__
from gauss2svg.warmup import compile_kernels

ProgressCallback = Callable[["Progress"], None]


@dataclass(frozen=True)
class Progress:
    """What `vectorize` is doing: phase, and the state of the fit while that is the phase.

    phase  "read", "compile", "fit", "write" or "measure", in this order
    """

    phase: str
    fit: FitProgress | None = None


@dataclass(frozen=True, eq=False)
class Result:
    """A vectorised photo; shows itself in a notebook.

    svg     the text of the file
    scene   the fitted Gaussians, on the photo's canvas
    report  numbers of the run, ready for JSON; see the README for the keys
    raster  (h, w, 3) float32: the SVG as the renderer drew it
    """

    svg: str
    scene: Scene
    report: dict[str, Any]
    raster: NDArray[np.float32]

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the SVG, whole or not at all; raises OutputError if it cannot be written."""
        write_atomically(path, self.svg.encode())

    def _repr_html_(self) -> str:
        # As an image of its own: inline, the gradient ids of two results would clash.
        data = base64.b64encode(self.svg.encode()).decode()
        return f'<img alt="vectorised photo" src="data:image/svg+xml;base64,{data}"/>'

    def __repr__(self) -> str:
        r = self.report
        return (
            f"<gauss2svg.Result {r['width']}x{r['height']}, {r['gaussians']} Gaussians, "
            f"{decibels(r['psnr_svg'])}, {r['svg_bytes']} bytes>"
        )


def vectorize(
    image: ImageSource,
    *,
    gaussians: int | None = None,
    quality: str = DEFAULT_QUALITY,
    iterations: int | None = None,
    init: str = DEFAULT_PLACEMENT,
    schedule: str = DEFAULT_SCHEDULE,
    loss: str = DEFAULT_LOSS,
    max_size: int | None = None,
    palette: int | None = None,
    seed: int = 0,
    threads: int | None = None,
    renderer: str = DEFAULT_RENDERER,
    progress: ProgressCallback | None = None,
) -> Result:
    """Fit Gaussians to a photo, write them as an SVG, draw it and measure it.

    image       path, bytes, binary file, PIL image, numpy array or torch tensor
    gaussians   how many, >= 0; None: as many as the quality says
    quality     a preset of gauss2svg.quality: draft, fast, balanced, high, max
    iterations  optimiser steps, >= 1; max_size: longest side in px that the fit runs on,
                >= 1; palette: most colours in the file, 0 for all; None: the quality's
    init        placement selective, error or random
    schedule    exponential, linear or all-at-once
    loss        mse, l1, mse+ssim or l1+ssim
    seed        >= 0; the same seed gives the same SVG, whatever the number of threads
                (selective placement hardly draws at random: seeds differ little there)
    threads     CPU threads, None: one a core; renderer: resvg or cairo, for the measuring
    progress    called with a Progress at every step; nothing is ever printed

    The SVG has the photo's width and height also where the fit ran on a smaller picture.
    Raises InputError for bad input, RendererError for a renderer that is missing. Calls
    from several threads wait for each other; in a forked child of a process that has
    fitted already numba's OpenMP refuses to work: start children by spawn.
    """
    begun = time.perf_counter()
    preset = quality_named(quality)
    options = FitOptions(
        gaussians=preset.gaussians if gaussians is None else gaussians,
        iterations=preset.iterations if iterations is None else iterations,
        placement=init,
        schedule=schedule,
        loss=loss,
        seed=seed,
    )
    preset.svg_options(0, palette)  # a bad palette is told before the fit, not after
    side = preset.max_size if max_size is None else max_size
    whole_number("max_size", side, 1, 2**31 - 1)
    renderer_version(renderer)  # a missing renderer is told before the fit, not after
    tell = progress or (lambda _: None)

    tell(Progress("read"))
    photo = load_image(image)
    shrunk = min(1.0, side / max(photo.width, photo.height))
    width, height = (max(1, round(s * shrunk)) for s in (photo.width, photo.height))
    with _threads(threads) as thread_count:
        tell(Progress("compile"))
        compile_s = compile_kernels()
        fitted = fit(
            shrink(photo.pixels, height, width), options, lambda f: tell(Progress("fit", f))
        )
        tell(Progress("write"))
        scene = fitted.scene.scaled(photo.width / width, photo.height / height)
        scene = scene.replace(width=photo.width, height=photo.height)
        svg_options = preset.svg_options(len(scene), palette)
        svg = write_svg(scene, svg_options)
        tell(Progress("measure"))
        measured = round_trip(svg, scene, photo.pixels, renderer)
    report: dict[str, Any] = {
        "width": photo.width,
        "height": photo.height,
        "fit_width": width,
        "fit_height": height,
        "gaussians": len(scene),
        "iterations": fitted.iterations,
        "rounds": fitted.rounds,
        "quality": quality,
        "init": init,
        "schedule": schedule,
        "loss": loss,
        "palette": svg_options.palette,
        "seed": seed,
        "threads": thread_count,
        "stop_reason": fitted.stop_reason,
        "compile_s": compile_s,
        "fit_s": fitted.wall_s,
        "fit_cpu_s": fitted.cpu_s,
        "pixel_pairs": fitted.pixel_pairs,
        **{
            field.name: _finite(getattr(measured, field.name))
            for field in dataclasses.fields(measured)
            if field.name != "raster"
        },
        "notes": list(photo.notes),
        "versions": _versions(),
        "total_s": time.perf_counter() - begun,
    }
    return Result(svg, scene, report, measured.raster)


def decibels(value: float | None) -> str:
    """A PSNR of the report as text."""
    return "equal" if value is None else f"{value:.2f} dB"


def _finite(value: Any) -> Any:
    """None for an infinite PSNR, of equal pictures: JSON has no infinity."""
    return None if isinstance(value, float) and math.isinf(value) else value


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


def _versions() -> dict[str, str]:
    names = ("numpy", "numba", "scipy", "scikit-image", "torch", "svgwrite", "resvg_py", "CairoSVG")
    found = {"gauss2svg": __version__, "python": platform.python_version()}
    return found | {name: version(name) for name in names}
