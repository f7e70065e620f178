"""What an untrusted SVG has, by one pass that checks that it is safe to draw, and its size."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

from gauss2svg.errors import InputError, brief, quoted
from gauss2svg.svg.syntax.css import declarations, words, written
from gauss2svg.svg.syntax.parse import (
    INKSCAPE,
    SVG,
    DoctypeError,
    Observer,
    ParseError,
    Root,
    parse,
)
from gauss2svg.svg.syntax.references import References
from gauss2svg.svg.syntax.values import pixels_of, view_box

MOST_ELEMENTS = 1_000_000  # resvg's limit
# Renderers hold numbers in 32 bits, of which the transform to pixels needs some of the range.
_LEAST, _MOST = 1e-30, 1e30
_SCALE = "to scale it to the size of the photo"


@dataclass(frozen=True)
class Survey:
    """Contents of an SVG.

    tags      number of elements by name, the commonest first; SVG's own by their local name,
              others as {namespace}name
    layers    groups that Inkscape shows as layers
    root      attributes of the root element
    qualified whether the root is in SVG's namespace, which browsers require
    """

    tags: dict[str, int]
    layers: int
    root: dict[str, str]
    qualified: bool

    @property
    def elements(self) -> int:
        """Number of elements."""
        return sum(self.tags.values())


def survey(text: str, most_elements: int, *observers: Observer) -> tuple[Survey, Root]:
    """Contents and root of an untrusted SVG, by one pass over it of which observers are told too.

    Raises InputError for XML that is malformed or defines entities, for links to anything
    outside of the file, for more than most_elements elements, and where the root is not svg.
    """
    census = _Census(most_elements)
    try:
        root = parse(text, census, References(), *observers, doctype="bare")
    except DoctypeError as error:
        raise InputError(
            "SVG must be a document that cannot expand; got a document type of its own. Try to "
            "re-save it as plain SVG"
        ) from error
    except (ParseError, UnicodeEncodeError) as error:
        raise InputError(
            f"SVG must be well-formed XML; got {brief(error)}. Try to re-save it"
        ) from error
    tags = dict(census.tags.most_common())
    return Survey(tags, census.layers, census.root, census.is_qualified), root


class _Census:
    """Counts elements, and refuses those that are too many or not of an SVG."""

    def __init__(self, most: int) -> None:
        self.tags: Counter[str] = Counter()
        self.layers = 0
        self.root: dict[str, str] = {}
        self.is_qualified = False
        self._most = self._left = most
        self._sheet = math.inf  # depth of the element before, if it is a style sheet

    def start(self, tag: str, attributes: dict[str, str], depth: int) -> None:
        name = tag.removeprefix(SVG)
        local = name.rpartition("}")[2]
        if not depth:
            if name != "svg":
                raise InputError(f"root element must be <svg>; got <{name[:80]}>")
            self.root, self.is_qualified = attributes, tag != name
        self._left -= 1
        if self._left < 0:
            raise InputError(
                f"SVG must be of at most {self._most} elements; got more. Try to raise "
                "--max-elements if you trust the file"
            )
        self.tags[name] += 1
        self.layers += attributes.get(INKSCAPE + "groupmode") == "layer"
        if depth > self._sheet:
            # Renderers disagree on which of its texts are the sheet.
            raise InputError(
                f"a style sheet in the SVG must be of text alone; got <{local[:80]}> in it. Try to "
                "save it as plain SVG"
            )
        self._sheet = depth if local == "style" else math.inf

    def sheet(self, text: str) -> None:
        pass


@dataclass(frozen=True)
class Frame:
    """Size and coordinates of an SVG.

    width, height  px, > 0
    view_box       x, y, width and height of the visible part in user units
    """

    width: float
    height: float
    view_box: tuple[float, float, float, float]


def frame_of(root: Mapping[str, str]) -> Frame:
    """The frame of a root's attributes; a missing size follows from the rest.

    Raises InputError where there is neither a viewBox nor a width and a height in absolute
    units, and for numbers that renderers do not hold: see _LEAST and _MOST.
    """
    styled = {
        one.lower_name: written(one.value)
        for one in declarations(root.get("style", ""))
        if [token.type for token in words(one.value)] in (["number"], ["dimension"])
    }
    width, height = (
        _length(name, styled.get(name) or root.get(name, "")) for name in ("width", "height")
    )
    box = view_box(root["viewBox"]) if root.get("viewBox", "").strip() else None
    if box is None:
        if width is None or height is None:
            raise InputError(
                "SVG must be of a known size, by a viewBox or by a width and a height in "
                'absolute units; got neither. Try to add viewBox="0 0 WIDTH HEIGHT" to its '
                "root"
            )
        return Frame(width, height, (0.0, 0.0, width, height))
    if max(map(abs, box)) > _MOST or min(box[2:]) < _LEAST:
        raise InputError(
            f"viewBox must be of numbers up to {_MOST:g}, and a width and a height of at least "
            f"{_LEAST:g}; got {quoted(root['viewBox'])}. Try {_SCALE}"
        )
    if width is None:
        width = box[2] if height is None else _side("width", height * box[2] / box[3])
        height = box[3] if height is None else height
    elif height is None:
        height = _side("height", width * box[3] / box[2])
    return Frame(width, height, box)


def _length(name: str, text: str) -> float | None:
    """Pixels; None for a relative length."""
    pixels = pixels_of(text)
    return None if pixels is None else _side(name, pixels, text)


def _side(name: str, pixels: float, text: str = "") -> float:
    if not _LEAST <= pixels <= _MOST:
        raise InputError(
            f"{name} of the SVG must be above 0 and in {_LEAST:g}..{_MOST:g} px; got "
            f"{quoted(text) if text else f'{pixels:g}'}. Try {_SCALE}"
        )
    return pixels
