"""The files of a photo or of an SVG of it, made in a worker process of a gallery."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.compare.records import answered, finite
from gauss2svg.compare.run import run
from gauss2svg.files import as_json, make_folder, saved, write_all_atomically
from gauss2svg.measure.heatmap import error_map
from gauss2svg.photo.alpha import over, pixels_of, shrunk
from gauss2svg.photo.load import load_image
from gauss2svg.svg.read import parse_document

PHOTO, THUMBNAIL = "photo.webp", "thumbnail.png"
PICTURE, SCENE, REPORT = "picture.svg", "scene.npz", "report.json"
OUTLINES, ERRORS = "outlines.svg", "errors.png"
SIDE = 74  # px of a crop: at 3x, five fit side by side on a laptop and more than one on a phone
_THUMBNAIL_PX = 320

Request = Mapping[str, Any]
_ROUND = re.compile(r"round-([0-9]+)")


def answer_to(request: Request) -> dict[str, Any]:
    """Make the files that a request asks for; return their record, or {"error": ..}."""
    return finite(answered(make_photo if request["tool"] is None else make_svg, request))


def make_photo(request: Request) -> dict[str, Any]:
    """Write the photo losslessly and without its metadata, and a thumbnail; return the record.

    request  source, folder, photo_size, max_pixels
    Raise InputError for a photo that cannot be read, OutputError for the folder.
    """
    needed = request["photo_size"]
    photo = load_image(request["source"], max_pixels=request["max_pixels"], needed=needed)
    pixels = pixels_of(photo)
    shown = _encoded(_eight_bits(pixels), "WEBP", lossless=True, exact=True)
    _write(request["folder"], {PHOTO: shown, THUMBNAIL: _thumbnail(pixels)})
    size = photo.width, photo.height
    record = {"width": size[0], "height": size[1], "is_reduced": size != tuple(photo.full)}
    return record | {"notes": list(photo.notes)}


def make_svg(request: Request) -> dict[str, Any]:
    """Write an SVG of a photo, its report, thumbnail and error map; return the record.

    request  folder, and what `run` takes
    Raise Gauss2SvgError where it cannot be made.
    """
    made = run(request)
    rendered = over(made.raster)
    most = request["options"]["max_pixels"]
    photo = over(pixels_of(load_image(request["source"], max_pixels=most)))
    files = {
        PICTURE: made.data,
        REPORT: as_json(made.report),
        THUMBNAIL: _thumbnail(made.raster),
        ERRORS: _encoded(error_map(rendered, photo), "PNG", optimize=True),
    }
    rounds = []
    if made.result is not None:
        files[SCENE] = saved(made.result.scene.save)
        files[OUTLINES] = made.result.outline().encode()
        rounds = rounds_of(made.result.svg)
    _write(request["folder"], files)
    crops = crops_of(rendered, photo)
    return {"report": made.report, "cpu_s": made.cost["cpu_s"], "rounds": rounds, "crops": crops}


def rounds_of(svg: str) -> list[list[int]]:
    """Return [round, shapes up to it] of each group of the SVG that is a round, from 1."""
    rounds: list[list[int]] = []
    total = 0
    for group in parse_document(svg):
        if named := _ROUND.fullmatch(group.get("id", "")):
            total += sum(element.tag.endswith("}circle") for element in group.iter())
            rounds.append([int(named[1]), total])
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
