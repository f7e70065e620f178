"""Survey an untrusted SVG: refuse what it would load, and remark what may be drawn wrongly.

A file is refused if it would load anything from outside of the file, because resvg reads the local
file to which an href refers. The href may be an absolute path, or a path relative to the current
folder. An embedded image must not be an SVG, because CairoSVG would draw that SVG, and its
references are not checked here. CSS is searched as it is written and with its escapes replaced,
because an escape could hide an address.

Only attributes that a renderer reads as an address or as CSS are looked at. In SVG these are href,
the xml:base of an address, the absref of Inkscape, and attributes that take url(...). Browsers draw
an SVG as an image here, which loads nothing for the HTML in it.

resvg ignores what it does not know, so a file that a browser draws exactly may get a low score. The
tables have the elements, attributes, values and CSS that resvg 0.48 and Chromium 156 draw alike.
Whatever else SVG or CSS defines gives a remark (docs/decisions/renderers.md). Attributes that SVG
does not define have no effect in any renderer, so they give none. resvg stops to read a list of
declarations at the first one that its simple grammar does not have. CSS beyond this grammar gives
one remark, and its effect is not looked for.
"""

from __future__ import annotations

import base64
import io
import re
import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from urllib.parse import unquote_to_bytes

from PIL import Image, ImageColor
from PIL.ExifTags import Base

from gauss2svg.errors import InputError, quoted, refusal
from gauss2svg.svg.file import INKSCAPE, SVG, parse

MOST_ELEMENTS = 1_000_000  # the limit that resvg has
# The largest number of pixels in all embedded images together. It is limited because renderers
# decode these images.
_MOST_IMAGE_PIXELS = 100_000_000
# Matches what CSS loads, apart from references within the file and embedded fonts.
_LOADING = re.compile(
    r"""@import|url\((?!\s*+["']?+\s*+(?:#|data:(?:font/|application/(?:x-)?font)))\s*+([^)]*)""",
    re.ASCII | re.IGNORECASE,
)
_ROOT = ":root"  # name of the root in the tables, because the root is stretched
# Elements that are drawn alike, or not at all.
_ELEMENTS = re.compile(
    "svg|g|defs|symbol|use|a|switch|view|path|rect|circle|ellipse|line|polyline|polygon|image"
    "|(?:linear|radial)Gradient|stop|clipPath|mask|marker|filter|title|desc|metadata|style"
    "|fe(?:GaussianBlur|Offset|Flood|Blend|Composite|Merge|MergeNode|ColorMatrix|DropShadow"
    "|ComponentTransfer|Func[RGBA])"
)


def _each(names: str, pattern: str) -> dict[str, str]:
    return dict.fromkeys(names.split(), pattern)


