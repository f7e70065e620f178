"""gauss2svg: photos as SVG, fitted by 2D Gaussians and measured by a real renderer."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gauss2svg.version import __version__

if TYPE_CHECKING:
    from gauss2svg.errors import (
        Gauss2SvgError,
        InputError,
        OutputError,
        RendererError,
        SceneError,
    )
    from gauss2svg.gallery import Gallery, GalleryProgress, build_gallery
    from gauss2svg.pipeline import Progress, Result, vectorize
    from gauss2svg.scene import Scene
    from gauss2svg.scoring import CheckResult, check
    from gauss2svg.svg import Page, SvgOptions, outline_svg, read_svg, write_svg

_HOMES = {
    "CheckResult": "scoring",
    "Gallery": "gallery",
    "GalleryProgress": "gallery",
    "Gauss2SvgError": "errors",
    "InputError": "errors",
    "OutputError": "errors",
    "RendererError": "errors",
    "SceneError": "errors",
    "build_gallery": "gallery",
    "check": "scoring",
    "Progress": "pipeline",
    "Result": "pipeline",
    "vectorize": "pipeline",
    "Scene": "scene",
    "Page": "svg",
    "SvgOptions": "svg",
    "outline_svg": "svg",
    "read_svg": "svg",
    "write_svg": "svg",
}

__all__ = [
    "CheckResult",
    "Gallery",
    "GalleryProgress",
    "Gauss2SvgError",
    "InputError",
    "OutputError",
    "Page",
    "Progress",
    "RendererError",
    "Result",
    "Scene",
    "SceneError",
    "SvgOptions",
    "__version__",
    "build_gallery",
    "check",
    "outline_svg",
    "read_svg",
    "vectorize",
    "write_svg",
]


def __getattr__(name: str) -> Any:
    # Names load on first use, so that `import gauss2svg` costs milliseconds.
    if name not in _HOMES:
        raise AttributeError(f"module 'gauss2svg' has no attribute {name!r}")
    return getattr(import_module(f"gauss2svg.{_HOMES[name]}"), name)
