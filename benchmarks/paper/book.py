"""State that the sections share: photos, images, the page's parts, numbers and verdicts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .claims import Verdict
from .photos import Pixels, photo
from .pictures import Gallery
from .settings import Settings


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

    shown     the photo whose images are shown
    page      context of the template
    numbers   the numbers of every run, for numbers.json
    """

    settings: Settings
    gallery: Gallery
    photos: dict[str, Pixels]
    shown: str
    page: dict[str, Any] = field(default_factory=dict)
    numbers: dict[str, Any] = field(default_factory=dict)
    verdicts: list[Verdict] = field(default_factory=list)

    @classmethod
    def begin(cls, settings: Settings, folder: Path) -> Book:
        """A book with the photos and no results."""
        photos = {name: photo(name, settings.side) for name in settings.photos}
        return cls(settings, Gallery(folder), photos, settings.photos[0])

    @property
    def pixels(self) -> Pixels:
        """The photo that is shown."""
        return self.photos[self.shown]

    @property
    def folder(self) -> Path:
        """Where images go."""
        return self.gallery.folder


def counted(count: int, noun: str) -> str:
    """Such as "1 seed" and "5 seeds"."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def texts(pattern: str, values: Sequence[float]) -> list[str]:
    """Each number by a format such as ".2f"."""
    return [format(value, pattern) for value in values]
