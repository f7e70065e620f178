"""Photos in a drawing, noise and other textured parts: each becomes one even part.

A large square without a block of one colour lies in a textured part. The part reaches as far as
squares without an exact block do, because the even places of a photo are noisy, and those of a
drawing are not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.areas.masks import BLOCK, LEVEL, dilated, distance_to, parts_of, widened
from gauss2svg.areas.regions import bend_of

CLEAN = 5  # px; width of a block of one colour. Smaller ones also occur in noise
SEED = 33  # px; text, hatching and the waves of JPEG leave no larger square without such a block
WINDOW, LEAST = 17, 65  # px; widths of squares that make up a part, and of one that it must have
MOST_OUTSIDE = 0.3  # largest share of exact blocks in a core that belongs to a textured part
SEED_SHARE = (
    0.2  # least share of a part in squares of SEED px. Where noise is faint, areas are found
)
EXACT = 1.1 * LEVEL  # largest second difference of values that are only rounded
ALIGNED = 0.8  # share of its full contrast from which an outline runs between pixels
LEAST_CONTRAST = 0.01  # squared difference of colours between which a share is measured


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
    ground, own = (values[tuple(distance_to(m)[1][:, rim])] for m in (~photo, inner))
    contrast = ((own - ground) ** 2).sum(axis=1)
    share = ((values[rim] - ground) * (own - ground)).sum(axis=1) / np.maximum(contrast, 1e-9)
    share[contrast < LEAST_CONTRAST] = 0.5
    if np.abs(values[rim] - ground).sum() > ALIGNED * np.abs(own - ground).sum():
        share[:] = 1.0
    return rim, np.clip(share, 0, 1), ground
