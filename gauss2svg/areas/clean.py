"""The picture in which areas are found: without noise of JPEG, photos, and shading.

A clean drawing is even up to its edges. Noise is measured where it is not: a few px beside crisp
edges. If there is noise, even cores are found within tolerances that follow it. Each core gets one
colour, or a smooth shading. Pixels between cores become mixtures of the two cores beside them.
What is no such mixture, as a thin line, is only smoothed.

What JPEG changes depends on the picture alone. So if areas are nearly those of the source, JPEG
changes their raster nearly as it has changed the source. Without this change, the noisy picture has
less noise, and its areas are closer to the source.

Photos in a drawing, noise and other textured parts each become one even part. A large square
without a block of one colour lies in a textured part. The part reaches as far as squares without an
exact block do, because the even places of a photo are noisy, and those of a drawing are not.

Glows, soft shadows, and other shading without crisp edges are taken out, because areas imitate them
by strips. Only crisp areas are then found, and Gaussians draw the shading below and above them.
"""

from __future__ import annotations

import io
import math
from typing import Any

import numpy as np
from scipy import ndimage

from gauss2svg import portable
from gauss2svg.areas import arrays
from gauss2svg.areas.arrays import BLOCK, LEVEL, Bools, Floats, Ints, dilated
from gauss2svg.areas.paint import GOOD, opacity_of, paint_of
from gauss2svg.areas.regions import bend_of, cores_of, cores_of_blocks, renamed, spread_of
from gauss2svg.areas.texture import TWO_TONED, is_shaded, two_toned
from gauss2svg.core import Kernel
from gauss2svg.portable import product

LUMA = np.array([[0.299, 0.587, 0.114], [-0.168, -0.332, 0.5], [0.5, -0.418, -0.082]])  # YCbCr
LEAST_NOISE = 0.8 * LEVEL  # noise of pixels that are far from edges
# Noise of colour differences is at least that of luma, and this share of their contrast nearby,
# because JPEG stores them at half the size. The second share is that of a picture of which areas
# tell where colour differences have edges.
BLEEDING, UNBLED = 0.08, 0.02

_average_alike = Kernel("average_alike", "int int float32 float32 float32")
_mix_cores = Kernel("mix_cores", "int int float32 float32 int32 int float32 float32 float32")


def noise_of(pixels: Floats) -> float:
    """Return the noise beside crisp edges of a picture (h, w, c).

    It is 0 if the picture is clean or transparent, or has a textured part, such as a photo.
    """
    if pixels.shape[2] != 3:
        return 0.0
    luma = product(pixels, LUMA[0].astype(np.float32))
    contrast = spread_of(luma[..., None], 3)[..., 0]
    distance: Any = ndimage.distance_transform_edt(contrast <= 24 * LEVEL)
    beside = (distance >= 2.5) & (distance <= 5.5)
    beside[[0, -1]] = beside[:, [0, -1]] = False
    bend = bend_of(luma[..., None])
    uneven = bend[beside & (bend > 1.01 * LEVEL)]  # smaller ones come from rounding
    # Clean drawings have at most a share of .11, JPEG over .2. Dense maps have up to .22, but then
    # three quarters of the others are exact, and at most .56 in a JPEG of quality 30.
    count, exact = np.count_nonzero(beside), np.count_nonzero(bend[beside] < 0.5 * LEVEL)
    if len(uneven) <= 0.17 * count or (exact > 0.65 * count and quality_of(pixels) is None):
        return 0.0
    if textured(pixels, cores_of(pixels)).any():
        return 0.0
    # This quantile of uneven second differences is 2.4 times the noise.
    noise = float(np.quantile(uneven, 0.8)) / 2.4
    # Glows bend beside edges too, but little.
    return 0.0 if noise < LEAST_NOISE and is_shaded(pixels) else max(noise, LEAST_NOISE)


