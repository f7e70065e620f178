"""What the file of a JPEG has of its picture, by its markers and by the codes of its scans.

libjpeg draws what it finds: what the data of a scan lack becomes grey, or keeps coarser values.
Only what ITU-T T.81 allows is examined, and what takes about as much work as to decode it: of any
other file libjpeg has the say.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, BinaryIO

from PIL import Image

if TYPE_CHECKING:
    from gauss2svg.photo.entropy import Bits

# The next marker that is not within the data of a scan, as stuffing and restarts are.
_MARKER = re.compile(rb"\xff([\x01-\xcf\xd8-\xfe])")
# After any number of fill bytes, which are not in the pattern: runs of them would take it long.
_RESTART, _FILL = re.compile(rb"\xff[\xd0-\xd7]"), b"\xff"
_END_OF_IMAGE, _START_OF_SCAN, _TABLES, _INTERVAL, _LINES = 0xD9, 0xDA, 0xC4, 0xDD, 0xDC
_FRAMES = {0xC0: False, 0xC1: False, 0xC2: True}  # by their marker: whether they are progressive
# Frames of other coders. Data of the arithmetic one may leave out trailing zeros.
_OTHER_FRAMES = (0xC3, 0xC5, 0xC6, 0xC7, 0xC9, 0xCA, 0xCB, 0xCD, 0xCE, 0xCF)
_WITHOUT_LENGTH = (0x01, 0xD8)
END_OF_JPEG = bytes((0xFF, _END_OF_IMAGE))
_COEFFICIENTS = 64
# Of a scan and of a block of all of its components (T.81, B.2.2 and B.2.3), and the largest
# symbol of a direct coefficient, which libjpeg allows.
_MOST_PARTS = 4
_MOST_BLOCKS_AT_ONCE = 10
_MOST_BITS = 15
_MOST_SEGMENTS = 1000  # a hostile file has more
_MOST_BLOCKS = 1 << 26  # in all scans; a picture of the most pixels has fewer

_Codes = tuple[bytes, bytes]  # number by length, and symbols
_DHT = Mapping[int, _Codes]  # by class and destination


class _UnusualError(Exception):
    """A JPEG that is not examined."""


@dataclass
class Survey:
    """What a JPEG lacks.

    missing  of its picture, "" for nothing
    is_few   whether that is so little that the picture is used
    ends     whether it has an end marker
    notes    what its decoder is helped with
    """

    missing: str = ""
    is_few: bool = True
    ends: bool = True
    notes: list[str] = field(default_factory=list)


@dataclass
class _Frame:
    """Size in px, sampling factors of each component, and coefficients known not to be 0."""

    width: int
    height: int
    progressive: bool
    components: dict[int, tuple[int, int]]
    nonzero: dict[int, Bits] = field(default_factory=dict)

    def blocks(self, sampling: tuple[int, int]) -> tuple[int, int]:
        """Across and down, of 8x8 samples of which the largest sampling has one for each px."""
        most = (max(factors) for factors in zip(*self.components.values(), strict=True))
        sizes = zip((self.width, self.height), sampling, most, strict=True)
        across, down = (-(-side * factor // (8 * largest)) for side, factor, largest in sizes)
        return across, down


@dataclass(frozen=True)
class _Scan:
    """Components of a scan and selectors of their tables, and what it has of their coefficients.

    band     first and last coefficient
    refines  whether it has one more bit of what earlier ones have
    is_last  whether no later one has further bits
    repeats  blocks of each component in a unit, of which there are units: across * down
    """

    parts: bytes
    selectors: bytes
    band: tuple[int, int]
    refines: bool
    is_last: bool
    repeats: list[int]
    across: int
    down: int


def with_height(file: BinaryIO) -> BinaryIO:
    """The file, or its bytes with the height that only follows its first scan (T.81, B.2.5)."""
    file.seek(2)
    while len(head := file.read(4)) == 4 and head[0] == 0xFF and head[1] != _START_OF_SCAN:
        if head[1] in _FRAMES:
            place = file.tell() + 1
            if file.read(3)[1:] != b"\0\0":
                break
            file.seek(0)
            data = file.read()
            lines = data.find(bytes((0xFF, _LINES, 0, 4)), place) + 4
            if lines < 4 or lines + 2 > len(data):
                break
            return io.BytesIO(data[:place] + data[lines : lines + 2] + data[place + 2 :])
        file.seek(int.from_bytes(head[2:], "big") - 2, io.SEEK_CUR)
    file.seek(0)
    return file


def survey(file: bytes, size: tuple[int, int], scale: int = 1) -> Survey:
    """What the first JPEG of a file lacks; an unusual one lacks nothing.

    size   width and height that its decoder takes it for, when it decodes it so many times smaller
    """
    try:
        return _survey(file, size, scale)
    except _UnusualError:
        return Survey()


def _survey(file: bytes, size: tuple[int, int], scale: int) -> Survey:
    found, frame = Survey(), None
    lacking: set[tuple[int, int]] = set()  # components and their coefficients
    interval = place = scans = segments = blocks = 0
    worst = 0.0
    tables: dict[int, _Codes] = {}
    while marker := _MARKER.search(file, place):
        kind, place = marker[1][0], marker.end()
        if kind == _END_OF_IMAGE:
            break
        segments += 1
        if segments > _MOST_SEGMENTS or kind in _OTHER_FRAMES:
            raise _UnusualError
        if kind in _WITHOUT_LENGTH:
            continue
        head = file[place + 2 : (place := place + int.from_bytes(file[place : place + 2], "big"))]
        if kind == _INTERVAL:
            interval = int.from_bytes(head[:2], "big")
        elif kind == _TABLES:
            tables |= _tables_of(head)
        elif kind == _LINES and scans == 1:
            found.notes.append("height read from the end of the JPEG's first scan")
        elif kind in _FRAMES:
            if frame is not None:
                raise _UnusualError
            frame = _frame_of(head, _FRAMES[kind])
            if size != tuple(-(-side // scale) for side in (frame.width, frame.height)):
                raise _UnusualError
            several = _COEFFICIENTS if frame.progressive else 1
            lacking = {(part, k) for part in frame.components for k in range(several)}
        elif kind == _START_OF_SCAN:
            if frame is None:
                raise _UnusualError
            scan = _scan_of(head, frame)
            scans += 1
            blocks += scan.across * scan.down * sum(scan.repeats)
            if blocks > _MOST_BLOCKS:
                raise _UnusualError
            after = _MARKER.search(file, place)
            data = file[place : len(file) if after is None else after.start()]
            place += len(data)
            if scan.is_last:
                first, last = scan.band
                lacking -= {(part, k) for part in scan.parts for k in range(first, last + 1)}
            row, share = _lack_of_scan(frame, scan, data, interval, tables)
            if share > worst:
                worst = share
                found.missing = f"its data end at row {row} of {frame.height}"
    else:
        found.ends = False
    if frame is None or not scans:
        raise _UnusualError
    area = frame.width * frame.height
    # So near the end of the picture data lack their last bytes, and not a part of it.
    found.is_few = worst * area <= max(0.005 * area, min(256, 0.05 * area))
    if lacking:
        found.missing, found.is_few = "some of its scans are missing", False
    if not found.ends:
        found.notes.append("end marker of the JPEG missing")
    if found.missing and found.is_few:
        found.notes.append(f"of the JPEG {found.missing.removeprefix('its ')}; the rest is guessed")
    return found


def _frame_of(head: bytes, progressive: bool) -> _Frame:
    number = head[5] if len(head) > 5 else 0
    sampling = {head[k]: (head[k + 1] >> 4, head[k + 1] & 15) for k in range(6, 6 + 3 * number, 3)
                if k + 2 < len(head)}  # fmt: skip
    height, width = (int.from_bytes(head[k : k + 2], "big") for k in (1, 3))
    factors = {factor for pair in sampling.values() for factor in pair}
    if (
        not width
        or not height
        or len(sampling) != number  # one that is repeated, or not there
        or not 1 <= number <= _MOST_PARTS
        or not factors <= {1, 2, 3, 4}
    ):
        raise _UnusualError
    return _Frame(width, height, progressive, sampling)


def _scan_of(head: bytes, frame: _Frame) -> _Scan:
    number = head[0] if head else 0
    parts, selectors = head[1 : 1 + 2 * number : 2], head[2 : 2 + 2 * number : 2]
    known = set(parts) & set(frame.components)
    if not number or len(head) < 4 + 2 * number or len(known) != number:
        raise _UnusualError
    if number == 1:
        across, down = frame.blocks(frame.components[parts[0]])
        repeats = [1]
    else:
        across, down = frame.blocks((1, 1))
        repeats = [a * b for a, b in (frame.components[part] for part in parts)]
    if sum(repeats) > _MOST_BLOCKS_AT_ONCE:
        raise _UnusualError
    if not frame.progressive:  # what follows has no meaning
        band = 0, _COEFFICIENTS - 1
        return _Scan(parts, selectors, band, False, True, repeats, across, down)
    first, last, precision = head[1 + 2 * number :][:3]
    # Direct coefficients alone, of any components, or others of one (T.81, G.1.1.1.1).
    if last > 0 if first == 0 else number > 1 or not first <= last < _COEFFICIENTS:
        raise _UnusualError
    refines, is_last = precision > 15, not precision & 15
    return _Scan(parts, selectors, (first, last), refines, is_last, repeats, across, down)


def _tables_of(head: bytes) -> dict[int, _Codes]:
    tables, place = {}, 0
    while place + 16 < len(head):
        symbols = place + 17
        end = symbols + sum(head[place + 1 : symbols])
        tables[head[place]] = head[place + 1 : symbols], head[symbols:end]
        place = end
    return tables


@cache
def _standard_tables() -> _DHT:
    """Huffman tables of T.81, annex K, which libjpeg uses for a file without, as of webcams."""
    stream = io.BytesIO()
    Image.new("RGB", (8, 8)).save(stream, "JPEG")
    file, tables, place = stream.getvalue(), {}, 0
    while (marker := _MARKER.search(file, place)) and marker[1][0] != _START_OF_SCAN:
        place = marker.end()
        if marker[1][0] in _WITHOUT_LENGTH:
            continue
        size = int.from_bytes(file[place : place + 2], "big")
        if marker[1][0] == _TABLES:
            tables |= _tables_of(file[place + 2 : place + size])
        place += size
    return tables


def _lack_of_scan(
    frame: _Frame, scan: _Scan, data: bytes, interval: int, tables: _DHT
) -> tuple[int, float]:
    """First row that the data of a scan lack, and the share of all of its blocks; 0 for none."""
    import numpy as np

    from gauss2svg.photo.entropy import lack, table_of  # numba, which no other format needs

    known = {**_standard_tables(), **tables}
    empty = b"", b""
    of_parts = [
        (known.get(selector >> 4, empty), known.get(16 | selector & 15, empty))
        for selector in scan.selectors
    ]
    has_direct = scan.band[0] == 0 and not scan.refines  # codes for them
    if has_direct and any(max(direct[1], default=0) > _MOST_BITS for direct, _ in of_parts):
        raise _UnusualError
    of_blocks = [
        (table_of(*direct), table_of(*others))
        for (direct, others), count in zip(of_parts, scan.repeats, strict=True)
        for _ in range(count)
    ]
    units = scan.across * scan.down
    nonzero = np.zeros(1, np.uint64)
    if scan.band[0] > 0:
        nonzero = frame.nonzero.setdefault(scan.parts[0], np.zeros(units, np.uint64))
    interval = interval or units
    parts = _RESTART.split(data, -(-units // interval))
    pieces = [part.rstrip(_FILL) for part in parts]
    unit, missing = lack(pieces, interval, units, of_blocks, scan.band, scan.refines, nonzero)
    return min(unit // scan.across * -(-frame.height // scan.down), frame.height), missing / units
