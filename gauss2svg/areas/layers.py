"""Layers: the order of regions, and the share of the pixels that each of them covers.

Larger regions lie below smaller ones. A region covers its own share of each pixel, and reaches
under the regions beside it that are drawn later, so that no seam shows between them. It also lies
under what it encloses. But the ground is no layer: where it shows, regions have holes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gauss2svg.areas.regions import Shares, widened

REACH = 2  # px by which a region reaches under its neighbours


class Mask(NamedTuple):
    """What a region covers: share (h, w) of the pixels of a box, whose corner is at (left, top)."""

    region: int
    share: NDArray[np.float64]
    left: int
    top: int


def masks_of(labels, shares: Shares, paints, is_ground, is_clear, reach=REACH) -> list[Mask]:
    """Return the masks of all regions that are not the ground, the lowest one first.

    is_ground  (k,) whether a region is part of the ground
    is_clear   (k,) whether a region lets shine through what is below it
    """
    h, w = labels.shape
    count = len(paints)
    boxes = ndimage.find_objects(labels + 1, max_label=count)
    beside: list[set[int]] = [set() for _ in range(count)]
    for first, second in ((labels[:, :-1], labels[:, 1:]), (labels[:-1], labels[1:])):
        pairs = np.unique(np.stack([first, second])[:, first != second], axis=1)
        for a, b in pairs.T:
            beside[a].add(int(b))
            beside[b].add(int(a))
    is_open = is_ground | is_clear
    filled, area = {}, np.zeros(count)
    for k, box in enumerate(boxes):
        if box is not None and not is_ground[k]:
            filled[k] = ndimage.binary_fill_holes(labels[box] == k)
            area[k] = filled[k].sum()
    order = [int(k) for k in np.argsort(-area, kind="stable") if area[k]]
    rank = np.full(count, -1)
    rank[order] = np.arange(len(order))
    masks = []
    for k in order:
        box = widened(boxes[k], 4, (h, w))
        near, whole = labels[box], np.zeros(labels[box].shape, bool)
        start = [boxes[k][i].start - box[i].start for i in (0, 1)]
        size = filled[k].shape
        whole[start[0] : start[0] + size[0], start[1] : start[1] + size[1]] = filled[k]
        body, share = near == k, shares.of(k, box)
        above = {int(j) for j in np.unique(near) if rank[j] > rank[k] and not is_open[j]}
        held = [j for j in above if not ((near == j) & ~whole).any()]
        others = [j for j in beside[k] if j in above and j not in held]
        if held or others:
            over, under = shares.of(np.array(held + others), box), np.isin(near, held)
            under |= ndimage.binary_dilation(body, iterations=reach) & np.isin(near, others)
            partly = (share > 0) & ~under
            is_hidden = np.ones_like(body)
            opening = is_open[near]
            if opening.any():
                is_hidden = ndimage.distance_transform_edt(~body) <= ndimage.distance_transform_edt(
                    ~opening
                )
            # What shows the ground through what is above the region must not show the region.
            share = np.where(
                under & is_hidden,
                1.0 - shares.of(np.flatnonzero(is_open), box),
                share + np.where(partly, over, 0),
            )
        masks.append(Mask(k, np.clip(share, 0, 1), box[1].start, box[0].start))
    return masks
