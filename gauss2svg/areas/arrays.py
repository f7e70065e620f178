"""Types of arrays of areas, and masks: which pixels of a box belong to something."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from gauss2svg.portable import least_squares

# The precision is not part of the types.
Floats = NDArray[Any]
Ints = NDArray[Any]
Bools = NDArray[np.bool_]
Box = tuple[slice, slice]  # rows and columns of a picture

LEVEL = 1 / 255  # smallest difference of two values of a picture of 8 bits
BLOCK = np.ones((3, 3), bool)  # neighbours of a pixel with the diagonal ones
WINDOW = 4  # weights of half of a window, from its centre on


def parts_of(mask: Bools) -> tuple[Ints, list[Box]]:
    """Return the labels (h, w) of the connected parts of a mask, from 1 on, and their boxes."""
    labels: Any = ndimage.label(mask, BLOCK)
    return labels[0], ndimage.find_objects(labels[0])


def dilated(mask: Bools, iterations: int = 1, block: Bools | None = BLOCK) -> Bools:
    """Return a mask with the neighbours of its pixels. With None, these are four for each."""
    result: Any = ndimage.binary_dilation(mask, block, iterations)
    return result


def filtered(image: Floats, half: Floats) -> Floats:
    """Return an image (h, w, c) filtered along its rows and columns by a symmetric window.

    half  (n,) weights of the window at 0, 1, 2 .. px from its centre
    """
    whole = np.append(half[:0:-1], half)
    return ndimage.correlate1d(ndimage.correlate1d(image, whole, 0), whole, 1)


def window_between(crisp: Floats, soft: Floats) -> Floats:
    """Return half of the window (WINDOW,) of sum 1 that brings an image closest to another one."""
    half = np.eye(1, WINDOW)[0]
    for _ in range(4):  # down the columns, the window of the step before is taken
        image = ndimage.correlate1d(crisp, np.append(half[:0:-1], half), 0)
        basis = np.empty((image.size, WINDOW - 1))
        for k in range(1, WINDOW):  # what a weight k px from the centre adds on both sides
            weights = np.zeros(2 * k + 1)
            weights[[0, k, -1]] = 1, -2, 1
            basis[:, k - 1] = ndimage.correlate1d(image, weights, 1).ravel()
        sides = least_squares(basis, (soft - image).reshape(-1, 1).astype(np.float64))[:, 0]
        half = np.append(1 - 2 * sides.sum(), sides)
    return half


def pixels_of(mask: Bools, box: Box) -> tuple[Ints, Ints]:
    """Return the rows and columns in the picture of the pixels of a mask (h, w) of a box."""
    ys, xs = np.nonzero(mask)
    return ys + box[0].start, xs + box[1].start


def distance_to(mask: Bools) -> tuple[Floats, Ints]:
    """Return the distance (h, w) to the nearest pixel of a mask, and its place (2, h, w)."""
    result: Any = ndimage.distance_transform_edt(~mask, return_indices=True)
    return result


def widened(box: Box, by: int, shape: tuple[int, ...]) -> Box:
    """Return a box with a margin of `by` px, within a picture of this shape."""
    first, second = (
        slice(max(side.start - by, 0), min(side.stop + by, most))
        for side, most in zip(box, shape, strict=False)
    )
    return first, second
