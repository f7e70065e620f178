"""A run of a photo in a variant: its scores and cost for the benchmark, its files for a gallery.

Each run of the benchmark, and each run of another tool, has its own process, so that its time and
memory can be measured.
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

from gauss2svg.compare.peers import PEERS, convert_by
from gauss2svg.compare.records import TOOL, record_or_error, start_watch
from gauss2svg.compare.variants import AXES, apply_constants, options_in
from gauss2svg.errors import PeerError, RendererError
from gauss2svg.files import as_json, as_png, make_folder, saved, write_all_atomically
from gauss2svg.measure import SCORES, packages_missing
from gauss2svg.measure.check import check, enlarged
from gauss2svg.measure.heatmap import error_map
from gauss2svg.measure.perceptual import perceptual_scores
from gauss2svg.measure.roundtrip import measure_pixels
from gauss2svg.photo.load import WHITE, header_of, load_image
from gauss2svg.photo.pixels import over, pixels_of, shrunk
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.vectorize import Result, vectorize_by, warm_up
from gauss2svg.pool import Pool
from gauss2svg.processes import held_bytes

Request = Mapping[str, Any]
# Keys of a report that are also in a record of the benchmark: _FIT_KEYS for gauss2svg alone,
# _FILE_KEYS for all tools.
_FIT_KEYS = (
    "fit_width", "fit_height", "gaussians", "iterations", "rounds", "stop_reason", "threads",
    "psnr_roundtrip", "fit_s", "fit_cpu_s", "pixel_pairs", "versions",
)  # fmt: skip
_FILE_KEYS = (
    "width", "height", "renderer", "psnr_model", *(score.key for score in SCORES),
    "psnr_svg_enlarged", "svg_bytes", "svgz_bytes",
)  # fmt: skip
# Names of the files of a gallery.
PHOTO, THUMBNAIL = "photo.webp", "thumbnail.png"
PICTURE, SCENE, REPORT = "picture.svg", "scene.npz", "report.json"
OUTLINES, ERRORS = "outlines.svg", "errors.png"
SIDE = 74  # px, side of a crop. Enlarged 3x, five fit side by side on the screen of a laptop
_THUMBNAIL_PX = 320  # longest side of a thumbnail


class Run(NamedTuple):
    """A finished run.

    data    bytes of the file, an SVG or a raster image
    report  measurements, in the form in which the command line writes them
    raster  pixels of the drawn file, from which the scores were computed
    photo   pixels of the photo, in the same size, with which `raster` was compared
    cost    total_s, cpu_s, other_cpu_s and peak_bytes, and for gauss2svg also warmup_s
    result  result of gauss2svg; None for other tools
    """

    data: bytes
    report: dict[str, Any]
    raster: NDArray[np.float32]
    photo: NDArray[np.float32]
    cost: dict[str, Any]
    result: Result | None = None


def run(request: Request) -> Run:
    """Make the file of a photo, and measure it at the size of the photo.

    request  source (path), tool, settings, options (further options of `vectorize`, among them
             max_pixels), peer_timeout (s), and perhaps reference (a path and a scale)
    Raise Gauss2SvgError if no file is made, or if it cannot be measured.
    """
    return _by_gauss2svg(request) if request["tool"] == TOOL else _by_peer(request)


def measure_alone(request: Request) -> dict[str, Any]:
    """Return the benchmark's record of a run, or {"error": line}.

    A run of gauss2svg has its own process. For another tool, only the call of the tool has one.
    """
    is_own = request["tool"] == TOOL
    return in_own_process(measure_run, request) if is_own else measure_run(request)


def measure_run(request: Request) -> dict[str, Any]:
    """Return the benchmark's record of a run that is made in this process."""
    finished, is_own = run(request), request["tool"] == TOOL
    names = _FILE_KEYS + _FIT_KEYS * is_own
    used = {name: finished.report[name] for name in AXES if is_own and name in finished.report}
    return {
        "used": request["settings"] | used,
        **finished.cost,
        **{name: finished.report.get(name) for name in names},
    }


