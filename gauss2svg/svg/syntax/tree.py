"""Documents as trees of elements, of limited size and depth."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import Element, SubElement

from gauss2svg.errors import InputError, brief
from gauss2svg.svg.syntax.parse import parse
from gauss2svg.svg.syntax.source import BLANKS, MOST_BYTES, READING, SvgSource, read_source

MOST_ELEMENTS = 4_000_000  # their tree takes about 3 GB
_DEEPEST = 1000  # renderers draw hardly deeper ones


class _Tree:
    def __init__(self, most_elements: int) -> None:
        self.open: list[Element] = []  # from the root to what was begun last
        self._most = self._left = most_elements

    def start(self, tag: str, attributes: dict[str, str], depth: int) -> None:
        self._left -= 1
        if self._left < 0:
            raise InputError(
                f"the SVG must be of at most {self._most} elements; got more. Try a "
                "larger max_elements if you trust it"
            )
        if depth >= _DEEPEST:
            raise InputError(
                f"elements must be nested at most {_DEEPEST} deep; got more. Try to ungroup them"
            )
        del self.open[depth:]
        inside = SubElement(self.open[-1], tag, attributes) if depth else Element(tag, attributes)
        self.open.append(inside)

    def sheet(self, text: str) -> None:
        for element in self.open[-1:]:
            element.text = (element.text or "") + text


def parse_document(
    source: SvgSource, max_bytes: int = MOST_BYTES, max_elements: int = MOST_ELEMENTS
) -> Any:
    """The root element of a source as of read_source, with the text of style elements alone.

    Raises InputError for a source that cannot be read, is not XML, declares a document type, which
    neither write_svg nor Inkscape writes, has more than max_bytes bytes, gunzipped, or more than
    max_elements elements, or nests them more than 1000 deep.
    """
    data, name = read_source(source, max_bytes, READING)
    tree = _Tree(max_elements)
    try:
        parse(data.lstrip(BLANKS) if isinstance(data, str) else data, tree, doctype="none")
    except InputError:
        raise
    except (ValueError, LookupError) as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(
            f"{name} must be an SVG; got {brief(what)}. Try a file of write_svg"
        ) from None
    return tree.open[0]
