"""An image file whose header is read, and how its pixels are read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from gauss2svg.photo.photo import Header
from gauss2svg.photo.srgb import ColorSpace, by_codes
from gauss2svg.photo.tags import Tags

Rows = Iterator[NDArray[Any]]


@dataclass(eq=False)
class Stored:
    """The first image of a file, as it is stored.

    width, height  in px
    colors         number of channels of colour: 1 of grey, 3 of RGB, INKS of CMYK
    alpha          index of the channel of alpha; None without one
    rows           function of one of the scales that returns rows (n, w, channels), uint8, uint16
                   or float32 in 0..1, from the top, some at a time
    reduced_bytes  see Header
    scales         numbers of times that its decoder can make it smaller
    space          the colour space of RGB or of grey
    tags           orientation, resolution, and notes on them
    notes          on what is changed; the rows may add some
    """

    width: int
    height: int
    colors: int
    alpha: int | None
    rows: Callable[[int], Rows]
    reduced_bytes: int | None
    scales: tuple[int, ...] = (1,)
    space: ColorSpace = field(default_factory=ColorSpace)
    tags: Tags = field(default_factory=Tags)
    notes: list[str] = field(default_factory=list)

    @property
    def header(self) -> Header:
        """The size, and what decoding takes."""
        return Header(self.width, self.height, self.alpha is not None, self.reduced_bytes)

    def set_codes(self, source: str, codes: Sequence[int]) -> None:
        """Set the colour space to primaries and transfer of ITU-T H.273, or note them."""
        primaries, transfer = codes
        coded = by_codes(primaries, transfer, source)
        if coded is None:
            self.notes.append(
                f"{source} with primaries {primaries} and transfer {transfer} not supported; "
                "ignored"
            )
        else:
            self.space = coded

    def note_frames(self, count: int, what: str = "frames") -> None:
        """Add a note if there is more than one frame or page."""
        if count > 1:
            self.notes.append(f"first of {count} {what}")
