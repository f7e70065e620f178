"""Photos by Pillow: formats that libvips lacks, and images that a caller passes."""

from __future__ import annotations

import importlib
import io
from typing import Any

import numpy as np
from PIL import Image, ImageCms
from PIL.ExifTags import Base

from gauss2svg.photo.reduce import rows_at_once
from gauss2svg.photo.srgb import INKS, ColorSpace, by_gamma
from gauss2svg.photo.stored import Rows, Stored
from gauss2svg.photo.tags import BROKEN_EXIF, tags_of

Box = tuple[int, int, int, int]  # left, top, right and bottom in px

_COLORS = {"L": 1, "LA": 1, "RGB": 3, "RGBA": 3, "CMYK": INKS}  # channels by Pillow's mode
_REDUCED_BYTES = 20  # for each pixel while a photo is reduced (docs/decisions/memory.md)
_START_OF_DATA, _END = b"\xff\x93", b"\xff\xd9"  # markers of JPEG 2000
_MOST_LEVEL = 65535  # of grey integers


def opened(file: bytes, loader: str) -> Stored:
    """Read the header of a file by a plugin; not by Image.open, whose limit is the process's."""
    if loader == "Jpeg2K" and file.rfind(_END) <= file.rfind(_START_OF_DATA):
        raise ValueError("its data end early")  # which OpenJPEG draws black
    plugin = importlib.import_module(f"PIL.{loader}ImagePlugin")
    return of_image(getattr(plugin, f"{loader}ImageFile")(io.BytesIO(file)))


def of_image(image: Image.Image) -> Stored:
    """Return a Pillow image, which may not be loaded yet."""
    mode, info = _mode(image), image.info
    colors = _COLORS.get(mode, 1)

    def rows(_scale: int) -> Rows:
        image.load()
        picture: Any = _converted(image, mode)
        for top in range(0, image.height, step := rows_at_once(image.width, len(mode))):
            some = np.asarray(picture.crop((0, top, image.width, min(top + step, image.height))))
            yield np.atleast_3d(some if mode in _COLORS else _levels(some))

    alpha = colors if mode.endswith("A") else None
    stored = Stored(image.width, image.height, colors, alpha, rows, _REDUCED_BYTES)
    if image.mode == "LAB":
        stored.notes.append("converted from CIELAB to sRGB")
    if image.format == "GIF":
        try:
            stored.note_frames(getattr(image, "n_frames", 1))
        except Exception:  # frames after the first are not used, and may be broken
            stored.notes.append("first of several frames")
    stored.space = ColorSpace(info.get("icc_profile"))
    if image.format == "PNG" and "gamma" in info and not {"srgb", "icc_profile"} & info.keys():
        stored.space = by_gamma(info["gamma"], info.get("chromaticity", ()))
    tags, broken = {}, ()
    try:
        tags = dict(image.getexif())
    except Exception:  # hostile bytes make the EXIF reader raise anything
        broken = (BROKEN_EXIF,)
    if image.format == "TIFF":  # which Pillow turns itself
        tags.pop(Base.Orientation, None)
    is_stated = image.format not in ("JPEG", "MPO") or info.get("jfif_unit") in (1, 2)
    stored.tags = tags_of(tags, broken, info.get("dpi") if is_stated else None, 2)
    return stored


def _mode(image: Image.Image) -> str:
    """Return the mode in which an image is read."""
    if image.mode.startswith("I") or image.mode == "F":
        return image.mode
    if image.mode in ("PA", "RGBa") or image.has_transparency_data or _frame(image):
        return "LA" if image.mode in ("LA", "La") else "RGBA"
    if image.mode == "La":
        return "LA"
    return image.mode if image.mode in _COLORS else "L" if image.mode == "1" else "RGB"


def _frame(image: Image.Image) -> Box | None:
    """Return the place of a GIF's frame on its screen; None where it fills the screen."""
    box = getattr(image, "dispose_extent", None)
    return None if box in (None, (0, 0, *image.size)) else box


def _converted(image: Image.Image, mode: str) -> Image.Image:
    if (box := _frame(image)) is not None:
        screen = Image.new(mode, image.size)
        screen.paste(image.convert(mode).crop(box), box)
        return screen
    if image.mode == mode:
        return image
    if image.mode != "LAB":
        return image.convert(mode)
    lab, srgb = ImageCms.createProfile("LAB"), ImageCms.createProfile("sRGB")
    transform = ImageCms.buildTransform(lab, srgb, "LAB", "RGB", flags=ImageCms.Flags.NOOPTIMIZE)
    return ImageCms.applyTransform(image, transform)  # pyright: ignore[reportReturnType]


def _levels(rows: Any) -> Any:
    """Return rows of grey integers or floats as (n, w) of a type that is decoded."""
    if rows.dtype.kind in "iu":
        if rows.min() < 0 or rows.max() > _MOST_LEVEL:
            raise ValueError(
                f"its grey levels are in {rows.min()}..{rows.max()} and not 0..{_MOST_LEVEL}"
            )
        rows = rows.astype(np.uint16)
    return rows
