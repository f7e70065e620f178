"""Reducing a photo while it is decoded, by libvips."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Size = tuple[int, int]  # width and height in px
# Of a photo of that width and height, as stored; or the longest side in px.
SizeNeeded = Callable[[int, int], Size] | int
# JPEGs are decoded at least so many times as large: libjpeg's own reduced decoding leaves out high
# frequencies, which is no filter of ours (docs/decisions/photo.md).
DRAFT = 3
_OPAQUE = {"uchar": 255, "ushort": 65535, "float": 1}  # alpha by the type of samples


def reduced_size(needed: SizeNeeded | None, width: int, height: int) -> Size | None:
    """The size to which a photo of that size is reduced; None where no side shrinks."""
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
    """Return a smaller picture; one with alpha as floating point in 0..1.

    Opaque pictures by the cubic filter of Catmull and Rom. Others by a triangle, because a filter
    with negative weights would leave faint rings around edges of alpha (docs/decisions/photo.md).
    """
    across, down = (
        small / side for small, side in zip(size, (picture.width, picture.height), strict=True)
    )
    if has_alpha:
        picture = (picture / _OPAQUE[picture.format]).premultiply(max_alpha=1)
    picture = picture.resize(across, vscale=down, kernel="linear" if has_alpha else "cubic")
    return picture.unpremultiply(max_alpha=1) if has_alpha else picture
