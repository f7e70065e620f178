"""An image file whose header is read, and how its pixels are read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from gauss2svg.photo.photo import Header
from gauss2svg.photo.srgb import SRGB, ColorSpace
from gauss2svg.photo.tags import UPRIGHT, Tags

Rows = Iterator[NDArray[Any]]


@dataclass(frozen=True, eq=False)
class Stored:
    """The first image of a file, as it is stored.

    width, height  in px
    colors         number of channels of colour: 1 of grey, 3 of RGB, INKS of CMYK
    alpha          index of the channel of alpha; None without one
    rows           function of one of the scales that returns rows (n, w, channels), uint8, uint16
                   or float32, from the top, some at a time
    top            largest value of a sample; None: that of its type, or 1 of floats
    is_negative    whether 0 is white
    is_premultiplied  whether colors are multiplied by alpha
    space          the colour space of RGB or of grey
    tags           orientation, resolution, and notes on them
    notes          on what is changed; the rows may add some
    reduced_bytes  see Header
    scales         numbers of times that its decoder can make it smaller
    """

    width: int
    height: int
    colors: int
    alpha: int | None
    rows: Callable[[int], Rows]
    reduced_bytes: int | None
    top: int | None = None
    is_negative: bool = False
    is_premultiplied: bool = False
    space: ColorSpace = SRGB
    tags: Tags = UPRIGHT
    notes: list[str] = field(default_factory=list)
    scales: tuple[int, ...] = (1,)

    @property
    def header(self) -> Header:
        """The size, and what decoding takes."""
        return Header(self.width, self.height, self.alpha is not None, self.reduced_bytes)


def frames_note(count: int, what: str = "frames") -> list[str]:
    """Return a note if there is more than one frame or page."""
    return [f"first of {count} {what}"] if count > 1 else []
