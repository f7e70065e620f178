"""Types of arrays of areas, and the forms of paints as the kernels read them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

# The precision is not part of the types.
Floats = NDArray[Any]
Ints = NDArray[Any]
Bools = NDArray[np.bool_]

FLAT, LINEAR, RADIAL = range(3)  # forms of paints (gauss2svg/core/paints.h)
SHADES = 1024  # colours of a gradient's table
