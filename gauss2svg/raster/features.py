"""Features of SVG that some renderers draw wrongly, and which of them a file uses.

Each renderer states its own as CANNOT_DRAW.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from enum import StrEnum
from functools import lru_cache
from typing import Any

from gauss2svg.errors import RendererError
from gauss2svg.svg.syntax.affine import COUNTS, IDENTITY, Affine, affine_of, compose
from gauss2svg.svg.syntax.css import declarations, nodes_of, words, written
from gauss2svg.svg.syntax.parse import ANIMATIONS, HREFS
from gauss2svg.svg.syntax.values import NUMBER

_Box = tuple[float, ...]


class Feature(StrEnum):
    """A feature, as an error names it.

    A blurred element counts as skewed where it is rotated or skewed and not uniformly scaled, so
    that circles become ellipses, and as rotated where it is turned other than by right angles.
    Animation is that which also runs under prefers-reduced-motion; without it a file is drawn as it
    is written.
    """

    SKEWED_BLUR = "a blur of rotated or skewed shapes"
    ROTATED_BLUR = "a blur of rotated shapes"
    BLUR = "a blur"
    LIGHTER = "mix-blend-mode: plus-lighter"
    BLEND = "mix-blend-mode"
    FILTER = "a filter"
    PLAIN_HREF = "href without xlink:"
    MASK = "a mask"
    MOVING = "animation, drawn at some moment of it"


# Without any of these words there is no such feature; escapes of CSS and XML could hide one.
_WORDS = (
    "filter", "blur", "shadow", "blend", "href", "mask", "animat", "discard", "starting-style",
    "<set", ":set", "\\", "&#",
)  # fmt: skip
_ELEMENTS = {
    **dict.fromkeys(ANIMATIONS, Feature.MOVING),
    "feGaussianBlur": Feature.BLUR,
    "feDropShadow": Feature.BLUR,
    "mask": Feature.MASK,
}
_BLURRED = (Feature.BLUR, Feature.ROTATED_BLUR, Feature.SKEWED_BLUR)
_LINKING = ("use", "image", "pattern", "filter", "linearGradient", "radialGradient")
_UNUSED = ("none", "normal", "inherit", "initial", "unset")  # values that switch a property off
# CSS without any of these is not parsed; an escape could hide a word.
_CSS_WORDS = ("filter", "blend", "animation", "starting-style", "\\")
_NEEDS_MOTION = "(prefers-reduced-motion:no-preference)"
_CALL = re.compile(r"\b(\w++)\s*+\(([^()]*+)\)")
_NUMBER = re.compile(NUMBER)
_ANGLE = re.compile(rf"({NUMBER})(grad|rad|turn)", re.IGNORECASE)
_DEGREES = {"grad": 0.9, "rad": math.degrees(1), "turn": 360.0}
# Of the matrix's norm: so small a rotation has no visible effect.
_STRAIGHT = 1e-3

_KINDS = {kind.lower(): kind for kind in COUNTS}


def _box(root: Mapping[str, str]) -> _Box | None:
    found = [float(number) for number in _NUMBER.findall(root.get("viewBox", ""))]
    return tuple(found) if len(found) == 4 and min(found[2:]) > 0 else None


def may_have_features(svg: str) -> bool:
    """Whether a file has any word of a feature: in one without, elements need not be looked at."""
    lowered = svg.lower()
    return any(word in lowered for word in _WORDS)


class Features:
    """What a document uses that some renderers do not draw, at width x height px.

    view_box  x, y, width and height of the visible part, of the root's attributes; None where they
              have none

    `use` elements count as filtered, and under a style sheet with filters all elements do.
    """

    def __init__(
        self, width: int, height: int, view_box: Callable[[Mapping[str, str]], _Box | None] = _box
    ) -> None:
        self._width, self._height, self._view_box = width, height, view_box
        self._used: set[Feature] = set()
        # To px from what the last element is in, and how they turn.
        self._maps: list[tuple[Affine, int]] = []
        self._by_sheet = False
        # Whether a blur differs along x and y even where the scales are equal.
        self._uneven = False
        self._turned = self._any_turned = 0  # the largest index in _BLURRED

    @property
    def used(self) -> set[Feature]:
        """What the elements and style sheets so far use."""
        if Feature.BLUR not in self._used:
            return self._used
        turned = self._any_turned if self._by_sheet else self._turned
        return self._used - {Feature.BLUR} | {_BLURRED[2 if turned and self._uneven else turned]}

    def start(self, tag: str, attributes: dict[str, str], depth: int) -> None:
        """Add the features of an element, and how much it is turned."""
        if not depth:
            box = self._view_box(attributes)
            canvas = (self._width / box[2], 0, 0, self._height / box[3], 0, 0) if box else IDENTITY
            self._maps = [(canvas, 0)]
        tag, style = tag.rpartition("}")[2], attributes.get("style", "")
        if tag in _ELEMENTS:
            self._used.add(_ELEMENTS[tag])
            self._uneven |= len(_NUMBER.findall(attributes.get("stdDeviation", ""))) > 1
        elif tag in _LINKING and HREFS[0] in attributes and HREFS[1] not in attributes:
            self._used.add(Feature.PLAIN_HREF)
        self._uneven |= "objectBoundingBox" in attributes.values()
        filtered = tag == "use"
        for name in ("filter", "mix-blend-mode"):
            if name in attributes:
                filtered |= self._add_css(f"{name}:{attributes[name]}")
        if style:
            filtered |= self._add_css(style)
        del self._maps[depth + 1 :]
        matrix, turned = self._maps[-1]
        transforms = [attributes["transform"]] if "transform" in attributes else []
        if "transform" in style.lower():
            found = declarations(style)
            found = [written(one.value) for one in found if one.lower_name == "transform"]
            transforms += [_ANGLE.sub(_in_degrees, text) for text in found]
        for transform in transforms:
            matrix = compose(matrix, _product(transform))
        if transforms or not depth:
            turned = _turn_of(matrix)
        self._maps.append((matrix, turned))
        if turned:
            self._any_turned = max(self._any_turned, turned)
            self._turned = max(self._turned, turned if filtered else 0)

    def sheet(self, text: str) -> None:
        """Add the features of a style sheet."""
        self._by_sheet |= self._add_css(text, is_sheet=True)

    def _add_css(self, text: str, is_sheet: bool = False) -> bool:
        """Add the features of a style sheet or attribute; returns whether it filters."""
        found = _features_of(text, is_sheet)
        self._used |= found
        return Feature.FILTER in found


@lru_cache(maxsize=32)  # shapes share their filters
def _features_of(css: str, is_sheet: bool) -> frozenset[Feature]:
    """Features of a style sheet or attribute, at any depth.

    What applies only where the viewer accepts motion is left out: renderers are started with
    reduced motion.
    """
    lowered = css.lower()
    if not any(word in lowered for word in _CSS_WORDS):
        return frozenset()
    found = set()
    for node in nodes_of(css, is_sheet, lambda node: not _needs_motion(node)):
        if node.type == "at-rule" and node.lower_at_keyword == "starting-style":
            found.add(Feature.MOVING)
        if node.type != "declaration":
            continue
        name, first = node.lower_name.removeprefix("-webkit-"), _first_word(node.value)
        if first in _UNUSED:
            continue
        if name == "filter":
            functions = {t.lower_name for t in node.value if t.type == "function"}
            blurs = functions & {"blur", "drop-shadow"}
            found |= {Feature.FILTER, Feature.BLUR} if blurs else {Feature.FILTER}
        elif name == "mix-blend-mode":
            found |= {Feature.BLEND, Feature.LIGHTER} if first[:5] == "plus-" else {Feature.BLEND}
        elif name in ("animation", "animation-name"):
            found.add(Feature.MOVING)
    return frozenset(found)


def _first_word(value: list[Any]) -> str:
    """The first word of a value; "" for what is not a word, "none" for an empty value."""
    for token in words(value):
        return token.lower_value if token.type == "ident" else ""
    return "none"


def _needs_motion(node: Any) -> bool:
    is_media = node.type == "at-rule" and node.lower_at_keyword == "media"
    return is_media and written(node.prelude).lower() == _NEEDS_MOTION


def _in_degrees(angle: re.Match[str]) -> str:
    return repr(float(angle[1]) * _DEGREES[angle[2].lower()])


def _product(transform: str) -> Affine:
    """The product of a transform list; functions that are unknown or incomplete are left out."""
    product = IDENTITY
    for name, inside in _CALL.findall(transform.lower()):
        numbers = [float(number) for number in _NUMBER.findall(inside)]
        if not all(map(math.isfinite, numbers)):
            raise RendererError(
                f"transform of the SVG must have finite numbers; got {name} of "
                f"{numbers[:6]}. Try smaller ones"
            )
        kind = _KINDS.get(name, "")
        count = max((n for n in COUNTS.get(kind, ()) if n <= len(numbers)), default=0)
        if count:
            product = compose(product, affine_of(kind, numbers[:count]))
    return product


def _turn_of(m: Affine) -> int:
    """0 where both axes stay along axes, swapped or not, 1 where circles stay circles, else 2."""
    allowed = _STRAIGHT * max(map(abs, m))
    if max(abs(m[1]), abs(m[2])) <= allowed or max(abs(m[0]), abs(m[3])) <= allowed:
        return 0
    first, second = math.hypot(m[0], m[1]), math.hypot(m[2], m[3])
    longest = max(first, second)
    allowed = _STRAIGHT * longest  # not longest**2, which raises on overflow
    across = abs(m[0] * m[2] + m[1] * m[3])
    return 1 if abs(first - second) <= allowed and across <= allowed * longest else 2
