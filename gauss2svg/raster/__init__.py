"""Rasterise SVGs by a renderer. Each name of gauss2svg.options.Renderer is a module here.

A renderer's module has

    CANNOT_DRAW               features that it draws wrongly, each with a remark or ""
                              (docs/decisions/renderers.md)
    draw(svg, width, height)  returns straight RGBA (height, width, 4) float32 in 0..1. A browser's
                              `draw` also takes the colour of the page, which is white by default
    version()                 returns the name and version

Both functions raise RendererError if the renderer is not installed.
"""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import get_args
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, RendererError
from gauss2svg.options import Field, Renderer
from gauss2svg.photo.alpha import has_alpha, over
from gauss2svg.photo.formats import MOST_PIXELS
from gauss2svg.raster.features import Feature, uses
from gauss2svg.raster.program import CLEAR
from gauss2svg.svg.source import from_root, stretched

RENDERERS: tuple[str, ...] = get_args(Renderer)
_MODULES = {name: import_module(f"gauss2svg.raster.{name}") for name in RENDERERS}
BROWSERS = "chromium", "firefox"  # renderers whose `draw` also takes the colour of the page


def renderer_named(name: str) -> ModuleType:
    """Return the module of a renderer. Raise InputError for any other name."""
    return _MODULES[Field("renderer", words=RENDERERS).checked(name)]


def drawn_by(*features: Feature) -> tuple[str, ...]:
    """Return the renderers that draw all of these features."""
    return tuple(
        name for name in RENDERERS if _MODULES[name].CANNOT_DRAW.keys().isdisjoint(features)
    )


DEFAULT_RENDERER = "resvg"  # it is fast, accurate, and installed as a wheel
DRAW_ROTATED_BLURS = drawn_by(Feature.TURNED_BLUR)
DRAW_MINIMAL = drawn_by(Feature.MASK, Feature.PLAIN_HREF)  # the features of minimal markup
DRAW_BLENDS = drawn_by(Feature.BLEND, Feature.FILTER)


def renderer_version(name: str) -> str:
    """Return the name and version of a renderer. Raise RendererError if it is not installed."""
    return renderer_named(name).version()


def rasterize(
    svg: str, width: int, height: int, renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Return the raster of an SVG over white: (height, width, 3) float32 in 0..1.

    An SVG with a viewBox is stretched to width x height px, whatever its own proportions. Raise
    RendererError if the renderer is missing, fails on the file, or is known to draw it wrongly.
    """
    return over(_drawn(svg, width, height, renderer, clear=False))


def rasterize_rgba(
    svg: str, width: int, height: int, renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Return the raster of an SVG with straight alpha: (height, width, 4) float32 in 0..1.

    Arguments and errors are those of rasterize. Firefox draws it twice: over white and over black.
    """
    return _drawn(svg, width, height, renderer, clear=True)


def rasterize_like(
    svg: str, picture: NDArray[np.floating], renderer: str = DEFAULT_RENDERER
) -> NDArray[np.float32]:
    """Return a raster of the size of `picture`, over white if that is opaque, else with alpha."""
    height, width = picture.shape[:2]
    draw = rasterize_rgba if has_alpha(picture) else rasterize
    return draw(svg, width, height, renderer)


def rasterize_sized(
    svg: str, width: int, height: int, renderer: str, clear: bool = False
) -> NDArray[np.float32]:
    """Return the raster (height, width, 4) of an SVG that is width x height px large.

    clear  whether the page of a browser is transparent. Else it is white
    """
    page = [CLEAR] if clear and renderer in BROWSERS else []
    pixels = renderer_named(renderer).draw(svg, width, height, *page)
    if pixels.shape[:2] != (height, width):
        got = f"{pixels.shape[1]}x{pixels.shape[0]} px"
        raise RendererError(
            f"raster of {renderer} must be {width}x{height} px; got {got}. Try to draw it smaller, "
            "or another --renderer"
        )
    return pixels


def refuse_unsupported(svg: str, renderer: str) -> None:
    """Raise RendererError if the renderer is known to draw wrongly what an SVG uses."""
    cannot = renderer_named(renderer).CANNOT_DRAW
    for feature in (each for each in Feature if each in cannot and uses(svg, each)):
        others = drawn_by(feature)
        raise RendererError(
            f"renderer must be one of {', '.join(others)} for what the SVG uses, {feature}; "
            f"got {renderer}. Try --renderer {others[0]}"
        )


def _drawn(svg: str, width: int, height: int, renderer: str, clear: bool) -> NDArray[np.float32]:
    if width * height > MOST_PIXELS:  # the same limit as for photos
        raise RendererError(
            f"the raster must be at most {MOST_PIXELS / 1e6:.0f} million px; got "
            f"{width}x{height}, {width * height / 1e6:.0f} million. Try to draw the SVG smaller"
        )
    try:
        text = from_root(svg)
        expat.ParserCreate().Parse(text, True)  # renderers would draw parts of a broken file
    except (InputError, expat.ExpatError, UnicodeEncodeError) as error:
        raise RendererError(f"cannot draw the SVG: {error}. Try to re-save it") from error
    refuse_unsupported(text, renderer)
    return rasterize_sized(stretched(text, width, height), width, height, renderer, clear)
