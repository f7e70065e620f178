"""What a search draws: the photo as it is measured and as it is fitted, and its document."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError
from gauss2svg.fit.options import Tune
from gauss2svg.fit.target import Target, TargetPyramid
from gauss2svg.photo.photo import Photo
from gauss2svg.svg.document import PHOTO_SIZE, Document


@dataclass(frozen=True, eq=False)
class Subject:
    """A photo, and the file that is made of it.

    photo     (h, w, 3) or (h, w, 4) float32 in 0..1, the reference of the measurements
    working   the same, perhaps smaller: the image that a fit runs on
    canvas    width and height in px of the file, which the photo has or had
    document  of the file
    """

    photo: NDArray[np.float32]
    working: NDArray[np.float32]
    canvas: tuple[int, int]
    document: Document = Document()
    _targets: dict[Tune, TargetPyramid] = field(default_factory=dict, init=False)

    @classmethod
    def of(cls, photo: NDArray[np.float32], canvas: tuple[int, int] | None = None) -> Self:
        """A photo that is fitted as it is, by default to a file of its own size."""
        return cls(photo, photo, canvas or photo.shape[1::-1])

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in px of the image that a fit runs on."""
        return self.working.shape[1::-1]

    def targets(self, tune: Tune) -> TargetPyramid:
        """The working image as targets of a fit, whose weight maps are computed once."""
        if tune not in self._targets:
            self._targets[tune] = TargetPyramid(self.working, tune)
        return self._targets[tune]

    def target(self, tune: Tune) -> Target:
        """The working image at its own size."""
        return self.targets(tune).reduced(1)

    def release(self) -> None:
        """Free what fits needed, once there is none to come."""
        self._targets.clear()


def document_for(photo: Photo, document: Document) -> Document:
    """Return the document, with a size by the photo's resolution if it asks for that.

    Raise InputError for a photo without a resolution, or a size that makes a side 0.
    """
    if document.size == PHOTO_SIZE:
        document = dataclasses.replace(document, size=_printed_width(photo))
    document.sides(*photo.full)
    return document


def _printed_width(photo: Photo) -> str:
    """Width in mm, by the photo's resolution tag."""
    if photo.dpi is None:
        raise InputError(
            "size must be a width for a photo without a resolution tag; got 'photo'. Try 120mm"
        )
    across, down = photo.dpi
    # Rounded resolutions of square pixels differ by less than a hundredth.
    if abs(across / down - 1) > 0.01:
        raise InputError(
            f"size must be a width for a photo whose pixels are not square ({across:g}x{down:g} "
            "dpi); got 'photo'. Try 120mm"
        )
    return f"{round(photo.full[0] / across * 25.4, 3):g}mm"
