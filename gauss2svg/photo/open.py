"""Opening image files: which are opened, by which decoder, up to which size."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import cache
from pkgutil import resolve_name
from typing import Any, BinaryIO

from PIL import Image, ImageFile, features

from gauss2svg.errors import InputError, brief
from gauss2svg.photo.damage import damage_of, mend_jpeg
from gauss2svg.photo.formats import DEFAULT_MAX_PIXELS, FORMATS, MOST_PIXELS
from gauss2svg.photo.stderr import stderr_silenced

_ORDERED = re.compile(r"(F;32|I;32|I;16)B?([FS])")  # raw modes of numbers with a sign
_PREFIX_BYTES = 16  # by which Pillow's plugins identify their files
_RAW = "a camera's raw file"  # a TIFF, of which only a small preview would be read
# Other files that are given in place of a photo, by their first bytes.
_OTHERS = (
    (rb"%PDF", "a PDF"),
    (rb"%!PS|\xc5\xd0\xd3\xc6", "a PostScript file"),
    (rb"8BPS", "a Photoshop file"),
    (rb"gimp xcf", "a GIMP file"),
    (rb"(\xef\xbb\xbf)?\s*<(svg|\?xml|!DOCTYPE svg)", "an SVG or other XML"),
    (rb"(?i)\s*<(!doctype html|html)", "a web page"),
    (rb"\x1f\x8b", "a gzipped file"),
    (rb"PK\x03\x04", "a ZIP archive"),
    (rb"....ftyp(hei[cxms]|hev[cxms]|mif1|msf1)", "a HEIC file"),
    (rb"....ftypcrx |II\*\0....CR", _RAW),
    (rb"....ftyp", "a video"),
    (rb"\0\0\0\x0cjP  |\xff\x4f\xff\x51", "a JPEG 2000 file"),
    (rb"\0\0\0\x0cJXL |\xff\x0a", "a JPEG XL file"),
    (rb"P[1-7Ff]\s", "a Netpbm file"),
    # Its image type and depth; an icon would have none in it.
    (rb".\0[\2\3\x0a\x0b]\0{5}.{8}[\x08\x10\x18\x20]|.\x01[\1\x09].{13}[\x08\x10]", "a TGA file"),
    (rb"\0\0[\1\2]\0", "an icon"),
    (rb"v/1\x01", "an OpenEXR file"),
)


class UnreadTiffError(InputError):
    """A TIFF with pixels of a kind that Pillow does not decode."""


@cache
def _decodable() -> tuple[str, ...]:
    """FORMATS without those that this build of Pillow lacks, as some lack AVIF."""
    found = [f for f in FORMATS.values() if not f.feature or features.check(f.feature)]
    for one in found:
        importlib.import_module(one.plugin)  # registers its decoder
    return tuple(one.name for one in found)


@contextmanager
def opened(
    file: BinaryIO, name: str, max_pixels: int = DEFAULT_MAX_PIXELS
) -> Iterator[ImageFile.ImageFile]:
    """An image file of one of FORMATS whose header is read and whose size is within the limit.

    Raises InputError that names the file: for another format, a broken header, and more than
    max_pixels.
    """
    image = _identified(file, name, max_pixels)
    with image:
        check_size(image.size, name, max_pixels)
        yield image


def _identified(file: BinaryIO, name: str, max_pixels: int) -> ImageFile.ImageFile:
    """An image whose header is read; not by Image.open, whose limit is the process's."""
    file.seek(0)
    start = file.read(4 * _PREFIX_BYTES)
    kind, other = _format_of(start), _other(start)
    if kind is None or other == _RAW:
        raise InputError(
            f"{name} must be a supported image ({', '.join(_decodable())}); got "
            f"{other or 'an unknown format'}. Try converting it"
        )
    file.seek(0)
    try:
        prepare = FORMATS[kind].prepare
        image = Image.OPEN[kind][0](resolve_name(prepare)(file) if prepare else file, "")
        if kind == "TIFF":
            image.tile = [_in_native_order(tile) for tile in image.tile]
        return image
    except MemoryError:
        raise
    except Image.DecompressionBombError as error:  # of a plugin that looks before it opens
        count = re.search(r"\d+", str(error))  # "Image size (2000000000 pixels) exceeds .."
        if count is None or int(count[0]) <= max_pixels:
            raise broken(name, error) from error
        raise _too_large("", name, max_pixels, int(count[0])) from error
    except Exception as error:  # hostile bytes make decoders raise anything
        if kind == "TIFF" and isinstance(error, SyntaxError):
            raise UnreadTiffError(
                f"{name} must be readable; got one that is not: {brief(error)}. Try saving it "
                "as PNG"
            ) from error
        raise broken(name, error) from error


