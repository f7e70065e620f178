"""Picture files: which are opened, by which decoder, up to which size; nothing is decoded here."""

from __future__ import annotations

import importlib
import io
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from typing import Any, BinaryIO

from PIL import Image, ImageFile, features

from gauss2svg.errors import InputError
from gauss2svg.photo.stderr import stderr_silenced

# Decoders that are tried; anything else is refused unread. Pillow's plugin of each.
FORMATS = {
    "JPEG": "JpegImagePlugin",
    "PNG": "PngImagePlugin",
    "WEBP": "WebPImagePlugin",
    "TIFF": "TiffImagePlugin",
    "GIF": "GifImagePlugin",
    "BMP": "BmpImagePlugin",
    "AVIF": "AvifImagePlugin",
}
_OPTIONAL = {"WEBP": "webp", "AVIF": "avif"}  # features that a build of Pillow may lack
# A quarter of a GiB at three bytes a pixel: from there on Pillow itself warns of bombs.
DEFAULT_MAX_PIXELS = 89_478_485
# Twice that is what Pillow's decoders refuse whatever is asked for, and what is ever drawn.
MOST_PIXELS = 2 * DEFAULT_MAX_PIXELS
_PREFIX_BYTES = 16  # by which Pillow's plugins know their files
_RAW = "a camera's raw file"  # a TIFF, of which a small preview would be read
# What people take for a photo, or have instead of one, to be told by its name.
_OTHERS = (
    (rb"%PDF", "a PDF"),
    (rb"%!PS|\xc5\xd0\xd3\xc6", "PostScript"),
    (rb"8BPS", "a Photoshop file"),
    (rb"gimp xcf", "a GIMP file"),
    (rb"(\xef\xbb\xbf)?\s*<(svg|\?xml|!DOCTYPE svg)", "an SVG or other XML"),
    (rb"(?i)\s*<(!doctype html|html)", "a web page"),
    (rb"\x1f\x8b", "gzipped"),
    (rb"PK\x03\x04", "a ZIP archive"),
    (rb"....ftyp(hei[cxms]|hev[cxms]|mif1|msf1)", "HEIC"),
    (rb"....ftypcrx |II\*\0....CR", _RAW),
    (rb"....ftyp", "a video"),
    (rb"\0\0\0\x0cjP  |\xff\x4f\xff\x51", "JPEG 2000"),
    (rb"\0\0\0\x0cJXL |\xff\x0a", "JPEG XL"),
    (rb"P[1-7Ff]\s", "a Netpbm file"),
    (rb"\0\0[\1\2]\0", "an icon"),
    (rb"v/1\x01", "OpenEXR"),
)


class UnreadTiffError(InputError):
    """A TIFF whose kind of pixels Pillow does not know."""


@contextmanager
def reading(path: str | os.PathLike[str], needed: str) -> Iterator[BinaryIO]:
    """A file open for reading; raises InputError that ends in what is needed.

    Folders, pipes and devices are refused unread: a pipe nobody writes to would wait for ever.
    """
    name = os.fsdecode(path)
    flags = os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
    try:
        descriptor = os.open(path, flags)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(f"cannot read {name}: {reason}; {needed}") from error
    mode = os.fstat(descriptor).st_mode
    if not stat.S_ISREG(mode):
        os.close(descriptor)
        if stat.S_ISDIR(mode):
            raise InputError(f"cannot read {name}: it is a folder; {needed}")
        raise InputError(
            f"cannot read {name}: it is a pipe or a device; {needed}, or pipe it into the command "
            "and give - as its name"
        )
    with open(descriptor, "rb") as file:
        yield file


@cache
def decodable() -> tuple[str, ...]:
    """FORMATS less those that this build of Pillow lacks, as some lack AVIF."""
    names = tuple(
        name for name in FORMATS if name not in _OPTIONAL or features.check(_OPTIONAL[name])
    )
    for name in names:
        importlib.import_module(f"PIL.{FORMATS[name]}")  # which registers its decoder
    return names


@contextmanager
def opened(
    file: BinaryIO, name: str, max_pixels: int = DEFAULT_MAX_PIXELS
) -> Iterator[ImageFile.ImageFile]:
    """A picture file of one of FORMATS, its header read and its size within the limit.

    Raises InputError that names the file: for what is no such picture, what is broken, and
    what has more than max_pixels.
    """
    picture = _identified(file, name, max_pixels)
    with picture:
        check_size(picture.size, name, max_pixels)
        yield picture


