"""The page of a photo: what was asked for by name or by count, found in the photo itself."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.image import Photo
from gauss2svg.segments import labels_of
from gauss2svg.svg import Page

PHOTO_SIZE = "photo"
_MM_AN_INCH = 25.4
_SQUARE = 0.01  # by which the resolutions across and down may differ


def page_for(
    photo: Photo,
    working: NDArray[np.float32],
    *,
    title: str,
    alt: str | None,
    size: str | None,
    aspect: str | None,
    segments: Any,
    animate: float | None,
    fragments: bool,
) -> Page:
    """The page of a photo; see `vectorize` for the options.

    working  (h, w, 3) or (h, w, 4) the photo, perhaps smaller, for superpixels
    Raises InputError for options that are not valid, or that the photo has nothing for.
    """
    if size == PHOTO_SIZE:
        size = _printed_width(photo)
    page = Page(
        title=title, alt=alt, size=size, aspect=aspect, animate=animate, fragments=fragments
    )
    page.sides(photo.width, photo.height)
    if segments is None:
        return page
    labels = labels_of(segments, (photo.width, photo.height), working)
    return dataclasses.replace(page, segments=labels)


def _printed_width(photo: Photo) -> str:
    """Width in mm by the photo's resolution tag."""
    if photo.dpi is None:
        raise InputError(
            f"size is {PHOTO_SIZE!r} and the photo says no resolution; needed is a width such as "
            "120mm"
        )
    across, down = photo.dpi
    if abs(across / down - 1) > _SQUARE:
        raise InputError(
            f"size is {PHOTO_SIZE!r} and the photo's resolution {across:g}x{down:g} dpi, of pixels "
            "that are not square; needed is a width such as 120mm"
        )
    return f"{round(photo.width / across * _MM_AN_INCH, 3):g}mm"
