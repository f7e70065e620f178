"""Radial gradients read back: the colour, the exponent and the disc of each.

The exponent is that of BETA_CLASSES whose profile the polygon of the stops is nearest to,

    min over beta of  sqrt(integral (stops(x) - f(x R))^2 2 x dx),  R = cut_radius(beta), x in 0..1,

whatever the number of stops; tests/svg/test_stops.py has the margins. Attributes and stops are
inherited along a chain of references, as in SVG 2: an element's own come first. The stops of
minimal markup have their opacities in a style sheet, or are greys of a mask, whose luminance is the
falloff.

Style sheets and animation are refused unless the SVG ends as its elements say. The sheet of minimal
markup has the opacities of stops, and is read as it is written.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, quoted
from gauss2svg.scene.falloff import BETA_CLASSES, cut_radius, profile
from gauss2svg.svg.document import UP_TO_TARGET
from gauss2svg.svg.minimal import MASK_STOPS
from gauss2svg.svg.stops import grey_stops
from gauss2svg.svg.syntax.parse import HREFS, SVG
from gauss2svg.svg.syntax.values import (
    IDENTITY,
    NUMBER,
    Affine,
    Color,
    color,
    component_values,
    compose,
    length,
    nodes_of,
    parse_transform,
    properties,
    share,
    written,
)

_STOP = SVG + "stop"
_RADIAL, _LINEAR = SVG + "radialGradient", SVG + "linearGradient"
_GEOMETRY = ("cx", "cy", "r", "fx", "fy", "fr")
_COMMON = ("gradientUnits", "gradientTransform", "spreadMethod")
_RADII = (np.arange(512) + 0.5) / 512  # of the disc
_LARGEST_ERROR = 0.02
_LARGEST_END = 0.005  # opacity of the last stop, which extends beyond the disc
# Inkscape makes chains of two; without a limit, reading n gradients could take n^2 steps.
_LONGEST_CHAIN = 100


@dataclass(frozen=True)
class Gradient:
    """One gradient: colour, opacity at the centre, exponent, and where it ends.

    disc maps the unit circle onto the gradient's edge, in the shape's user space or, with in_box,
    in the unit square of its bounding box.
    """

    color: Color
    peak: float
    beta: float
    disc: Affine
    in_box: bool


class Stop(NamedTuple):
    """One stop: its offset and opacity in 0..1, and its colour as it is written."""

    offset: float
    opacity: float
    color: str


class Gradients:
    """The radial gradients of a document by id, each read once, when it is asked for.

    opacities  of stops, by the id that their gradient refers to: rules.stop_opacities
    """

    def __init__(
        self, by_id: Mapping[str, Any], opacities: Mapping[str, Sequence[str]] | None = None
    ) -> None:
        self._by_id, self._opacities = by_id, opacities or {}
        self._read: dict[tuple[str, bool], Gradient] = {}

    def get(self, key: str, in_mask: bool = False) -> Gradient:
        """The gradient of an id; raises InputError if write_svg would not write it.

        in_mask  whether its greys are what a mask lets through
        """
        if (key, in_mask) not in self._read:
            with _naming(key):
                self._read[key, in_mask] = self._gradient(key, in_mask)
        return self._read[key, in_mask]

    def _gradient(self, key: str, in_mask: bool) -> Gradient:
        chain = list(self._chain(key))
        if chain[0].tag != _RADIAL:
            raise InputError("it must be a radialGradient; got a linear one")
        found: dict[str, str] = {}
        for element in chain:
            names = _COMMON + (_GEOMETRY if element.tag == _RADIAL else ())
            for name in names:
                if element.get(name) is not None:
                    found.setdefault(name, element.get(name))
        owner = next((e for e in chain if e.find(_STOP) is not None), chain[-1])
        opacities = self._opacities.get(owner.get("href", "").removeprefix("#"), ())
        stops = _stops(owner, opacities)
        disc, in_box = _disc(found)
        shade, peak, beta = _of_mask(stops) if in_mask else _of_one_color(stops)
        return Gradient(shade, peak, beta, disc, in_box)

    def _chain(self, key: str) -> Iterator[Any]:
        seen: set[str] = set()
        while key:
            element = self._by_id.get(key)
            why = ""
            if key in seen:
                why = "refers to itself"
            elif element is None or element.tag not in (_RADIAL, _LINEAR):
                why = "is missing or not a gradient"
            elif len(seen) == _LONGEST_CHAIN:
                why = f"comes after {_LONGEST_CHAIN} references"
            if why or element is None:
                raise InputError(
                    f"its reference must be to a radialGradient with stops; got {_shortened(key)}, "
                    f"which {why}"
                )
            seen.add(key)
            yield element
            key = next((element.get(h, "") for h in HREFS if element.get(h)), "").removeprefix("#")


def _disc(found: Mapping[str, str]) -> tuple[Affine, bool]:
    units = found.get("gradientUnits", "objectBoundingBox")
    if units not in ("objectBoundingBox", "userSpaceOnUse"):
        raise InputError(f"gradientUnits must be userSpaceOnUse; got {quoted(units)}")
    in_box = units == "objectBoundingBox"
    whole = 1.0 if in_box else None  # write_svg writes no percentage of the viewport
    cx, cy, r = (length(found.get(name, "50%"), name, whole) for name in ("cx", "cy", "r"))
    fx, fy = (length(found[f], f, whole) if f in found else c for f, c in (("fx", cx), ("fy", cy)))
    if r <= 0:
        raise InputError(f"its r must be above 0; got {quoted(r)}")
    away = math.hypot(fx - cx, fy - cy) / r
    # Within a hundredth of the radius the focus changes the image by under a level.
    if away > 0.01 or length(found.get("fr", "0"), "fr"):
        raise InputError(
            f"its focus must be its centre; got a circle or a point {away:.3g} radii away. Try to "
            "remove fx, fy and fr"
        )
    if found.get("spreadMethod", "pad") != "pad":
        raise InputError(f"its spreadMethod must be pad; got {quoted(found['spreadMethod'])}")
    onto = IDENTITY
    if "gradientTransform" in found:
        onto = parse_transform(found["gradientTransform"], "gradientTransform")
    return compose(onto, (r, 0.0, 0.0, r, cx, cy)), in_box


def _stops(owner: Any, opacities: Sequence[str]) -> list[Stop]:
    """The stops inside a gradient; a style sheet may give their opacities and currentColor."""
    current = {**owner.attrib, **properties(owner.get("style", ""))}.get("color", "")
    stops = []
    for k, stop in enumerate(owner.findall(_STOP)):
        sheet = {}
        if opacities:
            of_stop = opacities[min(k, len(opacities) - 1)]
            sheet = {"stop-color": "currentColor", "stop-opacity": of_stop}
        own: dict[str, str] = {**stop.attrib, **sheet, **properties(stop.get("style", ""))}
        shade = own.get("stop-color", "black")
        opacity = share(own.get("stop-opacity", "1"), "stop-opacity")
        offset = share(own.get("offset", "0"), "offset")
        stops.append(Stop(offset, opacity, current if shade == "currentColor" else shade))
    return stops


def _of_one_color(stops: list[Stop]) -> tuple[Color, float, float]:
    """Colour, centre opacity and exponent; raises InputError if no exponent has such stops."""
    shades = {color(text, "stop-color") for text in {stop.color.lower() for stop in stops}}
    if len(shades) != 1:
        raise InputError(f"its stops must be of one colour; got {len(shades)} colours")
    peak, beta = _exponent(tuple(stop[:2] for stop in stops))
    return shades.pop(), peak, beta


def _of_mask(stops: list[Stop]) -> tuple[Color, float, float]:
    """White, 1 and the exponent that minimal markup writes with such greys."""
    greys = tuple((stop.offset, *color(stop.color, "stop-color")) for stop in stops)
    beta = _grey_exponents().get(tuple((o, round(255 * red)) for o, red, _, _ in greys))
    grey = all(red == green == blue for _, red, green, blue in greys)
    if beta is None or not grey or any(stop.opacity != 1 for stop in stops):
        raise InputError("its stops must be greys of minimal markup; got others")
    return (1.0, 1.0, 1.0), 1.0, beta


@lru_cache(maxsize=1)
def _grey_exponents() -> dict[tuple[tuple[float, int], ...], float]:
    """Exponents by the offsets and levels that stand for them in masks."""
    found = {}
    for count, beta in product(MASK_STOPS, BETA_CLASSES):
        offsets, greys = grey_stops(count, beta)
        levels = (17 * greys).tolist()
        found[tuple(zip(np.round(offsets, 3).tolist(), levels, strict=True))] = beta
    return found


@lru_cache(maxsize=64)
def _exponent(polygon: tuple[tuple[float, float], ...]) -> tuple[float, float]:
    # An offset below the one before counts as that one, in every renderer.
    offsets = np.maximum.accumulate([offset for offset, _ in polygon])
    heights = np.array([height for _, height in polygon])
    drawn, area = np.interp(_RADII, offsets, heights), 2 * _RADII
    peaks = (area * drawn * _profiles()).sum(axis=1) / (area * _profiles() ** 2).sum(axis=1)
    shapes = drawn / np.maximum(peaks, 1e-6)[:, None]
    error = np.sqrt(np.mean(area * np.square(shapes - _profiles()), axis=1))
    best = int(error.argmin())
    peak = float(peaks[best])
    # Piecewise linear profiles differ from 1 by as much in their scale.
    if abs(peak - 1) < 0.01:
        peak = 1.0
    if error[best] > _LARGEST_ERROR or heights[-1] > _LARGEST_END * peak:
        known = ", ".join(f"{beta:g}" for beta in BETA_CLASSES)
        raise InputError(
            f"its stops must be those that write_svg writes for one of the exponents {known}; "
            f"got others, {error[best]:.3f} off {BETA_CLASSES[best]:g}, the nearest"
        )
    return peak, BETA_CLASSES[best]


@lru_cache(maxsize=1)
def _profiles() -> NDArray[np.floating]:
    """(classes, samples) each exponent's profile over the disc."""
    return np.stack([profile(_RADII * cut_radius(beta), beta) for beta in BETA_CLASSES])


