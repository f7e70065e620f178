"""Inks: a few colours of which a picture is made, given by texts or a palette file, or chosen."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from gauss2svg.errors import InputError, brief, plain_scalar, quoted
from gauss2svg.files import reading
from gauss2svg.options import file_name

if TYPE_CHECKING:  # the help does not need it
    import numpy as np
    from numpy.typing import NDArray

LEAST_INKS, MOST_INKS = 2, 64
_HEX = re.compile(r"#?([0-9a-f]{3}|[0-9a-f]{6})", re.IGNORECASE)
_COUNT = re.compile("[0-9]{1,9}")
PALETTE_SUFFIX = ".gpl"
_PALETTE_HEAD = "GIMP Palette"
# What GIMP and Inkscape skip: comments, and fields of the head such as Name and Columns.
_NO_COLOR = re.compile(r"\s*(#.*|[A-Za-z]+:.*)?")
_LEVELS = re.compile(r"\s*([0-9]{1,9})\s+([0-9]{1,9})\s+([0-9]{1,9})(\s.*)?")
_MOST_PALETTE_BYTES = 1_000_000
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

# A number, or colours and palette files; the command line takes no sequences.
if TYPE_CHECKING:
    Inks = int | str | os.PathLike[str] | Sequence[str]
else:
    Inks = int | str


def check_inks(name: str, value: Any) -> int | str:
    """A number of inks, or their colours as #rrggbb between commas; raises InputError.

    value  a number, colours as hex digits in a sequence or a text, or the path of a .gpl file
    """
    value = plain_scalar(value)
    if isinstance(value, str) and _COUNT.fullmatch(value.strip()):
        value = int(value)
    if isinstance(value, int) and not isinstance(value, bool):
        if not LEAST_INKS <= value <= MOST_INKS:
            raise _bad(name, f"a number from {LEAST_INKS} to {MOST_INKS}, or colours", value)
        return value
    if isinstance(value, os.PathLike) or (
        isinstance(value, str) and value.strip().lower().endswith(PALETTE_SUFFIX)
    ):
        value = _of_palette_file(name, file_name(name, value))
    texts = value.split(",") if isinstance(value, str) else value
    if not isinstance(texts, (list, tuple)) or not all(isinstance(t, str) for t in texts):
        raise _bad(name, "colours, a number of them or a .gpl file", value)
    inks = [_hex(name, text.strip()) for text in texts]
    for at, ink in enumerate(inks):
        if ink in inks[:at]:
            raise _bad(name, "different colours", f"{ink} twice")
    if not LEAST_INKS <= len(inks) <= MOST_INKS:
        got = inks[0] if len(inks) == 1 else len(inks)
        raise _bad(name, f"{LEAST_INKS} to {MOST_INKS} colours", got)
    return ",".join(inks)


def ink_colors(inks: str) -> NDArray[np.float64]:
    """(k, 3) sRGB in 0..1 of inks as `check_inks` and `inks_of` have them."""
    import numpy as np

    levels = [list(bytes.fromhex(ink.removeprefix("#"))) for ink in inks.split(",")]
    return np.array(levels, np.float64) / 255


def inks_of(pixels: NDArray[np.floating], inks: int | str) -> str:
    """The inks as colours: a number of them is chosen for pixels (h, w, 3) or (h, w, 4) in 0..1.

    By k-means in Oklab (Ottosson, 2020) with hue and chroma weighted, lightest first. A
    colour that makes up much of its cluster is itself the ink, so that flat drawings keep theirs.
    Raises InputError for more inks than the picture has colours.
    """
    if isinstance(inks, str):
        return inks
    import numpy as np

    from gauss2svg.scene.nearest import nearest_entry

    colors, counts = _colors(pixels)
    if inks > len(colors):
        most = len(colors)
        instead = f"Try {most}" if most >= LEAST_INKS else "Try it without inks"
        raise InputError(f"inks must be at most {most}, the colours seen; got {inks}. {instead}")
    points = _oklab(colors / 255) * [1, _CHROMA, _CHROMA]
    cell = np.unique(_codes(colors // _ALIKE), return_inverse=True)[1]
    if cell.max() + 1 < _CELLS_EACH * inks:
        cell = np.arange(len(colors))
    whole = np.bincount(cell, counts)
    cells = _means(points, counts, cell, np.zeros((len(whole), 3)))
    weight = np.asarray(whole**_BY_PIXELS, np.float64)
    centers = _spread(cells, weight, inks)
    for _ in range(_LLOYD):
        centers = _means(cells, weight, nearest_entry(centers, cells)[1], centers)
    entry = nearest_entry(centers, cells)[1][cell]
    found: list[tuple[float, str]] = []
    for k in range(inks):
        of_it = np.flatnonzero(entry == k)
        if not len(of_it):
            continue
        share = counts[of_it] / counts[of_it].sum()
        # The colour of the file that is nearest to the mean where none is that of a flat area.
        at = of_it[share.argmax()]
        if share.max() < _FLAT:
            at = of_it[np.square(points[of_it] - centers[k]).sum(axis=1).argmin()]
        found.append((-float(points[at, 0]), "#" + bytes(colors[at].tolist()).hex()))
    return ",".join(ink for _, ink in sorted(found))


def _colors(pixels: NDArray[np.floating]) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """Distinct colours (n, 3) in levels of the visible pixels, and how much (n,) of each.

    A pixel counts 1, and less where its neighbours are of other colours.
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
    _, first, which = np.unique(_codes(levels), return_index=True, return_inverse=True)
    return levels[first], np.bincount(which, share).astype(np.float64)


