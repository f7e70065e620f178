"""Fields: functions finer than pixels whose contour covers each pixel by its share of a mask.

A contour through linearly interpolated shares cuts corners, breaks lines of one pixel, and leaves
out those between two rows, because no share of theirs reaches a half. Here the shares are
interpolated finer, and changed until what lies inside the contour covers each pixel by its share.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage

from gauss2svg.areas.kernels import Floats

FINE = 3  # samples of a field for each px
STEPS, STEP = 4, 0.7  # changes of a field, and the part of the error that each of them takes away
SMOOTH = 0.22  # px, standard deviation of the smoothing after each change
SLOPE = 2.0  # change of a field for each px across a crisp edge
INSIDE, MOST_INSIDE = 0.98, 0.3  # share of a pixel that is inside, and part of a thin mask inside
LEAST_SHARE = 12.0  # px^2 of a thin mask; smaller ones may be slivers beside other areas


def field_of(share: Floats) -> Floats:
    """Return a field (FINE h, FINE w) for the shares (h, w) of a mask."""
    h, w = share.shape
    field: Any = ndimage.zoom(
        share.astype(np.float32), FINE, order=3, mode="nearest", grid_mode=True
    )
    for _ in range(STEPS):
        inside = np.clip((field - 0.5) * (SLOPE * FINE / 2) + 0.5, 0, 1)
        error = share - inside.reshape(h, FINE, w, FINE).mean(axis=(1, 3))
        field += STEP * ndimage.zoom(error, FINE, order=1, mode="nearest", grid_mode=True)
        field = ndimage.gaussian_filter(field, SMOOTH * FINE, truncate=3)
    return field


def is_thin(share: Floats) -> bool:
    """Return whether few pixels of a mask are inside it."""
    total = share.sum()
    if total < LEAST_SHARE:
        return False
    return np.count_nonzero(ndimage.minimum_filter(share, 3) > INSIDE) < MOST_INSIDE * total
