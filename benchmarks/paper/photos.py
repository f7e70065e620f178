"""The photos, which the wheel of scikit-image contains, and errors over their smooth areas."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from skimage import data

from gauss2svg.measure.metrics import LEVELS
from gauss2svg.photo.alpha import shrunk
from gauss2svg.photo.load import load_image

Pixels = NDArray[np.float32]

# 17 to 29 % of the photos at 256 px have no such step, ten levels, within that distance. The
# criterion of flat_error, five levels within 4 px, leaves 4 to 7 %.
_STEP, _AWAY = 0.04, 2


def photo(name: str, side: int) -> Pixels:
    """One picture (h, w, 3) in 0..1 on 8 bits, reduced to `side` px on its longest side."""
    pixels = load_image(getattr(data, name)()).pixels
    share = side / max(pixels.shape[:2])
    height, width = (round(s * share) for s in pixels.shape[:2])
    return (np.round(shrunk(pixels, height, width) * LEVELS) / LEVELS).astype(np.float32)


def steep(pixels: Pixels) -> NDArray[np.bool_]:
    """(h, w) pixels on either side of a step of 0.04 or more in any channel."""
    found = np.zeros(pixels.shape[:2], bool)
    for axis in (0, 1):
        steps = np.abs(np.diff(pixels, axis=axis)).max(axis=2) >= _STEP
        lead = (slice(None),) * axis
        found[(*lead, slice(1, None))] |= steps
        found[(*lead, slice(-1))] |= steps
    return found


@dataclass(frozen=True)
class Smoothness:
    """Errors of an image where the photo is smooth: no step of 0.04 within 2 px.

    area   share of the photo that is smooth
    error  root of the mean squared error there, in levels of 255
    edges  share of that area where the image has a false edge: a step of 0.04
    """

    area: float
    error: float
    edges: float


def smoothness(image: Pixels, pixels: Pixels) -> Smoothness:
    """Smoothness of an image (h, w, 3); error and edges are nan if no area is smooth."""
    area = np.logical_not(maximum_filter(steep(pixels), size=2 * _AWAY + 1))
    if not area.any():
        return Smoothness(0.0, math.nan, math.nan)
    squares = np.square(image[area].astype(np.float64) - pixels[area])
    edges = steep(image)[area]
    return Smoothness(
        float(area.mean()), math.sqrt(float(squares.mean())) * LEVELS, float(edges.mean())
    )
