"""Flat drawings: whether a picture is one, and what in it is shaded or texture.

A drawing is fitted enlarged, to what several fits agree on between its pixels. Every fit is close
to the picture and errs elsewhere between them (docs/decisions/enlarged.md):

    fits -> renders at four times the size -> their mean, corrected to match each pixel where the
    renders differ -> a larger picture to fit
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from gauss2svg.photo.alpha import from_views, has_alpha, views

# Definition of a flat drawing (docs/decisions/small.md).
FLAT_SHARE = 0.4  # share of the pixels that a drawing's most frequent colours have
FLAT_COLORS = 4  # number of colours that count as the most frequent
GENTLE = 0.03  # largest change for each px, in 0..1, of a shaded area
SHADED_SHARE = 0.01  # share of shaded pixels from which a drawing has shading
# Largest second difference between neighbours, in 0..1, of a flat or evenly shaded area: one
# level of 255, and roundings (docs/decisions/enlarged.md).
EVEN = 1.5 / 255
RIM = 2  # distance in px from an even area up to which an uneven pixel is part of an edge
# Share of uneven pixels that are farther, from which a picture is textured, like a photo on
# white.
TEXTURED_SHARE = 0.5


def is_drawing(photo: NDArray[np.float32]) -> bool:
    """Whether a few colours make up much of a picture, as the flat ones of a drawing do."""
    return _flat_share(photo) >= FLAT_SHARE


def has_edges(photo: NDArray[np.float32]) -> bool:
    """Whether what is not flat or evenly shaded in a drawing is mostly its antialiased edges.

    photo  (h, w, 3) or (h, w, 4) float32 in 0..1
    Not so of drawings of whole pixels, which have no other colours, and of photos on a flat ground.
    """
    if _flat_share(photo[::7, ::13]) < FLAT_SHARE / 2:  # most photos
        return False
    return FLAT_SHARE <= _flat_share(photo) < 1 and not _is_textured(photo)


def is_shaded(photo: NDArray[np.float32]) -> bool:
    """Whether some of a picture is neither flat nor near an edge (docs/decisions/enlarged.md).

    photo  (h, w, 3) or (h, w, 4) float32 in 0..1
    """
    if min(photo.shape[:2]) < 3:
        return False
    down, across = np.gradient(_channels(photo), axis=(0, 1))
    slope = np.hypot(down, across).max(axis=2)
    # Beside an antialiased edge some pixels are gentle.
    shaded = (slope > 0) & (_largest(slope, 1) < GENTLE)
    return bool(shaded[1:-1, 1:-1].mean() >= SHADED_SHARE)


def _is_textured(photo: NDArray[np.float32]) -> bool:
    """Whether much that is uneven lies away from what is flat or evenly shaded."""
    pixels, uneven = _channels(photo), np.zeros(photo.shape[:2], bool)
    for axis, inner in enumerate((uneven[1:-1], uneven[:, 1:-1])):
        if photo.shape[axis] > 2:
            inner |= np.abs(np.diff(pixels, 2, axis)).max(axis=2) > EVEN
    uneven = _largest(uneven.astype(np.uint8), 1)
    texture = 1 - _largest(1 - uneven, RIM)
    return bool(texture.sum() > TEXTURED_SHARE * uneven.sum())


def _largest(values: NDArray[Any], reach: int) -> NDArray[Any]:
    """Return (h, w) the largest of the values in the square of so many px around each."""
    return np.asarray(Image.fromarray(values).filter(ImageFilter.MaxFilter(2 * reach + 1)))


def _flat_share(pixels: NDArray[np.float32]) -> float:
    """Share of the pixels that have one of the most frequent colours of 8 bits."""
    numbers = np.round(pixels * 255).astype(np.int64) @ 256 ** np.arange(pixels.shape[2])
    counts = np.sort(np.unique(numbers, return_counts=True)[1])
    return float(counts[-FLAT_COLORS:].sum() / numbers.size)


RASTER_TIMES = 4  # size of the renders, times that of the picture
# Longest side in px of a drawing that is fitted enlarged. A larger one has pixels enough.
LARGEST_ENLARGED = 512
ENLARGED_TWICE_FROM = 256  # px of a side over which a picture is enlarged twice, not four times
LOCAL_SHARE = 0.3  # share of the variance of 3 x 3 px that is uncertain beside that of the renders
LEAST_VARIANCE = 1e-3  # variance that is uncertain everywhere, in 0..1
CORRECTIONS = 5  # after which few values are left that clipping changed


def enlargement(width: int, height: int) -> int:
    """Return how many times as large a drawing of so many px is fitted."""
    return 2 if max(width, height) > ENLARGED_TWICE_FROM else 4


def agreed(
    picture: NDArray[np.float32], renders: Sequence[NDArray[np.float32]], times: int
) -> NDArray[np.float32]:
    """Return the picture enlarged, by renders of fits at four times its size.

    x <- x + v / mean(v) (p - mean(x)), means over the 4 x 4 px of each pixel p of the picture, from
    x = the mean of the renders, with v = their variance + .3 of that of x in 3 x 3 px + .001: as
    in a Kalman filter an observation moves what is uncertain.

    picture  (h, w, 3) or (h, w, 4) float32 in 0..1
    renders  one or more of (4 h, 4 w, channels)
    times    size of the result, times that of the picture: 1, 2 or 4
    """
    height, width = picture.shape[:2]
    pixels = _channels(picture)
    all_ = np.stack([_channels(render) for render in renders])
    x = all_.mean(axis=0)
    channels = x.shape[2]
    variance = np.full((*x.shape[:2], 1), LEAST_VARIANCE, np.float32)
    for k in range(channels):  # one after the other: all at once take 100 MB
        local = LOCAL_SHARE * _local_variance(x[:, :, k])
        variance[:, :, 0] += (all_[:, :, :, k].var(axis=0) + local) / channels
    del all_
    share = variance / _repeated(_averaged(variance, height, width))
    for _ in range(CORRECTIONS):
        missing = _repeated(pixels - _averaged(x, height, width))
        x = np.clip(x + share * missing, 0, 1)
    x = _averaged(x, times * height, times * width)
    return from_views(x[:, :, :3], x[:, :, 3:]) if has_alpha(picture) else x


def _channels(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (h, w, 3), or (h, w, 6) over both backdrops where there is alpha."""
    return np.concatenate(views(pixels), axis=2)


def _averaged(pixels: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    """Return means of blocks, (height, width, channels)."""
    down, across = pixels.shape[0] // height, pixels.shape[1] // width
    blocks = pixels.reshape(height, down, width, across, -1)
    return blocks.mean(axis=(1, 3), dtype=np.float32)


def _repeated(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Repeat each pixel over a block of the renders' size."""
    return pixels.repeat(RASTER_TIMES, axis=0).repeat(RASTER_TIMES, axis=1)


def _local_variance(channel: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return (h, w) the variance in 3 x 3 px."""
    padded = np.pad(channel, 1, mode="edge")
    mean, squares = _sums(padded) / 9, _sums(np.square(padded)) / 9
    return np.maximum(squares - np.square(mean), 0, dtype=np.float32)


def _sums(padded: NDArray[np.floating]) -> NDArray[np.floating]:
    down = padded[:-2] + padded[1:-1] + padded[2:]
    return down[:, :-2] + down[:, 1:-1] + down[:, 2:]
