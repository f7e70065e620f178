"""Regions: labels of pixels of one even colour, shares of them in the pixels between, and layers.

Larger regions lie below smaller ones. A region covers its own share of each pixel, and reaches
under the regions beside it that are drawn later, so that no seam shows between them. It also lies
under what it encloses. But the ground is no layer: where it shows, regions have holes.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy import ndimage

from gauss2svg import portable
from gauss2svg.areas import arrays, outlines
from gauss2svg.areas.arrays import BLOCK, LEVEL, Bools, Box, Floats, Ints
from gauss2svg.areas.paint import Paint, Palette
from gauss2svg.core import Kernel

# Largest difference of values in a block of pixels of one colour, in any picture and in a clean one
# where CLEAN of the blocks have one colour. There, steps of five levels are edges of pale shapes.
FLAT, CLEAN_FLAT, CLEAN = 4 * LEVEL, 2.5 * LEVEL, 0.65
BEND = 2.1 * LEVEL  # largest second difference of values that are evenly shaded
STEEP = 0.03  # largest difference of neighbouring values that are evenly shaded
REACH = 4  # px by which a region reaches under its neighbours (docs/decisions/areas.md)

_grow_labels = Kernel("grow_labels", "int int int float32 int32 int32 float64")


def cores_of(pixels: Floats, is_clean: bool = False) -> Ints:
    """Return the labels (h, w) of evenly coloured or shaded pixels.

    is_clean  whether no JPEG and no filter that overshoots has changed the picture, and it is even

    A pixel belongs to a core if it is part of a block of 2 x 2 pixels whose values are equal within
    FLAT, or which are shaded evenly. All other pixels have the label -1. Larger cores have smaller
    labels.
    """
    spread = spread_of(pixels, 2).max(axis=-1)
    bend = ndimage.maximum_filter(bend_of(pixels), 2)
    is_shaded = (bend <= BEND) & (spread <= STEEP)
    return cores_of_blocks(is_shaded | (spread <= (CLEAN_FLAT if is_clean else FLAT)))


def is_even(pixels: Floats) -> bool:
    """Return whether most blocks of a picture (h, w, c) have one colour."""
    return bool(np.mean(spread_of(pixels, 2).max(axis=-1) <= 1.1 * LEVEL) >= CLEAN)


def cores_of_blocks(block: Bools) -> Ints:
    """Return the labels (h, w) of cores of at least 4 pixels.

    block  (h, w) whether the pixels of the block of 2 x 2 that ends at a pixel are alike. Two
           neighbours are in one core if they are in one such block
    """
    height, width = block.shape
    ends = np.pad(block, (0, 1))
    if min(block.shape) > 1:
        ends[0] = ends[:, 0] = False  # they have one row or column
    # Every other row and column are pixels. Those between tell which neighbours are joined.
    joined = np.zeros((2 * height - 1, 2 * width - 1), bool)
    joined[1::2, ::2] = ends[1:height, :width] | ends[1:height, 1:]
    joined[::2, 1::2] = ends[:height, 1:width] | ends[1:, 1:width]
    joined[::2, ::2] = ends[:-1, :-1] | ends[:-1, 1:] | ends[1:, :-1] | ends[1:, 1:]
    labels: Any = ndimage.label(joined)
    component = labels[0][::2, ::2].copy()
    del labels, joined  # four times as large
    names, counts = np.unique(component[component > 0], return_counts=True)
    kept = names[np.argsort(-counts, kind="stable")][: np.count_nonzero(counts >= 4)]
    return renamed(component, kept)


def bend_of(pixels: Floats) -> Floats:
    """Return the largest second difference (h, w) of the values along rows and columns."""
    bend = np.zeros(pixels.shape[:2], pixels.dtype)
    for axis, inner in enumerate((bend[1:-1], bend[:, 1:-1])):
        second = np.abs(np.diff(pixels, 2, axis)).max(axis=-1)
        np.maximum(inner, second, out=inner)
    return bend


def spread_of(values: Floats, side: int) -> Floats:
    """Return the largest differences (h, w, c) in the squares of `side` px around pixels.

    A square of 2 px ends at its pixel.
    """
    high: Any = ndimage.maximum_filter(values, (side, side, 1))
    return high - ndimage.minimum_filter(values, (side, side, 1))


def renamed(labels: Ints, names: Ints) -> Ints:
    """Return labels in which names[k] is k, and all other labels are -1."""
    table = np.full(max(labels.max(), names.max(initial=0)) + 2, -1, np.int32)
    table[names] = np.arange(len(names))
    return table[labels]


def without_edge_shades(pixels: Floats, labels: Ints) -> Ints:
    """Return the cores without those that are shades of an edge or of a thin line.

    Such a core is at most two pixels wide, and its colour lies between that of the one region
    beside it and that of a pixel or of another region nearby.
    """
    labels, names = labels.copy(), np.arange(labels.max() + 1)
    channels = np.moveaxis(pixels, 2, 0)
    color = np.stack([ndimage.mean(one, labels, names) for one in channels], axis=1)
    for k, box in enumerate(ndimage.find_objects(labels + 1)):
        near = arrays.widened(box, 3, labels.shape)
        inside = labels[near] == k
        if ndimage.binary_erosion(inside, BLOCK, border_value=1).any():
            continue
        ring = arrays.dilated(inside, 2) & ~inside
        beside, counts = np.unique(labels[near][ring & (labels[near] >= 0)], return_counts=True)
        beside = beside[counts > 0.12 * counts.sum()]
        # All that is beside it must have nearly one colour.
        if not len(beside) or np.abs(color[beside] - color[beside[0]]).max() > 0.1:
            continue
        ground, shade = color[beside[0]], color[k] - color[beside[0]]
        wide = labels[arrays.widened(box, 27, labels.shape)]
        others = color[np.unique(wide[wide >= 0])]
        for colors, most, least in ((pixels[near][ring], 0.93, 2), (others, 0.9, 1)):
            axis = colors - ground
            share = portable.product(axis, shade) / np.maximum((axis**2).sum(axis=1), 1e-9)
            off = ((shade - share[:, None] * axis) ** 2).sum(axis=1)
            if np.count_nonzero((share < most) & (share > 0.05) & (off < 1e-3)) >= least:
                labels[labels == k] = -1
                break
    return renamed(labels, np.unique(labels[labels >= 0]))


@dataclass
class Regions:
    """The regions of a picture: their paints, and at most three in each pixel.

    pixels  (h, w, c) picture
    cores   (h, w) name of the region to whose core a pixel belongs, -1 for none
    labels  (h, w) name of the region of a pixel if it is not mixed
    paints  of the regions
    label   (h, w, 3) names of the regions of a pixel, -1 for none
    share   (h, w, 3) their shares of it, which add up to 1
    error   (h, w) squared distance of the pixel from this mixture
    """

    pixels: Floats
    cores: Ints
    labels: Ints
    paints: list[Paint]
    label: Ints
    share: Floats
    error: Floats

    @classmethod
    def of(cls, pixels: Floats, cores: Ints, paints: list[Paint]) -> Self:
        """Return the regions that grow from cores, nearest colours first.

        A pixel of a core belongs to its region alone.
        """
        labels = cores.astype(np.int32)
        origin = np.arange(labels.size, dtype=np.int32).reshape(labels.shape)
        heap = np.empty((4 * np.count_nonzero(labels < 0), 2))
        _grow_labels(*pixels.shape, pixels, labels, origin, heap)
        label = np.full((*labels.shape, 3), -1, np.int32)
        share, error = np.zeros(label.shape, np.float32), np.zeros(labels.shape, np.float32)
        label[..., 0], share[..., 0] = labels, 1.0
        at: Any = np.nonzero(cores < 0)
        label[at], share[at], error[at] = Palette.of(paints).explain(pixels, labels, at)
        return cls(pixels, cores, labels, paints, label, share, error)

    def share_of(self, names: Ints | int, box: Box = np.s_[:, :]) -> Floats:
        """Return the share of these regions together in each pixel of a box."""
        label = self.label[box]
        is_one = label == names if np.ndim(names) == 0 else np.isin(label, names)
        return self.share[box].sum(axis=-1, where=is_one)

    def mix(self, at: tuple[Ints, Ints], mixtures: tuple[Any, Any, Any], where: Bools) -> None:
        """Write the label, share and error (n, ..) of some pixels, of those of them in `where`."""
        at = at[0][where], at[1][where]
        self.label[at], self.share[at], self.error[at] = (values[where] for values in mixtures)

    @property
    def largest(self) -> Ints:
        """The region (h, w) with the largest share of each pixel."""
        at = self.share.argmax(axis=-1)[..., None]
        return np.take_along_axis(self.label, at, axis=-1)[..., 0]


def paint_numbers(paints: list[Paint]) -> Ints:
    """Return a number for each paint (k,), which is the same for the same object."""
    known: dict[Paint, int] = {}
    return np.array([known.setdefault(paint, len(known)) for paint in paints])


def join_touching(regions: Regions) -> Ints:
    """Join regions of one paint that touch, and return the largest region (h, w) of each pixel.

    The cores along a thin part are often apart, although the part is one area. Names in
    `regions.label` are changed.
    """
    labels = regions.largest
    paint = paint_numbers(regions.paints)
    root = np.arange(len(paint), dtype=np.int32)
    for first, second in ((labels[:, :-1], labels[:, 1:]), (labels[:-1], labels[1:])):
        touching = (first != second) & (paint[first] == paint[second])
        for a, b in np.unique(np.stack([first[touching], second[touching]]), axis=1).T:
            root[root == root[b]] = root[a]
    regions.label = np.append(root, np.int32(-1))[regions.label]
    labels = root[labels]
    _keep_dots(labels, regions)
    return labels


def _keep_dots(labels: Ints, regions: Regions) -> None:
    """Give regions that have most of no pixel the pixel of which they have most.

    Points and dots of small text have a pixel or two in all.
    """
    label, share = regions.label, regions.share
    seen = np.where(share > outlines.DOT_SEEN, share, 0)
    total = np.bincount(label.ravel() + 1, seen.ravel())[1:]
    total[np.unique(labels)] = 0
    small = np.flatnonzero((total >= outlines.LEAST_DOT) & (total < outlines.MOST_DOT))
    ys, xs, slot = np.nonzero(np.isin(label, small))
    for k in np.argsort(share[ys, xs, slot], kind="stable"):
        labels[ys[k], xs[k]] = label[ys[k], xs[k], slot[k]]


def masks_of(
    labels: Ints, regions: Regions, is_ground: Bools, is_clear: Bools
) -> Iterator[tuple[int, Floats, Box]]:
    """Yield the regions that are not the ground, the lowest one first.

    Each comes with the share (h, w) that it covers of the pixels of a box, and with this box.

    is_ground  (k,) whether a region is part of the ground
    is_clear   (k,) whether a region lets shine through what is below it
    """
    count = len(regions.paints)
    boxes: dict[int, Box] = {}
    filled: dict[int, Bools] = {}
    area = np.zeros(count)
    for k, tight in enumerate(ndimage.find_objects(labels + 1, max_label=count)):
        if tight is not None and not is_ground[k]:
            box = arrays.widened(tight, 2 + REACH, labels.shape)
            boxes[k], filled[k] = box, np.asarray(ndimage.binary_fill_holes(labels[box] == k))
            area[k] = filled[k].sum()
    order = [int(k) for k in np.argsort(-area, kind="stable") if area[k]]
    rank = np.full(count, -1)
    rank[order] = np.arange(len(order))
    is_open = is_ground | is_clear
    for k in order:
        box, whole = boxes[k], filled[k]
        near = labels[box]
        body, share = near == k, regions.share_of(k, box)
        above = [j for j in np.unique(near) if rank[j] > rank[k] and not is_open[j]]
        held = [j for j in above if whole[near == j].all()]
        beside = np.unique(near[arrays.dilated(body, 1, None)])
        others = [j for j in above if j in beside and j not in held]
        if held or others:
            over, under = regions.share_of(np.array(held + others), box), np.isin(near, held)
            under |= arrays.dilated(body, REACH, None) & np.isin(near, others)
            partly = (share > 0) & ~under
            opening = is_open[near]
            if opening.any():
                under &= arrays.distance_to(body)[0] <= arrays.distance_to(opening)[0]
            # What shows the ground through what is above the region must not show the region.
            share = np.where(
                under,
                1.0 - regions.share_of(np.flatnonzero(is_open), box),
                share + np.where(partly, over, 0),
            )
        yield k, np.clip(share, 0, 1), box
