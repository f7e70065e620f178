"""SVGs to break, and ways to break them by their tags, names and values."""

from __future__ import annotations

import gzip
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from random import Random

from conftest import random_scene, random_sum
from svg_texts import AS_PATH, CIRCLE, document

from gauss2svg.svg.document import Document, SvgFormat
from gauss2svg.svg.minimal import minimal_svg
from gauss2svg.svg.write import outline_svg, write_svg

_DATA = Path(__file__).parents[1] / "data"
_DOT = (
    "data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNgAAAAAgAB"
    "SK+kcQAAAABJRU5ErkJggg=="
)
EXTREMES = (
    "", "0", "-0", "1", "-1", "1e309", "-1e309", "1e308", "-1e308", "1e-320", "nan", "NaN", "inf",
    "-inf", "1e", "--1", "+", ".", "1..2", "9" * 400, "0x10", "1_000", "\u0661", "1e99999999999",
    "%", "1%", "-5%", "1px", "1mm", "1q", "1em", "none", "auto", "inherit", "9" * 5000, "1,2",
    "1 2 3", "#f00", "#ff0000ff", "rgb(1e99,0,0)", "hsl(1,2%,3%)", "hsl(1e400,2%,3%)", "red",
    "url(#a)", "url(#", "url( '#a' )", "url(x.svg)", "u\\72l(x)", "\\0000000",
    "matrix(1 2 3 4 5 6)",
    "matrix(1e200 0 0 1e200 0 0) scale(1e200)", "rotate(1e308)", "skewX(90)", "scale(0)",
    "translate()", "scale(1e-320)", "matrix(" + "1 " * 3000 + ")", "(" * 3000, "rotate(" * 2000,
    "display:none", "fill:red;" * 2000, "/*" * 2000, "animation:a 1s infinite", "filter:url(#a)",
    "mix-blend-mode:plus-lighter", "M1 0A1 1 0 0 1 0 1Z", "M" + "1 " * 3000, "A" * 3000,
    "0 0 1e308 1e308", "0 0 1e-320 1e-320", "0 0 0 0", "0 0 -1 1", "nan nan nan nan",
    "xMidYMid slice", "none none", "#a", "#", "", " ", "\u00e9\u4e2d\U0001f600", "&#38;", "&amp;",
    "&#0;", "&#xD800;", "&x;", "&lt;", ";" * 3000, "-" * 3000, "1e" * 3000, _DOT, "data:,",
    "data:image/png;base64,AAAA", "data:image/png;base64," + "A" * 9999, "file:///etc/passwd",
    "//host/x", "javascript:1", "DATA:;", "data:%", "data:image/gif;base64,R0lGODlh////fwAAACw=",
)  # fmt: skip
_NAMES = (
    "transform", "style", "filter", "href", "xlink:href", "fill", "fill-opacity", "opacity", "r",
    "cx", "cy", "rx", "ry", "d", "viewBox", "width", "height", "preserveAspectRatio", "id", "mask",
    "gradientTransform", "gradientUnits", "fx", "fr", "offset", "stop-color", "stop-opacity",
    "stdDeviation", "x", "y", "data-canvas", "display", "visibility", "inkscape:label", "class",
    "inkscape:groupmode", "xmlns", "xmlns:a", "xml:base", "onload", "filterUnits", "spreadMethod",
    "sodipodi:absref", "a:b", "", "1", "animation",
)  # fmt: skip
_ELEMENTS = (
    "<g>", "</g>", "<g/>", "<script>1</script>", "<style>g{fill:red}</style>", "<use href='#a'/>",
    "<image href='x.png'/>", f"<image href='{_DOT}'/>", "<a href='http://a'>", "</svg>", "<svg>",
    "<svg viewBox='0 0 1 1'/>", "<foreignObject/>", "<text>a</text>", "<set/>", "<animate/>",
    "<style>", "</style>", "<style>@import 'x';</style>", "<style>@keyframes a{b{c:d}}</style>",
    "<style>" + "a{" * 3000 + "</style>", "<style>/*" + "*" * 9999 + "</style>",
    "<style>@keyframes " + "a{b:c}" * 3000 + "</style>", "<style>" + "@media a{" * 999 + "</style>",
    "<!-- a -->", "<!--", "-->", "<![CDATA[ a ]]>", "<![CDATA[", "]]>", "<?a b?>", "<?xml?>", "<?",
    "<?xml-stylesheet href='x'?>", "<!DOCTYPE svg>", "<!DOCTYPE svg [", "<!ENTITY a 'b'>", "]>",
    "<!DOCTYPE svg [<!ENTITY a 'b'>]>", "<!DOCTYPE svg SYSTEM 'x'>", "&a;", "&#1;", "&", "<", ">",
    "<radialGradient id='a' href='#a'/>", "<circle r='1' fill='url(#a)'/>", "<filter id='a'/>",
    "<rect width='100%' height='100%' fill='red'/>", f"<path {AS_PATH} fill='red'/>", "\0",
    "\ufeff", "\u2028", "<g id='round-999999999'>", "<g xmlns='a'/>",
    "<x:y/>", "<" + "a" * 9999 + "/>", "<g " + "a='b' " * 3 + "/>",
    "<g " + " ".join(f"a{i}='b'" for i in range(3000)) + "/>",
)  # fmt: skip
_VALUE = re.compile(r"=\s*(\"[^\"]*\"|'[^']*')")
_NUMBER = re.compile(r"[-+]?\d*\.?\d+(?:e[-+]?\d+)?")
_TAG = re.compile(r"<[^>]*>")
_DEEPEST = 20_000


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


