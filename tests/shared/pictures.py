"""Picture files that no library writes, made by hand; drawings; names of files."""

from __future__ import annotations

import io
import os
import re
import struct
import zlib
from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.photo.load import load_image
from gauss2svg.photo.pixels import shrunk

# First column, first row, step across and step down of each pass (PNG, third edition, 8.1).
_ADAM7 = (
    (0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2),
    (0, 1, 1, 2),
)  # fmt: skip
_COLOR_TYPES = {1: 0, 2: 4, 3: 2, 4: 6}  # by channels
DATA = Path(__file__).parents[1] / "data"
CONVERTED = "converted from its embedded ICC profile to sRGB"
BROKEN = "must be a complete image of a supported kind; got one that is broken, truncated or"


def encoded(picture: Image.Image, name: str, **options) -> bytes:
    """The file that Pillow makes of it."""
    stream = io.BytesIO()
    picture.save(stream, name, **options)
    return stream.getvalue()


def tiff(array: NDArray, **options) -> bytes:
    """The file that tifffile makes of it."""
    stream = io.BytesIO()
    tifffile.imwrite(stream, array, **options)
    return stream.getvalue()


def chunk(kind: bytes, data: bytes) -> bytes:
    """One chunk of a PNG, with its length and checksum."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(
    samples: NDArray,
    *chunks: bytes,
    bits: int = 8,
    interlaced: bool = False,
    size: tuple[int, int] | None = None,
) -> bytes:
    """A PNG of (h, w, 1..4) samples of so many bits, with more chunks before its pixels.

    size  width and height that it claims to have, None: those of the samples
    """
    width, height = size or samples.shape[1::-1]
    passes = _ADAM7 if interlaced else ((0, 0, 1, 1),)
    rows = b""
    for x, y, across, down in passes:
        part = samples[y::down, x::across]
        if part.size:
            rows += b"".join(b"\0" + _packed(row, bits) for row in part)
    color_type = _COLOR_TYPES[samples.shape[2]]
    head = struct.pack(">IIBBBBB", width, height, bits, color_type, 0, 0, int(interlaced))
    parts = [chunk(b"IHDR", head), *chunks, chunk(b"IDAT", zlib.compress(rows))]
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts) + chunk(b"IEND", b"")


def _packed(row: NDArray, bits: int) -> bytes:
    """A row (w, channels), highest bits first, filled up to whole bytes."""
    if bits == 16:
        return row.astype(">u2").tobytes()
    digits = np.unpackbits(row.astype(np.uint8).reshape(-1, 1), axis=1)[:, 8 - bits :]
    return np.packbits(digits.reshape(-1)).tobytes()


def srgb_curve(light: NDArray) -> NDArray:
    """Values of linear light by IEC 61966-2-1, written once more for the tests."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)


def assert_read(source, pixels, notes=(), atol=1e-7, alpha=None):
    """Load a photo, compare its pixels, notes and alpha, and return it."""
    photo = load_image(source)
    color = photo.pixels[:, :, :3]
    np.testing.assert_allclose(color, np.broadcast_to(pixels, color.shape), atol=atol)
    assert photo.notes == notes
    assert photo.pixels.shape[2] == (3 if alpha is None else 4)
    if alpha is not None:
        np.testing.assert_allclose(photo.pixels[:, :, 3], alpha, atol=atol)
    return photo


def antialiased_badge(side: int) -> NDArray[np.float32]:
    """A disc, a bar and a ring of flat colours at `side` px, antialiased."""
    y, x = (np.mgrid[: side * 4, : side * 4] + 0.5) * (16 / side)
    picture = np.full((*x.shape, 3), 0.95, np.float32)
    picture[np.hypot(x - 24, y - 26) < 17] = 0.1, 0.3, 0.7
    picture[(np.abs(x - y - 20) < 4) & (x + y < 100)] = 0.9, 0.2, 0.1
    picture[np.abs(np.hypot(x - 44, y - 44) - 11) < 3] = 0.1, 0.6, 0.3
    return shrunk(picture, side, side)


def smile(side: int) -> NDArray[np.float32]:
    """A face of flat colours at `side` px, antialiased."""
    y, x = np.mgrid[: side * 4, : side * 4] * (32 / side)
    r = np.hypot(x - 64, y - 64)
    picture = np.ones((*r.shape, 3), np.float32)
    picture[r < 54] = 0.2, 0.15, 0.05
    picture[r < 50] = 1.0, 0.8, 0.2
    for eye in (45, 83):
        picture[np.hypot(x - eye, 0.7 * (y - 50)) < 6] = 0.2, 0.15, 0.05
    mouth = (np.abs(np.hypot(x - 64, y - 66) - 30) < 3) & (y > 74)
    picture[mouth] = 0.7, 0.1, 0.1
    return shrunk(picture, side, side)


def ball(side: int, clear: bool = False) -> NDArray[np.float32]:
    """A ball in two lights at `side` px, antialiased. No gradient has its shading.

    It casts a soft shadow on a plain page. If `clear`, it has alpha, and there is no page.
    """
    y, x = (np.mgrid[: side * 4, : side * 4] + 0.5) / (4 * side)
    across, down = (x - 0.45) / 0.24, (y - 0.42) / 0.24
    inside = across**2 + down**2 < 1
    up = np.sqrt(np.clip(1 - across**2 - down**2, 0, 1))
    warm = np.clip(0.62 * up - 0.5 * across - 0.6 * down, 0, 1)[:, :, None]
    cold = np.clip(0.3 * up + 0.9 * across + 0.3 * down, 0, 1)[:, :, None] ** 2
    shaded = np.array([0.2, 0.05, 0.1]) + [0.65, 0.15, 0.1] * warm + [0.0, 0.3, 0.5] * cold
    if clear:
        return shrunk(np.dstack([shaded, inside]).astype(np.float32), side, side)
    shadow = 0.55 * np.exp(-(((x - 0.52) / 0.26) ** 2) - ((y - 0.72) / 0.09) ** 2)
    page = np.array([0.95, 0.93, 0.88]) * (1 - shadow[:, :, None])
    picture = np.where(inside[:, :, None], shaded, page)
    return shrunk(picture.astype(np.float32), side, side)


def clouds(side: int) -> NDArray[np.float32]:
    """Soft spots of many colours on a plain page at `side` px. The upper right corner is plain."""
    rng = np.random.default_rng(5)
    y, x = (np.mgrid[:side, :side] + 0.5) / side
    picture = np.tile(np.array([0.95, 0.93, 0.88], np.float32), (side, side, 1))
    for _ in range(14):
        (cx, cy), (rx, ry) = rng.uniform([0.1, 0.35], [0.75, 0.9]), rng.uniform(0.05, 0.11, 2)
        share = 0.8 * np.exp(-0.5 * (((x - cx) / rx) ** 2 + ((y - cy) / ry) ** 2))[:, :, None]
        picture += (share * (rng.random(3) - picture)).astype(np.float32)
    return picture


def possible(name: str) -> str:
    """A name, on Windows without the characters that no file may have in its name there."""
    return re.sub(r'[<>:"|?*\n]', "", name) if os.name == "nt" else name