def seekable(file: Any, name: str) -> BinaryIO:
    """The file itself, or all of its bytes in memory where it cannot be read twice."""
    try:
        file.seek(0)
        data = file.read(0)
    except (AttributeError, OSError):
        data = file.read()
        file = io.BytesIO(data) if isinstance(data, bytes) else file
    if not isinstance(data, bytes):
        raise InputError(f"{name} gives {type(data).__name__}; needed are bytes: open it as 'rb'")
    return file


def _identified(file: BinaryIO, name: str, max_pixels: int) -> ImageFile.ImageFile:
    """A picture whose header is read; not by Image.open, whose limit is the whole process's."""
    file.seek(0)
    start = file.read(4 * _PREFIX_BYTES)
    kind, other = format_of(start), _other(start)
    if kind is None or other == _RAW:
        raise InputError(
            f"{name} is {other and other + ', '}no picture that can be read; needed is one of "
            f"{', '.join(decodable())}: convert it"
        )
    file.seek(0)
    try:
        return Image.OPEN[kind][0](file, "")
    except MemoryError:
        raise
    except Image.DecompressionBombError as error:  # of a plugin that looks before it opens
        count = re.search(r"\d+", str(error))  # "Image size (2000000000 pixels) exceeds .."
        if count is None or int(count[0]) <= max_pixels:
            raise broken(name, error) from error
        raise _too_large(count[0], name, max_pixels, int(count[0])) from error
    except Exception as error:  # hostile bytes make decoders raise anything
        if kind == "TIFF" and isinstance(error, SyntaxError):
            raise UnreadTiffError(
                f"{name} is a TIFF of pixels that cannot be read: {error}"
            ) from error
        raise broken(name, error) from error


def format_of(start: bytes) -> str | None:
    """Which of FORMATS a file is by its first bytes, None if it is none of them."""
    for name in decodable():
        accept = Image.OPEN[name][1]
        if accept is not None and accept(start[:_PREFIX_BYTES]) is True:
            return name
    return None


def _other(start: bytes) -> str:
    if not start:
        return "empty"
    return next((kind for pattern, kind in _OTHERS if re.match(pattern, start, re.DOTALL)), "")


def check_size(size: tuple[int, int], name: str, max_pixels: int) -> None:
    """Refuse a picture (width, height) of more than max_pixels, or of none, by InputError."""
    width, height = size
    if width < 1 or height < 1:
        raise InputError(f"{name} has {width}x{height} px; needed is at least one pixel")
    if width * height > max_pixels:
        told = f"{width}x{height} px, {width * height}"
        raise _too_large(told, name, max_pixels, width * height)


def _too_large(size: str, name: str, max_pixels: int, count: int) -> InputError:
    advice = "shrink it"
    if count <= MOST_PIXELS:
        advice += f", or raise --max-pixels, up to {MOST_PIXELS}, if it is to be trusted"
    return InputError(
        f"{name} is too large to decode: {size}; needed are at most {max_pixels} "
        f"(--max-pixels): {advice}"
    )


def loaded(picture: Image.Image, name: str) -> Image.Image:
    """The picture with its pixels decoded; raises InputError if they are broken or cut off."""
    try:
        with (
            stderr_silenced() if picture.format == "TIFF" else nullcontext()
        ):  # libtiff writes by itself
            picture.load()
    except MemoryError:
        raise
    except Exception as error:  # hostile bytes make decoders raise anything
        raise broken(name, error) from error
    if picture.mode in ("P", "PA") and picture.palette is None:
        raise broken(name, ValueError("its colours have no palette"))
    return picture


def broken(name: str, error: Exception) -> InputError:
    """The error of a picture that its decoder cannot read."""
    reason = str(error) or type(error).__name__
    if isinstance(error, Image.DecompressionBombError):  # of a limit lower than Pillow's own
        return InputError(
            f"{name} is too large to decode: {reason.rstrip('.')}; shrink it, or raise "
            "PIL.Image.MAX_IMAGE_PIXELS of this process"
        )
    if "MAX_TEXT" in reason:
        reason = "its colour profile or its texts unpack to more than Pillow's limit"
    elif reason == "not identified by this driver":
        reason = "its header gives no size or no known kind of pixels"
    return InputError(f"{name} is broken or cut off: {reason}; save it anew and try again")
