"""gauss2svg: photos as SVG, fitted by 2D Gaussians and measured by a real renderer."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from gauss2svg.version import __version__

if TYPE_CHECKING:
    from gauss2svg.batch.many import vectorize_many
    from gauss2svg.batch.options import BatchOptions
    from gauss2svg.batch.records import PhotoRecord
    from gauss2svg.errors import (
        ClusterError,
        Gauss2SvgError,
        InputError,
        OutputError,
        RendererError,
        SceneError,
    )
    from gauss2svg.fit.options import DensifyOptions, FitOptions
    from gauss2svg.gallery.build import Gallery, GalleryProgress, build_gallery
    from gauss2svg.gallery.options import GalleryOptions
    from gauss2svg.measure.check import CheckResult, check
    from gauss2svg.pipeline.options import Goal, Options, RunOptions, SvgOptions
    from gauss2svg.pipeline.placeholder import Placeholder, placeholder
    from gauss2svg.pipeline.quantize import quantize
    from gauss2svg.pipeline.result import Result
    from gauss2svg.pipeline.run import Progress
    from gauss2svg.pipeline.vectorize import vectorize
    from gauss2svg.scene import Scene
    from gauss2svg.svg.document import Document
    from gauss2svg.svg.format import SvgFormat
    from gauss2svg.svg.reader.read import read_svg
    from gauss2svg.svg.write import outline_svg, write_svg

_HOMES = {
    "batch.many": ("vectorize_many",),
    "batch.options": ("BatchOptions",),
    "batch.records": ("PhotoRecord",),
    "errors": (
        "ClusterError",
        "Gauss2SvgError",
        "InputError",
        "OutputError",
        "RendererError",
        "SceneError",
    ),
    "fit.options": ("DensifyOptions", "FitOptions"),
    "gallery.options": ("GalleryOptions",),
    "gallery.build": ("Gallery", "GalleryProgress", "build_gallery"),
    "measure.check": ("CheckResult", "check"),
    "pipeline.options": ("Goal", "Options", "RunOptions", "SvgOptions"),
    "pipeline.placeholder": ("Placeholder", "placeholder"),
    "pipeline.quantize": ("quantize",),
    "pipeline.result": ("Result",),
    "pipeline.run": ("Progress",),
    "pipeline.vectorize": ("vectorize",),
    "scene": ("Scene",),
    "svg.document": ("Document",),
    "svg.format": ("SvgFormat",),
    "svg.reader.read": ("read_svg",),
    "svg.write": ("outline_svg", "write_svg"),
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "BatchOptions",
    "CheckResult",
    "ClusterError",
    "DensifyOptions",
    "Document",
    "FitOptions",
    "Gallery",
    "GalleryOptions",
    "GalleryProgress",
    "Gauss2SvgError",
    "Goal",
    "InputError",
    "Options",
    "OutputError",
    "PhotoRecord",
    "Placeholder",
    "Progress",
    "RendererError",
    "Result",
    "RunOptions",
    "Scene",
    "SceneError",
    "SvgFormat",
    "SvgOptions",
    "__version__",
    "build_gallery",
    "check",
    "outline_svg",
    "placeholder",
    "quantize",
    "read_svg",
    "vectorize",
    "vectorize_many",
    "write_svg",
]


def __getattr__(name: str) -> Any:
    # Names load on first use, so that `import gauss2svg` costs milliseconds.
    if name == "studio":  # gauss2svg.studio.app, without an import of its own
        return import_module("gauss2svg.studio")
    if name not in _HOME_OF:
        raise AttributeError(f"module 'gauss2svg' has no attribute {name!r}")
    return getattr(import_module(f"gauss2svg.{_HOME_OF[name]}"), name)