# The tables have regular expressions of values. resvg reads neither "20." nor a blank after a
# number. Atomic groups and possessive quantifiers keep the time of a match linear.
_NUMBER = r"[+-]?(?>\d+(?:\.\d+)?|\.\d+)(?:[eE][+-]?\d+)?"
_LENGTH = rf"{_NUMBER}(?:px|mm|cm|in|pt|pc|%)?"
_COMMA = r"\s*+,?+\s*+"
_COLOR = (
    rf"(?i:#(?:[\da-f]{{3,4}}|[\da-f]{{6}}|[\da-f]{{8}})|transparent"
    rf"|{'|'.join(ImageColor.colormap.keys() - {'rebeccapurple'})}"
    rf"|(?:rgb|hsl)a?\(\s*{_NUMBER}%?(?:\s*,\s*{_NUMBER}%?){{2}}(?:\s*,\s*{_NUMBER})?\s*\))"
)
_URL = r"""url\(\s*(?:#[^"'()\\%]*|"#[^"\\%]*"|'#[^'\\%]*')\s*\)"""
_CALL = (
    rf"(?:translate|scale|rotate|skew[XY]|matrix)\s*+\(\s*+{_NUMBER}(?:{_COMMA}{_NUMBER})*+\s*+\)"
)
# The values of properties, as attributes and in CSS.
_PROPERTIES = {
    **_each(
        "fill stroke",
        rf"{_COLOR}|none|currentColor|context-(?:fill|stroke)|{_URL}(?:\s+(?:none|{_COLOR}))?",
    ),
    **_each("color stop-color flood-color background-color", rf"{_COLOR}|currentColor"),
    **_each(
        "opacity fill-opacity stroke-opacity stop-opacity flood-opacity stroke-miterlimit",
        rf"{_NUMBER}%?",
    ),
    "stroke-width": rf"(?!-){_LENGTH}",
    "stroke-dasharray": rf"none|{_LENGTH}(?:{_COMMA}{_LENGTH})*+",
    "stroke-dashoffset": _LENGTH,
    "stroke-linecap": "butt|round|square",
    "stroke-linejoin": "miter|round|bevel",
    **_each("fill-rule clip-rule", "nonzero|evenodd"),
    **_each("clip-path mask filter marker-start marker-end", rf"none|{_URL}"),
    "display": "none|inline|block|inline-block",
    "visibility": "visible|hidden|collapse",
    "overflow": "visible|hidden|auto|scroll",
    "isolation": "auto|isolate",
    "mix-blend-mode": "multiply|screen|overlay|darken|lighten|color-dodge|color-burn|hard-light"
    "|soft-light|difference|exclusion|hue|saturation|color|luminosity|normal",
    "paint-order": r"normal|(?:fill|stroke|markers)(?:\s+(?:fill|stroke|markers)){0,2}",
    "mask-type": "luminance|alpha",
    **_each("vector-effect marker marker-mid", "none"),
    "image-rendering": "auto|optimizeQuality|high-quality|smooth",
    "color-interpolation": "auto|sRGB",
    "color-interpolation-filters": "sRGB|linearRGB",
    "background": "none|transparent|white|#fff(?:fff)?",
}
# The values of other attributes, in all elements or in one.
_ATTRIBUTES = {
    **_each("x y width height cx cy r rx ry x1 y1 x2 y2 fx fy fr refX refY", _LENGTH),
    **_each("markerWidth markerHeight offset", _LENGTH),
    **_each("dx dy", _NUMBER),
    "points": r"[-+.,eE\d\s]*+",
    "stdDeviation": rf"{_NUMBER}(?:{_COMMA}{_NUMBER})?",
    "viewBox": rf"\s*+{_NUMBER}(?:{_COMMA}{_NUMBER}){{3}}\s*+",
    "preserveAspectRatio": r"\s*(?:none|x(?:M[a-z]{2}Y?){2})?(?:\s+(?:meet|slice))?\s*",
    **_each("transform gradientTransform", rf"none|\s*+(?:{_CALL}(?:{_COMMA}{_CALL})*+)?\s*+"),
    "orient": r"auto|auto-start-reverse|-?[\d.]+",
    "edgeMode": "none",
    "primitiveUnits": "userSpaceOnUse",
    **_each("pathLength systemLanguage", "(?!)"),
    # draw.io ends its files with an empty group of this feature, which is skipped.
    "requiredFeatures": ".*#Extensibility",
    **_each("href {http://www.w3.org/1999/xlink}href", r"(?s:#[^\s%]*|\s*(?i:data):.*)|"),
    **_each("a/href a/{http://www.w3.org/1999/xlink}href", "(?s:.*)"),
    "style/type": "(?:text/css)?",
    "style/media": "|all|screen",
    "feComposite/operator": "over|in|out|atop|xor|arithmetic",
    **_each("symbol/x symbol/y symbol/width symbol/height symbol/transform", "(?!)"),
    **_each(f"{_ROOT}/x {_ROOT}/y {_ROOT}/width {_ROOT}/height {_ROOT}/overflow", "(?s:.*)"),
    **_each(f"{_ROOT}/viewBox {_ROOT}/preserveAspectRatio", "(?s:.*)"),
    **_each(f"{_ROOT}/transform {_ROOT}/filter {_ROOT}/mask {_ROOT}/clip-path", "none|"),
}
# Properties of CSS that change nothing in a still picture of shapes.
_WITHOUT_EFFECT = re.compile(
    "-(?:inkscape|moz|ms|khtml|webkit-(?:tap|touch|user|text|font|print))-.*"
    "|(?:font|text|letter|word|line|white|list|scroll|solid|transition|page|shape|color)(?:-.+)?"
    "|writing-mode|direction|unicode-bidi|.*baseline.*|kerning|cursor|pointer-events|user-select"
    "|touch-action|will-change|enable-background|z-index|vertical-align|block-progression"
    "|(?:min|max)-(?:width|height)"
)
# Rules of media that a still picture on a white page does not meet.
UNMET_MEDIA = re.compile(
    r"@media\s*(?:print|\(\s*prefers-(?:color-scheme\s*:\s*dark"
    r"|reduced-motion\s*:\s*no-preference)\s*\))\s*"
    r"\{(?:[^{}<]*+\{(?:[^{}<]*+\{[^{}<]*+\})*+[^{}<]*+\})*+[^{}<]*+\}"
)


