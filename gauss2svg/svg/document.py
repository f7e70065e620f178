"""SVG sources as trees of elements; the module of svg/ that knows defusedxml.

Files come from anywhere: document type declarations are refused, and with them entities that
multiply or read other files. Neither write_svg nor Inkscape writes one.
"""

from __future__ import annotations

import gzip
import io
import os
import zlib
from pathlib import Path
from typing import Any

from defusedxml.ElementTree import ParseError, fromstring

from gauss2svg.errors import InputError

GZIP = b"\x1f\x8b"
MOST_BYTES = 256_000_000  # of a gzipped file unpacked: a bomb has a thousand for each of its own


def parse_document(source: str | bytes | os.PathLike[str]) -> Any:
    """The root element of a path (.svg or .svgz), of text or of bytes, gzipped or not.

    A str is text if it has a "<" in it, a path otherwise. Raises InputError for what cannot be
    read, is no XML, or declares a document type.
    """
    name = "the SVG"
    if isinstance(source, os.PathLike) or (isinstance(source, str) and "<" not in source):
        name = os.fspath(source)
        try:
            data: str | bytes = Path(source).read_bytes()
        except (OSError, ValueError) as error:  # ValueError: a null character in the path
            reason = getattr(error, "strerror", None) or error
            raise InputError(f"cannot read {name}: {reason}; give an SVG's path or text") from None
    elif isinstance(source, (str, bytes)):
        data = source
    else:
        raise InputError(f"source is {type(source).__name__}; needed is a path, text or bytes")
    try:
        if isinstance(data, bytes) and data.startswith(GZIP):
            data = gunzipped(data, MOST_BYTES, name)
            if len(data) > MOST_BYTES:
                raise InputError(
                    f"{name} has more than {MOST_BYTES} bytes, gunzipped; needed is no more: "
                    "gunzip it first if it is to be trusted"
                )
        if isinstance(data, str):
            data = data.lstrip("\ufeff \t\r\n")
        return fromstring(data, forbid_dtd=True)
    except InputError:
        raise
    except (ParseError, ValueError, LookupError) as error:
        what = " ".join(f"{type(error).__name__}: {error}".split())
        raise InputError(f"{name} is no SVG: {what}; needed is a file of write_svg") from None


def gunzipped(data: bytes, most_bytes: int, name: str) -> bytes:
    """At most one byte more than most_bytes, however many there would be.

    Raises InputError for what is no whole gzip.
    """
    try:
        with gzip.GzipFile(fileobj=io.BytesIO(data)) as stream:
            return stream.read(most_bytes + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise InputError(f"{name} is broken gzip: {error}; save it anew and try again") from error
