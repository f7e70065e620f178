"""SVG renderers behind one function: for each name of gauss2svg.options.Renderer its module."""

from __future__ import annotations

from importlib import import_module
from typing import Any, Protocol, cast, get_args

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, RendererError, quoted
from gauss2svg.options import Renderer
from gauss2svg.photo.alpha import has_alpha, over
from gauss2svg.photo.formats import MOST_PIXELS
from gauss2svg.raster.features import Feature, Features, may_have_features
from gauss2svg.raster.program import wrong_size
from gauss2svg.svg.syntax.parse import ParseError, Root, parse


class RendererModule(Protocol):
    """What a renderer's module has; a browser's also has draw_clear, on a transparent page.

    CANNOT_DRAW  what it draws wrongly, with what is known of that (docs/decisions/renderers.md)
    """

    CANNOT_DRAW: dict[Feature, str]

    def draw(self, svg: str, width: int, height: int) -> NDArray[np.float32]:
        """Unpremultiplied RGBA (height, width, 4) in 0..1; browsers draw over white."""
        ...

    def version(self) -> str:
        """Name and version; raises RendererError where it is not installed."""
        ...


RENDERERS: tuple[str, ...] = get_args(Renderer)
_MODULES = {
    name: cast(RendererModule, import_module(f"gauss2svg.raster.{name}")) for name in RENDERERS
}
BROWSERS = tuple(name for name in RENDERERS if hasattr(_MODULES[name], "draw_clear"))


def renderer_named(name: Any) -> RendererModule:
    """The module of a renderer; raises InputError for any other name."""
    if name not in _MODULES:
        raise InputError(f"renderer must be one of {', '.join(RENDERERS)}; got {quoted(name)}")
    return _MODULES[name]


def drawn_by(*features: Feature) -> tuple[str, ...]:
    """The renderers that draw all of these features."""
    return tuple(
        name for name in RENDERERS if not _MODULES[name].CANNOT_DRAW.keys() & set(features)
    )


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


def refuse_unsupported(svg: str, width: int, height: int, renderer: str) -> Root:
    """Raise RendererError if the renderer draws the SVG wrongly at width x height px.

    Returns its root.
    """
    features = Features(width, height)
    try:
        root = parse(svg, *([features] if may_have_features(svg) else []))
    except ParseError as error:  # renderers draw parts of such files, or nothing
        raise RendererError(
            f"cannot draw the SVG: it must be well-formed XML; got {error}. Try to re-save it"
        ) from error
    except InputError as error:
        raise RendererError(f"cannot draw the SVG: {error}") from error
    refuse(features, renderer)
    return root


def refuse(features: Features, renderer: str) -> None:
    """Raise RendererError if the renderer draws wrongly what a document uses.

    The error names the feature and the renderers that draw it.
    """
    used, cannot = features.used, renderer_named(renderer).CANNOT_DRAW
    for feature in Feature:
        if feature in used and feature in cannot:
            known = drawn_by(feature)
            raise RendererError(
                f"renderer must be one of {', '.join(known)} for what the SVG uses, {feature}; "
                f"got {renderer}. Try --renderer {known[0]}"
            )


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
