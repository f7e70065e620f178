"""Flat drawings. This module recognises them, their edges and their shading, and enlarges them.

Shapes that are fitted to an enlarged drawing stay crisp when the SVG is enlarged. To enlarge a
drawing, several scenes are fitted to it. At the pixels of the drawing, all scenes are close to it.
Between the pixels, each scene has errors of its own. So the detail on which the scenes agree
becomes the enlarged picture (docs/decisions/enlarged.md):

    fits -> their renders at four times the size -> the mean of the renders, which is corrected
    until it matches each pixel of the drawing, mostly where the renders differ -> a larger picture
    to fit
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from gauss2svg.photo.pixels import from_views, has_alpha, views

Pixels = NDArray[np.float32]  # (h, w, channels), with values in 0..1

# Definition of a flat drawing (docs/decisions/small.md): a picture in which at least FLAT_SHARE of
# the pixels have one of the FLAT_COLORS most frequent colours.
FLAT_SHARE = 0.4
FLAT_COLORS = 4
# A pixel is shaded if its values change there, but by less than this per px. Values are in 0..1.
GENTLE = 0.03
SHADED_SHARE = 0.01  # a drawing has shading if at least this share of its pixels is shaded
# Three neighbouring pixels are uneven if the second difference of their values, which are in 0..1,
# is larger than this. Flat and evenly shaded areas count as even: their values are only rounded to
# levels of 255, so their second differences are at most one level (docs/decisions/enlarged.md).
EVEN = 1.5 / 255
RIM = 2  # px. Uneven pixels that are at most this far from an even area belong to an edge
# A picture is textured if more than this share of its uneven pixels belongs to no edge. For
# example, a photo of an object on a white ground is textured.
TEXTURED_SHARE = 0.5


def is_drawing(photo: Pixels) -> bool:
    """Return whether a picture is a flat drawing: a few colours make up much of it."""
    return _flat_share(photo) >= FLAT_SHARE


def has_edges(photo: Pixels) -> bool:
    """Return whether a picture is a flat drawing with antialiased edges.

    photo  (h, w, 3) or (h, w, 4) float32 in 0..1
    Return False for drawings without antialiasing, which have only a few colours, and for photos of
    objects on a flat ground, which are textured.
    """
    # One pixel in 91 is enough to tell most photos from drawings, and takes less time than all.
    if _flat_share(photo[::7, ::13]) < FLAT_SHARE / 2:
        return False
    return FLAT_SHARE <= _flat_share(photo) < 1 and not _is_textured(photo)


def is_shaded(photo: Pixels) -> bool:
    """Return whether a picture has shaded areas, and not only antialiased edges.

    A shaded drawing may get soft shapes (docs/decisions/enlarged.md).

    photo  (h, w, 3) or (h, w, 4) float32 in 0..1
    """
    if min(photo.shape[:2]) < 3:
        return False
    down, across = np.gradient(_channels(photo), axis=(0, 1))
    slope = np.hypot(down, across).max(axis=2)
    # The values may also change gently beside an antialiased edge. So a pixel counts as shaded only
    # if they change gently at its neighbours too.
    shaded = (slope > 0) & (_largest(slope, 1) < GENTLE)
    return bool(shaded[1:-1, 1:-1].mean() >= SHADED_SHARE)


def _is_textured(photo: Pixels) -> bool:
    """Return whether most uneven pixels belong to no edge.

    An uneven pixel belongs to no edge if it is more than RIM px from all even areas.
    """
    pixels, uneven = _channels(photo), np.zeros(photo.shape[:2], bool)
    for axis, inner in enumerate((uneven[1:-1], uneven[:, 1:-1])):
        if photo.shape[axis] > 2:
            inner |= np.abs(np.diff(pixels, 2, axis)).max(axis=2) > EVEN
    uneven = _largest(uneven.astype(np.uint8), 1)
    texture = 1 - _largest(1 - uneven, RIM)
    return bool(texture.sum() > TEXTURED_SHARE * uneven.sum())


def _largest(values: NDArray, reach: int) -> NDArray:
    """Return an array (h, w) that gives for each pixel the largest value in a square around it.

    reach  distance in px from the pixel to each side of the square
    """
    return np.asarray(Image.fromarray(values).filter(ImageFilter.MaxFilter(2 * reach + 1)))


def _flat_share(pixels: Pixels) -> float:
    """Return the share of pixels that have one of the FLAT_COLORS most frequent 8-bit colours."""
    numbers = np.round(pixels * 255).astype(np.int64) @ 256 ** np.arange(pixels.shape[2])
    counts = np.sort(np.unique(numbers, return_counts=True)[1])
    return float(counts[-FLAT_COLORS:].sum() / numbers.size)


RASTER_TIMES = 4  # factor by which the renders are larger than the drawing
# px. Drawings with a longer side are not enlarged, because they have enough pixels.
LARGEST_ENLARGED = 512
# px. Drawings with a longer side are enlarged 2 times, and all others 4 times.
ENLARGED_TWICE_FROM = 256
# The next three numbers belong to the formula in `agreed`, where v is a sum of three variances. The
# second one is multiplied by LOCAL_SHARE. The third one is LEAST_VARIANCE, for values in 0..1.
LOCAL_SHARE = 0.3
LEAST_VARIANCE = 1e-3
# Number of corrections of x. After each correction, x is clipped to 0..1. Without clipping, one
# correction would be enough. After this many corrections, clipping changes few values.
CORRECTIONS = 5


def enlargement(width: int, height: int) -> int:
    """Return the factor by which a drawing of width x height px is enlarged: 2 or 4."""
    return 2 if max(width, height) > ENLARGED_TWICE_FROM else 4


def agreed(picture: Pixels, renders: Sequence[Pixels], times: int) -> Pixels:
    """Enlarge a picture, and add the detail on which several renders of it agree.

    x is a picture of the size of the renders. It begins as the mean of the renders, and is then
    corrected CORRECTIONS times by

        x <- x + v / mean(v) (p - mean(x)).

    Here p is a pixel of the picture, and each mean is over the 4 x 4 px of x or v that lie in this
    pixel. v is the uncertainty of each px of x. It is a sum of three terms: the variance among the
    renders at this px, .3 times the variance of the renders' mean in the 3 x 3 px around it, and
    .001. The more uncertain a px is, the more it changes, as in a Kalman filter. At the end, x is
    reduced to the size of the result.

    picture  (h, w, 3) or (h, w, 4) float32 in 0..1
    renders  one or more pictures (4 h, 4 w, channels)
    times    factor by which the result is larger than the picture: 1, 2 or 4
    """
    height, width = picture.shape[:2]
    pixels = _channels(picture)
    all_ = np.stack([_channels(render) for render in renders])
    x = all_.mean(axis=0)
    channels = x.shape[2]
    variance = np.full((*x.shape[:2], 1), LEAST_VARIANCE, np.float32)
    for k in range(channels):  # one channel at a time, because all together would take 100 MB
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
    """Return the pixels as (h, w, 3).

    If they have alpha, return them as (h, w, 6): composited over white, and over black.
    """
    return np.concatenate(views(pixels), axis=2)


def _averaged(pixels: Pixels, height: int, width: int) -> Pixels:
    """Return the mean of each block of pixels, as (height, width, channels)."""
    down, across = pixels.shape[0] // height, pixels.shape[1] // width
    blocks = pixels.reshape(height, down, width, across, -1)
    return blocks.mean(axis=(1, 3), dtype=np.float32)


def _repeated(pixels: Pixels) -> Pixels:
    """Enlarge the pixels to the size of the renders by repeating each."""
    return pixels.repeat(RASTER_TIMES, axis=0).repeat(RASTER_TIMES, axis=1)


def _local_variance(channel: Pixels) -> Pixels:
    """Return the variance (h, w) in the 3 x 3 px around each pixel."""
    mean, squares = (_mean_of_nine(x) for x in (channel, np.square(channel)))
    return np.maximum(squares - np.square(mean), 0)


def _mean_of_nine(channel: Pixels) -> Pixels:
    """Return the mean (h, w) in the 3 x 3 px around each pixel. SciPy's import would take 0.1 s."""
    padded = np.pad(channel, 1, mode="edge")
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    rows[:, 1:-1] += rows[:, :-2] + rows[:, 2:]
    return np.divide(rows[:, 1:-1], 9, dtype=np.float32)
