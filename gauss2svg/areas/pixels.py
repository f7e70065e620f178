"""Pixel art: pictures without antialiased edges, as areas whose outlines follow the pixels exactly.

A sprite has cells of one colour each, which are squares of some px. Each colour becomes one area.
An area reaches half a cell or a cell under areas that are drawn later. Otherwise, at a size that is
no multiple of the cells, what is below both would show through the antialiased edge between them.
It does not touch the edges that these areas have with lower ones, where it would show itself:

    1 | 3        The numbers of four cells are their order of drawing. Area 2 reaches under area 3.
    --+--        There its outline begins in the middle of the picture, and goes down to the right
    2 | 3        by 45 degrees, so that it leaves the edge between 1 and 3.

So areas are made of triangles. A cell has eight: its quarters, each cut by the diagonal from the
corner of the cell to its centre.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from gauss2svg.scene.areas import Area, Color, Outline

if TYPE_CHECKING:  # all runs import this module, and few need the kernels
    from gauss2svg.areas.arrays import Bools, Floats, Ints

MOST_COLORS = 128  # largest number of colours of a sprite
# Steps along x and y of the eight directions of outlines, clockwise from the right.
ACROSS, DOWN = (1, 1, 0, -1, -1, -1, 0, 1), (0, 1, 1, 1, 0, -1, -1, -1)


class Sprite(NamedTuple):
    """Cells of a few colours.

    cells   (h, w) index of the colour of each cell
    levels  (n, 4) red, green, blue and alpha of each colour in levels of 255
    side    side of a cell in px
    """

    cells: Ints
    levels: NDArray[np.int64]
    side: int


def sprite_of(pixels: NDArray[np.float32]) -> Sprite | None:
    """Return the cells of a picture, or None if it is no pixel art.

    pixels  (h, w, 3), or (h, w, 4) with straight alpha, in 0..1
    """
    height, width = pixels.shape[:2]
    # In photos, some pixels have enough colours.
    step = max(1, math.isqrt(height * width // 2**13))
    if len(np.unique(_codes(pixels[::step, ::step]))) > MOST_COLORS:
        return None
    codes = _codes(pixels)
    down, across = codes[1:] != codes[:-1], codes[:, 1:] != codes[:, :-1]
    places = [np.flatnonzero(down.any(axis=1)) + 1, np.flatnonzero(across.any(axis=0)) + 1]
    side = int(np.gcd.reduce(np.concatenate([*places, codes.shape])))
    if np.count_nonzero(down) + np.count_nonzero(across) > 2**15 * side:
        return None  # the file would have over 290 kB
    colors, cells = np.unique(codes[::side, ::side], return_inverse=True)
    cells = cells.reshape(height // side, width // side)
    if not 2 <= len(colors) <= min(MOST_COLORS, cells.size // 4):
        return None
    levels = colors[:, None] >> np.array([0, 8, 16, 24]) & 255
    # Cells of 3 px are seen, and so kept even if they were antialiased once. Neighbours that differ
    # by few levels are steps of a gradient, or noise.
    if _slight_share(cells, levels, 12 if side < 3 else 3) > 0.2:
        return None
    # Drawings have over five times as many blended pixels (docs/decisions/areas.md).
    if side < 3 and _blended_for_bends(cells, levels) > 0.03:
        return None
    return Sprite(cells, levels, side)


def _codes(pixels: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return a number (h, w) for the colour of each pixel. It is 0 for all transparent ones."""
    levels = np.round(pixels * np.float32(255)).astype(np.int64)
    alpha = levels[..., 3] if levels.shape[2] == 4 else np.int64(255)
    codes = levels[..., 0] + (levels[..., 1] << 8) + (levels[..., 2] << 16) + (alpha << 24)
    return np.where(alpha > 0, codes, 0)


def _slight_share(cells: Ints, levels: NDArray[np.int64], most: int) -> float:
    """Return at which share of the edges of cells the colours differ by at most `most` levels."""
    steps = np.abs(levels[:, None] - levels).max(axis=2)
    pairs = (cells[1:], cells[:-1]), (cells[:, 1:], cells[:, :-1])
    step = np.concatenate([steps[one, other].ravel() for one, other in pairs])
    return np.count_nonzero((step > 0) & (step <= most)) / max(np.count_nonzero(step), 1)


