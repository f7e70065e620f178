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
from PIL import Image

from gauss2svg import portable
from gauss2svg.photo.pixels import LUMA, over, shrunk, views

SMOOTH = 2.0  # largest difference of neighbours in a smooth block of 2 x 2 pixels, in levels of 255
EDGE_PX = 4  # largest width of an edge between two blocks
# A picture is flat if at most MOST_UNEVEN of its blocks have several colours, at most MOST_WIDE of
# these are in squares of WIDE such blocks, and at least LEAST_STEPS of these have a step of STEP
# levels (docs/decisions/areas.md).
MOST_UNEVEN, WIDE, MOST_WIDE, STEP, LEAST_STEPS = 0.35, 9, 0.25, 3.0, 0.1
MOSTLY_WIDE = 0.5  # share of such squares in a drawing with glows: .51 to .9
# Largest energy of what a smaller picture lacks, for each of the steps between pixels. It is .03 in
# pictures that were enlarged so, and at least .11 in clean ones.
MOST_FINER = 0.045
# Sides in px of a picture that may be an enlarged drawing
MOST_DOUBLED = 1024
# In small logos as JPEG, few blocks are smooth. A picture of at most LOGO px a side is a drawing if
# TWO_TONED of its pixels near edges are as on one side of them. Photos have at most .64.
LOGO, TWO_TONED = 512, 0.65
GLOSSY = 0.77  # share of these pixels: .56 to .75 in glossy logos, .8 in flat ones
ICON = 48  # px of the larger side of an icon
FEW_PIXELS = 2**15  # largest number of pixels of a small picture


def may_have_areas(pixels: NDArray[np.float32]) -> bool:
    """Return whether areas are worth searching in a picture, as they are in a drawing.

    pixels  (h, w, 3), or (h, w, 4) with straight alpha, in 0..1
    """
    if _is_drawn(pixels):
        return True
    if max(pixels.shape[:2]) > MOST_DOUBLED:
        return False
    small = undoubled(pixels)
    return small is not pixels and _is_drawn(small)


def is_icon(pixels: NDArray[np.float32]) -> bool:
    """Return whether a picture has so few pixels that only its areas tell whether it is drawn."""
    return max(pixels.shape[:2]) <= ICON


def is_small(pixels: NDArray[np.float32]) -> bool:
    """Return whether a picture has few pixels, so that shapes are hardly larger than these."""
    return pixels.shape[0] * pixels.shape[1] <= FEW_PIXELS


def _is_drawn(pixels: NDArray[np.float32]) -> bool:
    """Return whether a picture that was not enlarged has the edges of a drawing."""
    level, rough = _levels(pixels)
    if min(rough.shape[1:]) <= EDGE_PX:
        return False
    # Icons have few edges, and one colour in most blocks. Photos have one in at most .1.
    if max(pixels.shape[:2]) <= 32 and np.mean(rough < 1) >= 0.15:
        return True
    if _is_flat(rough):
        return True
    crisp = 0
    for values, ends in ((level, rough), (level.swapaxes(1, 2), rough.swapaxes(1, 2))):
        edge = np.abs(values[:, :-1, 1:-EDGE_PX] - values[:, :-1, EDGE_PX:-1])
        end = np.maximum(ends[:, :, :-EDGE_PX], ends[:, :, EDGE_PX:])
        is_smooth = end <= np.maximum(SMOOTH, 0.05 * edge)  # beside an edge, JPEG leaves waves
        crisp += np.count_nonzero((edge > 24) & is_smooth)
    # The more of a picture is smooth, the fewer edges it needs (docs/decisions/areas.md).
    needed = portable.exp(-9.3 * np.count_nonzero(rough <= SMOOTH) / rough.size)
    if crisp / level.size + 3e-5 >= needed:
        return True
    if max(pixels.shape[:2]) > LOGO:
        return False
    is_edge, is_even = two_toned(pixels[..., :3])
    return bool(is_edge.mean() >= 0.4 and is_even.sum() >= TWO_TONED * is_edge.sum())


def is_flat(pixels: NDArray[np.float32]) -> bool:
    """Return whether blocks of one colour surround all others, however thin or pale these are.

    Charts of thin lines have few crisp edges, and so have waves of nearly one colour. What is
    not flat in a photo is wide, and slow shading has no block with a step.

    pixels  (h, w, 3), or (h, w, 4) with straight alpha, in 0..1
    """
    return _is_flat(_levels(pixels)[1])


def is_shaded(pixels: NDArray[np.float32]) -> bool:
    """Return whether most of what is not flat in a drawing is wide, as glows and gloss are."""
    return _wide_share(_levels(pixels)[1]) > MOSTLY_WIDE


def _is_flat(rough: NDArray[np.float32]) -> bool:
    uneven = rough >= 1
    if not 0 < uneven.sum() <= MOST_UNEVEN * uneven.size or _wide_share(rough) > MOST_WIDE:
        return False
    return bool(np.mean(rough[uneven] >= STEP) >= LEAST_STEPS)


