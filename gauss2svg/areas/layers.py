"""Layers: the order of regions, and the share of the pixels that each of them covers.

Larger regions lie below smaller ones. A region covers its own share of each pixel, and reaches
under the regions beside it that are drawn later, so that no seam shows between them. It also lies
under what it encloses. But the ground is no layer: where it shows, regions have holes.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.areas.masks import Box, dilated, distance_to, widened, without_holes
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.regions import Shares

REACH = 4  # px by which a region reaches under its neighbours (docs/decisions/areas.md)


class Mask(NamedTuple):
    """The share (h, w) that a region covers of the pixels of a box."""

    region: int
    share: Floats
    box: Box


def join_touching(shares: Shares, paints: list[Paint]) -> Ints:
    """Join regions of one paint that touch, and return the largest region (h, w) of each pixel.

    The cores along a thin part are often apart, although the part is one area. Names in `shares`
    are changed.
    """
    labels = shares.largest
    known: dict[int, int] = {}
    paint = np.array([known.setdefault(id(one), len(known)) for one in paints])
    root = np.arange(len(paints), dtype=np.int32)
    for first, second in ((labels[:, :-1], labels[:, 1:]), (labels[:-1], labels[1:])):
        touching = (first != second) & (paint[first] == paint[second])
        for a, b in np.unique(np.stack([first[touching], second[touching]]), axis=1).T:
            root[root == root[b]] = root[a]
    shares.label = np.append(root, np.int32(-1))[shares.label]
    return root[labels]


def masks_of(
    labels: Ints, shares: Shares, count: int, is_ground: Bools, is_clear: Bools
) -> Iterator[Mask]:
    """Yield the masks of all regions that are not the ground, the lowest one first.

    is_ground  (count,) whether a region is part of the ground
    is_clear   (count,) whether a region lets shine through what is below it
    """
    boxes: dict[int, Box] = {}
    filled: dict[int, Bools] = {}
    area = np.zeros(count)
    for k, tight in enumerate(ndimage.find_objects(labels + 1, max_label=count)):
        if tight is not None and not is_ground[k]:
            box = widened(tight, 2 + REACH, labels.shape)
            boxes[k], filled[k] = box, without_holes(labels[box] == k)
            area[k] = filled[k].sum()
    order = [int(k) for k in np.argsort(-area, kind="stable") if area[k]]
    rank = np.full(count, -1)
    rank[order] = np.arange(len(order))
    is_open = is_ground | is_clear
    for k in order:
        box, whole = boxes[k], filled[k]
        near = labels[box]
        body, share = near == k, shares.of(k, box)
        above = [j for j in np.unique(near) if rank[j] > rank[k] and not is_open[j]]
        held = [j for j in above if whole[near == j].all()]
        beside = np.unique(near[dilated(body, 1, None)])
        others = [j for j in above if j in beside and j not in held]
        if held or others:
            over, under = shares.of(np.array(held + others), box), np.isin(near, held)
            under |= dilated(body, REACH, None) & np.isin(near, others)
            partly = (share > 0) & ~under
            opening = is_open[near]
            if opening.any():
                under &= distance_to(body)[0] <= distance_to(opening)[0]
            # What shows the ground through what is above the region must not show the region.
            share = np.where(
                under,
                1.0 - shares.of(np.flatnonzero(is_open), box),
                share + np.where(partly, over, 0),
            )
        yield Mask(k, np.clip(share, 0, 1), box)
