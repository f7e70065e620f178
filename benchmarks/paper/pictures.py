"""Images of the page as PNG; equal pixels give equal bytes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from .photos import Pixels

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


class Gallery:
    """Writes images into a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir(parents=True, exist_ok=True)

    def save(self, name: str, pixels: Pixels, alt: str, caption: str, zoom: int = 1) -> Picture:
        """Save an image (h, w, 3) in 0..1, each pixel as zoom x zoom pixels."""
        levels = np.round(np.clip(pixels, 0, 1) * 255).astype(np.uint8)
        levels = np.ascontiguousarray(levels.repeat(zoom, axis=0).repeat(zoom, axis=1))
        Image.fromarray(levels).save(self.folder / f"{name}.png", optimize=True)
        height, width = levels.shape[:2]
        return Picture(f"{name}.png", width, height, alt, caption)


def difference(image: Pixels, other: Pixels, gain: float) -> NDArray[np.float32]:
    """Difference times gain, around grey; (h, w, 3) in 0..1."""
    return np.clip(0.5 + gain * (image - other), 0, 1)
