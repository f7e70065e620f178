"""Inks: a few colours of which a picture is made, given by texts or a palette file, or chosen."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gauss2svg.errors import plain_scalar, quoted, refusal
from gauss2svg.files import reading
from gauss2svg.options import Field, file_name

if TYPE_CHECKING:  # the help does not need it
    import numpy as np
    from numpy.typing import NDArray

    _Numbers = NDArray[np.float64]

    # A number, or colours and palette files; the command line takes no sequences.
    Inks = int | str | os.PathLike[str] | Sequence[str]
else:
    Inks = int | str

LEAST_INKS, MOST_INKS = 2, 64
PALETTE_SUFFIX = ".gpl"
_ADVICE = '6, or "#f7c306,#c0322c,#17324d"'
_HEX = re.compile(r"\s*#?([0-9a-f]{3}|[0-9a-f]{6})\s*", re.IGNORECASE)
_PALETTE_HEAD = "GIMP Palette"
_MOST_PALETTE_BYTES = 1_000_000
# What GIMP and Inkscape skip: comments, and fields of the head such as Name and Columns.
_NO_COLOR = re.compile(r"\s*(#.*|[A-Za-z]+:.*)?")
_LEVELS = re.compile(r"\s*([0-9]{1,9})\s+([0-9]{1,9})\s+([0-9]{1,9})(?:\s.*)?")
# Colours that are nearly alike count by this power of their pixels: a small red dot is to have its
# ink (docs/decisions/inks.md, also for the others).
_BY_PIXELS = 0.5
# Hue and chroma count so much more than lightness, or accents of photos share an ink with greys.
_CHROMA = 1.6
_ALIKE = 8  # levels of 255, the side of a cell of such colours
_CELLS_EACH = 4  # for each ink; of fewer cells each colour is one
# Difference from a neighbour at which a pixel counts half: edges mix what lies beside them.
_AT_AN_EDGE = 0.05
_LLOYD = 30  # iterations of k-means
_FLAT = 0.25  # share of a cluster's pixels that are of one colour, which is then the ink
_LOOKED_AT = 250_000  # pixels at most
_CODE = (65536, 256, 1)  # a colour as one number, which sorts faster than three do
# Oklab (Ottosson, 2020): from linear sRGB to cones, and from their cube roots to L, a, b.
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
    """Return a number of inks, or their colours as #rrggbb between commas; raise InputError.

    value  a number, colours as hex digits in a sequence or a text, or the path of a .gpl file
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
        texts = _of_palette_file(name, file_name(name, value))
    try:
        digits = [_HEX.fullmatch(text)[1].lower() for text in texts]  # pyright: ignore[reportOptionalSubscript] (TypeError)
    except TypeError:
        raise refusal(
            name, "colours such as #c0322c, a number of them or a .gpl file", quoted(value), _ADVICE
        ) from None
    inks = ["#" + (d if len(d) == 6 else "".join(2 * digit for digit in d)) for d in digits]
    if not LEAST_INKS <= len(inks) == len(set(inks)) <= MOST_INKS:
        raise refusal(
            name, f"{LEAST_INKS} to {MOST_INKS} different colours", quoted(value), _ADVICE
        )
    return ",".join(inks)


def ink_colors(inks: str) -> _Numbers:
    """Return (k, 3) sRGB in 0..1 of inks as `check_inks` and `inks_of` have them."""
    import numpy as np

    levels = [list(bytes.fromhex(ink.removeprefix("#"))) for ink in inks.split(",")]
    return np.array(levels, np.float64) / 255


