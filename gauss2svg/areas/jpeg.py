"""JPEG: the quality of a picture that was saved as JPEG, and what that changed of a drawing.

What JPEG changes depends on the picture alone. So if areas are nearly those of the source, JPEG
changes their raster nearly as it has changed the source. Without this change, the noisy picture has
less noise, and its areas are closer to the source.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from gauss2svg import portable
from gauss2svg.areas.clean import LUMA
from gauss2svg.areas.kernels import Floats

SIDE = 8  # px of the blocks that JPEG transforms
MOST_SIDE = 1024  # rows and columns of a larger picture that are looked at
QUALITIES = range(20, 100)  # a quality of 100 leaves no noise
LEAST_STEP = 2  # levels; rounding to whole levels hides finer steps
# Least mean cosine of the phases of coefficients in their steps, in standard deviations of random
# phases. It is 14 to 140 for JPEGs of 256 px, and up to 6 for pictures reduced by half. Clean
# ones, which have no noise and are not asked, have up to 14.
ON_STEPS = 8.0
# Element (x, u) is the value at x of the cosine of the frequency u.
_COSINES = portable.cos(np.pi / SIDE * np.outer(np.arange(SIDE) + 0.5, np.arange(SIDE)))
_COSINES *= np.sqrt(np.where(np.arange(SIDE), 2, 1) / SIDE)


def quality_of(picture: Floats) -> int | None:
    """Return the quality at which an opaque picture (h, w, 3) was saved as JPEG.

    It is that of libjpeg's tables. Return None if the picture has no such tables.
    """
    luma = 255 * portable.product(picture[:MOST_SIDE, :MOST_SIDE], LUMA[0])
    h, w = (side - side % SIDE for side in luma.shape)
    blocks = luma[:h, :w].reshape(h // SIDE, SIDE, w // SIDE, SIDE)
    values = portable.product(portable.product(blocks, _COSINES).swapaxes(1, 3), _COSINES)
    values = values.transpose(0, 2, 3, 1).reshape(-1, SIDE * SIDE)
    values[:, 0] = 0  # many blocks of even parts have the same mean
    place = np.nonzero(np.abs(values) > LEAST_STEP / 2)
    values, frequency = values[place], place[1]

    def score(quality: int) -> float:
        step = _steps(quality)[frequency]
        is_rounded = (step >= LEAST_STEP) & (np.abs(values) > step / 2)
        cosine = portable.cos(2 * np.pi * values[is_rounded] / step[is_rounded])
        return float(cosine.sum()) / np.sqrt(max(len(cosine) / 2, 1))

    scores = {quality: score(quality) for quality in QUALITIES}
    best = max(QUALITIES, key=lambda quality: scores[quality])
    return best if scores[best] > ON_STEPS else None


def coded(drawn: Floats, quality: int, picture: Floats) -> Floats:
    """Return a drawn picture (h, w, 3) after it was saved as JPEG, as `picture` was.

    Colour differences have the full or half the size, whichever brings it closer to `picture`.
    """
    levels = np.round(255 * np.clip(drawn, 0, 1)).astype(np.uint8)
    both = [_saved(levels, quality, subsampling) for subsampling in ("4:2:0", "4:4:4")]
    return min(both, key=lambda one: float(((one - picture) ** 2).sum()))


def decoded(picture: Floats, drawn: Floats, quality: int) -> Floats:
    """Return a picture without what JPEG changed, if the source is nearly as it is drawn."""
    change = coded(drawn, quality, picture) - np.round(255 * drawn) / 255
    return np.clip(picture - change, 0, 1).astype(np.float32)


def _saved(levels: Any, quality: int, subsampling: str) -> Floats:
    from PIL import Image  # few pictures need it

    file = io.BytesIO()
    Image.fromarray(levels).save(file, "JPEG", quality=quality, subsampling=subsampling)
    return np.asarray(Image.open(file), np.float32) / 255


def _steps(quality: int) -> Floats:
    """Return the steps (64,) to which JPEG rounds the coefficients of luma."""
    from PIL import Image

    file = io.BytesIO()
    Image.new("L", (SIDE, SIDE)).save(file, "JPEG", quality=quality)
    tables: Any = Image.open(file)
    return np.array(tables.quantization[0], float)
