"""Open photos by Pillow: formats that libvips lacks, and PIL images that a caller passes."""

from __future__ import annotations

import importlib
import io
from typing import Any

import numpy as np
import pyvips
from PIL import Image, ImageCms
from PIL.ExifTags import Base

from gauss2svg.photo.load import StoredImage
from gauss2svg.photo.srgb import CMYK_CHANNELS, ColorSpace

# Number of colour channels by mode of Pillow. Modes that are not listed have 1.
_COLORS = {"L": 1, "LA": 1, "RGB": 3, "RGBA": 3, "CMYK": CMYK_CHANNELS}
_REDUCED_BYTES = 20  # memory (bytes) per pixel while a photo is reduced (docs/decisions/memory.md)
_START_OF_DATA, _END = b"\xff\x93", b"\xff\xd9"  # markers of JPEG 2000


def opened(file: bytes, loader: str) -> StoredImage:
    """Read the header of a file by a plugin of Pillow, without the size limit of Image.open."""
    if loader == "Jpeg2K" and file.rfind(_END) <= file.rfind(_START_OF_DATA):
        raise ValueError("its data end early")  # OpenJPEG would return black pixels
    plugin = importlib.import_module(f"PIL.{loader}ImagePlugin")
    return of_image(getattr(plugin, f"{loader}ImageFile")(io.BytesIO(file)))


def of_image(image: Image.Image) -> StoredImage:
    """Return a PIL image as StoredImage. Its pixels need not be loaded yet."""
    mode, info = _mode(image), image.info
    colors = _COLORS.get(mode, 1)

    def picture(_scale: int) -> Any:
        image.load()
        array = np.asarray(_converted(image, mode))
        # Integers are grey levels of 16 or 32 bits. Later, `unit` refuses levels over 65535.
        if array.dtype.kind in "iu" and array.dtype != np.uint8:
            array = array.astype(np.float32) / 65535
        return pyvips.Image.new_from_array(array)

    alpha = colors if mode.endswith("A") else None
    stored = StoredImage(image.width, image.height, colors, alpha, picture, _REDUCED_BYTES)
    if image.mode == "LAB":
        stored.notes.append("converted from CIELAB to sRGB")
    try:
        if image.format == "GIF" and not image.tell():
            stored.note_frames(getattr(image, "n_frames", 1))
        if dpi := info.get("dpi"):  # the numbers of a TIFF are fractions
            stored.density = float(dpi[0]), float(dpi[1])
        if image.format != "TIFF":  # Pillow turns a TIFF upright itself
            turn = image.getexif().get(Base.Orientation)
            stored.orientation = turn if turn and turn in range(1, 9) else 1
    except Exception:  # a photo is still read if its EXIF data or later frames are broken
        stored.notes.append("its EXIF data, or frames after the first, are broken; ignored")
    stored.space = ColorSpace(info.get("icc_profile"))
    if image.format == "PNG" and "gamma" in info and not {"srgb", "icc_profile"} & info.keys():
        stored.set_gamma(info["gamma"], info.get("chromaticity", ()))
    return stored


def _mode(image: Image.Image) -> str:
    """Return the mode to which an image is converted before its samples are read."""
    if image.mode.startswith("I") or image.mode == "F":
        return image.mode
    if image.mode in ("PA", "RGBa") or image.has_transparency_data or _frame(image):
        return "LA" if image.mode in ("LA", "La") else "RGBA"
    if image.mode == "La":
        return "LA"
    return image.mode if image.mode in _COLORS else "L" if image.mode == "1" else "RGB"


def _frame(image: Image.Image) -> tuple[int, int, int, int] | None:
    """Return (left, top, right, bottom) in px of a GIF's first frame on its screen.

    Return None if that frame fills the screen, or if the image is at a later frame, which Pillow
    draws over the earlier ones.
    """
    box = getattr(image, "dispose_extent", None)
    return None if image.tell() or box in (None, (0, 0, *image.size)) else box


def _converted(image: Image.Image, mode: str) -> Any:
    if (box := _frame(image)) is not None:
        screen = Image.new(mode, image.size)
        screen.paste(image.convert(mode).crop(box), box)
        return screen
    if image.mode != "LAB":
        return image if image.mode == mode else image.convert(mode)
    lab, srgb = ImageCms.createProfile("LAB"), ImageCms.createProfile("sRGB")
    transform = ImageCms.buildTransform(lab, srgb, "LAB", "RGB", flags=ImageCms.Flags.NOOPTIMIZE)
    return ImageCms.applyTransform(image, transform)
