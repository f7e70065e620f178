"""Samples of any type, converted to float32 in 0..1."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError


def plain_array(array: NDArray[Any], name: str) -> NDArray[Any]:
    """An array of any subclass as a plain one, of the same samples.

    np.matrix keeps two dimensions whatever its index, and other subclasses redefine operators.
    Raises InputError for a masked array with masked samples, which have no value.
    """
    if np.ma.is_masked(array):
        count = int(np.ma.getmaskarray(array).sum())
        raise InputError(
            f"{name} must be without masked samples; got {count} masked of {array.size}. Try "
            ".filled(0), or another value"
        )
    return np.asarray(array)


def unit(array: NDArray[Any], name: str, top: int = 0) -> NDArray[np.float32]:
    """Samples (h, w, channels), uint8, uint16, bool or floating point, as float32 in 0..1.

    top  row of the first in the picture that they are of
    Raises InputError for other types, and for the first sample outside of 0..1.
    """
    array = array.astype(array.dtype.newbyteorder("="), copy=False)
    if array.dtype == np.bool_:
        return array.astype(np.float32)
    if array.dtype in (np.uint8, np.uint16):
        return array.astype(np.float32) / np.float32(np.iinfo(array.dtype).max)
    if not np.issubdtype(array.dtype, np.floating):
        raise InputError(
            f"type of {name} must be uint8, uint16, bool or floating point; got {array.dtype}"
        )
    bad = ~((array >= 0) & (array <= 1))  # NaN as well
    if bad.any():
        y, x, c = (int(v) for v in np.argwhere(bad)[0])
        raise InputError(
            f"samples of {name} must be finite and in 0..1; got {array[y, x, c]} at row {top + y}, "
            f"column {x}, channel {c}. Try dividing by the largest value, or clipping"
        )
    return array.astype(np.float32)
