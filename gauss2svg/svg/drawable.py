"""The attributes, properties and values that resvg 0.48 and Chromium 156 draw alike, also in CSS.

See docs/decisions/renderers.md. Whatever else SVG or CSS defines gives a remark. Attributes that
SVG does not define have no effect in any renderer, so they give none.

Browsers read CSS as tinycss2 does. resvg stops to read a list of declarations at the first one that
its simple grammar does not have, such as a custom property, a slash or nested brackets.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple

import tinycss2
from PIL import ImageColor

from gauss2svg.svg.file import SVG

XLINK = "{http://www.w3.org/1999/xlink}"
ROOT = ":root"  # the name of the root in the tables. It is stretched, and is a box of a page
# Elements with notes of their own, which say how they are drawn.
TEXTS = {"text", "tspan", "tref", "textPath", "altGlyph", "foreignObject"}


def _each(names: str, value: Any) -> dict[str, Any]:
    return dict.fromkeys(names.split(), value)


# The rest of the tables has regular expressions of values. Chromium places nothing at coordinates
# of 8 digits. resvg reads neither "20." nor a blank after a number. Atomic groups keep the time of
# a match linear.
_NEVER = "(?!)"
NUMBER = r"[+-]?(?>\d+(?:\.\d+)?|\.\d+)(?:[eE][+-]?\d+)?"
_SHARE = rf"\s*{NUMBER}%?"
_SIDE = (
    r"[+-]?(?:(?>\d(?:\.\d+)?|\.\d+)[eE]\+?0?[0-6](?!\d)"
    r"|(?>\d{1,7}(?!\d)(?:\.\d+)?|\.\d+)(?:[eE]-\d+)?)(?:px|mm|cm|in|pt|pc|em|%)?"
)
_LENGTH = rf"\s*{_SIDE}"
_NAMES = "|".join(["transparent", *sorted(ImageColor.colormap.keys() - {"rebeccapurple"})])
_N, _PERCENT = rf"\s*{NUMBER}\s*", rf"\s*{NUMBER}%\s*"
_COLOR = (
    rf"(?i:#(?:[\da-f]{{3,4}}|[\da-f]{{6}}|[\da-f]{{8}})|{_NAMES}"
    rf"|rgba?\((?:{_N}(?:,{_N}){{2}}|{_PERCENT}(?:,{_PERCENT}){{2}})(?:,{_N})?\)"
    rf"|rgb\((?:{_N}(?:\s{_N}){{2}}|{_PERCENT}(?:\s{_PERCENT}){{2}})\)"
    rf"|hsla?\({_N}(?:,{_PERCENT}){{2}}(?:,{_N})?\)|hsl\({_N}(?:\s{_PERCENT}){{2}}\))"
)
_URL = r"""url\(\s*(?:#[^"'()\\%]*|"#[^"\\%]*"|'#[^'\\%]*')\s*\)"""
_PAINT = (
    rf"\s*(?:{_COLOR}|none|currentColor|context-fill|context-stroke"
    rf"|{_URL}(?:\s+(?:none|currentColor|{_COLOR}))?)\s*"
)
_COMMA = r"\s*+,?+\s*+"
_ALIGN = "(?:Min|Mid|Max)"
_CALL = (
    "(?:translate|scale|rotate|skewX|skewY|matrix)"
    rf"\s*+\(\s*+{NUMBER}(?:{_COMMA}{NUMBER})*+\s*+\)"
)
_ABSOLUTE = rf"(?:0|{NUMBER}(?:px|mm|cm|in|pt|pc|em))"
_FUNCTIONS = (
    rf"(?:\s*(?:blur\({_ABSOLUTE}?\)|hue-rotate\({NUMBER}(?:deg|grad|rad|turn)\)"
    rf"|(?:brightness|contrast|grayscale|invert|opacity|saturate|sepia)\((?:{NUMBER}%?)?\)"
    rf"|drop-shadow\((?:{_COLOR}\s+)?{_ABSOLUTE}(?:\s+{_ABSOLUTE}){{1,2}}(?:\s+{_COLOR})?\)))+"
)
# The values of properties that are drawn right. `inherit` and `initial` are drawn right too.
_PROPERTIES = {
    **_each("fill stroke", _PAINT),
    "color": _COLOR,
    "stop-color": rf"{_COLOR}|currentColor",
    "flood-color": _COLOR,
    **_each("opacity fill-opacity stroke-opacity stop-opacity flood-opacity", _SHARE),
    "stroke-width": rf"\s*(?!-){_SIDE}",
    "stroke-dasharray": rf"none|{_LENGTH}(?:{_COMMA}{_SIDE})*+\s*+",
    "stroke-dashoffset": _LENGTH,
    "stroke-linecap": "butt|round|square",
    "stroke-linejoin": "miter|round|bevel",
    "stroke-miterlimit": _SHARE,
    **_each("fill-rule clip-rule", "nonzero|evenodd"),
    **_each("clip-path mask", rf"none|{_URL}"),
    **_each("marker marker-start marker-mid marker-end", "none"),  # see _EXCEPTIONS
    "filter": rf"none|(?:\s*{_URL})+|{_FUNCTIONS}",
    "display": "none|inline|block|inline-block|flex",
    "visibility": "visible|hidden|collapse",
    "overflow": "visible|hidden|auto|scroll",
    "isolation": "auto|isolate",
    "mix-blend-mode": "multiply|screen|overlay|darken|lighten|color-dodge|color-burn|hard-light"
    "|soft-light|difference|exclusion|hue|saturation|color|luminosity|normal",
    "paint-order": r"normal|(?:fill|stroke|markers)(?:\s+(?:fill|stroke|markers)){0,2}",
    "mask-type": "luminance|alpha",
    "vector-effect": "none",
    "image-rendering": "auto|optimizeQuality|high-quality|smooth",
    "color-interpolation": "auto|sRGB",
    "color-interpolation-filters": "sRGB|linearRGB",
    "background-color": rf"{_COLOR}|none",
    # CSS takes no blank between numbers, and resvg takes no unit. This leaves what has no unit.
    "transform": rf"none|(?:(?:scale|matrix)\({_N}(?:,{_N})*+\)\s*+)++",
}
# Properties that are no attributes, or attributes of another syntax.
_CSS_ONLY = ["mix-blend-mode", "isolation", "background-color", "marker", "transform"]
MARKERS = _each("marker marker-start marker-mid marker-end", rf"none|{_URL}")
# The values of other attributes that are drawn right. All values of all other attributes are.
_ATTRIBUTES = {
    **_each("x y width height cx cy r rx ry x1 y1 x2 y2 fx fy fr refX refY", _LENGTH),
    **_each("markerWidth markerHeight", _LENGTH),
    **_each("dx dy", NUMBER),
    "offset": _SHARE,
    "points": r"[-+.,eE\d\s]*+",
    "stdDeviation": rf"(?:\s*+,?+\s*+{NUMBER})*+\s*+",
    # Chromium draws nothing if a side is 0.
    "viewBox": rf"(?:{_COMMA}{NUMBER}){{2}}(?:{_COMMA}(?![+-]?[0.]+(?:[\s,]|\Z)){NUMBER}){{2}}\s*+",
    "preserveAspectRatio": rf"\s*(?:none|x{_ALIGN}Y{_ALIGN})?(?:\s+(?:meet|slice))?\s*",
    **_each(
        "transform gradientTransform patternTransform",
        rf"none|\s*+(?:{_CALL}(?:{_COMMA}{_CALL})*+)?\s*+",
    ),
    "orient": r"auto|auto-start-reverse|-?[\d.]+",
    **_each("pathLength requiredFeatures", _NEVER),
    **_each(f"href {XLINK}href", r"(?s:#[^\s%]*|\s*(?i:data):.*)|"),
    "systemLanguage": r"[a-z]{2}(?:-[A-Z]{2})?(?:,\s*[a-z]{2}(?:-[A-Z]{2})?)*",
    # resvg also reads attributes of these namespaces.
    **{space + name: _NEVER for space in (SVG, XLINK) for name in ("style", *_PROPERTIES)},
}
# Patterns for one element, in place of those of the tables above. None stands for any value.
_EXCEPTIONS: dict[str, dict[str, str | None]] = {
    ROOT: {
        **_each("x y width height viewBox overflow preserveAspectRatio", None),
        "transform": r"none|\s*|translate\(\s*0(?:px)?(?:[\s,]+0(?:px)?)?\s*\)",
        "display": "inline|block|inline-block",
        **_each("filter mask clip-path", "none"),
        "systemLanguage": _NEVER,
    },
    **_each("path line polyline polygon use", MARKERS),
    # draw.io ends its files with an empty group of this feature, which browsers and resvg skip.
    "g": {**MARKERS, "requiredFeatures": ".*#Extensibility"},
    "svg": {**MARKERS, **_each("width height", rf"(?!\s*(?:-|[0.]+(?:[a-z%]|\Z))){_LENGTH}")},
    "a": {**MARKERS, **_each(f"href {XLINK}href", None)},
    "script": _each(f"href {XLINK}href", None),
    **_each("clipPath linearGradient radialGradient", _each("display", "inline|block")),
    "defs": {**_each("display", "inline|block"), "systemLanguage": _NEVER},
    "marker": {
        **_each("refX refY", rf"{_LENGTH}|center|left|right|top|bottom"),
        **_each("opacity clip-path mask filter", "none|1"),
    },
    "symbol": _each("x y width height transform", _NEVER),
    "mask": {"mask": "none", "display": "inline|block"},
    "pattern": {"overflow": "hidden", "display": "inline|block"},
    "filter": {"display": "inline|block", **_each(f"href {XLINK}href", _NEVER)},
    "feTurbulence": {"stitchTiles": "noStitch"},
    "feGaussianBlur": {"edgeMode": "none"},
    "feComposite": {"operator": "over|in|out|atop|xor|arithmetic"},
}
# Attributes that browsers also take from CSS, and resvg does not.
_GEOMETRY = {
    **_each("rect image svg use", "x y width height rx ry"),
    "circle": "cx cy r",
    "ellipse": "cx cy rx ry",
    "path": "d",
}
KINDS = {*_EXCEPTIONS, *_GEOMETRY, *TEXTS}
# Properties that change nothing in a still picture of shapes, those of _check_others apart.
_WITHOUT_EFFECT = re.compile(
    "--.*|-(?:inkscape|moz|ms|o|khtml)-.*|-webkit-(?:tap|touch|user|text|font|print|line|overflow)-.*"
    "|(?:font|text|letter|word|line|glyph|white-space|list|scroll|flex|align|justify|grid|column|row"
    "|solid|transition|animation|page|break|backface|object)(?:-.*)?|writing-mode|direction"
    "|unicode-(?:bidi|range)|.*baseline.*|kerning|cursor|pointer-events|user-select|touch-action|speak"
    "|will-change|(?:shape|text|color)-rendering|color-(?:scheme|profile)|lighting-color|fill-color"
    "|shape-(?:inside|padding|margin|subtract)|enable-background|z-index|order|gap|perspective"
    "|transform-(?:origin|style)|(?:print-color|forced-color)-adjust|(?:accent|caret)-color"
    "|appearance|vertical-align|quotes|content|hyphens|tab-size|aspect-ratio|contain"
    "|(?:(?:min|max)-)?(?:width|height)|box-sizing|resize|overflow-(?:wrap|anchor)|float"
    "|clear|border-radius|outline-(?:offset|color)|stroke-(?:alignment|location)|[xydr]|[cr][xy]|src"
    "|orphans|widows|backdrop-filter|clip|zoom"
)
# Properties of boxes, which have an effect on the root alone, and their values that have none.
_BOX = re.compile(
    r"(?:padding|margin|border|inset|background)(?:-.*)?|position|left|top|right|bottom|box-shadow"
)
FONT_SIZE = rf"(?!-){NUMBER}(?:px|pt|em|%)?|none|inherit"  # the sizes that resvg reads


@lru_cache(maxsize=4096)
def _pattern(element: str, name: str, is_css: bool) -> str | None:
    """Return the pattern of the values that are drawn right, or None if all values are."""
    exceptions = _EXCEPTIONS.get(element, {})
    if name in exceptions:
        return exceptions[name]
    if is_css and (name == "all" or name in _GEOMETRY.get(element, "").split()):
        return _NEVER
    if name in _PROPERTIES and (is_css or name not in _CSS_ONLY):
        return f"{_PROPERTIES[name]}|inherit|initial"
    if not is_css:
        return _ATTRIBUTES.get(name)
    if _BOX.fullmatch(name):
        empty = "0(?:px|%)?|none|auto|static|relative|transparent|(?i:white|#fff|#ffffff)"
        return rf"(?:(?:{empty})(?:\s+|\Z))+" if element == ROOT else None
    # Values that change nothing, of whatever property.
    neutral = "none|auto|normal|0|1|inherit|initial"
    return None if _WITHOUT_EFFECT.fullmatch(name) else neutral


@lru_cache(maxsize=4096)
def matcher(element: str, name: str, is_css: bool = False) -> Callable[[str], Any] | None:
    """Return a function that tells whether a value is drawn right, or None if all values are."""
    pattern = _pattern(element, name, is_css)
    return None if pattern is None else re.compile(pattern).fullmatch


def has_effect(element: str, name: str) -> bool:
    """Return whether a property of CSS may change how an element is drawn."""
    return element not in TEXTS and _pattern(element, name, True) is not None


_COMMENT = r"/\*(?:[^*]|\*(?!/))*+"
# A search for comments alone would take quadratic time if many are not closed.
_TO_REMOVE = re.compile(rf"{_COMMENT}(?:\*/|\Z)")
_GAP = rf"(?:\s|{_COMMENT}\*/)*+"
IDENT = r"-?[a-zA-Z_][\w-]*+"
_TERM = (
    rf"""(?:#[\w-]*+|[+\-.\d][\d.]*+(?:%|{IDENT})?|"(?:[^"\\]|\\.)*+"|'(?:[^'\\]|\\.)*+'|,"""
    rf"""|{IDENT}(?:\([^)\\]*+\))?)"""
)
# One declaration as resvg reads it: a name, terms and the word !important. resvg skips a star
# before the name, but browsers skip the whole declaration.
_DECLARATION = re.compile(
    rf"{_GAP}(\*?)(-?[a-z_][\w-]*+){_GAP}:{_GAP}((?:{_TERM}{_GAP})++)(?:(!){_GAP}important{_GAP})?"
    rf"(?:(?:;{_GAP})++|(?=\}})|\Z)",
    re.ASCII | re.DOTALL,
)
_WITHOUT_EFFECT_AT = re.compile(
    "font-face|charset|page|property|namespace|counter-style|(?:-(?:webkit|moz|o)-)?keyframes"
)
# Queries of media that a still picture on a white page does not meet.
_UNMET_MEDIA = re.compile(
    r"print|speech|\(\s*prefers-color-scheme\s*:\s*dark\s*\)"
    r"|\(\s*prefers-reduced-motion\s*:\s*no-preference\s*\)"
)


class Declaration(NamedTuple):
    """A declaration of CSS, with its value as text."""

    name: str
    value: str
    is_important: bool


class Css(NamedTuple):
    """A list of declarations.

    by_resvg     those that resvg reads
    by_browsers  those that browsers read
    is_same      whether both are known to be the same
    """

    by_resvg: list[Declaration]
    by_browsers: list[Declaration]
    is_same: bool


@lru_cache(maxsize=4096)
def css_of(style: str) -> Css:
    """Return the declarations of the attribute style."""
    style = re.sub(r"\r\n?|\f", "\n", style)
    read, end = _by_resvg(style, 0)
    if re.compile(_GAP).fullmatch(style, end):
        return Css(read, read, True)
    return Css(read, _by_browsers(tinycss2.parse_blocks_contents(style, True, True)), False)


def rules_of(sheet: str) -> Iterator[tuple[str, list[Any], Css]]:
    """Yield each selector of a style sheet, as tokens, with its declarations.

    The first item of a tuple is what resvg does not apply: an at-rule around the selector, nested
    rules, or escapes. It is "" if there is none. Rules that no still picture meets are left out.
    """
    sheet = re.sub(r"\r\n?|\f", "\n", sheet)  # tinycss2 does it too, and then counts the lines
    lines = [0, *(match.end() for match in re.finditer("\n", sheet))]

    def offset(node: Any) -> int:
        return lines[node.source_line - 1] + node.source_column - 1

    waiting = [("", node) for node in reversed(tinycss2.parse_stylesheet(sheet, True, True))]
    while waiting:
        reason, node = waiting.pop()
        inner: list[tuple[str, Any]] = []
        if node.type == "qualified-rule" and node.content:
            begin = offset(node.content[0])
            if "\\" in sheet[offset(node) : begin]:
                reason = reason or "escapes in a selector"
            read, end = _by_resvg(sheet, begin)
            content = tinycss2.parse_blocks_contents(node.content, True, True)
            css = Css(read, _by_browsers(content), sheet[end : end + 1] in ("}", ""))
            for selector in _selectors(node.prelude):
                yield reason, selector, css
            inner = [(reason or "nested rules", each) for each in content]
        elif node.type == "at-rule" and node.content is not None:
            name, query = node.lower_at_keyword, text_of(node.prelude)
            is_unmet = name == "media" and _UNMET_MEDIA.fullmatch(query)
            if not is_unmet and not _WITHOUT_EFFECT_AT.fullmatch(name):
                rule = f"@{name} {query}".strip()[:60]
                inner = [
                    (rule, each) for each in tinycss2.parse_rule_list(node.content, True, True)
                ]
        waiting += reversed(inner)


def text_of(nodes: list[Any]) -> str:
    """Return the text of nodes of tinycss2, or a bracket if they are nested too deeply for it."""
    try:
        return tinycss2.serialize(nodes).strip()
    except RecursionError:
        return "("


def _by_resvg(text: str, begin: int) -> tuple[list[Declaration], int]:
    """Return the declarations that resvg reads from a position on, and where the others begin."""
    read: list[Declaration] = []
    while match := _DECLARATION.match(text, begin):
        read.append(Declaration(match[2], _TO_REMOVE.sub("", match[3]).strip(), bool(match[4])))
        if match[1]:
            break
        begin = match.end()
    return read, begin


def _by_browsers(nodes: list[Any]) -> list[Declaration]:
    return [
        Declaration(node.lower_name, text_of(node.value), node.important)
        for node in nodes
        if node.type == "declaration"
    ]


def _selectors(prelude: list[Any]) -> Iterator[list[Any]]:
    """Yield the tokens of each selector of a list, without comments."""
    part: list[Any] = []
    for token in prelude:
        if token == ",":
            yield part
            part = []
        elif token.type != "comment" and (part or token.type != "whitespace"):
            part.append(token)
    yield part
