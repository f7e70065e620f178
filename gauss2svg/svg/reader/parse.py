"""SVG sources as trees of elements, by defusedxml.

Files come from anywhere, so document type declarations are refused, and with them entities that
multiply or read other files; neither write_svg nor Inkscape writes one. Bytes, elements and depth
have limits.
"""

from __future__ import annotations

import gzip
import io
import os
import zlib
from typing import Any
from xml.etree.ElementTree import TreeBuilder

from defusedxml.ElementTree import DefusedXMLParser, ParseError

from gauss2svg.errors import InputError, brief
from gauss2svg.options import file_name

GZIP = b"\x1f\x8b"
MOST_BYTES = 256_000_000  # gunzipped: a gzip bomb expands a thousandfold
MOST_ELEMENTS = 4_000_000  # their tree takes about 3 GB
_DEEPEST = 1000  # renderers draw hardly deeper ones


class _Tree(TreeBuilder):
    """A tree of limited size and depth."""

    def __init__(self, most_elements: int) -> None:
        super().__init__()
        self._most = most_elements
        self._count = self._depth = 0

    def start(self, tag: str, attrs: dict[Any, Any], /) -> Any:
        self._count += 1
        self._depth += 1
        if self._count > self._most:
            raise InputError(
                f"the SVG must be of at most {self._most} elements; got more. Try a "
                "larger max_elements if you trust it"
            )
        if self._depth > _DEEPEST:
            raise InputError(
                f"elements must be nested at most {_DEEPEST} deep; got more. Try to ungroup them"
            )
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> Any:
        self._depth -= 1
        return super().end(tag)


def parse_document(
    source: str | bytes | os.PathLike[str],
    max_bytes: int = MOST_BYTES,
    max_elements: int = MOST_ELEMENTS,
) -> Any:
    """The root element of a path (.svg or .svgz), of text or of bytes, gzipped or not.

    A str with a "<" is text, otherwise a path. Raises InputError for a source that cannot be read,
    is not XML, declares a document type, has more than max_bytes bytes, gunzipped, or more than
    max_elements elements, or nests them more than 1000 deep.
    """
    name = "the SVG"
    if isinstance(source, os.PathLike) or (isinstance(source, str) and "<" not in source):
        name = file_name("source", source)
        try:
            with open(name, "rb") as stream:
                data: str | bytes = stream.read(max_bytes + 1)
        except (OSError, ValueError) as error:  # ValueError: a null character in the path
            reason = getattr(error, "strerror", None) or error
            raise InputError(f"cannot read {name}: {reason}. Try an SVG's path or text") from None
    elif isinstance(source, (str, bytes)):
        data = source
    else:
        raise InputError(f"source must be a path, text or bytes; got {type(source).__name__}")
    _within(data, max_bytes, name)
    try:
        if isinstance(data, bytes) and data.startswith(GZIP):
            data = gunzipped(data, max_bytes, name)
            _within(data, max_bytes, f"{name}, gunzipped,")
        if isinstance(data, str):
            data = data.lstrip("\ufeff \t\r\n")
        parser = DefusedXMLParser(target=_Tree(max_elements), forbid_dtd=True)
        parser.feed(data)
        return parser.close()
    except InputError:
        raise
    except (ParseError, ValueError, LookupError) as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(
            f"{name} must be an SVG; got {brief(what)}. Try a file of write_svg"
        ) from None


def _within(data: str | bytes, max_bytes: int, name: str) -> None:
    if len(data) > max_bytes:
        raise InputError(
            f"{name} must be at most {max_bytes} bytes; got more. Try a larger max_bytes if you "
            "trust it"
        )


def gunzipped(data: bytes, most_bytes: int, name: str) -> bytes:
    """Gunzipped data, at most one byte more than most_bytes.

    Raises InputError for anything but a complete gzip file.
    """
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as stream:
            return stream.read(most_bytes + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(
            f"{name} must be a complete gzip file; got {brief(error)}. Try to re-save it"
        ) from error
