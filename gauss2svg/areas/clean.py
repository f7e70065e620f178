"""Cleaning: a drawing without the noise that JPEG leaves beside its edges.

A clean drawing is even up to its edges. Noise is measured where it is not: a few px beside crisp
edges. If there is noise, even cores are found within tolerances that follow it. Each core gets one
colour, or a smooth shading. Pixels between cores become mixtures of the two cores beside them.
What is no such mixture, as a thin line, is only smoothed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy import ndimage

from gauss2svg.areas.evened import textured
from gauss2svg.areas.kernels import Bools, Floats, Ints
from gauss2svg.areas.masks import BLOCK, LEVEL, pixels_of
from gauss2svg.areas.paint import paint_of
from gauss2svg.areas.regions import bend_of, cores_of, cores_of_blocks, over_blocks, renamed
from gauss2svg.core import Kernel
from gauss2svg.portable import product, solve
from gauss2svg.without_scipy import smoothed

EDGE = 24 * LEVEL  # least contrast of 3 x 3 pixels at an edge
BESIDE = 2.5, 5.5  # px; distances from edges at which noise is measured
UNEVEN = 1.01 * LEVEL  # larger second differences do not come from rounding
NOISY = 0.17  # share of uneven pixels beside edges. Clean drawings have at most .11, JPEG over .2
QUANTILE, SPREAD = 0.8, 2.4  # quantile of uneven second differences, and its ratio to the noise
LEAST_NOISE = 0.8 * LEVEL  # noise of pixels that are far from edges
REACH = 4  # px up to which edges have noise beside them
FULL_NOISE = 60 * LEVEL  # contrast beside which noise of luma has its full height
# Noise of colour differences is at least that of luma, and this share of their contrast nearby,
# because JPEG stores them at half the size.
BLEEDING = 0.08
UNBLED = 0.02  # the same in a picture of which areas tell where colour differences have edges
LUMA = np.array([[0.299, 0.587, 0.114], [-0.168, -0.332, 0.5], [0.5, -0.418, -0.082]])  # YCbCr

# The rest is counted in noise, if no unit is given.
PASSES = 2  # means of neighbours that are alike
FLAT, JOINED = 1.3, 1.5  # largest differences in a block of one core, and of its neighbours
BEND, STEEP = 1.0, 3.0  # largest second and first differences in a block that is evenly shaded
ROUNDS = 3  # searches for cores, each among the pixels that were unlike the cores before
EVEN, MOST_OFF = 2.0, 0.15  # an even core has at most this share of pixels that differ more
SAME = 1.5  # difference of the colours of cores that become one
SURE = 8.0  # px; side of a core whose mean has the noise of a pixel, and larger ones less
SHADED = 0.7  # mean difference from a gradient that draws a core
SMOOTHED = 4.0  # px by which other shading is smoothed
OFF = 1.5  # a pixel that differs more is no part of its core
MOST_COLORS = 16  # colours of even cores that are tried in mixtures anywhere

EDGE_STEPS, WIDE_EDGE = 9, 60 * LEVEL  # px and least contrast of edges whose widths are measured
SAME_WAY = 0.8  # share of all differences along an edge that lead the same way
# Fewer edges, or a smaller share of all steep places, tell nothing: they may be sides of lines.
LEAST_EDGES, LEAST_SHARE = 20, 0.25
# A picture was enlarged if this quantile of the largest step of an edge, as a share of its
# contrast, is at most NARROW. Clean drawings have at least .74, and JPEGs of quality 75 .64.
CRISPEST, NARROW = 0.8, 0.6
ONE_STEP = 0.86  # the quantile in pictures that were not enlarged
MOST_TIMES = 2.0  # edges that are wider come from blur


def noise_of(pixels: Floats) -> float:
    """Return the noise beside crisp edges of a picture (h, w, c).

    It is 0 if the picture is clean or transparent, or has a textured part, such as a photo.
    """
    if pixels.shape[2] != 3:
        return 0.0
    luma = product(pixels, LUMA[0].astype(np.float32))
    distance: Any = ndimage.distance_transform_edt(_contrast(luma[..., None]) <= EDGE)
    beside = (distance >= BESIDE[0]) & (distance <= BESIDE[1])
    beside[[0, -1]] = beside[:, [0, -1]] = False
    bend = bend_of(luma[..., None])
    uneven = bend[beside & (bend > UNEVEN)]
    if len(uneven) <= NOISY * np.count_nonzero(beside):
        return 0.0
    if textured(pixels, cores_of(pixels)[0]).any():
        return 0.0
    return max(float(np.quantile(uneven, QUANTILE)) / SPREAD, LEAST_NOISE)


def _contrast(values: Floats) -> Floats:
    """Return the largest difference (h, w) of values (h, w, c) in 3 x 3 pixels."""
    high: Any = ndimage.maximum_filter(values, (3, 3, 1))
    low: Any = ndimage.minimum_filter(values, (3, 3, 1))
    return (high - low).max(axis=-1)


def cleaned(pixels: Floats, noise: float, bleeding: float = BLEEDING) -> Floats:
    """Return an opaque picture (h, w, 3) without noise of this height beside its edges."""
    values = product(pixels, LUMA.T.astype(np.float32))
    local = _local(values, noise, bleeding)
    smooth = values
    for _ in range(PASSES):
        noisy, smooth = smooth, np.empty_like(values)
        _average_alike(*values.shape[:2], noisy, local, smooth)
    spread = over_blocks(smooth, np.maximum) - over_blocks(smooth, np.minimum)
    spread = (spread / local).max(axis=-1)
    bend = over_blocks(bend_of(smooth), np.maximum) / local[..., 0]
    block = (spread <= FLAT) | ((bend <= BEND) & (spread <= STEEP))
    cores, colors = np.full(block.shape, -1, np.int32), np.empty((0, 3), np.float32)
    for _ in range(ROUNDS):
        # Cores of what the cores of earlier rounds have left.
        block &= over_blocks(cores[..., None], np.maximum)[..., 0] < 0
        more, count = _wide(*cores_of_blocks(smooth, block, JOINED * noise))
        colors = _evened(pixels, smooth, local, more, count, colors)
        cores = np.where(more >= 0, more + cores.max() + 1, cores)
    result = smooth.copy()
    colors = colors[:MOST_COLORS].astype(np.float32)
    _mix_cores(*cores.shape, values, smooth, cores, len(colors), colors, local, result)
    back = solve(LUMA, np.eye(3)).T.astype(np.float32)
    return np.clip(product(result, back), 0, 1)


def _local(values: Floats, noise: float, bleeding: float) -> Floats:
    """Return the noise (h, w, 3) of luma and of the colour differences around each pixel."""
    result = np.empty_like(values)
    luma, chroma = (
        ndimage.maximum_filter(_contrast(values[..., part]), 2 * REACH + 1)
        for part in (np.s_[:1], np.s_[1:])
    )
    result[..., 0] = np.clip(noise / FULL_NOISE * luma, LEAST_NOISE, noise)
    result[..., 1:] = np.maximum(bleeding * chroma, result[..., 0])[..., None]
    return result


def _wide(cores: Ints, count: int) -> tuple[Ints, int]:
    """Return the cores that have 3 x 3 pixels, because shades of an edge have not."""
    is_inner: Any = ndimage.minimum_filter(cores, 3) == ndimage.maximum_filter(cores, 3)
    kept = np.unique(cores[is_inner & (cores >= 0)])
    return renamed(cores, kept), len(kept)


def _evened(
    pixels: Floats, smooth: Floats, local: Floats, cores: Ints, count: int, colors: Floats
) -> Floats:
    """Write the values of cores without noise to `smooth`, and return the colours of even cores.

    Cores are in the order of their sizes. A small one gets the colour of a larger one that is alike
    within the noise. Pixels that are not like their core are taken out of `cores`.
    """
    values = product(pixels, LUMA.T.astype(np.float32))
    for k, box in enumerate(ndimage.find_objects(cores + 1, max_label=count)):
        if box is None:
            continue
        inside = cores[box] == k
        core: Any = ndimage.binary_erosion(inside, BLOCK, border_value=1)
        color, noise, own = _middle(values[box][core]), local[box][inside], smooth[box][inside]
        size = len(own)
        # This share of the noise is left in the mean of a core.
        share = min(1.0, SURE / math.sqrt(size))
        most = noise.mean(axis=0)
        off = np.abs(own - color) > EVEN * share * most + 2 * LEVEL
        if np.count_nonzero(off.any(axis=1)) <= MOST_OFF * size:
            far = (np.abs(colors - color) / (SAME * share * most + LEVEL)).max(axis=1)
            if far.size and far.min() <= 1:
                color = colors[far.argmin()]
            else:
                colors = np.vstack([colors, color[None]])
            new = np.broadcast_to(color, own.shape)
        else:
            ys, xs = pixels_of(inside, box)
            paint = paint_of(pixels, ys, xs)
            new = product(paint.at(xs, ys), LUMA.T.astype(np.float32))
            if not paint.is_shaded or np.abs(own - new).mean() > SHADED * most[0] + LEVEL:
                new = _smoothed(values[box], inside)
                new = np.where(np.abs(new - own) <= noise, new, own)
        is_off: Bools = np.any(np.abs(own - new) > OFF * noise + 2 * LEVEL, axis=1)
        smooth[box][inside] = np.where(is_off[:, None], own, new)
        cores[box][inside] = np.where(is_off, -1, k)
    return colors


def _smoothed(values: Floats, inside: Bools) -> Floats:
    """Return the values (n, c) of the pixels of a mask (h, w), smoothed within it."""
    masked = np.dstack([values, np.ones_like(values[..., 0])]) * inside[..., None]
    sums: Any = smoothed(masked, SMOOTHED)
    return sums[inside][:, :-1] / sums[inside][:, -1:]


def _middle(values: Floats) -> Floats:
    """Return the mean (c,) of the values (n, c) near their median."""
    median = np.median(values, axis=0)
    near = np.abs(values - median) <= 2 * LEVEL
    return (values * near).sum(axis=0) / np.maximum(near.sum(axis=0), 1)


_average_alike = Kernel("average_alike", "int int float32 float32 float32")
_mix_cores = Kernel("mix_cores", "int int float32 float32 int32 int float32 float32 float32")


def enlargement_of(pixels: Floats) -> float:
    """Return how many times a picture (h, w, c) was enlarged, by the width of its crispest edges.

    If it was not enlarged, one step between two pixels has most of the contrast of such an edge.
    """
    luma = product(pixels[..., :3], LUMA[0].astype(np.float32))
    shares, steep = [], 0
    for rows in (luma, luma.T):
        if rows.shape[1] <= EDGE_STEPS:
            return 1.0
        heights, middle = np.abs(np.diff(rows)), np.s_[:, EDGE_STEPS // 2 : -(EDGE_STEPS // 2)]
        highest: Any = ndimage.maximum_filter1d(heights, EDGE_STEPS)
        mean: Any = ndimage.uniform_filter1d(heights, EDGE_STEPS)
        step, highest, way = heights[middle], highest[middle], EDGE_STEPS * mean[middle]
        whole = np.abs(rows[:, EDGE_STEPS:] - rows[:, :-EDGE_STEPS])
        is_steep = (step >= highest) & (way > WIDE_EDGE)
        is_edge = is_steep & (whole > WIDE_EDGE) & (whole > SAME_WAY * way)
        shares.append(step[is_edge] / whole[is_edge])
        steep += np.count_nonzero(is_steep)
    shares = np.concatenate(shares)
    if len(shares) < max(LEAST_EDGES, LEAST_SHARE * steep):
        return 1.0
    share = float(np.quantile(shares, CRISPEST))
    return 1.0 if share > NARROW else min(round(2 * ONE_STEP / share) / 2, MOST_TIMES)
