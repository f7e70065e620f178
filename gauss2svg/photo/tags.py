"""Tags of an image file: orientation, resolution, number of frames."""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.ExifTags import Base

_LEAST_DPI = 1.0  # a resolution of this or less counts as none
_SQUARE = 0.01  # relative difference of resolutions up to which pixels count as square
SWAPPED = (5, 6, 7, 8)  # orientations that exchange width and height

Density = tuple[float, float]  # px per length, across and down


@dataclass(frozen=True)
class Tags:
    """Orientation of the stored image, and resolution of the upright one.

    orientation  1..8 as in EXIF; 1: upright as stored
    dpi          px per inch across and down; None where the file has none
    notes        for the report
    """

    orientation: int
    dpi: Density | None
    notes: tuple[str, ...]


def tags_of(image: Image.Image) -> Tags:
    """Tags of an image, of a TIFF before it is loaded; broken ones give a note, no error."""
    try:
        exif = dict(image.getexif())
        notes = ()
    except Exception:  # hostile bytes make the EXIF reader raise anything
        exif = {}
        notes = ("EXIF data broken; ignored",)
    dpi = _dpi(image, exif)
    found = tags_from(exif.get(Base.Orientation), dpi, dpi or _proportions(image))
    return Tags(found.orientation, found.dpi, (*notes, *found.notes))


def tags_from(orientation: Any, dpi: Density | None, proportions: Density | None) -> Tags:
    """Tags of the upright photo from those of its stored rows and columns.

    orientation  anything; values other than 1..8 count as 1
    dpi          px per inch across and down; proportions: the same, perhaps without a unit
    """
    notes = []
    if not isinstance(orientation, int) or not 1 <= orientation <= 8:
        orientation = 1
    if orientation != 1:
        notes.append("EXIF orientation applied")
    if orientation in SWAPPED:
        dpi = dpi and (dpi[1], dpi[0])
        proportions = proportions and (proportions[1], proportions[0])
    if proportions is not None and abs(proportions[0] / proportions[1] - 1) > _SQUARE:
        notes.append(
            f"pixels are {proportions[1] / proportions[0]:.3g} times as wide as high by the "
            "resolution tag; treated as square"
        )
    return Tags(orientation, dpi, tuple(notes))


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


def frames_note(image: Image.Image) -> list[str]:
    """A note if there is more than one frame or page; reads through the file."""
    what = "pages" if image.format == "TIFF" else "frames"
    try:
        count = getattr(image, "n_frames", 1)
    except Exception:  # frames after the first are not used, and may be broken
        return [f"first of several {what}"]
    return [f"first of {count} {what}"] if count > 1 else []


def _dpi(image: Image.Image, exif: dict[int, Any]) -> Density | None:
    """Pixels per inch across and down as stored; None without such a tag."""
    # Pillow invents 72 for a JPEG and 1 for a TIFF without one, so their own tags are read.
    stated = image.info.get("jfif_unit") in (1, 2) or image.format in ("PNG", "BMP", None)
    dpi = _pair(image.info.get("dpi")) if stated else None
    if dpi is None:
        tags = exif.get(Base.XResolution), exif.get(Base.YResolution)
        return dpi_in(_pair(tags), exif.get(Base.ResolutionUnit, 2))
    return dpi if min(dpi) > _LEAST_DPI else None


def dpi_in(density: Density | None, unit: Any) -> Density | None:
    """Pixels per inch of a density in a TIFF's ResolutionUnit; None without a unit or if tiny."""
    # ResolutionUnit 2 is inches, 3 is centimetres.
    inch = {2: 1.0, 3: 2.54}.get(unit) if isinstance(unit, int) else None
    if density is None or inch is None or inch * min(density) <= _LEAST_DPI:
        return None
    return inch * density[0], inch * density[1]


def _proportions(image: Image.Image) -> Density | None:
    """Densities across and down without a unit, where the file has no others."""
    info = image.info
    if info.get("jfif_unit") == 0:
        return _pair(info.get("jfif_density"))
    if image.format == "TIFF":
        return _pair(info.get("resolution"))
    return _pair(info.get("aspect"))  # of a PNG


def _pair(values: Any) -> Density | None:
    """Two finite numbers above 0, None for anything else."""
    if not isinstance(values, (tuple, list)) or len(values) != 2:
        return None
    if not all(isinstance(v, numbers.Real) for v in values):
        return None
    across, down = float(values[0]), float(values[1])
    return (across, down) if 0 < across < math.inf and 0 < down < math.inf else None
