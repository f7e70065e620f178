"""The images, SVGs and reports of a photo, in folders that stay when other photos come or go.

The crops that pages enlarge are the worst one and a typical one.

A folder is finished once it has its record, which is written last.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.compare.machine import machine
from gauss2svg.compare.records import TOOL, answered, finite
from gauss2svg.compare.run import run
from gauss2svg.compare.variants import Variant
from gauss2svg.errors import OutputError
from gauss2svg.files import as_json, as_png, make_folder, saved, write_all_atomically
from gauss2svg.measure.check import check
from gauss2svg.measure.heatmap import error_map
from gauss2svg.measure.perceptual import packages, packages_missing
from gauss2svg.photo.alpha import over, pixels_of, shrunk
from gauss2svg.photo.load import header_of, load_image
from gauss2svg.pipeline.listing import ListedPhoto, slug_of
from gauss2svg.svg.read import parse_document

PHOTOS = "photos"  # the folder of the photos' folders
RECORD = "record.json"
PHOTO, THUMBNAIL = "photo.webp", "thumbnail.png"
PICTURE, SCENE, REPORT = "picture.svg", "scene.npz", "report.json"
OUTLINES, ERRORS = "outlines.svg", "errors.png"
_THUMBNAIL_PX = 320
_MOST_WEBP_PX = 16383  # largest side of a WebP image
_PNG_PHOTO = "photo.png"

Request = Mapping[str, Any]
_ROUND = re.compile(r"round-([0-9]+)")


def folder_of(photo: ListedPhoto, variant: Variant | None = None) -> str:
    """The folder of a photo, or of an SVG of it, relative to the gallery, with /."""
    return f"{PHOTOS}/{photo.slug}" + (f"/{variant.slug}" if variant else "")


def with_kept_slugs(photos: Iterable[ListedPhoto], folder: Path) -> list[ListedPhoto]:
    """The photos with the slugs of folders that already hold their results.

    Without this, adding or removing a photo of the same name would change the folder of another,
    and all its SVGs would be made again.
    """
    listed = list(photos)
    taken = {photo.slug for photo in listed}
    found = []
    for photo in listed:
        plain = slug_of(Path(photo.path).stem)
        others = [plain, f"{plain}-{photo.digest[:8]}"] if photo.digest else []
        slugs = [photo.slug, *(slug for slug in others if slug not in taken)]
        slug = next((s for s in slugs if _holds(folder / s, photo.digest)), photo.slug)
        taken.add(slug)
        found.append(replace(photo, slug=slug))
    return found


def _holds(folder: Path, digest: str | None) -> bool:
    try:
        record = json.loads((folder / RECORD).read_bytes())
    except (OSError, ValueError):
        return False
    return isinstance(record, dict) and digest is not None and record.get("digest") == digest


def answer_to(request: Request) -> dict[str, Any]:
    """The record of what a request asks for, or {"error": ..}: what a worker does."""
    return answered(make_photo if request["kind"] == "photo" else make_variant, request)


def make_photo(request: Request) -> dict[str, Any]:
    """Write the photo losslessly and without its metadata, and a thumbnail; returns the record.

    request  path, digest, key, folder, photo_size, max_pixels
    Raises InputError for a photo that cannot be read, OutputError for the folder.
    """
    needed = request["photo_size"]
    photo = load_image(request["path"], max_pixels=request["max_pixels"], needed=needed)
    pixels = pixels_of(photo)
    height, width = pixels.shape[:2]
    name = PHOTO if max(width, height) <= _MOST_WEBP_PX else _PNG_PHOTO
    if name == PHOTO:
        shown = _encoded(_eight_bits(pixels), "WEBP", lossless=True, exact=True)
    else:
        shown = as_png(pixels)
    record = {"digest": request["digest"], "photo": name, "width": width, "height": height}
    record["notes"] = list(photo.notes)
    return _finish(request, {name: shown, THUMBNAIL: _thumbnail(pixels)}, record)


def make_variant(request: Request) -> dict[str, Any]:
    """Write an SVG of the photo, its report, thumbnail and error map; returns the record.

    request  path, key, folder, photo_size, jobs, what `run` takes, and shown, the path of the photo
             that the pages show
    Where it is there already and only scores are missing, whose packages have been installed
    since, nothing is fitted anew. Raises Gauss2SvgError where it cannot be made.
    """
    # A reduced photo is the 8-bit one of the page; others are read as by the command line.
    most = request["options"]["max_pixels"]
    header = header_of(request["path"], max_pixels=most)
    assert header is not None  # it is a file
    is_reduced = max(header.width, header.height) > request["photo_size"]
    source = request["shown"] if is_reduced else request["path"]
    kept = finished(Path(request["folder"]), request["key"])
    if kept is not None:
        return _scored(source, request, kept)
    made = run({**request, "source": source})
    rendered = over(made.raster)
    photo = over(pixels_of(load_image(source, max_pixels=most)))
    worst, typical = worst_and_typical(rendered, photo)
    files = {
        PICTURE: made.data,
        REPORT: as_json(made.report),
        THUMBNAIL: _thumbnail(made.raster),
        ERRORS: _encoded(error_map(rendered, photo), "PNG", optimize=True),
    }
    extra = {name: made.cost[name] for name in ("total_s", "cpu_s", "other_cpu_s")}
    if made.result is not None:
        files[SCENE] = saved(made.result.scene.save)
        files[OUTLINES] = made.result.outline().encode()
        extra["rounds"] = rounds_of(made.result.svg)
    extra |= {"worst": worst._asdict(), "typical": typical._asdict(), "scored_by": packages()}
    extra["origin"] = {
        "date": datetime.now(UTC).date().isoformat(),
        "machine": machine(),
        "jobs": request["jobs"],
        "threads": request["options"]["threads"],
    }
    return _finish(request, files, extra)


def rounds_of(svg: str) -> list[list[int]]:
    """[round, shapes up to it] of each group of the SVG that is a round, from 1."""
    found: list[list[int]] = []
    total = 0
    for group in parse_document(svg):
        if named := _ROUND.fullmatch(group.get("id", "")):
            total += sum(element.tag.endswith("}circle") for element in group.iter())
            found.append([int(named[1]), total])
    return found


def _scored(source: str, request: Request, record: dict[str, Any]) -> dict[str, Any]:
    """Add the scores to the report of a finished SVG; returns the record."""
    folder, own = Path(request["folder"]), request["tool"] == TOOL
    checked = check(
        source,
        folder / PICTURE,
        max_pixels=request["options"]["max_pixels"],
        matte=None if own else "white",
    )
    asked = {"scores": not packages_missing()} if own else {}
    report = as_json(json.loads((folder / REPORT).read_bytes()) | asked | checked.scores.report)
    record = record | {
        "files": record["files"] | {REPORT: len(report)},
        "scored_by": packages(),
    }
    write_all_atomically({folder / REPORT: report, folder / RECORD: as_json(record)})
    return record


def is_scored(record: Mapping[str, Any]) -> bool:
    """Whether a finished SVG has been scored by all packages that are installed; True of photos."""
    return packages().items() <= record.get("scored_by", packages()).items()


def _eight_bits(pixels: NDArray[np.float32]) -> Image.Image:
    return Image.fromarray(np.round(pixels * 255).astype(np.uint8))


def _thumbnail(pixels: NDArray[np.float32]) -> bytes:
    width, height = thumbnail_size(pixels.shape[1], pixels.shape[0])
    return _encoded(_eight_bits(shrunk(pixels, height, width)), "PNG", optimize=True)


def thumbnail_size(width: int, height: int) -> tuple[int, int]:
    """Width and height (px) of the thumbnails of a photo of this size."""
    scale = min(1.0, _THUMBNAIL_PX / max(width, height))
    return max(1, round(width * scale)), max(1, round(height * scale))


def _encoded(picture: Image.Image, form: str, **options: Any) -> bytes:
    return saved(lambda stream: picture.save(stream, form, **options))


def _finish(
    request: Request, files: Mapping[str, bytes], extra: Mapping[str, Any]
) -> dict[str, Any]:
    """Write the files and then the record, without which the folder does not count as finished."""
    folder = Path(request["folder"])
    record = {
        "key": request["key"],
        "files": {name: len(data) for name, data in files.items()},
        **finite(extra),
    }
    make_folder(folder)
    try:
        (folder / RECORD).unlink(missing_ok=True)
    except OSError as error:
        reason = error.strerror or error
        raise OutputError(f"cannot write in {folder}: {reason}. Try another folder") from error
    written: dict[str | os.PathLike[str], bytes] = {folder / n: data for n, data in files.items()}
    written[folder / RECORD] = as_json(record)
    write_all_atomically(written)
    return record


def finished(folder: Path, key: str) -> dict[str, Any] | None:
    """The record of a folder that is complete and has this key; None for any other."""
    try:
        record = json.loads((folder / RECORD).read_bytes())
        if record["key"] != key:
            return None
        for name, size in record["files"].items():
            if (folder / name).stat().st_size != size:
                return None
        if REPORT in record["files"]:
            json.loads((folder / REPORT).read_bytes())
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return None  # missing or damaged: it is made again
    return record


SIDE = 74  # px: at 3x, five crops fit side by side on a laptop and more than one on a phone
_SAME = 1e-12  # mean squared errors that differ by less are equal up to rounding


class Crop(NamedTuple):
    """A part of an image: its top left corner and size in px, and its PSNR in dB."""

    x: int
    y: int
    width: int
    height: int
    psnr: float


def worst_and_typical(
    image: NDArray[np.floating], other: NDArray[np.floating], side: int = SIDE
) -> tuple[Crop, Crop]:
    """The window with the largest mean squared error, and a typical one.

    image, other  (h, w, c) in 0..1
    side          of a window, in px; less where an image is smaller
    The typical window is the one whose error is closest to the median of all windows' errors; of
    several, the one closest to the centre.
    """
    height, width = image.shape[:2]
    down, across = min(side, height), min(side, width)
    squared = np.subtract(image, other, dtype=np.float64) ** 2
    means = _window_means(squared.mean(axis=2), down, across)
    worst = np.unravel_index(np.argmax(means), means.shape)
    off = np.abs(means - np.median(means))
    rows, columns = np.nonzero(off <= off.min() + _SAME)
    middle = (np.array(means.shape) - 1) / 2
    nearest = np.argmin((rows - middle[0]) ** 2 + (columns - middle[1]) ** 2)
    typical = (rows[nearest], columns[nearest])

    def crop(corner: tuple[np.intp, ...]) -> Crop:
        y, x = map(int, corner)
        error = squared[y : y + down, x : x + across].mean()  # exactly 0 for equal pixels
        return Crop(x, y, across, down, float(-10 * np.log10(error)) if error else np.inf)

    return crop(worst), crop(typical)


def _window_means(values: NDArray[np.float64], down: int, across: int) -> NDArray[np.float64]:
    """Mean of every window of down x across px, by its top left corner."""
    integral = np.pad(values, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    inside = integral[down:, across:] - integral[:-down, across:]
    inside = inside - integral[down:, :-across] + integral[:-down, :-across]
    return inside / (down * across)
