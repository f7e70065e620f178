"""Text of an SVG from a path, text, bytes or a file, gzipped or not, with a size limit."""

from __future__ import annotations

import codecs
import os
import re
from typing import Any

from gauss2svg.errors import InputError
from gauss2svg.options import file_name
from gauss2svg.svg.reader.parse import GZIP, gunzipped

SvgSource = Any  # a path, text that begins with <, bytes or a binary file

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
_DECLARED = re.compile(rb"""<\?xml[^>]{0,200}?\sencoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")
# Python also knows codecs that XML does not have, such as unicode_escape.
_ENCODINGS = re.compile(r"utf-8|ascii|iso8859-\d+|cp125\d|koi8-[ru]|shift_jis|gb(k|18030)|big5")


def svg_source(source: SvgSource, most_bytes: int) -> tuple[bytes, str]:
    """Bytes of an SVG, gunzipped where it was gzipped, and the text that they encode.

    source      a path, text that begins with <, bytes or a binary file
    most_bytes  limit of the size, also gunzipped, >= 1
    Raises InputError for a source that cannot be read, has more bytes, or is not text.
    """
    if isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<"):
        data = source.encode("utf-8", "surrogatepass")
        _within(len(data), most_bytes, "SVG")
        return data, source.removeprefix("\ufeff")
    data, name = _read(source, most_bytes)
    _within(len(data), most_bytes, name)
    if data.startswith(GZIP):
        data = gunzipped(data, most_bytes, name)
        _within(len(data), most_bytes, f"{name}, gunzipped,")
    if not data.strip():
        raise InputError(f"{name} must be an SVG; got an empty file")
    return data, _decoded(data, name)


def _read(source: SvgSource, most_bytes: int) -> tuple[bytes, str]:
    """The source's bytes, at most one more than the limit, to refuse longer ones; and its name."""
    if isinstance(source, (bytes, bytearray, memoryview)):
        return bytes(source), "SVG"
    if isinstance(source, (str, os.PathLike)):
        name = file_name("svg", source)
        try:
            with open(name, "rb") as file:
                return file.read(most_bytes + 1), name
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError(f"cannot read {name}: {reason}. Try the path of an SVG") from error
    if hasattr(source, "read"):
        data = source.read(most_bytes + 1)
        if isinstance(data, bytes):
            return data, "SVG"
    raise InputError(
        "the SVG must be a path, text that begins with <, bytes or a binary file; got "
        f"{type(source).__name__}"
    )


def _within(size: int, most_bytes: int, name: str) -> None:
    if size > most_bytes:
        raise InputError(
            f"{name} must be at most {most_bytes} bytes; got more. Try to raise --max-svg-bytes "
            "if you trust it"
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
            f"{name} must be an SVG in {encoding}; got {error.reason} at byte {error.start}. "
            "Try to save it as UTF-8"
        ) from error
    if "\0" in text:  # expat would take it for UTF-16 without a byte order mark
        raise InputError(
            f"{name} must be text; got null characters, read as {encoding}. Try to save it as UTF-8"
        )
    return text
