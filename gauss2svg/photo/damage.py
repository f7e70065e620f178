"""Damage of image files: whether their data reach the last pixel, where the decoder does not ask.

Pillow refuses what ends early in a GIF, WebP, BMP or AVIF. The pixels that it does not find it
leaves black in a PNG and in a TIFF, and libjpeg makes them grey: `jpeg` says where.
"""

from __future__ import annotations

import io
import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from pkgutil import resolve_name
from typing import Any

from PIL import Image
from PIL.ExifTags import Base
from PIL.JpegImagePlugin import JpegImageFile
from PIL.TiffImagePlugin import TiffImageFile

from gauss2svg.photo.formats import FORMATS
from gauss2svg.photo.jpeg import END_OF_JPEG, survey
from gauss2svg.photo.strips import SEPARATE, one_strip

# Data of any kind without markers. The bits of one are the other's inverted: some code of a block
# without content may begin with either.
_PADDING = bytes(1 + 89 * n * n % 251 for n in range(500))
_PADDINGS = (_PADDING, bytes(255 - byte for byte in _PADDING))
_PIECE = 1 << 18  # bytes
_MOST_PART_PIXELS = 1 << 26  # of a strip or tile that is decoded once more
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by colour type
# First column, first row, step across and step down of each pass (PNG, third edition, 8.1).
_ADAM7 = (
    (0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
    (0, 1, 1, 2),
)  # fmt: skip
# Tags by which libtiff decodes a fax.
_FAX_TAGS = (
    Base.Compression, Base.PhotometricInterpretation, Base.FillOrder, Base.T4Options,
    Base.T6Options,
)  # fmt: skip

_Tags = dict[int, Any]


def damage_of(image: Image.Image) -> Callable[[Image.Image], str]:
    """A function to call with the loaded image, which says what its file lacks, "" if nothing.

    A file that cannot be understood lacks nothing here: that is for its decoder to say.
    """
    known, data = FORMATS.get(image.format or ""), _file_of(image)
    if known is None or not known.damage or not data:
        return lambda _: ""
    check = resolve_name(known.damage)
    tags = dict(getattr(image, "tag_v2", {}))  # loading turns the image, and they go
    return lambda loaded: check(data, loaded, tags)


def mend_jpeg(image: Any) -> list[str]:
    """Give an image that is not loaded yet, if a JPEG, the end marker that it lacks; returns notes.

    Raises OSError where it lacks more than the last bytes of its picture.
    """
    data = _file_of(image) if image.format in ("JPEG", "MPO") else b""
    if not data:
        return []
    drafted = getattr(image, "decoderconfig", ())
    found = survey(data, image.size, drafted[0] if drafted else 1)
    if found.missing and not found.is_few:
        raise OSError(found.missing)
    if not found.ends:
        image.fp = io.BytesIO(data + END_OF_JPEG)
    return found.notes


def _file_of(image: Any) -> bytes:
    """The whole file of an image that is not loaded yet, or nothing."""
    file = getattr(image, "fp", None)
    if file is None or not getattr(image, "tile", None):
        return b""
    place = file.tell()
    file.seek(0)
    data = file.read()
    file.seek(place)
    return data


def damage_of_parts(offsets: Sequence[int], counts: Sequence[int], number: int) -> str:
    """What a TIFF lacks of its number of strips or tiles; 0 or none stands for one left out."""
    present = sum(1 for offset, count in zip(offsets, counts, strict=False) if offset and count)
    missing = number - min(present, number)
    return f"{missing} of its {number} strips or tiles have no data" if missing else ""


def damage_of_tiff(file: bytes, _: Image.Image, tags: _Tags) -> str:
    """What a TIFF lacks of its strips or tiles, "" if nothing."""
    width, height = _number(tags, Base.ImageWidth, 1), _number(tags, Base.ImageLength, 1)
    if is_tiled := Base.TileOffsets in tags:
        places, sizes = Base.TileOffsets, Base.TileByteCounts
        across = _number(tags, Base.TileWidth, width)
        down = _number(tags, Base.TileLength, height)
    else:
        places, sizes = Base.StripOffsets, Base.StripByteCounts
        across, down = width, _number(tags, Base.RowsPerStrip, height)
    offsets = _as_tuple(tags.get(places))
    counts = _as_tuple(tags.get(sizes)) or (1,) * len(offsets)
    if not offsets:  # as in old files of JPEG data
        return ""
    is_separate = tags.get(Base.PlanarConfiguration) == SEPARATE
    planes = _number(tags, Base.SamplesPerPixel, 1) if is_separate else 1
    columns, rows = math.ceil(width / across), math.ceil(height / down)
    number = columns * rows * planes
    if missing := damage_of_parts(offsets, counts, number):
        return missing
    ends = _ENDS.get(_number(tags, Base.Compression, 1))
    if ends is None or across * down > _MOST_PART_PIXELS:
        return ""
    for k, (offset, count) in enumerate(zip(offsets[:number], counts, strict=False)):
        left = height - k // columns % rows * down
        tall = down if is_tiled else min(down, left)
        if ends(file[offset : offset + count], tags, across, tall):
            return f"the data of its strip or tile {k + 1} of {number} end early"
    return ""


def _jpeg_ends(part: bytes, tags: _Tags, width: int, height: int) -> bool:
    tables = tags.get(Base.JPEGTables)
    stream = tables[:-2] + part[2:] if isinstance(tables, bytes) else part
    with JpegImageFile(io.BytesIO(stream), "") as image:
        if image.width > width or image.height > height:  # of which libtiff reads a part
            return False
        return bool(survey(stream, image.size).missing)


def _fax_ends(part: bytes, tags: _Tags, width: int, height: int) -> bool:
    """Whether the data of a fax strip end early; libtiff leaves what is missing white."""
    numbers: dict[int, int] = {
        Base.ImageWidth: width,
        Base.ImageLength: height,
        Base.BitsPerSample: 1,
    }
    numbers |= {tag: tags[tag] for tag in _FAX_TAGS if isinstance(tags.get(tag), int)}
    images = [
        TiffImageFile(io.BytesIO(one_strip(part + padding, numbers)), "")
        for padding in (b"", *map(_with_lines, _PADDINGS))
    ]
    try:
        return len({image.tobytes() for image in images}) > 1
    except OSError:  # the padding is no data of this kind, and was read
        return True


def _with_lines(padding: bytes) -> bytes:
    """Data with ends of lines, up to which libtiff skips what it cannot read."""
    return b"\0\x10".join(padding[k : k + 8] for k in range(0, len(padding), 8))


def _number(tags: _Tags, tag: int, default: int) -> int:
    value = tags.get(tag, default)
    return value if isinstance(value, int) and value > 0 else default


def _as_tuple(value: Any) -> tuple[int, ...]:
    return value if isinstance(value, tuple) else () if value is None else (value,)


def damage_of_png(file: bytes, image: Image.Image, _tags: _Tags) -> str:
    """What a PNG lacks, by the length of its unpacked rows; "" if nothing."""
    bits, color_type, _, _, interlaced = file[24:29]
    samples = bits * _PNG_CHANNELS.get(color_type, 0)
    width, height = image.size
    needed = 0
    for x, y, across, down in _ADAM7 if interlaced else ((0, 0, 1, 1),):
        columns, rows = math.ceil((width - x) / across), math.ceil((height - y) / down)
        if columns > 0 and rows > 0:
            needed += rows * (1 + math.ceil(columns * samples / 8))
    left, unpack = needed, zlib.decompressobj()
    for data in _packed_rows(file):
        rest, got = data, b"."
        while left > 0 and (rest or got) and not unpack.eof:
            got = unpack.decompress(rest, min(left, _PIECE))
            left -= len(got)
            rest = unpack.unconsumed_tail
    return f"its data end after {(needed - left) / needed:.1%} of its rows" if left > 0 else ""


def _packed_rows(file: bytes) -> Iterator[bytes]:
    """The data of each IDAT of a PNG, in pieces: zlib copies what is left of one at each call."""
    place = 8
    while place + 8 <= len(file):
        end = place + 8 + int.from_bytes(file[place : place + 4], "big")
        if file[place + 4 : place + 8] == b"IDAT":
            for begin in range(place + 8, end, _PIECE):
                yield file[begin : min(begin + _PIECE, end)]
        place = end + 4


# By the compression of a TIFF: whether a part ends early, where libtiff only warns.
_ENDS = {2: _fax_ends, 3: _fax_ends, 4: _fax_ends, 32771: _fax_ends, 7: _jpeg_ends}
