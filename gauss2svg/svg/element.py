"""Elements of an SVG and the short texts in them: numbers, colours, ids.

All that gauss2svg draws is written by Element: svgwrite's documents (gauss2svg.svg.write) take
elements by `get_xml`, minimal files (gauss2svg.svg.minimal) are made of their `text`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from xml.etree import ElementTree
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import SceneError
from gauss2svg.svg.limits import LARGEST_NUMBER

_LETTERS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"


@dataclass(frozen=True, slots=True)
class Element:
    """One element: its tag, its attributes in the order of the file, and what is inside it.

    inside  None for a tag that closes itself; or elements; or a text, in which <, > and & become
            entities. Attributes are written as they are: numbers, colours, ids have none of them
    """

    tag: str
    attributes: Mapping[str, str] = field(default_factory=dict)
    inside: Sequence[Element] | str | None = None

    def without(self, *names: str) -> Element:
        """The element without some attributes."""
        kept = {name: value for name, value in self.attributes.items() if name not in names}
        return Element(self.tag, kept, self.inside)

    def text(self) -> str:
        """The element as SVG text, without white space between tags."""
        begin, inside = f"<{self.tag}{attributes_text(self.attributes)}", self.inside
        if inside is None:
            return begin + "/>"
        if not isinstance(inside, str):
            return f"{begin}>{''.join([one.text() for one in inside])}</{self.tag}>"
        return f"{begin}>{escape(inside)}</{self.tag}>"

    def get_xml(self) -> ElementTree.Element:
        """The element as svgwrite asks for it, which takes only elements from here."""
        xml = ElementTree.Element(self.tag, dict(self.attributes))
        xml.extend([one.get_xml() for one in self.inside or () if isinstance(one, Element)])
        return xml


def attributes_text(attributes: Mapping[str, str]) -> str:
    """Attributes as they follow a tag's name, each with a space before it."""
    return "".join([f' {name}="{value}"' for name, value in attributes.items()])


def with_default(name: str, value: str, default: str) -> dict[str, str]:
    """The attribute, or none where its value is the one that renderers assume."""
    return {} if value == default else {name: value}


def radial_gradient(key: str, stops: Sequence[Element], r: str = "1", fx: str = "") -> Element:
    """A radial gradient of radius r around the origin of user space.

    fx moves resvg to its accurate gradient (docs/decisions/svg.md); "" for none.
    """
    focus = {"fx": fx} if fx else {}
    attributes = {"cx": "0", "cy": "0", **focus, "gradientUnits": "userSpaceOnUse"}
    return Element("radialGradient", {**attributes, "id": key, "r": r}, stops)


def number(value: float, decimals: int) -> str:
    """Shortest text of a value rounded to some decimals.

    Raises SceneError for NaN and infinity, which renderers draw wrongly or crash on, and for
    numbers above LARGEST_NUMBER.
    """
    if not abs(value) <= LARGEST_NUMBER:
        raise SceneError(
            f"a number in an SVG must be finite and at most {LARGEST_NUMBER:g}; got "
            f"{value!s}. Try to scale the scene, to drop shapes that lie so far off, or a "
            "coarser precision"
        )
    text = f"{value:.{decimals}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    if text in ("-0", ""):
        return "0"
    if text.startswith("0."):
        return text[1:]
    if text.startswith("-0."):
        return "-" + text[2:]
    return text


def hex_color(color: NDArray[np.integer], short: bool = True) -> str:
    """#rrggbb of three levels 0..255, or where it may be short #rgb if that is the same."""
    text = "#" + "".join(f"{int(v):02x}" for v in color)
    if short and text[1] == text[2] and text[3] == text[4] and text[5] == text[6]:
        return "#" + text[1] + text[3] + text[5]
    return text


def short_id(index: int) -> str:
    """The index-th shortest id of letters: a, b, ..., Z, aa, ab, ..."""
    text = _LETTERS[index % len(_LETTERS)]
    while index >= len(_LETTERS):
        index = index // len(_LETTERS) - 1
        text = _LETTERS[index % len(_LETTERS)] + text
    return text
