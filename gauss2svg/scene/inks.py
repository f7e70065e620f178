"""Inks: the few colours in which a picture is drawn. A user lists them, or they are chosen here.

gauss2svg.scene.ink_lists reads the lists of users.

On paper, a picture also has the paper's colour where nothing is printed. If the inks overprint, it
has the products of paper and inks too (printed_colors).
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.errors import refusal
from gauss2svg.photo.pixels import linear_light
from gauss2svg.scene import Scene
from gauss2svg.without_scipy import nearest_entry, weighted_means

_Numbers = NDArray[np.float64]
# These factors turn the three levels of a colour into one number, their weighted sum. Such numbers
# are sorted faster than triples of levels.
_CODE = (65536, 256, 1)


def ink_colors(inks: str) -> _Numbers:
    """Return the sRGB values (k, 3) in 0..1 of inks listed as "#rrggbb,#rrggbb,.."."""
    levels = [list(bytes.fromhex(ink.removeprefix("#"))) for ink in inks.split(",")]
    return np.array(levels, np.float64) / 255


def printed_colors(
    inks: str, paper: str | None = None, tones: int | None = None
) -> dict[str, tuple[float, ...]]:
    """Return the colours "#rrggbb" of inks on paper, each with the strength 0..1 of every ink.

    inks   "#rrggbb,#rrggbb,.."
    paper  colour where no ink is printed, which is the first of the colours. If it is None and no
           ink is near white, the paper is white. If an ink is, this ink is the paper, and is
           printed
    tones  None: each ink hides what is below it. A number: inks overprint in so many strengths

    An ink of strength s lets through 1 - s (1 - ink) of each channel. Among inks that overprint,
    a colour is the product of these and the paper. If several mixes have the same colour, the one
    of least strength is taken.
    """
    colors = ink_colors(inks)
    # In sRGB, a pale cream is .15 away from white, and a pale skin .3.
    if paper is None and (np.square(1 - colors).sum(axis=1) > 0.4**2).all():
        paper = "#ffffff"
    count = len(colors)
    if tones is None:
        mixes = {} if paper is None else {paper: (0.0,) * count}
        for k, ink in enumerate(inks.split(",")):
            mixes.setdefault(ink, tuple(float(k == j) for j in range(count)))
        return mixes
    mixes, ground = {}, ink_colors(paper or "#ffffff")[0]
    steps = itertools.product(range(tones + 1), repeat=count)
    for step in sorted(steps, key=lambda step: (sum(step), step)):
        strength = np.array(step)[:, None] / tones
        name = ink_name(ground * (1 - strength * (1 - colors)).prod(axis=0))
        mixes.setdefault(name, tuple(strength[:, 0].tolist()))
    return mixes


def ink_name(ink: _Numbers) -> str:
    """Return an ink (3,) with values in 0..1 as a text #rrggbb."""
    return "#" + bytes(round(255 * level) for level in ink.tolist()).hex()


def inks_of_scene(scene: Scene) -> _Numbers:
    """Return Scene.inks. Raise InputError if it is None."""
    if scene.inks is None:
        rule = "of opaque plain ellipses and areas alone"
        raise refusal("the scene", rule, "others", "a fit with inks")
    return scene.inks


