"""Types of arrays of areas, and masks: which pixels of a box belong to something."""

from __future__ import annotations

from typing import Any, NamedTuple, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
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
MARGIN = 8  # px around what is drawn
MOST_TOLD = 2**15  # most pixels that tell a window


class Content(NamedTuple):
    """The part of a picture in which something is drawn. The margins around it have one colour.

    box    rows and columns
    shape  rows and columns of the whole picture
    """

    box: Box
    shape: tuple[int, ...]

    @classmethod
    def whole(cls, shape: tuple[int, ...]) -> Self:
        """Return the content of a picture of this shape that has no margins."""
        return cls((slice(0, shape[0]), slice(0, shape[1])), shape[:2])

    @classmethod
    def of(cls, picture: Floats) -> Self:
        """Return the content of a picture (h, w, c), with MARGIN px of the colour around it.

        Margins of a picture with transparent parts are transparent.
        """
        differs = (picture != picture[0, 0]).any(axis=2)
        has_clear = picture.shape[2] == 6 and (picture[0, 0] == [0, 0, 0, 1, 1, 1]).all()
        if not differs.any() or not (picture.shape[2] == 3 or has_clear):
            return cls.whole(differs.shape)
        rows, columns = (np.flatnonzero(differs.any(axis=axis))[[0, -1]] for axis in (1, 0))
        tight = slice(rows[0], rows[1] + 1), slice(columns[0], columns[1] + 1)
        return cls(widened(tight, MARGIN, differs.shape), differs.shape)

    @property
    def corner(self) -> Floats:
        """Left and top of the box, in px."""
        return np.array([self.box[1].start, self.box[0].start])

    @property
    def margin(self) -> tuple[int, int] | None:
        """A pixel of the box that has the colour of the margins. None: there are none."""
        is_before = self.corner.any()
        is_after = any(side.stop < most for side, most in zip(self.box, self.shape, strict=True))
        return (0, 0) if is_before else (-1, -1) if is_after else None


def squared(error: Floats) -> float:
    """Return the sum of squares."""
    return float(np.square(error).sum())


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
    """Return half of the window (WINDOW,) of sum 1 that brings an image closest to another one.

    At most MOST_TOLD pixels tell it, evenly among those near a change of the image.
    """
    half, side = np.eye(1, WINDOW)[0], WINDOW - 1
    change = np.pad((np.diff(crisp, axis=1) != 0).any(axis=2), ((0, 0), (0, 1)))
    ys, xs = np.nonzero(ndimage.maximum_filter(change, 2 * side + 1))
    if not len(ys):
        return half
    told = np.s_[:: 1 + len(ys) // MOST_TOLD]
    padded = np.pad(crisp, ((side, side), (side, side), (0, 0)), "symmetric")
    windows = sliding_window_view(padded, (2 * side + 1, 2 * side + 1), (0, 1))
    squares, wanted = windows[ys[told], xs[told]], soft[ys[told], xs[told]]
    for _ in range(4):  # down the columns, the window of the step before is taken
        rows = half[0] * squares[:, :, side]
        for k in range(1, WINDOW):
            rows += half[k] * (squares[:, :, side - k] + squares[:, :, side + k])
        middle = rows[..., side]
        # What a weight k px from the centre adds on both sides
        pairs = [rows[..., side - k] + rows[..., side + k] for k in range(1, WINDOW)]
        basis = np.stack([(pair - 2 * middle).ravel() for pair in pairs], axis=1)
        sides = least_squares(basis, (wanted - middle).reshape(-1, 1))[:, 0]
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


def within(box: Box, outer: Box) -> Box:
    """Return the box in the picture of a box that counts from the corner of another one."""
    down, across = (
        slice(side.start + around.start, side.stop + around.start)
        for side, around in zip(box, outer, strict=True)
    )
    return down, across
