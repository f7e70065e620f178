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

from gauss2svg.errors import brief
from gauss2svg.photo import by_pillow, libvips
from gauss2svg.photo.srgb import INKS, UNUSABLE, ColorSpace, by_gamma
from gauss2svg.photo.stored import Rows, Stored
from gauss2svg.photo.tags import exif_tags, tags_of

_COLORS = {"b-w": 1, "grey16": 1, "cmyk": INKS}  # channels by interpretation; 3 in others
_MOST_EXTRA = 4  # samples besides colours: hostile files have thousands
_START_OF_SCAN, _END_OF_IMAGE = b"\xff\xda", b"\xff\xd9"
_CUT = "premature end of data segment"  # libjpeg's words, which libvips only warns of
_JFIF = re.compile(rb"\xff\xd8\xff\xe0(?!\0[\0-\x0f])..JFIF\0..(.)(..)(..)", re.DOTALL)
_NCLX = re.compile(rb"colrnclx(..)(..)", re.DOTALL)
_AV1 = re.compile(rb"av1C..(.)", re.DOTALL)
_GREY = 0x10  # bit of that byte
_HEAD = 1 << 16  # bytes of a file in which it stands
_MOST_PROFILE = 1 << 24  # bytes of a PNG's profile, unpacked
_REDUCED_RESOLUTION = 1  # bit of a TIFF's NewSubfileType
_PREMULTIPLIED, _STRAIGHT = 1, 2  # ExtraSamples of a TIFF
_LAB = 8  # PhotometricInterpretation
_FAXES = (2, 3, 4)  # Compression
_SEPARATE, _FLOAT = 2, 3  # PlanarConfiguration, SampleFormat


