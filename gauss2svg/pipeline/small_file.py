"""Small files that are made to fit a limit of bytes. Their coordinates are in whole units.

    the most useful shapes -> coordinates rounded to whole units -> colours by least squares,
    rounded to 3 or 6 hex digits -> minimal markup -> fewer shapes until the file is within its
    limit of bytes

If the shapes are fixed, a picture is a linear function of its colours: each pixel is
sum_k w_k c_k, where c_k is the colour of shape k, and w_k is its alpha times the transmittance of
all shapes above it. k = 0 is the background. The best colours within 0..1 are found by solving the
normal equations, and are then rounded to the digits of the file. These colours regain much of the
PSNR that is lost when the coordinates are rounded (docs/decisions/small.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.colors import solved_colors
from gauss2svg.photo.pixels import BACKDROPS, Size, has_alpha, views
from gauss2svg.pipeline.outcome import Subject
from gauss2svg.pipeline.palette import Rows
from gauss2svg.render.weights import color_weights
from gauss2svg.scene import Scene
from gauss2svg.svg.minimal import as_written, whole_unit

# A file counts as exact if its mean squared error is below that of a picture in which every value
# is half an 8-bit level too large.
EXACT_UNDER = (0.5 / 255) ** 2


# The next three numbers decide the unit of a small file's coordinates (docs/decisions/small.md).
# The number of units along the longest side is the square root of the number of Gaussians,
# multiplied by this number.
UNITS_PER_ROOT = 32.0
# Smallest number of units along the shortest side. With fewer, the shapes of a long and thin
# picture would be under half a unit thick, and would not be drawn.
LEAST_ACROSS = 8
# To make both sides whole numbers of units, the number of units may be raised by at most this
# factor.
MOST_FINER = 10


@dataclass(frozen=True, eq=False)
class SmallFile:
    """A file, the scene that it draws on the photo's canvas, and its error.

    error           mean squared error at the size of the working picture. If the file has been
                    rasterised, it is the error of the raster, otherwise that of the model
    size            number of bytes of the file, as the limit counts them
    """

    svg: str
    scene: Scene
    error: float
    size: int


def error_and_size(file: SmallFile) -> tuple[float, int]:
    """Return the sort key of a file. Of two files of one error, the smaller one is better."""
    return file.error, file.size


def flat_scene(subject: Subject, digits: int) -> tuple[Scene, float]:
    """Return a scene without Gaussians, and the length in px of the unit of its file.

    The background has the mean colour of the photo. If the photo has alpha, the scene is
    transparent instead.
    """
    transparent, unit = has_alpha(subject.photo), whole_unit(*subject.canvas)
    mean = subject.photo.mean(axis=(0, 1), dtype=np.float64)
    background = np.ones(3) if transparent else mean
    scene = Scene(*subject.canvas, background=background, transparent=transparent)
    return as_written(scene, unit, digits), unit


def unit_of(grid: float, count: int, canvas: Size) -> float:
    """Return the length in px of the unit in which a file with `count` shapes has its coordinates.

    grid  factor on the usual number of units along a side. The larger it is, the smaller is the
          unit
    The unit is chosen so that both sides of the canvas are whole numbers of units, because the file
    then needs no width and height. But if this takes more than MOST_FINER times as many units as
    wanted, only the longest side is a whole number of units.
    """
    longest, shortest = max(canvas), min(canvas)
    units = math.ceil(grid * UNITS_PER_ROOT * math.sqrt(max(count, 1)))
    units = max(units, math.ceil(LEAST_ACROSS * longest / shortest))
    unit = whole_unit(*canvas, units)
    return unit if longest / unit <= MOST_FINER * units else longest / units


def recolored(
    scene: Scene,
    pixels: NDArray[np.float32],
    digits: int,
    weight: NDArray[np.float32] | None = None,
) -> tuple[Scene, float]:
    """Return the scene with the colours that minimise its squared error against a picture.

    The second value is the mean squared error with these colours.

    pixels  picture, (h, w, 3) or (h, w, 4) float32 in 0..1. The scene is drawn at the size of the
            picture to compare the two
    digits  number of hex digits, 3 or 6, to which the colours are rounded
    weight  (h, w) weight of each pixel's error, of mean 1. If it is None, all weights are 1
    A picture with alpha is compared over white and over black, and its scene has no background.
    """
    height, width = pixels.shape[:2]
    scaled = scene.scaled(width / scene.width, height / scene.height)
    weights, products = color_weights(scaled, height, width)
    targets = [view.reshape(-1, 3).astype(np.float64) for view in views(pixels)]
    # Each pixel gives an equation. Both of its sides are multiplied by the square root of the
    # pixel's weight, so that the squared error of the equation gets this weight.
    if weight is not None:
        root = np.sqrt(weight.reshape(-1, 1).astype(np.float64))
        weights, targets = weights.multiply(root.T).tocsr(), [root * target for target in targets]
        products = (weights @ weights.T).toarray()
    first = int(has_alpha(pixels))  # index of the first weight that belongs to an unknown colour
    # For a picture with alpha, the targets are the picture over white and over black. Weight 0 says
    # how much of the white or black is visible at each pixel. As this colour is known, its part is
    # subtracted from the targets.
    if first:
        through = weights[[0]].toarray().reshape(-1, 1)
        targets = [t - b * through for t, b in zip(targets, BACKDROPS, strict=True)]
    products = products[first:, first:] * len(targets)
    # Right-hand sides of the normal equations.
    sums = (weights @ np.sum(targets, axis=0))[first:]
    levels = 15 if digits == 3 else 255
    squares = sum(float(np.square(target).sum()) for target in targets)

    def residual(color: Rows) -> float:
        return squares + float(np.sum(color * (products @ color - 2 * sums)))

    color = solved_colors(products, sums, levels)
    error = max(residual(color), 0.0) / (3 * len(targets) * width * height)
    background = scene.background if first else color[0]
    return scene.replace(background=background, color=color[1 - first :]), error
