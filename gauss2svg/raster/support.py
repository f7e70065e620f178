"""What of SVG a renderer does not draw, so that no picture is scored which it drew wrongly.

Found by drawing with resvg 0.48, CairoSVG 2.9, Chromium 156, librsvg 2.54, Firefox 153 and
Inkscape 1.2; errors in levels of 255:

    what a file uses                      not drawn by
    a blur                                cairo (no filters at all but offset, flood and blend);
                                          resvg, where its element is turned or sheared and not
                                          scaled alike (20 to 43 levels off); librsvg, where it is
                                          turned other than by right angles (39 to 45)
    mix-blend-mode                        cairo
    mix-blend-mode: plus-lighter          all but the two browsers
    href without xlink:                   inkscape
    animation that runs also where less   the two browsers: at some moment of it; all others
    motion is preferred                   draw the file as it is written
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from xml.parsers import expat

from gauss2svg.errors import RendererError
from gauss2svg.raster.css import plain_css, without_blocks

BROWSERS = ("chromium", "firefox")
DRAW_TURNED_BLURS = (*BROWSERS, "inkscape")
DRAW_BLENDS = ("resvg", *BROWSERS, "librsvg", "inkscape")  # of mix-blend-mode, and filters
# A file without any of these uses nothing of the table, and is not parsed. Escapes of CSS and
# XML could hide a word.
_WORDS = (
    "filter", "blur", "shadow", "blend", "href", "animat", "discard", "starting-style", "<set",
    ":set", "\\", "&#",
)  # fmt: skip
_BLURS = ("feGaussianBlur", "feDropShadow")
_MOVING = ("animate", "animateTransform", "animateMotion", "animateColor", "set", "discard")
_LINKING = ("use", "image", "pattern", "filter", "linearGradient", "radialGradient")
_XLINK_HREF = "http://www.w3.org/1999/xlink href"
_PROPERTY = r"(?:^|(?<=[\s;{]))(?:-webkit-)?"
_VALUE = r"\s*:\s*(?!(?:none|normal|inherit|initial|unset)\b)[^\s;}]"
_FILTERED = re.compile(rf"{_PROPERTY}filter{_VALUE}")
_BLURRED = re.compile(r"\b(?:blur|drop-shadow)\s*\(")
_BLENDED = re.compile(rf"{_PROPERTY}mix-blend-mode{_VALUE}")
_LIGHTER = re.compile(rf"{_PROPERTY}mix-blend-mode\s*:\s*plus-")
_ANIMATED = re.compile(rf"{_PROPERTY}animation(?:-name)?{_VALUE}|@starting-style")
# The browsers are told that less motion is preferred.
_WELCOME = re.compile(r"@media\s*\(\s*prefers-reduced-motion\s*:\s*no-preference\s*\)\s*\{")
_CALL = re.compile(r"\b(\w++)\s*+\(([^()]*+)\)")
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
# Of the matrix's length: an element turned by so little is as true as one that is not.
_STRAIGHT = 1e-3

_Matrix = tuple[float, float, float, float]  # a b c d; where it moves to does not matter


def refuse_unsupported(svg: str, width: int, height: int, renderer: str) -> None:
    """Raise RendererError if the renderer draws wrongly what the SVG uses at width x height px.

    It says what that is, and which renderers draw it.
    """
    for uses, drawn_by in _limits(svg, width, height):
        if renderer not in drawn_by:
            raise RendererError(
                f"{renderer} cannot draw what the SVG uses: {uses}; needed is one of "
                f"{', '.join(drawn_by)}: try --renderer {drawn_by[0]}"
            )


def _limits(svg: str, width: int, height: int) -> Iterator[tuple[str, tuple[str, ...]]]:
    """What the file uses that some do not draw, and who does; cheap for a file without it."""
    lowered = svg.lower()
    if not any(word in lowered for word in _WORDS):
        return
    used = _uses(svg, width, height)
    if used.blur:
        drawn_by = DRAW_TURNED_BLURS
        if used.sheared:
            yield "a blur of turned or sheared shapes", drawn_by
        elif used.turned:
            yield "a blur of turned shapes", (*drawn_by, "resvg")
        else:
            yield "a blur", (*drawn_by, "resvg", "librsvg")
    if used.lighter:
        yield "mix-blend-mode: plus-lighter", BROWSERS
    if used.blended:
        yield "mix-blend-mode", DRAW_BLENDS
    if used.filter:
        yield "a filter", DRAW_BLENDS
    if used.plain_href:
        yield "href without xlink:", ("resvg", "cairo", *BROWSERS, "librsvg")
    if used.moving:
        yield "animation, drawn at some moment of it", ("resvg", "cairo", "librsvg", "inkscape")


@dataclass
class _Uses:
    """What of the table at the top a file uses.

    turned, sheared  whether a filtered element is, the latter so that circles are ellipses
    """

    blur: bool = False
    turned: bool = False
    sheared: bool = False
    filter: bool = False
    blended: bool = False
    lighter: bool = False
    plain_href: bool = False
    moving: bool = False

    def add_css(self, text: str) -> bool:
        """Add what a style sheet or attribute uses; whether it filters."""
        text = plain_css(text).lower()
        filtered = bool(_FILTERED.search(text))
        self.filter |= filtered
        self.blur |= filtered and bool(_BLURRED.search(text))
        self.lighter |= bool(_LIGHTER.search(text))
        self.blended |= bool(_BLENDED.search(text))
        self.moving |= bool(_ANIMATED.search(without_blocks(text, _WELCOME)))
        return filtered


class _Survey:
    """Takes a parser's events; titles and other text say nothing about what is drawn.

    Elements that `use` others count as filtered, and all do under a style sheet with filters.
    """

    def __init__(self, width: int, height: int) -> None:
        self.uses = _Uses()
        self._size = width, height
        self._matrices: list[_Matrix] = []
        self._sheet: list[str] | None = None
        self._by_sheet = False
        # Then also equal scales along x and y blur differently along them.
        self._uneven = False
        self._any_turned = self._any_sheared = False

    def start(self, name: str, attributes: dict[str, str]) -> None:
        tag, uses = name.rpartition(" ")[2], self.uses
        if not self._matrices:
            self._matrices = [_canvas(attributes.get("viewBox", ""), *self._size)]
        if tag == "style":
            self._sheet = []
        elif tag in _BLURS:
            uses.blur = True
            self._uneven |= len(_NUMBER.findall(attributes.get("stdDeviation", ""))) > 1
        elif tag in _MOVING:
            uses.moving = True
        elif tag in _LINKING:
            uses.plain_href |= "href" in attributes and _XLINK_HREF not in attributes
        self._uneven |= "objectBoundingBox" in attributes.values()
        filtered = tag == "use"
        for property_name in ("filter", "mix-blend-mode"):
            if property_name in attributes:
                filtered |= uses.add_css(f"{property_name}:{attributes[property_name]}")
        style = attributes.get("style", "")
        if style:
            filtered |= uses.add_css(style)
        self._transform(attributes.get("transform", ""), style, filtered)

    def _transform(self, transform: str, style: str, filtered: bool) -> None:
        matrix = self._matrices[-1]
        for text in (transform, style if "transform" in style else ""):
            matrix = _times(matrix, _parsed(text)) if text else matrix
        self._matrices.append(matrix)
        if not _is_straight(matrix):
            sheared = not _keeps_circles(matrix)
            self._any_turned, self._any_sheared = True, self._any_sheared or sheared
            if filtered:
                self.uses.turned, self.uses.sheared = True, self.uses.sheared or sheared

    def data(self, text: str) -> None:
        if self._sheet is not None:
            self._sheet.append(text)

    def end(self, name: str) -> None:
        self._matrices.pop()
        if self._sheet is not None and name.rpartition(" ")[2] == "style":
            self._by_sheet |= self.uses.add_css("".join(self._sheet))
            self._sheet = None

    def close(self) -> _Uses:
        if self._by_sheet:
            self.uses.turned, self.uses.sheared = self._any_turned, self._any_sheared
        self.uses.sheared |= self.uses.turned and self._uneven
        return self.uses


def _uses(svg: str, width: int, height: int) -> _Uses:
    survey = _Survey(width, height)
    # Whatever encoding it declares, it is text by now.
    parser = expat.ParserCreate("utf-8", " ")
    parser.StartElementHandler = survey.start
    parser.CharacterDataHandler = survey.data
    parser.EndElementHandler = survey.end
    try:
        parser.Parse(svg.encode(), True)
    except expat.ExpatError as error:
        raise RendererError(f"cannot draw the SVG: it is no XML, {error}; save it anew") from error
    return survey.close()


def _canvas(view_box: str, width: int, height: int) -> _Matrix:
    numbers = [float(n) for n in _NUMBER.findall(view_box)]
    if len(numbers) != 4 or numbers[2] <= 0 or numbers[3] <= 0:
        return 1.0, 0.0, 0.0, 1.0
    return width / numbers[2], 0.0, 0.0, height / numbers[3]


def _times(m: _Matrix, n: _Matrix) -> _Matrix:
    return (
        m[0] * n[0] + m[2] * n[1],
        m[1] * n[0] + m[3] * n[1],
        m[0] * n[2] + m[2] * n[3],
        m[1] * n[2] + m[3] * n[3],
    )


def _turn(v: list[float]) -> _Matrix:
    cosine, sine = math.cos(math.radians(v[0])), math.sin(math.radians(v[0]))
    return cosine, sine, -sine, cosine


_CALLS: dict[str, Callable[[list[float]], _Matrix]] = {
    "matrix": lambda v: (v[0], v[1], v[2], v[3]),
    "scale": lambda v: (v[0], 0.0, 0.0, v[-1]),
    "rotate": _turn,
    "skewX": lambda v: (1.0, 0.0, math.tan(math.radians(v[0])), 1.0),
    "skewY": lambda v: (1.0, math.tan(math.radians(v[0])), 0.0, 1.0),
}


def _parsed(transform: str) -> _Matrix:
    """The product of a transform list; what moves only, or cannot be read, is left out."""
    product: _Matrix = (1.0, 0.0, 0.0, 1.0)
    for name, text in _CALL.findall(transform):
        numbers = [float(n) for n in _NUMBER.findall(text)]
        if not all(map(math.isfinite, numbers)):
            raise RendererError(
                f"cannot draw the SVG: its transform {name}({text[:40]}) holds numbers beyond all "
                "that renderers compute with; needed are finite ones"
            )
        if name in _CALLS and len(numbers) >= (4 if name == "matrix" else 1):
            product = _times(product, _CALLS[name](numbers))
    return product


def _is_straight(m: _Matrix) -> bool:
    """Whether both axes stay along the axes, whichever is which."""
    allowed = _STRAIGHT * max(map(abs, m))
    return max(abs(m[1]), abs(m[2])) <= allowed or max(abs(m[0]), abs(m[3])) <= allowed


def _keeps_circles(m: _Matrix) -> bool:
    """Whether circles stay circles: turned, mirrored, scaled alike."""
    first, second = math.hypot(m[0], m[1]), math.hypot(m[2], m[3])
    longest = max(first, second)
    across = m[0] * m[2] + m[1] * m[3]
    allowed = _STRAIGHT * longest  # no power: it raises where a product is infinite
    return abs(first - second) <= allowed and abs(across) <= allowed * longest
