"""Sketches on paper. This module recognises them, and evens their paper out.

A sketch is thin ink or pencil on bright paper. A photo or a scan of it has uneven light, grain and
stains, which nobody wants in a drawing:

    picture -> paper, which is what is nearly as bright as the brightest nearby -> its light
    -> darkness, as a share of the light -> ink, from half of its full darkness on

A scan in two colours has stairs of pixels, which are made smooth.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.areas.pixels import sprite_of
from gauss2svg.areas.texture import may_have_areas
from gauss2svg.photo.pixels import LUMA, shrunk
from gauss2svg.scene.inks import ink_colors, ink_name
from gauss2svg.without_scipy import nearest_entry, smoothed

Values = NDArray[np.float32]
LEVEL = 1 / 255  # smallest difference of two values of a picture of 8 bits

# What is darker than DIRT, and than NOISES times the noise of the paper, may be ink. The QUANTILE
# of its darkness is that of full ink.
NOISES = 6
DIRT = 0.1
QUANTILE = 0.8
MOST_INKS = 4
LEAST_SCAN = 2**16  # pixels of a scan in two colours. A smaller picture is pixel art
STAIRS = 1.0  # standard deviation in px of the blur that makes stairs smooth
MOST_STAIR = 4  # connected px that it moves to the other colour at a stair. More are a line
# Darkness of ink, as a share of the paper's light. Pencil may be paler, but makes no crisp edges.
LEAST_INK, LEAST_PENCIL = 0.4, 0.25
SAME_HUE = 0.3  # largest difference of hues of one ink, as blur and JPEG change them
RARE = 0.03  # share of the inked pixels that need no ink of their own


def evened(pixels: Values, working: Values, inks: object) -> tuple[Values, Values, str] | None:
    """Return a sketch without its paper, at two sizes, and the colours of paper and inks.

    Each pixel is a mixture of paper and an ink. The colours are returned as "#rrggbb,#rrggbb,..".

    pixels, working  the picture, and the perhaps smaller one that is fitted
    inks  colours of paper and ink to take, as a text like that, or 2. None: those of the sketch,
          which may have MOST_INKS
    Return None if the picture is no sketch on paper.
    """
    most = MOST_INKS if inks is None else 1
    sketch = _scan_of(working) or _sketch_of(working, most)
    larger = sketch
    if sketch is not None and pixels is not working:
        larger = _scan_of(pixels) or _sketch_of(pixels, most)
    if sketch is None or larger is None:
        return None
    colors = sketch[2]
    if isinstance(inks, str):
        colors = ink_colors(inks)
        colors = colors[np.argsort(-portable.product(colors, LUMA), kind="stable")]
    # In the larger picture, inks may be in another order.
    nearest = np.append(0, 1 + nearest_entry(sketch[2][1:], larger[2][1:])[1])
    picture, fitted = (
        (colors[0] + covered[..., None] * (colors[ink] - colors[0])).astype(np.float32)
        for covered, ink in ((larger[0], nearest[larger[1]]), sketch[:2])
    )
    return picture, picture if larger is sketch else fitted, ",".join(map(ink_name, colors))


def _scan_of(pixels: Values) -> tuple[Values, Any, Any] | None:
    """Return the shares, inks and colours of a scan in two colours, or None if it is no such scan.

    Its edges are smooth. In pixel art and in hatching, they would be elsewhere. That is no scan.
    """
    shape, channels = pixels.shape[:2], pixels.shape[2]
    colors = np.array([pixels.max(axis=(0, 1)), pixels.min(axis=(0, 1))])
    is_paper, is_ink = ((pixels == color).all(axis=2) for color in colors)
    if math.prod(shape) < LEAST_SCAN or channels != 3 or not (is_paper ^ is_ink).all():
        return None
    from gauss2svg.areas.arrays import dilated, parts_of  # here because few pictures need SciPy

    smooth: Any = smoothed(is_ink.astype(np.float32), STAIRS)
    edges = np.count_nonzero(np.diff(is_ink)) + np.count_nonzero(np.diff(is_ink, axis=0))
    moved = (smooth > 0.5) != is_ink
    if getattr(sprite_of(pixels), "side", 1) > 1 or np.count_nonzero(moved) > 0.1 * edges:
        return None
    # Lines of 1 px would be lost, so they stay as they are.
    labels, _ = parts_of(moved)
    beside_line = dilated((np.bincount(labels.ravel()) > MOST_STAIR)[labels] & moved)
    return (
        _crisp(np.where(beside_line, is_ink, smooth).astype(np.float32) - 0.5),
        np.ones(shape, int),
        colors,
    )


def _sketch_of(pixels: Values, most: int) -> tuple[Values, Any, Any] | None:
    """Return the shares (h, w) of ink in a picture, their inks (h, w), and the colours (k, 3).

    The first colour is that of the paper.

    pixels  (h, w, 3), or (h, w, 4), which is no sketch on paper, in 0..1
    most    largest number of inks
    Return None if it is no sketch on paper.
    """
    h, w, channels = pixels.shape
    times = max(max(h, w) // 256, 1)  # the light is found in a picture of 256 to 512 px
    small = shrunk(pixels, max(h // times, 1), max(w // times, 1))
    if channels != 3 or not _is_mostly_paper(portable.product(small, LUMA)):
        return None
    is_drawn = may_have_areas(pixels)
    light = _light_of(small, is_drawn)
    if light is None:
        return None
    from scipy import ndimage  # imported here because few pictures are mostly paper

    ratio = h / light.shape[0], w / light.shape[1], 1
    light: Any = ndimage.zoom(light, ratio, order=1, mode="nearest", grid_mode=True)
    dark = 1 - pixels / np.maximum(light, LEVEL)
    darkness = dark.max(axis=2)  # coloured ink is bright in one channel
    darkness -= np.median(darkness)
    noise, ink = _noise_and_ink(darkness)
    if ink < (LEAST_INK if is_drawn else LEAST_PENCIL) or not _is_ink(darkness, noise, ink):
        return None
    # What of the light of each channel ink takes, as a share of what it takes of the darkest one.
    # It is the same at edges, where ink mixes with paper.
    local: Any = smoothed(dark, 1)
    hues = np.clip(local / np.maximum(local.max(axis=2, keepdims=True), LEVEL), 0, 1)
    inked = darkness > ink / 2
    kinds = _kinds_of(hues[inked], most)
    if kinds is None:
        return None
    paper, nearest = np.clip(np.quantile(light, 0.9, axis=(0, 1)), 0, 1), np.ones((h, w), np.int64)
    nearest[inked] += nearest_entry(kinds, hues[inked])[1]
    colors = [paper]
    for k in range(1, len(kinds) + 1):
        own = inked & (nearest == k)
        strong = own & (darkness >= np.quantile(darkness[own], QUANTILE))
        colors.append(paper * np.clip(1 - np.median(dark[strong], axis=0), 0, 1))
    # Paler pixels have the ink of the nearest inked one.
    at: Any = ndimage.distance_transform_edt(~inked, return_distances=False, return_indices=True)
    colors = np.round(255 * np.array(colors)) / 255
    return _covered(darkness, noise, ink), nearest[tuple(at)], colors


def _kinds_of(hues: Values, most: int) -> Any:
    """Return the hues (k, 3) of at most `most` inks, the commonest one first.

    hues  (n, 3) of pixels. One is of an ink if it differs by at most SAME_HUE
    Return None if more than RARE of the pixels are of none.
    """
    kinds, left = list[Any](), hues
    while len(left) > RARE * len(hues) and len(kinds) < most:
        _, cell, counts = np.unique(np.rint(left * 6), True, False, True, axis=0)
        kind = np.median(
            left[np.abs(left - left[cell[counts.argmax()]]).max(axis=1) <= SAME_HUE / 2], 0
        )
        kinds.append(kind)
        left = left[np.abs(left - kind).max(axis=1) > SAME_HUE]
    return np.array(kinds) if len(left) <= RARE * len(hues) else None


def _is_mostly_paper(luma: Values) -> bool:
    """Return whether most pixels (h, w) are nearly as bright as the bright ones around them.

    A pixel is if its luma is within 10 % of the upper quartile of a square around it.
    """
    block = max(round(max(luma.shape) / 16), 1)
    rows, columns = (side // block for side in luma.shape)
    if not (rows and columns):  # a strip
        return False
    blocks = luma[: rows * block, : columns * block].reshape(rows, block, columns, block)
    bright = np.quantile(blocks, 0.75, axis=(1, 3), keepdims=True)
    is_paper = np.abs(blocks - bright) < 0.1 * bright
    return bool(np.median(bright) >= 0.5 and is_paper.mean() >= 0.7)


def _light_of(small: Values, is_drawn: bool) -> Values | None:
    """Return the light (h, w, 3) of the paper of a picture, or None if it shows none.

    is_drawn  whether the picture has the edges of a drawing. Then paper without grain is none
    """
    from scipy import ndimage

    from gauss2svg.areas.arrays import dilated

    side, luma = max(small.shape), portable.product(small, LUMA)
    smooth: Any = smoothed(luma, 1)
    # A window of a twelfth of the side always contains paper.
    bright: Any = ndimage.grey_closing(smooth, 2 * round(side / 24) + 1)
    darkness = 1 - smooth / np.maximum(bright, LEVEL)
    darkness -= np.median(darkness)
    noise, ink = _noise_and_ink(darkness)
    is_dark = darkness > max(NOISES / 2 * noise, 0.15 * ink)
    is_paper = ~dilated(is_dark, 2, None)
    if is_paper.mean() < 0.5:  # the share of the picture that is near no ink
        return None
    known = np.dstack([small, np.ones_like(luma)]) * is_paper[..., None]

    # Paper has grain: its median difference from the mean within 2 px is at least .3 levels.
    # Gradients that a program drew have at most .23, and even paper has none.
    sums: Any = smoothed(known, 2)[is_paper]
    grain = np.abs(luma[is_paper] - portable.product(sums[:, :3], LUMA) / sums[:, 3])
    has_grain = np.median(grain) >= 0.3 * LEVEL
    if not has_grain and is_drawn:
        return None
    # Light from farther away counts little.
    sums = smoothed(known, side / 60) + 0.02 * smoothed(known, side / 10)
    light = sums[..., :3] / np.maximum(sums[..., 3:], 1e-9)
    hues = light / np.maximum(light.mean(axis=2, keepdims=True), LEVEL)
    tint = np.median(hues, axis=(0, 1))
    is_white = np.ptp(tint) <= 0.3 and hues.std(axis=(0, 1)).max() <= 0.05
    # Pale areas of a cartoon are no shadows, which paper with grain may have.
    is_even = light.min() >= 0.96 * light.max()
    return light if is_white and (has_grain or is_even) else None


def _noise_and_ink(darkness: Values) -> tuple[float, float]:
    """Return the noise of paper, and the full darkness of ink, 0 if there is none."""
    noise = 1.48 * float(np.median(np.abs(darkness)))
    dark = darkness[darkness > max(NOISES * noise, DIRT)]
    return noise, float(np.quantile(dark, QUANTILE)) if dark.size else 0.0


def _is_ink(darkness: Values, noise: float, ink: float) -> bool:
    """Return whether what is dark is the ink of a sketch: dark, thin, and clear of the paper.

    Few pixels over 3 px away from ink have over a quarter of its darkness, and few are brighter
    than paper. A tenth of a plot with grey lines, its axes, is much darker than the others.
    """
    from scipy import ndimage

    from gauss2svg.areas.arrays import dilated

    is_ink, dirt = darkness > ink / 2, max(NOISES * noise, DIRT)
    if not is_ink.any() or np.quantile(darkness[is_ink], 0.9) > 1.7 * ink:
        return False
    wide: Any = ndimage.distance_transform_edt(is_ink)
    between = np.count_nonzero((darkness > ink / 4) & ~dilated(is_ink, 3, None))
    glare = np.count_nonzero(darkness < -dirt)
    is_thin = wide.max() <= max(is_ink.shape) / 50  # half of the width of the widest ink
    return is_thin and between <= 0.3 * is_ink.sum() and glare <= 0.05 * is_ink.sum()


def _covered(darkness: Values, noise: float, ink: float) -> Values:
    """Return the share (h, w) of each pixel that ink covers, with crisp edges.

    Ink begins at half of its darkness. The darkest pixel within 4 px tells how dark a line is. A
    line with less than .75 of the full darkness is drawn from half of its own darkness on. One with
    less than .4 is dirt, and so are parts of less than a pixel.
    """
    from scipy import ndimage

    from gauss2svg.areas.arrays import parts_of

    highest: Any = ndimage.maximum_filter(darkness, 9)
    own: Any = smoothed(highest, 1)
    rim = ink / 2 * np.minimum(own / (0.75 * ink), 1)
    above = np.where(own > max(NOISES * noise, DIRT), darkness - rim, -ink)
    covered = _crisp(above)
    labels, _ = parts_of(covered > 0)
    sizes = np.bincount(labels.ravel(), covered.ravel())
    own = np.bincount(labels.ravel(), (own * covered).ravel()) / np.maximum(sizes, 1e-9)
    return np.where((sizes >= 1) & (own >= 0.4 * ink), 1, 0)[labels] * covered


def _crisp(above: Values) -> Values:
    """Return which share (h, w) of each pixel lies where values are above 0, by cubic splines."""
    from scipy import ndimage

    ends: Any = (ndimage.maximum_filter(above, 3) > 0) & (ndimage.minimum_filter(above, 3) <= 0)
    covered: Any = (above > 0).astype(np.float32)
    spline: Any = ndimage.spline_filter(above, mode="nearest")
    places, parts = np.argwhere(ends).T, (np.arange(6) + 0.5) / 6 - 0.5
    within = np.stack(np.meshgrid(parts, parts, indexing="ij")).reshape(2, 1, -1)
    for k in range(0, places.shape[1], 2**15):  # to save memory
        some = places[:, k : k + 2**15]
        fine: Any = ndimage.map_coordinates(
            spline, some[..., None] + within, mode="nearest", prefilter=False
        )
        covered[tuple(some)] = (fine > 0).mean(axis=1)
    return covered