def _extreme_value(rng: Random, text: str) -> str:
    """An attribute's value becomes an extreme one."""
    found = list(_VALUE.finditer(text))
    if not found:
        return text
    one = rng.choice(found)
    quote = rng.choice('"""\'')
    return f"{text[: one.start()]}={quote}{rng.choice(EXTREMES)}{quote}{text[one.end() :]}"


def _extreme_number(rng: Random, text: str) -> str:
    """One number, wherever it is."""
    found = list(_NUMBER.finditer(text))
    if not found:
        return text
    one = rng.choice(found)
    return text[: one.start()] + rng.choice(EXTREMES) + text[one.end() :]


def _attribute(rng: Random, text: str) -> str:
    """One more attribute."""
    found = list(_TAG.finditer(text))
    if not found:
        return text
    at = rng.choice(found).end() - 1
    at -= text[at - 1 : at] == "/"
    value = rng.choice(EXTREMES)
    if rng.randrange(50) == 0:
        value = rng.choice(["a", "1 ", "\\", "url(#a) "]) * rng.choice([1000, 300_000])
    return f"{text[:at]} {rng.choice(_NAMES)}='{value}'{text[at:]}"


def _element(rng: Random, text: str) -> str:
    """One more element, or a piece of one, between two others."""
    found = [0, *(tag.end() for tag in _TAG.finditer(text))]
    at = rng.choice(found)
    return text[:at] + rng.choice(_ELEMENTS) + text[at:]


def _exchanged(rng: Random, text: str) -> str:
    """A tag takes the place of another."""
    found = list(_TAG.finditer(text))
    if len(found) < 2:
        return text
    one, other = rng.choice(found), rng.choice(found)
    return text[: one.start()] + other[0] + text[one.end() :]


def _without(rng: Random, text: str) -> str:
    """A few tags less."""
    found = list(_TAG.finditer(text))
    if not found:
        return text
    first = rng.randrange(len(found))
    last = min(first + rng.randint(0, 3), len(found) - 1)
    return text[: found[first].start()] + text[found[last].end() :]


def _nested(rng: Random, text: str) -> str:
    """All of the root, or what follows a tag, in many groups."""
    found = list(_TAG.finditer(text))
    if len(found) < 3:
        return text
    tag = rng.choice(["g", "svg", "a", "defs", "style", "title"])
    depth = rng.choice([2, 99, 101, 300, 3000, _DEEPEST])
    last = text.rfind("</")
    at = min(rng.choice(found[:-1]).end(), last)
    if last < 0:
        return text
    return f"{text[:at]}{f'<{tag}>' * depth}{text[at:last]}{f'</{tag}>' * depth}{text[last:]}"


def _repeated(rng: Random, text: str) -> str:
    """An element very often."""
    found = [tag for tag in _TAG.finditer(text) if tag[0].endswith("/>")]
    if not found:
        return text
    one = rng.choice(found)
    return text[: one.end()] + one[0] * rng.choice([2, 50, 2000]) + text[one.end() :]


_MUTATIONS: tuple[Callable[[Random, str], str], ...] = (
    _extreme_value, _extreme_value, _extreme_value, _extreme_number, _extreme_number, _attribute,
    _attribute, _element, _element, _exchanged, _without, _nested, _repeated,
)  # fmt: skip


def mutated_svg(rng: Random, seed: bytes, other: bytes) -> bytes:
    """One to four mutations of an SVG's text, in one of several encodings, now and then gzipped."""
    text = _text(seed)
    if rng.randrange(20) == 0:
        theirs = _text(other)
        text = text[: rng.randrange(len(text))] + theirs[rng.randrange(len(theirs)) :]
    for _ in range(rng.choice([1, 1, 1, 2, 3, 4])):
        text = rng.choice(_MUTATIONS)(rng, text)
    encoding = rng.choice(["utf-8"] * 12 + ["utf-16", "utf-8-sig", "utf-16-be"])
    data = text.encode(encoding, "surrogatepass")
    return gzip.compress(data, 1) if rng.randrange(30) == 0 else data


def _text(seed: bytes) -> str:
    if seed.startswith(b"\x1f\x8b"):
        seed = gzip.decompress(seed)
    return seed.decode("utf-16" if seed.startswith(b"\xff\xfe") else "utf-8")
