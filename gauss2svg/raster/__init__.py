"""SVG renderers behind one function. One module each; add one here to have it everywhere."""

from __future__ import annotations

import io
import re
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg.errors import InputError, RendererError
from gauss2svg.image import over_white
from gauss2svg.raster import cairo, resvg


class _Renderer(Protocol):
    def draw(self, svg: str, width: int, height: int) -> bytes: ...

    def version(self) -> str: ...


_RENDERERS: dict[str, _Renderer] = {"resvg": resvg, "cairo": cairo}
_ROOT = re.compile(r"<svg\b[^>]*>")
_OWN_SIZE = re.compile(r"""\s(?:width|height|preserveAspectRatio)\s*=\s*("[^"]*"|'[^']*')""")
RENDERERS = tuple(_RENDERERS)
DEFAULT_RENDERER = "resvg"  # embedded in a wheel, nothing to install, the most exact of them


def _renderer(name: str) -> _Renderer:
    if name not in _RENDERERS:
        raise InputError(f"renderer is {name!r}; needed is one of {', '.join(RENDERERS)}")
    return _RENDERERS[name]


def renderer_version(name: str) -> str:
    """Name and version of a renderer; raises RendererError where it is not installed."""
    return _renderer(name).version()


def rasterize(
    svg: str, width: int, height: int, renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Draw an SVG at width x height px, over white; (height, width, 3) float32 in 0..1.

    With a viewBox it is stretched to that size, whatever its own proportions.
    Raises RendererError if the renderer is missing or fails on the file.
    """
    png = _renderer(renderer).draw(_stretched(svg, width, height), width, height)
    with Image.open(io.BytesIO(png)) as picture:
        drawn = np.asarray(picture.convert("RGBA"), np.float32) / np.float32(255)
    if drawn.shape[:2] != (height, width):
        raise RendererError(
            f"{renderer} drew {drawn.shape[1]}x{drawn.shape[0]} px; needed is {width}x{height}: "
            "give the SVG a viewBox"
        )
    return over_white(drawn[:, :, :3], drawn[:, :, 3:])


def _stretched(svg: str, width: int, height: int) -> str:
    """The SVG with a root that fills width x height px, if it has a viewBox."""
    root = _ROOT.search(svg)
    if root is None or "viewBox" not in root[0]:
        return svg
    rest = _OWN_SIZE.sub("", root[0][len("<svg") :])
    size = f'<svg width="{width}" height="{height}" preserveAspectRatio="none"'
    return svg[: root.start()] + size + rest + svg[root.end() :]
