"""One pass over the XML of a document that anyone wrote, by expat.

What the package wants to know of a foreign SVG is found by observers of this pass: what renderers
cannot draw, what the document refers to, how much it has, its tree. Each raises what it refuses.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum
from xml.parsers import expat

SVG = "{http://www.w3.org/2000/svg}"
# Bytes after which an error ends the pass: what Python hands to expat at once in any case.
_PIECE = 1 << 20
_BEFORE_DOCTYPE = re.compile(rb"(?:\s|\xef\xbb\xbf|<!--.*?-->|<\?.*?\?>)*+", re.DOTALL)
_ATTRIBUTE = re.compile(rb"""\s+([^\s=/>]+)\s*=\s*(?:"[^"]*"|'[^']*')""")
_START_TAG = re.compile(rb"<([^\s/>]+)((?:%b)*+)" % _ATTRIBUTE.pattern)
_WHERE = "line {0.CurrentLineNumber}, column {0.CurrentColumnNumber}"


class Doctype(Enum):
    """Document types that are let through: BARE has no declarations, as that of matplotlib."""

    NONE, BARE, ANY = range(3)


class ParseError(ValueError):
    """A document that is not well-formed."""


class DoctypeError(ParseError):
    """A document type that is not let through."""


class Observer:
    """What a pass tells of a document. Names are {namespace}local, or local without a namespace."""

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        """A start tag."""

    def end(self, tag: str) -> None:
        """An end tag."""

    def sheet(self, text: str) -> None:
        """The text of a style element, in several parts where style elements are in it."""

    def instruction(self, target: str) -> None:
        """A processing instruction."""


@dataclass(frozen=True)
class Root:
    """Where the root begins in the bytes of a document.

    declared  where a document type with declarations of its own ends; 0 without
    """

    data: bytes
    begin: int
    declared: int

    def stretched(self, width: int, height: int, view_box: str | None = None) -> str:
        """The document with a root that fills width x height px.

        view_box is the part that is shown; None keeps the root's own, and a root that has none as
        it is. Everything before the root is dropped except a document type with
        declarations of its own: no renderer needs it, and text has no encoding. A width in the
        root's style changes nothing in any renderer.
        """
        size = {"width": width, "height": height, "preserveAspectRatio": "none"}
        if view_box is not None:
            size["viewBox"] = view_box
        tag = _START_TAG.match(self.data, self.begin)
        found = _ATTRIBUTE.finditer(tag[2]) if tag else ()
        own = [(one[1].decode(), one[0].decode()) for one in found]
        if tag is None or (view_box is None and "viewBox" not in dict(own)):
            return self.data.decode()
        written = "".join(f' {name}="{value}"' for name, value in size.items())
        kept = "".join(text for name, text in own if name not in size)
        before = _BEFORE_DOCTYPE.sub(b"", self.data[: self.declared], count=1)
        after = self.data[tag.end() :]
        return f"{before.decode()}<{tag[1].decode()}{written}{kept}{after.decode()}"


def parse(document: str | bytes, *observers: Observer, doctype: Doctype = Doctype.ANY) -> Root:
    """Tell observers of a document in its order, and return its root.

    Without observers it is parsed no further than that. Raises ParseError for XML that is not
    well-formed, DoctypeError, UnicodeEncodeError or LookupError for an encoding, and what observers
    raise. Nothing is loaded, and expat itself limits how much entities may expand.
    """
    is_text = isinstance(document, str)
    data = document.encode() if is_text else document
    one = _Pass(expat.ParserCreate("utf-8" if is_text else None, "}"), observers, doctype)
    try:
        for begin in range(0, len(data), _PIECE):
            one.parser.Parse(data[begin : begin + _PIECE])
        one.parser.Parse(b"", True)
    except StopIteration:
        pass
    except expat.ExpatError as error:
        raise ParseError(str(error)) from error
    return Root(data, one.begin, one.declared)


class _Names(dict[str, str]):
    """expat's names, which have no { before the namespace, by those of observers."""

    def __missing__(self, name: str) -> str:
        self[name] = "{" + name if "}" in name else name
        return self[name]


class _Pass:
    """expat's handlers; it keeps calling none of them after one has raised."""

    def __init__(
        self, parser: expat.XMLParserType, observers: tuple[Observer, ...], doctype: Doctype
    ) -> None:
        self.begin = self.declared = 0
        self.parser = parser
        self._observers, self._doctype, self._names = observers, doctype, _Names()
        self._sheet: list[str] = []
        self._sheets = 0  # that are open
        self._declares = False
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = self._start_doctype
        parser.EndDoctypeDeclHandler = self._end_doctype
        if doctype is not Doctype.ANY:
            parser.SkippedEntityHandler = self._skipped
        parser.StartElementHandler = self._root
        if observers:
            parser.EndElementHandler = self._end
            parser.ProcessingInstructionHandler = self._instruction

    def _start_doctype(
        self, name: str, system: str | None, public: str | None, has_declarations: int
    ) -> None:
        if self._doctype is Doctype.NONE or (has_declarations and self._doctype is Doctype.BARE):
            raise DoctypeError(f"a document type, {name[:80]}")
        self._declares = bool(has_declarations)

    def _end_doctype(self) -> None:
        self.declared = self.parser.CurrentByteIndex + 1 if self._declares else 0

    def _skipped(self, name: str, _is_parameter: int) -> None:
        # expat lets them through where an external document type could define them.
        raise ParseError(f"undefined entity &{name};: {_WHERE.format(self.parser)}")

    def _root(self, name: str, attributes: dict[str, str]) -> None:
        self.begin = self.parser.CurrentByteIndex
        if not self._observers:
            raise StopIteration
        self.parser.StartElementHandler = self._start
        self._start(name, attributes)

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        names = self._names
        if name.rpartition("}")[2] == "style":
            self._tell_sheet()
            self._sheets += 1
            self.parser.CharacterDataHandler = self._sheet.append
        tag, named = names[name], {names[key]: value for key, value in attributes.items()}
        for observer in self._observers:
            observer.start(tag, named)

    def _end(self, name: str) -> None:
        if self._sheets and name.rpartition("}")[2] == "style":
            self._tell_sheet()
            self._sheets -= 1
            if not self._sheets:
                self.parser.CharacterDataHandler = None
        tag = self._names[name]
        for observer in self._observers:
            observer.end(tag)

    def _tell_sheet(self) -> None:
        text = "".join(self._sheet)
        self._sheet.clear()
        if text:
            for observer in self._observers:
                observer.sheet(text)

    def _instruction(self, target: str, _data: str) -> None:
        for observer in self._observers:
            observer.instruction(target)
