"""Inks: the few colours in which a picture is drawn. A user lists them, or they are chosen here.

On paper, a picture also has the paper's colour where nothing is printed. If the inks overprint, it
has the products of paper and inks too (printed_colors).
"""

from __future__ import annotations

import itertools
import math
import os
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gauss2svg.errors import plain_scalar, quoted, refusal
from gauss2svg.files import reading, text_of
from gauss2svg.options import Field, file_name, hex_of

if TYPE_CHECKING:  # not at run time, because --help needs this module but not NumPy
    import numpy as np
    from numpy.typing import NDArray

    from gauss2svg.scene import Scene

    _Numbers = NDArray[np.float64]

    # The number of inks, or their colours, or the path of a palette file. The command line builds
    # its option from the simpler type below, because it cannot read a sequence.
    Inks = int | str | os.PathLike[str] | Sequence[str]
else:
    Inks = int | str

LEAST_INKS, MOST_INKS = 2, 64
MOST_TONES = 7  # tones of an ink that overprints. Two inks then have 64 mixes
WHITE = "#ffffff"
# The paper of a list of inks is white unless one of them is at most this far from white. The
# distance is that of levels of sRGB in 0..1. A pale cream is .15 away, and a pale skin .3.
NEAR_WHITE = 0.4
PALETTE_SUFFIX = ".gpl"
_ADVICE = '6, or "#f7c306,#c0322c,#17324d"'
# The constants from here on are for the choice of inks (docs/decisions/inks.md).

# k-means groups cells of similar colours. The weight of a cell is w to this power, where w is the
# sum of the weights of the cell's pixels. With a power below 1, small areas count more, so that a
# small red dot gets an ink of its own.
_WEIGHT_POWER = 0.5
# Factor by which differences of hue and chroma count more than differences of lightness. With a
# factor of 1, small areas of strong colour in photos would share an ink with greys.
_CHROMA_FACTOR = 1.6
# The weight of a cell is multiplied by 1 plus this factor times its chroma. Chroma includes
# _CHROMA_FACTOR and is at most about 0.5. Otherwise small areas of strong colour have no ink.
_CHROMA_WEIGHT = 4.0
# With fewer inks than this, the factor is not used. A few inks are needed for light and dark, and
# with three inks a face beside a red hat would be red.
_COLORFUL_INKS = 5
# If there are n inks, fewer than this number, the lightest ink stands for the lightest part of its
# cluster. This part has n / _WIDE_INKS of the cluster's weight. The darkest ink stands for the
# darkest part. The means of whole clusters would be too near to grey, so that teeth were brown.
_WIDE_INKS = 8
_CELL_SIDE = 8  # side of a cell of similar colours, in levels of 255
# A pixel that differs from a neighbour by this value (0..1) has half the weight of a pixel in a
# flat area, because pixels at edges have mixed colours.
_EDGE_DIFFERENCE = 0.05
# If the commonest colour of a cluster makes up at least this share of the cluster, this colour is
# the ink. Otherwise the ink is the colour nearest to the cluster's mean.
_FLAT_SHARE = 0.25
# In a picture whose pixels have at least _FLAT_PICTURE of the largest weight, an ink is left out as
# antialiasing if its pixels have less than _MIXED_WEIGHT of it, and if its colour is within
# _MIXED_ERROR, in levels of 0..1, of a mix of two other inks.
_FLAT_PICTURE, _MIXED_WEIGHT, _MIXED_ERROR = 0.6, 0.1, 0.08
# These factors turn the three levels of a colour into one number, their weighted sum. Such numbers
# are sorted faster than triples of levels.
_CODE = (65536, 256, 1)
# Matrices of Oklab (Ottosson, 2020). The first converts linear sRGB to the responses of cones, and
# the second converts the cube roots of the responses to L, a and b.
_TO_CONES = (
    (0.4122214708, 0.5363325363, 0.0514459929),
    (0.2119034982, 0.6806995451, 0.1073969566),
    (0.0883024619, 0.2817188376, 0.6299787005),
)
_TO_LAB = (
    (0.2104542553, 0.7936177850, -0.0040720468),
    (1.9779984951, -2.4285922050, 0.4505937099),
    (0.0259040371, 0.7827717662, -0.8086757660),
)


