"""A drawing enlarged: what several fits agree on between its pixels.

    fits -> renders at four times the size -> their mean, corrected to match each pixel where the
    renders differ -> a larger picture to fit

Every fit is close to the picture and errs elsewhere between its pixels: docs/decisions/enlarged.md.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gauss2svg.photo.alpha import from_views, has_alpha, views

RASTER_TIMES = 4  # size of the renders, times that of the picture
LARGEST = 512  # px of a side up to which a drawing is enlarged; a larger one has pixels enough
LARGE_FROM = 256  # px of a side over which a picture is enlarged twice, not four times
LOCAL_SHARE = 0.3  # share of the variance of 3 x 3 px that is uncertain beside that of the renders
LEAST_VARIANCE = 1e-3  # variance that is uncertain everywhere, in 0..1
CORRECTIONS = 5  # after which few values are left that clipping changed


def may_enlarge(width: int, height: int) -> bool:
    """Whether a drawing of so many px is enlarged."""
    return max(width, height) <= LARGEST


def enlargement(width: int, height: int) -> int:
    """Return how many times as large a drawing of so many px is fitted."""
    return 2 if max(width, height) > LARGE_FROM else 4


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
    share = variance / _spread(_averaged(variance, height, width))
    for _ in range(CORRECTIONS):
        missing = _spread(pixels - _averaged(x, height, width))
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


def _spread(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
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
