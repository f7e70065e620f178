"""An image file whose header is read, and a function that reads its pixels."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from gauss2svg.photo.photo import Header
from gauss2svg.photo.srgb import PRIMARIES, TRANSFERS, ColorSpace

SWAPPED = (5, 6, 7, 8)  # orientations that exchange width and height
_LEAST_DPI = 1.0  # a resolution of this or less counts as none
_SQUARE = 0.01  # largest relative difference of resolutions at which pixels count as square


@dataclass(eq=False)
class Stored:
    """The first image of a file, as it is stored.

    width, height   size in px
    colors          number of colour channels: 1 of grey, 3 of RGB, INKS of CMYK
    alpha           index of the alpha channel, or None
    picture         function of one of `scales` that returns a picture of libvips. Its samples are
                    uint8, uint16 or float32 in 0..1
    reduced_bytes   as in Header
    scales          factors by which the decoder can make the image smaller
    space           colour space
    orientation     1..8 as in EXIF. 1 is upright as stored
    density         px across and down in one unit of length, as stored. None if the file has none
    is_per_inch     whether this unit is an inch, and not unknown
    notes           notes on changes, for the report
    notes_warnings  whether the decoder's last warning becomes a note
    """

    width: int
    height: int
    colors: int
    alpha: int | None
    picture: Callable[[int], Any]
    reduced_bytes: int | None
    scales: tuple[int, ...] = (1,)
    space: ColorSpace = field(default_factory=ColorSpace)
    orientation: int = 1
    density: tuple[float, float] | None = None
    is_per_inch: bool = True
    notes: list[str] = field(default_factory=list)
    notes_warnings: bool = False

    @property
    def header(self) -> Header:
        """Size, alpha, and memory for decoding."""
        return Header(self.width, self.height, self.alpha is not None, self.reduced_bytes)

    @property
    def upright_size(self) -> tuple[int, int]:
        """Width and height in px of the upright photo."""
        is_swapped = self.orientation in SWAPPED
        return (self.height, self.width) if is_swapped else (self.width, self.height)

    def resolution(self) -> tuple[tuple[float, float] | None, list[str]]:
        """Return px per inch across and down of the upright photo, or None, and notes."""
        if self.density is None or min(self.density) <= 0:
            return None, []
        across, down = self.density[::-1] if self.orientation in SWAPPED else self.density
        notes = []
        if abs(across / down - 1) > _SQUARE:
            notes.append(
                f"pixels are {down / across:.3g} times as wide as high by the resolution tag; "
                "treated as square"
            )
        is_known = self.is_per_inch and min(self.density) > _LEAST_DPI
        return (across, down) if is_known else None, notes

    def set_codes(self, source: str, codes: Sequence[int]) -> None:
        """Set the colour space by H.273 codes (primaries, transfer). Note unknown codes."""
        primaries, transfer = codes
        chromaticity, gamma = PRIMARIES.get(primaries), TRANSFERS.get(transfer)
        if chromaticity and gamma:
            self.space = ColorSpace(None, gamma, chromaticity, source)
        else:
            kind = f"{source} with primaries {primaries} and transfer {transfer}"
            self.notes.append(f"{kind} not supported; ignored")

    def set_gamma(self, gamma: float, chromaticity: Sequence[float]) -> None:
        """Set the colour space by the gAMA of a PNG, and by its cHRM if that has eight numbers."""
        source = f"gAMA of {gamma:g}"
        self.space = ColorSpace(gamma=gamma, source=source)
        if len(chromaticity) == 8:
            self.space = ColorSpace(None, gamma, tuple(chromaticity), f"{source} and cHRM")

    def note_frames(self, count: int, noun: str = "frames") -> None:
        """Add a note if there is more than one frame or page."""
        if count > 1:
            self.notes.append(f"first of {count} {noun}")
