"""One run of a photo in a variant: its scores and cost for the benchmark, its files for a gallery.

What is measured has a process of its own: a run of the benchmark, and each run of another tool.
"""

from __future__ import annotations

import gzip
import json
import tempfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.compare.peers import PEERS, converted
from gauss2svg.compare.records import TOOL, answered, started_watch
from gauss2svg.compare.variants import AXES, apply_constants, options_in
from gauss2svg.errors import PeerError, RendererError
from gauss2svg.files import as_json, as_png, make_folder, saved, write_all_atomically
from gauss2svg.measure.check import check, enlarged
from gauss2svg.measure.heatmap import error_map
from gauss2svg.measure.memory import held_bytes
from gauss2svg.measure.perceptual import packages_missing, perceptual_scores
from gauss2svg.measure.roundtrip import measure_pixels
from gauss2svg.measure.scores import SCORES
from gauss2svg.photo.alpha import over, pixels_of, shrunk
from gauss2svg.photo.load import WHITE, header_of, load_image
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
# Files of a gallery.
PHOTO, THUMBNAIL = "photo.webp", "thumbnail.png"
PICTURE, SCENE, REPORT = "picture.svg", "scene.npz", "report.json"
OUTLINES, ERRORS = "outlines.svg", "errors.png"
SIDE = 74  # px of a crop: at 3x, five fit side by side on a laptop and more than one on a phone
_THUMBNAIL_PX = 320


class Run(NamedTuple):
    """A finished run.

    data    the file, an SVG or a raster image
    report  as the command line writes it
    raster  the file as pixels, as the scores have it
    photo   of the same size, what it was compared with
    cost    total_s, cpu_s, other_cpu_s and peak_bytes, of our own also warmup_s
    result  of our own
    """

    data: bytes
    report: dict[str, Any]
    raster: NDArray[np.float32]
    photo: NDArray[np.float32]
    cost: dict[str, Any]
    result: Result | None = None


def run(request: Request) -> Run:
    """Make the file of a photo and measure it, at the size of the photo.

    request  source (path), tool, settings; options: others of `vectorize` by their names, among
             them max_pixels; peer_timeout (s); perhaps reference, a path and a scale
    Raise Gauss2SvgError where there is no file, or one that cannot be measured.
    """
    return _own(request) if request["tool"] == TOOL else _by_peer(request)


def measured_alone(request: Request) -> dict[str, Any]:
    """Return what the benchmark keeps of a run, or {"error": line}.

    The run has a process of its own. Of another tool that is its call.
    """
    is_own = request["tool"] == TOOL
    return in_own_process(measured, request) if is_own else measured(request)


def measured(request: Request) -> dict[str, Any]:
    """Return what the benchmark keeps of a run that this process makes."""
    made, is_own = run(request), request["tool"] == TOOL
    names = _OF_A_FILE + _OF_A_FIT * is_own
    used = {name: made.report[name] for name in AXES if is_own and name in made.report}
    return {
        "used": request["settings"] | used,
        **made.cost,
        **{name: made.report.get(name) for name in names},
    }


def in_own_process(function: Callable[..., Any], *arguments: Any, timeout_s: float = 0.0) -> Any:
    """Return the record that a function makes in a process that makes no other run, or its error.

    Raise WorkerDiedError, and TimeoutError after timeout_s seconds if that is not 0.
    """
    with Pool(1) as pool:
        return pool.submit(answered, function, *arguments, timeout=timeout_s).result()


# Once for all runs with the same settings in a process. It is no part of their time.
_warmed_up = cache(lambda given: warm_up(json.loads(given)))


def _own(request: Request) -> Run:
    apply_constants(request["settings"])
    settings = options_in(request["settings"])
    options = Options.from_flat({**settings, **request["options"], "full_size": True})
    read = started_watch()
    _warmed_up(json.dumps({**settings, "threads": options.run.threads}))
    warmup_s = read()["total_s"]
    read = started_watch()
    result = vectorize_by(options, request["source"])
    cost = {**read(), "warmup_s": warmup_s}  # without what the scores take
    memory = request["options"].get("max_memory")
    scores = perceptual_scores(result.raster, result.photo, memory and memory - held_bytes())
    report = {**result.report, "scores": not packages_missing(), **scores.report}
    if reference := request.get("reference"):
        size = report["width"], report["height"]
        report["psnr_svg_enlarged"] = enlarged(result.svg, reference[0], size, reference[1]).psnr
    return Run(result.svg.encode(), report, result.raster, result.photo, cost, result)


def _by_peer(request: Request) -> Run:
    """Return the run of another tool, for the photo over white."""
    tool, settings, limit_s = (request[name] for name in ("tool", "settings", "peer_timeout"))
    most = request["options"]["max_pixels"]
    photo = load_image(request["source"], matte=WHITE, max_pixels=most).pixels
    with tempfile.TemporaryDirectory(prefix="gauss2svg-") as folder:
        png, output = Path(folder) / "photo.png", Path(folder) / f"output{PEERS[tool].suffix}"
        png.write_bytes(as_png(photo))
        try:
            cost = in_own_process(converted, tool, settings, png, output, timeout_s=limit_s)
        except TimeoutError as error:
            line = f"timed out after {limit_s:g} s. Try a longer --peer-timeout"
            raise PeerError(line) from error
        if "error" in cost:
            raise PeerError(cost["error"])
        if not output.exists():
            raise PeerError(f"{tool} wrote no file. Try running it by hand")
        data = output.read_bytes()
    if output.suffix != ".svg":
        return Run(data, *_measured_image(data, photo), photo, cost)
    source, scale = request.get("reference") or (None, None)
    result = check(photo, data, reference=source, reference_scale=scale)
    about = {"tool": tool, "settings": settings, "total_s": cost["total_s"]}
    return Run(data, about | result.report, result.raster, photo, cost)


