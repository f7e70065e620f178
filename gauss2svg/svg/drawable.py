"""The elements, attributes, values and CSS that resvg 0.48 and Chromium 156 draw alike.

resvg ignores what it does not know, so a file that a browser draws exactly may get a low score.
Whatever SVG or CSS defines and these tables do not have gives a remark
(docs/decisions/renderers.md). Attributes that SVG does not define have no effect in any renderer,
so they give none.

resvg stops to read a list of declarations at the first one that its simple grammar does not have.
CSS beyond this grammar gives one remark, and its effect is not looked for.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import lru_cache

from PIL import Image, ImageColor
from PIL.ExifTags import Base

ROOT = ":root"  # name of the root in the tables, because the root is stretched
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
PROPERTIES = {
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
    **_each(f"{ROOT}/x {ROOT}/y {ROOT}/width {ROOT}/height {ROOT}/overflow", "(?s:.*)"),
    **_each(f"{ROOT}/viewBox {ROOT}/preserveAspectRatio", "(?s:.*)"),
    **_each(f"{ROOT}/transform {ROOT}/filter {ROOT}/mask {ROOT}/clip-path", "none|"),
}
# Properties of CSS that change nothing in a still picture of shapes.
_WITHOUT_EFFECT = re.compile(
    "-(?:inkscape|moz|ms|khtml|webkit-(?:tap|touch|user|text|font|print))-.*"
    "|(?:font|text|letter|word|line|white|list|scroll|solid|transition|page|shape|color)(?:-.+)?"
    "|writing-mode|direction|unicode-bidi|.*baseline.*|kerning|cursor|pointer-events|user-select"
    "|touch-action|will-change|enable-background|z-index|vertical-align|(?:min|max)-(?:width|height)"
)
# Rules of media that a still picture on a white page does not meet.
UNMET_MEDIA = re.compile(
    r"@media\s*(?:print|\(\s*prefers-(?:color-scheme\s*:\s*dark"
    r"|reduced-motion\s*:\s*no-preference)\s*\))\s*"
    r"\{(?:[^{}<]*+\{(?:[^{}<]*+\{[^{}<]*+\})*+[^{}<]*+\})*+[^{}<]*+\}"
)


def element_remarks(element: str, attributes: Mapping[str, str]) -> Iterator[str]:
    """Yield remarks on an element, such as 'fill="oklch(...)" on <rect>'."""
    name = "svg" if element == ROOT else element[:40]
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


def sheet_remarks(sheet: str) -> Iterator[str]:
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
        # The frame of a file reads the sides of the root.
        is_side = element == ROOT and name in ("width", "height")
        if pattern is None and (is_side or _WITHOUT_EFFECT.fullmatch(name)):
            continue
        if not re.fullmatch(pattern or "none|auto|normal|0(?:px)?|1|inherit|initial", value):
            remarks.append(f"{name}: {_brief(value)}{place}")
    if rest := style[end:].strip():
        remarks.append(f"{_brief(rest)}{place}")
    return tuple(remarks)


@lru_cache(maxsize=1024)
def _property(name: str) -> str | None:
    return f"{PROPERTIES[name]}|inherit|initial" if name in PROPERTIES else None


def _brief(text: str) -> str:
    """Return a text for a remark: on one line, and without the arguments of functions."""
    return " ".join(re.sub(r"\(.*", "(...)", text[:200], flags=re.DOTALL).split())[:40]


def picture_remark(picture: Image.Image, declared: str) -> str | None:
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