def inks_of(pixels: NDArray[np.floating], inks: int | str) -> str:
    """Return inks as colours, lightest first, and choose them for a picture if given a number.

    pixels  (h, w, 3) or (h, w, 4) in 0..1
    Inks are chosen by k-means in Oklab with hue and chroma weighted. A colour that makes up much of
    its cluster is itself the ink, so that flat drawings keep theirs.
    Raises InputError for more inks than the picture has colours.
    """
    if isinstance(inks, str):
        return inks
    import numpy as np

    from gauss2svg.scene.nearest import nearest_entry

    colors, counts = _colors(pixels)
    if inks > len(colors):
        needed = f"at most {len(colors)}, the number of colours in the picture"
        raise refusal("inks", needed, str(inks))
    color = colors / 255
    linear = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    points = np.cbrt(linear @ np.transpose(_TO_CONES)) @ np.transpose(_TO_LAB)
    points *= [1, _CHROMA, _CHROMA]
    cell = np.unique(colors // _ALIKE @ _CODE, return_inverse=True)[1]
    if cell.max() + 1 < _CELLS_EACH * inks:
        cell = np.arange(len(colors))
    whole = np.bincount(cell, counts)
    cells = _means(points, counts, cell, np.zeros((len(whole), 3)))
    weight = np.asarray(whole**_BY_PIXELS, np.float64)
    first = [int(weight.argmax())]  # then the point that lies farthest from those before, by weight
    apart = np.square(cells - cells[first[0]]).sum(axis=1)
    while len(first) < inks:
        first.append(int((weight * apart).argmax()))
        apart = np.minimum(apart, np.square(cells - cells[first[-1]]).sum(axis=1))
    centers = cells[first]
    for _ in range(_LLOYD):
        centers = _means(cells, weight, nearest_entry(centers, cells)[1], centers)
    entry = nearest_entry(centers, cells)[1][cell]
    chosen: list[tuple[float, str]] = []
    for k in np.unique(entry):
        of_it = np.flatnonzero(entry == k)
        share = counts[of_it] / counts[of_it].sum()
        at = of_it[share.argmax()]
        if share.max() < _FLAT:  # the colour that is nearest to the mean
            at = of_it[np.square(points[of_it] - centers[k]).sum(axis=1).argmin()]
        chosen.append((-float(points[at, 0]), "#" + bytes(colors[at].tolist()).hex()))
    return ",".join(ink for _, ink in sorted(chosen))


def _colors(pixels: NDArray[np.floating]) -> tuple[NDArray[np.uint8], _Numbers]:
    """Return distinct colours (n, 3) in levels of the visible pixels, and the weights (n,) of each.

    The weight of a pixel is 1, and less where its neighbours are of other colours.
    """
    import numpy as np

    steps = np.zeros(pixels.shape[:2])
    for axis in (0, 1):
        step = np.abs(np.diff(pixels, axis=axis)).max(axis=2)
        for before, after in ((0, 1), (1, 0)):
            beside = np.pad(step, [(before, after) if a == axis else (0, 0) for a in (0, 1)])
            np.maximum(steps, beside, out=steps)
    stride = max(1, steps.size // _LOOKED_AT)
    while math.gcd(stride, pixels.shape[1]) > 1:  # else some columns are never seen
        stride += 1
    every = slice(None, None, stride)
    flat = pixels.reshape(-1, pixels.shape[2])[every]
    share = 1 / (1 + np.square(steps.ravel()[every] / _AT_AN_EDGE))
    if flat.shape[1] > 3:
        seen = flat[:, 3] >= 0.5
        flat, share = flat[seen, :3], share[seen]
    levels = np.round(flat * 255).astype(np.uint8)
    _, first, which = np.unique(levels @ _CODE, return_index=True, return_inverse=True)
    return levels[first], np.bincount(which, share).astype(np.float64)


def _means(points: _Numbers, weight: _Numbers, entry: Any, others: _Numbers) -> _Numbers:
    """Return (k, 3) weighted means of the points of each entry, or `others` where it has none."""
    import numpy as np

    mass = np.bincount(entry, weight, len(others))
    sums = [np.bincount(entry, weight * column, len(others)) for column in points.T]
    means = np.stack(sums, axis=1) / np.maximum(mass, 1e-12)[:, None]
    return np.where(mass[:, None] > 0, means, others)


def _of_palette_file(name: str, path: str) -> list[str]:
    """Return the colours of a palette file of GIMP and Inkscape, each once."""
    with reading(path, "a palette file") as file:
        content = file.read(_MOST_PALETTE_BYTES + 1)
    head, *lines = re.split(r"\r\n?|\n", content.decode("utf-8-sig", "replace"))
    if len(content) > _MOST_PALETTE_BYTES or not head.startswith(_PALETTE_HEAD):
        needed = f"a file of at most {_MOST_PALETTE_BYTES:,} bytes that begins with {_PALETTE_HEAD}"
        raise refusal(name, needed, quoted(path), _ADVICE)
    colors: dict[str, None] = {}
    for number, line in enumerate(lines, 2):
        match = _LEVELS.fullmatch(line)
        levels = [int(level) for level in match.groups()] if match else [256]
        if max(levels) <= 255:
            colors[bytes(levels).hex()] = None
        elif not _NO_COLOR.fullmatch(line):
            got = quoted(f"line {number}, {line}")
            raise refusal(name, "three levels of 0 to 255 a line", got, _ADVICE)
    return list(colors)