class Survey:
    """Counts of the elements and layers of an SVG, and its root.

    elements   number of elements
    tags       number of elements of each name, the most frequent name first. A name that is not in
               the namespace of SVG is written as {namespace}name
    layers     number of groups that Inkscape shows as layers
    root       attributes of the root
    qualified  whether the root is in the namespace of SVG. If not, browsers do not show the file
    remarks    what resvg is not known to draw as browsers do, such as "fill: oklch(...) on <rect>".
               There are at most 20

    Raise InputError if the SVG has more than most_elements elements, or if it refers to anything
    outside of the file.
    """

    def __init__(self, text: str, most_elements: int = MOST_ELEMENTS) -> None:
        self.tags: dict[str, int] = Counter()
        self.elements, self.layers, self.root, self.qualified = 0, 0, dict[str, str](), False
        self._most, self._pixels, self._ids = most_elements, 0, set[str]()
        self._in_sheet, self._sheet = False, list[str]()
        self._remarks = dict[str, None]()
        parse(text, self)
        self.remarks = tuple(self._remarks)
        self.tags = dict(Counter(self.tags).most_common())

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """Count an element and check its references. Store the attributes if it is the root."""
        name, local = tag.removeprefix(SVG), tag.rpartition("}")[2]
        is_root = not self.tags
        if is_root:
            if name != "svg":
                raise refusal("root element", "<svg>", f"<{name[:80]}>")
            self.root, self.qualified = attributes, tag != name
        self.elements += 1
        if self.elements > self._most:
            advice = "to raise --max-elements if you trust it"
            raise refusal("the SVG", f"of at most {self._most} elements", "more", advice)
        if self._in_sheet:
            # Renderers disagree about the CSS of a <style> that contains elements, so such a file
            # is refused.
            got = f"<{local[:80]}> in it"
            raise refusal("a style sheet", "of text alone", got, "to save it as plain SVG")
        self._in_sheet = local == "style"
        self.tags[name] += 1
        self.layers += name == "g" and attributes.get(INKSCAPE + "groupmode") == "layer"
        if "}" not in name:  # no renderer draws an element of another namespace
            self._remark(_element_remarks(_ROOT if is_root else name, attributes))
            key = attributes.get("id", "")
            if name in ("linearGradient", "radialGradient", "clipPath", "mask", "filter") and key:
                # resvg takes the last one, and browsers take the first.
                self._remark([f"the id {key[:40]} of several elements"] if key in self._ids else [])
                self._ids.add(key)
        for key, value in attributes.items():
            link = key.rpartition("}")[2]
            if link in ("href", "absref") or key.endswith("}base"):
                # The href of an <a> is allowed, because it is loaded only if someone clicks on it.
                if (local, link) != ("a", "href"):
                    self._add_picture(value)
            elif link in _PROPERTIES or link == "style":
                _check_loading(value)

    def end(self, _tag: str) -> None:
        """Check the text of a style sheet when its element ends."""
        if self._in_sheet:
            sheet = "".join(self._sheet)
            _check_loading(sheet)
            self._remark(_sheet_remarks(sheet))
            self._sheet.clear()
            self._in_sheet = False

    def data(self, text: str) -> None:
        """Collect the text of a style sheet."""
        if self._in_sheet:
            self._sheet.append(text)

    def pi(self, target: str, _text: str) -> None:
        """Raise InputError if a processing instruction loads a style sheet.

        The instruction may be at any place of the file.
        """
        if target == "xml-stylesheet":
            raise _outside("xml-stylesheet")

    def _remark(self, remarks: Iterable[str]) -> None:
        """Keep remarks. A note has the first few, so more than 20 are not kept."""
        for remark in remarks:
            if len(self._remarks) < 20:
                self._remarks[remark] = None

    def _add_picture(self, target: str) -> None:
        """Count the pixels of the embedded image that an address contains.

        A reference within the file has none. Raise InputError for any other address. resvg opens a
        file named " #a.png", but ignores blanks before "data:" as browsers do.
        """
        if not target or target.startswith("#"):
            return
        target = target.lstrip(" \t\r\n")
        if target[:5].lower() != "data:":
            raise _outside(target)
        declared, _, content = target[5:].partition(",")
        data = unquote_to_bytes(content)
        formats = "PNG", "JPEG", "GIF", "WEBP"
        try:
            if declared.lower().rstrip().endswith("base64"):
                data = base64.b64decode(b"".join(data.split()) + b"==")
            with (
                warnings.catch_warnings(action="ignore"),
                # Image.open reads only the header.
                Image.open(io.BytesIO(data), formats=formats) as picture,
            ):
                self._pixels += picture.width * picture.height
                remark = _picture_remark(picture, declared)
        except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
            needed = f"an image, one of {', '.join(formats)}"
            raise refusal("data: in the SVG", needed, quoted(target[:40])) from error
        self._remark([remark] if remark else [])
        if self._pixels > _MOST_IMAGE_PIXELS:
            needed, advice = f"at most {_MOST_IMAGE_PIXELS} px", "smaller images"
            raise refusal("images in the SVG", needed, f"{self._pixels} px", advice)


