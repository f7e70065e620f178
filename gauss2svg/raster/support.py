"""Files with features that a renderer draws wrongly, refused so that no such image is measured."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from xml.parsers import expat

from gauss2svg.errors import InputError, RendererError
from gauss2svg.raster.css import declarations, first_word, statements
from gauss2svg.raster.features import Feature
from gauss2svg.raster.registry import drawn_by, renderer_named
from gauss2svg.svg.reader.affine import COUNTS, IDENTITY, Affine, affine_of, compose
from gauss2svg.svg.reader.values import NUMBER

# A file without any of these words has no such feature and is not parsed. Escapes of CSS
# and XML could hide a word.
_WORDS = (
    "filter", "blur", "shadow", "blend", "href", "mask", "animat", "discard", "starting-style",
    "<set", ":set", "\\", "&#",
)  # fmt: skip
_BLURS = ("feGaussianBlur", "feDropShadow")
_MOVING = ("animate", "animateTransform", "animateMotion", "animateColor", "set", "discard")
_LINKING = ("use", "image", "pattern", "filter", "linearGradient", "radialGradient")
_XLINK_HREF = "http://www.w3.org/1999/xlink href"
_UNUSED = ("none", "normal", "inherit", "initial", "unset")  # values that switch a property off
# CSS without any of these is not parsed; an escape could hide a word.
_CSS_WORDS = ("filter", "blend", "animation", "starting-style", "\\")
_CALL = re.compile(r"\b(\w++)\s*+\(([^()]*+)\)")
_NUMBER = re.compile(NUMBER)
# Of the matrix's norm: so small a rotation has no visible effect.
_STRAIGHT = 1e-3

_KINDS = {kind.lower(): kind for kind in COUNTS}


def refuse_unsupported(svg: str, width: int, height: int, renderer: str) -> None:
    """Raise RendererError if the renderer draws the SVG wrongly at width x height px.

    The error names the feature and the renderers that draw it.
    """
    cannot = renderer_named(renderer).CANNOT_DRAW
    for feature in _features(svg, width, height):
        if feature in cannot:
            known = drawn_by(feature)
            raise RendererError(
                f"renderer must be one of {', '.join(known)} for what the SVG uses, {feature}; got "
                f"{renderer}. Try --renderer {known[0]}"
            )


def _features(svg: str, width: int, height: int) -> Iterator[Feature]:
    """Features of the file that some renderers do not draw."""
    lowered = svg.lower()
    if not any(word in lowered for word in _WORDS):
        return
    used = _uses(svg, width, height)
    if used.blur:
        rotated = Feature.ROTATED_BLUR if used.rotated else Feature.BLUR
        yield Feature.SKEWED_BLUR if used.skewed else rotated
    if used.lighter:
        yield Feature.LIGHTER
    if used.blended:
        yield Feature.BLEND
    if used.filter:
        yield Feature.FILTER
    if used.plain_href:
        yield Feature.PLAIN_HREF
    if used.masked:
        yield Feature.MASK
    if used.moving:
        yield Feature.MOVING


@dataclass
class _Uses:
    """What a file uses.

    rotated, skewed  whether a filtered element is; skewed: so that circles become ellipses
    """

    blur: bool = False
    rotated: bool = False
    skewed: bool = False
    filter: bool = False
    blended: bool = False
    lighter: bool = False
    plain_href: bool = False
    masked: bool = False
    moving: bool = False

    def add_css(self, text: str, is_sheet: bool = False) -> bool:
        """Add the features of a style sheet or attribute; returns whether it filters."""
        found = _features_of(text, is_sheet)
        for feature in found:
            setattr(self, feature, True)
        return "filter" in found


@lru_cache(maxsize=32)  # shapes share their filters
def _features_of(css: str, is_sheet: bool) -> frozenset[str]:
    """Names of the fields of _Uses that are True for a style sheet or attribute."""
    lowered = css.lower()
    if not any(word in lowered for word in _CSS_WORDS):
        return frozenset()
    found = set()
    for node in statements(css, is_sheet):
        if node.type == "at-rule":
            found |= {"moving"} if node.lower_at_keyword == "starting-style" else set()
            continue
        name, first = node.lower_name.removeprefix("-webkit-"), first_word(node.value)
        if first in _UNUSED:
            continue
        if name == "filter":
            functions = {t.lower_name for t in node.value if t.type == "function"}
            found |= {"filter", "blur"} if functions & {"blur", "drop-shadow"} else {"filter"}
        elif name == "mix-blend-mode":
            found |= {"blended", "lighter"} if first.startswith("plus-") else {"blended"}
        elif name in ("animation", "animation-name"):
            found.add("moving")
    return frozenset(found)


class _Survey:
    """Target of a parser's events.

    `use` elements count as filtered, and under a style sheet with filters all elements do.
    """

    def __init__(self, width: int, height: int) -> None:
        self.uses = _Uses()
        self._size = width, height
        self._matrices: list[Affine] = []
        self._sheet: list[str] | None = None
        self._by_sheet = False
        # Whether a blur differs along x and y even where the scales are equal.
        self._uneven = False
        self._any_rotated = self._any_skewed = False

    def start(self, name: str, attributes: dict[str, str]) -> None:
        tag, uses = name.rpartition(" ")[2], self.uses
        if not self._matrices:
            self._matrices = [_canvas(attributes.get("viewBox", ""), *self._size)]
        if tag == "style":
            self._sheet = []
        elif tag in _BLURS:
            uses.blur = True
            self._uneven |= len(_NUMBER.findall(attributes.get("stdDeviation", ""))) > 1
        elif tag == "mask":
            uses.masked = True
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
        if transform:
            matrix = compose(matrix, _product(_attribute_calls(transform)))
        if "transform" in style.lower():
            matrix = compose(matrix, _product(_style_calls(style)))
        self._matrices.append(matrix)
        if not _is_straight(matrix):
            skewed = not _keeps_circles(matrix)
            self._any_rotated, self._any_skewed = True, self._any_skewed or skewed
            if filtered:
                self.uses.rotated, self.uses.skewed = True, self.uses.skewed or skewed

    def data(self, text: str) -> None:
        if self._sheet is not None:
            self._sheet.append(text)

    def end(self, name: str) -> None:
        self._matrices.pop()
        if self._sheet is not None and name.rpartition(" ")[2] == "style":
            self._by_sheet |= self.uses.add_css("".join(self._sheet), is_sheet=True)
            self._sheet = None

    def close(self) -> _Uses:
        if self._by_sheet:
            self.uses.rotated, self.uses.skewed = self._any_rotated, self._any_skewed
        self.uses.skewed |= self.uses.rotated and self._uneven
        return self.uses


def _uses(svg: str, width: int, height: int) -> _Uses:
    survey = _Survey(width, height)
    # The text is decoded already, whatever encoding it declares.
    parser = expat.ParserCreate("utf-8", " ")
    parser.StartElementHandler = survey.start
    parser.CharacterDataHandler = survey.data
    parser.EndElementHandler = survey.end
    try:
        parser.Parse(svg.encode(), True)
    except InputError as error:
        raise RendererError(f"cannot draw the SVG: {error}") from error
    except expat.ExpatError as error:
        raise RendererError(
            f"cannot draw the SVG: it must be well-formed XML; got {error}. Try to re-save it"
        ) from error
    return survey.close()


def _canvas(view_box: str, width: int, height: int) -> Affine:
    numbers = [float(n) for n in _NUMBER.findall(view_box)]
    if len(numbers) != 4 or numbers[2] <= 0 or numbers[3] <= 0:
        return IDENTITY
    return width / numbers[2], 0.0, 0.0, height / numbers[3], 0.0, 0.0


_DEGREES = {"grad": 0.9, "rad": math.degrees(1), "turn": 360.0}


def _attribute_calls(transform: str) -> Iterator[tuple[str, list[float]]]:
    """Functions of a transform attribute by name, with their numbers."""
    for name, text in _CALL.findall(transform):
        yield name.lower(), [float(n) for n in _NUMBER.findall(text)]


def _style_calls(style: str) -> Iterator[tuple[str, list[float]]]:
    """Functions of the transform property of a style, with their numbers; angles in degrees."""
    for declaration in declarations(style):
        for call in declaration.value if declaration.lower_name == "transform" else ():
            if call.type == "function":
                numbers = (n for n in call.arguments if n.type in ("number", "dimension"))
                factor = _DEGREES.get
                yield (
                    call.lower_name,
                    [n.value * factor(getattr(n, "lower_unit", ""), 1.0) for n in numbers],
                )


def _product(calls: Iterator[tuple[str, list[float]]]) -> Affine:
    """The product of a transform list; functions that are unknown or incomplete are left out."""
    product = IDENTITY
    for name, numbers in calls:
        if not all(map(math.isfinite, numbers)):
            raise RendererError(
                f"transform of the SVG must have finite numbers; got {name} of {numbers[:6]}. Try "
                "smaller ones"
            )
        kind = _KINDS.get(name, "")
        count = max((n for n in COUNTS.get(kind, ()) if n <= len(numbers)), default=0)
        if count:
            product = compose(product, affine_of(kind, numbers[:count]))
    return product


def _is_straight(m: Affine) -> bool:
    """Whether both axes stay along axes, swapped or not."""
    allowed = _STRAIGHT * max(map(abs, m))
    return max(abs(m[1]), abs(m[2])) <= allowed or max(abs(m[0]), abs(m[3])) <= allowed


def _keeps_circles(m: Affine) -> bool:
    """Whether circles stay circles: rotated, mirrored, uniformly scaled."""
    first, second = math.hypot(m[0], m[1]), math.hypot(m[2], m[3])
    longest = max(first, second)
    across = m[0] * m[2] + m[1] * m[3]
    allowed = _STRAIGHT * longest  # not longest**2, which raises on overflow
    return abs(first - second) <= allowed and abs(across) <= allowed * longest
