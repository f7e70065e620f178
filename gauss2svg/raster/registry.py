"""The renderers: for each name of gauss2svg.options.Renderer the module of that name."""

from __future__ import annotations

from importlib import import_module
from typing import Any, Protocol, cast, get_args

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, quoted
from gauss2svg.options import Renderer
from gauss2svg.raster.features import Feature


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
