"""Vectorise one photo with one variant, and measure the result.

The benchmark takes the scores and the cost from such a run, and a gallery takes the files.

Each run of another tool has its own process, so that its time and memory can be measured.
"""

from __future__ import annotations

import base64
import tempfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.compare import records
from gauss2svg.compare.variants import AXES
from gauss2svg.errors import Gauss2SvgError, RendererError
from gauss2svg.files import SVG_ENDINGS, as_json, as_png, make_folder, saved, write_all_atomically
from gauss2svg.measure import packages_missing
from gauss2svg.measure.check import check
from gauss2svg.measure.heatmap import heatmap
from gauss2svg.measure.perceptual import perceptual_scores
from gauss2svg.measure.roundtrip import measure_pixels
from gauss2svg.photo.load import WHITE_MATTE, header_of, load_image
from gauss2svg.photo.pixels import over, shrunk
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.vectorize import Result, vectorize_by
from gauss2svg.pool import Pool
from gauss2svg.processes import held_bytes
from gauss2svg.svg import NAMESPACE
from gauss2svg.svg.file import MOST_BYTES, file_bytes, read_source

Request = Mapping[str, Any]
# Side (px) of a crop. Pages show crops enlarged 3 times, and five of them fit side by side on the
# screen of a laptop.
SIDE = 74


class Run(NamedTuple):
    """A finished run.

    data    bytes of the file, which is an SVG or a raster image
    report  measurements, as in the file of the option --report
    raster  pixels of the drawn file, from which the scores were computed
    photo   pixels of the photo at the size of `raster`. The two were compared
    cost    total_s, cpu_s and peak_bytes
    result  result of gauss2svg, or None for another tool
    """

    data: bytes
    report: dict[str, Any]
    raster: NDArray[np.float32]
    photo: NDArray[np.float32]
    cost: dict[str, Any]
    result: Result | None = None


def run(request: Request) -> Run:
    """Turn a photo into a file with gauss2svg or another tool, and measure the file.

    The file is drawn at the size of the photo and compared with it.

    request  has the keys source (path of the photo), tool, settings, options (further options of
             `vectorize`, among them max_pixels) and peer_timeout (s). If another method has made
             the file, it also has the keys file (path) and numbers, as of `entries_of`.
    Raise Gauss2SvgError if no file is made, or if the file cannot be measured.
    """
    return _by_gauss2svg(request) if request["tool"] == records.TOOL else _by_peer(request)


def measure_run(request: Request) -> dict[str, Any]:
    """Return the benchmark's record of a run. Call this in a process of its own."""
    if request.get("file") == "":  # published numbers
        report = request["numbers"]
    else:
        finished = run(request)
        report = finished.report | finished.cost
    is_own = request["tool"] == records.TOOL
    used = {name: report[name] for name in AXES if is_own and name in report}
    names = (*records.FILE_KEYS, *records.COUNTS, *records.OWN_KEYS)
    numbers = {name: report.get(name) for name in names} | {"versions": report.get("versions", {})}
    return {"used": request["settings"] | used, **numbers}


def _by_gauss2svg(request: Request) -> Run:
    options = Options.from_flat({**request["settings"], **request["options"], "full_size": True})
    read = records.start_watch()
    result = vectorize_by(options, request["source"])
    # The cost is read here, because it must not include the computation of scores.
    cost = read()
    memory = request["options"].get("max_memory")
    scores = perceptual_scores(result.raster, result.photo, memory and memory - held_bytes())
    report = {**result.report, "scores": not packages_missing(), **scores}
    # The gallery itself asks for fragments, so their note is none for its reader.
    report["notes"] = [note for note in report["notes"] if not note.startswith("--fragments")]
    return Run(result.svg.encode(), report, result.raster, result.photo, cost, result)


def _by_peer(request: Request) -> Run:
    """Measure the file of another method, or run another tool on the photo.

    White is put behind the transparent parts of the photo.
    """
    tool, settings = request["tool"], request["settings"]
    most = request["options"]["max_pixels"]
    photo = load_image(request["source"], matte=WHITE_MATTE, max_pixels=most).pixels
    if "file" in request:
        if request["file"] is None:
            needed = "a file or a row for each photo"
            raise Gauss2SvgError(f"{tool} must have {needed}; got none for this one")
        path, cost = Path(request["file"]), request["numbers"]
        suffix = path.suffix.lower()
        is_svg = suffix in SVG_ENDINGS
        data = read_source(path, MOST_BYTES)[0] if is_svg else path.read_bytes()
    else:
        data, cost = _converted(photo, tool, settings, request["peer_timeout"])
        suffix = records.PEERS[tool].suffix
    columns = {"tool": tool, "settings": settings, **cost}
    cost = {name: cost.get(name) for name in records.COSTS}
    if suffix not in SVG_ENDINGS:
        report, raster = _measured_image(data, photo)
        return Run(_as_svg(data, photo), columns | report, raster, photo, cost)
    result = check(photo, data)
    return Run(data, columns | result.report, result.raster, photo, cost)


