"""Photos by libvips: JPEG, PNG, WebP, TIFF, GIF and AVIF.

Each loader is called by its name, so libvips never chooses another one by the file.
"""

from __future__ import annotations

import io
import re
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pyvips
from PIL.ExifTags import Base
from PIL.TiffImagePlugin import ImageFileDirectory_v2

from gauss2svg.errors import InputError, brief, on_one_line
from gauss2svg.photo import by_pillow, libvips
from gauss2svg.photo.srgb import INKS, UNUSABLE, ColorSpace, by_codes, by_gamma
from gauss2svg.photo.stored import Rows, Stored, frames_note
from gauss2svg.photo.tags import exif_tags, tags_of

_COLORS = {"b-w": 1, "grey16": 1, "cmyk": INKS}  # channels by interpretation; 3 in others
_MOST_EXTRA = 4  # samples besides colours: hostile files have thousands
_START_OF_SCAN, _END_OF_IMAGE = b"\xff\xda", b"\xff\xd9"
_CUT = "premature end of data segment"  # libjpeg's words, which libvips only warns of
_JFIF = re.compile(rb"\xff\xd8\xff\xe0..JFIF\0..(.)(..)(..)", re.DOTALL)
_NCLX = re.compile(rb"colrnclx(..)(..)", re.DOTALL)
_REDUCED_RESOLUTION = 1  # bit of a TIFF's NewSubfileType
_PREMULTIPLIED, _STRAIGHT = 1, 2  # ExtraSamples of a TIFF
_LAB = 8  # PhotometricInterpretation
_SEPARATE = 2  # PlanarConfiguration


