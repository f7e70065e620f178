"""One run of a photo in a variant, for the benchmark and the gallery: its files, scores and cost.

What is measured has a process of its own: a run of the benchmark, and each run of another tool.
"""

from __future__ import annotations

import gzip
import json
import tempfile
import time
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg.compare.machine import Stopwatch, peak_bytes
from gauss2svg.compare.peers import PEERS, converted
from gauss2svg.compare.records import TOOL, answered, finite
from gauss2svg.compare.variants import AXES, apply_constants, options_in
from gauss2svg.errors import PeerError, RendererError
from gauss2svg.files import as_png
from gauss2svg.measure.check import check, enlarged
from gauss2svg.measure.memory import held_bytes
from gauss2svg.measure.perceptual import packages_missing, perceptual_scores
from gauss2svg.measure.roundtrip import measure_pixels
from gauss2svg.measure.scores import SCORES
from gauss2svg.photo.load import WHITE, load_image
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.vectorize import Result, vectorize_by, warm_up
from gauss2svg.pool import Pool

Request = Mapping[str, Any]
_OF_A_FIT = (
    "fit_width", "fit_height", "gaussians", "iterations", "rounds", "stop_reason", "threads",
    "psnr_roundtrip", "fit_s", "fit_cpu_s", "pixel_pairs", "versions",
)  # fmt: skip
_OF_A_FILE = (
    "width", "height", "renderer", "psnr_model", *(score.key for score in SCORES),
    "psnr_svg_enlarged", "svg_bytes", "svgz_bytes",
)  # fmt: skip


class Run(NamedTuple):
    """A finished run.

    data    the file, an SVG or a raster image
    report  as the command line writes it
    raster  the file as pixels, as the scores have it
    cost    total_s, cpu_s, other_cpu_s and peak_bytes, of our own also warmup_s
    result  of our own
    """

    data: bytes
    report: dict[str, Any]
    raster: NDArray[np.float32]
    cost: dict[str, Any]
    result: Result | None = None


def in_own_process(function: Callable[..., Any], *arguments: Any, timeout_s: float = 0.0) -> Any:
    """Return what a function of a module returns in a process that makes no other run.

    Raises WorkerDiedError, and TimeoutError after timeout_s seconds if that is not 0.
    """
    with Pool(1) as pool:
        return pool.submit(function, *arguments, timeout=timeout_s).result()


def run(request: Request) -> Run:
    """Make the file of a photo and measure it, at the size of the photo.

    request  source (path), tool, settings; options: others of `vectorize` by their names;
             peer_timeout (s); perhaps reference and reference_scale
    Raises Gauss2SvgError where there is no file, or one that cannot be measured.
    """
    return _own(request) if request["tool"] == TOOL else _by_peer(request)


def measured(request: Request) -> dict[str, Any]:
    """Return what the benchmark keeps of a run, or {"error": line}."""
    return finite(answered(_measured, request))


def measured_alone(request: Request) -> dict[str, Any]:
    """Return the same, of a run in a process of its own; of another tool that is its call."""
    if request["tool"] != TOOL:
        return measured(request)
    return answered(lambda request: in_own_process(measured, request), request)


def _measured(request: Request) -> dict[str, Any]:
    report, cost = (made := run(request)).report, made.cost
    names = _OF_A_FILE + _OF_A_FIT if request["tool"] == TOOL else _OF_A_FILE
    used = {name: report[name] for name in AXES if name in report and request["tool"] == TOOL}
    return {
        "used": request["settings"] | used,
        **cost,
        **{name: report.get(name) for name in names},
    }


def _own(request: Request) -> Run:
    apply_constants(request["settings"])
    settings = options_in(request["settings"])
    given = {**settings, **request["options"], "full_size": True}
    options, memory = Options.from_flat(given), given.get("max_memory")
    warmup_s = _warm_up(json.dumps({**settings, "threads": options.run.threads}))
    watch = Stopwatch()
    result = vectorize_by(options, request["source"])
    # Without what the scores take.
    cost = {**watch.read(), "peak_bytes": peak_bytes(), "warmup_s": warmup_s}
    free = memory and memory - held_bytes()
    scores = perceptual_scores(result.raster, result.photo, free).report
    report = {**result.report, "scores": not packages_missing(), **scores}
    if (source := request.get("reference")) is not None:
        size, scale = (report["width"], report["height"]), request["reference_scale"]
        report["psnr_svg_enlarged"] = enlarged(result.svg, source, size, scale).psnr
    return Run(result.svg.encode(), report, result.raster, cost, result)


@cache
def _warm_up(given: str) -> float:
    """Return the seconds of imports and compilation, which are no part of a run's time."""
    begun = time.perf_counter()
    warm_up(json.loads(given))
    return time.perf_counter() - begun


def _by_peer(request: Request) -> Run:
    """Return the run of another tool, for the photo over white."""
    tool, settings, limit_s = (request[name] for name in ("tool", "settings", "peer_timeout"))
    most = request["options"].get("max_pixels")
    photo = load_image(request["source"], matte=WHITE, **({"max_pixels": most} if most else {}))
    with tempfile.TemporaryDirectory(prefix="gauss2svg-") as folder:
        png, output = Path(folder) / "photo.png", Path(folder) / f"output{PEERS[tool].suffix}"
        png.write_bytes(as_png(photo.pixels))
        try:
            told = in_own_process(converted, tool, settings, png, output, timeout_s=limit_s)
        except TimeoutError as error:
            line = f"timed out after {limit_s:g} s. Try a longer --peer-timeout"
            raise PeerError(line) from error
        if "error" in told:
            raise PeerError(told["error"])
        if not output.exists():
            raise PeerError(f"{tool} wrote no file. Try running it by hand")
        data = output.read_bytes()
    if output.suffix != ".svg":
        return Run(data, *_measured_image(data, photo.pixels), told)
    source = request.get("reference")
    scale = None if source is None else request["reference_scale"]
    result = check(photo.pixels, data, reference=source, reference_scale=scale)
    about = {"tool": tool, "settings": settings, "total_s": told["total_s"]}
    return Run(data, about | result.report, result.raster, told)


def _measured_image(
    data: bytes, photo: NDArray[np.float32]
) -> tuple[dict[str, Any], NDArray[np.float32]]:
    raster = load_image(data, matte=WHITE).pixels
    if raster.shape != photo.shape:
        (height, width), (h, w) = photo.shape[:2], raster.shape[:2]
        raise RendererError(f"image must be {width}x{height} px; got {w}x{h}")
    return {
        "width": photo.shape[1],
        "height": photo.shape[0],
        "renderer": "Pillow",
        **measure_pixels(raster, photo),
        **perceptual_scores(raster, photo).report,
        "svg_bytes": len(data),
        "svgz_bytes": len(gzip.compress(data, compresslevel=9, mtime=0)),
    }, raster
