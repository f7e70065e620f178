"""One pass over the XML of a document that anyone wrote, by expat.

What the package wants to know of a foreign SVG is found by observers of this pass: how much it has,
what it refers to, what renderers cannot draw, its tree. Each raises what it refuses. Nothing is
loaded, and what entities may expand to is limited by expat.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, Protocol
from xml.parsers import expat

SVG = "{http://www.w3.org/2000/svg}"
INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"
HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
ANIMATIONS = ("animate", "animateTransform", "animateMotion", "animateColor", "set", "discard")
# Bytes after which a refusal ends the pass: what Python hands to expat at once in any case.
_PIECE = 1 << 20
_XML_DECLARATION = re.compile(rb"(?:\s|\xef\xbb\xbf)*+<\?xml\s.*?\?>", re.DOTALL)
_ATTRIBUTE = re.compile(rb"""\s+([^\s=/>]+)\s*=\s*(?:"[^"]*"|'[^']*')""")
_START_TAG = re.compile(rb"<([^\s/>]+)((?:%b)*+)" % _ATTRIBUTE.pattern)


class ParseError(ValueError):
    """A document that is not well-formed."""


class DoctypeError(ParseError):
    """A document type that is not let through."""


class Observer(Protocol):
    """What is told of the elements of a document, in their order.

    Names are {namespace}local, or local where there is no namespace; depth is 0 for the root.
    """

    def start(self, tag: str, attributes: dict[str, str], depth: int, /) -> None:
        """Take a start tag."""
        ...

    def sheet(self, text: str, /) -> None:
        """Take CSS that applies: the text of style elements, an import of another document."""
        ...


@dataclass(frozen=True)
class Root:
    """Where in the bytes of a document its root begins, after what is to be kept of them."""

    data: bytes
    begin: int
    is_declared: bool  # whether the document type has declarations of its own

    def stretched(self, width: int, height: int, view_box: str | None = None) -> str:
        """The document with a root that fills width x height px.

        view_box is the part that is shown; None keeps the root's own, and a root that has none as
        it is. Everything before the root is dropped where no entities are declared: no renderer
        needs it, and text has no encoding. A width in the root's style changes nothing in any
        renderer.
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
        before = self.data[: self.begin] if self.is_declared else b""
        before = _XML_DECLARATION.sub(b"", before, count=1).decode()
        return f"{before}<{tag[1].decode()}{written}{kept}{self.data[tag.end() :].decode()}"


def parse(
    document: str | bytes,
    *observers: Observer,
    doctype: Literal["none", "bare", "any"] = "any",
) -> Root:
    """Tell observers of a document, and return its root.

    doctype  document types that are let through; a bare one has no declarations of its own, as
             those that potrace and matplotlib write, and nobody loads what it names

    Raises ParseError for XML that is not well-formed, DoctypeError, UnicodeEncodeError or
    LookupError for an encoding, and what observers raise.
    """
    is_text = isinstance(document, str)
    data = document.encode() if is_text else document
    parser = expat.ParserCreate("utf-8" if is_text else None, "}")
    told = _Told(parser, observers, doctype)
    try:
        for begin in range(0, len(data), _PIECE):
            parser.Parse(data[begin : begin + _PIECE])
        parser.Parse(b"", True)
    except expat.ExpatError as error:
        raise ParseError(str(error)) from error
    return Root(data, told.begin, told.is_declared)


class _Names(dict[str, str]):
    """expat's names, which have no { before the namespace, as observers get them."""

    def __missing__(self, name: str) -> str:
        self[name] = "{" + name if "}" in name else name
        return self[name]


def _is_style(name: str) -> bool:
    return name.endswith("style") and name.rpartition("}")[2] == "style"


class _Told:
    """expat's handlers."""

    def __init__(
        self, parser: expat.XMLParserType, observers: tuple[Observer, ...], doctype: str
    ) -> None:
        self.begin, self.is_declared = 0, False
        self._parser, self._observers, self._doctype = parser, observers, doctype
        self._depth = self._sheets = 0  # of open elements, and of style elements among them
        self._names, self._css = _Names(), list[str]()
        parser.buffer_text = True
        parser.StartDoctypeDeclHandler = self._start_doctype
        parser.StartElementHandler = self._start
        parser.EndElementHandler = self._end
        parser.ProcessingInstructionHandler = self._instruction
        if doctype != "any":
            parser.SkippedEntityHandler = self._skipped

    def _start_doctype(
        self, name: str, _system: str | None, _public: str | None, is_declared: int
    ) -> None:
        self.is_declared = bool(is_declared)
        if self._doctype == "none" or (is_declared and self._doctype == "bare"):
            raise DoctypeError(f"a document type, {name[:80]}")

    def _skipped(self, name: str, _is_parameter: int) -> None:
        # expat accepts those that an external document type could define.
        at = f"line {self._parser.CurrentLineNumber}, column {self._parser.CurrentColumnNumber}"
        raise ParseError(f"undefined entity &{name};: {at}")

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        if not self._depth:
            self.begin = self._parser.CurrentByteIndex
            if not self._observers:  # the rest need only be well-formed
                self._parser.StartElementHandler = self._parser.EndElementHandler = None
        if _is_style(name):
            self._tell_css()
            self._sheets += 1
            self._parser.CharacterDataHandler = self._css.append
        names = self._names
        if "}" in "".join(attributes):
            attributes = {names[key]: value for key, value in attributes.items()}
        for observer in self._observers:
            observer.start(names[name], attributes, self._depth)
        self._depth += 1

    def _end(self, name: str) -> None:
        self._depth -= 1
        if self._sheets and _is_style(name):
            self._tell_css()
            self._sheets -= 1
            self._parser.CharacterDataHandler = self._css.append if self._sheets else None

    def _instruction(self, target: str, _text: str) -> None:
        if target == "xml-stylesheet":
            self._css.append("@import")
            self._tell_css()

    def _tell_css(self) -> None:
        text = "".join(self._css)
        self._css.clear()
        if text:
            for observer in self._observers:
                observer.sheet(text)