def opened(file: bytes, loader: str, name: str) -> Stored:
    """Read the header of a file by a loader of libvips."""
    page = _tiff_tags(file) if loader == "tiffload" else {}
    if page.get(Base.PhotometricInterpretation) == _LAB:  # whose 8 bits libvips does not read
        return by_pillow.opened(file, "Tiff", name)
    if 0 in _numbers(page, Base.StripOffsets) + _numbers(page, Base.TileOffsets):
        raise ValueError("some of its strips or tiles have no data")
    # A strip whose length is 0 gives a warning, and so do tiles and lines of faxes that are broken.
    strict = loader == "tiffload" and 0 not in _numbers(page, Base.StripByteCounts)
    notes: list[str] = []
    if loader == "jpegload" and file.rfind(_END_OF_IMAGE) < file.rfind(_START_OF_SCAN):
        file += _END_OF_IMAGE
        notes.append("its end marker is missing")

    def image(**options: int) -> Any:
        load = getattr(pyvips.Image, f"{loader}_buffer")
        picture = load(
            file, access="sequential", fail_on="warning" if strict else "error", **options
        )
        if loader == "gifload" and not picture.hasalpha():
            return _with_margin(picture, file)
        return picture

    def rows(scale: int) -> Rows:
        picture = image()
        if scale > 1:  # to whole pixels, of which libvips leaves out the last
            size = -(-picture.width // scale), -(-picture.height // scale)
            picture = image(shrink=scale).embed(0, 0, *size, extend="copy")
        libvips.forget_warnings()
        yield from libvips.rows(picture)
        del picture  # by which libjpeg's warnings come
        warnings = libvips.warnings()
        if any(_CUT in message for message in warnings):
            raise OSError(_CUT)
        if warnings:
            notes.append(f"its data are damaged: {brief(on_one_line(warnings[0]))}")

    header = image()
    if header.format not in libvips.TYPES:
        raise ValueError(f"its samples are of type {header.format}")
    colors = min(_COLORS.get(header.interpretation, 3), header.bands)
    if header.bands > colors + _MOST_EXTRA:
        raise ValueError(f"it has {header.bands} samples for each pixel")
    what = "pages" if loader == "tiffload" else "frames"
    notes += frames_note(_field(header, "n-pages") or 1, what)
    tags, broken = exif_tags(_field(header, "exif-data"), is_turned=loader == "heifload")
    stored = Stored(
        header.width,
        header.height,
        colors,
        colors if header.hasalpha() else None,
        rows,
        _reduced_bytes(loader, header),
        space=ColorSpace(_field(header, "icc-profile-data")),
        tags=tags_of(tags, broken),
        notes=notes,
    )
    if loader == "jpegload":
        if match := _JFIF.match(file):
            unit, *density = (int.from_bytes(number, "big") for number in match.groups())
            if unit or Base.XResolution not in tags:
                stored = replace(stored, tags=tags_of(tags, broken, tuple(density), unit + 1))
        return replace(stored, scales=(1, 2, 4, 8))
    if loader == "pngload":
        return _of_png(stored, file)
    if loader == "tiffload":
        return _of_tiff(stored, header, page, name)
    if loader == "heifload":
        return _of_avif(stored, header, file)
    return stored


def _field(image: Any, name: str) -> Any:
    return image.get(name) if image.get_typeof(name) else None


def _reduced_bytes(loader: str, image: Any) -> int:
    """Bytes for each pixel while a photo is decoded and reduced (docs/decisions/memory.md)."""
    pixel = image.bands * np.dtype(libvips.TYPES[image.format]).itemsize
    if loader == "jpegload":
        return 2 * pixel if _field(image, "jpeg-multiscan") else 1
    return {"pngload": pixel, "webpload": 16, "tiffload": 2 * pixel, "gifload": 8}.get(
        loader, 5 * pixel
    )


def _with_margin(image: Any, file: bytes) -> Any:
    """A GIF whose first frame may be smaller than its screen: transparent around it."""
    place = 13 + (6 << (file[10] & 7) if file[10] & 0x80 else 0)
    while file[place] == 0x21:  # extensions, of blocks
        place += 2
        while file[place]:
            place += 1 + file[place]
        place += 1
    left, top, width, height = struct.unpack_from("<4H", file, place + 1)
    if (width, height) == (image.width, image.height):
        return image
    shows = (pyvips.Image.black(width, height) + 255).cast("uchar")
    return image.bandjoin(shows.embed(left, top, image.width, image.height))


def _of_png(stored: Stored, file: bytes) -> Stored:
    """Add the colour space, the tags and the frames, which libvips does not tell all of."""
    chunks: dict[bytes, bytes] = {}
    place = 8
    while (kind := file[place + 4 : place + 8]) not in (b"", b"IDAT"):
        end = place + 8 + int.from_bytes(file[place : place + 4], "big")
        chunks.setdefault(kind, file[place + 8 : end])
        place = end + 4
    space = stored.space
    if b"iCCP" in chunks and not space.profile:
        stored.notes.append(UNUSABLE)
    coded = by_codes(*chunks[b"cICP"][:2], "cICP") if len(chunks.get(b"cICP", b"")) == 4 else ""
    if isinstance(coded, ColorSpace):
        space = coded
    elif coded:
        stored.notes.append(coded)
    if space is stored.space and not space.profile and b"sRGB" not in chunks:
        gama, chrm = chunks.get(b"gAMA", b""), chunks.get(b"cHRM", b"")
        if len(gama) == 4:
            numbers = [n / 100_000 for n in struct.unpack(f">{len(chrm) // 4}I", chrm)]
            space = by_gamma(int.from_bytes(gama, "big") / 100_000, numbers)
    density, unit = None, 0
    if len(stated := chunks.get(b"pHYs", b"")) == 9:
        *density, unit = struct.unpack(">IIB", stated)
        if unit:  # px per metre
            density = [0.0254 * number for number in density]
    if len(frames := chunks.get(b"acTL", b"")) == 8:
        stored.notes.extend(frames_note(int.from_bytes(frames[:4], "big")))
    tags = tags_of(*exif_tags(chunks.get(b"eXIf")), density, 2 if unit else 1)
    return replace(stored, space=space, tags=tags)


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


def _of_tiff(stored: Stored, header: Any, tags: dict[int, Any], name: str) -> Stored:
    """Add what the tags of the first page say that libvips does not tell."""
    if tags.get(Base.NewSubfileType, 0) == _REDUCED_RESOLUTION or Base.DNGVersion in tags:
        raise InputError(
            f"{name} must be a developed photo; got a camera's raw file, or one that begins "
            "with a preview. Try developing it, and saving it as TIFF, PNG or JPEG"
        )
    if tags.get(Base.PlanarConfiguration) == _SEPARATE and header.bands == 2:
        raise ValueError("its grey and its alpha are in planes")
    alpha = stored.alpha
    if alpha is not None and (extra := tags.get(Base.ExtraSamples)):
        kinds = [kind in (_PREMULTIPLIED, _STRAIGHT) for kind in extra]
        alpha = alpha + kinds.index(True) if True in kinds else None
    return replace(
        stored,
        alpha=alpha,
        is_negative=tags.get(Base.PhotometricInterpretation) == 0 and header.format == "float",
        tags=tags_of(tags),
    )


def _of_avif(stored: Stored, header: Any, file: bytes) -> Stored:
    """Add the codes of its colours; libheif has turned it, whatever its EXIF data say."""
    space, top = stored.space, None
    if file[8:12] == b"avis":
        stored.notes.append("first of several frames")
    if not space.profile and (match := _NCLX.search(file)):
        coded = by_codes(*(int.from_bytes(code, "big") for code in match.groups()), "nclx")
        if isinstance(coded, str):
            stored.notes.append(coded)
        else:
            space = coded
    if header.format == "ushort":
        bits = _field(header, "bits-per-sample")
        top = (1 << bits) - 1 << 16 - bits  # libvips shifts them
    return replace(stored, space=space, top=top)
