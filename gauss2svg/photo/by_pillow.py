"""Photos by Pillow: formats that libvips lacks, and images that a caller passes."""

from __future__ import annotations

import importlib
import io
from typing import Any

import numpy as np
from PIL import Image, ImageCms
from PIL.ExifTags import Base

from gauss2svg.errors import InputError
from gauss2svg.photo.reduce import rows_at_once
from gauss2svg.photo.srgb import INKS, ColorSpace, by_gamma
from gauss2svg.photo.stored import Rows, Stored
from gauss2svg.photo.tags import tags_of

_COLORS = {"L": 1, "LA": 1, "RGB": 3, "RGBA": 3, "CMYK": INKS}  # channels by Pillow's mode
_REDUCED_BYTES = (
    14  # for each pixel while a photo is decoded and reduced (docs/decisions/memory.md)
)
_MOST_LEVEL = 65535  # of grey integers


def opened(file: bytes, loader: str, name: str) -> Stored:
    """Read the header of a file by a plugin; not by Image.open, whose limit is the process's."""
    plugin = importlib.import_module(f"PIL.{loader}ImagePlugin")
    return of_image(getattr(plugin, f"{loader}ImageFile")(io.BytesIO(file)), name)


def of_image(image: Image.Image, name: str) -> Stored:
    """Return a Pillow image, which may not be loaded yet."""
    mode, info, tags = _mode(image), image.info, {}
    try:
        tags = dict(image.getexif())
        broken = ()
    except Exception:  # hostile bytes make the EXIF reader raise anything
        broken = ("EXIF data broken; ignored",)
    if image.format == "TIFF":  # which Pillow turns itself
        tags.pop(Base.Orientation, None)

    def rows(_scale: int) -> Rows:
        image.load()
        picture: Any = image
        if mode in _COLORS and mode != image.mode:
            picture = _converted(image, mode)
        for top in range(0, image.height, step := rows_at_once(image.width, _COLORS.get(mode, 1))):
            box = 0, top, image.width, min(top + step, image.height)
            some = np.asarray(picture.crop(box))
            yield some.reshape(*some.shape[:2], -1) if mode in _COLORS else _levels(some, name)

    stated = image.format not in ("JPEG", "MPO") or info.get("jfif_unit") in (1, 2)
    space = ColorSpace(info.get("icc_profile"))
    if image.format == "PNG" and "gamma" in info and not {"srgb", "icc_profile"} & info.keys():
        space = by_gamma(info["gamma"], info.get("chromaticity"))
    colors = _COLORS.get(mode, 1)
    return Stored(
        image.width,
        image.height,
        colors,
        colors if mode.endswith("A") else None,
        rows,
        _REDUCED_BYTES,
        space=space,
        tags=tags_of(tags, broken, info.get("dpi") if stated else None, 2),
        notes=["converted from CIELAB to sRGB"] if image.mode == "LAB" else [],
    )


def _mode(image: Image.Image) -> str:
    """Return the mode in which an image is read."""
    if image.mode.startswith("I") or image.mode == "F":
        return image.mode
    if image.mode in ("PA", "RGBa") or image.has_transparency_data:
        return "LA" if image.mode in ("LA", "La") else "RGBA"
    if image.mode == "La":
        return "LA"
    return image.mode if image.mode in _COLORS else "L" if image.mode == "1" else "RGB"


def _converted(image: Image.Image, mode: str) -> Image.Image:
    if image.mode != "LAB":
        return image.convert(mode)
    lab, srgb = ImageCms.createProfile("LAB"), ImageCms.createProfile("sRGB")
    transform = ImageCms.buildTransform(lab, srgb, "LAB", "RGB", flags=ImageCms.Flags.NOOPTIMIZE)
    return ImageCms.applyTransform(image, transform)  # pyright: ignore[reportReturnType]


def _levels(rows: Any, name: str) -> Any:
    """Rows of grey integers or floats as (n, w, 1) of a type that is decoded."""
    if rows.dtype.kind in "iu":
        if rows.min() < 0 or rows.max() > _MOST_LEVEL:
            raise InputError(
                f"grey levels of {name} must be in 0..{_MOST_LEVEL}; got {rows.min()}.."
                f"{rows.max()}. Try rescaling them"
            )
        rows = rows.astype(np.uint16)
    return rows[:, :, None]
