"""SVG renderers behind one function. One module each; add one here to have it everywhere."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, RendererError
from gauss2svg.photo.alpha import has_alpha, over
from gauss2svg.photo.formats import MOST_PIXELS
from gauss2svg.raster import cairo, chromium, firefox, inkscape, librsvg, resvg
from gauss2svg.raster.root import stretched
from gauss2svg.raster.support import DRAW_BLENDS, DRAW_TURNED_BLURS, refuse_unsupported

__all__ = [
    "DEFAULT_RENDERER",
    "DRAW_BLENDS",
    "DRAW_TURNED_BLURS",
    "RENDERERS",
    "rasterize",
    "rasterize_like",
    "rasterize_rgba",
    "renderer_version",
]


class _Renderer(Protocol):
    def draw(self, svg: str, width: int, height: int) -> NDArray[np.float32]:
        """RGBA (height, width, 4) in 0..1, alpha not multiplied in; browsers draw over white."""
        ...

    def version(self) -> str: ...


_RENDERERS: dict[str, _Renderer] = {
    "resvg": resvg,
    "cairo": cairo,
    "chromium": chromium,
    "librsvg": librsvg,
    "firefox": firefox,
    "inkscape": inkscape,
}
_Draw = Callable[[str, int, int], NDArray[np.float32]]
# The others have no page.
_WITHOUT_A_PAGE: dict[str, _Draw] = {"chromium": chromium.draw_clear, "firefox": firefox.draw_clear}
RENDERERS = tuple(_RENDERERS)
DEFAULT_RENDERER = "resvg"  # embedded in a wheel, nothing to install, quick and exact


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
    Raises RendererError if the renderer is missing, fails on the file, or is known to draw
    wrongly what the file uses.
    """
    return over(_drawn(svg, width, height, renderer, _renderer(renderer).draw))


def rasterize_rgba(
    svg: str, width: int, height: int, renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Draw an SVG on nothing: (height, width, 4) float32 in 0..1, alpha not multiplied in.

    Arguments and errors are those of rasterize. Firefox draws it twice: over white, over black.
    """
    draw = _WITHOUT_A_PAGE.get(renderer, _renderer(renderer).draw)
    return _drawn(svg, width, height, renderer, draw)


def rasterize_like(
    svg: str, picture: NDArray[np.floating], renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Draw an SVG as large as a picture: over white where that is (h, w, 3), else with alpha."""
    height, width = picture.shape[:2]
    draw = rasterize_rgba if has_alpha(picture) else rasterize
    return draw(svg, width, height, renderer)


def _drawn(svg: str, width: int, height: int, renderer: str, draw: _Draw) -> NDArray[np.float32]:
    if width * height > MOST_PIXELS:  # than any photo has
        raise RendererError(
            f"{width}x{height} px are {width * height / 1e6:.0f} million; needed are at most "
            f"{MOST_PIXELS / 1e6:.0f}: draw the SVG smaller"
        )
    try:
        svg.encode()
    except UnicodeEncodeError as error:
        raise RendererError(
            f"{renderer} cannot draw the SVG: its character {error.start} is half of a pair "
            "(a lone surrogate), which no file can hold; remove it"
        ) from error
    refuse_unsupported(svg, width, height, renderer)
    drawn = draw(stretched(svg, width, height) or svg, width, height)
    if drawn.shape[:2] != (height, width):
        raise RendererError(
            f"{renderer} drew {drawn.shape[1]}x{drawn.shape[0]} px; needed is {width}x{height}: "
            "give the SVG a viewBox"
        )
    return drawn