def inks_of(pixels: NDArray[np.floating], inks: int | str, paper: str | None = None) -> str:
    """Return `inks` if it is a list of colours. If it is a number, choose inks for the picture.

    pixels  (h, w, 3) or (h, w, 4) in 0..1
    paper   colour for which the chosen inks need none. None: the paper is one of the inks

    The chosen inks are colours of the picture, and are returned as "#rrggbb,#rrggbb,..", from light
    to dark. Each ink stands for a cluster of k-means in Oklab, where hue and chroma have more
    weight than lightness. If the commonest colour of a cluster makes up much of it, this colour is
    the ink, so that flat drawings keep their colours. Else the ink is the colour nearest to the
    cluster's mean. Of 3 to 7 inks, the lightest one stands for the lightest part of its cluster,
    and the darkest one for the darkest part. In a flat drawing there may be fewer inks, because
    colours of antialiasing are none. Raise InputError if the picture has fewer colours than
    `inks`.
    """
    if isinstance(inks, str):
        return inks
    if paper is not None:  # one ink more is chosen, and the one nearest to the paper left out
        names = inks_of(pixels, inks + 1).split(",")
        apart = np.square(oklab(ink_colors(",".join(names))) - oklab(ink_colors(paper)))
        del names[int(apart.sum(axis=1).argmin())]
        return ",".join(names)
    colors, counts, pixel_counts = _colors(pixels)
    if inks > len(colors):
        needed = f"at most {len(colors)}, the number of colours in the picture"
        raise refusal("inks", needed, str(inks))
    # Without the factor on hue and chroma, small areas of strong colour would share an ink with
    # greys. docs/decisions/inks.md has this number and the next ones.
    points = oklab(colors / 255) * [1, 1.6, 1.6]
    cell = np.unique(colors // 8 @ _CODE, return_inverse=True)[1]
    if cell.max() + 1 < 4 * inks:  # the cells are too coarse
        cell = np.arange(len(colors))
    cell_counts = np.bincount(cell, counts)
    cells = weighted_means(points, counts, cell, np.zeros((len(cell_counts), 3)))
    # By the square root, small areas count more, so that a small red dot gets an ink of its own.
    # So do areas of strong colour. But a few inks are needed for light and dark: with three, a face
    # beside a red hat would be red.
    weight = np.sqrt(cell_counts)
    if inks >= 5:
        weight *= 1 + 4 * portable.hypot(*cells.T[1:])
    # The first seed is the cell of largest weight. Each later seed is the cell whose weight, times
    # the squared distance to the nearest seed so far, is largest.
    seeds = [int(weight.argmax())]
    squares = np.square(cells - cells[seeds[0]]).sum(axis=1)
    while len(seeds) < inks:
        seeds.append(int((weight * squares).argmax()))
        squares = np.minimum(squares, np.square(cells - cells[seeds[-1]]).sum(axis=1))
    centers = cells[seeds]
    for _ in range(30):
        centers = weighted_means(cells, weight, nearest_entry(centers, cells)[1], centers)
    cluster = nearest_entry(centers, cells)[1]
    if 2 < inks < 8:
        # The lightest ink becomes the mean of the lightest part of its cluster. The darkest ink
        # becomes the mean of the darkest part. The means of whole clusters would be too near to
        # grey, so that teeth were brown.
        by_lightness = sorted(set(cluster.tolist()), key=lambda k: centers[k, 0])
        for sign, k in ((1, by_lightness[0]), (-1, by_lightness[-1])):
            members = np.flatnonzero(cluster == k)
            members = members[np.argsort(sign * cells[members, 0], kind="stable")]
            total = np.cumsum(weight[members])
            part = members[: 1 + np.searchsorted(total, total[-1] * inks / 8)]
            centers[k] = np.average(cells[part], axis=0, weights=weight[part])
    entry = cluster[cell]
    chosen: list[tuple[float, NDArray[np.uint8]]] = []  # the weight of each ink's pixels
    for k in np.unique(entry):
        members = np.flatnonzero(entry == k)
        share = counts[members] / counts[members].sum()
        at = members[share.argmax()]
        if share.max() < 0.25:  # take the colour nearest to the cluster's mean
            at = members[np.square(points[members] - centers[k]).sum(axis=1).argmin()]
        chosen.append((counts[members].sum() / pixel_counts[members].sum(), colors[at]))
    if counts.sum() >= 0.6 * pixel_counts.sum():  # the picture is flat
        chosen = _without_mixes(chosen)
    by_light = sorted((-float(oklab(color / 255)[0]), ink_name(color / 255)) for _, color in chosen)
    return ",".join(name for _, name in by_light)


def _without_mixes(
    inks: list[tuple[float, NDArray[np.uint8]]],
) -> list[tuple[float, NDArray[np.uint8]]]:
    """Return inks (weight of a pixel, levels of 255) without the colours of antialiasing.

    These have pixels of little weight, and are near a mix of two other inks.
    """
    for one in sorted(inks, key=lambda ink: ink[0]):
        others = [ink[1] / 255 for ink in inks if ink is not one]
        for first, last in itertools.combinations(others, 2):
            along, offset = last - first, one[1] / 255 - first
            share = portable.dot(offset, along) / max(portable.dot(along, along), 1e-9)
            share = min(max(share, 0.0), 1.0)
            is_mix = float(np.square(offset - share * along).sum()) < 0.08**2
            if one[0] < 0.1 and is_mix:
                inks = [ink for ink in inks if ink is not one]
                break
    return inks


def oklab(colors: NDArray[np.floating]) -> _Numbers:
    """Return L, a and b (.., 3) of sRGB colours (.., 3) in 0..1, by Oklab (Ottosson, 2020)."""
    # From linear sRGB to the responses of cones, and from their cube roots to L, a and b.
    to_cones = (
        (0.4122214708, 0.5363325363, 0.0514459929),
        (0.2119034982, 0.6806995451, 0.1073969566),
        (0.0883024619, 0.2817188376, 0.6299787005),
    )
    to_lab = (
        (0.2104542553, 0.7936177850, -0.0040720468),
        (1.9779984951, -2.4285922050, 0.4505937099),
        (0.0259040371, 0.7827717662, -0.8086757660),
    )
    cones = portable.product(linear_light(colors), np.transpose(to_cones))
    return portable.product(portable.cbrt(cones), np.transpose(to_lab))


def _colors(pixels: NDArray[np.floating]) -> tuple[NDArray[np.uint8], _Numbers, _Numbers]:
    """Return the distinct colours (n, 3) of a picture in levels of 255, and two arrays (n,).

    These are the weights of the colours, and the numbers of the pixels that have them. Pixels with
    an alpha below 0.5 are ignored. The weight of a colour is the sum of the weights of its pixels.
    The weight of a pixel is 1, or less if a neighbouring pixel has another colour.
    """
    steps = np.zeros(pixels.shape[:2])
    for axis in (0, 1):
        step = np.moveaxis(np.abs(np.diff(pixels, axis=axis)).max(axis=2), axis, 0)
        turned = np.moveaxis(steps, axis, 0)
        for beside in (turned[1:], turned[:-1]):
            np.maximum(beside, step, out=beside)
    # If a picture has far more pixels than 250 000, only about this many of them are read. The
    # stride is raised until it has no common divisor with the width. Otherwise pixels of some
    # columns would never be read.
    stride = max(1, steps.size // 250_000)
    while math.gcd(stride, pixels.shape[1]) > 1:
        stride += 1
    every = slice(None, None, stride)
    flat = pixels.reshape(-1, pixels.shape[2])[every]
    share = 1 / (1 + np.square(steps.ravel()[every] / 0.05))  # edges have mixed colours
    if flat.shape[1] > 3:
        visible = flat[:, 3] >= 0.5
        flat, share = flat[visible, :3], share[visible]
    levels = np.round(flat * 255).astype(np.uint8)
    _, first, inverse = np.unique(levels @ _CODE, return_index=True, return_inverse=True)
    weights = np.bincount(inverse, share).astype(np.float64)
    return levels[first], weights, np.bincount(inverse).astype(np.float64)


def inks_in(
    scene: Scene, inks: str, paper: str | None = None, tones: int | None = None
) -> dict[str, dict[str, float]]:
    """Return the inks that a scene needs, each with its strength in every colour of the scene.

    inks, paper, tones  as in printed_colors. The colours of the scene are among theirs
    """
    used = {ink_name(ink) for ink in inks_of_scene(scene)}
    colors = printed_colors(inks, paper, tones)
    strengths = {
        ink: {color: strength[k] for color, strength in colors.items() if color in used}
        for k, ink in enumerate(inks.split(","))
    }
    return {ink: tones for ink, tones in strengths.items() if any(tones.values())}
