"""The file of an SVG: its name, its bytes, gzipped or not, what parts they are of, and its HTML.

A scene lies below the renderers and cannot draw, so `Scene` asks the function that this module
installs for the HTML that IPython shows. The package and the reader take `Scene` from here, and a
scene alone still loads NumPy and no renderer.
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
    """Whether a file of that name is a gzipped SVG: its extension is .svgz, in any case."""
    return os.fsdecode(path).lower().endswith(".svgz")


def check_svg_name(name: str, path: str | os.PathLike[str]) -> None:
    """Raise InputError for an empty name, that of a folder, and that of another format."""
    text = os.fspath(path)
    if not os.path.basename(text):
        raise refusal(name, "the name of a file, not of a folder", quoted(text))
    if _type_of(text) not in (None, "image/svg+xml", "text/xml", "application/xml"):
        advice = brief(os.path.splitext(text)[0] + ".svg")
        raise refusal(name, "a name that ends in .svg or .svgz", quoted(text), advice)


def check_suffix(name: str, path: str | os.PathLike[str], suffix: str) -> None:
    """Raise InputError for a file name whose suffix is known as of another type than `suffix`."""
    text = os.fspath(path)
    if _type_of(text) not in (None, "text/plain", _type_of(f"x{suffix}")):
        raise refusal(name, f"a name that ends in {suffix}", quoted(text))


def _type_of(path: str) -> str | None:
    return mimetypes.guess_type(os.path.basename(path), strict=False)[0]


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
    # Text and attributes contain no < or > themselves, as both are written as entities.
    gradients, geometry = (sum(map(len, part.findall(data))) for part in (_DEFS, _SHAPES))
    overhead = len(data) - gradients - geometry
    return {"gradients": gradients, "geometry": geometry, "overhead": overhead}


def image(data: bytes, media_type: str, alt: str) -> str:
    """HTML of a picture with its data, no wider than the page.

    It is an <img>, because the gradient ids of two inline SVGs would clash.
    """
    source = f"data:{media_type};base64,{base64.b64encode(data).decode()}"
    return f'<img alt="{html.escape(alt)}" style="max-width:100%" src="{source}"/>'


def picture(scene: Scene) -> str:
    """HTML of a scene as the model's renderer draws it, some 50 kB for any number of shapes."""
    from gauss2svg.render.frame import as_jpeg  # numba, which few scenes are shown for

    return image(as_jpeg(scene), "image/jpeg", repr(scene))


Scene.as_html = picture
