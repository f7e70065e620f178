"""A drawing enlarged: where the files of several fits agree between its pixels.

    files of some fits -> rasters of four times the size -> their mean, which what each pixel
    lacks moves to where the rasters differ -> a picture of twice the size to fit

Every fit is close to the picture and errs elsewhere between its pixels: docs/decisions/enlarged.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.photo.alpha import from_views, has_alpha, views
from gauss2svg.raster import rasterize_like


@dataclass(frozen=True)
class EnlargedTuning:
    """How a drawing is enlarged (docs/decisions/enlarged.md).

    from_bytes  of a file, from which a drawing is fitted once more, enlarged
    up_to       longest side in px of the drawing
    times       size of the rasters, times that of the picture
    size        size of the enlarged picture, times that of the picture
    contrast    share of the variance of 3 x 3 px that is uncertain beside that of the rasters
    floor       variance that is uncertain everywhere, in 0..1
    steps       corrections, after which few values are left that clipping took
    """

    from_bytes: int = 2000
    up_to: int = 256
    times: int = 4
    size: int = 2
    contrast: float = 0.3
    floor: float = 1e-3
    steps: int = 5


TUNING = EnlargedTuning()


def may_enlarge(width: int, height: int, limit: int | None) -> bool:
    """Whether a drawing of so many px is fitted once more, enlarged, for a file of these bytes."""
    return limit is not None and limit >= TUNING.from_bytes and max(width, height) <= TUNING.up_to


def large_raster(svg: str, picture: NDArray[np.float32], renderer: str) -> NDArray[np.float32]:
    """The raster of an SVG at four times the size of a picture."""
    height, width, channels = picture.shape
    large = np.empty((TUNING.times * height, TUNING.times * width, channels), np.float32)
    return rasterize_like(svg, large, renderer)


def enlarged(
    picture: NDArray[np.float32], rasters: Sequence[NDArray[np.float32]]
) -> NDArray[np.float32]:
    """The picture at twice its size, by rasters of four times its size.

    x <- x + v / mean(v) (p - mean(x)), means over the 4 x 4 px of each pixel p of the picture, from
    x = the mean of the rasters, with v = their variance + .3 of that of x in 3 x 3 px + .001: as
    in a Kalman filter an observation moves what is uncertain.

    picture  (h, w, 3) or (h, w, 4) float32 in 0..1
    rasters  one or more of (4 h, 4 w, channels)
    """
    tuning = TUNING
    height, width = picture.shape[:2]
    wanted = _channels(picture)
    all_ = np.stack([_channels(raster) for raster in rasters])
    found = all_.mean(axis=0)
    channels = found.shape[2]
    uncertain = np.full((*found.shape[:2], 1), tuning.floor, np.float32)
    for k in range(channels):  # one after the other: all at once take 100 MB
        local = tuning.contrast * _local_variance(found[:, :, k])
        uncertain[:, :, 0] += (all_[:, :, :, k].var(axis=0) + local) / channels
    del all_
    share = uncertain / _spread(_averaged(uncertain, height, width))
    for _ in range(tuning.steps):
        missing = _spread(wanted - _averaged(found, height, width))
        found = np.clip(found + share * missing, 0, 1)
    found = _averaged(found, tuning.size * height, tuning.size * width)
    return from_views(found[:, :, :3], found[:, :, 3:]) if has_alpha(picture) else found


def _channels(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w, 3), or (h, w, 6) over both backdrops where there is alpha."""
    return np.concatenate(views(pixels), axis=2)


def _averaged(pixels: NDArray[np.float32], height: int, width: int) -> NDArray[np.float32]:
    """Means of blocks, (height, width, channels)."""
    down, across = pixels.shape[0] // height, pixels.shape[1] // width
    blocks = pixels.reshape(height, down, width, across, -1)
    return blocks.mean(axis=(1, 3), dtype=np.float32)


def _spread(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Each pixel as a block of the rasters' size."""
    return pixels.repeat(TUNING.times, axis=0).repeat(TUNING.times, axis=1)


def _local_variance(channel: NDArray[np.float32]) -> NDArray[np.float32]:
    """(h, w) the variance in 3 x 3 px."""
    padded = np.pad(channel, 1, mode="edge")
    mean, squares = _sums(padded) / 9, _sums(np.square(padded)) / 9
    return np.maximum(squares - np.square(mean), 0, dtype=np.float32)


def _sums(padded: NDArray[np.floating]) -> NDArray[np.floating]:
    down = padded[:-2] + padded[1:-1] + padded[2:]
    return down[:, :-2] + down[:, 1:-1] + down[:, 2:]
