"""Orientation and resolution, by the tags of a TIFF or of EXIF data."""

from __future__ import annotations

import math
import numbers
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.ExifTags import Base

BROKEN_EXIF = "EXIF data broken; ignored"
_LEAST_DPI = 1.0  # a resolution of this or less counts as none
_SQUARE = 0.01  # relative difference of resolutions up to which pixels count as square
_INCHES = {2: 1.0, 3: 2.54}  # by ResolutionUnit: px per inch of 1 px per unit
SWAPPED = (5, 6, 7, 8)  # orientations that exchange width and height

Density = tuple[float, float]  # px per length, across and down


@dataclass(frozen=True)
class Tags:
    """Orientation of the stored image, and resolution of the upright one.

    orientation  1..8 as in EXIF; 1: upright as stored
    dpi          px per inch across and down; None where the file has none
    notes        for the report
    """

    orientation: int = 1
    dpi: Density | None = None
    notes: tuple[str, ...] = ()


def exif_tags(
    exif: bytes | None, *, is_turned: bool = False
) -> tuple[dict[int, Any], tuple[str, ...]]:
    """Return the tags of EXIF data, and a note if the data are broken.

    is_turned  whether the decoder has turned the photo already, whatever its tag says
    """
    tags = Image.Exif()
    try:
        tags.load(exif or b"")
        found = dict(tags)
    except Exception:  # hostile bytes make the EXIF reader raise anything
        return {}, (BROKEN_EXIF,)
    if is_turned:
        found.pop(Base.Orientation, None)
    return found, ()


def tags_of(
    tags: Mapping[int, Any], notes: tuple[str, ...] = (), density: Any = None, unit: Any = 0
) -> Tags:
    """Return the orientation and the resolution of the upright photo.

    density  px across and down for each unit, a ResolutionUnit, as stored; None: by the tags
    """
    density = _pair(density)
    if density is None:
        density = _pair((tags.get(Base.XResolution), tags.get(Base.YResolution)))
        unit = tags.get(Base.ResolutionUnit, 2)
    orientation, more = tags.get(Base.Orientation), list(notes)
    if not isinstance(orientation, int) or not 1 <= orientation <= 8:
        orientation = 1
    if orientation != 1:
        more.append("EXIF orientation applied")
    if density is None:
        return Tags(orientation, None, tuple(more))
    across, down = reversed(density) if orientation in SWAPPED else density
    if abs(across / down - 1) > _SQUARE:
        more.append(
            f"pixels are {down / across:.3g} times as wide as high by the resolution tag; "
            "treated as square"
        )
    inch = _INCHES.get(unit, 0) if isinstance(unit, int) else 0
    dpi = (inch * across, inch * down) if inch * min(density) > _LEAST_DPI else None
    return Tags(orientation, dpi, tuple(more))


def upright(array: NDArray[Any], orientation: int) -> NDArray[Any]:
    """An array (h, w, ..) rotated and mirrored by an orientation (EXIF 2.32, 4.6.4, tag 274)."""
    if orientation in SWAPPED:
        array = array.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):  # the first row is seen at the bottom
        array = array[::-1]
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    return np.ascontiguousarray(array)


def turned(size: tuple[int, int], orientation: int) -> tuple[int, int]:
    """Width and height of an upright image that is stored with that size."""
    return (size[1], size[0]) if orientation in SWAPPED else size


def _pair(values: Any) -> Density | None:
    """Two finite numbers above 0, None for anything else."""
    if not isinstance(values, (tuple, list)) or len(values) != 2:
        return None
    if not all(isinstance(v, numbers.Real) for v in values):
        return None
    across, down = float(values[0]), float(values[1])
    return (across, down) if 0 < across < math.inf and 0 < down < math.inf else None
