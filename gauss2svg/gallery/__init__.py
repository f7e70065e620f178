"""Galleries: static pages that show what the vectoriser makes of some photos."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gauss2svg.gallery.build import Gallery, GalleryProgress, build_gallery

_HOME = "gauss2svg.gallery.build"

__all__ = ["Gallery", "GalleryProgress", "build_gallery"]


def __getattr__(name: str) -> Any:
    # On first use: the workers import this package, and need no pages.
    if name not in __all__:
        raise AttributeError(f"module 'gauss2svg.gallery' has no attribute {name!r}")
    return getattr(import_module(_HOME), name)
