"""Images as arrays, opaque (h, w, 3) or with straight alpha (h, w, 4), sRGB in 0..1.

Over a background of colour b a pixel of colour c and alpha A shows A c + (1 - A) b. Over white
and over black this determines c and A, and over any other grey it is a mean of the two: an image
that matches a photo over both matches it over all.
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor

from gauss2svg.errors import InputError, quoted
from gauss2svg.photo.photo import Photo

WHITE, BLACK = 1.0, 0.0
BACKDROPS = (WHITE, BLACK)
_AVERAGED = 2  # times as small, from which on an average is as good as a filter
_COLOR = re.compile(r"white|black|#(?:[0-9a-f]{3}){1,2}", re.IGNORECASE)


def has_alpha(pixels: NDArray[np.floating]) -> bool:
    """Whether an image is (h, w, 4), and not (h, w, 3)."""
    return pixels.shape[2] == 4


def pixels_of(photo: Photo) -> NDArray[np.float32]:
    """A photo as one array: (h, w, 3) where it is opaque, else (h, w, 4)."""
    if photo.alpha is None:
        return photo.pixels
    return np.dstack([photo.pixels, photo.alpha])


def shrunk(
    pixels: NDArray[np.float32], height: int, width: int, sharp: bool = False
) -> NDArray[np.float32]:
    """Area average on a smaller grid, colour weighted by alpha; black where alpha is 0.

    sharp  by Lanczos' filter instead where the grid is more than half as fine: an average of whole
           pixels then takes one here and two there (docs/decisions/photo.md). Not with alpha,
           around whose edges the filter would leave faint rings
    """
    if (height, width) == pixels.shape[:2]:
        return pixels
    sharp = (
        sharp and not has_alpha(pixels) and _AVERAGED * max(height, width) > max(pixels.shape[:2])
    )
    filter_ = Image.Resampling.LANCZOS if sharp else Image.Resampling.BOX
    if not has_alpha(pixels):
        return _resized(pixels, height, width, filter_)
    weight = alpha_of(pixels)
    alpha = _resized(weight, height, width, filter_)
    premultiplied = _resized(pixels[:, :, :3] * weight, height, width, filter_)
    return straight(premultiplied, alpha[:, :, 0])


def over(
    pixels: NDArray[np.float32], background: float | tuple[float, float, float] = WHITE
) -> NDArray[np.float32]:
    """An image composited over a grey or an sRGB colour in 0..1, (h, w, 3); opaque ones as is."""
    if not has_alpha(pixels):
        return pixels
    color, alpha = pixels[:, :, :3], alpha_of(pixels)
    return np.asarray(color * alpha + (1 - alpha) * np.asarray(background, np.float32), np.float32)


def views(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """(views, h, w, 3): over each of BACKDROPS, or the image itself where it is opaque."""
    if not has_alpha(pixels):
        return pixels[None]
    return np.stack([over(pixels, level) for level in BACKDROPS])


def stacked(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """The views one below the other, (views h, w, 3), for a metric of them all."""
    return views(pixels).reshape(-1, *pixels.shape[1:2], 3)


def alpha_of(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """The alpha channel of an image (h, w, 4), as (h, w, 1)."""
    return pixels[:, :, 3:]


def straight(color: NDArray[np.floating], alpha: NDArray[np.floating]) -> NDArray[np.float32]:
    """(h, w, 4) from premultiplied color (h, w, 3) and alpha (h, w); black where alpha is 0."""
    shown = alpha[:, :, None] > 0
    divided = np.divide(color, alpha[:, :, None], out=np.zeros_like(color), where=shown)
    return np.dstack([np.clip(divided, 0, 1), np.clip(alpha, 0, 1)]).astype(np.float32)


def from_views(white: NDArray[np.floating], black: NDArray[np.floating]) -> NDArray[np.float32]:
    """(h, w, 4) from renderings over white and black, (h, w, 3): A = 1 - (white - black)."""
    return straight(black, np.clip(1 - (white - black).mean(axis=2), 0, 1))


def matte_color(text: str, name: str = "matte") -> tuple[float, float, float]:
    """Colour in 0..1 of white, black, #rgb or #rrggbb; raises InputError for anything else."""
    if not isinstance(text, str) or not _COLOR.fullmatch(text):
        raise InputError(
            f"{name} must be a colour such as white, black, #fa0 or #ffaa00; got {quoted(text)}"
        )
    red, green, blue = ImageColor.getrgb(text)[:3]
    return red / 255, green / 255, blue / 255


def _resized(
    pixels: NDArray[np.float32], height: int, width: int, filter_: Image.Resampling
) -> NDArray[np.float32]:
    planes = [
        Image.fromarray(np.ascontiguousarray(plane)).resize((width, height), filter_)
        for plane in np.moveaxis(pixels, 2, 0)
    ]
    return np.clip(np.stack([np.asarray(p) for p in planes], axis=2), 0, 1, dtype=np.float32)
