"""Features of SVG that some renderers draw wrongly, and which of them a file uses.

Each renderer states its own as CANNOT_DRAW.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from enum import StrEnum
from functools import lru_cache
from typing import Any

from gauss2svg.errors import InputError
from gauss2svg.svg.syntax import values
from gauss2svg.svg.syntax.parse import ANIMATIONS, HREFS
from gauss2svg.svg.syntax.values import IDENTITY, Affine

_Box = tuple[float, float, float, float]


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
_BLURS = {"blur", "drop-shadow"}  # functions of CSS
_LINKING = ("use", "image", "pattern", "filter", "linearGradient", "radialGradient")
_PROPERTIES = ("filter", "mix-blend-mode")  # which attributes can have
_UNUSED = ("none", "normal", "inherit", "initial", "unset")  # values that switch a property off
_NEEDS_MOTION = "(prefers-reduced-motion:no-preference)"
_CSS_TRANSFORM = re.compile(r"(?<![\w-])(transform|rotate|scale|translate)\s*:|\\", re.IGNORECASE)
_STRAIGHT = 1e-3  # share of a matrix's norm; a smaller rotation has no visible effect
_SKEW: Affine = (1.0, 0.0, 1.0, 1.0, 0.0, 0.0)  # stands for a transform that is not read


def _box(root: Mapping[str, str]) -> _Box | None:
    with suppress(InputError):
        return values.view_box(root.get("viewBox", ""))
    return None


def may_have_features(text: str) -> bool:
    """Whether a file, or CSS of it, has any word of a feature; without one none is looked for."""
    lowered = text.lower()
    return any(word in lowered for word in _WORDS)


class Features:
    """An observer that notes what a document uses that some renderers draw wrongly.

    view_box  returns x, y, width and height of the visible part by the root's attributes, or None
              where they have none

    Each `use` counts as filtered, and under a style sheet with filters every element does.
    """

    def __init__(
        self, width: int, height: int, view_box: Callable[[Mapping[str, str]], _Box | None] = _box
    ) -> None:
        self._width, self._height, self._view_box = width, height, view_box
        self._used: set[Feature] = set()
        self._maps: list[Affine] = []  # to px, of the last element and those that it is in
        self._sheet_filters = False
        self._is_uneven = False  # whether a blur can differ along x and y at equal scales
        self._turned = self._filtered_turned = 0  # largest index in _BLURRED

    @property
    def used(self) -> set[Feature]:
        """Features of the elements and style sheets so far."""
        if Feature.BLUR not in self._used:
            return self._used
        turned = self._turned if self._sheet_filters else self._filtered_turned
        blur = _BLURRED[2 if turned and self._is_uneven else turned]
        return self._used - {Feature.BLUR} | {blur}

    def start(self, tag: str, attributes: dict[str, str], depth: int) -> None:
        """Add the features of an element, and how it is turned."""
        tag, style = tag.rpartition("}")[2], attributes.get("style", "")
        if tag in _ELEMENTS:
            self._used.add(_ELEMENTS[tag])
            self._is_uneven |= len(attributes.get("stdDeviation", "").replace(",", " ").split()) > 1
        elif tag in _LINKING and HREFS[0] in attributes and HREFS[1] not in attributes:
            self._used.add(Feature.PLAIN_HREF)
        self._is_uneven |= "objectBoundingBox" in attributes.values()
        own = [f"{name}:{attributes[name]}" for name in _PROPERTIES if name in attributes]
        is_filtered = self._add_css(style, *own) or tag == "use"
        del self._maps[depth:]
        matrix = self._maps[-1] if depth else self._canvas(attributes)
        if "transform" in attributes or _CSS_TRANSFORM.search(style):
            matrix = values.compose(matrix, _own_map(attributes.get("transform", "none"), style))
        self._maps.append(matrix)
        self._turned = max(self._turned, turned := _turn_of(matrix))
        if is_filtered:
            self._filtered_turned = max(self._filtered_turned, turned)

    def sheet(self, text: str) -> None:
        """Add the features of a style sheet."""
        self._sheet_filters |= self._add_css(text, is_sheet=True)

    def _canvas(self, root: dict[str, str]) -> Affine:
        box = self._view_box(root)
        return (self._width / box[2], 0, 0, self._height / box[3], 0, 0) if box else IDENTITY

    def _add_css(self, *texts: str, is_sheet: bool = False) -> bool:
        """Add the features of a style sheet or attributes, and return whether they filter."""
        found = {feature for text in texts for feature in _features_of(text, is_sheet)}
        self._used |= found
        return Feature.FILTER in found


@lru_cache(maxsize=32)  # shapes share their filters
def _features_of(css: str, is_sheet: bool) -> frozenset[Feature]:
    """Features of a style sheet or attribute, at any depth.

    What applies only where the viewer accepts motion is left out: renderers are started with
    reduced motion.
    """
    if not may_have_features(css):
        return frozenset()
    found = set()
    for node in values.nodes_of(css, is_sheet, _accepts_no_motion):
        if node.type == "at-rule" and node.lower_at_keyword == "starting-style":
            found.add(Feature.MOVING)
        if node.type != "declaration":
            continue
        name = node.lower_name.removeprefix("-webkit-")
        token = next(iter(values.words(node.value)), None)
        first = token.lower_value if token is not None and token.type == "ident" else ""
        if token is None or first in _UNUSED:
            continue
        if name == "filter":
            functions = {t.lower_name for t in node.value if t.type == "function"}
            found |= {Feature.FILTER, *([Feature.BLUR] if functions & _BLURS else [])}
        elif name == "mix-blend-mode":
            found |= {Feature.BLEND, *([Feature.LIGHTER] if first[:5] == "plus-" else [])}
        elif name in ("animation", "animation-name"):
            found.add(Feature.MOVING)
    return frozenset(found)


def _accepts_no_motion(node: Any) -> bool:
    is_media = node.type == "at-rule" and node.lower_at_keyword == "media"
    return not (is_media and values.written(node.prelude).lower() == _NEEDS_MOTION)


def _own_map(transform: str, style: str) -> Affine:
    """Return the map of an element, or a skew where CSS transforms it or the list is invalid."""
    if not _CSS_TRANSFORM.search(style):
        with suppress(InputError):
            return values.parse_transform(transform)
    return _SKEW


def _turn_of(m: Affine) -> int:
    """0 where both axes stay along axes, swapped or not, 1 where circles stay circles, else 2."""
    a, b, c, d = m[:4]
    allowed = _STRAIGHT * max(math.hypot(a, b), math.hypot(c, d))
    off_axes = min(max(abs(b), abs(c)), max(abs(a), abs(d)))
    off_circle = min(math.hypot(a - d, b + c), math.hypot(a + d, b - c))  # turned, or mirrored too
    return 0 if off_axes <= allowed else 1 if off_circle <= allowed else 2
