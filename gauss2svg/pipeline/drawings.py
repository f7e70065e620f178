"""Flat drawings: tests for their edges and shading, and the enlarged picture to fit.

A drawing is fitted enlarged. Several fits are close to the drawing at its pixels, but each errs
differently between the pixels. The enlarged picture is what the fits agree on
(docs/decisions/enlarged.md):

    fits -> renders at four times the size -> their mean, corrected to match each pixel where the
    renders differ -> a larger picture to fit
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from gauss2svg.photo.pixels import from_views, has_alpha, views

Pixels = NDArray[np.float32]  # (h, w, channels), of values in 0..1

# Definition of a flat drawing (docs/decisions/small.md).
FLAT_SHARE = 0.4  # least share of a drawing's pixels that have its most frequent colours
FLAT_COLORS = 4  # number of colours that count as the most frequent
GENTLE = 0.03  # largest change per px, in 0..1, in a shaded area
SHADED_SHARE = 0.01  # smallest share of shaded pixels of a drawing with shading
# Largest second difference between neighbours, in 0..1, of a flat or evenly shaded area. It
# allows for one level of 255 and rounding (docs/decisions/enlarged.md).
EVEN = 1.5 / 255
RIM = 2  # px; uneven pixels at most this far from an even area are part of an edge
# A picture is textured, like a photo on white, if more than this share of its uneven pixels is
# farther than RIM from even areas.
TEXTURED_SHARE = 0.5


def is_drawing(photo: Pixels) -> bool:
    """Return whether a few colours make up much of a picture, as in a flat drawing."""
    return _flat_share(photo) >= FLAT_SHARE


def has_edges(photo: Pixels) -> bool:
    """Return whether a picture is a drawing whose uneven pixels are mostly antialiased edges.

    photo  (h, w, 3) or (h, w, 4) float32 in 0..1
    Return False for drawings without antialiasing, which have only a few colours, and for photos on
    a flat ground.
    """
    if _flat_share(photo[::7, ::13]) < FLAT_SHARE / 2:  # every 91st pixel rules out most photos
        return False
    return FLAT_SHARE <= _flat_share(photo) < 1 and not _is_textured(photo)


def is_shaded(photo: Pixels) -> bool:
    """Return whether a picture has shaded areas away from edges (docs/decisions/enlarged.md).

    photo  (h, w, 3) or (h, w, 4) float32 in 0..1
    """
    if min(photo.shape[:2]) < 3:
        return False
    down, across = np.gradient(_channels(photo), axis=(0, 1))
    slope = np.hypot(down, across).max(axis=2)
    # A pixel beside an antialiased edge may change gently, so its neighbours must do so too.
    shaded = (slope > 0) & (_largest(slope, 1) < GENTLE)
    return bool(shaded[1:-1, 1:-1].mean() >= SHADED_SHARE)


def _is_textured(photo: Pixels) -> bool:
    """Return whether most uneven pixels lie away from flat or evenly shaded areas."""
    pixels, uneven = _channels(photo), np.zeros(photo.shape[:2], bool)
    for axis, inner in enumerate((uneven[1:-1], uneven[:, 1:-1])):
        if photo.shape[axis] > 2:
            inner |= np.abs(np.diff(pixels, 2, axis)).max(axis=2) > EVEN
    uneven = _largest(uneven.astype(np.uint8), 1)
    texture = 1 - _largest(1 - uneven, RIM)
    return bool(texture.sum() > TEXTURED_SHARE * uneven.sum())


def _largest(values: NDArray, reach: int) -> NDArray:
    """Return the largest value (h, w) in the square that extends `reach` px around each pixel."""
    return np.asarray(Image.fromarray(values).filter(ImageFilter.MaxFilter(2 * reach + 1)))


def _flat_share(pixels: Pixels) -> float:
    """Return the share of the pixels that have one of the most frequent 8-bit colours."""
    numbers = np.round(pixels * 255).astype(np.int64) @ 256 ** np.arange(pixels.shape[2])
    counts = np.sort(np.unique(numbers, return_counts=True)[1])
    return float(counts[-FLAT_COLORS:].sum() / numbers.size)


RASTER_TIMES = 4  # ratio of the renders' size to the picture's
# px, longest side of a drawing that is fitted enlarged. A larger drawing has enough pixels.
LARGEST_ENLARGED = 512
ENLARGED_TWICE_FROM = 256  # px. Pictures with a longer side are enlarged 2 times, others 4 times
LOCAL_SHARE = 0.3  # share of the variance in 3 x 3 px that is added to the renders' variance
LEAST_VARIANCE = 1e-3  # variance that is added everywhere, of values in 0..1
CORRECTIONS = 5  # number of corrections. After them, clipping changes few values


def enlargement(width: int, height: int) -> int:
    """Return the factor, 2 or 4, by which a drawing of width x height px is enlarged."""
    return 2 if max(width, height) > ENLARGED_TWICE_FROM else 4


def agreed(picture: Pixels, renders: Sequence[Pixels], times: int) -> Pixels:
    """Return the picture enlarged, with the detail on which renders at four times its size agree.

    x begins as the mean of the renders and is corrected CORRECTIONS times by

        x <- x + v / mean(v) (p - mean(x)),

    with means over the 4 x 4 px of each pixel p of the picture, and v = variance of the renders
    + .3 variance of x in 3 x 3 px + .001. Uncertain values move most, as in a Kalman filter.

    picture  (h, w, 3) or (h, w, 4) float32 in 0..1
    renders  one or more pictures (4 h, 4 w, channels)
    times    ratio of the result's size to the picture's: 1, 2 or 4
    """
    height, width = picture.shape[:2]
    pixels = _channels(picture)
    all_ = np.stack([_channels(render) for render in renders])
    x = all_.mean(axis=0)
    channels = x.shape[2]
    variance = np.full((*x.shape[:2], 1), LEAST_VARIANCE, np.float32)
    for k in range(channels):  # one channel at a time, because all at once would take 100 MB
        local = LOCAL_SHARE * _local_variance(x[:, :, k])
        variance[:, :, 0] += (all_[:, :, :, k].var(axis=0) + local) / channels
    del all_
    share = variance / _repeated(_averaged(variance, height, width))
    for _ in range(CORRECTIONS):
        missing = _repeated(pixels - _averaged(x, height, width))
        x = np.clip(x + share * missing, 0, 1)
    x = _averaged(x, times * height, times * width)
    return from_views(x[:, :, :3], x[:, :, 3:]) if has_alpha(picture) else x


def _channels(pixels: Pixels) -> Pixels:
    """Return the pixels as (h, w, 3). With alpha, return them over both backdrops as (h, w, 6)."""
    return np.concatenate(views(pixels), axis=2)


def _averaged(pixels: Pixels, height: int, width: int) -> Pixels:
    """Return the mean of each block of pixels, as (height, width, channels)."""
    down, across = pixels.shape[0] // height, pixels.shape[1] // width
    blocks = pixels.reshape(height, down, width, across, -1)
    return blocks.mean(axis=(1, 3), dtype=np.float32)


def _repeated(pixels: Pixels) -> Pixels:
    """Return the pixels enlarged to the renders' size by repetition."""
    return pixels.repeat(RASTER_TIMES, axis=0).repeat(RASTER_TIMES, axis=1)


def _local_variance(channel: Pixels) -> Pixels:
    """Return the variance (h, w) in the 3 x 3 px around each pixel."""
    from scipy.ndimage import uniform_filter  # the import takes 0.1 s

    mean, squares = (uniform_filter(x, 3, mode="nearest") for x in (channel, np.square(channel)))
    return np.maximum(squares - np.square(mean), 0)
