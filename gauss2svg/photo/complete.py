"""Whether the data of an image file reach its last pixel, where the decoder does not ask.

Pillow refuses what ends early in a GIF, WebP, BMP or AVIF. The pixels that it does not find it
leaves black in a PNG and in a TIFF, and libjpeg makes them grey.
"""

from __future__ import annotations

import io
import math
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from PIL import Image
from PIL.JpegImagePlugin import JpegImageFile

# The next marker of a JPEG that is not within the data of a scan, as stuffing and restarts are.
_MARKER = re.compile(rb"\xff+([\x01-\xcf\xd8-\xfe])")
_END_OF_IMAGE, _START_OF_SCAN = 0xD9, 0xDA
_ARITHMETIC = range(0xC9, 0xD0)  # frames of a coder whose data may leave out trailing zeros
_WITHOUT_LENGTH = (0x01, 0xD8)
_RESTARTS = range(0xD0, 0xD8)
_PADDING = bytes(1 + 89 * n * n % 251 for n in range(500))  # no 0xFF; any pattern would do
_BAND = 256  # rows that are compared at once
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # by colour type
# First column, first row, step across and step down of each pass (PNG, third edition, 8.1).
_ADAM7 = (
    (0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
    (0, 1, 1, 2),
)  # fmt: skip
_WIDTH, _HEIGHT, _SAMPLES, _PLANES = 256, 257, 277, 284  # tags of a TIFF
_STRIPS, _TILES = (273, 279), (324, 325)  # offsets and byte counts
_ROWS_PER_STRIP, _TILE_WIDTH, _TILE_HEIGHT = 278, 322, 323
_SEPARATE = 2


def lack_of(image: Image.Image) -> Callable[[Image.Image], str]:
    """What to ask of an image after it is loaded, given before: what its file lacks, "" if nothing.

    A file that cannot be understood lacks nothing here: that is for its decoder to say.
    """
    if image.format == "TIFF":
        tags = dict(getattr(image, "tag_v2", {}))
        return lambda _: _lack_of_tiff(tags)
    file = getattr(image, "fp", None)
    check = {"PNG": _lack_of_png, "JPEG": _lack_of_jpeg, "MPO": _lack_of_jpeg}.get(
        image.format or ""
    )
    if file is None or check is None or not getattr(image, "tile", None):
        return lambda _: ""
    place = file.tell()
    file.seek(0)
    data = file.read()
    file.seek(place)
    return lambda loaded: check(data, loaded)


def lack_of_parts(offsets: Sequence[int], counts: Sequence[int], number: int) -> str:
    """What a TIFF lacks of its number of strips or tiles; 0 or none stands for one left out."""
    present = sum(1 for offset, count in zip(offsets, counts, strict=False) if offset and count)
    missing = number - min(present, number)
    return f"{missing} of its {number} strips or tiles have no data" if missing else ""


def _lack_of_tiff(tags: dict[int, Any]) -> str:
    def number(tag: int, default: int) -> int:
        value = tags.get(tag, default)
        return value if isinstance(value, int) and value > 0 else default

    width, height = number(_WIDTH, 1), number(_HEIGHT, 1)
    parts = math.ceil(height / number(_ROWS_PER_STRIP, height))
    places, sizes = _STRIPS
    if _TILES[0] in tags:
        places, sizes = _TILES
        parts = math.ceil(width / number(_TILE_WIDTH, width))
        parts *= math.ceil(height / number(_TILE_HEIGHT, height))
    if tags.get(_PLANES) == _SEPARATE:
        parts *= number(_SAMPLES, 1)
    offsets = _as_tuple(tags.get(places))
    if not offsets:  # as in old files of JPEG data
        return ""
    return lack_of_parts(offsets, _as_tuple(tags.get(sizes)) or (1,) * len(offsets), parts)


def _as_tuple(value: Any) -> tuple[int, ...]:
    return value if isinstance(value, tuple) else () if value is None else (value,)


def _lack_of_png(file: bytes, image: Image.Image) -> str:
    """By the length of its unpacked rows."""
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
        while data and left > 0 and not unpack.eof:
            left -= len(unpack.decompress(data, min(left, 1 << 20)))
            data = unpack.unconsumed_tail
    return f"its data end after {(needed - left) / needed:.1%} of its rows" if left > 0 else ""


def _packed_rows(file: bytes) -> Iterator[bytes]:
    """The data of each IDAT of a PNG."""
    place = 8
    while place + 8 <= len(file):
        end = place + 8 + int.from_bytes(file[place : place + 4], "big")
        if file[place + 4 : place + 8] == b"IDAT":
            yield file[place + 8 : end]
        place = end + 4


def _lack_of_jpeg(file: bytes, image: Image.Image) -> str:
    """By whether more data at the end of a scan change the picture."""
    padded = _padded(file)
    if padded is None:
        return ""
    with JpegImageFile(io.BytesIO(padded), "") as other:
        other.load()
        if (other.size, other.mode) != (image.size, image.mode):  # its owner asked for a draft
            return ""
        width, height = image.size
        for top in range(0, height, _BAND):
            band = (0, top, width, min(top + _BAND, height))
            one, two = image.crop(band), other.crop(band)
            if one.tobytes() != two.tobytes():
                changed = next(
                    row for row in range(band[3] - top)
                    if one.crop((0, row, width, row + 1)).tobytes()
                    != two.crop((0, row, width, row + 1)).tobytes()
                )  # fmt: skip
                return f"its data end at row {top + changed} of {height}"
    return ""


def _padded(file: bytes) -> bytes | None:
    """The first JPEG of a file with more data in every scan, which those that are whole skip."""
    parts, done, place = [], 0, 0
    while found := _MARKER.search(file, place):
        kind = found[1][0]
        place = found.end()
        if kind == _END_OF_IMAGE:
            return b"".join((*parts, file[done:place]))
        if kind in _ARITHMETIC and kind != 0xCC:
            return None
        if kind in _WITHOUT_LENGTH:
            continue
        place += int.from_bytes(file[place : place + 2], "big")
        if kind == _START_OF_SCAN:
            if (end := _MARKER.search(file, place)) is None:
                return None
            parts += [file[done : end.start()], _padding(file[place : end.start()])]
            done = place = end.start()
    return None


def _padding(scan: bytes) -> bytes:
    """Data that go on with those of a scan, also after each restart that may come next."""
    last = max(_RESTARTS, key=lambda kind: scan.rfind(bytes((0xFF, kind))))
    if scan.find(bytes((0xFF, last))) < 0:
        last = _RESTARTS[-1]
    following = (bytes((0xFF, 0xD0 | (last + n) & 7)) for n in range(1, 9))
    return _PADDING + b"".join(restart + _PADDING for restart in following)
