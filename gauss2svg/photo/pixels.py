"""Photos in memory: header, size, samples and alpha.

Images are sRGB arrays in 0..1. An opaque image is (h, w, 3). An image with straight alpha is
(h, w, 4). A pixel of colour c and alpha A shows the colour A c + (1 - A) b over a background b. The
two colours that the pixel shows over white and over black determine c and A. The colour that it
shows over any other background is a weighted mean of these two. So an image that matches a photo
over white and over black matches the photo over every background.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from gauss2svg import portable
from gauss2svg.errors import refusal

Size = tuple[int, int]  # width and height in px
# The size to which a photo is reduced: its longest side in px, or a function that takes the stored
# width and height and returns the needed width and height.
SizeNeeded = Callable[[int, int], Size] | int
WHITE, BLACK = 1.0, 0.0
BACKDROPS = (WHITE, BLACK)
LUMA = np.array([0.299, 0.587, 0.114], np.float32)  # share of each channel in the brightness


@dataclass(frozen=True)
class Header:
    """The header of a photo.

    width, height  size in px, as stored
    has_alpha      whether the photo may have alpha
    reduced_bytes  number of bytes of memory that decoding and reducing the photo takes for each
                   pixel of the stored photo. None if all pixels are in memory before the photo is
                   reduced
    """

    width: int
    height: int
    has_alpha: bool
    reduced_bytes: int | None = None

    @property
    def size(self) -> Size:
        """Width and height in px."""
        return self.width, self.height


@dataclass(frozen=True, eq=False)
class Photo:
    """A decoded photo.

    pixels         float32 sRGB in 0..1: (height, width, 3) if every pixel is opaque, else
                   (height, width, 4) with straight alpha. Colours are 0 where alpha is 0
    original_size  width and height in px of the upright photo before any reduction
    notes          notes on the conversions during loading, for the report
    dpi            px per inch across and down, from the file's resolution tag. None if not known
    """

    pixels: NDArray[np.float32]
    original_size: tuple[int, int]
    notes: tuple[str, ...] = ()
    dpi: tuple[float, float] | None = None

    @property
    def width(self) -> int:
        """Width in px."""
        return self.pixels.shape[1]

    @property
    def height(self) -> int:
        """Height in px."""
        return self.pixels.shape[0]


FOCUS_STRENGTH = 4.0  # default of FitOptions.focus_strength (docs/decisions/focus.md)


@dataclass(frozen=True, eq=False)
class Focus:
    """A mask that marks the part of a photo where detail matters.

    mask      (h, w, 1) float32 in 0..1, which is 1 where detail matters. It has the proportions of
              the photo, but it may have another size
    strength  where the mask is 1, an error counts this many times as much as where it is 0
    """

    mask: NDArray[np.float32]
    strength: float = FOCUS_STRENGTH

    def inside(self, height: int, width: int) -> NDArray[np.float32]:
        """Return the mask resized to (height, width)."""
        return shrunk(self.mask, height, width)[:, :, 0]

    def weight(self, height: int, width: int) -> NDArray[np.float32]:
        """Return the weight of the error of each pixel (height, width). The mean weight is 1."""
        weight = 1 + np.float32(self.strength - 1) * self.inside(height, width)
        return weight / weight.mean()


def unit(array: NDArray[Any], name: str) -> NDArray[np.float32]:
    """Return samples (h, w, channels) as float32 in 0..1.

    The samples are uint8, uint16, bool or floats. Integers are divided by the largest value of
    their type. Raise InputError for other types, and if a float is outside of 0..1.
    """
    array = array.astype(array.dtype.newbyteorder("="), copy=False)
    if array.dtype == np.bool_:
        return array.astype(np.float32)
    if array.dtype in (np.uint8, np.uint16):
        return array.astype(np.float32) / np.float32(np.iinfo(array.dtype).max)
    if not np.issubdtype(array.dtype, np.floating):
        needed = "uint8, uint16, bool or floating point"
        raise refusal(f"type of {name}", needed, str(array.dtype), "floats in 0..1")
    bad = ~((array >= 0) & (array <= 1))  # `bad` is true for NaN too
    if bad.any():
        advice = "dividing by the largest value, or clipping"
        if not np.isfinite(array).all():
            advice = "numpy.nan_to_num"
        raise refusal(f"samples of {name}", "finite and in 0..1", str(array[bad][0]), advice)
    return array.astype(np.float32)


def reduced_size(needed: SizeNeeded | None, width: int, height: int) -> Size | None:
    """Return the size to which a photo is reduced, or None if the photo keeps its size."""
    if needed is None:
        return None
    if callable(needed):
        across, down = needed(width, height)
    else:
        scale = needed / max(width, height)
        across, down = (max(1, round(side * scale)) for side in (width, height))
    size = min(across, width), min(down, height)
    return None if size == (width, height) else size


def elongation(width: int, height: int) -> float:
    """Return the longest side of a picture divided by that of one of 3 : 2 with as many pixels.

    It is at least 1. A largest side that is meant for photos is multiplied by this factor for a
    strip. The strip may then have as many pixels as a photo of 3 : 2.
    """
    return max(1.0, math.sqrt(2 / 3 * max(width, height) / min(width, height)))


def has_alpha(pixels: NDArray[np.floating]) -> bool:
    """Return whether an image has an alpha channel. If it has none, its shape is (h, w, 3)."""
    return pixels.shape[2] == 4


def shrunk(
    pixels: NDArray[np.float32], height: int, width: int, sharp: bool = False
) -> NDArray[np.float32]:
    """Return an image reduced by an area average, in which colours are weighted by alpha.

    sharp  whether to use Lanczos' filter in place of the average if the image is opaque and is
           reduced by a factor below 2. At such a factor an average would take one pixel in some
           places and two pixels in others (docs/decisions/photo.md). An image with alpha is always
           averaged, because the filter would leave faint rings around its edges
    """
    if (height, width) == pixels.shape[:2]:
        return pixels
    if not has_alpha(pixels):
        sharp = sharp and 2 * max(height, width) > max(pixels.shape[:2])
        filter_ = Image.Resampling.LANCZOS if sharp else Image.Resampling.BOX
        return _resized(pixels, height, width, filter_)
    weight, filter_ = pixels[:, :, 3:], Image.Resampling.BOX
    alpha = _resized(weight, height, width, filter_)
    premultiplied = _resized(pixels[:, :, :3] * weight, height, width, filter_)
    return straight(premultiplied, alpha[:, :, 0])


def averaged(pixels: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    """Return an image whose pixels are exact means of what they cover, weighted by alpha.

    Where a factor is no whole number, pixels at the rim of a mean count in part. So edges stay
    where they are and get no rings, but they are softer than those of `shrunk`.
    """
    if has_alpha(pixels):
        weight = pixels[:, :, 3:]
        parts = (averaged(part, height, width) for part in (pixels[:, :, :3] * weight, weight))
        color, alpha = parts
        return straight(color, alpha[:, :, 0])
    for axis, count in ((0, height), (1, width)):
        size = pixels.shape[axis]
        rows = np.moveaxis(pixels, axis, 0)
        sums = np.concatenate([np.zeros_like(rows[:1], np.float64), np.cumsum(rows, 0, np.float64)])
        place = np.linspace(0, size, count + 1)
        before = np.minimum(place.astype(np.int64), size - 1)
        share = (place - before)[:, None, None]
        means = np.diff(sums[before] * (1 - share) + sums[before + 1] * share, axis=0)
        pixels = np.moveaxis(means * (count / size), 0, axis).astype(np.float32)
    return np.ascontiguousarray(np.clip(pixels, 0, 1))


def over(
    pixels: NDArray[np.float32], background: float | tuple[float, float, float] = WHITE
) -> NDArray[np.float32]:
    """Return an image composited over a background: (h, w, 3).

    The background is a grey level or an sRGB colour, in 0..1. An opaque image is returned as it is.
    """
    if not has_alpha(pixels):
        return pixels
    color, alpha = pixels[:, :, :3], pixels[:, :, 3:]
    return np.asarray(color * alpha + (1 - alpha) * np.asarray(background, np.float32), np.float32)


def views(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the image over each of BACKDROPS, as k views (k, h, w, 3).

    An opaque image has one view, which is the image itself.
    """
    if not has_alpha(pixels):
        return pixels[None]
    return np.stack([over(pixels, level) for level in BACKDROPS])


