"""Broken photos and SVGs, made of whole ones, and what must hold of whatever is read."""

from __future__ import annotations

import gzip
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
from conftest import random_scene, random_sum
from pictures import chunk, encoded
from PIL import Image, ImageCms
from svg_texts import AS_PATH, CIRCLE, document

from gauss2svg.errors import InputError, RendererError
from gauss2svg.measure.check import sized_svg
from gauss2svg.photo.load import load_image
from gauss2svg.raster import refuse_unsupported
from gauss2svg.svg import Document, SvgFormat
from gauss2svg.svg.file import read_source
from gauss2svg.svg.minimal import minimal_svg
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.untrusted import Survey
from gauss2svg.svg.write import outline_svg, write_svg

_PILLOW = Path(PIL.__file__).parent
_DATA = Path(__file__).parents[1] / "data"
_PNG = b"\x89PNG\r\n\x1a\n"
_MOST_PIXELS, _MOST_SVG_BYTES, _MOST_ELEMENTS = 16_000_000, 10_000_000, 100_000
_EDGES = [0, 1, 0x7F, 0x80, 0xFF, 0x7FFF, 0x8000, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF]
_DOT = (
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgAB"
    "SK+kcQAAAABJRU5ErkJggg=="
)
EXTREMES = (
    "", "0", "-1", "1e309", "-1e308", "1e-320", "nan", "-inf", "1e", "--1", ".", "1..2", "9" * 400,
    "0x10", "\u0661", "1e99999999999", "%", "-5%", "1mm", "1q", "1em", "none", "inherit", "1 2 3",
    "9" * 5000, "#ff0000ff", "rgb(1e99,0,0)", "hsl(1e400,2%,3%)", "url(#a)", "url(#", "url( '#a' )",
    "url(x.svg)", "u\\72l(x)", "\\0000000", "matrix(1e200 0 0 1e200 0 0) scale(1e200)",
    "rotate(1e308)", "skewX(90)", "scale(0)", "translate()", "matrix(" + "1 " * 3000 + ")",
    "(" * 3000, "rotate(" * 2000, "display:none", "fill:red;" * 2000, "/*" * 2000,
    "animation:a 1s infinite", "filter:url(#a)", "mix-blend-mode:plus-lighter",
    "M1 0A1 1 0 0 1 0 1Z", "M" + "1 " * 3000, "A" * 3000, "0 0 1e308 1e308", "0 0 1e-320 1e-320",
    "0 0 0 0", "0 0 -1 1", "nan nan nan nan", "xMidYMid slice", "none none", "#a", "#", " ",
    "\u00e9\u4e2d\U0001f600", "&amp;", "&#0;", "&#xD800;", "&x;", ";" * 3000, "1e" * 3000, _DOT,
    "data:,", "data:image/png;base64,AAAA", "data:image/png;base64," + "A" * 9999,
    "file:///etc/passwd", "//host/x", "javascript:1", "DATA:;", "data:%",
    "data:image/gif;base64,R0lGODlh////fwAAACw=",
)  # fmt: skip
_NAMES = (
    "transform", "style", "filter", "href", "xlink:href", "fill", "fill-opacity", "opacity", "r",
    "cx", "rx", "d", "viewBox", "width", "preserveAspectRatio", "id", "mask", "gradientTransform",
    "gradientUnits", "fx", "offset", "stop-color", "stop-opacity", "stdDeviation", "x",
    "data-canvas", "display", "inkscape:label", "class", "inkscape:groupmode", "xmlns", "xmlns:a",
    "xml:base", "onload", "spreadMethod", "sodipodi:absref", "a:b", "", "1",
)  # fmt: skip
_ELEMENTS = (
    "<g>", "</g>", "<script>1</script>", "<style>g{fill:red}</style>", "<use href='#a'/>",
    "<image href='x.png'/>", f"<image href='{_DOT}'/>", "<a href='http://a'>", "</svg>", "<svg>",
    "<foreignObject/>", "<text>a</text>", "<animate/>", "<style>", "<style>@import 'x';</style>",
    "<style>@keyframes a{b{c:d}}</style>", "<style>" + "a{" * 3000 + "</style>",
    "<style>/*" + "*" * 9999 + "</style>", "<style>" + "@media a{" * 999 + "</style>", "<!--",
    "-->", "<![CDATA[ a ]]>", "<![CDATA[", "]]>", "<?a b?>", "<?xml?>", "<?",
    "<?xml-stylesheet href='x'?>", "<!DOCTYPE svg>", "<!DOCTYPE svg [", "<!ENTITY a 'b'>", "]>",
    "<!DOCTYPE svg [<!ENTITY a 'b'>]>", "<!DOCTYPE svg SYSTEM 'x'>", "&a;", "&#1;", "&", "<",
    "<radialGradient id='a' href='#a'/>", "<circle r='1' fill='url(#a)'/>", "<filter id='a'/>",
    "<rect width='100%' height='100%' fill='red'/>", f"<path {AS_PATH} fill='red'/>", "\0",
    "\ufeff", "<g id='round-999999999'>", "<x:y/>", "<" + "a" * 9999 + "/>",
    "<g " + "a='b' " * 3 + "/>", "<g " + " ".join(f"a{i}='b'" for i in range(3000)) + "/>",
)  # fmt: skip
_VALUE_OR_NUMBER = re.compile(r"(?<==)\"[^\"]*\"|(?<==)'[^']*'|[-+]?\d*\.?\d+(?:e[-+]?\d+)?")
_TAG = re.compile(r"<[^>]*>")


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
    tiff = {"compression": "tiff_lzw"}
    made = [
        (color, "JPEG", {"exif": exif, "icc_profile": profile, "dpi": (96, 96)}),
        (color, "JPEG", {"progressive": True}), (grey, "JPEG", {}), (cmyk, "JPEG", {}),
        (color, "PNG", frames | {"icc_profile": profile}), (alpha, "PNG", {"exif": exif}),
        (palette, "PNG", {"transparency": 3, "bits": 4}), (wide, "PNG", {}),
        (color, "WEBP", {"exif": exif, "icc_profile": profile}),
        (alpha, "WEBP", {"lossless": True}), (color, "WEBP", frames), (wide, "TIFF", {}),
        (real, "TIFF", {}), (palette, "TIFF", {"compression": "packbits"}), (alpha, "TIFF", tiff),
        (color, "TIFF", {"compression": "jpeg"}), (color, "TIFF", {"compression": "tiff_deflate"}),
        (grey.convert("1"), "TIFF", {"compression": "group4"}), (cmyk, "TIFF", frames),
        (palette, "GIF", frames | {"transparency": 2}), (color, "BMP", {}), (palette, "BMP", {}),
        (color, "JPEG2000", {}), (alpha, "ICO", {}), (alpha, "AVIF", {"exif": exif}),
    ]  # fmt: skip
    seeds = [encoded(picture, name, **options) for picture, name, options in made]
    return *seeds, *(path.read_bytes() for path in sorted(_DATA.glob("*.heic")))


