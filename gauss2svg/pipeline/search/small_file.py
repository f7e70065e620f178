"""Files whose every byte is planned: a scene in whole numbers of a coarse unit.

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
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit.losses import psnr_of
from gauss2svg.photo.alpha import BACKDROPS, has_alpha, views
from gauss2svg.pipeline.palette import best_palette
from gauss2svg.pipeline.search.outcome import SEEN_UP_TO
from gauss2svg.scene import PLAIN, Scene
from gauss2svg.scene.falloff import coverage, cut_radius, profile
from gauss2svg.svg.minimal import minimal_rounded, whole_unit
from gauss2svg.svg.plain_ellipse import plain_radius

if TYPE_CHECKING:
    from scipy.sparse import csr_array

# dB that twice as many shapes must gain on the enlarged picture. More shapes follow more of what is
# guessed between the pixels (docs/decisions/enlarged.md).
LEAST_GAIN = 1.0
EXACT = (0.5 / 255) ** 2  # mean squared error of half an 8-bit level, under which a file is exact


# Unit of a small file's whole numbers (docs/decisions/small.md).
UNITS_PER_ROOT = 32.0  # units along the longest side of the file, per square root of the count
# Fewest units along the shortest side. Shapes under half a unit are not drawn.
ACROSS = 8
FINER = 10  # largest multiple of the wanted units that whole numbers for both sides may take


@dataclass(frozen=True, eq=False)
class SmallFile:
    """A file, the scene that it draws on the photo's canvas, and its error.

    error           mean squared error at the working size, of the model until the file is drawn,
                    then of the raster
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

    If there is an enlarged picture, differences at the working size count up to SEEN_UP_TO dB.
    Files that are equal by that are compared enlarged, and twice as many shapes must gain
    LEAST_GAIN.
    """
    if math.isnan(file.enlarged_error):
        return -file.error, -file.size
    gain = psnr_of(file.enlarged_error) - LEAST_GAIN * math.log2(max(len(file.scene), 1))
    return min(psnr_of(file.error), SEEN_UP_TO), gain, -file.size


def flat_scene(
    photo: NDArray[np.float32], canvas: tuple[int, int], digits: int
) -> tuple[Scene, float]:
    """Return a scene without Gaussians of a photo's mean colour, and the unit of its file."""
    transparent = has_alpha(photo)
    background = np.ones(3) if transparent else photo.mean(axis=(0, 1), dtype=np.float64)
    scene, unit = (
        Scene(*canvas, background=background, transparent=transparent),
        whole_unit(*canvas),
    )
    return minimal_rounded(scene, unit, digits), unit


def unit_of(grid: float, count: int, canvas: tuple[int, int]) -> float:
    """Return the unit in px of a file with `count` shapes. A larger grid makes it smaller.

    Both sides are whole numbers of units, so that the file needs no size. They are not if that
    takes over FINER times the units.
    """
    longest, shortest = max(canvas), min(canvas)
    units = math.ceil(grid * UNITS_PER_ROOT * math.sqrt(max(count, 1)))
    units = max(units, math.ceil(ACROSS * longest / shortest))
    unit = whole_unit(*canvas, units)
    return unit if longest / unit <= FINER * units else longest / units


_LEAST_WEIGHT = 1e-9  # least weight of a colour that counts in a pixel


# Colours by least squares (docs/decisions/small.md).
BOUNDED_SWEEPS = 20  # sweeps over all colours that keep them within their bounds
ROUNDED_SWEEPS = 3  # sweeps over all colours that round them
DAMPING = 1e-6  # share of the diagonal that is added to it, for nearly hidden shapes