def _converted(
    photo: NDArray[np.float32], tool: str, settings: dict[str, Any], limit_s: float
) -> tuple[bytes, dict[str, Any]]:
    """Run another tool on a photo. Return the bytes of its file, and its cost."""
    with tempfile.TemporaryDirectory(prefix="gauss2svg-") as folder:
        png = Path(folder) / "photo.png"
        output = png.with_name(f"output{records.PEERS[tool].suffix}")
        png.write_bytes(as_png(photo))
        call = records.convert_by, tool, settings, png, output
        try:
            with Pool(1) as pool:
                cost = pool.submit(*call, timeout=limit_s).result()
        except TimeoutError as error:
            line = f"timed out after {limit_s:g} s. Try a longer --peer-timeout"
            raise Gauss2SvgError(line) from error
        return output.read_bytes(), cost


def _as_svg(data: bytes, photo: NDArray[np.float32]) -> bytes:
    """Return an SVG that shows a raster image, so that pages treat it like other files."""
    height, width = photo.shape[:2]
    with Image.open(BytesIO(data)) as image:
        kind = image.get_format_mimetype()
    size = f'width="{width}" height="{height}"'
    root = f'<svg {NAMESPACE} {size} viewBox="0 0 {width} {height}">'
    source = f"data:{kind};base64,{base64.b64encode(data).decode()}"
    return f'{root}<image {size} href="{source}"/></svg>'.encode()


def _measured_image(
    data: bytes, photo: NDArray[np.float32]
) -> tuple[dict[str, Any], NDArray[np.float32]]:
    raster = load_image(data, matte=WHITE_MATTE).pixels
    (height, width), (h, w) = photo.shape[:2], raster.shape[:2]
    if (height, width) != (h, w):
        raise RendererError(f"image must be {width}x{height} px; got {w}x{h}")
    columns = {"width": width, "height": height, "renderer": "Pillow"}
    zipped = file_bytes(data, gzipped=True)
    scores = measure_pixels(raster, photo) | perceptual_scores(raster, photo)
    return columns | scores | {"svg_bytes": len(data), "svgz_bytes": len(zipped)}, raster


def make_photo(request: Request) -> dict[str, Any]:
    """Write a photo as lossless WebP, and its thumbnail. Return the record.

    The longest side of the WebP is at most photo_size px.

    request  has the keys source, folder, photo_size, and options with max_pixels
    Raise InputError if the photo cannot be read, and OutputError if a file cannot be written.
    """
    most, needed = request["options"]["max_pixels"], request["photo_size"]
    photo = load_image(request["source"], max_pixels=most, needed=needed)
    pixels = photo.pixels
    shown = Image.fromarray(np.round(pixels * 255).astype(np.uint8))
    webp = saved(lambda stream: shown.save(stream, "WEBP", lossless=True, exact=True))
    _write(request["folder"], {"photo.webp": webp, "thumbnail.png": _thumbnail(pixels)})
    return {"width": photo.width, "height": photo.height, "notes": list(photo.notes)}


def make_svg(request: Request) -> dict[str, Any]:
    """Write an SVG of a photo, and the other files that a gallery shows of it. Return the record.

    request  has all keys that `run` needs, and also `folder`, `photo_size`, and `page_photo`, which
             is the path of the WebP that make_photo wrote
    Raise Gauss2SvgError if the SVG cannot be made.
    """
    header = header_of(request["source"], max_pixels=request["options"]["max_pixels"])
    # The photo's own file is vectorised if the photo is not larger than photo_size. Otherwise the
    # WebP that the page shows is vectorised in its place. This WebP is reduced to photo_size and
    # has 8 bits per channel.
    if header and max(header.width, header.height) > request["photo_size"]:
        request = {**request, "source": request["page_photo"]}
    finished = run(request)
    raster, photo = over(finished.raster), over(finished.photo)
    files = {
        "picture.svg": finished.data,
        "report.json": as_json(finished.report),
        "thumbnail.png": _thumbnail(finished.raster),
        "errors.png": heatmap(raster, photo),
    }
    if finished.result is not None:
        files["scene.npz"] = saved(finished.result.scene.save)
        files["outlines.svg"] = outlines_with_nodes(finished.result)
    _write(request["folder"], files)
    return {
        "report": finished.report,
        "cpu_s": finished.cost["cpu_s"],
        "rounds": rounds_of(finished.result.svg) if finished.result else [],
        "crops": crops_of(raster, photo),
    }


