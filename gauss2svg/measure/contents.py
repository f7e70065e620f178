"""What the elements of an SVG do that no tag tells: how shapes get colours, softness and places."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from gauss2svg.svg.reader.gradient import HREFS
from gauss2svg.svg.syntax.css import color_alpha
from gauss2svg.svg.syntax.values import pixels_of, reference

# What is in these is drawn where something refers to it, if at all.
_DEFINING = ("defs", "symbol", "mask", "clipPath", "pattern", "marker")
_COLORED = ("color", "fill", "stroke", "stop-color", "flood-color", "lighting-color")
_TRANSFORMING = re.compile(r"(?<![\w-])transform\s*:", re.IGNORECASE)
_STOP_OPACITY = re.compile(r"stop-opacity\s*:([^;}!]*)", re.IGNORECASE)
_PLACING = ("cx", "cy", "r", "x1", "y1", "x2", "y2")
_NONE = ("", "none")
_LONGEST_CHAIN = 100  # of elements that refer to each other, maybe in a circle


@dataclass(frozen=True)
class _Drawn:
    """How an element is drawn: under a mask, by the gradients of these ids, as the one it uses."""

    masked: bool
    gradients: tuple[str, ...]
    used: str


@dataclass
class _Gradient:
    """The gradient from which it takes what it does not have itself, and what it has."""

    template: str
    is_placed: bool = False
    stops: int = 0
    translucent: bool = False


class Contents:
    """Counts of what a document does, as an observer of its elements; sheets are read roughly.

    A mask of a group counts once, and a `use` is drawn as the one element that it names.
    """

    def __init__(self) -> None:
        self._counts: Counter[str] = Counter()
        self._most_stops = 0
        self._gradient = _Gradient("")  # whose stops are read
        self._gradients: dict[str, _Gradient] = {}
        self._drawn: list[_Drawn] = []
        self._named: dict[str, _Drawn] = {}
        self._defining = math.inf  # depth of the element that defines what the present one is in
        self._sheets_soften = False

    @property
    def counts(self) -> Mapping[str, int]:
        """Numbers by what they are of.

        masked shapes        shapes and groups that are drawn under a mask
        soft shapes          those, and shapes with a gradient that lets something through
        stops of a gradient  of the one with the most
        borrowed places      gradients that take their place from another
        style sheet, transform, currentColor  sheets, and attributes or properties
        """
        masked = soft = 0
        for shape in self._drawn:
            chain = self._chain(shape)
            under = any(one.masked for one in chain)
            masked += under
            soft += under or any(self._is_soft(name) for one in chain for name in one.gradients)
        return {
            **self._counts,
            "masked shapes": masked,
            "soft shapes": soft,
            "stops of a gradient": self._most_stops,
            "borrowed places": sum(map(self._is_borrowed, self._gradients.values())),
        }

    def start(self, tag: str, attributes: dict[str, str], depth: int) -> None:
        """Add an element."""
        local = tag.rpartition("}")[2]
        own = _properties(attributes)
        self._counts["transform"] += own.get("transform", "") not in _NONE
        self._counts["currentColor"] += any(
            "currentcolor" in own.get(name, "").lower() for name in _COLORED
        )
        if depth <= self._defining:
            self._defining = depth if local in _DEFINING else math.inf
        href = next((own[name] for name in HREFS if name in own), "").strip().removeprefix("#")
        if local.endswith("Gradient"):
            self._gradient = _Gradient(href, any(name in own for name in _PLACING))
            if own.get("id"):  # others cannot be named
                self._gradients[own["id"]] = self._gradient
        elif local == "stop":
            gradient = self._gradient
            gradient.stops += 1
            self._most_stops = max(self._most_stops, gradient.stops)
            gradient.translucent |= _is_translucent(
                own.get("stop-color", ""), own.get("stop-opacity", "")
            )
        else:
            paints = (reference(own.get(name, "")) for name in ("fill", "stroke"))
            shape = _Drawn(
                own.get("mask", "") not in _NONE,
                tuple(name for name in paints if name is not None),
                href if local == "use" else "",
            )
            if shape != _PLAIN:
                if own.get("id"):
                    self._named[own["id"]] = shape
                if self._defining == math.inf:
                    self._drawn.append(shape)

    def sheet(self, text: str) -> None:
        """Add a style sheet."""
        self._counts["style sheet"] += 1
        self._counts["transform"] += len(_TRANSFORMING.findall(text))
        self._counts["currentColor"] += "currentcolor" in text.lower()
        self._sheets_soften |= any(_is_translucent("", one) for one in _STOP_OPACITY.findall(text))

    def _chain(self, shape: _Drawn) -> list[_Drawn]:
        """An element, the one that it uses, and so on."""
        chain = [shape]
        while len(chain) < _LONGEST_CHAIN and (used := self._named.get(chain[-1].used)) is not None:
            chain.append(used)
        return chain

    def _is_soft(self, name: str) -> bool:
        """Whether a gradient lets something through; with such a sheet any may."""
        gradient = self._gradients.get(name)
        for _ in range(_LONGEST_CHAIN):
            if gradient is None or gradient.stops:
                break
            gradient = self._gradients.get(gradient.template)
        return gradient is not None and (gradient.translucent or self._sheets_soften)

    def _is_borrowed(self, gradient: _Gradient) -> bool:
        """Whether a gradient takes its place from the one that it names."""
        template = self._gradients.get(gradient.template)
        return template is not None and template.is_placed and not gradient.is_placed


_PLAIN = _Drawn(masked=False, gradients=(), used="")


def _properties(attributes: dict[str, str]) -> dict[str, str]:
    """Attributes, and the properties of the style, which win; they are split by hand, for speed."""
    if "style" not in attributes:
        return attributes
    parts = (part.partition(":") for part in attributes["style"].split(";"))
    styled = {name.strip().lower(): value.partition("!")[0].strip() for name, _, value in parts}
    return {**attributes, **styled}


@lru_cache(maxsize=1024)  # gradients share their stops
def _is_translucent(color: str, opacity: str) -> bool:
    """Whether a stop lets something through; what cannot be read is opaque."""
    share = pixels_of(opacity.strip(), 1.0)
    return color_alpha(color) < 1 or (share is not None and share < 1)
