"""State that the sections share: photos, images as PNG, the page's parts, numbers and verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from common import eight_bits

from .claims import Verdict
from .photos import Pixels, photo
from .settings import Settings

ZOOM = 4  # of crops


@dataclass(frozen=True)
class Picture:
    """An image of the page: its file, size in px, alternative text and caption.

    dark  the file for dark pages, None where one serves both
    """

    file: str
    width: int
    height: int
    alt: str
    caption: str
    dark: str | None = None


@dataclass(frozen=True)
class Table:
    """A table of the page; name is its id, the first text of each line is the row's name."""

    name: str
    caption: str
    head: list[str]
    lines: list[list[str]]


@dataclass
class Book:
    """A page under construction.

    folder    where images go
    shown     the photo whose images are shown
    page      context of the template
    numbers   the numbers of every run, for numbers.json
    """

    settings: Settings
    folder: Path
    photos: dict[str, Pixels]
    shown: str
    page: dict[str, Any] = field(default_factory=dict)
    numbers: dict[str, Any] = field(default_factory=dict)
    verdicts: list[Verdict] = field(default_factory=list)

    @classmethod
    def begin(cls, settings: Settings, folder: Path) -> Book:
        """A book with the photos and no results."""
        photos = {name: photo(name, settings.side) for name in settings.photos}
        folder.mkdir(parents=True, exist_ok=True)
        return cls(settings, folder, photos, settings.photos[0])

    @property
    def pixels(self) -> Pixels:
        """The photo that is shown."""
        return self.photos[self.shown]

    def save(self, name: str, pixels: Pixels, alt: str, caption: str, zoom: int = 1) -> Picture:
        """Save an image (h, w, 3) in 0..1, each pixel as zoom x zoom pixels."""
        image = eight_bits(np.repeat(np.repeat(pixels, zoom, axis=0), zoom, axis=1))
        image.save(self.folder / f"{name}.png", optimize=True)
        return Picture(f"{name}.png", image.width, image.height, alt, caption)


def counted(count: int, noun: str) -> str:
    """Such as "1 seed" and "5 seeds"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def texts(pattern: str, values: Sequence[float]) -> list[str]:
    """Each number by a format such as ".2f"."""
    return [format(value, pattern) for value in values]


def difference(image: Pixels, other: Pixels, gain: float) -> Pixels:
    """Difference times gain, around grey; (h, w, 3) in 0..1."""
    return np.clip(0.5 + gain * (image - other), 0, 1)
