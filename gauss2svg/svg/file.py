"""The file of an SVG: its name, its bytes, gzipped or not, and what parts they are of."""

from __future__ import annotations

import gzip
import mimetypes
import os
import re

from gauss2svg.errors import InputError, quoted

_DEFS = re.compile(rb"<defs>.*?</defs>", re.DOTALL)
_SHAPES = re.compile(rb"<(?:circle|ellipse|use)\b[^>]*>")


def is_svgz(path: str | os.PathLike[str]) -> bool:
    """Whether a file of that name is a gzipped SVG: its extension is .svgz, in any case."""
    return os.fsdecode(path).lower().endswith(".svgz")


def check_svg_name(name: str, path: str | os.PathLike[str]) -> None:
    """Raise InputError for a file name that an SVG cannot have: empty, or of another format."""
    text = os.fspath(path)
    if not text:
        raise InputError(f"{name} must be the name of a file; got {quoted(text)}")
    if text.endswith(("/", os.sep)):
        raise InputError(f"{name} must be the name of a file, not of a folder; got {quoted(text)}")
    check_type(name, text, ("image/svg+xml", "text/xml", "application/xml"), ".svg or .svgz")


def check_type(name: str, path: str, allowed: tuple[str, ...], suffixes: str) -> None:
    """Raise InputError for a name whose suffix is known as another type than the allowed ones."""
    kind = mimetypes.guess_type(os.path.basename(path), strict=False)[0]
    if kind is not None and kind not in allowed:
        raise InputError(f"{name} must be a name that ends in {suffixes}; got {quoted(path)}")


def file_bytes(svg: str, gzipped: bool) -> bytes:
    """Bytes of the file of an SVG; gzipped at level 9 and without a date, so always the same."""
    data = svg.encode()
    return gzip.compress(data, compresslevel=9, mtime=0) if gzipped else data


def bytes_by_part(svg: str) -> dict[str, int]:
    """Bytes of a text of write_svg by part; they add up to its size.

    gradients  all definitions; geometry: the shapes' own elements; overhead: the rest, which is
    the root, names, background, groups and a style sheet
    """
    data = svg.encode()
    found = _DEFS.search(data)
    gradients = len(found[0]) if found else 0
    # Text and attributes contain no < or > themselves, as both are written as entities.
    geometry = sum(len(tag) for tag in _SHAPES.findall(data))
    return {
        "gradients": gradients,
        "geometry": geometry,
        "overhead": len(data) - gradients - geometry,
    }