def in_own_process(function: Callable[..., Any], *arguments: Any, timeout_s: float = 0.0) -> Any:
    """Call a function in a new process, and return its record, or {"error": line}.

    Raise WorkerDiedError if the process dies, and TimeoutError after timeout_s seconds. 0 seconds
    mean no limit.
    """
    with Pool(1) as pool:
        return pool.submit(record_or_error, function, *arguments, timeout=timeout_s).result()


# A process warms up once for all its runs with the same settings. Their time excludes the warm-up.
_warm_up_once = cache(lambda options_json: warm_up(json.loads(options_json)))


def _by_gauss2svg(request: Request) -> Run:
    apply_constants(request["settings"])
    settings = options_in(request["settings"])
    options = Options.from_flat({**settings, **request["options"], "full_size": True})
    read = start_watch()
    _warm_up_once(json.dumps({**settings, "threads": options.run.threads}))
    warmup_s = read()["total_s"]
    read = start_watch()
    result = vectorize_by(options, request["source"])
    cost = {**read(), "warmup_s": warmup_s}  # read before the scores are computed
    memory = request["options"].get("max_memory")
    scores = perceptual_scores(result.raster, result.photo, memory and memory - held_bytes())
    report = {**result.report, "scores": not packages_missing(), **scores.report}
    if reference := request.get("reference"):
        size = report["width"], report["height"]
        report["psnr_svg_enlarged"] = enlarged(result.svg, reference[0], size, reference[1]).psnr
    return Run(result.svg.encode(), report, result.raster, result.photo, cost, result)


def _by_peer(request: Request) -> Run:
    """Return the run of another tool, which is given the photo over white."""
    tool, settings, limit_s = (request[name] for name in ("tool", "settings", "peer_timeout"))
    most = request["options"]["max_pixels"]
    photo = load_image(request["source"], matte=WHITE, max_pixels=most).pixels
    with tempfile.TemporaryDirectory(prefix="gauss2svg-") as folder:
        png, output = Path(folder) / "photo.png", Path(folder) / f"output{PEERS[tool].suffix}"
        png.write_bytes(as_png(photo))
        try:
            cost = in_own_process(convert_by, tool, settings, png, output, timeout_s=limit_s)
        except TimeoutError:
            cost = {"error": f"timed out after {limit_s:g} s. Try a longer --peer-timeout"}
        if "error" in cost or not output.exists():
            line = f"{tool} wrote no file. Try running it by hand"
            raise PeerError(cost.get("error", line))
        data = output.read_bytes()
    if output.suffix != ".svg":
        return Run(data, *_measured_image(data, photo), photo, cost)
    source, scale = request.get("reference") or (None, None)
    result = check(photo, data, reference=source, reference_scale=scale)
    columns = {"tool": tool, "settings": settings, "total_s": cost["total_s"]}
    return Run(data, columns | result.report, result.raster, photo, cost)


def _measured_image(
    data: bytes, photo: NDArray[np.float32]
) -> tuple[dict[str, Any], NDArray[np.float32]]:
    raster = load_image(data, matte=WHITE).pixels
    (height, width), (h, w) = photo.shape[:2], raster.shape[:2]
    if (height, width) != (h, w):
        raise RendererError(f"image must be {width}x{height} px; got {w}x{h}")
    columns = {"width": width, "height": height, "renderer": "Pillow"}
    zipped = gzip.compress(data, compresslevel=9, mtime=0)
    scores = measure_pixels(raster, photo) | perceptual_scores(raster, photo).report
    return columns | scores | {"svg_bytes": len(data), "svgz_bytes": len(zipped)}, raster


