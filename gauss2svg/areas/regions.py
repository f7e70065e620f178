"""Regions: labels of pixels of one even colour, and the shares of them in the pixels between."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import ndimage

from gauss2svg import portable
from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.areas.masks import BLOCK, LEVEL, Box, dilated, widened
from gauss2svg.areas.paint import Paint
from gauss2svg.core import Kernel

FLAT = 4 * LEVEL  # largest difference of values in a block of pixels of one colour
BEND = 2.1 * LEVEL  # largest second difference of values that are evenly shaded
STEEP = 0.03  # largest difference of neighbouring values that are evenly shaded
LEAST_CORE = 4  # px; smaller cores are no regions


def cores_of(pixels: Floats) -> tuple[Ints, int]:
    """Return the labels (h, w) of evenly coloured or shaded pixels, and their number.

    A pixel belongs to a core if it is part of a block of 2 x 2 pixels whose values are equal within
    FLAT, or which are shaded evenly. Neighbours of nearly the same values have the same label. All
    other pixels have the label -1. Larger cores have smaller labels.
    """
    return cores_of_blocks(pixels, _even_blocks(pixels), max(FLAT, STEEP))


def _even_blocks(pixels: Floats) -> Bools:
    """Return whether the pixels of the block of 2 x 2 that ends at each pixel are even (h, w)."""
    spread = over_blocks(pixels, np.maximum) - over_blocks(pixels, np.minimum)
    spread = spread.max(axis=-1)
    bend = over_blocks(bend_of(pixels), np.maximum)
    return (spread <= FLAT) | ((bend <= BEND) & (spread <= STEEP))


def cores_of_blocks(pixels: Floats, block: Bools, most: float) -> tuple[Ints, int]:
    """Return the labels (h, w) of cores, and their number.

    block  (h, w) whether the pixels of the block of 2 x 2 that ends at a pixel are alike
    most   largest difference of neighbours of one core
    """
    core = block.copy()
    core[:-1] |= block[1:]
    core[:, :-1] |= block[:, 1:]
    core[:-1, :-1] |= block[1:, 1:]
    # Every other row and column are pixels. Those between tell which neighbours are joined.
    h, w = core.shape
    joined = np.zeros((2 * h - 1, 2 * w - 1), bool)
    joined[::2, ::2] = core
    joined[1::2, ::2] = core[1:] & core[:-1] & _are_near(pixels[1:], pixels[:-1], most)
    joined[::2, 1::2] = core[:, 1:] & core[:, :-1] & _are_near(pixels[:, 1:], pixels[:, :-1], most)
    labels: Any = ndimage.label(joined)
    component = labels[0][::2, ::2].copy()
    del labels, joined  # four times as large
    names, counts = np.unique(component[core], return_counts=True)
    kept = names[np.argsort(-counts, kind="stable")][: np.count_nonzero(counts >= LEAST_CORE)]
    return renamed(component, kept), len(kept)


def _are_near(one: Floats, other: Floats, most: float) -> Bools:
    """Return which pixels (h, w) of two pictures differ by at most `most`."""
    return np.abs(one - other).max(axis=-1) <= most


def bend_of(pixels: Floats) -> Floats:
    """Return the largest second difference (h, w) of the values along rows and columns."""
    bend = np.zeros(pixels.shape[:2], pixels.dtype)
    for axis, inner in enumerate((bend[1:-1], bend[:, 1:-1])):
        second = np.abs(np.diff(pixels, 2, axis)).max(axis=-1)
        np.maximum(inner, second, out=inner)
    return bend


def over_blocks(values: Floats, combine: np.ufunc) -> Floats:
    """Return the maximum or minimum over the block of 2 x 2 pixels that ends at each pixel."""
    result = values.copy()
    combine(result[1:], values[:-1], out=result[1:])
    across = result.copy()
    combine(result[:, 1:], across[:, :-1], out=result[:, 1:])
    return result


def renamed(labels: Ints, names: Ints) -> Ints:
    """Return labels in which names[k] is k, and all other labels are -1."""
    table = np.full(max(labels.max(), names.max(initial=0)) + 2, -1, np.int32)
    table[names] = np.arange(len(names))
    return table[labels]


_grow_labels = Kernel("grow_labels", "int int int float32 int32 int32 float64")
_explain_pixels = Kernel(
    "explain_pixels",
    "int int int float32 int32 int64 float64 float32 int int64 int64 float64 int int32 float32"
    " float32",
)


def grown(pixels: Floats, labels: Ints) -> Ints:
    """Return the labels with pixels between the cores joined to those beside them."""
    labels = labels.astype(np.int32)
    origin = np.arange(labels.size, dtype=np.int32).reshape(labels.shape)
    heap = np.empty((4 * np.count_nonzero(labels < 0), 2))
    _grow_labels(*pixels.shape, pixels, labels, origin, heap)
    return labels


@dataclass
class Shares:
    """The regions of each pixel, at most three, with their shares of it.

    label  (h, w, 3) names of regions, -1 for none
    share  (h, w, 3) which add up to 1
    error  (h, w) squared distance of the pixel from this mixture
    """

    label: Ints
    share: Floats
    error: Floats

    def of(self, names: Ints | int, box: Box = np.s_[:, :]) -> Floats:
        """Return the share of these regions together in each pixel of a box."""
        label = self.label[box]
        is_one = label == names if np.ndim(names) == 0 else np.isin(label, names)
        return self.share[box].sum(axis=-1, where=is_one)

    @property
    def largest(self) -> Ints:
        """The region (h, w) with the largest share of each pixel."""
        at = self.share.argmax(axis=-1)[..., None]
        return np.take_along_axis(self.label, at, axis=-1)[..., 0]


class Palette(NamedTuple):
    """The paints of regions, as the kernels read them (gauss2svg/core/paints.h).

    form, place, table  (k,), (k, 4) and (k, SHADES, c)
    """

    form: Ints
    place: Floats
    table: Floats

    @classmethod
    def of(cls, paints: Sequence[Paint]) -> Palette:
        """Return the palette of some paints."""
        return cls(*(np.array([getattr(p, name) for p in paints]) for name in cls._fields))

    def explain(
        self, pixels: Floats, labels: Ints, at: tuple[Ints, Ints], extra: Floats | None = None,
        name: int = -1,
    ) -> tuple[Ints, Floats, Floats]:  # fmt: skip
        """Return the labels (n, 3), shares (n, 3) and squared errors (n,) of mixtures at pixels.

        at     rows and columns (n,) of the pixels
        extra  (c,) one more colour, whose label is `name`
        """
        n = len(at[0])
        label = np.empty((n, 3), np.int32)
        share, error = np.empty((n, 3), np.float32), np.empty(n, np.float32)
        color = np.zeros(pixels.shape[2]) if extra is None else np.asarray(extra, np.float64)
        labels, (ys, xs) = labels.astype(np.int32, copy=False), np.array(at)
        _explain_pixels(
            *pixels.shape, pixels, labels, *self, n, ys, xs, color, name, label, share, error
        )
        return label, share, error


def shares_of(pixels: Floats, cores: Ints, labels: Ints, palette: Palette) -> Shares:
    """Return the shares of regions. A pixel of a core belongs to its region alone."""
    h, w, _ = pixels.shape
    label = np.full((h, w, 3), -1, np.int32)
    share, error = np.zeros((h, w, 3), np.float32), np.zeros((h, w), np.float32)
    label[..., 0], share[..., 0] = labels, 1.0
    ys, xs = np.nonzero(cores < 0)
    at = ys, xs
    label[at], share[at], error[at] = palette.explain(pixels, labels, at)
    return Shares(label, share, error)


MOST_MEDIAN = 1000  # px; larger regions have a mean, because a median takes long
LEAST_BESIDE = 0.12  # share of the ring around a core; a region with less is not beside it
SAME = 0.1  # largest difference of the colours of regions that count as one ground


def without_edge_shades(pixels: Floats, labels: Ints, count: int) -> tuple[Ints, int]:
    """Return the cores without those that are shades of an edge or of a thin line.

    Such a core is at most two pixels wide, and its colour lies between that of the one region
    beside it and that of a pixel or of another region nearby.
    """
    labels = labels.copy()
    order = np.argsort(labels, axis=None, kind="stable")
    ends = np.cumsum(np.bincount(labels.ravel() + 1, minlength=count + 1))
    values = pixels.reshape(labels.size, -1)[order]
    median = np.zeros((count, pixels.shape[2]))
    for k, (start, end) in enumerate(itertools.pairwise(ends)):
        middle = np.median if end - start < MOST_MEDIAN else np.mean
        median[k] = middle(values[start:end], axis=0)
    for k, box in enumerate(ndimage.find_objects(labels + 1, max_label=count)):
        if box is None:
            continue
        near = widened(box, 3, labels.shape)
        inside = labels[near] == k
        if ndimage.binary_erosion(inside, BLOCK, border_value=1).any():
            continue
        ring = dilated(inside, 2) & ~inside
        beside, counts = np.unique(labels[near][ring & (labels[near] >= 0)], return_counts=True)
        beside = beside[counts > LEAST_BESIDE * counts.sum()]
        if not len(beside) or np.abs(median[beside] - median[beside[0]]).max() > SAME:
            continue
        ground, shade = median[beside[0]], median[k] - median[beside[0]]
        wide = labels[widened(box, 27, labels.shape)]
        others = median[np.unique(wide[wide >= 0])]
        for colors, most, least in ((pixels[near][ring], 0.93, 2), (others, 0.9, 1)):
            axis = colors - ground
            share = portable.product(axis, shade) / np.maximum((axis**2).sum(axis=1), 1e-9)
            off = ((shade - share[:, None] * axis) ** 2).sum(axis=1)
            if np.count_nonzero((share < most) & (share > 0.05) & (off < 1e-3)) >= least:
                labels[labels == k] = -1
                break
    names = np.unique(labels[labels >= 0])
    return renamed(labels, names), len(names)