def outlines_with_nodes(result: Result) -> bytes:
    """Return outlines that pages lay over a picture, as SVG. Those of areas and lines have nodes.

    Outlines of areas and lines are one px of the screen wide at any zoom, with a dot on each node.
    Raise InputError for an additive picture, which has no outlines.
    """
    outlines = (outline for area in result.scene.areas for outline in area.outlines)
    dots = "".join(f"M{x:.2f} {y:.2f}h0" for outline in outlines for x, y in outline.nodes)
    nodes = (
        "<style>path{vector-effect:non-scaling-stroke;stroke-linecap:round}"
        "[id|=area]{stroke:#d0f;stroke-width:1px}</style>"
        f'<defs><path id="nodes" d="{dots}"/></defs>'
        '<use href="#nodes" stroke="#d0f" stroke-width="6"/>'
        '<use href="#nodes" stroke="#fff" stroke-width="4"/></svg>'
    )
    return (result.outline().rpartition("</svg>")[0] + nodes).encode()


def rounds_of(svg: str) -> list[list[int]]:
    """Return [number of a round, number of shapes after that round] for each round of an SVG."""
    rounds: list[list[int]] = []
    below, *groups = svg.split('<g id="round-')
    shapes = below.count("<circle")  # shapes below areas are in no group of a round
    for group in groups:
        shapes += group.count("<circle")
        rounds.append([int(group.partition('"')[0]), shapes])
    return rounds


def crops_of(
    image: NDArray[np.floating], other: NDArray[np.floating], side: int = SIDE
) -> dict[str, dict[str, Any]]:
    """Choose the two windows of the image that a page shows enlarged. Return their positions.

    "worst" is the window with the largest mean squared error. "typical" is the window whose mean
    squared error is closest to the median of all windows. The entries of each window are the x and
    y of its top left corner, its width and height (all in px), and its PSNR (dB).

    image, other  pixels (h, w, c) in 0..1
    side          side of a window in px. A window is never larger than the image.
    """
    from scipy.ndimage import uniform_filter  # its import takes a third of a second

    height, width = image.shape[:2]
    down, across = min(side, height), min(side, width)
    squared = (np.subtract(image, other, dtype=np.float64) ** 2).mean(axis=2)
    means = uniform_filter(squared, (down, across))  # pyright: ignore[reportArgumentType]
    # uniform_filter puts the mean of a window at the window's centre. Now each mean is moved to the
    # top left corner of its window.
    means = means[down // 2 :, across // 2 :]
    means = means[: height - down + 1, : width - across + 1]
    crops = {}
    for kind, distance in (("worst", -means), ("typical", np.abs(means - np.median(means)))):
        y, x = map(int, np.unravel_index(np.argmin(distance), means.shape))
        # The mean of this window is computed anew. If the two images are equal in the window, this
        # mean is exactly 0, but the mean in `means` may have a rounding error.
        error = squared[y : y + down, x : x + across].mean()
        psnr = float(-10 * np.log10(error)) if error else None
        crops[kind] = {"x": x, "y": y, "width": across, "height": down, "psnr": psnr}
    return crops


def thumbnail_size(width: int, height: int) -> tuple[int, int]:
    """Return the width and height (px) of thumbnails of a photo with this width and height."""
    scale = min(1.0, 320 / max(width, height))
    return max(1, round(width * scale)), max(1, round(height * scale))


def _thumbnail(pixels: NDArray[np.float32]) -> bytes:
    width, height = thumbnail_size(pixels.shape[1], pixels.shape[0])
    return as_png(shrunk(pixels, height, width))


def _write(folder: str, files: Mapping[str, bytes]) -> None:
    make_folder(Path(folder))
    write_all_atomically({Path(folder) / name: data for name, data in files.items()})
