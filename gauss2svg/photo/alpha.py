"""Pictures with alpha: straight sRGB and alpha in 0..1, (h, w, 4), and how pages show them.

Over a page of colour b a pixel of colour c and alpha A is A c + (1 - A) b. Over white and over
black it says all that there is to know of c and A, and over any other page it is a mean of the
two: what is near to a photo over both is near to it everywhere.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from gauss2svg.errors import InputError, must_be
from gauss2svg.photo.image import Photo, shrink_photo

WHITE, BLACK = 1.0, 0.0
BACKDROPS = (WHITE, BLACK)
_CHANNELS = 4
_COLOR = re.compile(r"white|black|#(?:[0-9a-f]{3}){1,2}", re.IGNORECASE)


def has_alpha(pixels: NDArray[np.floating]) -> bool:
    """Whether a picture is (h, w, 4), and not (h, w, 3)."""
    return pixels.shape[2] == _CHANNELS


def pixels_of(photo: Photo) -> NDArray[np.float32]:
    """A photo as one array: (h, w, 3) where it is opaque, else (h, w, 4)."""
    if photo.alpha is None:
        return photo.pixels
    return np.dstack([photo.pixels, photo.alpha])


def photo_of(pixels: NDArray[np.float32]) -> Photo:
    """The inverse of pixels_of, but for notes and resolution."""
    if not has_alpha(pixels):
        return Photo(pixels)
    return Photo(np.ascontiguousarray(pixels[:, :, :3]), alpha=pixels[:, :, 3].copy())


def shrunk(pixels: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    """Area average of a picture on a smaller grid, weighted by alpha where it has one."""
    return pixels_of(shrink_photo(photo_of(pixels), height, width))


def over(pixels: NDArray[np.float32], page: float = WHITE) -> NDArray[np.float32]:
    """A picture as a page of a grey level in 0..1 shows it, (h, w, 3); an opaque one as it is."""
    if not has_alpha(pixels):
        return pixels
    color, alpha = pixels[:, :, :3], pixels[:, :, 3:]
    return np.asarray(color * alpha + (1 - alpha) * np.float32(page), np.float32)


def views(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """(pages, h, w, 3): over each of BACKDROPS, or the picture itself where it is opaque."""
    if not has_alpha(pixels):
        return pixels[None]
    return np.stack([over(pixels, page) for page in BACKDROPS])


def stacked(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Its views one below the other, (pages h, w, 3), for metrics of them all."""
    return views(pixels).reshape(-1, *pixels.shape[1:2], 3)


def alpha_of(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Alpha of a picture (h, w, 4) as a picture of one channel, (h, w, 1)."""
    return pixels[:, :, 3:]


def straight(color: NDArray[np.floating], alpha: NDArray[np.floating]) -> NDArray[np.float32]:
    """(h, w, 4) of colours times alpha, (h, w, 3), and alpha (h, w); black where alpha is 0."""
    shown = alpha[:, :, None] > 0
    divided = np.divide(color, alpha[:, :, None], out=np.zeros_like(color), where=shown)
    return np.dstack([np.clip(divided, 0, 1), np.clip(alpha, 0, 1)]).astype(np.float32)


def from_views(white: NDArray[np.floating], black: NDArray[np.floating]) -> NDArray[np.float32]:
    """(h, w, 4) of what is drawn over white and over black, (h, w, 3): A = 1 - (white - black)."""
    return straight(black, np.clip(1 - (white - black).mean(axis=2), 0, 1))


def matte_color(text: str, name: str = "matte") -> tuple[float, float, float]:
    """Colour in 0..1 of white, black, #rgb or #rrggbb; raises InputError for anything else."""
    if not isinstance(text, str) or not _COLOR.fullmatch(text):
        raise InputError(must_be(name, "a colour such as white, black, #fa0 or #ffaa00", text))
    red, green, blue = ImageColor.getrgb(text)[:3]
    return red / 255, green / 255, blue / 255