def check_inks(name: str, value: Any) -> int | str:
    """Return the number of inks, or their colours as "#rrggbb,#rrggbb,..".

    name   name of the option, which errors show
    value  a number, hex colours in a text or a sequence, or the path of a .gpl file

    Raise InputError if the value is none of these, if the number of inks to choose is not in
    LEAST_INKS..MOST_INKS, if more than MOST_INKS are listed, or if a colour occurs twice.
    """
    value = plain_scalar(value)
    if isinstance(value, str) and value.strip().isdecimal():
        value = int(value)
    if isinstance(value, int) and not isinstance(value, bool):
        return Field(name, int, LEAST_INKS, MOST_INKS).checked(value)
    texts: Any = value.split(",") if isinstance(value, str) else value
    if isinstance(value, os.PathLike) or (
        isinstance(value, str) and value.strip().lower().endswith(PALETTE_SUFFIX)
    ):
        texts = _read_palette(name, file_name(name, value))
    try:
        inks = [hex_of(text) for text in texts]
    except (TypeError, ValueError) as error:
        needed = "colours such as #c0322c or red, a number of them or a .gpl file"
        close = str(error) if isinstance(error, ValueError) else ""
        raise refusal(name, needed, quoted(value), close or _ADVICE) from None
    if not 1 <= len(inks) == len(set(inks)) <= MOST_INKS:
        raise refusal(name, f"1 to {MOST_INKS} different colours", quoted(value), _ADVICE)
    return ",".join(inks)


def ink_colors(inks: str) -> _Numbers:
    """Return the sRGB values (k, 3) in 0..1 of inks listed as "#rrggbb,#rrggbb,.."."""
    import numpy as np

    levels = [list(bytes.fromhex(ink.removeprefix("#"))) for ink in inks.split(",")]
    return np.array(levels, np.float64) / 255


