"""Photos by libvips: JPEG, PNG, WebP, TIFF and AVIF.

Each loader is called by its name, so libvips never chooses another one by the file.
"""

from __future__ import annotations

import io
import re
import struct
import zlib
from dataclasses import replace
from typing import Any

import numpy as np
import pyvips
from PIL.ExifTags import Base
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from gauss2svg.photo import by_pillow, libvips
from gauss2svg.photo.srgb import INKS, UNUSABLE, ColorSpace
from gauss2svg.photo.stored import Stored

_COLORS = {"b-w": 1, "grey16": 1, "cmyk": INKS}  # channels by interpretation; 3 in others
_MOST_EXTRA = 4  # samples besides colours: hostile files have thousands
_END_OF_IMAGE = b"\xff\xd9"
_NCLX = re.compile(rb"colrnclx(..)(..)", re.DOTALL)
_AV1 = re.compile(rb"av1C..(.)", re.DOTALL)
_MOST_PROFILE = 1 << 24  # bytes of a PNG's profile, unpacked
_INKS, _YCBCR, _LAB = 5, 6, 8  # PhotometricInterpretation of a TIFF
_OLD_JPEG, _JPEG, _LZMA, _ZSTD = 6, 7, 34925, 50000  # Compression; 2 to 4 are faxes
_SEPARATE, _FLOAT = 2, 3  # PlanarConfiguration, SampleFormat


