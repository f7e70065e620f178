"""Photo files: open, decode, turn upright and convert to sRGB.

This module has the formats, one entry each, and the limits of the number of pixels.

Batches, the studio, the help and the documentation take their lists from here. This module loads
no decoder, so that the help stays fast.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

# Pillow's own limit (Image.MAX_IMAGE_PIXELS), a quarter of a GiB at three bytes per pixel.
DEFAULT_MAX_PIXELS = 89_478_485
# Pillow's decoders refuse any file above twice its limit. Larger images are not rasterised either.
MOST_PIXELS = 2 * DEFAULT_MAX_PIXELS
PREFIX_BYTES = 64  # length of the start of a file that identifies its format

LIBVIPS, PILLOW = "gauss2svg.photo.by_libvips:opened", "gauss2svg.photo.by_pillow:opened"
LIBHEIF = "gauss2svg.photo.by_heif:opened"
OF_PILLOW = "gauss2svg.photo.by_pillow:of_image"  # opens an image of Pillow


@dataclass(frozen=True)
class Format:
    """A format that can be read.

    name      name in texts
    suffixes  suffixes of the files in a folder that count as photos
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
        # AVIF is the major brand, or a compatible one beside a general major brand.
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
# First bytes of other files that users give instead of a photo, with the words for an error.
_OTHERS = (
    (_RAW, "a camera's raw file"),  # decoders would read only its small preview
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
    """Return the format of a file by its first PREFIX_BYTES, or a phrase for any other file."""
    if not start:
        return "an empty file"
    if not re.match(_RAW, start, re.DOTALL):
        for entry in FORMATS.values():
            if re.match(entry.start, start, re.DOTALL):
                return entry
    kinds = (kind for pattern, kind in _OTHERS if re.match(pattern, start, re.DOTALL))
    return next(kinds, "an unknown format")
