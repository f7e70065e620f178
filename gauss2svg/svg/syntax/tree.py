"""Documents as trees of elements, of limited size and depth."""

from __future__ import annotations

from typing import Any
from xml.etree.ElementTree import TreeBuilder

from gauss2svg.errors import InputError, must_be, shown
from gauss2svg.svg.syntax.parse import Doctype, Observer, parse
from gauss2svg.svg.syntax.source import BLANKS, MOST_BYTES, READING, SvgSource, read_source

MOST_ELEMENTS = 4_000_000  # their tree takes about 3 GB
_DEEPEST = 1000  # renderers draw hardly deeper ones


class _Tree(Observer):
    def __init__(self, most_elements: int) -> None:
        self.builder = TreeBuilder()
        self._most = most_elements
        self._count = self._depth = 0

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        self._depth += 1
        if self._count > self._most:
            needed, advice = f"of at most {self._most} elements", "a larger max_elements"
            raise InputError(must_be("the SVG", needed, shown("more"), f"{advice} if you trust it"))
        if self._depth > _DEEPEST:
            needed = f"nested at most {_DEEPEST} deep"
            raise InputError(must_be("elements", needed, shown("more"), "to ungroup them"))
        self.builder.start(tag, attributes)

    def end(self, tag: str) -> None:
        self._depth -= 1
        self.builder.end(tag)

    def sheet(self, text: str) -> None:
        self.builder.data(text)


def parse_document(
    source: SvgSource, max_bytes: int = MOST_BYTES, max_elements: int = MOST_ELEMENTS
) -> Any:
    """The root element of a source as of read_source, with the text of style elements alone.

    Raises InputError for a source that cannot be read, is not XML, declares a document type, has
    more than max_bytes bytes, gunzipped, or more than max_elements elements, or nests them more
    than 1000 deep. Neither write_svg nor Inkscape writes a document type.
    """
    data, name = read_source(source, max_bytes, READING)
    tree = _Tree(max_elements)
    try:
        parse(data.lstrip(BLANKS) if isinstance(data, str) else data, tree, doctype=Doctype.NONE)
    except InputError:
        raise
    except (ValueError, LookupError) as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(must_be(name, "an SVG", shown(what), "a file of write_svg")) from None
    return tree.builder.close()