def _shortened(key: str) -> str:
    """The id of a gradient in an error, cut where it is long."""
    return repr(key if len(key) <= 60 else key[:57] + "...")


@contextmanager
def _naming(key: str) -> Iterator[None]:
    """Put the gradient before the message of an InputError."""
    try:
        yield
    except InputError as error:
        raise InputError(f"its gradient {_shortened(key)}: {error}") from None


# Characters: write_svg writes a few thousand, and tokenising hostile ones takes up to 5 us each.
_LONGEST_SHEET = 100_000
# After these a shape stays as the animation leaves it, or is never as it is written.
_LASTING = ("forwards", "both", "infinite", "paused")
_STOP_RULE = re.compile(
    rf'\[href="#([A-Za-z]+)"\] (stop(?:\+stop)*+)\{{'
    rf"(stop-color:currentColor;)?stop-opacity:({NUMBER})\}}"
)
_NEEDED = "animation only, without escapes"
_ADVICE = "to write what it sets into the elements"


def stop_opacities(text: str) -> dict[str, list[str]]:
    """Opacities of stops by the id of what their gradient refers to; none for any other sheet.

    The k-th rule of an id is for the k-th stop and, if it is the last one, for all that follow.
    """
    found: dict[str, list[str]] = {}
    at = 0
    while rule := _STOP_RULE.match(text, at):
        stops = found.setdefault(rule[1], [])
        if rule[2].count("stop") != len(stops) + 1 or bool(rule[3]) == bool(stops):
            return {}
        stops.append(rule[4])
        at = rule.end()
    return found if at == len(text) else {}