def opened(file: bytes, loader: str) -> Stored:
    """Read the header of a file by a loader of libvips."""
    page = _tiff_tags(file) if loader == "tiffload" else {}
    _refuse_unread(page)
    if _is_of_pillow(page):
        return by_pillow.opened(file, "Tiff")
    if loader == "heifload" and (av1 := _AV1.search(file)) and av1[1][0] & 0x10:
        return by_pillow.opened(file, "Avif")  # libheif does not widen greys of 16..235
    # Of broken tiles and faxes libtiff only warns, as of a strip whose length is left out.
    is_strict = (Base.TileWidth in page or page.get(Base.Compression) in (2, 3, 4)) and (
        0 not in _numbers(page, Base.StripByteCounts)
    )

    def image(**options: int) -> Any:
        load = getattr(pyvips.Image, f"{loader}_buffer")
        if loader == "tiffload":  # without which a part of 50 MB is refused
            options["unlimited"] = True
        picture = load(
            file, access="sequential", fail_on="warning" if is_strict else "error", **options
        )
        if loader == "heifload" and picture.format == "ushort":  # whose upper bits are used
            bits = picture.get("bits-per-sample")
            return picture / ((1 << bits) - 1 << 16 - bits)
        if page.get(Base.PhotometricInterpretation) == 0 and picture.format == "float":
            return picture.linear([-1, 1][: picture.bands], [1, 0][: picture.bands])
        return picture

    def picture(scale: int) -> Any:
        if scale == 1:
            return image()
        # To whole pixels, of which libvips leaves out the last.
        size = -(-header.width // scale), -(-header.height // scale)
        return image(shrink=scale).embed(0, 0, *size, extend="copy")

    header = image()
    colors = min(_COLORS.get(header.interpretation, 3), header.bands)
    if header.format not in libvips.TYPES or header.bands > colors + _MOST_EXTRA or colors == 2:
        raise ValueError(f"samples of type {header.format}, {header.bands} for each pixel")
    # Not all of them, whose texts need not be Unicode.
    names = ("resolution-unit", "orientation", "icc-profile-data", "n-pages")
    fields = {name: header.get(name) for name in names if header.get_typeof(name)}
    alpha = colors if header.hasalpha() else None
    size = header.width, header.height
    stored = Stored(*size, colors, alpha, picture, _reduced_bytes(loader, header))
    stored.density = header.xres * 25.4, header.yres * 25.4
    # 1 px per mm is what libvips has for a WebP, whose resolution it does not read.
    stored.is_per_inch = "resolution-unit" in fields and header.xres != 1.0
    stored.orientation = fields.get("orientation", 1)
    stored.space = ColorSpace(fields.get("icc-profile-data"))
    stored.note_frames(fields.get("n-pages", 1), "pages" if loader == "tiffload" else "frames")
    # Warnings of a PNG are of what is read otherwise.
    stored.notes_warnings = loader in ("jpegload", "tiffload")
    if loader == "jpegload":
        stored.scales = (1, 2, 4, 8)
        sides = re.escape(struct.pack(">HH", *size[::-1]))
        # The last of its size, because a preview in the EXIF data is a JPEG with an end too.
        frame = re.match(rb".*\xff[\xc0-\xcf].{3}" + sides, file, re.DOTALL)
        if frame and file.find(_END_OF_IMAGE, frame.end()) == -1:
            file += _END_OF_IMAGE
            stored.notes.append("its end marker is missing")
    elif loader == "pngload":
        _add_chunks(stored, file)
    elif loader == "tiffload":
        if stored.alpha is not None and (extra := _numbers(page, Base.ExtraSamples)):
            kinds = [kind in (1, 2) for kind in extra]  # premultiplied or straight alpha
            stored.alpha = colors + kinds.index(True) if True in kinds else None
    elif loader == "heifload":
        if file[8:12] == b"avis":
            stored.notes.append("first of several frames")
        if not stored.space.profile and (match := _NCLX.search(file)):
            stored.set_codes("nclx", [int.from_bytes(code, "big") for code in match.groups()])
    return stored


def _reduced_bytes(loader: str, image: Any) -> int:
    """Return the bytes for each pixel while a photo is reduced (docs/decisions/memory.md)."""
    pixel = image.bands * np.dtype(libvips.TYPES[image.format]).itemsize
    if loader == "jpegload":
        return 3 * pixel if image.get("jpeg-multiscan") else 3
    return {"pngload": pixel + 2, "webpload": 14, "tiffload": 3 * pixel}.get(loader, 5 * pixel + 1)


def _add_chunks(stored: Stored, file: bytes) -> None:
    """Add what the chunks of a PNG before its pixels say that libvips does not tell."""
    chunks: dict[bytes, bytes] = {}
    place = 8
    while (kind := file[place + 4 : place + 8]) not in (b"", b"IDAT"):
        end = place + 8 + int.from_bytes(file[place : place + 4], "big")
        chunks.setdefault(kind, file[place + 8 : end])
        place = end + 4
    gama, chrm = (chunks.get(kind, b"") for kind in (b"gAMA", b"cHRM"))
    if b"sRGB" not in chunks and len(gama) == 4:
        numbers = struct.iter_unpack(">I", gama + chrm * (len(chrm) == 32))
        gamma, *primaries = (number / 100_000 for (number,) in numbers)
        stored.set_gamma(gamma, primaries)
    if iccp := chunks.get(b"iCCP"):  # of which libpng forgets some that are of use
        packed = iccp.partition(b"\0")[2][1:]
        try:
            profile = zlib.decompressobj().decompress(packed, _MOST_PROFILE)
            stored.space = replace(stored.space, profile=profile)
        except zlib.error:
            stored.notes.append(UNUSABLE)
    if len(codes := chunks.get(b"cICP", b"")) == 4:
        stored.set_codes("cICP", codes[:2])
    stored.is_per_inch |= chunks.get(b"pHYs", b"")[8:] == b"\1"
    stored.note_frames(int.from_bytes(chunks.get(b"acTL", b"")[:4], "big"))


def _tiff_tags(file: bytes) -> dict[int, Any]:
    """Return the tags of the first page; none if they cannot be read, for libtiff has the say."""
    try:
        page = ImageFileDirectory_v2(file[: 16 if b"+" in file[2:4] else 8])
        stream = io.BytesIO(file)
        stream.seek(page.next)
        page.load(stream)
        return dict(page)
    except Exception:  # hostile bytes make the reader raise anything
        return {}


def _numbers(tags: dict[int, Any], tag: int) -> tuple[int, ...]:
    value = tags.get(tag, ())
    return value if isinstance(value, tuple) else (value,)


def _is_of_pillow(page: dict[int, Any]) -> bool:
    """Whether libvips lacks a kind of TIFF that Pillow has, which is of up to 8 bits."""
    return max(_numbers(page, Base.BitsPerSample), default=1) <= 8 and (
        page.get(Base.PhotometricInterpretation) == _LAB
        or page.get(Base.Compression) in (_OLD_JPEG, _LZMA, _ZSTD)
        or (page.get(Base.PlanarConfiguration) == _SEPARATE and Base.TileWidth in page)
    )


def _refuse_unread(page: dict[int, Any]) -> None:
    """Raise ValueError for a TIFF of which another picture would be read, by its tags."""
    if page.get(Base.NewSubfileType) == 1 or Base.DNGVersion in page:
        raise ValueError("it is a camera's raw file, or begins with a preview")
    if 0 in _numbers(page, Base.StripOffsets) + _numbers(page, Base.TileOffsets):
        raise ValueError("some of its strips or tiles have no data")
    color = page.get(Base.PhotometricInterpretation)
    is_separate = page.get(Base.PlanarConfiguration) == _SEPARATE
    if color == _INKS and page.get(Base.SamplesPerPixel) in (1, 2, 3):
        raise ValueError("its inks are not cyan, magenta, yellow and black")
    is_whole = is_separate or _numbers(page, Base.YCbCrSubSampling) == (1, 1)
    if color == _YCBCR and is_whole and page.get(Base.Compression) not in (_OLD_JPEG, _JPEG):
        raise ValueError("its luma has no more pixels than its chroma, or they are in planes")
    bits, kinds = _numbers(page, Base.BitsPerSample), _numbers(page, Base.SampleFormat)
    is_half, is_grey = _FLOAT in kinds and 16 in bits, color in (0, 1)
    if is_separate and (
        is_half or (is_grey and page.get(Base.SamplesPerPixel, 1) > 1)
    ):  # which libvips reads as if they were not in planes
        raise ValueError("its grey and alpha, or its floats of 16 bits, are in planes")
