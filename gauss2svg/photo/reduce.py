"""Reduce a photo by libvips while it is decoded."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Size = tuple[int, int]  # width and height in px
# A function (width, height as stored) that returns the size needed, or the longest side in px.
SizeNeeded = Callable[[int, int], Size] | int
# libjpeg decodes a JPEG at least this many times as large as needed, and `resized` does the rest.
# libjpeg itself leaves out high frequencies, which is a poor filter (docs/decisions/photo.md).
DRAFT = 3
_OPAQUE = {"uchar": 255, "ushort": 65535, "float": 1}  # alpha of an opaque sample by its type


def reduced_size(needed: SizeNeeded | None, width: int, height: int) -> Size | None:
    """Return the size to which a photo is reduced, or None if no side shrinks."""
    if needed is None:
        return None
    if callable(needed):
        across, down = needed(width, height)
    else:
        scale = needed / max(width, height)
        across, down = (max(1, round(side * scale)) for side in (width, height))
    size = min(across, width), min(down, height)
    return None if size == (width, height) else size


def resized(picture: Any, size: Size, has_alpha: bool) -> Any:
    """Return a smaller picture. One with alpha has floating-point samples in 0..1.

    Opaque pictures are reduced by the cubic filter of Catmull and Rom, and others by a triangle
    filter. A filter with negative weights would leave faint rings around edges of alpha
    (docs/decisions/photo.md).
    """
    across, down = (
        small / side for small, side in zip(size, (picture.width, picture.height), strict=True)
    )
    if has_alpha:
        picture = (picture / _OPAQUE[picture.format]).premultiply(max_alpha=1)
    picture = picture.resize(across, vscale=down, kernel="linear" if has_alpha else "cubic")
    return picture.unpremultiply(max_alpha=1) if has_alpha else picture
