"""Elementary functions and small linear algebra that give the same bits on every machine.

NumPy's functions depend on the CPU and on the C library, and its products of matrices on BLAS
(docs/decisions/same-file.md). These functions have the names of NumPy's. Their sums and products
are in a fixed order, and their errors are in core/functions.h. They compute in float64, and return
float32 if all arrays are of float32.
"""

import math
from typing import Any

import numpy as np

from gauss2svg.core import Kernel

_EACH = {
    name: Kernel(f"each_{name}", "int float64 float64 float64")
    for name in ("exp", "log", "cos", "sin", "power", "arctan2")
}
_MULTIPLY = Kernel("multiply", "int int int float64 float64 float64")
_SOLVE = Kernel("solve", "int int float64 float64")
_LN2, _LN10 = 0.6931471805599453, 2.302585092994046
_SQUARINGS = 12  # eigenvalues to the power of 2^12 leave only the largest one


def _dtype(*values: Any) -> Any:
    kinds = [np.asarray(value).dtype for value in values if np.ndim(value)]
    return np.float32 if kinds and all(kind == np.float32 for kind in kinds) else np.float64


def _each(name: str, *values: Any) -> Any:
    arrays = [np.asarray(value, np.float64, order="C") for value in values]
    if arrays[0].shape != arrays[-1].shape:
        arrays = [np.array(array, order="C") for array in np.broadcast_arrays(*arrays)]
    result = np.empty(arrays[0].shape)
    _EACH[name](result.size, arrays[0], arrays[-1], result)
    return result.astype(_dtype(*values), copy=False) if result.ndim else float(result)


def exp(value: Any) -> Any:
    """Return e to the power of each value."""
    return _each("exp", value)


def log(value: Any) -> Any:
    """Return the natural logarithm of each value."""
    return _each("log", value)


def log2(value: Any) -> Any:
    """Return the logarithm to the base 2 of each value, which is exact for powers of two."""
    fraction, exponent = np.frexp(value)
    return np.where(fraction == 0.5, exponent - 1.0, log(value) / _LN2)[()]


def log10(value: Any) -> Any:
    """Return the logarithm to the base 10 of each value."""
    return log(value) / _LN10


def power(base: Any, exponent: Any) -> Any:
    """Return base ** exponent for bases that are not negative."""
    return _each("power", base, exponent)


def cos(angle_rad: Any) -> Any:
    """Return the cosine of each angle."""
    return _each("cos", angle_rad)


def sin(angle_rad: Any) -> Any:
    """Return the sine of each angle."""
    return _each("sin", angle_rad)


def arctan2(y: Any, x: Any) -> Any:
    """Return the angle in -pi..pi of each point (x, y)."""
    return _each("arctan2", y, x)


def arccos(value: Any) -> Any:
    """Return the angle in 0..pi of each cosine."""
    value = np.asarray(value)
    return arctan2(np.sqrt((1 - value) * (1 + value)), value)


def cbrt(value: Any) -> Any:
    """Return the cube root of each value that is not negative."""
    return power(value, 1 / 3)


def hypot(x: Any, y: Any) -> Any:
    """Return the length of each vector (x, y), which must be 0 or within 1e-150..1e150."""
    return np.sqrt(np.square(x) + np.square(y))


def dot(a: Any, b: Any) -> float:
    """Return the sum of the products of two vectors."""
    return float((a * b).sum())


def product(a: Any, b: Any) -> Any:
    """Return a @ b, where b is a vector or a matrix, and a has any number of rows."""
    left = np.asarray(a, np.float64, order="C")
    right = np.asarray(b, np.float64, order="C")
    count, columns = left.shape[-1], right.size // max(len(right), 1)
    if count != len(right):
        raise ValueError(f"product needs as many rows as columns; got {left.shape}, {right.shape}")
    result = np.empty(left.shape[:-1] + right.shape[1:])
    _MULTIPLY(left.size // max(count, 1), count, columns, left, right, result)
    return result.astype(_dtype(a, b), copy=False)


def solve(matrix: Any, right: Any) -> Any:
    """Return x with matrix @ x = right. Raise numpy.linalg.LinAlgError if there is no single x."""
    left = np.array(matrix, np.float64, order="C")
    result = np.array(right, np.float64, order="C")
    if not _SOLVE(len(left), result.size // max(len(result), 1), left, result):
        raise np.linalg.LinAlgError("matrix is singular")
    return result


def least_squares(basis: Any, values: Any) -> Any:
    """Return x for which the squares of basis @ x - values have the smallest sum.

    Columns of the basis may depend on each other. Then x is nearly the smallest of all.
    """
    gram = product(basis.T, basis)
    gram += (1e-12 * np.trace(gram) + 1e-300) * np.eye(len(gram))
    return solve(gram, product(basis.T, values))


def main_axis(rows: Any) -> Any:
    """Return the unit vector (d,) along which the rows (n, d) vary most from 0."""
    spread = product(rows.T, rows) + 1e-300 * np.eye(rows.shape[1])
    if len(spread) == 2:
        (xx, xy), (_, yy) = spread.tolist()
        half = 0.5 * (xx - yy)
        root = math.sqrt(half * half + xy * xy)
        axis = np.array([half + root, xy] if half >= 0 else [xy, root - half])
        return axis / np.sqrt(dot(axis, axis)) if root else np.array([1.0, 0.0])
    for _ in range(_SQUARINGS):
        spread /= np.trace(spread)  # so that powers do not grow
        spread = product(spread, spread)
    axis = spread[spread.diagonal().argmax()]
    return axis / np.sqrt(dot(axis, axis))
