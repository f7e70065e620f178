"""Broken images and SVGs made of whole ones, and laws of whatever is read.

A mutation is a function of random numbers and bytes, so that hypothesis can draw them in
tests/whole/test_fuzz.py, and a seeded generator by the hundred thousand in tests/shared/fuzz.py.
"""

from __future__ import annotations

import io
import re
import struct
import warnings
import zlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random

import numpy as np
import PIL
from pictures import chunk
from PIL import Image, ImageCms
from svg_fuzzing import mutated_svg, svg_seeds

from gauss2svg.errors import InputError, RendererError
from gauss2svg.measure.check import sized_svg
from gauss2svg.photo.load import load_image
from gauss2svg.raster import refuse_unsupported
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.source import read_source
from gauss2svg.svg.untrusted import Survey

_LONGEST = 2000
_PILLOW = Path(PIL.__file__).parent
_DATA = Path(__file__).parents[1] / "data"
_PNG = b"\x89PNG\r\n\x1a\n"
_MOST_SVG_BYTES, _MOST_ELEMENTS = 10_000_000, 100_000
_INTERESTING = [0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF]


@cache
def picture_seeds() -> tuple[bytes, ...]:
    """Small whole pictures in every format and mode that differ in how they are decoded."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:19, :23]
    smooth = np.stack([x * 11, y * 13, (x + y) * 6], axis=2).astype(np.uint8)
    color = Image.fromarray(smooth + rng.integers(0, 4, smooth.shape, np.uint8))
    grey, alpha = color.convert("L"), color.copy()
    alpha.putalpha(grey)
    wide = Image.fromarray(np.asarray(grey).astype(np.uint16) * 257)
    real = Image.fromarray(np.asarray(grey, np.float32) / 255)
    palette, cmyk = color.quantize(16), color.convert("CMYK")
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    exif = Image.Exif()
    exif[0x0112], exif[0x011A], exif[0x011B] = 6, 300.0, 300.0
    frames = {"save_all": True, "append_images": [color.rotate(90)]}
    made = [
        (color, "JPEG", {"exif": exif, "icc_profile": profile, "dpi": (96, 96)}),
        (color, "JPEG", {"progressive": True}), (grey, "JPEG", {}), (cmyk, "JPEG", {}),
        (color, "PNG", {"icc_profile": profile, "dpi": (72, 72)}),
        (alpha, "PNG", {"exif": exif}), (palette, "PNG", {"transparency": 3, "bits": 4}),
        (wide, "PNG", {}), (grey.convert("1"), "PNG", {}), (color, "PNG", frames),
        (color, "WEBP", {"exif": exif, "icc_profile": profile}), (alpha, "WEBP", {"quality": 60}),
        (alpha, "WEBP", {"lossless": True}), (color, "WEBP", frames),
        (color, "TIFF", {"dpi": (300, 300)}), (wide, "TIFF", {}), (real, "TIFF", {}),
        (palette, "TIFF", {"compression": "packbits"}),
        (alpha, "TIFF", {"compression": "tiff_lzw"}),
        (color, "TIFF", {"compression": "jpeg"}), (color, "TIFF", {"compression": "tiff_deflate"}),
        (grey.convert("1"), "TIFF", {"compression": "group4"}), (cmyk, "TIFF", frames),
        (palette, "GIF", {}), (palette, "GIF", frames | {"transparency": 2}), (grey, "GIF", {}),
        (color, "BMP", {}), (palette, "BMP", {}), (color, "JPEG2000", {}), (alpha, "ICO", {}),
        (color, "AVIF", {"exif": exif}), (alpha, "AVIF", {}),
    ]  # fmt: skip
    seeds = []
    for picture, name, options in made:
        stream = io.BytesIO()
        picture.save(stream, name, **options)
        seeds.append(stream.getvalue())
    seeds += [path.read_bytes() for path in sorted(_DATA.glob("*.heic"))]
    return tuple(seeds)


def flipped(rng: Random, data: bytearray) -> None:
    """One bit."""
    data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def overwritten(rng: Random, data: bytearray) -> None:
    """One byte."""
    data[rng.randrange(len(data))] = rng.randrange(256)


def numbered(rng: Random, data: bytearray) -> None:
    """An integer at the edge of its type, in either byte order."""
    value, size = rng.choice(_INTERESTING), rng.choice([1, 2, 4])
    order = rng.choice(["big", "little"])
    at = rng.randrange(len(data))
    data[at : at + size] = (value & (256**size - 1)).to_bytes(size, order)


def _block(rng: Random, data: bytearray) -> slice:
    at = rng.randrange(len(data))
    return slice(at, at + min(rng.randint(1, 64), max(len(data) // 4, 1)))


def deleted(rng: Random, data: bytearray) -> None:
    """A block less."""
    del data[_block(rng, data)]


def doubled(rng: Random, data: bytearray) -> None:
    """A block twice."""
    block = _block(rng, data)
    data[block.stop : block.stop] = data[block] * rng.choice([1, 1, 2, 50])


def inserted(rng: Random, data: bytearray) -> None:
    """A block of one value more."""
    at = rng.randrange(len(data))
    data[at:at] = bytes([rng.randrange(256)]) * rng.randint(1, 32)


def cut(rng: Random, data: bytearray) -> None:
    """The end is missing."""
    del data[rng.randrange(len(data)) :]


_BYTE_MUTATIONS: tuple[Callable[[Random, bytearray], None], ...] = (
    flipped, flipped, overwritten, overwritten, numbered, numbered, deleted, doubled, inserted, cut,
)  # fmt: skip


def mutated_bytes(rng: Random, seed: bytes, other: bytes) -> bytes:
    """One to six mutations of a file; now and then with the end of another."""
    data = bytearray(seed)
    if rng.randrange(16) == 0:
        data[rng.randrange(len(data)) :] = other[rng.randrange(len(other)) :]
    for _ in range(rng.randint(1, 6)):
        if data:
            rng.choice(_BYTE_MUTATIONS)(rng, data)
    return bytes(data)


def chunks(png: bytes) -> list[tuple[bytes, bytes]]:
    """Kind and content of each chunk of a PNG, as far as they are whole."""
    found, at = [], len(_PNG)
    while at + 12 <= len(png):
        size, kind = struct.unpack(">I4s", png[at : at + 8])
        found.append((kind, png[at + 8 : at + 8 + size]))
        at += 12 + size
    return found


def png_of(parts: list[tuple[bytes, bytes]]) -> bytes:
    """A PNG of chunks, with lengths and checksums that are right."""
    return _PNG + b"".join(chunk(*part) for part in parts)


def mutated_png(rng: Random, seed: bytes, other: bytes) -> bytes:
    """A PNG whose chunks are changed, left out, doubled or another's, with right checksums.

    Half of the changes to compressed chunks are made to what is in them.
    """
    parts = chunks(seed)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(parts))
        kind, content = parts[at]
        what = rng.randrange(8)
        if what == 0 and len(parts) > 1:
            del parts[at]
        elif what == 1:
            parts.insert(rng.randrange(len(parts)), parts[at])
        elif what == 2 and (theirs := chunks(other)):
            parts.insert(at, rng.choice(theirs))
        elif what == 3:
            parts[at] = (bytes(rng.choice([kind, b"tRNS", b"gAMA", b"eXIf", b"fdAT"])), content)
        elif kind == b"IDAT" and rng.randrange(2):
            try:
                inner = zlib.decompress(content)
                parts[at] = kind, zlib.compress(mutated_bytes(rng, inner or b"\0", inner))
            except zlib.error:
                parts[at] = kind, mutated_bytes(rng, content or b"\0", content or b"\0")
        else:
            parts[at] = kind, mutated_bytes(rng, content or b"\0", content or b"\0")
    return png_of(parts)


def mutated_webp(rng: Random, seed: bytes, other: bytes) -> bytes:
    """A WebP with bytes changed whose outermost size is right again."""
    data = bytearray(mutated_bytes(rng, seed, other))
    data[:12] = b"RIFF" + struct.pack("<I", max(len(data) - 8, 0)) + b"WEBP"
    return bytes(data)


def broken_picture(rng: Random) -> bytes:
    """A picture file that something has happened to."""
    seeds = picture_seeds()
    seed, other = rng.choice(seeds), rng.choice(seeds)
    if rng.randrange(2):
        if seed.startswith(_PNG):
            return mutated_png(rng, seed, other)
        if seed.startswith(b"RIFF"):
            return mutated_webp(rng, seed, other)
    return mutated_bytes(rng, seed, other)


_MOST_PIXELS = 16_000_000


def broken_svg(rng: Random) -> bytes:
    """An SVG that something has happened to: to its bytes, or to its names and values."""
    seeds = svg_seeds()
    seed, other = rng.choice(seeds), rng.choice(seeds)
    if rng.randrange(5) == 0:
        return mutated_bytes(rng, seed, other)
    return mutated_svg(rng, seed, other)


def read_photo(data: bytes) -> None:
    """Load a photo and check it; raises InputError for anything else.

    The limit of memory is one of pixels: decoding takes about 24 bytes for each.
    """
    photo = load_image(data, max_pixels=_MOST_PIXELS)
    height, width, channels = photo.pixels.shape
    assert channels == 3
    assert height > 0 < width
    assert photo.pixels.dtype == np.float32
    assert np.isfinite(photo.pixels).all()
    assert photo.pixels.min() >= 0
    assert photo.pixels.max() <= 1
    assert photo.dpi is None or all(0 < v < np.inf for v in photo.dpi)


def check_svg(data: bytes) -> None:
    """All that `gauss2svg check` does with an SVG before another process rasterises it.

    The rasterised text has the elements of the survey. Raises InputError or RendererError.
    """
    _, text = read_source(data, _MOST_SVG_BYTES)
    surveyed, frame, sized = sized_svg(text, 40, 30, "resvg", _MOST_ELEMENTS)
    box = " ".join(f"{v!r}" for v in frame.view_box)
    again = Survey(sized, _MOST_ELEMENTS)
    assert again.tags == surveyed.tags
    assert (again.root["width"], again.root["height"], again.root["viewBox"]) == ("40", "30", box)
    refuse_unsupported(sized, "resvg")


def read_scene(data: bytes) -> None:
    """Read a scene, whose constructor checks it; raises InputError for anything else."""
    read_svg(data)


TARGETS: dict[str, tuple[Callable[[Random], bytes], Callable[[bytes], None]]] = {
    "loader": (broken_picture, read_photo),
    "svg": (broken_svg, check_svg),
    "read": (broken_svg, read_scene),
}


def outcome(target: str, data: bytes) -> tuple[str, list[str], list[str]]:
    """ "accepted" or the refusal, warnings, and those of Pillow; other errors are let through.

    A refusal must be one line with text. Pillow warns of what it ignores, which is not an error.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            TARGETS[target][1](data)
            said = "accepted"
        except (InputError, RendererError) as error:
            said = str(error)
            if type(error) is not InputError and target != "svg":
                raise
    # The command puts it on one line; what is quoted is cut where it is long.
    assert said.strip()
    assert len(said) < _LONGEST, f"{len(said)} characters: {said[:80]}"
    by_whom: tuple[list[str], list[str]] = [], []
    for w in caught:
        pillows = Path(w.filename).is_relative_to(_PILLOW)
        by_whom[pillows].append(f"{w.category.__name__}: {w.message}")
    return said, *by_whom


def message_class(said: str) -> str:
    """A message without what is particular to one input."""
    return re.sub(r"'[^']*'|\"[^\"]*\"|<[^>]*>|0x[0-9a-f]+|-?[0-9.]+(e[-+]?\d+)?", "*", said)[:90]