def _blended_for_bends(cells: Ints, levels: NDArray[np.int64]) -> float:
    """Return how many pixels have colours of antialiased edges, for each where edges bend.

    Most pixels of such a colour lie between two others, whose colours mix to it. Level and upright
    edges do not count, because those of a card with round corners need no antialiasing.
    """
    color = levels * np.where(np.arange(4) < 3, levels[:, 3:] / 255, 1)
    mixed, edges = np.zeros(cells.shape, bool), np.zeros((2, *cells.shape), bool)
    for axis in (0, 1):
        turned, mix, edge = (np.moveaxis(one, axis, 0) for one in (cells, mixed, edges[axis]))
        differs = turned[1:] != turned[:-1]
        edge[1:] |= differs
        edge[:-1] |= differs
        at = np.nonzero(differs[1:] & differs[:-1])
        before, here, after = (color[turned[at[0] + k, at[1]]] for k in range(3))
        way = after - before
        square = (way**2).sum(axis=1)
        share = ((here - before) * way).sum(axis=1) / np.maximum(square, 1)
        off = ((here - before - share[:, None] * way) ** 2).sum(axis=1)
        is_mixed = (square > 6**2) & (share > 0) & (share < 1)
        is_mixed &= off <= np.maximum(0.1**2 * square, 3**2)
        mix[at[0] + 1, at[1]] |= is_mixed
    counts = np.bincount(cells.ravel(), minlength=len(levels))
    blended = np.bincount(cells.ravel(), mixed.ravel(), len(levels)) > 0.6 * counts
    windows = sliding_window_view(np.pad(edges, ((0, 0), (1, 1), (1, 1))), (3, 3), (1, 2))
    bends = edges.any(axis=0) & windows.any(axis=(3, 4)).all(axis=0)
    return counts[blended].sum() / max(np.count_nonzero(bends), 1)


def areas_of_sprite(sprite: Sprite, overlap: bool = True) -> tuple[tuple[Area, ...], Color | None]:
    """Return the areas of a sprite in px, the lowest one first, and the background below them.

    The background is None if a cell is not opaque. What is transparent is drawn first, then what is
    partly transparent, because it hides nothing. After that come the larger colours.

    overlap  whether areas reach under those that are drawn later. Otherwise they are shorter, but
             what is below both shows between them at a size that is no multiple of the cells
    """
    alpha, count = sprite.levels[:, 3], np.bincount(sprite.cells.ravel())
    order = np.lexsort((-count, (alpha > 0).astype(int) + (alpha == 255)))
    is_clear = alpha.min() < 255
    cells = np.pad(sprite.cells, 2, constant_values=-1)
    later = np.append(alpha == 255, False)  # the last one is what is beside the sprite
    areas = []
    for k, color in enumerate(order):
        later[color] = False
        if alpha[color] == 0 or (k == 0 and not is_clear):  # the first layer is the background
            continue
        ys, xs = np.nonzero(cells == color)
        top, left = ys.min() - 2, xs.min() - 2
        box = cells[top : ys.max() + 3, left : xs.max() + 3]
        hidden = later[box] if overlap else np.zeros(box.shape, bool)
        lower = (box != color) & ~later[box] & (box >= 0)
        corner = 2 * np.array([left - 2, top - 2])
        loops = [
            (points + corner) * 0.5 * sprite.side
            for points in _loops(_shortest(box == color, hidden, lower))
        ]
        outlines = tuple(Outline(tuple(map(tuple, p)), (False,) * len(p)) for p in loops)
        *rgb, opacity = (sprite.levels[color] / 255).tolist()
        areas.append(Area(outlines, tuple(rgb), round(opacity, 3)))
    ground = None if is_clear else tuple((sprite.levels[order[0], :3] / 255).tolist())
    return tuple(areas), ground


def _shortest(own: Bools, hidden: Bools, lower: Bools) -> Bools:
    """Return the edges of the shortest layer of a colour.

    It reaches under its neighbours by triangles, by half a cell or by a cell.

    own, hidden, lower  (h, w) cells of the colour, those of later colours, and those of earlier
                        ones, whose edges the layer does not touch
    """
    near = np.zeros_like(own)
    near[1:-1] |= own[2:] | own[:-2]
    near[:, 1:-1] |= own[:, 2:] | own[:, :-2]
    hides = _quarters(hidden)
    needed = _quarters(own) | (hides & _facing(own))
    free = hides & ~_facing(lower)
    shapes = needed, needed | (free & needed[..., ::-1]), needed | (free & _quarters(near))
    return min(map(_edges, shapes if hidden.any() else shapes[:1]), key=_cost_of)


