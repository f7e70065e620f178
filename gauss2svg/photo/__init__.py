"""Photo files: open, decode, turn upright and convert to sRGB.

This module lists the formats of photos, and has the limits on their number of pixels. Batches, the
studio, the help and the documentation take their lists of formats from here.

This module imports no decoder, so that printing the help stays fast.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

# The largest number of pixels that a photo may have by default. It is the value of Pillow's
# MAX_IMAGE_PIXELS. A photo of this size takes 256 MiB at 3 bytes per pixel.
DEFAULT_MAX_PIXELS = 89_478_485
# The highest limit on the number of pixels that a user can set. Pillow's Image.open refuses images
# with more pixels than this. The number of pixels of a raster has the same limit.
MOST_PIXELS = 2 * DEFAULT_MAX_PIXELS
PREFIX_BYTES = 64  # number of bytes at the start of a file that suffice to identify its format


@dataclass(frozen=True)
class Format:
    """A file format of photos.

    name      name of the format in messages and in the help
    suffixes  suffixes of file names. They say which files of a folder are photos of this format
    start     regular expression that matches the first bytes of files of this format
    loader    name of the libvips operation or Pillow plugin that decodes such files, "" for libheif
    """

    name: str
    suffixes: tuple[str, ...]
    start: bytes
    loader: str


FORMATS = {
    entry.name: entry
    for entry in (
        Format("JPEG", (".jpg", ".jpeg", ".jpe", ".jfif"), rb"\xff\xd8\xff", "jpegload"),
        Format("PNG", (".png",), rb"\x89PNG\r\n\x1a\n", "pngload"),
        Format("WebP", (".webp",), rb"RIFF.{4}WEBP", "webpload"),
        Format("TIFF", (".tif", ".tiff"), rb"II[\x2a\x2b]\0|MM\0[\x2a\x2b]", "tiffload"),
        # An AVIF has the brand avif or avis. It is either the major brand of the file, or one of
        # the brands after a general major brand such as mif1.
        Format("AVIF", (".avif",), rb".{4}ftyp(avi[fs]|m[is]f1(.{4})+?avi[fs])", "heifload"),
        Format("HEIC", (".heic", ".heif", ".hif"), rb".{4}ftyp(he[iv][cxms]|m[is]f1)", ""),
        Format("GIF", (".gif",), rb"GIF8[79]a", "Gif"),
        Format("BMP", (".bmp",), rb"BM", "Bmp"),
        Format("JPEG 2000", (".jp2", ".j2k", ".jpx"), rb"\0{3}\x0cjP  |\xff\x4f\xff\x51", "Jpeg2K"),
        Format("PSD", (".psd",), rb"8BPS", "Psd"),
        Format("ICO", (".ico",), rb"\0\0\x01\0", "Ico"),
    )
}
SUFFIXES = tuple(suffix for entry in FORMATS.values() for suffix in entry.suffixes)

_RAW = rb"II\*\0....CR|II[RU][\0SO]|MMOR|IIU\0|FUJIFILM"
# For each type of file that is not supported: a pattern that its first bytes match, and its name in
# error messages. Raw files are not read, because decoders would read only the small preview in
# them.
_OTHERS = (
    (_RAW, "a camera's raw file"),
    (rb"%PDF", "a PDF"),
    (rb"(\xef\xbb\xbf)?\s*<(svg|\?xml|!DOCTYPE svg)", "an SVG or other XML"),
    (rb"(?i)\s*<(!doctype html|html)", "a web page"),
    (rb"\x1f\x8b", "a gzipped file"),
    (rb"PK\x03\x04", "a ZIP archive"),
    (rb".{4}ftypcrx ", "a camera's raw file"),
    (rb".{4}ftyp", "a video"),
    (rb"\0\0\0\x0cJXL |\xff\x0a", "a JPEG XL file"),
)


def format_of(start: bytes) -> Format | str:
    """Return the format of the file that begins with the bytes `start`.

    If the format is not supported, return words for the error message, such as "a PDF". The first
    PREFIX_BYTES bytes of a file are enough to find its format.
    """
    if not start:
        return "an empty file"
    if not re.match(_RAW, start, re.DOTALL):
        for entry in FORMATS.values():
            if re.match(entry.start, start, re.DOTALL):
                return entry
    kinds = (kind for pattern, kind in _OTHERS if re.match(pattern, start, re.DOTALL))
    return next(kinds, "an unknown format")
