"""Open photos by Pillow: formats that libvips lacks, and PIL images that a caller passes."""

from __future__ import annotations

import importlib
import io
from typing import Any

import numpy as np
import pyvips
from PIL import Image, ImageCms
from PIL.ExifTags import Base

from gauss2svg.errors import refusal
from gauss2svg.photo.load import StoredImage
from gauss2svg.photo.srgb import CMYK_CHANNELS, ColorSpace

# Number of colour channels for each mode of a Pillow image. Modes that are not listed have 1.
_COLORS = {"L": 1, "LA": 1, "RGB": 3, "RGBA": 3, "CMYK": CMYK_CHANNELS}
# Number of bytes of memory per pixel that decoding and reducing a photo takes.
# docs/decisions/memory.md has the measurements.
_REDUCED_BYTES = 20
_START_OF_DATA, _END = b"\xff\x93", b"\xff\xd9"  # markers in JPEG 2000 files


def opened(file: bytes, loader: str) -> StoredImage:
    """Read the header of a file by one of Pillow's plugins.

    The plugin is called directly, so the size limit of Image.open does not apply.
    """
    if loader == "Jpeg2K" and file.rfind(_END) <= file.rfind(_START_OF_DATA):
        # OpenJPEG would decode the missing part as black pixels, without an error.
        raise ValueError("its data end early")
    plugin = importlib.import_module(f"PIL.{loader}ImagePlugin")
    return of_image(getattr(plugin, f"{loader}ImageFile")(io.BytesIO(file)))


def of_image(image: Image.Image) -> StoredImage:
    """Return a PIL image as StoredImage. Its pixels need not be loaded yet.

    Raise InputError if the image, or the file that has its pixels, is closed.
    """
    if _is_closed(image):
        advice = "to read it before it is closed, or its path"
        raise refusal("image", "an open image of Pillow", "a closed one", advice)
    mode, info = _mode(image), image.info
    colors = _COLORS.get(mode, 1)

    def picture(_scale: int) -> Any:
        image.load()
        array = np.asarray(_converted(image, mode))
        # Integers of 16 or 32 bits are grey levels in 0..65535. A higher level becomes more than 1
        # here, and `unit` refuses it later.
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
        if dpi := info.get("dpi"):  # two numbers, which are fractions if the image is a TIFF
            stored.density = float(dpi[0]), float(dpi[1])
        if image.format != "TIFF":  # Pillow itself turns a TIFF upright
            turn = image.getexif().get(Base.Orientation)
            stored.orientation = turn if turn and turn in range(1, 9) else 1
    except Exception:  # if EXIF data or later frames are broken, the photo is read all the same
        stored.notes.append("its EXIF data, or frames after the first, are broken; ignored")
    stored.space = ColorSpace(info.get("icc_profile"))
    if image.format == "PNG" and "gamma" in info and not {"srgb", "icc_profile"} & info.keys():
        stored.set_gamma(info["gamma"], info.get("chromaticity", ()))
    return stored


def _is_closed(image: Image.Image) -> bool:
    """Return whether an image is closed, so that its pixels can no longer be read."""
    try:
        is_loaded = image.im is not None
    except AssertionError:  # raised if the pixels are not loaded yet
        is_loaded = False
    except ValueError:  # raised if the image is closed
        return True
    file = getattr(image, "fp", None)
    # Some plugins have no tiles, because they have read the whole file already.
    has_tiles = bool(getattr(image, "tile", None))
    return not is_loaded and has_tiles and (file is None or file.closed)


def _mode(image: Image.Image) -> str:
    """Return the mode to which an image must be converted before its samples are read."""
    if image.mode.startswith("I") or image.mode == "F":
        return image.mode
    if image.mode in ("PA", "RGBa") or image.has_transparency_data or _frame(image):
        return "LA" if image.mode in ("LA", "La") else "RGBA"
    if image.mode == "La":
        return "LA"
    return image.mode if image.mode in _COLORS else "L" if image.mode == "1" else "RGB"


def _frame(image: Image.Image) -> tuple[int, int, int, int] | None:
    """Return the box (left, top, right, bottom), in px, that the first frame of a GIF covers.

    Return None if the frame fills the whole screen of the GIF. Also return None if a later frame
    is selected, because Pillow itself draws a later frame over the earlier frames.
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