def recolored(
    scene: Scene, pixels: NDArray[np.float32], digits: int, shared: float = 0.0
) -> tuple[Scene, float]:
    """Return the scene with the colours of least squared error, and that error per value.

    pixels  (h, w, 3) or (h, w, 4) float32 in 0..1, compared with the scene at this size
    digits  number of hex digits, 3 or 6, to which the colours are rounded
    shared  share of the squared error that may be added so that shapes share colours
    A picture with alpha is compared over white and over black, and has no background. Plain
    ellipses count by how much of each pixel they cover, as in `render` with covering.
    """
    height, width = pixels.shape[:2]
    scaled = scene.scaled(width / scene.width, height / scene.height)
    weights, products = _weights(scaled, height, width)
    targets = [view.reshape(-1, 3).astype(np.float64) for view in views(pixels)]
    first = 0
    if has_alpha(pixels):  # the backdrop shows through the shapes, and is known
        through = weights[[0]].toarray().reshape(-1, 1)
        targets = [t - b * through for t, b in zip(targets, BACKDROPS, strict=True)]
        first = 1
    products = products[first:, first:] * len(targets)
    total = np.sum(targets, axis=0)
    given = (weights @ total)[first:]
    levels = 15 if digits == 3 else 255
    squares = sum(float(np.square(target).sum()) for target in targets)

    def residual(color: NDArray[np.float64]) -> float:
        return squares + float(np.sum(color * (products @ color - 2 * given)))

    color = _solved(products, given, levels)
    if shared and len(color):
        entry = best_palette(
            color, np.ones(len(color)), np.diag(products), len(color), shared * residual(color)
        ).entry
        sums = np.zeros((entry.max() + 1, len(entry)))
        sums[entry, np.arange(len(entry))] = 1
        color = _solved(sums @ products @ sums.T, sums @ given, levels)[entry]
    error = max(residual(color), 0.0) / (3 * len(targets) * width * height)
    if first:
        return scene.replace(color=color), error
    return scene.replace(background=color[0], color=color[1:]), error


def _weights(scene: Scene, height: int, width: int) -> tuple[csr_array, NDArray[np.float64]]:
    """Return the weights (n + 1, h w) of the colours, the background first, and their products.

    The products (n + 1, n + 1) are sums over all pixels. The weights are sparse, because few shapes
    show in a pixel.
    """
    from scipy.sparse import csr_array  # takes a third of a second, and only small files need it

    covers, radius = scene.drawn == PLAIN, plain_radius(scene.beta)
    reach = scene.sigma * cut_radius(scene.beta)[:, None] + covers[:, None]
    low = np.clip(np.floor(scene.mean - reach - 0.5), 0, [width, height]).astype(np.intp)
    high = np.clip(np.ceil(scene.mean + reach + 0.5), 0, [width, height]).astype(np.intp)
    left, whitening = np.ones((height, width)), scene.whitening
    pixel = np.arange(height * width).reshape(height, width)
    values, pixels = [np.zeros(0)] * (len(scene) + 1), [pixel[0, :0]] * (len(scene) + 1)
    for k in range(len(scene) - 1, -1, -1):
        (x0, y0), (x1, y1) = low[k], high[k]
        u = np.arange(x0, x1) + 0.5 - scene.mean[k, 0]
        v = np.arange(y0, y1)[:, None] + 0.5 - scene.mean[k, 1]
        w11, w21, w22 = whitening[k]
        z = np.stack(np.broadcast_arrays(w11 * u, w21 * u + w22 * v), axis=-1)
        if covers[k]:
            share = coverage(z, whitening[k], radius[k])
        else:
            share = profile(np.sqrt(np.square(z).sum(axis=-1)), scene.beta[k])
        alpha = scene.opacity[k] * share
        box = left[y0:y1, x0:x1]
        weight = alpha * box
        shows = weight > _LEAST_WEIGHT
        values[k + 1], pixels[k + 1] = weight[shows], pixel[y0:y1, x0:x1][shows]
        box *= 1 - alpha
    shows = left > _LEAST_WEIGHT
    values[0], pixels[0] = left[shows], pixel[shows]
    starts = np.cumsum([0, *map(len, values)])
    weights = csr_array(
        (np.concatenate(values), np.concatenate(pixels), starts), (len(values), height * width)
    )
    return weights, (weights @ weights.T).toarray()


def _solved(
    products: NDArray[np.float64], given: NDArray[np.float64], levels: int
) -> NDArray[np.float64]:
    """Return (k, 3) colours in 0..1, multiples of 1 / levels, that solve the normal equations.

    The equations are solved without bounds, then colour by colour within bounds, and then with each
    colour rounded in turn. Colours that are rounded later make up for earlier rounding errors.
    """
    diagonal = np.maximum(np.diag(products), 1e-9)
    damped = products + DAMPING * np.diag(diagonal + diagonal.max())
    color = np.linalg.solve(damped, given)
    bounded = 0 if (color >= 0).all() and (color <= 1).all() else BOUNDED_SWEEPS
    color = np.minimum(np.maximum(color, 0), 1)
    order = np.argsort(-diagonal)
    for sweep in range(bounded + ROUNDED_SWEEPS):
        for k in order:
            best = color[k] + (given[k] - products[k] @ color) / diagonal[k]
            if sweep >= bounded:
                best = np.rint(best * levels) / levels
            color[k] = np.minimum(np.maximum(best, 0), 1)
    return color