def _check_loading(text: str) -> None:
    """Raise InputError if CSS loads anything, as it is written or with its escapes replaced."""
    if "(" not in text and "@" not in text and "\\" not in text:
        return
    unescaped = re.sub(r"\\(?:([\da-fA-F]{1,6})(?:\r\n|\s)?|\r\n|[\n\r\f])", _character, text)
    for css in {text, unescaped.replace("\\", "")}:
        if match := _LOADING.search(css):
            raise _outside(match[1] or match[0])


def _character(escape: re.Match[str]) -> str:
    """Return the character of an escape of CSS, or "" for an escaped end of a line."""
    code = int(escape[1] or "0", 16)
    return chr(code) if 0 < code < 0x110000 else ""


def _outside(target: str) -> InputError:
    advice = "to embed the image, or to remove the reference"
    needed = "within the file or embedded as data:"
    return refusal("a reference in the SVG", needed, quoted(target.strip()), advice)


def _element_remarks(element: str, attributes: Mapping[str, str]) -> Iterator[str]:
    """Yield remarks on an element, such as 'fill="oklch(...)" on <rect>'."""
    name = "svg" if element == _ROOT else element[:40]
    # `check` has a note of its own on texts. No renderer has extensions, and Illustrator requires
    # one for what only Illustrator reads.
    is_text = element in ("text", "tspan", "tref", "textPath")
    if is_text or "requiredExtensions" in attributes:
        return
    if not _ELEMENTS.fullmatch(name):
        yield f"<{name}>"
        return
    if name.startswith("fe") and 0 < len(attributes.keys() & {"x", "y", "width", "height"}) < 4:
        yield f"<{name}> with a part of x, y, width and height"
    for key, value in attributes.items():
        if key == "style":
            yield from _style_remarks(element, value, f" on <{name}>")
            continue
        pattern = _ATTRIBUTES.get(f"{element}/{key}") or _ATTRIBUTES.get(key) or _property(key)
        if pattern and not re.fullmatch(pattern, value):
            yield f'{key.rpartition("}")[2]}="{_brief(value)}" on <{name}>'


