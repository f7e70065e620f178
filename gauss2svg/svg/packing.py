"""From the text of an SVG to the bytes of its file, gzipped or not, and their breakdown."""

from __future__ import annotations

import gzip
import os
import re

_DEFS = re.compile(rb"<defs>.*?</defs>", re.DOTALL)
_SHAPES = re.compile(rb"<(?:circle|ellipse|use)\b[^>]*>")


def is_svgz(path: str | os.PathLike[str]) -> bool:
    """Whether a file of that name is a gzipped SVG: its extension is .svgz, in any case."""
    return os.fsdecode(path).lower().endswith(".svgz")


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