def _measured_image(
    data: bytes, photo: NDArray[np.float32]
) -> tuple[dict[str, Any], NDArray[np.float32]]:
    raster = load_image(data, matte=WHITE).pixels
    (height, width), (h, w) = photo.shape[:2], raster.shape[:2]
    if (height, width) != (h, w):
        raise RendererError(f"image must be {width}x{height} px; got {w}x{h}")
    about = {"width": width, "height": height, "renderer": "Pillow"}
    zipped = gzip.compress(data, compresslevel=9, mtime=0)
    scores = measure_pixels(raster, photo) | perceptual_scores(raster, photo).report
    return about | scores | {"svg_bytes": len(data), "svgz_bytes": len(zipped)}, raster


def make_photo(request: Request) -> dict[str, Any]:
    """Write the photo losslessly and without its metadata, and a thumbnail; return the record.

    request  source, folder, photo_size, and max_pixels among its options
    Raise InputError for a photo that cannot be read, OutputError for the folder.
    """
    most, needed = request["options"]["max_pixels"], request["photo_size"]
    photo = load_image(request["source"], max_pixels=most, needed=needed)
    pixels = pixels_of(photo)
    shown = _encoded(_eight_bits(pixels), "WEBP", lossless=True, exact=True)
    _write(request["folder"], {PHOTO: shown, THUMBNAIL: _thumbnail(pixels)})
    return {"width": photo.width, "height": photo.height, "notes": list(photo.notes)}


def make_svg(request: Request) -> dict[str, Any]:
    """Write an SVG of a photo, its report, thumbnail and error map; return the record.

    request  folder, photo_size, shown (the photo of the page), and what `run` takes
    Raise Gauss2SvgError where it cannot be made.
    """
    header = header_of(request["source"], max_pixels=request["options"]["max_pixels"])
    # A reduced photo is the 8-bit one of the page; others are read as by the command line.
    if header and max(header.width, header.height) > request["photo_size"]:
        request = {**request, "source": request["shown"]}
    made = run(request)
    drawn, photo = over(made.raster), over(made.photo)
    files = {
        PICTURE: made.data,
        REPORT: as_json(made.report),
        THUMBNAIL: _thumbnail(made.raster),
        ERRORS: _encoded(error_map(drawn, photo), "PNG", optimize=True),
    }
    if made.result is not None:
        files[SCENE] = saved(made.result.scene.save)
        files[OUTLINES] = made.result.outline().encode()
    _write(request["folder"], files)
    return {
        "report": made.report,
        "cpu_s": made.cost["cpu_s"],
        "rounds": rounds_of(made.result.svg) if made.result else [],
        "crops": crops_of(drawn, photo),
    }


def rounds_of(svg: str) -> list[list[int]]:
    """Return [round, shapes up to it] of each round of an SVG of our own, from 1."""
    rounds: list[list[int]] = []
    shapes = 0
    for group in svg.split('<g id="round-')[1:]:
        shapes += group.count("<circle")
        rounds.append([int(group.partition('"')[0]), shapes])
    return rounds


def crops_of(
    image: NDArray[np.floating], other: NDArray[np.floating], side: int = SIDE
) -> dict[str, dict[str, Any]]:
    """Return the window with the largest mean squared error, and one with the median error.

    image, other  (h, w, c) in 0..1
    side          of a window, in px; less where an image is smaller
    A window is its top left corner, its size in px, and its PSNR in dB.
    """
    from scipy.ndimage import uniform_filter  # a third of a second

    height, width = image.shape[:2]
    down, across = min(side, height), min(side, width)
    squared = (np.subtract(image, other, dtype=np.float64) ** 2).mean(axis=2)
    means = uniform_filter(squared, (down, across))  # pyright: ignore[reportArgumentType]
    means = means[down // 2 :, across // 2 :]  # by the top left corners
    means = means[: height - down + 1, : width - across + 1]
    crops = {}
    for kind, distance in (("worst", -means), ("typical", np.abs(means - np.median(means)))):
        y, x = map(int, np.unravel_index(np.argmin(distance), means.shape))
        error = squared[y : y + down, x : x + across].mean()  # exactly 0 for equal pixels
        psnr = float(-10 * np.log10(error)) if error else np.inf
        crops[kind] = {"x": x, "y": y, "width": across, "height": down, "psnr": psnr}
    return crops


def thumbnail_size(width: int, height: int) -> tuple[int, int]:
    """Return width and height (px) of the thumbnails of a photo of this size."""
    scale = min(1.0, _THUMBNAIL_PX / max(width, height))
    return max(1, round(width * scale)), max(1, round(height * scale))


def _thumbnail(pixels: NDArray[np.float32]) -> bytes:
    width, height = thumbnail_size(pixels.shape[1], pixels.shape[0])
    return _encoded(_eight_bits(shrunk(pixels, height, width)), "PNG", optimize=True)


def _eight_bits(pixels: NDArray[np.float32]) -> Image.Image:
    return Image.fromarray(np.round(pixels * 255).astype(np.uint8))


def _encoded(picture: Image.Image, form: str, **options: Any) -> bytes:
    return saved(lambda stream: picture.save(stream, form, **options))


def _write(folder: str, files: Mapping[str, bytes]) -> None:
    make_folder(Path(folder))
    write_all_atomically({Path(folder) / name: data for name, data in files.items()})
