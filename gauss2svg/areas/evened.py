"""Parts of a picture that become even before areas are found: its photos and its shading.

Photos in a drawing, noise and other textured parts each become one even part. A large square
without a block of one colour lies in a textured part. The part reaches as far as squares without an
exact block do, because the even places of a photo are noisy, and those of a drawing are not.

Glows, soft shadows, and other shading without crisp edges are taken out, because areas imitate them
by strips. Only crisp areas are then found, and Gaussians draw the shading below and above them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.areas.masks import BLOCK, LEVEL, dilated, distance_to, parts_of, pixels_of, widened
from gauss2svg.areas.paint import GOOD, paint_of
from gauss2svg.areas.regions import bend_of

CLEAN = 5  # px; width of a block of one colour. Smaller ones also occur in noise
SEED = 33  # px; text, hatching and the waves of JPEG leave no larger square without such a block
WINDOW, LEAST = 17, 65  # px; widths of squares that make up a part, and of one that it must have
MOST_OUTSIDE = 0.3  # largest share of exact blocks in a core that belongs to a textured part
# Least share of a part in squares of SEED px. Where noise is faint, areas are found.
SEED_SHARE = 0.2
EXACT = 1.1 * LEVEL  # largest second difference of values that are only rounded
ALIGNED = 0.8  # share of its full contrast from which an outline runs between pixels
LEAST_CONTRAST = 0.01  # squared difference of colours between which a share is measured
SMOOTH = 0.07  # largest difference of a pixel and its neighbours where there is no edge
LEAST_PIXELS = 40  # a part of fewer pixels has no shading
PLAIN = 0.25  # a colour that this share of a part has exactly is that below its shading
RIM = 3  # px around a part in which pixels are mixed of its colours and others


def with_even_photos(pixels: Floats, cores: Ints) -> Floats:
    """Return the picture in which each textured part has its mean colour."""
    photo = textured(pixels, cores)
    if not photo.any():
        return pixels
    result = pixels.copy()
    part, boxes = parts_of(photo)
    for k, tight in enumerate(boxes, 1):
        box = widened(tight, 1, photo.shape)
        inside, values = part[box] == k, pixels[box]
        color = values[inside].mean(axis=0, dtype=np.float64).astype(pixels.dtype)
        result[box][inside] = color
        at, share, ground = _along_outline(values, inside, photo[box])
        result[box][at] = ground + share[:, None] * (color - ground)
    return result


def textured(pixels: Floats, cores: Ints) -> Bools:
    """Return the pixels (h, w) of textured parts."""
    seeds = opened(~opened(cores >= 0, CLEAN), SEED)
    if not seeds.any():
        return seeds
    # An exact pixel has exact neighbours, so that those of a block have exact values up to its rim.
    is_exact: Any = ndimage.binary_erosion(bend_of(pixels) <= EXACT, BLOCK, border_value=1)
    rough = ~dilated(is_exact, CLEAN // 2)
    part, _ = parts_of(opened(rough, WINDOW) | seeds)
    sizes, seed_sizes = (np.bincount(part[m], minlength=part.max() + 1) for m in (part > 0, seeds))
    names = np.flatnonzero(seed_sizes > SEED_SHARE * sizes)
    whole = np.isin(part, np.intersect1d(names, part[opened(part > 0, LEAST)]))
    # The squares leave out corners of a part that is turned or round.
    result: Any = ndimage.binary_dilation(whole, BLOCK, WINDOW // 2, opened(rough, CLEAN))
    # A core is in or out as a whole, so that a photo has no holes, and letters on it none either.
    sizes = np.bincount(cores[cores >= 0])
    outside = np.bincount(cores[(cores >= 0) & ~result], minlength=len(sizes))
    is_inside = outside <= MOST_OUTSIDE * sizes
    return np.where(cores < 0, result, is_inside[cores]) if len(sizes) else result


def opened(mask: Bools, side: int) -> Bools:
    """Return the union of the squares of `side` px in a mask."""
    least = ndimage.minimum_filter(mask.view(np.uint8), side, mode="constant")
    return ndimage.maximum_filter(least, side, mode="constant").view(bool)


def _along_outline(values: Floats, inside: Bools, photo: Bools) -> tuple[Bools, Floats, Floats]:
    """Return the pixels (h, w) along the outline of a part, their shares (n,), and what is beside.

    inside, photo  (h, w) pixels of the part, and of all parts
    """
    rim = inside & dilated(~photo)
    inner = inside & ~rim
    if not rim.any() or not inner.any():
        return np.zeros_like(inside), np.empty(0), np.empty((0, values.shape[2]))
    nearest, beside, share = _between(values, rim, inner, ~photo)
    ground, own = values[beside], values[nearest]
    share[((own - ground) ** 2).sum(axis=1) < LEAST_CONTRAST] = 0.5
    if np.abs(values[rim] - ground).sum() > ALIGNED * np.abs(own - ground).sum():
        share[:] = 1.0
    return rim, share, ground


def _between(values: Floats, rim: Bools, inside: Bools, others: Bools) -> tuple[Any, Any, Floats]:
    """Return what the pixels (n,) of a rim are mixed of, and their shares (n,) of the first.

    These are the nearest pixel of `inside`, and the nearest one of `others`.
    """
    own, other = (tuple(distance_to(mask)[1][:, rim]) for mask in (inside, others))
    way = values[own] - values[other]
    along = ((values[rim] - values[other]) * way).sum(axis=1)
    return own, other, np.clip(along / np.maximum((way**2).sum(axis=1), 1e-6), 0, 1)


def without_shading(pixels: Floats) -> Floats:
    """Return a picture (h, w, c) in which each part without edges has one paint."""
    is_edge = np.zeros(pixels.shape[:2], bool)
    for axis, first, last in ((0, np.s_[:-1], np.s_[1:]), (1, np.s_[:, :-1], np.s_[:, 1:])):
        differs = np.abs(np.diff(pixels, axis=axis)).max(axis=2) > SMOOTH
        is_edge[first] |= differs
        is_edge[last] |= differs
    part, boxes = parts_of(~is_edge)
    result = pixels.astype(np.float32, copy=True)
    for k, tight in enumerate(boxes, 1):
        ys, xs = pixels_of(part[tight] == k, tight)
        if len(ys) < LEAST_PIXELS:
            continue
        change = np.zeros_like(result)
        change[ys, xs] = _evened(pixels, ys, xs) - pixels[ys, xs]
        if np.abs(change[ys, xs]).max() < GOOD:
            continue
        box = widened(tight, RIM + 1, part.shape)
        result[box] += _with_rim(pixels[box], change[box], part[box] == k, part[box] > 0)
    return np.clip(result, 0, 1)


def _evened(pixels: Floats, ys: Ints, xs: Ints) -> Floats:
    """Return the colours (n, c) that the pixels of a part have without shading."""
    values = pixels[ys, xs]
    levels = np.round(values * 255).astype(np.int64) @ 256 ** np.arange(values.shape[1])
    _, first, count = np.unique(levels, return_index=True, return_counts=True)
    if count.max() >= PLAIN * len(ys):
        return np.broadcast_to(values[first[count.argmax()]], values.shape)
    return paint_of(pixels, ys, xs).at(xs, ys)


def _with_rim(values: Floats, change: Floats, inside: Bools, parts: Bools) -> Floats:
    """Return the change (h, w, c) of a part, and that of its rim.

    A pixel of the rim is mixed of the nearest pixel of the part and the nearest one of another.

    inside, parts  (h, w) pixels of the part, and of all parts
    """
    others, rim = parts & ~inside, dilated(inside, RIM) & ~parts
    if not others.any():
        return change
    own, _, share = _between(values, rim, inside, others)
    change = change.copy()
    change[rim] = share[:, None] * change[own]
    return change