def _wide_share(rough: NDArray[np.float32]) -> float:
    """Return the share of uneven blocks that are in squares of WIDE such blocks."""
    wide = uneven = rough >= 1
    if not uneven.any():
        return 0.0
    for join in (np.logical_and, np.logical_or):  # erosion and dilation
        for axis in (1, 2):
            ends = [(WIDE // 2, WIDE // 2) if k == axis else (0, 0) for k in range(3)]
            windows = sliding_window_view(np.pad(wide, ends, "edge"), WIDE, axis)
            wide = join.reduce(np.moveaxis(windows, -1, 0))
    return float(wide.sum() / uneven.sum())


def _levels(pixels: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the brightness (n, h, w) of tiles of a picture, and how rough their blocks are.

    Both are in levels of 255. Element (y, x) of the second is the largest difference of neighbours
    in the block of 2 x 2 pixels whose upper left one is (y, x).
    """
    tiles = _tiles(pixels)
    if tiles.shape[-1] == 4:
        tiles = np.concatenate([tiles[..., :3] * tiles[..., 3:], tiles[..., 3:]], axis=-1)
    red_green_blue_alpha = np.array([77, 128, 50, 100], np.float32)
    level = portable.product(tiles, red_green_blue_alpha[: tiles.shape[-1]])
    down, across = (np.abs(np.diff(level, axis=axis)) for axis in (1, 2))
    rough = np.maximum(
        np.maximum(down[:, :, 1:], down[:, :, :-1]), np.maximum(across[:, 1:], across[:, :-1])
    )
    return level, rough


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


def is_between_tones(pixels: NDArray[np.float32]) -> bool:
    """Return whether many pixels near edges are between two tones, as in glossy logos."""
    is_edge, is_even = two_toned(over(pixels))
    return bool(is_even.sum() < GLOSSY * is_edge.sum())


def undoubled(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a picture (h, w, c) that was doubled at half its size, and so once more.

    Others are returned as they are.
    """
    for _ in range(2):
        if not all(map(_was_doubled, views(picture))):  # over black and over white
            break
        height, width = picture.shape[:2]
        picture = shrunk(picture, round(height / 2), round(width / 2), sharp=True)
    return picture


def _was_doubled(pixels: NDArray[np.float32]) -> bool:
    """Return whether the sides of an opaque picture were doubled, by its crispest edges.

    If it was not enlarged, one step between two pixels has most of the contrast of such an edge. A
    picture that was enlarged has nothing that a smaller one lacks.
    """
    luma = portable.product(pixels, LUMA)
    shares, steep = [], 0
    for rows in (luma, luma.T):
        # Edges are up to 9 steps wide, and have a contrast of over 60 levels.
        if rows.shape[1] <= 9:
            return False
        near = sliding_window_view(np.abs(np.diff(rows)), 9, axis=1)
        step, way = near[..., 4], near.sum(axis=-1)
        whole = np.abs(rows[:, 9:] - rows[:, :-9])
        is_steep = (step >= near.max(axis=-1)) & (way > 60 / 255)
        # Most differences along an edge lead the same way.
        is_edge = is_steep & (whole > 60 / 255) & (whole > 0.8 * way)
        shares.append(step[is_edge] / whole[is_edge])
        steep += np.count_nonzero(is_steep)
    shares = np.concatenate(shares)
    # Fewer edges, or a smaller share of all steep places, tell nothing: they may be sides of lines.
    if len(shares) < max(20, 0.25 * steep):
        return False
    # The share is .85 in clean drawings, and .42 to .54 in doubled ones.
    return float(np.quantile(shares, 0.8)) <= 0.55 and _finer_than_half(luma) <= MOST_FINER


def _finer_than_half(luma: NDArray[np.float32]) -> float:
    """Return how much detail a picture loses if it is halved and enlarged again.

    It is the squared loss, divided by the squared differences of neighbouring pixels.
    """
    whole, (height, width) = Image.fromarray(luma), luma.shape
    small = whole.resize((round(width / 2), round(height / 2)), Image.Resampling.LANCZOS)
    lost = luma - np.asarray(small.resize((width, height), Image.Resampling.BICUBIC))
    steps = [np.diff(luma, axis=axis).ravel() for axis in (0, 1)]
    return float((lost**2).sum() / max((np.concatenate(steps) ** 2).sum(), 1e-9))


def _tiles(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return about 1024 tiles (n, 32, 32, c) spread over a picture, or all of a small picture."""
    h, w, _ = pixels.shape
    if h * w <= 2**20:
        return pixels[None]
    rows = min(max(round(math.sqrt(1024 * h / w)), 1), 1024)
    ys, xs = (
        np.linspace(0, max(side - 32, 0), count).astype(int)
        for side, count in ((h, rows), (w, 1024 // rows))
    )
    return np.stack([pixels[y : y + 32, x : x + 32] for y in ys for x in xs])
