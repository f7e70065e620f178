"""Reading of untrusted SVGs: their bytes, their text from the root on, and their XML.

Everything before the root is dropped, so that neither the parser nor a renderer sees a document
type or an encoding. A document type with declarations of its own is refused, and so is a file with
more bytes than the limit.
"""

from __future__ import annotations

import gzip
import io
import os
import re
import zlib
from typing import Any
from xml.etree import ElementTree

from gauss2svg.errors import InputError, brief, quoted, refusal
from gauss2svg.files import reason_of
from gauss2svg.options import file_name

SvgSource = Any  # a path, text that begins with <, bytes or a binary file
SVG = "{http://www.w3.org/2000/svg}"
INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"
BLANKS = "\ufeff \t\r\n"  # characters that may precede the first <
MOST_BYTES = 256_000_000  # limit of a gunzipped file: a gzip bomb expands a thousandfold
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}  # byte order marks
_DECLARED = re.compile(rb"""<\?xml[^>]{0,200}?\sencoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
# Blanks, comments, processing instructions except xml-stylesheet, and document types without
# declarations.
_BEFORE_ROOT = re.compile(
    r"""(?:[\s\ufeff]++|<\?(?!xml-stylesheet).*?\?>|<!--.*?-->|<!DOCTYPE(?:[^\[\]<>"']|"[^"]*"|'[^']*')*+>)*+""",
    re.DOTALL,
)
_ATTRIBUTE = re.compile(r"""\s+([^\s=/>]+)\s*=\s*(?:"[^"]*"|'[^']*')""")
_START_TAG = re.compile(rf"<([^\s/>]+)((?:{_ATTRIBUTE.pattern})*+)")


def read_source(
    source: SvgSource, most_bytes: int, argument: str = "svg", limit: str = "--max-svg-bytes"
) -> tuple[bytes, str]:
    """Return the bytes of an SVG, gunzipped, and the text that they encode.

    A str is text if it begins with <, and a path otherwise. Raise InputError if the source cannot
    be read, or if it has more than most_bytes bytes, gunzipped. The messages use the names
    `argument` and `limit`.
    """
    name, data = "the SVG", source
    if isinstance(source, str) and source.lstrip(BLANKS).startswith("<"):
        data = source.encode("utf-8", "surrogatepass")
    elif isinstance(source, (str, os.PathLike)):
        name = file_name(argument, source)
        try:
            with open(name, "rb") as file:
                data = file.read(most_bytes + 1)
        except (OSError, ValueError) as error:  # ValueError: a null character in the path
            raise InputError(f"cannot read {name}: {reason_of(error)}. Try another path") from error
    elif hasattr(source, "read"):
        data = source.read(most_bytes + 1)
    if not isinstance(data, bytes):
        needed = "a path, text that begins with <, bytes or a binary file"
        raise refusal(argument, needed, type(source).__name__)
    if data.startswith(b"\x1f\x8b"):  # the magic number of gzip
        try:
            with gzip.GzipFile(fileobj=io.BytesIO(data)) as stream:
                data = stream.read(most_bytes + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise refusal(name, "a complete gzip file", brief(error), "to re-save it") from error
    if len(data) > most_bytes:
        advice = f"to raise {limit} if you trust it"
        raise refusal(name, f"at most {most_bytes} bytes, gunzipped", "more", advice)
    if isinstance(source, str) and name == "the SVG":
        return data, source
    return data, _decoded(data, name)


def _decoded(data: bytes, name: str) -> str:
    declared = _DECLARED.match(data)
    encoding = _MARKS.get(data[:2], declared[1].decode() if declared else "utf-8")
    try:
        return data.decode(encoding)
    except (LookupError, ValueError) as error:
        needed = f"an SVG in {encoding[:40]}"
        raise refusal(name, needed, brief(error), "to save it as UTF-8") from error


def from_root(text: str) -> str:
    """Return the text from the root on.

    Raise InputError if the text has a null character, or if a document type with declarations or a
    style sheet of another file precedes the root.
    """
    # expat takes null characters for UTF-16, and would find elements that no renderer finds.
    if "\0" in text:
        raise refusal("the SVG", "without null characters", "some", "to save it as UTF-8")
    rest = _BEFORE_ROOT.sub("", text, count=1)
    if rest.startswith(("<!DOCTYPE", "<?xml-stylesheet")):
        needed = "without a document type of its own or a style sheet of another file"
        got, advice = quoted(rest[:60]), "to save it as plain SVG"
        raise refusal("the SVG", needed, got, advice)
    return rest


def parse(text: str, target: Any = None) -> Any:
    """Return the tree of an SVG's text, or the result of `target` as the parser's target.

    The text begins with the root. Raise InputError if it is not well-formed XML.
    """
    try:
        parser = ElementTree.XMLParser(target=target)
        parser.feed(text)
        return parser.close()
    except (ElementTree.ParseError, UnicodeEncodeError, OverflowError) as error:
        raise refusal("the SVG", "well-formed XML", brief(error), "to re-save it") from error


def stretched(text: str, width: int, height: int, view_box: str | None = None) -> str:
    """Return an SVG's text with its root stretched to width x height px.

    view_box is the visible part. If it is None, the root keeps its own viewBox, and a text whose
    root has none is returned as it is. A width in the root's style changes nothing in any renderer.
    """
    size = {"width": width, "height": height, "preserveAspectRatio": "none"}
    if view_box is not None:
        size["viewBox"] = view_box
    tag = _START_TAG.match(text)
    own = [(one[1], one[0]) for one in _ATTRIBUTE.finditer(tag[2])] if tag else []
    if tag is None or (view_box is None and "viewBox" not in dict(own)):
        return text
    written = "".join(f' {name}="{value}"' for name, value in size.items())
    kept = "".join(attribute for name, attribute in own if name not in size)
    return f"<{tag[1]}{written}{kept}{text[tag.end() :]}"