def _codes(levels: NDArray[np.uint8]) -> NDArray[np.int64]:
    """(n,) a number for each colour (n, 3), which sorts faster than three do."""
    return levels @ [65536, 256, 1]


def _means(
    points: NDArray[np.float64],
    weight: NDArray[np.float64],
    entry: NDArray[np.intp],
    others: NDArray[np.float64],
) -> NDArray[np.float64]:
    """(k, 3) weighted means of the points of each entry; of one without points that of others."""
    import numpy as np

    mass = np.bincount(entry, weight, len(others))
    sums = [np.bincount(entry, weight * column, len(others)) for column in points.T]
    means = np.stack(sums, axis=1) / np.maximum(mass, 1e-12)[:, None]
    return np.where(mass[:, None] > 0, means, others)


def _spread(
    points: NDArray[np.float64], weight: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    """(count, 3) of the points, each the one that lies farthest from those before, by weight."""
    import numpy as np

    at = [int(weight.argmax())]
    left = np.square(points - points[at[0]]).sum(axis=1)
    while len(at) < count:
        at.append(int((weight * left).argmax()))
        left = np.minimum(left, np.square(points - points[at[-1]]).sum(axis=1))
    return points[at]


def _oklab(color: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) L, a, b of Oklab for sRGB (n, 3) in 0..1 (Ottosson, 2020)."""
    import numpy as np

    linear = np.where(color <= 0.04045, color / 12.92, ((color + 0.055) / 1.055) ** 2.4)
    to_cones = np.array(
        [
            [0.4122214708, 0.5363325363, 0.0514459929],
            [0.2119034982, 0.6806995451, 0.1073969566],
            [0.0883024619, 0.2817188376, 0.6299787005],
        ]
    )
    to_lab = np.array(
        [
            [0.2104542553, 0.7936177850, -0.0040720468],
            [1.9779984951, -2.4285922050, 0.4505937099],
            [0.0259040371, 0.7827717662, -0.8086757660],
        ]
    )
    return np.cbrt(linear @ to_cones.T) @ to_lab.T


def _of_palette_file(name: str, path: str) -> list[str]:
    """Colours of a palette file of GIMP and Inkscape, each once."""
    with reading(path, "a palette file") as file:
        content = file.read(_MOST_PALETTE_BYTES + 1)
    if len(content) > _MOST_PALETTE_BYTES:
        raise _bad(name, f"a file of at most {_MOST_PALETTE_BYTES:,} bytes", path)
    head, *lines = re.split(r"\r\n?|\n", content.decode("utf-8-sig", "replace"))
    if not head.startswith(_PALETTE_HEAD):
        raise _bad(name, f"a file that begins with {_PALETTE_HEAD!r}", head)
    found: dict[str, None] = {}
    for number, line in enumerate(lines, 2):
        if _NO_COLOR.fullmatch(line) is None:
            match = _LEVELS.fullmatch(line)
            levels = [int(level) for level in match.groups()[:3]] if match else [256]
            if max(levels) > 255:
                raise InputError(
                    f"{name} must be three levels of 0 to 255 a line; got {quoted(line)} in line "
                    f"{number} of {brief(path)}. Try a palette that GIMP saved"
                )
            found["#" + bytes(levels).hex()] = None
    return list(found)


def _hex(name: str, text: str) -> str:
    match = _HEX.fullmatch(text)
    if match is None:
        raise _bad(name, "colours such as #c0322c", text)
    digits = match[1].lower()
    return "#" + (digits if len(digits) == 6 else "".join(d + d for d in digits))


def _bad(name: str, needed: str, got: Any) -> InputError:
    shown = got if isinstance(got, (int, str)) else brief(str(got))
    return InputError(
        f'{name} must be {needed}; got {quoted(shown)}. Try 6, or "#f7c306,#c0322c,#17324d"'
    )
