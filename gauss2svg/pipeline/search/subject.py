"""What a search draws: the photo as it is measured and as it is fitted."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.choices import Tune
from gauss2svg.fit.options import DEFAULT_DTYPE
from gauss2svg.fit.target import Target, TargetPyramid
from gauss2svg.svg.document import Document


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
            self._targets[tune] = TargetPyramid(self.working, DEFAULT_DTYPE, tune)
        return self._targets[tune]

    def target(self, tune: Tune) -> Target:
        """The working image at its own size."""
        return self.targets(tune).reduced(1)

    def release(self) -> None:
        """Free what fits needed, once there is none to come."""
        self._targets.clear()