def check_sheet(text: str) -> None:
    """Raise InputError for a style sheet with anything but animation that ends as it began.

    The rule of write_svg by which a fragment of the address hides later rounds is skipped.
    """
    if len(text) > _LONGEST_SHEET:
        raise InputError(
            f"the style sheet must be of at most {_LONGEST_SHEET} characters; got {len(text)}. "
            f"Try {_ADVICE}"
        )
    if "\\" in text:
        raise InputError(f"the style sheet must be {_NEEDED}; got an escape. Try {_ADVICE}")
    for node in nodes_of(text, True, _is_entered):
        if node.type == "declaration":
            check_animation(node.lower_name, node.value, _ADVICE)
        elif not (node.type == "qualified-rule" or _is_entered(node) or _is_keyframes(node)):
            what = f"@{node.at_keyword[:60]}" if node.type == "at-rule" else f"{text[:60]!r}"
            raise InputError(f"the style sheet must be {_NEEDED}; got {what}. Try {_ADVICE}")


def check_animation(name: str, value: str | list[Any], advice: str) -> None:
    """Raise InputError for a property other than animation, and for one that does not end."""
    if name == "mix-blend-mode":
        raise InputError(
            "blend must be 'over' in an SVG that is read; got an additive one, whose levels are "
            "too few. Try the scene that --save-scene keeps, by Scene.load"
        )
    if not name.removeprefix("-webkit-").startswith("animation"):
        raise InputError(f"the style must be animation only; got {name[:60]}. Try {advice}")
    tokens = component_values(value) if isinstance(value, str) else value
    for token in tokens:
        if token.type == "ident" and token.lower_value in _LASTING:
            raise InputError(
                f"{name[:60]} must be one that ends as it began; got {quoted(token.value)}. Try "
                "to remove it"
            )


def check_smil(tag: str, attributes: Any) -> None:
    """Raise InputError for an element that sets or animates something for good."""
    if tag in ("set", "discard"):
        raise InputError(
            "animation must end as it began; got an element that changes what is drawn. Try to "
            "write that into the elements, and to delete it"
        )
    for name in ("fill", "repeatCount", "repeatDur", "dur"):
        if attributes.get(name) in ("freeze", "indefinite"):
            raise InputError(
                f"{name} must be such that animation ends as it began; got "
                f"{quoted(attributes[name])}. Try to delete the element"
            )


def _is_entered(node: Any) -> bool:
    if node.type == "at-rule":
        return node.content is not None and node.lower_at_keyword == "media"
    if node.type != "qualified-rule":
        return False
    rule = f"{written(node.prelude)}{{{written(node.content).rstrip(';')}}}"
    return rule != UP_TO_TARGET  # which hides nothing without a fragment in the address


def _is_keyframes(node: Any) -> bool:
    at_rule = node.type == "at-rule" and node.content is not None
    return at_rule and node.lower_at_keyword.endswith("keyframes")
