"""What the elements of an SVG do that no tag tells: how shapes get colours, softness and places."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TypeVar

from gauss2svg.svg.syntax.css import color_alpha, without_comments
from gauss2svg.svg.syntax.parse import HREFS
from gauss2svg.svg.syntax.values import pixels_of, reference

# What is in these is drawn where something refers to it, if at all.
_DEFINING = ("defs", "symbol", "mask", "clipPath", "pattern", "marker")
_COLORED = ("color", "fill", "stroke", "stop-color", "flood-color", "lighting-color")
_TRANSFORMING = re.compile(r"(?<![\w-])transform\s*:(?!\s*(?:none\s*)?(?:[;!}]|\Z))", re.IGNORECASE)
_STOP_OPACITY = re.compile(r"stop-opacity\s*:([^;}!]*)", re.IGNORECASE)
_PLACING = ("cx", "cy", "r", "x1", "y1", "x2", "y2")
_URL = re.compile(r"\s*url\(", re.IGNORECASE)


@dataclass(frozen=True)
class _Drawn:
    """How an element is drawn: as the one that it names, masked, by gradients of these ids."""

    named: str
    masked: bool
    gradients: frozenset[str]

    def only(self, gradients: set[str]) -> _Drawn:
        """The same, of its gradients with these alone."""
        return replace(self, gradients=self.gradients & gradients)


@dataclass
class _Gradient:
    """The gradient from which it takes what it does not have itself, and what it has."""

    named: str
    placed: frozenset[str] = frozenset()
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
        borrowed places      gradients that take their place from another, or a part of it
        style sheet, transform, currentColor  sheets, and attributes or properties
        """
        gradients = _whole(self._gradients, _by_template)
        # With such a sheet any gradient may let something through.
        clear = {
            name
            for name, one in gradients.items()
            if one.translucent or (one.stops and self._sheets_soften)
        }
        named = {name: shape.only(clear) for name, shape in self._named.items()}
        used = _whole(named, _as_used)
        drawn = [_joined(shape.only(clear), used, _as_used) for shape in self._drawn]
        return {
            **self._counts,
            "masked shapes": sum(shape.masked for shape in drawn),
            "soft shapes": sum(shape.masked or bool(shape.gradients) for shape in drawn),
            "stops of a gradient": self._most_stops,
            "borrowed places": sum(
                gradients[name].placed != one.placed for name, one in self._gradients.items()
            ),
        }

    def start(self, tag: str, attributes: dict[str, str], depth: int) -> None:
        """Add an element."""
        local = tag.rpartition("}")[2]
        own = _properties(attributes)
        self._counts["transform"] += _is_given(own, "transform")
        self._counts["currentColor"] += any(
            "currentcolor" in own.get(name, "").lower() for name in _COLORED
        )
        if depth <= self._defining:
            self._defining = depth if local in _DEFINING else math.inf
        href = next((own[name] for name in HREFS if name in own), "").strip().removeprefix("#")
        if local.endswith("Gradient"):
            self._gradient = _Gradient(href, frozenset(name for name in _PLACING if name in own))
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
            paints = (
                reference(_URL.sub("url(", own.get(name, ""), 1)) for name in ("fill", "stroke")
            )
            shape = _Drawn(
                href if local == "use" else "",
                _is_given(own, "mask"),
                frozenset(name for name in paints if name is not None),
            )
            if shape != _PLAIN:
                if own.get("id"):
                    self._named[own["id"]] = shape
                if self._defining == math.inf:
                    self._drawn.append(shape)

    def sheet(self, text: str) -> None:
        """Add a style sheet."""
        text = without_comments(text)
        self._counts["style sheet"] += 1
        self._counts["transform"] += len(_TRANSFORMING.findall(text))
        self._counts["currentColor"] += "currentcolor" in text.lower()
        self._sheets_soften |= any(_is_translucent("", one) for one in _STOP_OPACITY.findall(text))


_PLAIN = _Drawn(named="", masked=False, gradients=frozenset())
_One = TypeVar("_One", _Drawn, _Gradient)


def _whole(own: Mapping[str, _One], join: Callable[[_One, _One], _One]) -> dict[str, _One]:
    """Each with what it takes from the one that it names, and so on; circles end somewhere."""
    whole: dict[str, _One] = {}
    for name in own:
        chain: list[str] = []
        while name in own and name not in whole:
            whole[name] = own[name]
            chain.append(name)
            name = own[name].named
        for link in reversed(chain):
            whole[link] = _joined(own[link], whole, join)
    return whole


def _joined(one: _One, whole: Mapping[str, _One], join: Callable[[_One, _One], _One]) -> _One:
    return join(one, whole[one.named]) if one.named in whole else one


def _by_template(own: _Gradient, template: _Gradient) -> _Gradient:
    """A gradient with the place, and without stops with the stops, of a whole one."""
    stops = own if own.stops else template
    return replace(stops, placed=own.placed | template.placed)


def _as_used(own: _Drawn, used: _Drawn) -> _Drawn:
    """An element under its mask or that of the one it uses, by the gradients of either."""
    return _Drawn(used.named, own.masked or used.masked, own.gradients or used.gradients)


def _properties(attributes: dict[str, str]) -> dict[str, str]:
    """Attributes, and the properties of the style, which win; they are split by hand, for speed."""
    if "style" not in attributes:
        return attributes
    parts = (part.partition(":") for part in without_comments(attributes["style"]).split(";"))
    styled = {name.strip().lower(): value.partition("!")[0].strip() for name, _, value in parts}
    return {**attributes, **styled}


def _is_given(own: Mapping[str, str], name: str) -> bool:
    return own.get(name, "").strip().lower() not in ("", "none")


@lru_cache(maxsize=1024)  # gradients share their stops
def _is_translucent(color: str, opacity: str) -> bool:
    """Whether a stop lets something through; what cannot be read is opaque."""
    share = pixels_of(opacity.strip(), 1.0)
    return color_alpha(color) < 1 or (share is not None and share < 1)
