"""What a picture file says about its picture: which way up, how dense, how many frames."""

from __future__ import annotations

import math
import numbers
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import ExifTags, Image

_LEAST_DPI = 1.0  # what says this or less says nothing
_SQUARE = 0.01  # by which the densities across and down may differ
_SWAPPED = (5, 6, 7, 8)  # orientations that exchange width and height
_CM_AN_INCH = 2.54
_INCHES = {2: 1.0, 3: _CM_AN_INCH}  # by ResolutionUnit

Density = tuple[float, float]  # px a length, across and down


@dataclass(frozen=True)
class Tags:
    """What holds for the picture once it is turned upright.

    orientation  1..8 by EXIF, 1: as it is
    dpi          px an inch across and down; None where the file has none
    notes        for the report
    """

    orientation: int
    dpi: Density | None
    notes: tuple[str, ...]


def tags_of(picture: Image.Image) -> Tags:
    """Tags of a picture, asked of a TIFF before it is loaded; broken ones are noted, no error."""
    try:
        exif = dict(picture.getexif())
        notes = ()
    except Exception:  # anything at all is in EXIF data
        exif = {}
        notes = ("EXIF data broken, left out",)
    dpi = _dpi(picture, exif)
    found = tags_from(exif.get(ExifTags.Base.Orientation), dpi, dpi or _proportions(picture))
    return Tags(found.orientation, found.dpi, (*notes, *found.notes))


def tags_from(orientation: Any, dpi: Density | None, proportions: Density | None) -> Tags:
    """Tags by what the file says of its stored rows and columns.

    orientation  anything; what is not 1..8 says nothing
    dpi          px an inch across and down; proportions: the same, perhaps in no unit
    """
    notes = []
    if not isinstance(orientation, int) or not 1 <= orientation <= 8:
        orientation = 1
    if orientation != 1:
        notes.append("turned as its EXIF orientation says")
    if orientation in _SWAPPED:
        dpi = dpi and (dpi[1], dpi[0])
        proportions = proportions and (proportions[1], proportions[0])
    if proportions is not None and abs(proportions[0] / proportions[1] - 1) > _SQUARE:
        notes.append(
            f"pixels are {proportions[1] / proportions[0]:.3g} times as wide as high by its "
            "resolution tag; shown as squares"
        )
    return Tags(orientation, dpi, tuple(notes))


def orientation_left(picture: Image.Image) -> int:
    """EXIF orientation 1..8 of a loaded picture: Pillow turns a TIFF as it loads it."""
    return tags_of(picture).orientation


def upright(array: NDArray[Any], orientation: int) -> NDArray[Any]:
    """An array (h, w, ..) as it is seen: EXIF says where its first row and column are."""
    if orientation in _SWAPPED:
        array = array.swapaxes(0, 1)
    if orientation in (3, 4, 7, 8):  # the first row is the visual bottom; right, if swapped: left
        array = array[::-1]
    if orientation in (2, 3, 6, 7):
        array = array[:, ::-1]
    return np.ascontiguousarray(array)


def frames_note(picture: Image.Image) -> list[str]:
    """A note if there are more frames or pages than the first. Reads on through the file."""
    what = "pages" if picture.format == "TIFF" else "frames"
    try:
        count = getattr(picture, "n_frames", 1)
    except Exception:  # what comes after the first is not asked for, and may be broken
        return [f"first of several {what}"]
    return [f"first of {count} {what}"] if count > 1 else []


def _dpi(picture: Image.Image, exif: dict[int, Any]) -> Density | None:
    """Pixels an inch across and down as stored; None where no tag says so."""
    # Pillow makes up 72 for a JPEG and 1 for a TIFF without one, so their tags are asked.
    stated = picture.info.get("jfif_unit") in (1, 2) or picture.format in ("PNG", "BMP", None)
    dpi = _pair(picture.info.get("dpi")) if stated else None
    if dpi is None:
        tags = exif.get(ExifTags.Base.XResolution), exif.get(ExifTags.Base.YResolution)
        return dpi_in(_pair(tags), exif.get(ExifTags.Base.ResolutionUnit, 2))
    return dpi if min(dpi) > _LEAST_DPI else None


def dpi_in(density: Density | None, unit: Any) -> Density | None:
    """Pixels an inch of a density in a TIFF's ResolutionUnit; None in no unit and for too few."""
    inch = _INCHES.get(unit) if isinstance(unit, int) else None
    if density is None or inch is None or inch * min(density) <= _LEAST_DPI:
        return None
    return inch * density[0], inch * density[1]


def _proportions(picture: Image.Image) -> Density | None:
    """Densities across and down in no unit, where there is nothing else."""
    info = picture.info
    if info.get("jfif_unit") == 0:
        return _pair(info.get("jfif_density"))
    if picture.format == "TIFF":
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
