"""How far the data of a JPEG's scan reach, by their Huffman codes, sequential or progressive.

Codes are only counted (ITU-T T.81, F.2.2 and G.2), which takes a fraction of decoding them.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gauss2svg.kernel_cache import cached

_LENGTHS = 16
_NO_CODE = (_LENGTHS + 1) << 8  # libjpeg takes the bits of a code that is none for a zero
# Bytes after the data. A block that begins within them is read, of at most 64 codes with 15 bits
# more for each, and 63 bits of corrections.
_PADDING = 512

Bits = NDArray[np.uint64]  # of a block and its coefficients


@lru_cache(64)
def table_of(counts: bytes, symbols: bytes) -> NDArray[np.uint16]:
    """The Huffman table of a number of codes by length 1..16, and their symbols (T.81, annex C).

    By the next 16 bits: length of the code * 256 + symbol.
    """
    table = np.full(1 << _LENGTHS, _NO_CODE, np.uint16)
    code, place = 0, 0
    for length, count in enumerate(counts, start=1):
        step = 1 << (_LENGTHS - length)
        for symbol in symbols[place : place + count]:
            table[code : code + step] = length << 8 | symbol
            code += step
        place += count
    return table


def lack(
    parts: Sequence[bytes],
    interval: int,
    units: int,
    tables: Sequence[tuple[NDArray[np.uint16], NDArray[np.uint16]]],
    band: tuple[int, int],
    refines: bool,
    nonzero: Bits,
) -> tuple[int, int]:
    """Units (blocks, or groups of interleaved ones) without all of their codes: first, and number.

    parts     data between restarts; interval: units of each
    tables    for direct and other coefficients, of each block of a unit
    band      first and last coefficient
    refines   whether the scan has one more bit of what earlier ones have
    nonzero   bits by block and coefficient: those of earlier scans that are not 0, which grow;
              not used for direct coefficients, nor for all in one scan
    """
    # The kernel does not check its indices.
    if band[1] > 0 and (band[0] > 0 or refines) and len(nonzero) != units:
        raise ValueError(
            f"length of nonzero must be that of its units, {units}; got {len(nonzero)}"
        )
    plain = [part.replace(b"\xff\0", b"\xff") for part in parts[: -(-units // interval)]]
    ends = np.cumsum([0, *map(len, plain)])
    data = np.frombuffer(b"".join((*plain, bytes(_PADDING))), np.uint8)
    several = list({id(table): table for pair in tables for table in pair}.values())
    places = {id(table): k for k, table in enumerate(several)}
    kinds = np.array([[places[id(table)] for table in pair] for pair in tables])
    return _lack(data, ends, interval, units, np.stack(several), kinds, band, refines, nonzero)


@cached(nogil=True)
def _lack(data, ends, interval, units, tables, kinds, band, refines, nonzero):
    first, last = band
    one = np.uint64(1)
    lacking, missing = units, 0
    for part in range(len(ends) - 1):
        begin = part * interval
        left = min(interval, units - begin)
        position, end = 8 * ends[part], 8 * ends[part + 1]
        run = 0  # of blocks without further coefficients
        for unit in range(left):
            block = begin + unit
            for k in range(len(kinds)):
                if position > end:
                    break
                at = first
                if at == 0:
                    at = 1
                    if refines:
                        position += 1
                    else:
                        found = int(tables[kinds[k, 0], _next_16(data, position)])
                        position += (found >> 8) + (found & 255)
                while at <= last and run == 0:
                    found = int(tables[kinds[k, 1], _next_16(data, position)])
                    position += found >> 8
                    zeros, bits = (found >> 4) & 15, found & 15
                    if bits == 0 and zeros < 15:
                        run = 1
                        if zeros > 0 and first > 0:
                            run = (1 << zeros) + (_next_16(data, position) >> (16 - zeros))
                            position += zeros
                        break
                    if refines:
                        position += min(bits, 1)  # its sign
                        while at <= last:
                            if nonzero[block] >> np.uint64(at) & one:
                                position += 1
                            elif zeros == 0:
                                break
                            else:
                                zeros -= 1
                            at += 1
                    else:
                        position += bits
                        at += zeros
                    if bits > 0 and first > 0 and at <= last:
                        nonzero[block] |= one << np.uint64(at)
                    at += 1
                if run > 0:
                    while refines and first > 0 and at <= last:
                        if nonzero[block] >> np.uint64(at) & one:
                            position += 1
                        at += 1
                    run -= 1
            if position > end:
                lacking = min(lacking, block)
                missing += left - unit
                break
    rest = max(0, units - (len(ends) - 1) * interval)
    return min(lacking, units - rest), missing + rest


@njit(inline="always")
def _next_16(data, position):
    k = position >> 3
    three = (int(data[k]) << 16) | (int(data[k + 1]) << 8) | int(data[k + 2])
    return (three >> (8 - (position & 7))) & 0xFFFF
