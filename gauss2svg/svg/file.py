"""SVG files: checks of their names, their bytes, the bytes of each part, and HTML that shows them.

IPython shows a scene as HTML. `gauss2svg.scene` cannot import a renderer, so this module sets
`Scene.as_html`. The package and the reader import `Scene` from here. `gauss2svg.scene` alone loads
NumPy and no renderer.
"""

from __future__ import annotations

import base64
import gzip
import html
import mimetypes
import os
import re

from gauss2svg.errors import brief, quoted, refusal
from gauss2svg.scene import Scene

_DEFS = re.compile(rb"<defs>.*?</defs>", re.DOTALL)
_SHAPES = re.compile(rb"<(?:circle|ellipse|use)\b[^>]*>")


def is_svgz(path: str | os.PathLike[str]) -> bool:
    """Return whether a file name ends in .svgz, in any case. Such a file is a gzipped SVG."""
    return os.fsdecode(path).lower().endswith(".svgz")


def check_svg_name(name: str, path: str | os.PathLike[str]) -> None:
    """Raise InputError if a file name is empty, a folder's, or has the suffix of another format."""
    text = os.fspath(path)
    if not os.path.basename(text):
        raise refusal(name, "the name of a file, not of a folder", quoted(text))
    if _type_of(text) not in (None, "image/svg+xml", "text/xml", "application/xml"):
        advice = brief(os.path.splitext(text)[0] + ".svg")
        raise refusal(name, "a name that ends in .svg or .svgz", quoted(text), advice)


def check_suffix(name: str, path: str | os.PathLike[str], suffix: str) -> None:
    """Raise InputError if a file name has the suffix of a type other than that of `suffix`."""
    text = os.fspath(path)
    if _type_of(text) not in (None, "text/plain", _type_of(f"x{suffix}")):
        raise refusal(name, f"a name that ends in {suffix}", quoted(text))


def _type_of(path: str) -> str | None:
    return mimetypes.guess_type(os.path.basename(path), strict=False)[0]


def file_bytes(svg: str, gzipped: bool) -> bytes:
    """Return the bytes of an SVG's file. Gzip without a date gives the same bytes each time."""
    data = svg.encode()
    return gzip.compress(data, compresslevel=9, mtime=0) if gzipped else data


def bytes_by_part(svg: str) -> dict[str, int]:
    """Return the number of bytes of each part of a text of write_svg. They add up to its size.

    gradients  all definitions
    geometry   elements of the shapes
    overhead   the rest: root, names, background, groups and style sheet
    """
    data = svg.encode()
    # Text and attributes contain no < or > themselves, as both are written as entities.
    gradients, geometry = (sum(map(len, part.findall(data))) for part in (_DEFS, _SHAPES))
    overhead = len(data) - gradients - geometry
    return {"gradients": gradients, "geometry": geometry, "overhead": overhead}


def image(data: bytes, media_type: str, alt: str) -> str:
    """Return HTML that embeds a picture's data and shows it no wider than the page.

    It is an <img>, because the gradient ids of two inline SVGs would clash.
    """
    source = f"data:{media_type};base64,{base64.b64encode(data).decode()}"
    return f'<img alt="{html.escape(alt)}" style="max-width:100%" src="{source}"/>'


def picture(scene: Scene) -> str:
    """Return HTML that shows a scene as a JPEG: some 50 kB for any number of Gaussians."""
    from gauss2svg.render.frame import as_jpeg  # imports numba, which is slow and seldom needed

    return image(as_jpeg(scene), "image/jpeg", repr(scene))


Scene.as_html = picture