@cache
def svg_seeds() -> tuple[bytes, ...]:
    """SVGs of every form that we write, after an editor, and others that are let through."""
    scene = random_scene(6, 40, 30, 5, sigma=(2.0, 9.0))
    texts = [
        write_svg(scene),
        write_svg(
            scene, SvgFormat(form="blur", stops=6), Document(title="a & b", alt="<c>", size="120mm")
        ),
        write_svg(scene, document=Document(aspect="xMidYMid slice")),
        write_svg(scene, document=Document(animate=2.0)),
        write_svg(random_sum(5, 40, 30, 3)),
        outline_svg(scene),
        document(),
        document(f'<g opacity=".5" transform="rotate(9)">{CIRCLE}</g><path {AS_PATH} fill="red"/>'),
        "<!DOCTYPE svg PUBLIC '-//W3C//DTD SVG 1.1//EN' 'a'>\n<!-- b -->"
        "<svg xmlns='http://www.w3.org/2000/svg' xmlns:xlink='http://www.w3.org/1999/xlink' "
        "style='width:40px;height:30px' viewBox='0 0 40 30'><style>/* a */ .b { fill: url(#c); "
        "mix-blend-mode: screen }</style><g class='b' transform='translate(1,2) skewX(3)'>"
        f"<image width='9' height='9' xlink:href='{_DOT}'/><use href='#c'/></g></svg>",
        minimal_svg(scene, 0.5, 3, masked=True),
        minimal_svg(scene, 0.5, 6, masked=False),
    ]
    files = [text.encode() for text in texts]
    files += [path.read_bytes() for path in sorted(_DATA.glob("*_by_inkscape.svg"))]
    return (*files, gzip.compress(files[0]), texts[6].encode("utf-16"))