def make_photo(request: Request) -> dict[str, Any]:
    """Write a photo as lossless WebP of at most photo_size, and its thumbnail. Return the record.

    request  source, folder, photo_size, and options with max_pixels
    Raise InputError if the photo cannot be read, and OutputError if a file cannot be written.
    """
    most, needed = request["options"]["max_pixels"], request["photo_size"]
    photo = load_image(request["source"], max_pixels=most, needed=needed)
    pixels = pixels_of(photo)
    webp = _encoded(_eight_bits(pixels), "WEBP", lossless=True, exact=True)
    _write(request["folder"], {PHOTO: webp, THUMBNAIL: _thumbnail(pixels)})
    return {"width": photo.width, "height": photo.height, "notes": list(photo.notes)}


def make_svg(request: Request) -> dict[str, Any]:
    """Write an SVG of a photo, and the files of a gallery that belong to it. Return the record.

    request  folder, photo_size, page_photo (path of the page's photo), and all that `run` needs
    Raise Gauss2SvgError if the SVG cannot be made.
    """
    header = header_of(request["source"], max_pixels=request["options"]["max_pixels"])
    # If the photo is larger than photo_size, the page's photo is read, which is reduced and has 8
    # bits. Otherwise the photo is read as the command line reads it.
    if header and max(header.width, header.height) > request["photo_size"]:
        request = {**request, "source": request["page_photo"]}
    finished = run(request)
    raster, photo = over(finished.raster), over(finished.photo)
    files = {
        PICTURE: finished.data,
        REPORT: as_json(finished.report),
        THUMBNAIL: _thumbnail(finished.raster),
        ERRORS: _encoded(error_map(raster, photo), "PNG", optimize=True),
    }
    if finished.result is not None:
        files[SCENE] = saved(finished.result.scene.save)
        files[OUTLINES] = finished.result.outline().encode()
    _write(request["folder"], files)
    return {
        "report": finished.report,
        "cpu_s": finished.cost["cpu_s"],
        "rounds": rounds_of(finished.result.svg) if finished.result else [],
        "crops": crops_of(raster, photo),
    }


def rounds_of(svg: str) -> list[list[int]]:
    """Return [number of a round, number of shapes up to its end] for each round of an SVG."""
    rounds: list[list[int]] = []
    shapes = 0
    for group in svg.split('<g id="round-')[1:]:
        shapes += group.count("<circle")
        rounds.append([int(group.partition('"')[0]), shapes])
    return rounds


def crops_of(
    image: NDArray[np.floating], other: NDArray[np.floating], side: int = SIDE
) -> dict[str, dict[str, Any]]:
    """Return two windows: "worst" with the largest mean squared error, "typical" with the median.

    image, other  pixels (h, w, c) in 0..1
    side          side of a window in px; smaller if the image is smaller
    A window has the x and y of its top left corner, its width and height (all in px), and its PSNR
    (dB).
    """
    from scipy.ndimage import uniform_filter  # its import takes a third of a second

    height, width = image.shape[:2]
    down, across = min(side, height), min(side, width)
    squared = (np.subtract(image, other, dtype=np.float64) ** 2).mean(axis=2)
    means = uniform_filter(squared, (down, across))  # pyright: ignore[reportArgumentType]
    means = means[down // 2 :, across // 2 :]  # now an index is a window's top left corner
    means = means[: height - down + 1, : width - across + 1]
    crops = {}
    for kind, distance in (("worst", -means), ("typical", np.abs(means - np.median(means)))):
        y, x = map(int, np.unravel_index(np.argmin(distance), means.shape))
        error = squared[y : y + down, x : x + across].mean()  # exactly 0 if pixels are equal
        psnr = float(-10 * np.log10(error)) if error else np.inf
        crops[kind] = {"x": x, "y": y, "width": across, "height": down, "psnr": psnr}
    return crops


def thumbnail_size(width: int, height: int) -> tuple[int, int]:
    """Return the width and height (px) of thumbnails of a photo with this width and height."""
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
