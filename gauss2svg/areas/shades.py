"""Shading without crisp edges: glows, soft shadows, and what no gradient draws.

Areas imitate it by strips. Here it is taken out of a picture, so that only crisp areas are found,
and Gaussians can draw it below and above them.
"""

from __future__ import annotations

import numpy as np

from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.areas.masks import dilated, distance_to, parts_of, pixels_of, widened
from gauss2svg.areas.paint import GOOD, paint_of

SMOOTH = 0.07  # largest difference of a pixel and its neighbours where there is no edge
LEAST_PIXELS = 40  # a part of fewer pixels has no shading
PLAIN = 0.25  # a colour that this share of a part has exactly is that below its shading
RIM = 3  # px around a part in which pixels are mixed of its colours and others


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
    own, other = (tuple(distance_to(mask)[1][:, rim]) for mask in (inside, others))
    a, b = values[own], values[other]
    contrast = np.maximum(((b - a) ** 2).sum(axis=1), 1e-6)
    share = ((b - values[rim]) * (b - a)).sum(axis=1) / contrast
    change = change.copy()
    change[rim] = np.clip(share, 0, 1)[:, None] * change[own]
    return change
