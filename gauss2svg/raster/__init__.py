"""SVG renderers behind one function, a module each."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.photo.alpha import has_alpha, over
from gauss2svg.photo.limits import MOST_PIXELS
from gauss2svg.raster.features import Feature
from gauss2svg.raster.program import wrong_size
from gauss2svg.raster.registry import RENDERERS, drawn_by, renderer_named
from gauss2svg.raster.support import refuse_unsupported

__all__ = [
    "DEFAULT_RENDERER",
    "DRAW_BLENDS",
    "DRAW_MINIMAL",
    "DRAW_ROTATED_BLURS",
    "RENDERERS",
    "rasterize",
    "rasterize_like",
    "rasterize_rgba",
    "rasterize_sized",
    "renderer_version",
]


DEFAULT_RENDERER = "resvg"  # a wheel, with nothing else to install, fast and accurate
DRAW_ROTATED_BLURS = drawn_by(Feature.SKEWED_BLUR)
DRAW_MINIMAL = drawn_by(Feature.MASK, Feature.PLAIN_HREF)  # what minimal markup has
DRAW_BLENDS = drawn_by(Feature.BLEND, Feature.FILTER)


def renderer_version(name: str) -> str:
    """Name and version of a renderer; raises RendererError where it is not installed."""
    return renderer_named(name).version()


def rasterize(
    svg: str, width: int, height: int, renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Raster of an SVG over white: (height, width, 3) float32 in 0..1.

    An SVG with a viewBox is stretched to width x height px, whatever its own proportions. Raises
    RendererError if the renderer is missing, fails on the file, or is known to draw it wrongly.
    """
    return over(rasterize_sized(_sized(svg, width, height, renderer), width, height, renderer))


def rasterize_rgba(
    svg: str, width: int, height: int, renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Raster of an SVG with unpremultiplied alpha: (height, width, 4) float32 in 0..1.

    Arguments and errors are those of rasterize. Firefox draws it twice: over white and over black.
    """
    sized = _sized(svg, width, height, renderer)
    return rasterize_sized(sized, width, height, renderer, clear=True)


def rasterize_like(
    svg: str, picture: NDArray[np.floating], renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Raster of the size of an image: over white for (h, w, 3), with alpha for (h, w, 4)."""
    height, width = picture.shape[:2]
    draw = rasterize_rgba if has_alpha(picture) else rasterize
    return draw(svg, width, height, renderer)


def rasterize_sized(
    svg: str, width: int, height: int, renderer: str, clear: bool = False
) -> NDArray[np.float32]:
    """Raster (height, width, 4) of an SVG that fills width x height px and can be drawn.

    Browsers draw on a page, which is transparent where clear is given, and else white.
    """
    module = renderer_named(renderer)
    draw = getattr(module, "draw_clear", module.draw) if clear else module.draw
    drawn = draw(svg, width, height)
    if drawn.shape[:2] != (height, width):
        raise wrong_size(f"raster of {renderer}", drawn.shape[1::-1], (width, height))
    return drawn


def _sized(svg: str, width: int, height: int, renderer: str) -> str:
    renderer_named(renderer)
    if width * height > MOST_PIXELS:  # the limit of photos
        raise RendererError(
            f"the raster must be at most {MOST_PIXELS / 1e6:.0f} million px; got "
            f"{width}x{height}, {width * height / 1e6:.0f} million. Try to draw the SVG "
            "smaller"
        )
    try:
        svg.encode()
    except UnicodeEncodeError as error:
        raise RendererError(
            "the SVG must be text that a file can hold; got a lone surrogate as character "
            f"{error.start}"
        ) from error
    return refuse_unsupported(svg, width, height, renderer).stretched(width, height)