def check_paper(name: str, value: Any) -> str:
    """Return a colour as "#rrggbb". Raise InputError if `value` is not a colour."""
    try:
        return hex_of(value)
    except ValueError as error:
        needed = "a colour such as white, #fa0 or #ffaa00"
        raise refusal(name, needed, quoted(value), str(error)) from None


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
    import numpy as np

    colors = ink_colors(inks)
    if paper is None and (np.square(1 - colors).sum(axis=1) > NEAR_WHITE**2).all():
        paper = WHITE
    count = len(colors)
    if tones is None:
        mixes = {} if paper is None else {paper: (0.0,) * count}
        for k, ink in enumerate(inks.split(",")):
            mixes.setdefault(ink, tuple(float(k == j) for j in range(count)))
        return mixes
    mixes, ground = {}, ink_colors(paper or WHITE)[0]
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
    import numpy as np

    from gauss2svg import portable
    from gauss2svg.without_scipy import nearest_entry, weighted_means

    if paper is not None:  # one ink more is chosen, and the one nearest to the paper left out
        names = inks_of(pixels, inks + 1).split(",")
        apart = np.square(oklab(ink_colors(",".join(names))) - oklab(ink_colors(paper)))
        del names[int(apart.sum(axis=1).argmin())]
        return ",".join(names)
    colors, counts, pixel_counts = _colors(pixels)
    if inks > len(colors):
        needed = f"at most {len(colors)}, the number of colours in the picture"
        raise refusal("inks", needed, str(inks))
    points = oklab(colors / 255)
    points *= [1, _CHROMA_FACTOR, _CHROMA_FACTOR]
    cell = np.unique(colors // _CELL_SIDE @ _CODE, return_inverse=True)[1]
    if cell.max() + 1 < 4 * inks:  # the cells are too coarse
        cell = np.arange(len(colors))
    cell_counts = np.bincount(cell, counts)
    cells = weighted_means(points, counts, cell, np.zeros((len(cell_counts), 3)))
    weight = portable.power(cell_counts, _WEIGHT_POWER)
    if inks >= _COLORFUL_INKS:
        weight *= 1 + _CHROMA_WEIGHT * portable.hypot(*cells.T[1:])
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
    if 2 < inks < _WIDE_INKS:
        # The lightest ink becomes the mean of the lightest part of its cluster. The darkest ink
        # becomes the mean of the darkest part.
        by_lightness = sorted(set(cluster.tolist()), key=lambda k: centers[k, 0])
        for sign, k in ((1, by_lightness[0]), (-1, by_lightness[-1])):
            members = np.flatnonzero(cluster == k)
            members = members[np.argsort(sign * cells[members, 0], kind="stable")]
            total = np.cumsum(weight[members])
            part = members[: 1 + np.searchsorted(total, total[-1] * inks / _WIDE_INKS)]
            centers[k] = np.average(cells[part], axis=0, weights=weight[part])
    entry = cluster[cell]
    chosen: list[tuple[float, NDArray[np.uint8]]] = []  # the weight of each ink's pixels
    for k in np.unique(entry):
        members = np.flatnonzero(entry == k)
        share = counts[members] / counts[members].sum()
        at = members[share.argmax()]
        if share.max() < _FLAT_SHARE:  # take the colour nearest to the cluster's mean
            at = members[np.square(points[members] - centers[k]).sum(axis=1).argmin()]
        chosen.append((counts[members].sum() / pixel_counts[members].sum(), colors[at]))
    if counts.sum() >= _FLAT_PICTURE * pixel_counts.sum():
        chosen = _without_mixes(chosen)
    by_light = sorted((-float(oklab(color / 255)[0]), ink_name(color / 255)) for _, color in chosen)
    return ",".join(name for _, name in by_light)


def _without_mixes(
    inks: list[tuple[float, NDArray[np.uint8]]],
) -> list[tuple[float, NDArray[np.uint8]]]:
    """Return inks (weight of a pixel, levels of 255) without the colours of antialiasing."""
    import numpy as np

    from gauss2svg import portable

    for one in sorted(inks, key=lambda ink: ink[0]):
        others = [ink[1] / 255 for ink in inks if ink is not one]
        for first, last in itertools.combinations(others, 2):
            along, offset = last - first, one[1] / 255 - first
            share = portable.dot(offset, along) / max(portable.dot(along, along), 1e-9)
            share = min(max(share, 0.0), 1.0)
            is_mix = float(np.square(offset - share * along).sum()) < _MIXED_ERROR**2
            if one[0] < _MIXED_WEIGHT and is_mix:
                inks = [ink for ink in inks if ink is not one]
                break
    return inks


def oklab(colors: NDArray[np.floating]) -> _Numbers:
    """Return L, a and b (.., 3) of sRGB colours (.., 3) in 0..1."""
    import numpy as np

    from gauss2svg import portable
    from gauss2svg.photo.pixels import linear_light

    cones = portable.product(linear_light(colors), np.transpose(_TO_CONES))
    return portable.product(portable.cbrt(cones), np.transpose(_TO_LAB))


def _colors(pixels: NDArray[np.floating]) -> tuple[NDArray[np.uint8], _Numbers, _Numbers]:
    """Return the distinct colours (n, 3) of a picture in levels of 255, and two arrays (n,).

    These are the weights of the colours, and the numbers of the pixels that have them. Pixels with
    an alpha below 0.5 are ignored. The weight of a colour is the sum of the weights of its pixels.
    The weight of a pixel is 1, or less if a neighbouring pixel has another colour.
    """
    import numpy as np

    steps = np.zeros(pixels.shape[:2])
    for axis in (0, 1):
        step = np.abs(np.diff(pixels, axis=axis)).max(axis=2)
        for before, after in ((0, 1), (1, 0)):
            beside = np.pad(step, [(before, after) if a == axis else (0, 0) for a in (0, 1)])
            np.maximum(steps, beside, out=steps)
    # If a picture has far more pixels than 250 000, only about this many of them are read. The
    # stride is raised until it has no common divisor with the width. Otherwise pixels of some
    # columns would never be read.
    stride = max(1, steps.size // 250_000)
    while math.gcd(stride, pixels.shape[1]) > 1:
        stride += 1
    every = slice(None, None, stride)
    flat = pixels.reshape(-1, pixels.shape[2])[every]
    share = 1 / (1 + np.square(steps.ravel()[every] / _EDGE_DIFFERENCE))
    if flat.shape[1] > 3:
        visible = flat[:, 3] >= 0.5
        flat, share = flat[visible, :3], share[visible]
    levels = np.round(flat * 255).astype(np.uint8)
    _, first, inverse = np.unique(levels @ _CODE, return_index=True, return_inverse=True)
    weights = np.bincount(inverse, share).astype(np.float64)
    return levels[first], weights, np.bincount(inverse).astype(np.float64)


def _read_palette(name: str, path: str) -> list[str]:
    """Return the distinct colours of a palette file of GIMP or Inkscape, each as six hex digits."""
    most_bytes, head = 1_000_000, "GIMP Palette"
    with reading(path, "a palette file") as file:
        content = file.read(most_bytes + 1)
    text = text_of(content, path, "replace")  # names of colours may be in any encoding
    if len(content) > most_bytes or not text.lstrip().startswith(head):
        needed = f"a file of at most {most_bytes:,} bytes that begins with {head}"
        raise refusal(name, needed, quoted(path), _ADVICE)
    colors: dict[str, None] = {}
    lines = re.split(r"\r\n?|\n", text)
    # Lines that GIMP and Inkscape skip: comments, and header fields such as Name and Columns.
    # Palettes of Aseprite with the field Channels have alpha as a fourth level.
    skipped = rf"\s*(#.*|[A-Za-z]+:.*|{head}.*)?"
    if any(re.fullmatch(r"\s*Channels:\s*RGBA\s*", line) for line in lines):
        skipped += r"|\s*[0-9]+\s+[0-9]+\s+[0-9]+\s+0+(?:\s.*)?"
    for number, line in enumerate(lines, 1):
        if re.fullmatch(skipped, line):
            continue
        match = re.fullmatch(r"\s*([0-9]{1,9})\s+([0-9]{1,9})\s+([0-9]{1,9})(?:\s.*)?", line)
        levels = [int(level) for level in match.groups()] if match else [256]
        if max(levels) > 255:
            got = quoted(f"line {number}, {line}")
            raise refusal(name, "three levels of 0 to 255 a line", got, _ADVICE)
        colors[bytes(levels).hex()] = None
    return list(colors)


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
