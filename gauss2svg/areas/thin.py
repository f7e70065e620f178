"""Colours of thin parts, which have few pixels of pure colour: letters, and what is unexplained.

The strokes of small letters have few pixels of their pure colour, or none, and many pixels of equal
mixtures with the ground. Taken as colours, these would become areas of their own. So parts that may
be a line of text have one colour, the one that is farthest from the ground, and each pixel of a
part is mixed of this colour and the ground.

Other parts that the regions around them do not explain take a colour that is pure elsewhere, if one
explains them.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from operator import itemgetter
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from gauss2svg.areas.arrays import (
    LEVEL,
    Bools,
    Box,
    Floats,
    Ints,
    dilated,
    parts_of,
    pixels_of,
    widened,
)
from gauss2svg.areas.paint import Paint, Palette
from gauss2svg.areas.regions import Regions, paint_numbers
from gauss2svg.portable import dot, product

PURE = 3  # px; a square of this size whose pixels have one colour is no mixture
UNEXPLAINED = 0.0015  # squared error of a pixel that regions do not explain
LEAST_HAIRLINE = 16  # px; length of a faint line
FAINT = 0.0003  # the same, if a part has it evenly
RIM = 2  # px around a part in which pixels are mixed of its colour and the ground
SAME_COLOR = 6 * LEVEL  # largest difference of a part's colour from a paint that it takes
SIMILAR = 0.2  # largest difference of a rim's first colour from paints that are tried for it
MOST_PARTS = 1000  # because photos have thousands of parts
MOST_COUNTED = 0.02  # largest squared error that counts for a pixel, because outliers do not decide
PRICE = 1e-4  # squared error of a pixel by which a new colour must be better


class Letter(NamedTuple):
    """A thin part.

    at      rows and columns of its pixels and of its rim, without those of the thick region
    near    rows and columns of its pixels and of its rim
    box     of the part
    region  thick region around it
    share   (n,) distance of its pixels from the ground along `way`
    way     (c,) direction of its colour from the ground
    darkest (c,) colour of the pixel that is farthest from the ground
    """

    at: tuple[Ints, Ints]
    near: tuple[Ints, Ints]
    box: Box
    region: int
    share: Floats
    way: Floats
    darkest: Floats


def add_letters(regions: Regions) -> Ints:
    """Give thin parts on one ground one colour. Return the region (h, w) below and beside them.

    The region is -1 at other pixels.
    """
    pixels, labels, paints = regions.pixels, regions.labels, regions.paints
    ground = np.full(labels.shape, -1, np.int32)
    letters = _letters_of(regions)
    flat = [paint for paint in dict.fromkeys(paints) if not paint.is_shaded]
    for line in _lines_of(letters, paints):
        longest = max(line, key=lambda letter: letter.share.max())
        half = 0.5 * longest.share.max()
        # Slivers at the edges of thick parts are no text.
        if sum(np.count_nonzero(letter.share > half) for letter in line) < 8:
            continue
        strong = np.concatenate([pixels[letter.at][letter.share > half] for letter in line])
        same = [p for p in flat if _differences(longest.darkest, p) <= SAME_COLOR]
        # The darkest pixel of thicker strokes may be mixed of another area that they meet.
        if np.mean(_differences(strong, Paint(longest.darkest)) <= SAME_COLOR) < 0.03:
            common = [p for p in flat if np.mean(_differences(strong, p) <= SAME_COLOR) > 0.5]
            same = common or same
        share, most = np.concatenate([letter.share for letter in line]), longest.share.max()
        if not same and np.mean(share[share > half] > 0.97 * most) < 0.1:
            # The strokes are so thin that none of their pixels may be pure.
            base = longest.darkest - most * longest.way
            for p in flat:
                way = p.color - base
                if dot(way, longest.way) > 0.99 * max(np.sqrt(dot(way, way)), most):
                    same.append(p)
        if not same:
            flat.append(Paint(longest.darkest))
            same = flat[-1:]
        paint = min(same, key=lambda p: _differences(longest.darkest, p))
        for letter in line:
            at, region = letter.at, letter.region
            mixture = _mixture(pixels, at, len(paints), paint, region, paints[region])
            labels[at] = np.where(mixture[1][:, 0] > 0.5, len(paints), region)
            regions.mix(at, mixture, np.ones(len(at[0]), bool))
            ground[letter.near] = letter.region
            paints.append(paint)
    return ground


def _differences(colors: Floats, paint: Paint) -> Floats:
    """Return the largest difference of each of the colours (.., c) from a paint."""
    return np.abs(colors - paint.color).max(axis=-1)


def inside_of(cores: Ints, size: int) -> Ints:
    """Return the labels (h, w) of pixels around which a square of `size` px has one, or -1."""
    low, high = ndimage.minimum_filter(cores, size), ndimage.maximum_filter(cores, size)
    return np.where(low == high, low, -1)


def _letters_of(regions: Regions) -> list[Letter]:
    """Return the thin parts of a picture that have one ground and one direction of colours."""
    pixels, cores, paints = regions.pixels, regions.cores, regions.paints
    pure, inside = inside_of(cores, PURE), inside_of(cores, 5)
    # A crossing of lines has squares of this size too, and gaps in it are no letters. So half of
    # the pixels of a ground are in such squares.
    opened = ndimage.maximum_filter(inside, 5)
    thick, whole = (np.bincount(one[one >= 0], minlength=len(paints)) for one in (opened, cores))
    # Mixtures do not look like a gradient.
    is_thick = (thick > 0.5 * whole) | [paint.is_shaded for paint in paints]
    solid = (cores >= 0) & is_thick[cores]
    part, boxes = parts_of((~is_thick[regions.largest] | (regions.error > UNEXPLAINED)) & ~solid)
    letters = []
    for k, tight in enumerate(boxes, 1):
        box = widened(tight, RIM + 1, cores.shape)
        own = part[box] == k
        rim = dilated(own, RIM)
        around = cores[box][rim & solid[box]]
        if np.count_nonzero(own) < 2 or not len(around):
            continue
        counts = np.bincount(around)
        region = int(counts.argmax())
        ground = paints[region]
        if sum(n for k, n in enumerate(counts) if paints[k] is ground) < 0.9 * len(around):
            continue
        ys, xs = pixels_of(rim & ~solid[box], box)
        off = pixels[ys, xs] - ground.at(xs, ys)
        way = (off * np.sqrt((off**2).sum(axis=1, keepdims=True))).sum(axis=0)
        way /= max(np.sqrt(dot(way, way)), 1e-9)
        share = product(off, way)
        rest = ((off - share[:, None] * way) ** 2).sum(axis=1)
        # Pixels that are no mixtures are those of other areas that the part meets.
        strength = np.where(rest <= 0.001, share, 0)
        share = np.minimum(share, strength.max())
        if share.max() < 0.15 or rest.mean() > 1e-3:
            continue  # it is faint, or has pixels that are no mixtures
        darkest = pixels[ys, xs][strength.argmax()].astype(np.float64)
        # Another colour than these two that is pure within the part was not mixed of them.
        names = np.unique(pure[box][own & (pure[box] >= 0)])
        off = [np.abs(paints[name].color - [darkest, ground.color]).max(axis=1) for name in names]
        if all(one.min() <= SAME_COLOR for one in off):
            near = pixels_of(rim, box)
            letters.append(Letter((ys, xs), near, tight, region, share, way, darkest))
    return letters


def _lines_of(letters: list[Letter], paints: list[Paint]) -> list[list[Letter]]:
    """Return the letters in lines of text of one colour."""
    root = np.arange(len(letters))
    for i, one in enumerate(letters):
        for j, other in enumerate(letters[:i]):
            if (
                root[i] != root[j]
                and paints[one.region] is paints[other.region]
                and dot(one.way, other.way) > 0.99
                and _are_beside(one.box, other.box)
            ):
                root[root == root[i]] = root[j]
    return [[letters[k] for k in np.flatnonzero(root == r)] for r in np.unique(root)]


def _are_beside(one: Box, other: Box) -> bool:
    """Return whether two boxes may be letters beside each other, or a letter and its dot."""
    heights = [box[0].stop - box[0].start for box in (one, other)]
    down, across = (
        min(a.stop, b.stop) - max(a.start, b.start) for a, b in zip(one, other, strict=True)
    )
    if across > 0 and down > -3:
        return True
    # They overlap by half of the lower one, and the gap is at most .6 of the higher one.
    return down >= 0.5 * min(heights) and -across <= 0.6 * max(heights)


def add_thin_regions(regions: Regions) -> None:
    """Give parts that nothing explains a colour."""
    palette = Palette.of(regions.paints)
    for _ in range(3):
        before = len(regions.paints)
        _add_parts(regions, palette, UNEXPLAINED)
        if len(regions.paints) == before:
            break
    _add_parts(regions, palette, FAINT)
    _add_hairlines(regions)
    _add_rims(regions, palette)


def _add_hairlines(regions: Regions) -> None:
    """Give long faint lines on one ground the colour that their pixels have.

    They were explained as much thinner lines of a colour that is seen elsewhere. Faint lines are
    more often a pixel wide, as those of grids.
    """
    pixels, paints = regions.pixels, regions.paints
    largest = regions.largest
    flat = [paint for paint in dict.fromkeys(paints) if not paint.is_shaded]
    main = paint_numbers(paints)[largest]
    for box, part, faint in _faint_parts(regions, main, inside_of(main, 3) >= 0, np.s_[1:2]):
        at = pixels_of(part & (faint > 0), box)
        ground = paints[np.bincount(largest[at]).argmax()]
        strength = ((pixels[at] - ground.at(*at[::-1])) ** 2).sum(axis=1)
        color = np.median(pixels[at][strength >= np.percentile(strength, 75)], axis=0)
        others = (paint for paint in flat if paint is not ground)
        same = [paint for paint in others if _differences(color, paint) <= SAME_COLOR]
        paint = min(same or [Paint(color)], key=lambda paint: _differences(color, paint))
        at = pixels_of(part & (regions.cores[box] < 0), box)
        mixture = _mixture(pixels, at, len(paints), paint, largest[at], ground)
        regions.mix(at, mixture, mixture[2] < regions.error[at] + UNEXPLAINED)
        paints.append(paint)


def _add_rims(regions: Regions, palette: Palette) -> None:
    """Give long faint lines between two grounds, as coasts of maps, the colour that explains them.

    Here, a thinner line of another colour is another mixture.
    """
    pixels, paints = regions.pixels, regions.paints
    main, known = paint_numbers(paints)[regions.largest], list(dict.fromkeys(paints))
    for box, part, faint in _faint_parts(regions, main, inside_of(main, 3) < 0, np.s_[1:]):
        inner, name = part & (faint > 0), len(paints)
        strong = inner & (faint >= np.percentile(faint[inner], 75))
        color = np.median(pixels[box][strong], axis=0)
        far = [_differences(color, paint) > SIMILAR for paint in known]
        # Letters that the line meets stay whole.
        met = np.setdiff1d(np.flatnonzero(far), main[box][inner])
        is_free = ~dilated(np.isin(main[box], met)) & (regions.cores[box] < 0)
        at, own = pixels_of(part & is_free, box), np.count_nonzero(inner & is_free)
        if own < 0.5 * len(at[0]) or own < 0.5 * np.count_nonzero(inner):
            continue  # it is a soft edge, or a glow around letters
        similar = [p for p, off in zip(known, far, strict=True) if not (off or p.is_shaded)][:24]
        tried = [
            (paint, *palette.explain(pixels, regions.labels, at, paint.color, name))
            for paint in [Paint(color), *similar]
        ]
        price = PRICE * len(at[0])  # each px of a new colour, the first one, has this price
        costs = [one[3].sum() + price * (k == 0) for k, one in enumerate(tried)]
        paint, label, share, error = tried[int(np.argmin(costs))]
        if error.sum() < 0.5 * regions.error[at].sum():
            is_own = (label == name).any(axis=1) & (error < regions.error[at] + UNEXPLAINED)
            regions.mix(at, (label, share, error), is_own)
            paints.append(paint)


def _faint_parts(
    regions: Regions, main: Ints, where: Bools, slots: slice
) -> Iterator[tuple[Box, Bools, Floats]]:
    """Yield long parts of which each pixel has little of a paint that has most of none nearby.

    Each is a box, which of its pixels are in the part, and the share (h, w) of this paint in them.

    main   (h, w) number of the paint that has most of each pixel
    where  (h, w) pixels that count
    slots  of the paints of a pixel, by falling share
    """
    order = np.argsort(-regions.share, axis=-1, kind="stable")[..., slots]
    label, share = (np.take_along_axis(a, order, -1) for a in (regions.label, regions.share))
    numbers = np.append(paint_numbers(regions.paints), -1)[label]
    # Less than .06 is noise. Lines with .4 and more of their pixels are as wide as they seem.
    is_faint = (share > 0.06) & (share < 0.4) & (where & (regions.cores < 0))[..., None]
    (height, width), around = main.shape, np.pad(main, 2, constant_values=-1)
    for y, x in itertools.product(range(5), repeat=2):
        is_faint &= around[y : y + height, x : x + width, None] != numbers
    faint = share.max(axis=-1, where=is_faint, initial=0)
    part, boxes = parts_of(dilated(faint > 0))
    for q, box in enumerate(boxes, 1):
        if max(side.stop - side.start for side in box) >= LEAST_HAIRLINE:
            yield box, part[box] == q, faint[box]


def _mixture(
    pixels: Floats, at: tuple[Ints, Ints], name: int, paint: Paint, under: Ints | int, ground: Paint
) -> tuple[Ints, Floats, Floats]:
    """Return the labels, shares (n, 3) and errors (n,) of pixels that a paint and a ground mix to.

    name, under  regions of the paint, and of the ground
    """
    way = paint.color - ground.at(*at[::-1])
    off = paint.color - pixels[at]
    share = np.clip(1 - (off * way).sum(axis=1) / (way**2).sum(axis=1), 0, 1)
    label = np.stack(np.broadcast_arrays(name, under, -1, share)[:3], axis=1)
    error = ((off - (1 - share)[:, None] * way) ** 2).sum(axis=1)
    return label, np.stack([share, 1 - share, 0 * share], axis=1), error


def _add_parts(regions: Regions, palette: Palette, least: float) -> None:
    """Give parts whose pixels have squared errors above `least` a colour.

    The strongest part comes first, because its colour may explain the weaker ones.
    """
    pixels, labels, paints = regions.pixels, regions.labels, regions.paints
    part, boxes = parts_of(regions.error > least)
    power = ndimage.sum_labels(regions.error, part, np.arange(1, len(boxes) + 1))
    for q in np.argsort(-power, kind="stable")[:MOST_PARTS]:
        at = pixels_of(part[boxes[q]] == q + 1, boxes[q])
        old = regions.error[at]
        if len(old) < 3 or old.sum() < 0.02:
            continue
        # Faint errors that are even are those of a line in a colour that is nearly a mixture.
        if least < UNEXPLAINED and (len(old) < 16 or old.std() > 0.25 * old.mean()):
            continue
        paint = _paint_of_part(regions, at, old, palette)
        if paint is None:
            continue
        name = len(paints)
        paints.append(paint)
        box = widened(boxes[q], 2, labels.shape)
        grown_part = dilated(part[box] == q + 1) & (regions.cores[box] < 0)
        at = pixels_of(grown_part, box)
        label, share, error = palette.explain(pixels, labels, at, paint.color, name)
        better = (error < regions.error[at] - PRICE) & (label == name).any(axis=1)
        regions.mix(at, (label, share, error), better)


def _paint_of_part(
    regions: Regions, at: tuple[Ints, Ints], error: Floats, palette: Palette
) -> Paint | None:
    """Return the paint that explains the pixels of a part best, or None if it explains little.

    error  (n,) squared error of the pixels without it
    """
    pixels, paints = regions.pixels, regions.paints
    values, count = pixels[at][np.argsort(-error, kind="stable")], len(error)

    def cost(color: Floats) -> float:
        error = palette.explain(pixels, regions.labels, at, color, len(paints))[2]
        return float(np.minimum(error, MOST_COUNTED).sum())

    # The pixels that are explained worst may have the pure colour.
    shares = (values[:n] for n in (1, max(3, count // 20), max(3, count // 8)))
    colors = [np.median(some, axis=0) for some in shares]
    known = list(dict.fromkeys(paint for paint in paints if not paint.is_shaded))
    known.sort(key=lambda paint: np.abs(paint.color - colors[0]).max())
    tried = [(cost(c) + PRICE * count, Paint(c)) for c in colors]
    tried += [(cost(paint.color), paint) for paint in known[:24]]
    most = 0.6 * np.minimum(error, MOST_COUNTED).sum()
    if min(tried, key=itemgetter(0))[0] > most:
        # Where lines of several colours meet, the colour of most pixels may explain more of them.
        _, first, counts = np.unique(np.round(values * 32), True, False, True, axis=0)
        common = values[first[counts.argmax()]]
        tried.append((cost(common) + PRICE * count, Paint(common)))
    least, paint = min(tried, key=itemgetter(0))
    return paint if least <= most else None
