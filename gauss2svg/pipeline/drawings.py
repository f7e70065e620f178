"""Flat drawings: whether a picture is one, what is shaded, and what a tracer would take."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.photo.alpha import views


@dataclass(frozen=True)
class DrawingsTuning:
    """What a flat drawing is (docs/decisions/small.md).

    flat_share      of the pixels that the most frequent colours of a drawing have
    flat_colors     number of colours that count as the most frequent
    most_colors     of one to trace: regions of more lie over each other, and a corner takes several
                    times as much
    bytes_a_corner  of a tracer; vtracer takes 9.3 for one of scikit-image's horse
    gentle          change for each px, in 0..1, up to which a picture is shaded
    shaded_share    of the pixels that are shaded in a drawing with shading
    """

    flat_share: float = 0.4
    flat_colors: int = 4
    most_colors: int = 4
    bytes_a_corner: int = 10
    gentle: float = 0.03
    shaded_share: float = 0.01


TUNING = DrawingsTuning()


def is_drawing(photo: NDArray[np.float32]) -> bool:
    """Whether a few colours make up much of a picture, as the flat ones of a drawing do."""
    colors = _colors(photo)
    shares = np.sort(np.unique(colors, return_counts=True)[1])[-TUNING.flat_colors :] / colors.size
    return bool(shares.sum() >= TUNING.flat_share)


def has_edges(photo: NDArray[np.float32]) -> bool:
    """Whether a picture is a drawing with more colours than one of whole pixels, as edges have."""
    return is_drawing(photo) and not _has_few_colors(_colors(photo))


def is_shaded(photo: NDArray[np.float32]) -> bool:
    """Whether some of a picture is neither flat nor near an edge (docs/decisions/enlarged.md).

    photo  (h, w, 3) or (h, w, 4) float32 in 0..1
    """
    if min(photo.shape[:2]) < 3:
        return False
    down, across = np.gradient(np.concatenate(views(photo), axis=2), axis=(0, 1))
    slope = np.hypot(down, across).max(axis=2)
    steepest = slope  # of 3 x 3 px: beside an antialiased edge some are gentle
    for _ in range(2):
        steepest = np.maximum(np.maximum(steepest[:-2], steepest[1:-1]), steepest[2:]).T
    shaded = (slope[1:-1, 1:-1] > 0) & (steepest < TUNING.gentle)
    return bool(shaded.mean() >= TUNING.shaded_share)


def outline_bytes(pixels: NDArray[np.float32]) -> int | None:
    """About the bytes of an SVG of the outlines of a drawing's flat regions.

    pixels  (h, w, channels) float32 in 0..1
    None for more than four colours, as antialiased edges and photos have. The bytes are those of
    the corners of outlines: blocks of 2 x 2 px with different pixels along both axes.
    """
    colors = _colors(pixels)
    if not _has_few_colors(colors):
        return None
    right = colors[:, 1:] != colors[:, :-1]
    down = colors[1:] != colors[:-1]
    corners = (right[1:] | right[:-1]) & (down[:, 1:] | down[:, :-1])
    return TUNING.bytes_a_corner * int(np.count_nonzero(corners))


def _colors(pixels: NDArray[np.float32]) -> NDArray[np.int64]:
    """(h, w) a number for each colour of 8 bits."""
    weights = 256 ** np.arange(pixels.shape[2])
    return (np.round(pixels * 255).astype(np.int64) * weights).sum(axis=2)


def _has_few_colors(colors: NDArray[np.int64]) -> bool:
    # A few pixels tell for most photos.
    some = colors.ravel()[::97], colors
    return all(len(np.unique(each)) <= TUNING.most_colors for each in some)
