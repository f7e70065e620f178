"""Broken photos, broken SVGs and odd options give a result or one refusal, and nothing else.

GAUSS2SVG_EXAMPLES=10000 tries a thousand times as many.
"""

import gzip
import itertools
import json
import math
import re
import warnings
from functools import cache
from pathlib import Path
from random import Random

import numpy as np
import PIL
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pictures import DATA, chunk, encoded
from PIL import Image, ImageCms
from scenes import minimal_by_gradients, random_scene, random_sum

from gauss2svg.errors import Gauss2SvgError, InputError, RendererError
from gauss2svg.measure.check import sized_svg
from gauss2svg.options import fields_of
from gauss2svg.photo.load import load_image
from gauss2svg.pipeline.options import GROUPS, Options
from gauss2svg.pipeline.vectorize import vectorize_by
from gauss2svg.raster import refuse_unsupported
from gauss2svg.svg import Document, SvgFormat
from gauss2svg.svg.encode import outline_svg
from gauss2svg.svg.file import read_source
from gauss2svg.svg.minimal import minimal_svg
from gauss2svg.svg.read import read_svg
from gauss2svg.svg.write import write_svg

PIXELS = np.random.default_rng(0).integers(0, 256, (16, 16, 3), np.uint8)
EXAMPLES = settings().max_examples
MANY = settings(max_examples=25 * EXAMPLES, suppress_health_check=list(HealthCheck))
FORMATS = [
    ("JPEG", "RGB", {"dpi": (96, 96)}), ("JPEG", "L", {"progressive": True}), ("PNG", "RGBA", {}),
    ("PNG", "P", {"transparency": 3, "bits": 4}), ("WEBP", "RGBA", {}), ("AVIF", "RGBA", {}),
    ("TIFF", "RGB", {"compression": "tiff_lzw"}), ("TIFF", "1", {"compression": "group4"}),
    ("GIF", "P", {"transparency": 2}), ("BMP", "P", {}),
]  # fmt: skip


@cache
def photos() -> list[bytes]:
    """Small whole pictures that differ in how they are decoded."""
    y, x = np.mgrid[:19, :23]
    color = Image.fromarray(np.stack([x * 11, y * 13, (x + y) * 6], axis=2).astype(np.uint8))
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    made = [
        encoded(
            color.convert(mode), name, icc_profile=profile if "RGB" in mode else None, **options
        )
        for name, mode, options in FORMATS
    ]
    return made + [path.read_bytes() for path in sorted(DATA.glob("*.heic"))]


@cache
def svgs() -> list[bytes]:
    """SVGs of every form that we write, and what editors make of them."""
    scene = random_scene(6, 40, 30, 5, sigma=(2.0, 9.0))
    texts = [
        write_svg(scene, document=Document(aspect="xMidYMid slice", animate=2.0)),
        write_svg(scene, SvgFormat(form="blur", stops=6), Document(title="a & b", size="120mm")),
        write_svg(random_sum(5, 40, 30, 3)), outline_svg(scene),
        minimal_svg(scene, 0.5, 3), minimal_by_gradients(scene, 0.5, 6),
    ]  # fmt: skip
    edited = [path.read_bytes() for path in sorted(DATA.glob("*_by_inkscape.svg"))]
    return [*(text.encode() for text in texts), *edited, gzip.compress(texts[0].encode())]


# What readers of photos and of SVGs may choke on, in place of a part of a file or between two.
HOSTILE = (
    b"\xff" * 4, b"\0" * 64, b"1e309", b"-1", b"nan", b"9" * 5000, b"1 " * 3000, b"(" * 3000,
    b"&#0;", b"&x;", b"\xf0\x9f\x98\x80", b"none", b"url(#a)", b"url(x.svg)", b"u\\72l(x)", b"<!--",
    b"matrix(1e200 0 0 1e200 0 0) scale(1e200)", b"rotate(" * 2000, b"fill:red;" * 2000, b"data:,",
    b"0 0 1e308 1e308", b"0 0 0 0", b"</g>", b"<script>1</script>", b"<style>@import 'x';</style>",
    b"<style>" + b"a{" * 3000 + b"</style>", b"<use href='#a'/>", b"<image href='x.png'/>", b"/*",
    b"<![CDATA[", b"<!DOCTYPE svg [<!ENTITY a 'b'>]>", b"<g>" * 3000, b"<svg>" * 101, b"<animate/>",
    b"<radialGradient id='a' href='#a'/>", b"<g id='round-999999999'>", b"<g a='' a=''/>",
)  # fmt: skip
# A number, the value of an attribute, or a tag; in the files of photos these are some bytes.
PART = re.compile(rb'[-+]?\d*\.?\d+|(?<==")[^"]*|<[^>]*>')


