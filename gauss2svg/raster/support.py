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
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator
from xml.parsers import expat

from gauss2svg.errors import RendererError

_BROWSERS = ("chromium", "firefox")
DRAW_TURNED_BLURS = (*_BROWSERS, "inkscape")
_BLUR_WORDS = ("feGaussianBlur", "feDropShadow", "blur(", "drop-shadow(")
_FILTERED = re.compile(r"""\bfilter\s*[=:]\s*["']?\s*(?!none\b|inherit\b|initial\b)[a-z]""")
_BLENDED = re.compile(r"mix-blend-mode\s*:\s*(?!normal\b)[a-z]")
_LIGHTER = re.compile(r"mix-blend-mode\s*:\s*plus-")
_PLAIN_HREF = re.compile(
    r"<(?:use|image|pattern|filter|linearGradient|radialGradient)\b(?![^>]*xlink:href)[^>]*\shref="
)
_TWO_DEVIATIONS = re.compile(r"""stdDeviation\s*=\s*["']\s*[^"'\s,]+[\s,]+[^"'\s]""")
_CALL = re.compile(r"(\w+)\s*\(([^)]*)\)")
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
    if any(word in svg for word in _BLUR_WORDS):
        drawn_by = DRAW_TURNED_BLURS
        turned, sheared = _blurred_matrices(svg, width, height)
        if sheared:
            yield "a blur of turned or sheared shapes", drawn_by
        elif turned:
            yield "a blur of turned shapes", (*drawn_by, "resvg")
        else:
            yield "a blur", (*drawn_by, "resvg", "librsvg")
    if "filter" in svg and _FILTERED.search(svg):
        yield "a filter", ("resvg", *_BROWSERS, "librsvg", "inkscape")
    if "mix-blend-mode" in svg:
        if _LIGHTER.search(svg):
            yield "mix-blend-mode: plus-lighter", _BROWSERS
        if _BLENDED.search(svg):
            yield "mix-blend-mode", ("resvg", *_BROWSERS, "librsvg", "inkscape")
    if " href=" in svg and _PLAIN_HREF.search(svg):
        yield "href without xlink:", ("resvg", "cairo", *_BROWSERS, "librsvg")


def _blurred_matrices(svg: str, width: int, height: int) -> tuple[bool, bool]:
    """Whether any filtered element is turned, and whether so that circles are ellipses.

    Elements that `use` others count as filtered, and all do under a style sheet with filters.
    """
    stack: list[_Matrix] = [_canvas(svg, width, height)]
    # Then also equal scales along x and y blur differently along them.
    uneven = "objectBoundingBox" in svg or bool(_TWO_DEVIATIONS.search(svg))
    by_sheet = any("filter" in rest.partition("</style")[0] for rest in svg.split("<style")[1:])
    turned = sheared = False

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal turned, sheared
        matrix = stack[-1]
        style = attributes.get("style", "")
        for text in (attributes.get("transform", ""), style if "transform" in style else ""):
            matrix = _times(matrix, _parsed(text)) if text else matrix
        stack.append(matrix)
        if not (by_sheet or "filter" in attributes or "filter" in style or name == "use"):
            return
        if not _is_straight(matrix):
            turned = True
            sheared = sheared or uneven or not _keeps_circles(matrix)

    parser = expat.ParserCreate()
    parser.StartElementHandler = start
    parser.EndElementHandler = lambda name: stack.pop()
    try:
        parser.Parse(svg.encode(), True)
    except expat.ExpatError as error:
        raise RendererError(f"cannot draw the SVG: it is no XML, {error}") from error
    return turned, sheared


def _canvas(svg: str, width: int, height: int) -> _Matrix:
    found = re.search(r"""viewBox\s*=\s*["']([^"']*)""", svg)
    numbers = [float(n) for n in _NUMBER.findall(found[1])] if found else []
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
    return abs(first - second) <= _STRAIGHT * longest and abs(across) <= _STRAIGHT * longest**2