def _quarters(cells: Bools) -> Bools:
    """Return what cells (h, w) cover, as triangles (2 h, 2 w, 2) as in `_facing`."""
    return np.repeat(np.repeat(cells, 2, axis=0), 2, axis=1)[..., None].repeat(2, axis=2)


def _facing(cells: Bools) -> Bools:
    """Return the triangles (2 h, 2 w, 2) beside which one of the cells (h, w) lies.

    Each quarter of a cell has two triangles. The first one is at the upper or lower side of the
    cell, the second one at its left or right side. Nothing is beside the cells along the border.
    """
    h, w = cells.shape
    facing = np.zeros((2 * h, 2 * w, 2), bool)
    facing[2::2, :, 0] = np.repeat(cells[:-1], 2, axis=1)
    facing[1:-2:2, :, 0] = np.repeat(cells[1:], 2, axis=1)
    facing[:, 2::2, 1] = np.repeat(cells[:, :-1], 2, axis=0)
    facing[:, 1:-2:2, 1] = np.repeat(cells[:, 1:], 2, axis=0)
    return facing


def _edges(shape: Bools) -> Bools:
    """Return in which of the eight directions edges begin at each corner of a quarter.

    shape  triangles (h, w, 2), of which none is in the cells along the border

    The shape (8, h + 1, w + 1) lies to the right of its edges.
    """
    h, w, _ = shape.shape
    starts = np.zeros((8, h + 1, w + 1), bool)
    for turn in range(4):  # so that edges to the right and by 45 degrees downwards suffice
        level, upright = (np.rot90(shape[..., k], turn) for k in (turn % 2, 1 - turn % 2))
        top, bottom = upright.copy(), level.copy()
        top[::2], bottom[::2] = level[::2], upright[::2]
        right, down = np.zeros((2, *np.add(level.shape, 1)), bool)
        right[1:-1, :-1] = top[1:] & ~bottom[:-1]
        down[:-1:2, :-1:2] = (upright & ~level)[::2, ::2]
        down[1:-1:2, 1:-1:2] = (level & ~upright)[1::2, 1::2]
        starts[2 * turn : 2 * turn + 2] = np.rot90(right, -turn), np.rot90(down, -turn)
    return starts


def _cost_of(starts: Bools) -> float:
    """Return about how many bytes of path data edges take.

    An upright or level line has 2.5 bytes, and one of 45 degrees 4.5.
    """
    cost = 0.0
    for k, (across, down) in enumerate(zip(ACROSS, DOWN, strict=True)):
        goes_on = np.roll(starts[k], (down, across), axis=(0, 1))
        cost += (4.5 if k % 2 else 2.5) * np.count_nonzero(starts[k] & ~goes_on)
    return cost


def _loops(starts: Bools) -> list[Floats]:
    """Return the corners (n, 2) of closed outlines along edges. They are as few as possible.

    Edges that are connected become one outline, which may touch itself.
    """
    leaving = dict[tuple[int, int], list[int]]()
    for y, x, k in np.argwhere(np.moveaxis(starts, 0, -1)).tolist():
        leaving.setdefault((x, y), []).append(k)
    loops = []
    for start in leaving:
        if not leaving[start]:
            continue
        # The algorithm of Hierholzer for a path along all edges that goes straight on if it can.
        walk, points = [(start, -1)], list[tuple[int, int]]()
        while walk:
            at, came = walk[-1]
            if ways := leaving[at]:
                k = ways.pop(ways.index(came) if came in ways else 0)
                walk.append(((at[0] + ACROSS[k], at[1] + DOWN[k]), k))
            else:
                points.append(walk.pop()[0])
        path = np.array(points[:0:-1])
        step = np.diff(path, axis=0, append=path[:1])
        path = path[(step != np.roll(step, 1, axis=0)).any(axis=1)]
        # The last line is not written, so it is the one with the longest numbers.
        way = np.abs(path - np.roll(path, 1, axis=0))
        longest = np.lexsort((way.max(axis=1), np.count_nonzero(way, axis=1)))[-1]
        loops.append(np.roll(path, -longest, axis=0))
    return sorted(loops, key=lambda path: (path[0, 1], path[0, 0]))
