"""The start tag of an SVG's root: found by expat whatever stands before it, and rewritten."""

from __future__ import annotations

from contextlib import suppress
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

_REPLACED = ("width", "height", "viewBox", "preserveAspectRatio")


def stretched(text: str, width: int, height: int, view_box: str | None = None) -> str | None:
    """The SVG with a root that fills width x height px; text is well-formed.

    view_box is the part that is shown; None keeps the root's own. Returns None for a root that has
    none either, and for one that cannot be found. Everything before the root is dropped except a
    document type with declarations of its own: no renderer needs it, and text has no encoding. A
    width in the root's style changes nothing in any renderer.
    """
    data = text.encode()
    root = _Root(data)
    box = root.attributes.get("viewBox") if view_box is None else view_box
    if box is None or not root.end:
        return None
    kept = {name: value for name, value in root.attributes.items() if name not in _REPLACED}
    attributes = {
        "width": str(width), "height": str(height), "preserveAspectRatio": "none", "viewBox": box,
        **kept,
    }  # fmt: skip
    written = "".join(f" {name}={quoteattr(value)}" for name, value in attributes.items())
    slash = "/" if data[root.end - 2 : root.end] == b"/>" else ""
    before, after = data[root.declarations].decode(), data[root.end :].decode()
    return f"{before}<{root.name}{written}{slash}>{after}"


class _Root:
    """The root's name and attributes, and what lies where in the bytes of a document.

    end           of its start tag; 0 where that was not found
    declarations  a document type that has any, else nothing
    """

    def __init__(self, data: bytes) -> None:
        self.name, self.attributes, self.end = "", dict[str, str](), 0
        self.declarations = slice(0)
        self._doctype, self._declares = 0, False
        self._parser = expat.ParserCreate("utf-8")
        self._parser.specified_attributes = True
        self._parser.StartElementHandler = self._start
        self._parser.EndElementHandler = self._parser.DefaultHandler = self._other
        self._parser.EndDoctypeDeclHandler = self._end_of_doctype
        with suppress(StopIteration, expat.ExpatError):
            self._parser.Parse(data, True)

    def _start(self, name: str, attributes: dict[str, str]) -> None:
        self._stop_after_root()
        self.name, self.attributes = name, attributes

    def _other(self, token: str) -> None:
        self._stop_after_root()
        if token == "<!DOCTYPE":
            self._doctype = self._parser.CurrentByteIndex
        self._declares |= token == "["

    def _end_of_doctype(self) -> None:
        if self._declares:
            self.declarations = slice(self._doctype, self._parser.CurrentByteIndex + 1)

    def _stop_after_root(self) -> None:
        # Any event after the start tag begins where that ends.
        if self.name:
            self.end = self._parser.CurrentByteIndex
            raise StopIteration
