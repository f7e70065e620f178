"""JPEGs made to harm their reader; as a program, reads each and prints what is said of it."""

from __future__ import annotations

import struct

END = b"\xff\xd9"
PROGRESSIVE, BASELINE = 0xC2, 0xC0
LARGE = (9000, 9000)


def _segment(marker: int, body: bytes) -> bytes:
    return bytes((0xFF, marker)) + struct.pack(">H", len(body) + 2) + body


def frame(size: tuple[int, int], *sampling: int, marker: int = PROGRESSIVE) -> bytes:
    """Components 1, 2, .. of so much sampling each, such as 0x21."""
    parts = b"".join(bytes((k, factors, 0)) for k, factors in enumerate(sampling, start=1))
    return _segment(marker, struct.pack(">BHHB", 8, size[1], size[0], len(sampling)) + parts)


def scan(parts: list[int], first: int, last: int, precision: int = 0) -> bytes:
    pairs = b"".join(bytes((part, 0)) for part in parts)
    return _segment(0xDA, bytes((len(parts),)) + pairs + bytes((first, last, precision)))


def codes(kind: int, symbol: int, length: int = 1) -> bytes:
    """One code of zeros, of so many bits."""
    counts = bytes(int(k == length) for k in range(1, 17))
    return _segment(0xC4, bytes((kind,)) + counts + bytes((symbol,)))


QUANTA = _segment(0xDB, b"\0" + bytes([1] * 64))
EACH_BLOCK = _segment(0xDD, b"\0\1")  # a restart interval
START = b"\xff\xd8" + QUANTA
CODES = EACH_BLOCK + codes(0x00, 0) + codes(0x10, 1)

# File, and the size by its last frame.
UNUSUAL = {
    "refinement of all coefficients": (
        START + frame(LARGE, 0x11) + CODES + scan([1], 0, 63, 0x10), LARGE,
    ),
    "coefficients of several components": (
        START + frame(LARGE, 0x44, 0x11, 0x11) + CODES + scan([1, 2, 3], 1, 63)
        + scan([1], 1, 63), LARGE,
    ),
    "components again and again": (
        START + frame((8, 8), 0x44, 0x44, 0x44, marker=BASELINE) + codes(0x00, 0xFF)
        + codes(0x10, 0x0F) + scan([1] * 255, 0, 63), (8, 8),
    ),
    "many components": (
        START + frame((8, 8), *[0x11] * 5, marker=BASELINE) + CODES + scan([1], 0, 63), (8, 8),
    ),
    "many blocks at once": (
        START + frame((8, 8), 0x44, 0x11, marker=BASELINE) + CODES + scan([1, 2], 0, 63), (8, 8),
    ),
    "bits of direct coefficients": (
        START + frame((8, 8), 0x11, marker=BASELINE) + codes(0x00, 0xFF) + CODES[-22:]
        + scan([1], 0, 63), (8, 8),
    ),
    "two frames": (
        START + frame((65535, 65535), 0x11) + frame((8, 8), 0x11) + CODES
        + 3 * scan([1], 1, 63), (8, 8),
    ),
    "work of many scans": (
        START + frame(LARGE, 0x11) + CODES + 100 * scan([1], 1, 63), LARGE,
    ),
    "many segments": (
        START + 1000 * EACH_BLOCK + frame((8, 8), 0x11) + CODES + scan([1], 0, 0), (8, 8),
    ),
}  # fmt: skip
# Ten blocks of the longest codes, and runs of bytes that may be the start of a marker.
LONG_CODES = (
    START + frame((8, 8), 0x42, 0x11, 0x11, marker=BASELINE) + codes(0x00, 15, 16)
    + codes(0x10, 0x0F, 16) + scan([1, 2, 3], 0, 63) + END
)  # fmt: skip
FILL_BYTES = (
    START + frame((8, 8), 0x11, marker=BASELINE) + CODES + scan([1], 0, 63)
    + (b"\xff" * 2_000_000 + b"\0") * 2 + END
)  # fmt: skip


def _main() -> None:
    from gauss2svg.photo.jpeg import Survey, survey

    from gauss2svg.errors import InputError
    from gauss2svg.photo.load import load_image

    for name, (file, size) in UNUSUAL.items():
        print(name, survey(file + END, size) == Survey(), flush=True)
        try:
            # With most of the work libjpeg would be long as well.
            print("many scans" in name or load_image(file + END).pixels.shape, flush=True)
        except InputError:
            print("refused", flush=True)
    print(survey(LONG_CODES, (8, 8)).missing, flush=True)
    print(survey(FILL_BYTES, (8, 8)).missing, flush=True)


if __name__ == "__main__":
    _main()