def broken(rng: Random, files: list[bytes]) -> bytes:
    """One of these files after one to four changes; a PNG has right checksums, so it is read on."""
    data = rng.choice(files)
    is_packed = data.startswith(b"\x1f\x8b") and rng.randrange(2)
    data = gzip.decompress(data) if is_packed else data
    for _ in range(rng.choice([1, 1, 2, 4])):
        at = rng.randrange(len(data) + 1)
        found = PART.search(data, at) if rng.randrange(4) else None
        start, end = found.span() if found else (at, at + rng.choice([0, 1, 4, 64]))
        repeated = (data[start:end] * rng.choice([2, 50, 2000]))[:100_000]
        new = rng.choice([rng.choice(HOSTILE), rng.randbytes(end - start), repeated, b""])
        data = data[:start] + new + data[end if rng.randrange(9) else len(data) :]
    data = with_checksums(data) if data.startswith(b"\x89PNG") else data
    return gzip.compress(data, 1) if is_packed else data


def with_checksums(data: bytes) -> bytes:
    """The chunks of a PNG, whose lengths are believed, with the checksums of what they have."""
    parts, at = [data[:8]], 8
    while at + 8 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4])
        parts.append(chunk(data[at + 4 : at + 8], data[at + 8 : end]))
        at = end + 4
    return b"".join(parts)


def read_photo(data: bytes) -> None:
    """Load a photo and check it."""
    pixels = load_image(data, max_pixels=16_000_000).pixels
    assert pixels.shape[2] in (3, 4)
    assert pixels.dtype == np.float32
    assert (pixels >= 0).all() & (pixels <= 1).all()


def check_svg(data: bytes) -> None:
    """Do all that `gauss2svg check` does with an SVG before another process rasterises it."""
    sized = sized_svg(read_source(data, 10_000_000)[1], 40, 30, "resvg", 100_000)[2]
    refuse_unsupported(sized, "resvg")


def outcome(read, data: bytes) -> str:
    """Whether a file is "accepted", or the refusal. Pillow alone may warn, of what it ignores."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            read(data)
            said = "accepted"
        except (InputError, RendererError) as error:
            said = str(error)
    assert said.strip()
    assert len(said) < 2000
    pillow = Path(PIL.__file__).parent
    assert not [str(w) for w in caught if not Path(w.filename).is_relative_to(pillow)]
    return said


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("read", "files"),
    [(read_photo, photos), (check_svg, svgs), (read_svg, svgs)],
    ids=["photo", "check", "scene"],
)
@MANY
@given(rng=st.integers(0, 2**32 - 1).map(Random), rubbish=st.binary(max_size=200))
def test_broken_files_are_accepted_or_refused_and_rubbish_is_refused(read, files, rng, rubbish):
    outcome(read, broken(rng, files()))
    assert outcome(read, rubbish) != "accepted"


def odd_values() -> list:
    """Values that most options refuse, and some that they take."""
    return [
        None, True, False, 0, 1, -1, 5, 2**31, 2**64, 10**400, 0.0, 0.5, 1e-320, 1e308, math.inf,
        math.nan, 1j, "", " 5", "5", "0.5", "1_0", "\u0663", "auto", "nan", "a\nb", "\0", "\ud800",
        "9" * 5000, "--gzip", "<svg/>", "new/fit", ".", "/dev/null", "photo.png", b"5", b"\xff",
        [], [5], (5,), {"a": 1}, {5}, iter([5]), object(), type, len, Path("fit"),
        np.int8(5), np.float16(0.5), np.float32("nan"), np.bool_(True), np.str_("over"),
        np.array(5), np.array([0.5]), np.zeros((16, 16), np.uint8), np.array(None),
        np.datetime64("2020"), np.ma.masked, "white", "#ffaa00", "120mm", "1e9mm", "300M", "1.5 kB",
        "xMidYMid slice",
    ]  # fmt: skip


def options_of(rng: Random) -> dict:
    """Options of a quick run and up to four others, often at the ends of their ranges."""
    given = {"quality": "draft", "gaussians": 4, "iterations": 3, "max_memory": "400M"}
    fields = [field for group in GROUPS.values() for field in fields_of(group)]
    for field in rng.sample(fields, rng.randint(0, 4)):
        ends = [field.least, field.most, field.least + 1, 30] if field.kind in (int, float) else []
        valid = {*field.choices, *field.words, *ends} - {"chromium", "firefox", "inkscape"}
        given[field.name] = rng.choice(sorted(valid, key=repr) * 9 + odd_values())
    return given


@pytest.mark.sweep
def test_any_combination_of_options_gives_a_result_or_one_refusal_and_writes_no_file(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    seen = set()
    for number in range(12 * EXAMPLES):
        asked = itertools.count()  # a fit ends after a few steps
        try:
            options = Options.from_flat(options_of(Random(number)))
            result = vectorize_by(options, PIXELS, stop=lambda asked=asked: next(asked) > 20)
            json.dumps(result.report, allow_nan=False)
            seen.add("result")
        except Gauss2SvgError:
            seen.add("refusal")
    assert seen == {"result", "refusal"}
    assert not list(tmp_path.iterdir())
