"""Texture: whether a picture may have areas, or is a photo.

In a drawing, most blocks of pixels are smooth, and its edges lead from one smooth block to another
within a few pixels. In a photo, few pixels beside an edge are smooth. If a photo is blurred or
enlarged, its edges are wide. If it is clipped to white, it has smooth blocks, but few of its edges
lead from one to another.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from gauss2svg import portable

TILE, TILES = 32, 1024  # side in px, and number, of the tiles that are looked at in larger pictures
LEVELS = np.array([77, 128, 50, 100], np.float32)  # weights of red, green, blue and alpha
SMOOTH = 2.0  # largest difference of neighbours in a smooth block of 2 x 2 pixels, in levels of 255
SMOOTH_SHARE = 0.05  # the same as a share of the edge beside the block, for the waves of JPEG
EDGE, EDGE_PX = 24.0, 4  # least height in levels, and width in px, of an edge between two blocks
# The more of a picture is smooth, the fewer crisp edges it needs (docs/decisions/areas.md). The
# number of edges at a pixel must be at least exp(-STEEPNESS * share) - FREE_EDGES.
STEEPNESS, FREE_EDGES = 9.3, 3e-5
# In small logos as JPEG, few blocks are smooth. A picture of at most LOGO px a side is a drawing if
# TWO_TONED of its pixels near edges are as on one side of them. Photos have at most .64.
LOGO, TWO_TONED = 512, 0.65
# A picture of at most ICON px a side has few such edges. If this share of its blocks has one
# colour, it is a drawing. Photos have at most .1.
ICON, ONE_COLOR = 32, 0.15


def may_have_areas(pixels: NDArray[np.float32]) -> bool:
    """Return whether areas are worth searching in a picture, as they are in a drawing.

    pixels  (h, w, 3), or (h, w, 4) with straight alpha, in 0..1
    """
    tiles = _tiles(pixels)
    if tiles.shape[-1] == 4:
        tiles = np.concatenate([tiles[..., :3] * tiles[..., 3:], tiles[..., 3:]], axis=-1)
    level = portable.product(tiles, LEVELS[: tiles.shape[-1]])
    down, across = (np.abs(np.diff(level, axis=axis)) for axis in (1, 2))
    # Element (y, x) is about the block whose upper left pixel is (y, x).
    rough = np.maximum(
        np.maximum(down[:, :, 1:], down[:, :, :-1]), np.maximum(across[:, 1:], across[:, :-1])
    )
    if min(rough.shape[1:]) <= EDGE_PX:
        return False
    if max(pixels.shape[:2]) <= ICON and np.mean(rough < 1) >= ONE_COLOR:
        return True
    crisp = 0
    for values, ends in ((level, rough), (level.swapaxes(1, 2), rough.swapaxes(1, 2))):
        edge = np.abs(values[:, :-1, 1:-EDGE_PX] - values[:, :-1, EDGE_PX:-1])
        end = np.maximum(ends[:, :, :-EDGE_PX], ends[:, :, EDGE_PX:])
        is_smooth = end <= np.maximum(SMOOTH, SMOOTH_SHARE * edge)
        crisp += np.count_nonzero((edge > EDGE) & is_smooth)
    needed = portable.exp(-STEEPNESS * np.count_nonzero(rough <= SMOOTH) / rough.size)
    if crisp / level.size + FREE_EDGES >= needed:
        return True
    if max(pixels.shape[:2]) > LOGO:
        return False
    is_edge, is_even = two_toned(pixels[..., :3])
    return bool(is_edge.mean() >= 0.4 and is_even.sum() >= TWO_TONED * is_edge.sum())


def two_toned(pixels: NDArray[np.floating]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return which pixels (h, w) are near edges, and which of these are as on one side of them.

    Most pixels near the edges of crisp shapes, such as letters and hatching, are nearly the
    darkest or the brightest ones around them, also in a JPEG. Those of a photo are between.
    """
    high, low = pixels, -pixels
    for axis in (0, 1):
        width = [(4, 4) if k == axis else (0, 0) for k in range(3)]
        high, low = (
            sliding_window_view(np.pad(values, width, "edge"), 9, axis).max(axis=-1)
            for values in (high, low)
        )
    contrast = high + low
    channel = contrast.argmax(axis=2, keepdims=True)
    above, below, contrast = (
        np.take_along_axis(values, channel, 2)[..., 0]
        for values in (high - pixels, pixels + low, contrast)
    )
    is_edge = contrast >= 48 / 255
    return is_edge, is_edge & (np.minimum(above, below) <= 0.15 * contrast)


def _tiles(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return tiles (n, h, w, c) that are spread over a picture, or all of a small picture."""
    h, w, _ = pixels.shape
    if h * w <= TILES * TILE**2:
        return pixels[None]
    rows = min(max(round(math.sqrt(TILES * h / w)), 1), TILES)
    corners = (
        np.linspace(0, max(side - TILE, 0), count).astype(int)
        for side, count in ((h, rows), (w, TILES // rows))
    )
    ys, xs = corners
    return np.stack([pixels[y : y + TILE, x : x + TILE] for y in ys for x in xs])