def _sheet_remarks(sheet: str) -> Iterator[str]:
    """Yield remarks on the text of a style sheet."""
    css = re.sub(r"/\*.*?(?:\*/|\Z)", "", sheet, flags=re.DOTALL)
    css = re.sub(r"@(?:charset|namespace)[^;{}]*+;|@font-face\s*\{[^{}]*+\}", "", css)
    css, end = UNMET_MEDIA.sub("", css).strip(), 0
    rule = re.compile(r"\s*+([^{}@\\]++)\{([^{}]*+)\}")
    attribute = r"""\[[\w-]++(?:="[^"\\]*+")?\]"""
    known = re.compile(
        rf"\s*+(?:[*\w-]*+(?:[.#][a-zA-Z_-][\w-]*+|{attribute})*+[\s>+]*+)++", re.ASCII
    )
    while match := rule.match(css, end):
        end = match.end()
        for selector in match[1].split(","):
            if re.search(r":(?:hover|active|focus|visited|target)\b", selector):
                continue  # matches nothing in a still picture
            if known.fullmatch(selector):
                yield from _style_remarks("", match[2], "")
            else:
                yield f"the selector {_brief(selector)}"
    if css[end:]:
        yield f"{_brief(css[end:])} in a style sheet"


@lru_cache(maxsize=4096)
def _style_remarks(element: str, style: str, place: str) -> tuple[str, ...]:
    """Return remarks on a list of declarations, each with the place where the list is."""
    style, end = re.sub(r"/\*.*?(?:\*/|\Z)", "", style, flags=re.DOTALL), 0
    value = r"""(?:[^;:{}\\!/"'()]|"[^"\\]*+"|'[^'\\]*+'|\([^()\\]*+\))++"""
    declaration = re.compile(rf"\s*+(-?[a-z][\w-]*+)\s*+:({value})(?:;[\s;]*+|\Z)")
    remarks = []
    while match := declaration.match(style, end):
        end, name, value = match.end(), match[1], match[2].strip()
        pattern = _property(name)
        # The root is stretched, whatever its sides in CSS are.
        is_side = element == _ROOT and name in ("width", "height")
        if pattern is None and (is_side or _WITHOUT_EFFECT.fullmatch(name)):
            continue
        if not re.fullmatch(pattern or "none|auto|normal|0(?:px)?|1|inherit|initial", value):
            remarks.append(f"{name}: {_brief(value)}{place}")
    if rest := style[end:].strip():
        remarks.append(f"{_brief(rest)}{place}")
    return tuple(remarks)


@lru_cache(maxsize=1024)
def _property(name: str) -> str | None:
    return f"{_PROPERTIES[name]}|inherit|initial" if name in _PROPERTIES else None


def _brief(text: str) -> str:
    """Return a text for a remark: on one line, and without the arguments of functions."""
    return " ".join(re.sub(r"\(.*", "(...)", text[:200], flags=re.DOTALL).split())[:40]


def _picture_remark(picture: Image.Image, declared: str) -> str | None:
    """Return a remark on an embedded image that resvg draws otherwise than Chromium.

    declared  media type that its address declares, such as "image/png;base64"
    """
    kind, orientation = picture.format or "", 1
    media_type = declared.partition(";")[0].strip().lower()
    if media_type not in ("", f"image/{kind.lower()}", *["image/jpg"] * (kind == "JPEG")):
        return f"a {kind} declared as {media_type[:40]}"
    if kind != "WEBP":
        with suppress(Exception):  # broken data may raise any exception, and browsers ignore them
            orientation = picture.getexif().get(Base.Orientation, 1)
    profile = (picture.info.get("icc_profile") or b"sRGB").replace(b"\0", b"")
    is_plain = picture.mode != "CMYK" and not getattr(picture, "is_animated", False)
    if is_plain and orientation == 1 and b"sRGB" in profile:
        return None
    return f"a {kind} that is turned, animated or not in sRGB"