def mutated_bytes(rng: Random, seed: bytes, other: bytes) -> bytes:
    """Return a file after one to six mutations, now and then with the end of another."""
    data = bytearray(seed)
    if rng.randrange(16) == 0:
        data[rng.randrange(len(data)) :] = other[rng.randrange(len(other)) :]
    for _ in range(rng.randint(1, 6)):
        if not data:
            break
        at, size = rng.randrange(len(data)), rng.choice([1, 2, 4])
        block = slice(at, at + min(rng.randint(1, 64), max(len(data) // 4, 1)))
        edge = (rng.choice(_EDGES) & (256**size - 1)).to_bytes(size, rng.choice(["big", "little"]))
        place, new = rng.choice(
            [
                *[(slice(at, at + 1), bytes([data[at] ^ 1 << rng.randrange(8)]))] * 2,
                *[(slice(at, at + 1), rng.randbytes(1)), (slice(at, at + size), edge)] * 2,
                (block, b""),
                (block, data[block] * rng.choice([2, 2, 3, 51])),
                (slice(at, at), rng.randbytes(1) * rng.randint(1, 32)),
                (slice(at, None), b""),
            ]
        )
        data[place] = new
    return bytes(data)


def mutated_png(rng: Random, seed: bytes) -> bytes:
    """Return a PNG with chunks changed, left out, doubled or renamed, whose checksums are right.

    In half of them what the compressed pixels unpack to is changed too.
    """
    parts, at, inside = [], len(_PNG), rng.randrange(2)
    while at < len(seed):
        size, kind = struct.unpack(">I4s", seed[at : at + 8])
        content = seed[at + 8 : at + 8 + size]
        if inside and kind == b"IDAT":
            rows = zlib.decompress(content)
            content = zlib.compress(mutated_bytes(rng, rows, rows))
        parts.append((kind, content))
        at += 12 + size
    for _ in range(rng.randint(1 - inside, 3)):
        at = rng.randrange(len(parts))
        kind, content = parts[at]
        changed = kind, mutated_bytes(rng, content or b"\0", content or b"\0")
        renamed = rng.choice([b"tRNS", b"gAMA", b"eXIf", b"fdAT"]), content
        parts[at : at + 1] = rng.choice([[], [parts[at]] * 2, [renamed], *[[changed]] * 4])
        parts = parts or [changed]
    return _PNG + b"".join(chunk(*part) for part in parts)


def broken_picture(rng: Random) -> bytes:
    """Return a picture file that something has happened to."""
    seed, other = rng.choices(picture_seeds(), k=2)
    if seed.startswith(_PNG) and rng.randrange(2):
        return mutated_png(rng, seed)
    data = mutated_bytes(rng, seed, other)
    if seed.startswith(b"RIFF") and rng.randrange(2):  # the outermost size of a WebP is right again
        return b"RIFF" + struct.pack("<I", max(len(data) - 8, 0)) + b"WEBP" + data[12:]
    return data


def _mutated_text(rng: Random, text: str) -> str:
    """Return the text of an SVG after one mutation of its tags, names or values."""
    values, tags = list(_VALUE_OR_NUMBER.finditer(text)), list(_TAG.finditer(text))
    if not values or not tags:
        return text
    value, tag, other = rng.choice(values), rng.choice(tags), rng.choice(tags)
    extreme = rng.choice(EXTREMES)
    if rng.randrange(100) == 0:
        extreme = rng.choice(["a", "1 ", "\\", "url(#a) "]) * rng.choice([1000, 300_000])
    quote = rng.choice("\"'") if value[0][0] in "\"'" else ""
    name_end = tag.end() - 1 - tag[0].endswith("/>")
    group, depth = rng.choice(_GROUPS), rng.choice([2, 99, 101, 300, 3000, 20_000])
    last = max(text.rfind("</"), tag.end())
    nested = f"<{group}>" * depth + text[tag.end() : last] + f"</{group}>" * depth
    start, end, new = rng.choice(
        [
            *[(*value.span(), quote + extreme + quote)] * 5,
            *[(name_end, name_end, f" {rng.choice(_NAMES)}='{extreme}'")] * 2,
            *[(tag.end(), tag.end(), rng.choice(_ELEMENTS))] * 2,
            (*tag.span(), other[0]),
            (*tag.span(), ""),
            (*tag.span(), tag[0] * rng.choice([2, 50, 2000])),
            (tag.end(), last, nested),
        ]
    )
    return text[:start] + new + text[end:]


_GROUPS = ("g", "svg", "a", "defs", "style", "title")


def _text(seed: bytes) -> str:
    if seed.startswith(b"\x1f\x8b"):
        seed = gzip.decompress(seed)
    return seed.decode("utf-16" if seed.startswith(b"\xff\xfe") else "utf-8")


def broken_svg(rng: Random) -> bytes:
    """Return an SVG that something has happened to: to its bytes, or to its text."""
    seed, other = rng.choices(svg_seeds(), k=2)
    if rng.randrange(5) == 0:
        return mutated_bytes(rng, seed, other)
    text, theirs = _text(seed), _text(other)
    if rng.randrange(20) == 0:
        text = text[: rng.randrange(len(text))] + theirs[rng.randrange(len(theirs)) :]
    for _ in range(rng.choice([1, 1, 1, 2, 3, 4])):
        text = _mutated_text(rng, text)
    encoding = rng.choice(["utf-8"] * 12 + ["utf-16", "utf-8-sig", "utf-16-be"])
    data = text.encode(encoding, "surrogatepass")
    return gzip.compress(data, 1) if rng.randrange(30) == 0 else data


def read_photo(data: bytes) -> None:
    """Load a photo and check it. Raise InputError for what is none."""
    photo = load_image(data, max_pixels=_MOST_PIXELS)
    height, width, channels = photo.pixels.shape
    assert (channels, photo.pixels.dtype) == (3, np.float32)
    assert height > 0 < width
    assert np.isfinite(photo.pixels).all()
    assert 0 <= photo.pixels.min() <= photo.pixels.max() <= 1
    assert photo.dpi is None or all(0 < v < np.inf for v in photo.dpi)


def check_svg(data: bytes) -> None:
    """Do all that `gauss2svg check` does with an SVG before another process rasterises it.

    The rasterised text has the elements of the survey. Raise InputError or RendererError.
    """
    _, text = read_source(data, _MOST_SVG_BYTES)
    surveyed, frame, sized = sized_svg(text, 40, 30, "resvg", _MOST_ELEMENTS)
    box = " ".join(f"{v!r}" for v in frame.view_box)
    again = Survey(sized, _MOST_ELEMENTS)
    assert again.tags == surveyed.tags
    assert (again.root["width"], again.root["height"], again.root["viewBox"]) == ("40", "30", box)
    refuse_unsupported(sized, "resvg")


READERS: dict[str, Callable[[bytes], object]] = {
    "photo": read_photo, "svg": check_svg, "scene": read_svg,
}  # fmt: skip


def outcome(reader: str, data: bytes) -> str:
    """Return "accepted" or the refusal, which is not long. Let other errors through.

    Pillow alone may warn, of what it ignores.
    """
    refusals = (InputError, RendererError) if reader == "svg" else InputError
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            READERS[reader](data)
            said = "accepted"
        except refusals as error:
            said = str(error)
    assert 0 < len(said.strip()) < 2000, said[:80]
    assert not [str(w) for w in caught if not Path(w.filename).is_relative_to(_PILLOW)]
    return said
