"""The document for a photo: its size and segments, where these depend on the photo."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.photo.photo import Photo
from gauss2svg.svg.document import PHOTO_SIZE, Document

_MM_PER_INCH = 25.4
_SQUARE = 0.01  # relative difference of resolutions up to which pixels count as square


def document_for(photo: Photo, working: NDArray[np.float32], document: Document) -> Document:
    """The document with a size and segments taken from the photo where it asks for these.

    working  (h, w, 3) or (h, w, 4) the photo, perhaps smaller, for superpixels
    Raises InputError where the photo has no resolution, or does not match the segments.
    """
    if document.size == PHOTO_SIZE:
        document = dataclasses.replace(document, size=_printed_width(photo))
    document.sides(*photo.full)
    if document.segments is None:
        return document
    from gauss2svg.photo.segments import labels_of  # with scikit-image, and seldom needed

    labels = labels_of(document.segments, photo.full, working)
    return dataclasses.replace(document, segments=labels)


def _printed_width(photo: Photo) -> str:
    """Width in mm, by the photo's resolution tag."""
    if photo.dpi is None:
        raise InputError(
            "size must be a width for a photo without a resolution tag; got 'photo'. Try 120mm"
        )
    across, down = photo.dpi
    if abs(across / down - 1) > _SQUARE:
        raise InputError(
            f"size must be a width for a photo whose pixels are not square ({across:g}x{down:g} "
            "dpi); got 'photo'. Try 120mm"
        )
    return f"{round(photo.full[0] / across * _MM_PER_INCH, 3):g}mm"