def cleaned(pixels: Floats, noise: float, bleeding: float = BLEEDING) -> Floats:
    """Return an opaque picture (h, w, 3) without noise of this height beside its edges.

    Differences within cores are counted in the noise around them.
    """
    values = product(pixels, LUMA.T.astype(np.float32))
    local = _local(values, noise, bleeding)
    smooth = values
    for _ in range(2):
        noisy, smooth = smooth, np.empty_like(values)
        _average_alike(*values.shape[:2], noisy, local, smooth)
    spread = (spread_of(smooth, 2) / local).max(axis=-1)
    bend: Any = ndimage.maximum_filter(bend_of(smooth), 2) / local[..., 0]
    block = (spread <= 1.3) | ((bend <= 1.0) & (spread <= 3.0))
    cores, colors = np.full(block.shape, -1, np.int32), np.empty((0, 3), np.float32)
    for _ in range(3):
        # Cores of what the cores of earlier rounds have left.
        block &= ndimage.maximum_filter(cores, 2) < 0
        more = cores_of_blocks(block)
        # Shades of an edge have no 3 x 3 pixels.
        is_inner: Any = ndimage.minimum_filter(more, 3) == ndimage.maximum_filter(more, 3)
        more = renamed(more, np.unique(more[is_inner & (more >= 0)]))
        colors = _evened(pixels, values, smooth, local, more, colors)
        cores = np.where(more >= 0, more + cores.max() + 1, cores)
    result = smooth.copy()
    colors = colors[:16].astype(np.float32)  # those that are tried in mixtures anywhere
    _mix_cores(*cores.shape, values, smooth, cores, len(colors), colors, local, result)
    back = portable.solve(LUMA, np.eye(3)).T.astype(np.float32)
    return np.clip(product(result, back), 0, 1)


def _local(values: Floats, noise: float, bleeding: float) -> Floats:
    """Return the noise (h, w, 3) of luma and of the colour differences around each pixel.

    It follows the contrasts up to 4 px away.
    """
    result = np.empty_like(values)
    luma, chroma = (
        ndimage.maximum_filter(spread_of(values[..., part], 3).max(axis=-1), 9)
        for part in (np.s_[:1], np.s_[1:])
    )
    # Beside a contrast of 60 levels, noise has its full height.
    result[..., 0] = np.clip(noise / (60 * LEVEL) * luma, LEAST_NOISE, noise)
    # JPEG has blocks of up to 16 px. Where all is grey in them, colour differences have no noise.
    near: Any = ndimage.maximum_filter(chroma, 25)
    least = np.minimum(result[..., 0], np.maximum(near, LEAST_NOISE))
    result[..., 1:] = np.maximum(bleeding * chroma, least)[..., None]
    return result


def _evened(
    pixels: Floats, values: Floats, smooth: Floats, local: Floats, cores: Ints, colors: Floats
) -> Floats:
    """Write the values of cores without noise to `smooth`, and return the colours of even cores.

    Cores are in the order of their sizes. A small one gets the colour of a larger one that is alike
    within the noise. Pixels that are not like their core are taken out of `cores`.
    """
    for k, box in enumerate(ndimage.find_objects(cores + 1)):
        inside = cores[box] == k
        core: Any = ndimage.binary_erosion(inside, BLOCK, border_value=1)
        # The mean of the values near their median
        inner = values[box][core]
        near = np.abs(inner - np.median(inner, axis=0)) <= 2 * LEVEL
        color = (inner * near).sum(axis=0) / np.maximum(near.sum(axis=0), 1)
        noise, own = local[box][inside], smooth[box][inside]
        size = len(own)
        # This share of the noise is left in the mean of a core of more than 8 x 8 pixels.
        share = min(1.0, 8 / math.sqrt(size))
        most = noise.mean(axis=0)
        off = np.abs(own - color) > 2.0 * share * most + 2 * LEVEL
        if np.count_nonzero(off.any(axis=1)) <= 0.15 * size:
            far = (np.abs(colors - color) / (1.5 * share * most + LEVEL)).max(axis=1)
            if far.size and far.min() <= 1:
                color = colors[far.argmin()]
            else:
                colors = np.vstack([colors, color[None]])
            new = np.broadcast_to(color, own.shape)
        else:
            ys, xs = arrays.pixels_of(inside, box)
            paint = paint_of(pixels, ys, xs)
            new = product(paint.at(xs, ys), LUMA.T.astype(np.float32))
            if not paint.is_shaded or np.abs(own - new).mean() > 0.7 * most[0] + LEVEL:
                new = own
        is_off: Bools = np.any(np.abs(own - new) > 1.5 * noise + 2 * LEVEL, axis=1)
        smooth[box][inside] = np.where(is_off[:, None], own, new)
        cores[box][inside] = np.where(is_off, -1, k)
    return colors