def stacked(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return one image (k * h, w, 3) that has all `views` one below the other.

    So a single call of a metric measures all views.
    """
    return views(pixels).reshape(-1, *pixels.shape[1:2], 3)


def straight(color: NDArray[np.floating], alpha: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return an image with straight alpha (h, w, 4) from premultiplied color and alpha (h, w).

    Where alpha is 0, the colour becomes black.
    """
    is_visible = alpha[:, :, None] > 0
    divided = np.divide(color, alpha[:, :, None], out=np.zeros_like(color), where=is_visible)
    return np.dstack([np.clip(divided, 0, 1), np.clip(alpha, 0, 1)]).astype(np.float32)


def from_views(white: NDArray[np.floating], black: NDArray[np.floating]) -> NDArray[np.float32]:
    """Return an image (h, w, 4) from its views over white and over black.

    Its alpha is A = 1 - (white - black), averaged over the channels.
    """
    return straight(black, np.clip(1 - (white - black).mean(axis=2), 0, 1))


def linear_light(value: NDArray[np.floating]) -> NDArray[np.floating]:
    """Return the linear light of sRGB values in 0..1 (IEC 61966-2-1)."""
    return np.where(value <= 0.04045, value / 12.92, portable.power((value + 0.055) / 1.055, 2.4))


def psnr_of(error: float) -> float:
    """Return the PSNR in dB of a mean squared error, which is infinite for 0."""
    return -10 * portable.log10(error) if error > 0 else math.inf


def _resized(
    pixels: NDArray[np.float32], height: int, width: int, filter_: Image.Resampling
) -> NDArray[np.float32]:
    planes = [
        Image.fromarray(np.ascontiguousarray(plane)).resize((width, height), filter_)
        for plane in np.moveaxis(pixels, 2, 0)
    ]
    return np.clip(np.stack([np.asarray(p) for p in planes], axis=2), 0, 1, dtype=np.float32)
