"""Panels of the documentation's figures: the example photo, pictures in rows under their titles."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

COFFEE = Path(__file__).parents[1] / "examples/coffee.jpg"
WIDTH_IN = 7.2
_TITLE_IN = 0.3

Pixels = NDArray[np.floating]


def coffee(width: int) -> Pixels:
    """The example photo at a width in px."""
    with Image.open(COFFEE) as image:
        return reduced(np.asarray(image.convert("RGB")), width)


def reduced(pixels: NDArray[np.uint8], width: int) -> Pixels:
    """An image (h, w, c) of 8 bits at another width in px, in 0..1."""
    size = (width, round(width * pixels.shape[0] / pixels.shape[1]))
    return np.asarray(Image.fromarray(pixels).resize(size, Image.Resampling.LANCZOS)) / 255


def enlarged(pixels: Pixels, factor: int, how: Image.Resampling) -> Pixels:
    """An image (h, w, 3) in 0..1 so many times as large."""
    eight = Image.fromarray(np.round(np.clip(pixels, 0, 1) * 255).astype(np.uint8))
    return np.asarray(eight.resize((eight.width * factor, eight.height * factor), how)) / 255


def tiles(pictures: Sequence[Pixels], titles: Sequence[str], columns: int | None = None) -> Figure:
    """Pictures of one shape in so many columns, for phones too, or in a row; under their titles."""
    size = 8 if columns is None else 12  # pt
    columns = columns or len(pictures)
    rows = -(-len(pictures) // columns)
    ratio = sum(p.shape[1] / p.shape[0] for p in pictures[:columns])
    figure, axes = plt.subplots(
        rows, columns, figsize=(WIDTH_IN, rows * (WIDTH_IN / ratio + _TITLE_IN) + 0.15),
        layout="constrained", squeeze=False,
        width_ratios=[p.shape[1] / p.shape[0] for p in pictures[:columns]],
    )  # fmt: skip
    for axis in axes.flat:
        axis.axis("off")
    for axis, picture, title in zip(axes.flat, pictures, titles, strict=False):
        axis.imshow(np.clip(picture, 0, 1), interpolation="lanczos")
        axis.set_title(title, fontsize=size)
    return figure
