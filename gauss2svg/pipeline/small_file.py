"""Files in which every byte is planned. Their scenes are in whole numbers of a coarse unit.

shapes -> the most useful ones, in whole units -> colours by least squares, rounded to 3 or 6
digits -> minimal markup -> fewer shapes until the file is within its limit of bytes

With the shapes fixed a picture is linear in its colours: each pixel is sum_k w_k c_k, where w_k is
alpha_k times the transmittance of all shapes above, and k = 0 is the background. The colours that
solve the normal equations within 0..1, rounded to the digits of the file, regain much of what
rounding the geometry costs (docs/decisions/small.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.colors import solved_colors
from gauss2svg.fit.target import psnr_of
from gauss2svg.photo.pixels import BACKDROPS, Size, has_alpha, views
from gauss2svg.pipeline.outcome import SEEN_UP_TO, Subject
from gauss2svg.pipeline.palette import Rows, best_palette
from gauss2svg.render.weights import color_weights
from gauss2svg.scene import Scene
from gauss2svg.svg.forms import plain_radius
from gauss2svg.svg.minimal import minimal_rounded, whole_unit

# dB that twice as many shapes must gain on the enlarged picture. More shapes also follow more of
# the guesses between the pixels (docs/decisions/enlarged.md).
LEAST_GAIN = 1.0
# Mean squared error below which a file is exact: that of half an 8-bit level.
EXACT_UNDER = (0.5 / 255) ** 2


# Unit of a small file's whole numbers (docs/decisions/small.md).
UNITS_PER_ROOT = 32.0  # units along the longest side of the file, per square root of the count
LEAST_ACROSS = 8  # least units along the shortest side. Shapes under half a unit are not drawn
MOST_FINER = 10  # largest factor on the wanted number of units that may make both sides whole


@dataclass(frozen=True, eq=False)
class SmallFile:
    """A file, the scene that it draws on the photo's canvas, and its error.

    error           mean squared error at the working size: of the raster if the file has been
                    rasterised, else of the model
    size            bytes of the file, as the limit counts them
    enlarged_error  mean squared error of the model against the enlarged picture, NaN without one
    """

    svg: str
    scene: Scene
    error: float
    size: int
    enlarged_error: float = math.nan


def closeness(file: SmallFile) -> tuple[float, ...]:
    """Return a sort key that is larger for the closer of two files.

    If there is an enlarged picture, differences at the working size count only up to SEEN_UP_TO dB.
    If both files reach SEEN_UP_TO, they are compared enlarged, where twice as many shapes must gain
    LEAST_GAIN dB.
    """
    if math.isnan(file.enlarged_error):
        return -file.error, -file.size
    gain = psnr_of(file.enlarged_error) - LEAST_GAIN * math.log2(max(len(file.scene), 1))
    return min(psnr_of(file.error), SEEN_UP_TO), gain, -file.size


def flat_scene(subject: Subject, digits: int) -> tuple[Scene, float]:
    """Return a scene without Gaussians, in an opaque photo's mean colour, and its file's unit."""
    transparent, unit = has_alpha(subject.photo), whole_unit(*subject.canvas)
    mean = subject.photo.mean(axis=(0, 1), dtype=np.float64)
    background = np.ones(3) if transparent else mean
    scene = Scene(*subject.canvas, background=background, transparent=transparent)
    return minimal_rounded(scene, unit, digits), unit


def unit_of(grid: float, count: int, canvas: Size) -> float:
    """Return the unit in px of a file with `count` shapes. A larger grid makes the unit smaller.

    Both sides are whole numbers of units, so that the file needs no size, unless this takes more
    than MOST_FINER times the wanted number of units.
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
    shared: float = 0.0,
    weight: NDArray[np.float32] | None = None,
) -> tuple[Scene, float]:
    """Return the scene with the colours of least squared error, and that error per value.

    pixels  (h, w, 3) or (h, w, 4) float32 in 0..1, compared with the scene at this size
    digits  number of hex digits, 3 or 6, to which the colours are rounded
    shared  share of the squared error that may be added so that shapes share colours
    weight  (h, w) weight of each pixel's error, of mean 1; None for 1
    A picture with alpha is compared over white and over black, and has no background. Plain
    ellipses count by how much of each pixel they cover, as in `render` with covering.
    """
    height, width = pixels.shape[:2]
    scaled = scene.scaled(width / scene.width, height / scene.height)
    weights, products = color_weights(scaled, plain_radius(scaled.beta), height, width)
    targets = [view.reshape(-1, 3).astype(np.float64) for view in views(pixels)]
    if weight is not None:  # both sides of each pixel's equation are multiplied by its root
        root = np.sqrt(weight.reshape(-1, 1).astype(np.float64))
        weights, targets = weights.multiply(root.T).tocsr(), [root * target for target in targets]
        products = (weights @ weights.T).toarray()
    first = int(has_alpha(pixels))  # index of the first weight whose colour is unknown
    if first:  # the backdrop shows through the shapes, and is known
        through = weights[[0]].toarray().reshape(-1, 1)
        targets = [t - b * through for t, b in zip(targets, BACKDROPS, strict=True)]
    products = products[first:, first:] * len(targets)
    sums = (weights @ np.sum(targets, axis=0))[first:]  # right-hand sides of the normal equations
    levels = 15 if digits == 3 else 255
    squares = sum(float(np.square(target).sum()) for target in targets)

    def residual(color: Rows) -> float:
        return squares + float(np.sum(color * (products @ color - 2 * sums)))

    color = solved_colors(products, sums, levels)
    if shared and len(color):
        allowed = shared * residual(color)
        beta, count = np.ones(len(color)), len(color)
        entry = best_palette(color, beta, np.diag(products), count, allowed)[2]
        members = np.eye(entry.max() + 1)[:, entry]
        color = solved_colors(members @ products @ members.T, members @ sums, levels)[entry]
    error = max(residual(color), 0.0) / (3 * len(targets) * width * height)
    background = scene.background if first else color[0]
    return scene.replace(background=background, color=color[1 - first :]), error
