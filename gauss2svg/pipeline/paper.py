"""Sketches on paper. This module recognises them, and evens their paper out.

A sketch is thin dark ink on bright paper. A photo or a scan of it has uneven light, grain and
stains, which nobody wants in a drawing:

    picture -> paper, which is what is nearly as bright as the brightest nearby -> its light
    -> darkness, as a share of the light -> ink, from half of its full darkness on
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.photo.pixels import shrunk
from gauss2svg.scene.inks import ink_colors, ink_name
from gauss2svg.without_scipy import smoothed

Values = NDArray[np.float32]
LUMA = np.array([0.299, 0.587, 0.114], np.float32)
LEVEL = 1 / 255  # smallest difference of two values of a picture of 8 bits

# The light is found in a reduced picture, whose longest side has SIDE to 2 * SIDE px. Lengths are
# shares of this side: of the squares in which pixels are compared, of a window that always contains
# paper, and of the sigma by which light is smoothed.
SIDE, BLOCK, WINDOW, SMOOTH = 256, 1 / 16, 1 / 12, 1 / 60
# A pixel may be paper if its luma differs by less than PALE from the upper quartile of its square,
# as a share of that. MOSTLY is the least share of such pixels, BRIGHT the least median quartile.
UPPER, PALE, MOSTLY, BRIGHT = 0.75, 0.1, 0.7, 0.5
FAR, FAR_WEIGHT = 6, 0.02  # factor on this sigma for light from farther away, and its weight
LEAST_PAPER = 0.5  # share of the picture that is near no ink
# The grain of paper, in levels, is its median difference from the mean within so many px. Gradients
# that a program drew have at most .23, and even paper has none.
GRAIN, AROUND = 0.3, 2
# Largest standard deviations of a channel of the light divided by their mean, and of a channel of
# the ink minus their mean. TINTED is the largest difference between two channels of the light.
COLORED_PAPER, COLORED_INK, TINTED = 0.05, 0.06, 0.3
# What is darker than DIRT, and than NOISES times the noise of the paper, may be ink. The QUANTILE
# of its darkness is that of full ink, at least LEAST_INK.
NOISES, DIRT, QUANTILE, LEAST_INK = 6, 0.1, 0.8, 0.4
WIDEST = 1 / 50  # half of the width of the widest ink, as a share of the longest side
# Largest numbers, for each pixel of ink, of pixels that are over 3 px away from ink and have over a
# quarter of its darkness, and of pixels that are brighter than paper.
BETWEEN, GLARE = 0.3, 0.05

FINE, AT_ONCE = 6, 2**15  # parts of a pixel's side, and pixels that are divided at once
NEAR = 4  # px within which the darkest pixel tells how dark a line is
# A line with less of the full darkness than FAINT is drawn from half of its own darkness on, and
# one with less than FAINTEST is dirt. So are parts of fewer px than SPECK.
FAINT, FAINTEST, SPECK = 0.75, 0.4, 1.0
BRIGHTEST = 0.9  # quantile of the light that becomes the colour of the paper


def evened(pixels: Values, working: Values, inks: object) -> tuple[Values, Values, str] | None:
    """Return a sketch without its paper, at two sizes, and the colours of paper and ink.

    Each pixel is a mixture of these colours, which are returned as "#rrggbb,#rrggbb".

    pixels, working  the picture, and the perhaps smaller one that is fitted
    inks  colours to take, as a text like that. Otherwise they are those of the sketch
    Return None if the picture is no sketch on paper.
    """
    sketch = _sketch_of(working)
    larger = sketch if pixels is working or sketch is None else _sketch_of(pixels)
    if sketch is None or larger is None:
        return None
    colors = ink_colors(inks) if isinstance(inks, str) else sketch[1]
    colors = colors[np.argsort(-portable.product(colors, LUMA), kind="stable")]
    picture, fitted = (
        (colors[0] + covered[..., None] * (colors[1] - colors[0])).astype(np.float32)
        for covered in (larger[0], sketch[0])
    )
    return picture, picture if larger is sketch else fitted, ",".join(map(ink_name, colors))


def _sketch_of(pixels: Values) -> tuple[Values, Any] | None:
    """Return the shares (h, w) of ink in a picture, and the colours (2, 3) of paper and ink.

    pixels  (h, w, 3), or (h, w, 4), which is no sketch on paper, in 0..1
    Return None if it is no sketch on paper.
    """
    h, w, channels = pixels.shape
    times = max(max(h, w) // SIDE, 1)
    small = shrunk(pixels, max(h // times, 1), max(w // times, 1))
    if channels != 3 or not _is_mostly_paper(portable.product(small, LUMA)):
        return None
    light = _light_of(small)
    if light is None:
        return None
    from scipy import ndimage  # imported here because few pictures are mostly paper

    ratio = h / light.shape[0], w / light.shape[1], 1
    light: Any = ndimage.zoom(light, ratio, order=1, mode="nearest", grid_mode=True)
    shares = pixels / np.maximum(light, LEVEL)
    darkness = 1 - portable.product(shares, LUMA)
    noise, ink = _noise_and_ink(darkness)
    inked = shares[darkness > QUANTILE * ink]
    hues = inked - inked.mean(axis=1, keepdims=True)
    if not _is_ink(darkness, noise, ink) or hues.std(axis=0).max() > COLORED_INK:
        return None
    paper = np.clip(np.quantile(light, BRIGHTEST, axis=(0, 1)), 0, 1)
    colors = np.stack([paper, paper * np.clip(np.median(inked, axis=0), 0, 1)])
    return _covered(darkness, noise, ink), np.round(255 * colors) / 255


def _is_mostly_paper(luma: Values) -> bool:
    """Return whether most pixels (h, w) are nearly as bright as the bright ones around them."""
    block = max(round(BLOCK * max(luma.shape)), 1)
    rows, columns = (side // block for side in luma.shape)
    if not (rows and columns):  # a strip
        return False
    blocks = luma[: rows * block, : columns * block].reshape(rows, block, columns, block)
    bright = np.quantile(blocks, UPPER, axis=(1, 3), keepdims=True)
    is_paper = np.abs(blocks - bright) < PALE * bright
    return bool(np.median(bright) >= BRIGHT and is_paper.mean() >= MOSTLY)


def _light_of(small: Values) -> Values | None:
    """Return the light (h, w, 3) of uneven paper, or None if the picture shows none."""
    from scipy import ndimage

    from gauss2svg.areas.arrays import dilated

    side, luma = max(small.shape), portable.product(small, LUMA)
    smooth: Any = smoothed(luma, 1)
    bright: Any = ndimage.grey_closing(smooth, 2 * round(WINDOW * side / 2) + 1)
    darkness = 1 - smooth / np.maximum(bright, LEVEL)
    darkness -= np.median(darkness)
    noise, ink = _noise_and_ink(darkness)
    is_dark = darkness > max(NOISES / 2 * noise, 0.15 * ink)
    is_paper = ~dilated(is_dark, 2, None)
    if is_paper.mean() < LEAST_PAPER:
        return None
    known = np.dstack([small, np.ones_like(luma)]) * is_paper[..., None]

    sums: Any = smoothed(known, AROUND)[is_paper]
    grain = np.abs(luma[is_paper] - portable.product(sums[:, :3], LUMA) / sums[:, 3])
    if np.median(grain) < GRAIN * LEVEL:
        return None
    sums = smoothed(known, SMOOTH * side) + FAR_WEIGHT * smoothed(known, FAR * SMOOTH * side)
    light = sums[..., :3] / np.maximum(sums[..., 3:], 1e-9)
    hues = light / np.maximum(light.mean(axis=2, keepdims=True), LEVEL)
    tint = np.median(hues, axis=(0, 1))
    is_white = np.ptp(tint) <= TINTED and hues.std(axis=(0, 1)).max() <= COLORED_PAPER
    return light if is_white else None


def _noise_and_ink(darkness: Values) -> tuple[float, float]:
    """Return the noise of paper, and the full darkness of ink, 0 if there is none."""
    noise = 1.48 * float(np.median(np.abs(darkness)))
    dark = darkness[darkness > max(NOISES * noise, DIRT)]
    return noise, float(np.quantile(dark, QUANTILE)) if dark.size else 0.0


def _is_ink(darkness: Values, noise: float, ink: float) -> bool:
    """Return whether what is dark is the ink of a sketch: dark, thin, and clear of the paper."""
    from scipy import ndimage

    from gauss2svg.areas.arrays import dilated

    is_ink, dirt = darkness > ink / 2, max(NOISES * noise, DIRT)
    if ink < LEAST_INK:
        return False
    wide: Any = ndimage.distance_transform_edt(is_ink)
    between = np.count_nonzero((darkness > ink / 4) & ~dilated(is_ink, 3, None))
    glare = np.count_nonzero(darkness < -dirt)
    return (
        wide.max() <= WIDEST * max(is_ink.shape)
        and between <= BETWEEN * is_ink.sum()
        and glare <= GLARE * is_ink.sum()
    )


def _covered(darkness: Values, noise: float, ink: float) -> Values:
    """Return the share (h, w) of each pixel that ink covers, with crisp edges."""
    from scipy import ndimage

    from gauss2svg.areas.arrays import parts_of

    highest: Any = ndimage.maximum_filter(darkness, 2 * NEAR + 1)
    own: Any = smoothed(highest, 1)
    rim = ink / 2 * np.minimum(own / (FAINT * ink), 1)
    above = np.where(own > max(NOISES * noise, DIRT), darkness - rim, -ink)
    ends: Any = (ndimage.maximum_filter(above, 3) > 0) & (ndimage.minimum_filter(above, 3) <= 0)
    covered: Any = (above > 0).astype(np.float32)
    spline: Any = ndimage.spline_filter(above, mode="nearest")
    places, parts = np.argwhere(ends).T, (np.arange(FINE) + 0.5) / FINE - 0.5
    within = np.stack(np.meshgrid(parts, parts, indexing="ij")).reshape(2, 1, -1)
    for k in range(0, places.shape[1], AT_ONCE):
        some = places[:, k : k + AT_ONCE]
        fine: Any = ndimage.map_coordinates(
            spline, some[..., None] + within, mode="nearest", prefilter=False
        )
        covered[tuple(some)] = (fine > 0).mean(axis=1)
    labels, _ = parts_of(covered > 0)
    sizes = np.bincount(labels.ravel(), covered.ravel())
    own = np.bincount(labels.ravel(), (own * covered).ravel()) / np.maximum(sizes, 1e-9)
    return np.where((sizes >= SPECK) & (own >= FAINTEST * ink), 1, 0)[labels] * covered
