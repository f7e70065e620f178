"""Bytes, text and tree of an SVG from a path, text, bytes or a file, gzipped or not.

Its size, the number of its elements and their depth are limited.
"""

from __future__ import annotations

import codecs
import gzip
import io
import os
import re
import zlib
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element, SubElement

from gauss2svg.errors import InputError, brief
from gauss2svg.options import file_name
from gauss2svg.svg.syntax.parse import parse

SvgSource = Any  # a path, text that begins with <, bytes or a binary file
MOST_BYTES = 256_000_000  # gunzipped: a gzip bomb expands a thousandfold
BLANKS = "\ufeff \t\r\n"  # that text may begin with
_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_DECLARED = re.compile(rb"""<\?xml[^>]{0,200}?\sencoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
# Python also knows codecs that XML does not have, such as unicode_escape.
_ENCODINGS = re.compile(r"utf-8|ascii|iso8859-\d+|cp125\d|koi8-[ru]|shift_jis|gb(k|18030)|big5")


class Wording(NamedTuple):
    """How errors name a source, its argument, what to try instead, and a larger limit."""

    name: str
    argument: str
    instead: str
    larger: str


CHECKING = Wording("SVG", "svg", "the path of an SVG", "to raise --max-svg-bytes")
READING = Wording("the SVG", "source", "an SVG's path or text", "a larger max_bytes")


def read_source(source: SvgSource, most_bytes: int, said: Wording) -> tuple[str | bytes, str]:
    """The text that is given, or else the source's bytes, gunzipped; and its name.

    A str that begins with < is text, otherwise a path. Raises InputError for a source that cannot
    be read or has more than most_bytes bytes, also gunzipped.
    """
    name = said.name
    if isinstance(source, str) and source.lstrip(BLANKS).startswith("<"):
        _within(source.encode("utf-8", "surrogatepass"), most_bytes, name, said)
        return source, name
    if isinstance(source, (bytes, bytearray, memoryview)):
        data = bytes(source)
    elif isinstance(source, (str, os.PathLike)):
        name = file_name(said.argument, source)
        try:
            with open(name, "rb") as file:
                data = file.read(most_bytes + 1)
        except (OSError, ValueError) as error:  # ValueError: a null character in the path
            reason = getattr(error, "strerror", None) or error
            raise InputError(f"cannot read {name}: {reason}. Try {said.instead}") from error
    else:
        data = source.read(most_bytes + 1) if hasattr(source, "read") else None
    if not isinstance(data, bytes):
        raise InputError(
            f"{said.argument} must be a path, text that begins with <, bytes or a binary file; got "
            f"{type(source).__name__}"
        )
    _within(data, most_bytes, name, said)
    # The magic number of gzip.
    if data.startswith(b"\x1f\x8b"):
        try:
            with gzip.GzipFile(fileobj=io.BytesIO(data)) as stream:
                data = stream.read(most_bytes + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise InputError(
                f"{name} must be a complete gzip file; got {brief(error)}. Try to re-save it"
            ) from error
        _within(data, most_bytes, f"{name}, gunzipped,", said)
    return data, name


def svg_source(source: SvgSource, most_bytes: int) -> tuple[bytes, str]:
    """Bytes of an SVG, gunzipped where it was gzipped, and the text that they encode.

    Raises InputError as read_source, and for bytes that are not text.
    """
    data, name = read_source(source, most_bytes, CHECKING)
    if isinstance(data, str):
        return data.encode("utf-8", "surrogatepass"), data.removeprefix("\ufeff")
    if not data.strip():
        raise InputError(f"{name} must be an SVG; got an empty file")
    return data, _decoded(data, name)


def _within(data: bytes, most_bytes: int, name: str, said: Wording) -> None:
    if len(data) > most_bytes:
        raise InputError(
            f"{name} must be at most {most_bytes} bytes; got more. Try {said.larger} if you "
            "trust it"
        )


def _decoded(data: bytes, name: str) -> str:
    encoding = next((known for mark, known in _MARKS if data.startswith(mark)), None)
    declared = _DECLARED.match(data)
    if encoding is None:
        encoding = declared[1].decode() if declared else "utf-8"
        try:
            known = codecs.lookup(encoding).name
        except LookupError:
            known = ""
        if not _ENCODINGS.fullmatch(known):
            raise InputError(
                f"{name} must be of an encoding that is known; got {encoding[:40]}. Try to save it "
                "as UTF-8"
            )
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        raise InputError(
            f"{name} must be an SVG in {encoding}; got {error.reason} at byte {error.start}. Try "
            "to save it as UTF-8"
        ) from error
    if "\0" in text:  # expat would take it for UTF-16 without a byte order mark
        raise InputError(
            f"{name} must be text; got null characters, read as {encoding}. Try to save it as UTF-8"
        )
    return text


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
