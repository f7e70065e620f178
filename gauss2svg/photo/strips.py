"""Samples of the strips and tiles of a TIFF, of any number of bits, in one plane or in several.

Pillow reads the common kinds of pixels. Of any other kind its libtiff can still unpack the data, as
the bytes of a grey image; predictors are undone here (TIFF 6.0, section 14; TIFF Technical Note 3).
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from PIL.ExifTags import Base
from PIL.TiffImagePlugin import TiffImageFile

from gauss2svg.photo.reduce import rows_at_once
from gauss2svg.photo.stderr import stderr_silenced

SEPARATE = 2  # PlanarConfiguration
NOT_COMPRESSED = 1
_DEFLATE = (8, 32946)
UNPACKED = (NOT_COMPRESSED, *_DEFLATE, 5, 32773, 34925, 50000)  # LZW, PackBits, LZMA, Zstandard
_NONE, _HORIZONTAL, _FLOATING = 1, 2, 3  # predictors
_WITHOUT_PREDICTOR = (NOT_COMPRESSED, 32773)  # whatever the tag says, as in libtiff
_REVERSED = 2  # FillOrder
_WHOLE = (8, 16, 32, 64)  # bits of samples that are whole bytes
_UNSIGNED, _FLOAT, _UNDEFINED = 1, 3, 4  # SampleFormat; the last is read as the first
_OTHER_ORDER = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))  # of the bits of a byte

Samples = NDArray[Any]


def bands(file: BinaryIO, page: Any) -> Iterator[Samples]:
    """The samples of a page (tifffile's), (rows, w, samples) from the top, one row of tiles each.

    Those of fewer bits than a type has are in the lower ones; float64 becomes float32. Raises
    OSError for data that end early, and zlib.error or ValueError for broken ones.
    """
    width, height, samples = page.imagewidth, page.imagelength, page.samplesperpixel
    across, down = _part_size(page)
    columns, rows = -(-width // across), -(-height // down)
    planes = samples if page.planarconfig == SEPARATE else 1
    for row in range(rows):
        tall = min(down, height - row * down)
        stored = down if page.is_tiled else tall
        band: Samples | None = None
        for plane in range(planes):
            for column in range(columns):
                part = (plane * rows + row) * columns + column
                left = column * across
                for top, values in _part(file, page, part, (stored, across)):
                    values = values[: max(0, tall - top), : width - left]
                    if band is None:
                        is_long = values.dtype.itemsize > 4
                        kind = np.float32 if is_long else values.dtype.newbyteorder("=")
                        band = np.empty((tall, width, samples), kind)
                    place = band[top : top + len(values), left : left + across, plane:]
                    with np.errstate(over="ignore"):  # to infinity, which is refused
                        place[:, :, : values.shape[2]] = values
        if band is not None:
            yield band


def part_bytes(page: Any) -> int:
    """Largest number of bytes that the data of a strip or tile take while they are unpacked."""
    across, down = _part_size(page)
    copies = 1 if page.compression in _DEFLATE else 2 if page.compression == NOT_COMPRESSED else 3
    return copies * down * _bytes_of_row(page, across)


def are_read(page: Any) -> bool:
    """Whether samples of such bits, format and predictor are."""
    bits, is_float = page.bitspersample, page.sampleformat == _FLOAT
    if not isinstance(bits, int) or page.sampleformat not in (_UNSIGNED, _FLOAT, _UNDEFINED):
        return False
    whole = bits in _WHOLE
    predictors = {_NONE: True, _HORIZONTAL: whole, _FLOATING: whole and is_float}
    return predictors.get(_predictor(page), False) and (whole or not is_float)


def _predictor(page: Any) -> int:
    return _NONE if page.compression in _WITHOUT_PREDICTOR else int(page.predictor)


def _part_size(page: Any) -> tuple[int, int]:
    """Columns and rows of a tile, or of a strip."""
    if page.is_tiled:
        return page.tilewidth, page.tilelength
    return page.imagewidth, min(page.rowsperstrip or page.imagelength, page.imagelength)


def _bytes_of_row(page: Any, columns: int) -> int:
    return -(-columns * _samples_together(page) * page.bitspersample // 8)


def _samples_together(page: Any) -> int:
    """How many samples of a pixel lie side by side."""
    return 1 if page.planarconfig == SEPARATE else page.samplesperpixel


def _part(
    file: BinaryIO, page: Any, k: int, size: tuple[int, int]
) -> Iterator[tuple[int, Samples]]:
    """Strip or tile k: the first of some rows, and they, (rows, columns, samples).

    Some at a time: bits become bytes.
    """
    rows, columns = size
    a_row = _bytes_of_row(page, columns)
    file.seek(page.dataoffsets[k])
    data = file.read(page.databytecounts[k])
    if len(data := _unpacked(data, page, rows * a_row)) < rows * a_row:
        number = len(page.dataoffsets)
        raise OSError(f"the data of its strip or tile {k + 1} of {number} end early")
    step = rows_at_once(a_row, 8)
    for top in range(0, rows, step):
        some = min(step, rows - top)
        piece = np.frombuffer(data, np.uint8, some * a_row, top * a_row).reshape(some, a_row)
        yield top, _values(piece, page, columns)


def _values(data: NDArray[np.uint8], page: Any, columns: int) -> Samples:
    """Samples (rows, columns, samples) of the unpacked bytes of rows."""
    rows, bits = len(data), page.bitspersample
    samples = _samples_together(page)
    if bits not in _WHOLE:
        digits = np.unpackbits(data, axis=1)[:, : columns * samples * bits]
        weights = 1 << np.arange(bits, dtype=np.uint16)[::-1]
        values = digits.reshape(rows, columns, samples, bits) @ weights
        return values.astype(np.uint8 if bits < 8 else np.uint16)
    bytes_each = bits // 8
    shape = rows, columns, samples
    predictor = _predictor(page)
    if predictor == _FLOATING:  # bytes by significance, each the difference to that before
        sums = data.reshape(rows, -1, samples).cumsum(axis=1, dtype=np.uint8)
        by_value = np.moveaxis(sums.reshape(rows, bytes_each, -1), 1, 2)
        return np.ascontiguousarray(by_value).view(f">f{bytes_each}").reshape(shape)
    order = page.parent.byteorder
    values = data.view(f"{order}u{bytes_each}").reshape(shape)
    if predictor == _HORIZONTAL:
        native = values.astype(f"=u{bytes_each}")
        values = native.cumsum(axis=1, dtype=native.dtype)
        order = "="
    return values.view(f"{order}{'f' if page.sampleformat == _FLOAT else 'u'}{bytes_each}")


def _unpacked(data: bytes, page: Any, size: int) -> bytes:
    if page.compression in _DEFLATE:
        return zlib.decompressobj().decompress(_in_order(data, page), size)
    if page.compression == NOT_COMPRESSED:
        return _in_order(data, page)
    tags: dict[int, int] = {
        Base.ImageWidth: size,
        Base.ImageLength: 1,
        Base.BitsPerSample: 8,
        Base.Compression: int(page.compression),
        Base.PhotometricInterpretation: 1,
        Base.FillOrder: _fill_order(page),
    }
    tiff = one_strip(data, tags)
    with TiffImageFile(io.BytesIO(tiff), "") as image, stderr_silenced():
        return image.tobytes()


def _in_order(data: bytes, page: Any) -> bytes:
    """The data with the highest bit of each byte first."""
    return data.translate(_OTHER_ORDER) if _fill_order(page) == _REVERSED else data


def _fill_order(page: Any) -> int:
    return page.tags.valueof(Base.FillOrder, default=1)


def one_strip(data: bytes, tags: Mapping[int, int]) -> bytes:
    """A grey TIFF of one strip of these data, with more tags, such as its size."""
    numbers = {
        **tags,
        Base.StripOffsets: 8,
        Base.SamplesPerPixel: 1,
        Base.RowsPerStrip: tags[Base.ImageLength],
        Base.StripByteCounts: len(data),
    }
    entries = (struct.pack("<HHII", tag, 4, 1, numbers[tag]) for tag in sorted(numbers))
    directory = struct.pack("<H", len(numbers)) + b"".join(entries) + bytes(4)
    return b"II*\0" + struct.pack("<I", 8 + len(data)) + data + directory