def _in_native_order(tile: Any) -> Any:
    """What Pillow will unpack of a TIFF: libtiff gives samples in the order of this machine."""
    if tile.codec_name != "libtiff" or not (match := _ORDERED.fullmatch(tile.args[0])):
        return tile
    return tile._replace(args=(f"{match[1]}N{match[2]}", *tile.args[1:]))


def _format_of(start: bytes) -> str | None:
    """Which of FORMATS a file has, by its first bytes; None for any other."""
    for name in _decodable():
        accept = Image.OPEN[name][1]
        if accept is not None and accept(start[:_PREFIX_BYTES]) is True:
            return name
    return None


def _other(start: bytes) -> str:
    if not start:
        return "an empty file"
    return next((kind for pattern, kind in _OTHERS if re.match(pattern, start, re.DOTALL)), "")


def check_size(size: tuple[int, int], name: str, max_pixels: int) -> None:
    """Raise InputError for a size (width, height) of no pixel, or of more than max_pixels."""
    width, height = size
    if width < 1 or height < 1:
        raise InputError(f"{name} must be at least 1x1 px; got {width}x{height} px")
    if width * height > max_pixels:
        raise _too_large(f"{width}x{height} = ", name, max_pixels, width * height)


def _too_large(sides: str, name: str, max_pixels: int, count: int) -> InputError:
    advice = "shrinking it"
    if count <= MOST_PIXELS:
        advice += f", or raising --max-pixels, up to {MOST_PIXELS}, if you trust the file"
    return InputError(
        f"{name} must be at most {max_pixels} px (--max-pixels); got {sides}{count} px. Try "
        f"{advice}"
    )


def loaded(image: Image.Image, name: str, notes: list[str] | None = None) -> Image.Image:
    """The image with its pixels decoded; raises InputError if they are broken or truncated.

    notes  is given what its decoder had to be helped with
    """
    try:
        damage, mended = damage_of(image), mend_jpeg(image)
        if notes is not None:
            notes += mended
        # libtiff writes to standard error by itself.
        with stderr_silenced() if image.format == "TIFF" else nullcontext():
            image.load()
        if missing := damage(image):
            raise OSError(missing)
    except MemoryError:
        raise
    except Exception as error:  # hostile bytes make decoders raise anything
        raise broken(name, error) from error
    if image.mode in ("P", "PA") and image.palette is None:
        raise broken(name, ValueError("its palette is missing"))
    return image


def broken(name: str, error: Exception) -> InputError:
    """The error for an image that its decoder cannot read."""
    reason = str(error) or type(error).__name__
    if isinstance(error, Image.DecompressionBombError):  # of a limit lower than Pillow's own
        return InputError(
            f"{name} must be within PIL.Image.MAX_IMAGE_PIXELS of this process; got "
            f"{brief(reason.rstrip('.'))}. Try shrinking it, or raising that limit"
        )
    if "MAX_TEXT" in reason:
        reason = "its ICC profile or its texts unpack to more than Pillow's limit"
    elif reason == "not identified by this driver":
        reason = "its header has no size or no known kind of pixels"
    return InputError(
        f"{name} must be a complete image; got a broken or truncated one: {brief(reason)}. Try "
        "re-saving it"
    )
