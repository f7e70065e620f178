"""JPEG: the quality of a picture that was saved as JPEG, and what that changes of a drawing.

What JPEG does to a picture depends on the picture alone. So if areas are nearly those of the
source, their raster is changed nearly as the source was. The difference, taken from the noisy
picture, leaves one with less noise, whose areas are closer still.
"""

from __future__ import annotations

import io
from typing import NamedTuple

import numpy as np
from scipy.fft import dctn

from gauss2svg.areas.kernels import Floats

BLOCK = 8  # px a side that JPEG transforms at once
QUALITIES = range(20, 100)  # a quality of 100 leaves no noise
LEAST_STEP = 2  # levels; values of finer steps are on them by chance
# Least sum of cosines of the phases of coefficients, in its standard deviation if they are random.
# JPEGs of 256 px have 20 to 90, and other pictures up to 7.
ON_STEPS = 12.0
LUMA, BLUE = (0.299, 0.587, 0.114), (-0.168736, -0.331264, 0.5)
MOST_ROWS = 1024  # rows and columns of a large picture that are looked at


class Coding(NamedTuple):
    """How a picture was saved as JPEG.

    quality      that of the tables of the standard, as libjpeg scales them
    is_halved    whether its colour differences have half its size
    """

    quality: int
    is_halved: bool


def coding_of(picture: Floats) -> Coding | None:
    """Return how an opaque picture (h, w, 3) was saved as JPEG. Return None if it was not."""
    values = 255 * picture[:MOST_ROWS, :MOST_ROWS]
    tables = {quality: _tables(quality) for quality in QUALITIES}
    luma, blue = (_coefficients(values @ np.array(weights)) for weights in (LUMA, BLUE))
    scores = {quality: _on_steps(luma, luma_table) for quality, (luma_table, _) in tables.items()}
    quality = max(scores, key=lambda quality: scores[quality])
    if scores[quality] < ON_STEPS:
        return None
    return Coding(quality, _on_steps(blue, tables[quality][1]) < ON_STEPS)


def coded(picture: Floats, coding: Coding) -> Floats:
    """Return a picture (h, w, 3) after it was saved as JPEG."""
    from PIL import Image  # few pictures need it

    file, levels = io.BytesIO(), np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)
    subsampling = "4:2:0" if coding.is_halved else "4:4:4"
    Image.fromarray(levels).save(file, "JPEG", quality=coding.quality, subsampling=subsampling)
    return np.asarray(Image.open(file), np.float32) / 255


def decoded(picture: Floats, drawn: Floats, coding: Coding) -> Floats:
    """Return a picture without what JPEG changed of it, if it is nearly that which was drawn."""
    drawn = np.round(255 * drawn) / 255
    return np.clip(picture + drawn - coded(drawn, coding), 0, 1).astype(np.float32)


def _tables(quality: int) -> list[Floats]:
    """Return the steps (64,) by which JPEG rounds coefficients of luma and of colour differences."""
    from PIL import Image

    file = io.BytesIO()
    Image.new("RGB", (BLOCK, BLOCK)).save(file, "JPEG", quality=quality)
    tables = Image.open(file).quantization
    return [np.array(tables[k], float) for k in (0, 1)]


def _coefficients(values: Floats) -> tuple[Floats, Floats]:
    """Return the coefficients (n,) of a channel (h, w) that may not be 0, and their places."""
    h, w = (side - side % BLOCK for side in values.shape)
    blocks = values[:h, :w].reshape(h // BLOCK, BLOCK, w // BLOCK, BLOCK)
    coefficients = dctn(blocks, axes=(1, 3), norm="ortho").swapaxes(1, 2).reshape(-1, BLOCK**2)
    place = np.nonzero(np.abs(coefficients) > LEAST_STEP / 2)
    is_mean = place[1] == 0  # even parts have the same mean in many blocks
    return coefficients[place][~is_mean], place[1][~is_mean]


def _on_steps(channel: tuple[Floats, Floats], table: Floats) -> float:
    """Return how far coefficients are at whole steps of a table, in standard deviations."""
    value, step = channel[0], table[channel[1]]
    is_rounded = (step >= LEAST_STEP) & (np.abs(value) > step / 2)
    cosine = np.cos(2 * np.pi * (value / step)[is_rounded])
    return float(cosine.sum() / np.sqrt(max(len(cosine), 1) / 2))
