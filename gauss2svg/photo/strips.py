"""Samples of the strips and tiles of a TIFF, of any number of bits, in one plane or in several.

Pillow reads the common kinds of pixels. Of any other kind its libtiff can still unpack the data, as
the bytes of a grey image; predictors are undone here (TIFF 6.0, section 14; TIFF Technical Note 3).
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL.TiffImagePlugin import TiffImageFile

from gauss2svg.photo.stderr import stderr_silenced

_SEPARATE = 2  # PlanarConfiguration
NOT_COMPRESSED = 1
_DEFLATE = (8, 32946)
UNPACKED = (NOT_COMPRESSED, *_DEFLATE, 5, 32773, 34925, 50000)  # LZW, PackBits, LZMA, Zstandard
_HORIZONTAL, _FLOATING = 2, 3  # predictors
_FILL_ORDER, _REVERSED = 266, 2
_WHOLE = (8, 16, 32, 64)  # bits of samples that are whole bytes
_KINDS = {1: "u", 2: "i", 3: "f"}  # by SampleFormat

Samples = NDArray[Any]


def bands(file: BinaryIO, page: Any) -> Iterator[Samples]:
    """The samples of a page (tifffile's), (rows, w, samples) from the top, one row of tiles each.

    Those of fewer bits than a type has are in the lower ones. Raises OSError for data that end
    early, and zlib.error or ValueError for broken ones.
    """
    width, height, samples = page.imagewidth, page.imagelength, page.samplesperpixel
    across, down = (page.tilewidth, page.tilelength) if page.is_tiled else (width, 0)
    down = down or min(page.rowsperstrip or height, height)
    columns, rows = -(-width // across), -(-height // down)
    planes = samples if page.planarconfig == _SEPARATE else 1
    for row in range(rows):
        tall = min(down, height - row * down)
        stored = down if page.is_tiled else tall
        band = [
            np.hstack(
                [
                    _part(file, page, (plane * rows + row) * columns + column, (stored, across))
                    for column in range(columns)
                ]
            )[:tall, :width]
            for plane in range(planes)
        ]
        yield np.dstack(band)


def _part(file: BinaryIO, page: Any, k: int, size: tuple[int, int]) -> Samples:
    """Strip or tile k, (rows, columns, samples)."""
    rows, columns = size
    bits, several = page.bitspersample, page.planarconfig != _SEPARATE
    samples = page.samplesperpixel if several else 1
    a_row = -(-columns * samples * bits // 8)
    file.seek(page.dataoffsets[k])
    data = file.read(page.databytecounts[k])
    if len(data := _unpacked(data, page, rows * a_row)) < rows * a_row:
        number = len(page.dataoffsets)
        raise OSError(f"the data of its strip or tile {k + 1} of {number} end early")
    data = np.frombuffer(data, np.uint8, rows * a_row).reshape(rows, a_row)
    if bits not in _WHOLE:
        digits = np.unpackbits(data, axis=1)[:, : columns * samples * bits]
        weights = 1 << np.arange(bits, dtype=np.uint16)[::-1]
        values = digits.reshape(rows, columns, samples, bits) @ weights
        return values.astype(np.uint8 if bits < 8 else np.uint16)
    bytes_each = bits // 8
    shape = rows, columns, samples
    if page.predictor == _FLOATING:  # bytes by significance, each the difference to that before
        sums = data.reshape(rows, -1, samples).cumsum(axis=1, dtype=np.uint8)
        by_value = np.moveaxis(sums.reshape(rows, bytes_each, -1), 1, 2)
        return np.ascontiguousarray(by_value).view(f">f{bytes_each}").reshape(shape)
    order = page.parent.byteorder
    values = data.view(f"{order}u{bytes_each}").reshape(shape)
    if page.predictor == _HORIZONTAL:
        native = values.astype(f"=u{bytes_each}")
        values = native.cumsum(axis=1, dtype=native.dtype)
        order = "="
    return values.view(f"{order}{_KINDS[page.sampleformat]}{bytes_each}")


def _unpacked(data: bytes, page: Any, size: int) -> bytes:
    if page.compression in _DEFLATE:
        return zlib.decompressobj().decompress(_in_order(data, page), size)
    if page.compression == NOT_COMPRESSED:
        return _in_order(data, page)
    numbers = {
        256: size, 257: 1, 258: 8, 259: int(page.compression), 262: 1,
        _FILL_ORDER: page.tags.valueof(_FILL_ORDER, default=1), 273: 8, 277: 1, 278: 1,
        279: len(data),
    }  # fmt: skip
    entries = (struct.pack("<HHII", tag, 4, 1, value) for tag, value in numbers.items())
    directory = struct.pack("<H", len(numbers)) + b"".join(entries) + bytes(4)
    tiff = b"II*\0" + struct.pack("<I", 8 + len(data)) + data + directory
    with TiffImageFile(io.BytesIO(tiff), "") as image, stderr_silenced():
        return image.tobytes()


def _in_order(data: bytes, page: Any) -> bytes:
    """With the highest bit of each byte first."""
    if page.tags.valueof(_FILL_ORDER, default=1) != _REVERSED:
        return data
    bits = np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little")
    return np.packbits(bits).tobytes()
