"""One pass over an untrusted SVG: counts its elements and checks that it is safe to draw."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any
from xml.etree.ElementTree import ParseError

from defusedxml.common import DefusedXmlException, DTDForbidden
from defusedxml.ElementTree import DefusedXMLParser

from gauss2svg.errors import InputError, brief
from gauss2svg.measure.references import MOST_EMBEDDED_PIXELS, check_css, check_link, check_unread
from gauss2svg.raster.css import MOST_CSS

SVG_NAMESPACE = "http://www.w3.org/2000/svg"
_SVG = f"{{{SVG_NAMESPACE}}}"
_GROUP_MODE = "{http://www.inkscape.org/namespaces/inkscape}groupmode"
_LINKS = ("href", "absref")  # the latter of sodipodi, by which Inkscape finds local files
_BASE = "{http://www.w3.org/XML/1998/namespace}base"  # CairoSVG adds links, even empty ones, to it
# By which browsers load into elements of HTML, whichever part of an SVG they are in.
_FOREIGN_LINKS = ("src", "data", "poster", "background")
_FOREIGN_LISTS = ("srcset", "imagesrcset", "srcdoc", "archive", "code", "codebase", "classid")
# Characters of the first piece; each next one is twice as long. Up to 2.5 expat rescans a token
# that spans pieces, so that with pieces of one size an attribute of 200 MB took 252 s.
_PIECE = 1 << 16


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


def survey(text: str, most_elements: int) -> Survey:
    """Count the elements of an SVG, without building a tree.

    Raises InputError for XML that is malformed or defines entities, for links to anything
    outside of the file, for more than most_elements elements, and where the root is not svg.
    """
    counter = _Counter(most_elements)
    try:
        # Its tree builder may be anything with start, data, end and close.
        parser = _Parser(target=counter, forbid_dtd=True)  # pyright: ignore[reportArgumentType]
        begin, end = 0, _PIECE
        while begin < len(text):
            parser.feed(text[begin:end])
            begin, end = end, 2 * end
        parser.close()
    except DefusedXmlException as error:
        what = "a document type of its own" if isinstance(error, DTDForbidden) else "entities"
        raise InputError(
            f"SVG must be a document that cannot expand; got {brief(what)}. Try to re-save it "
            "as plain SVG"
        ) from error
    except (ParseError, UnicodeEncodeError) as error:
        raise InputError(
            f"SVG must be well-formed XML; got {brief(error)}. Try to re-save it"
        ) from error
    return Survey(dict(counter.tags.most_common()), counter.layers, counter.root, counter.qualified)


class _Parser(DefusedXMLParser):
    """Accepts a bare <!DOCTYPE>, which potrace and matplotlib write and nobody loads."""

    def defused_start_doctype_decl(
        self, name: str, sysid: str | None, pubid: str | None, has_internal_subset: bool
    ) -> None:
        if has_internal_subset:
            super().defused_start_doctype_decl(name, sysid, pubid, has_internal_subset)


class _Counter:
    """Target of the parser's events in place of a tree builder."""

    def __init__(self, most_elements: int) -> None:
        self.tags: Counter[str] = Counter()
        self.layers = 0
        self.root: dict[str, str] = {}
        self.qualified = False
        self._most = most_elements
        self._count = 0
        self._pixels = self._tokenized = 0
        self._css: list[str] | None = None

    def start(self, tag: str, attributes: dict[str, str]) -> None:
        name = tag.removeprefix(_SVG)
        if not self._count:
            if name != "svg":
                raise InputError(f"root element must be <svg>; got <{name[:80]}>")
            self.root = dict(attributes)
            self.qualified = tag != name
        self._count += 1
        if self._count > self._most:
            raise InputError(
                f"SVG must be of at most {self._most} elements; got more. Try to raise "
                "--max-elements if you trust the file"
            )
        self.tags[name] += 1
        self.layers += attributes.get(_GROUP_MODE) == "layer"
        local = name.rpartition("}")[2]
        if self._css is not None:
            # Renderers disagree on which of its texts are the sheet.
            raise InputError(
                f"a style sheet in the SVG must be of text alone; got <{local[:80]}> in it. Try "
                "to save it as plain SVG"
            )
        if local == "style":
            self._css = []
        is_foreign = local != name
        for key, value in attributes.items():
            if key.rpartition("}")[2] in _LINKS or (is_foreign and key in _FOREIGN_LINKS):
                self._follow(local, value)
            elif key == _BASE or (is_foreign and key in _FOREIGN_LISTS):
                check_unread(value)
            elif "(" in value:
                self._check_css(value)

    def _check_css(self, text: str) -> None:
        self._tokenized += check_css(text)
        if self._tokenized > MOST_CSS:
            raise InputError(
                f"CSS in the SVG must be at most {MOST_CSS} characters where it has escapes, "
                f"imports or addresses; got {self._tokenized}. Try to save it as plain "
                "SVG"
            )

    def _follow(self, tag: str, target: str) -> None:
        if tag == "a":
            return  # only loaded on a click
        self._pixels += check_link(tag, target)
        if self._pixels > MOST_EMBEDDED_PIXELS:
            raise InputError(
                f"images in the SVG must be of at most {MOST_EMBEDDED_PIXELS} px together; got "
                f"{self._pixels}. Try to shrink them before embedding them"
            )

    def data(self, text: str) -> None:
        if self._css is not None:
            self._css.append(text)

    def end(self, tag: str) -> None:
        if self._css is not None and tag.rpartition("}")[2] == "style":
            self._check_css("".join(self._css))
            self._css = None

    def pi(self, target: str, _data: Any = None) -> None:
        if target.split()[0] == "xml-stylesheet":
            self._check_css("@import")

    def close(self) -> None:
        pass