SIDE = 8  # px of the blocks that JPEG transforms


def quality_of(picture: Floats) -> int | None:
    """Return the quality at which an opaque picture (h, w, 3) was saved as JPEG.

    It is that of libjpeg's tables. Return None if the picture has no such tables.
    """
    luma = 255 * product(picture[:1024, :1024], LUMA[0])  # enough of a large picture
    h, w = (side - side % SIDE for side in luma.shape)
    # Element (x, u) is the value at x of the cosine of the frequency u.
    cosines = portable.cos(np.pi / SIDE * np.outer(np.arange(SIDE) + 0.5, np.arange(SIDE)))
    cosines *= np.sqrt(np.where(np.arange(SIDE), 2, 1) / SIDE)
    blocks = luma[:h, :w].reshape(h // SIDE, SIDE, w // SIDE, SIDE)
    values = product(product(blocks, cosines).swapaxes(1, 3), cosines)
    values = values.transpose(0, 2, 3, 1).reshape(-1, SIDE * SIDE)
    values[:, 0] = 0  # many blocks of even parts have the same mean
    place = np.nonzero(np.abs(values) > 1)
    values, frequency = values[place], place[1]

    def score(quality: int) -> float:
        tables: Any = _jpeg(np.zeros((SIDE, SIDE), np.uint8), quality)
        step = np.array(tables.quantization[0], float)[frequency]
        # Rounding to whole levels hides finer steps.
        is_rounded = (step >= 2) & (np.abs(values) > step / 2)
        cosine = portable.cos(2 * np.pi * values[is_rounded] / step[is_rounded])
        return float(cosine.sum()) / np.sqrt(max(len(cosine) / 2, 1))

    best = max(range(20, 100), key=score)  # 100 leaves no noise
    # In standard deviations of random phases, the mean cosine is 14 to 140 for JPEGs of 256 px, and
    # up to 6 for pictures reduced by half.
    return best if score(best) > 8 else None


def coded(drawn: Floats, quality: int, picture: Floats) -> Floats:
    """Return a drawn picture (h, w, 3) after it was saved as JPEG, as `picture` was.

    Colour differences have the full or half the size, whichever brings it closer to `picture`.
    """
    levels = np.round(255 * np.clip(drawn, 0, 1)).astype(np.uint8)
    both = [
        np.asarray(_jpeg(levels, quality, subsampling=subsampling), np.float32) / 255
        for subsampling in ("4:2:0", "4:4:4")
    ]
    return min(both, key=lambda one: float(((one - picture) ** 2).sum()))


def decoded(picture: Floats, drawn: Floats, quality: int) -> Floats:
    """Return a picture without what JPEG changed, if the source is nearly as it is drawn."""
    change = coded(drawn, quality, picture) - np.round(255 * drawn) / 255
    return np.clip(picture - change, 0, 1).astype(np.float32)


def _jpeg(levels: Any, quality: int, **options: str) -> Any:
    """Return an image of Pillow with these levels that was saved as JPEG."""
    from PIL import Image  # few pictures need it

    file = io.BytesIO()
    Image.fromarray(levels).save(file, "JPEG", quality=quality, **options)
    return Image.open(file)


def with_even_photos(pixels: Floats, cores: Ints) -> Floats:
    """Return the picture in which each textured part has its mean colour."""
    photo = textured(pixels, cores)
    if not photo.any():
        return pixels
    result = pixels.copy()
    part, boxes = arrays.parts_of(photo)
    for k, box in enumerate(boxes, 1):
        inside = part[box] == k
        result[box][inside] = pixels[box][inside].mean(axis=0, dtype=np.float64)
    return result


def textured(pixels: Floats, cores: Ints) -> Bools:
    """Return the pixels (h, w) of textured parts."""
    # Blocks of one colour below 5 px occur in noise too. Text, hatching and the waves of JPEG leave
    # no square of over 33 px without such a block.
    seeds = _opened(~_opened(cores >= 0, 5), 33)
    if not seeds.any():
        return seeds
    # An exact pixel has exact neighbours, so that those of a block have exact values up to its rim.
    bend = bend_of(pixels)
    is_exact: Any = ndimage.binary_erosion(bend <= 1.1 * LEVEL, BLOCK, border_value=1)
    rough = ~dilated(is_exact, 2)
    part, _ = arrays.parts_of(_opened(rough, 17) | seeds)
    sizes, seed_sizes = (np.bincount(part[m], minlength=part.max() + 1) for m in (part > 0, seeds))
    # Where noise is faint, fewer squares are seeds, and areas are found.
    # Letters, hatching and lines on a shaded ground of a JPEG have no such blocks either. There,
    # half of a part may be far from edges.
    edge, even = (np.bincount(part[m], minlength=len(sizes)) for m in two_toned(pixels[..., :3]))
    is_crisp = (edge >= 0.4 * sizes) & (even >= TWO_TONED * edge)
    names = np.flatnonzero((seed_sizes > 0.2 * sizes) & ~is_crisp)
    whole = np.isin(part, np.intersect1d(names, part[_opened(part > 0, 65)]))
    # The squares leave out corners of a part that is turned or round.
    result: Any = ndimage.binary_dilation(whole, BLOCK, 8, _opened(rough, 5))
    # A core is in or out as a whole, so that a photo has no holes, and letters on it none either.
    sizes = np.bincount(cores[cores >= 0])
    outside = np.bincount(cores[(cores >= 0) & ~result], minlength=len(sizes))
    is_inside = outside <= 0.3 * sizes
    return np.where(cores < 0, result, is_inside[cores]) if len(sizes) else result


def _opened(mask: Bools, side: int) -> Bools:
    """Return the union of the squares of `side` px in a mask."""
    least = ndimage.minimum_filter(mask.view(np.uint8), side, mode="constant")
    return ndimage.maximum_filter(least, side, mode="constant").view(bool)


def without_shading(pixels: Floats) -> Floats:
    """Return a picture (h, w, c) in which each part without edges has one paint.

    Parts of fewer than 40 pixels have no shading.
    """
    is_edge = np.zeros(pixels.shape[:2], bool)
    for axis, first, last in ((0, np.s_[:-1], np.s_[1:]), (1, np.s_[:, :-1], np.s_[:, 1:])):
        step = np.abs(np.diff(pixels, axis=axis)).max(axis=2)
        # A step of an edge may be small, as of dark cards, if those 3 px away are much smaller.
        ends = np.isin(np.arange(7), (0, 6)).reshape((1, 7) if axis else (7, 1))
        away: Any = ndimage.maximum_filter(step, footprint=ends, mode="constant")
        differs = (step > 0.07) | ((step > 0.03) & (step > 6 * away))
        is_edge[first] |= differs
        is_edge[last] |= differs
    part, boxes = arrays.parts_of(~is_edge)
    result = pixels.astype(np.float32, copy=True)
    for k, tight in enumerate(boxes, 1):
        ys, xs = arrays.pixels_of(part[tight] == k, tight)
        if len(ys) < 40:
            continue
        values = pixels[ys, xs]
        levels = np.round(values * 255).astype(np.int64) @ 256 ** np.arange(values.shape[1])
        _, first, count = np.unique(levels, return_index=True, return_counts=True)
        if count.max() >= 0.25 * len(ys):  # the colour below the shading
            even = np.broadcast_to(values[first[count.argmax()]], values.shape)
        elif (opacity := opacity_of(values.T)).min() < 0.05 and opacity.max() > 0.1:
            # Gaussians above and below only add opacity.
            clearest = values[opacity <= np.quantile(opacity, 0.01)]
            even = np.broadcast_to(clearest.mean(axis=0), values.shape)
        else:
            even = paint_of(pixels, ys, xs).at(xs, ys)
        change = np.zeros_like(result)
        change[ys, xs] = even - values
        if np.abs(change[ys, xs]).max() < GOOD:
            continue
        box = arrays.widened(tight, 4, part.shape)
        change, inside, parts = change[box], part[box] == k, part[box] > 0
        others, rim = parts & ~inside, dilated(inside, 3) & ~parts
        if others.any():
            # A pixel of the rim is mixed of the nearest ones of the part and of the others.
            values, nearest = pixels[box], (arrays.distance_to(m)[1] for m in (inside, others))
            own, other = (tuple(places[:, rim]) for places in nearest)
            way = values[own] - values[other]
            along = ((values[rim] - values[other]) * way).sum(axis=1)
            share = np.clip(along / np.maximum((way**2).sum(axis=1), 1e-6), 0, 1)
            change[rim] = share[:, None] * change[own]
        result[box] += change
    return np.clip(result, 0, 1)