def opened(file: bytes, loader: str) -> Stored:
    """Read the header of a file by a loader of libvips."""
    page = _tiff_tags(file) if loader == "tiffload" else {}
    if page.get(Base.PhotometricInterpretation) == _LAB:  # whose 8 bits libvips does not read
        return by_pillow.opened(file, "Tiff")
    lacks_end = loader == "jpegload" and file.rfind(_END_OF_IMAGE) < file.rfind(_START_OF_SCAN)
    if lacks_end:
        file += _END_OF_IMAGE
    if (match := _AV1.search(file, 0, _HEAD)) and loader == "heifload" and match[1][0] & _GREY:
        return by_pillow.opened(file, "Avif")  # libheif does not widen greys of 16..235
    # Of broken tiles and faxes libtiff only warns, as of a strip whose length is left out.
    is_strict = (Base.TileWidth in page or page.get(Base.Compression) in _FAXES) and (
        0 not in _numbers(page, Base.StripByteCounts)
    )

    def image(**options: int) -> Any:
        load = getattr(pyvips.Image, f"{loader}_buffer")
        fail_on = "warning" if is_strict else "error"
        if loader == "tiffload":  # without which a part of 50 MB is refused
            options["unlimited"] = True
        picture = load(file, access="sequential", fail_on=fail_on, **options)
        if loader == "heifload" and picture.format == "ushort":
            bits = _field(picture, "bits-per-sample")
            return picture.linear(1 / ((1 << bits) - 1 << 16 - bits), 0)
        if page.get(Base.PhotometricInterpretation) == 0 and picture.format == "float":
            others = picture.bands - 1
            return picture.linear([-1] + [1] * others, [1] + [0] * others)
        return picture

    def rows(scale: int) -> Rows:
        picture = image()
        if scale > 1:  # to whole pixels, of which libvips leaves out the last
            size = -(-picture.width // scale), -(-picture.height // scale)
            picture = image(shrink=scale).embed(0, 0, *size, extend="copy")
        libvips.forget_warnings()
        yield from libvips.rows(picture)
        del picture  # by which libjpeg's warnings come
        if any(_CUT in message for message in libvips.warnings()):
            raise OSError(_CUT)
        if loader in ("jpegload", "tiffload"):  # those of a PNG are of what is read otherwise
            stored.notes += (f"decoder warns: {brief(m)}" for m in libvips.warnings()[-1:])

    header = image()
    if header.format not in libvips.TYPES:
        raise ValueError(f"its samples are of type {header.format}")
    colors = min(_COLORS.get(header.interpretation, 3), header.bands)
    if header.bands > colors + _MOST_EXTRA:
        raise ValueError(f"it has {header.bands} samples for each pixel")
    alpha = colors if header.hasalpha() else None
    stored = Stored(
        header.width, header.height, colors, alpha, rows, _reduced_bytes(loader, header)
    )
    stored.space = ColorSpace(_field(header, "icc-profile-data"))
    what = "pages" if loader == "tiffload" else "frames"
    stored.note_frames(_field(header, "n-pages") or 1, what)
    if lacks_end:
        stored.notes.append("its end marker is missing")
    exif, broken = exif_tags(_field(header, "exif-data"), is_turned=loader == "heifload")
    stored.tags = tags_of(exif, broken)
    if loader == "pngload":
        _add_chunks(stored, file)
    elif loader == "tiffload":
        _add_tags(stored, page)
    elif loader == "jpegload":
        stored.scales = (1, 2, 4, 8)
        if match := _JFIF.match(file):
            unit, *density = (int.from_bytes(number, "big") for number in match.groups())
            if unit or Base.XResolution not in exif:
                stored.tags = tags_of(exif, broken, density, unit + 1)
    elif loader == "heifload":
        if file[8:12] == b"avis":
            stored.notes.append("first of several frames")
        if not stored.space.profile and (match := _NCLX.search(file)):
            stored.set_codes("nclx", [int.from_bytes(code, "big") for code in match.groups()])
    return stored


def _field(image: Any, name: str) -> Any:
    return image.get(name) if image.get_typeof(name) else None


def _reduced_bytes(loader: str, image: Any) -> int:
    """Return the bytes for each pixel while a photo is reduced (docs/decisions/memory.md)."""
    pixel = image.bands * np.dtype(libvips.TYPES[image.format]).itemsize
    if loader == "jpegload":
        return 3 * pixel if _field(image, "jpeg-multiscan") else 3
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
        numbers = struct.iter_unpack(">I", gama + chrm[:32])
        gamma, *primaries = (number / 100_000 for (number,) in numbers)
        stored.space = by_gamma(gamma, primaries)
    if iccp := chunks.get(b"iCCP"):  # of which libpng forgets some that are of use
        packed = iccp.partition(b"\0")[2][1:]
        try:
            profile = zlib.decompressobj().decompress(packed, _MOST_PROFILE)
            stored.space = replace(stored.space, profile=profile)
        except zlib.error:
            stored.notes.append(UNUSABLE)
    if len(codes := chunks.get(b"cICP", b"")) == 4:
        stored.set_codes("cICP", codes[:2])
    density, unit = None, 0
    if len(stated := chunks.get(b"pHYs", b"")) == 9:
        *density, unit = struct.unpack(">IIB", stated)
        if unit:  # px per metre
            density = [0.0254 * number for number in density]
    stored.tags = tags_of(*exif_tags(chunks.get(b"eXIf")), density, 2 if unit else 1)
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


def _add_tags(stored: Stored, page: dict[int, Any]) -> None:
    """Add what the tags of a TIFF's first page say that libvips does not tell."""
    if page.get(Base.NewSubfileType, 0) == _REDUCED_RESOLUTION or Base.DNGVersion in page:
        raise ValueError("it is a camera's raw file, or begins with a preview")
    if 0 in _numbers(page, Base.StripOffsets) + _numbers(page, Base.TileOffsets):
        raise ValueError("some of its strips or tiles have no data")
    is_half = page.get(Base.SampleFormat, (1,))[0] == _FLOAT and page[Base.BitsPerSample][0] == 16
    if page.get(Base.PlanarConfiguration) == _SEPARATE and (
        is_half or (stored.colors == 1 and stored.alpha is not None)
    ):  # which libvips reads as if they were not in planes
        raise ValueError("its grey and alpha, or its floats of 16 bits, are in planes")
    if stored.alpha is not None and (extra := _numbers(page, Base.ExtraSamples)):
        kinds = [kind in (_PREMULTIPLIED, _STRAIGHT) for kind in extra]
        stored.alpha = stored.colors + kinds.index(True) if True in kinds else None
    stored.tags = tags_of(page)
