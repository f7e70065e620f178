"""Samples of any type, converted to float32 in 0..1."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, must_be, shown


def plain_array(array: NDArray[Any], name: str) -> NDArray[Any]:
    """An array of any subclass as a plain one, of the same samples.

    np.matrix keeps two dimensions whatever its index, and other subclasses redefine operators.
    Raises InputError for a masked array with masked samples, which have no value.
    """
    if np.ma.is_masked(array):
        count = int(np.ma.getmaskarray(array).sum())
        got = shown(f"{count} masked of {array.size}")
        advice = ".filled(0), or another value"
        raise InputError(must_be(name, "without masked samples", got, advice))
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
        needed = "uint8, uint16, bool or floating point"
        raise InputError(must_be(f"type of {name}", needed, shown(array.dtype)))
    bad = ~((array >= 0) & (array <= 1))  # NaN as well
    if bad.any():
        y, x, c = (int(v) for v in np.argwhere(bad)[0])
        got = shown(f"{array[y, x, c]} at row {top + y}, column {x}, channel {c}")
        advice = "dividing by the largest value, or clipping"
        raise InputError(must_be(f"samples of {name}", "finite and in 0..1", got, advice))
    return array.astype(np.float32)
