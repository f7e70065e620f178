"""Photo files: open, decode, turn upright and convert to sRGB.

This module lists the formats, and has the limits on the number of pixels.

Batches, the studio, the help and the documentation take their lists of formats from here. This
module loads no decoder, so that the help stays fast.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

# Default limit of a photo's pixels. It is Pillow's (MAX_IMAGE_PIXELS), 256 MiB at 3 bytes a pixel.
DEFAULT_MAX_PIXELS = 89_478_485
# Highest limit that a user can set: Pillow refuses more pixels. It is also the limit of rasters.
MOST_PIXELS = 2 * DEFAULT_MAX_PIXELS
PREFIX_BYTES = 64  # bytes at the start of a file that suffice to identify its format

LIBVIPS, PILLOW = "gauss2svg.photo.by_libvips:opened", "gauss2svg.photo.by_pillow:opened"
LIBHEIF = "gauss2svg.photo.by_heif:opened"
OF_PILLOW = "gauss2svg.photo.by_pillow:of_image"  # function that reads a PIL image


@dataclass(frozen=True)
class Format:
    """A file format of photos.

    name      name in messages and help
    suffixes  suffixes of file names by which a folder is searched for photos
    start     regular expression for a file's first bytes
    decoder   function that opens the file, as module:name
    loader    operation of libvips or plugin of Pillow that the decoder calls
    """

    name: str
    suffixes: tuple[str, ...]
    start: bytes
    decoder: str
    loader: str = ""


FORMATS = {
    entry.name: entry
    for entry in (
        Format("JPEG", (".jpg", ".jpeg", ".jpe", ".jfif"), rb"\xff\xd8\xff", LIBVIPS, "jpegload"),
        Format("PNG", (".png",), rb"\x89PNG\r\n\x1a\n", LIBVIPS, "pngload"),
        Format("WebP", (".webp",), rb"RIFF.{4}WEBP", LIBVIPS, "webpload"),
        Format("TIFF", (".tif", ".tiff"), rb"II[\x2a\x2b]\0|MM\0[\x2a\x2b]", LIBVIPS, "tiffload"),
        # An AVIF has the brand avif or avis, either as major brand or after a general one (mif1).
        Format("AVIF", (".avif",), rb".{4}ftyp(avi[fs]|m[is]f1(.{4})+?avi[fs])", LIBVIPS,
               "heifload"),
        Format("HEIC", (".heic", ".heif", ".hif"), rb".{4}ftyp(he[iv][cxms]|m[is]f1)", LIBHEIF),
        Format("GIF", (".gif",), rb"GIF8[79]a", PILLOW, "Gif"),
        Format("BMP", (".bmp",), rb"BM", PILLOW, "Bmp"),
        Format("JPEG 2000", (".jp2", ".j2k", ".jpx"), rb"\0\0\0\x0cjP  |\xff\x4f\xff\x51", PILLOW,
               "Jpeg2K"),
        Format("PSD", (".psd",), rb"8BPS", PILLOW, "Psd"),
        Format("ICO", (".ico",), rb"\0\0\x01\0", PILLOW, "Ico"),
    )
}  # fmt: skip
SUFFIXES = tuple(suffix for entry in FORMATS.values() for suffix in entry.suffixes)

_RAW = rb"II\*\0....CR|II[RU][\0SO]|MMOR|IIU\0|FUJIFILM"
# Patterns for the first bytes of files that are no photos, and the words for them in errors.
_OTHERS = (
    (_RAW, "a camera's raw file"),  # decoders would read only the small preview in it
    (rb"%PDF", "a PDF"),
    (rb"%!PS|\xc5\xd0\xd3\xc6", "a PostScript file"),
    (rb"gimp xcf", "a GIMP file"),
    (rb"(\xef\xbb\xbf)?\s*<(svg|\?xml|!DOCTYPE svg)", "an SVG or other XML"),
    (rb"(?i)\s*<(!doctype html|html)", "a web page"),
    (rb"\x1f\x8b", "a gzipped file"),
    (rb"PK\x03\x04", "a ZIP archive"),
    (rb".{4}ftypcrx ", "a camera's raw file"),
    (rb".{4}ftyp", "a video"),
    (rb"\0\0\0\x0cJXL |\xff\x0a", "a JPEG XL file"),
    (rb"P[1-7Ff]\s", "a Netpbm file"),
    (rb"v/1\x01", "an OpenEXR file"),
)


def format_of(start: bytes) -> Format | str:
    """Return a file's format by its first PREFIX_BYTES, or words like "a PDF" if it has none."""
    if not start:
        return "an empty file"
    if not re.match(_RAW, start, re.DOTALL):
        for entry in FORMATS.values():
            if re.match(entry.start, start, re.DOTALL):
                return entry
    kinds = (kind for pattern, kind in _OTHERS if re.match(pattern, start, re.DOTALL))
    return next(kinds, "an unknown format")
