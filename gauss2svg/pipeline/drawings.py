"""Flat drawings: whether a picture is one, and what a tracer would take for it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# Regions of more colours lie over each other, and a corner takes several times as much; vtracer
# takes 9.3 bytes for a corner of scikit-image's horse (docs/decisions/small.md).
_MOST_COLORS, _BYTES_A_CORNER = 4, 10
_SOME = 97
# Share of the pixels that the most frequent colours of a drawing have, and how many these are
# (docs/decisions/small.md).
_FLAT_SHARE, _FLAT_COLORS = 0.4, 4


def is_drawing(photo: NDArray[np.float32]) -> bool:
    """Whether a few colours make up much of a picture, as the flat ones of a drawing do."""
    weights = 256 ** np.arange(photo.shape[2])
    colors = (np.round(photo * 255).astype(np.int64) * weights).sum(axis=2)
    shares = np.sort(np.unique(colors, return_counts=True)[1])[-_FLAT_COLORS:] / colors.size
    return bool(shares.sum() >= _FLAT_SHARE)


def outline_bytes(pixels: NDArray[np.float32]) -> int | None:
    """About the bytes of an SVG of the outlines of a drawing's flat regions.

    pixels  (h, w, channels) float32 in 0..1
    None for more than four colours, as antialiased edges and photos have. The bytes are those of
    the corners of outlines: blocks of 2 x 2 px with different pixels along both axes.
    """
    levels = np.round(pixels * 255).astype(np.uint8)
    colors = (levels * 256 ** np.arange(levels.shape[2])).sum(axis=2).ravel()
    # A few pixels tell for most photos.
    if any(len(np.unique(some)) > _MOST_COLORS for some in (colors[::_SOME], colors)):
        return None
    right = (levels[:, 1:] != levels[:, :-1]).any(axis=2)
    down = (levels[1:] != levels[:-1]).any(axis=2)
    corners = (right[1:] | right[:-1]) & (down[:, 1:] | down[:, :-1])
    return _BYTES_A_CORNER * int(np.count_nonzero(corners))
