"""Colours and widths of lines that lie in two rows of pixels, or in two columns.

Such pixels tell only the product of a line's width and its contrast: a line of 1 px between two
rows has the same pixels as a line of 2 px with half the contrast. So other parts of the picture
decide: another line, an area of the same colour, a crossing, or a line that has two grounds. Where
nothing does, faint lines are 1 px wide.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from gauss2svg.areas.kernels import Floats, Ints
from gauss2svg.areas.letters import PURE, SAME_COLOR, inside_of
from gauss2svg.areas.masks import LEVEL
from gauss2svg.areas.outlines import Path, lengths_of
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.thin import Line
from gauss2svg.portable import dot, product

MOST_OFF = 1.5  # px across a level segment between its points, because ends bend at crossings
LEAST_LENGTH = 4.0  # px of a segment
LEAST_LEVEL = 0.8  # share of a line's length in level or upright segments
LEAST_OF_PEN = 16.0  # px of a line, or of all lines of a pen, that are no noise
END = 1.0  # px at each end of a segment that are not measured
EVEN = 3 * LEVEL  # largest difference of pixels of one colour
LEAST_EVEN = 0.4  # share of a segment's pixels that must be like their median
EMPTY = 0.04  # share of a row of pixels in which the line is not
SAME_PEN = 5 * LEVEL  # largest difference of two colours of lines of a pen
OUTSIDE = 1.5 * LEVEL  # most by which a colour may leave its range, because it was rounded
SURE_WIDTH = 1.4  # px; lines that are wider have pixels of their colour
UNEQUAL = 0.55  # share of the stronger row of a line that is no line of 2 px in these rows
FAINT = 0.3  # largest contrast of the pixels of a line that is 1 px wide without other evidence
DARKER = 0.1  # least share by which a crossing of lines of 1 px must differ from these lines


class Piece(NamedTuple):
    """A level or upright segment of a line in at most two rows, or columns, of pixels.

    line, segment  indices of the line and of its segment
    axis       0 for a level segment, 1 for an upright one
    low, high  its ends along the axis, in px
    middle     its place across the axis, in px
    row        row of pixels with most of it
    share      share of it that this row has
    ground     (c,) colour beside it
    total      (c,) sum of the contrasts of its rows
    """

    line: int
    segment: int
    axis: int
    low: float
    high: float
    middle: float
    row: int
    share: float
    ground: Floats
    total: Floats

    @property
    def color(self) -> Floats:
        """The colour (c,) that the line has if it is 1 px wide."""
        return self.ground + self.total

    @property
    def length(self) -> float:
        """The length in px."""
        return self.high - self.low


def with_sure_widths(
    pixels: Floats, cores: Ints, lines: list[Line], paints: list[Paint]
) -> list[Line]:
    """Return lines, of which those in two rows of pixels have their likely colours and widths.

    New colours are added to `paints`.
    """
    pieces = list[Piece]()
    sure = list[Line]()
    for k, line in enumerate(lines):
        own = pieces_of(pixels, k, line.path)
        length = float(lengths_of(line.path.segments).sum())
        if sum(piece.length for piece in own) >= LEAST_LEVEL * length:
            pieces += own
        elif line.width > SURE_WIDTH and length >= LEAST_OF_PEN:
            sure.append(line)
    inside = inside_of(cores, PURE)
    pure = [paints[k].color for k in np.unique(inside[inside >= 0])]
    pure += [paints[line.region].color for line in sure]

    def is_pure(piece: Piece) -> bool:
        """Whether a piece has the colour of an area, so that it is wider than 1 px."""
        color = paints[lines[piece.line].region].color
        is_other = np.abs(color - piece.color).max() > SAME_COLOR
        is_wide = lines[piece.line].width > 1
        return is_wide and is_other and _is_in(color, pure)

    moved = dict[int, Line]()
    for pen in pens_of([one for one in pieces if not is_pure(one)]):
        alike = next((line for line in sure if _draws(line, paints[line.region].color, pen)), None)
        if alike is not None:
            region, width = alike.region, alike.width
        elif _is_thin(pixels, pen, pure):
            color = np.average([one.color for one in pen], 0, [one.length for one in pen])
            region, width = _region_of(color, paints), 1.0
        else:
            continue
        for one in pen:
            path = moved.get(one.line, lines[one.line]).path
            moved[one.line] = Line(region, _at_middle(path, one), width)
    return [moved.get(k, line) for k, line in enumerate(lines)]


def pieces_of(pixels: Floats, index: int, path: Path) -> list[Piece]:
    """Return the segments of a line that are in at most two rows, or columns, on one ground."""
    pieces = []
    for segment, points in enumerate(path.segments):
        low, high = points.min(axis=0), points.max(axis=0)
        axis = int(high[1] - low[1] > high[0] - low[0])
        first, last = round(low[axis] + END), round(high[axis] - END)
        top = int(np.floor((low + high)[1 - axis] / 2 - 0.5)) - 2
        picture = pixels if axis == 0 else pixels.swapaxes(0, 1)
        is_level = (high - low)[1 - axis] <= MOST_OFF and (high - low)[axis] >= LEAST_LENGTH
        if not is_level or top < 0 or top + 6 > len(picture):
            continue
        rows = picture[top : top + 6, max(first, 0) : last].astype(np.float64)
        ground = np.median(rows[0], axis=0)
        has_ground = np.abs(rows[[0, -1]] - ground).max(axis=(0, 2)) <= EVEN
        if not has_ground.any():
            continue
        off = np.median(rows[:, has_ground], axis=1) - ground
        is_even = np.abs(rows - ground - off[:, None]).max(axis=(0, 2)) <= EVEN
        total = off.sum(axis=0)
        share = product(off, total) / max(dot(total, total), 1e-9)
        row = int(share.argmax())
        if (
            is_even.mean() >= LEAST_EVEN
            and np.abs(np.sort(share)[:-2]).max() <= EMPTY
            and np.abs(off - share[:, None] * total).max() <= EVEN
        ):
            middle = top + 0.5 + dot(share, np.arange(6))
            pieces.append(Piece(
                index, segment, axis, low[axis], high[axis], middle, top + row, share[row], ground,
                total,
            ))  # fmt: skip
    return pieces


def pens_of(pieces: list[Piece]) -> list[list[Piece]]:
    """Return the pieces in groups that have one colour if they are 1 px wide."""
    pens = list[list[Piece]]()
    for one in pieces:
        near = (pen for pen in pens if np.abs(one.color - pen[0].color).max() <= SAME_PEN)
        pen = next(near, None)
        if pen is None:
            pens.append([one])
        else:
            pen.append(one)
    return pens


def _draws(line: Line, color: Floats, pen: list[Piece]) -> bool:
    """Whether the width and the colour of a line explain all pieces of a pen."""
    off = [line.width * (color - one.ground) - one.total for one in pen]
    return bool(np.abs(off).max() <= SAME_PEN)


def _is_in(color: Floats, colors: list[Floats]) -> bool:
    """Whether a colour is nearly one of some others."""
    return any(np.abs(color - one).max() <= SAME_COLOR for one in colors)


def _is_thin(pixels: Floats, pen: list[Piece], pure: list[Floats]) -> bool:
    """Whether the lines of a pen are 1 px wide. `pure` has the colours of areas and wide lines."""
    color = np.mean([one.color for one in pen], axis=0)
    over_black, over_white = color[:3], color[-3:]
    lowest = min(over_black.min(), (over_white - over_black).min())
    is_long = sum(one.length for one in pen) >= LEAST_OF_PEN
    if not is_long or lowest < -OUTSIDE or over_white.max() > 1 + OUTSIDE:
        return False
    has_two_grounds = np.abs([one.ground - pen[0].ground for one in pen]).max() > SAME_COLOR
    strongest = max(pen, key=lambda one: one.share)
    if has_two_grounds or strongest.share > UNEQUAL:
        return True
    crossings = [_is_darker(pixels, *two) for two in itertools.permutations(pen, 2) if _cross(*two)]
    if crossings:
        return any(crossings)
    is_faint = 0.5 * np.abs(strongest.total).max() <= FAINT
    return is_faint or _is_in(color, [*pure, 0 * color, 0 * color + 1])


def _cross(one: Piece, other: Piece) -> bool:
    """Whether a level piece crosses an upright one so that the pixels there tell the width."""
    return (
        (one.axis, other.axis) == (0, 1)
        and one.low + END < other.middle < one.high - END
        and other.low + END < one.middle < other.high - END
        and (1 - max(one.share, other.share)) * min(one.share, other.share) > DARKER
    )


def _is_darker(pixels: Floats, one: Piece, other: Piece) -> bool:
    """Whether two pieces that cross differ more from the ground there than each of them does.

    Lines of 1 px cover a larger share of the pixel there, and wider ones all of the two rows.
    """
    share = dot(pixels[one.row, other.row] - one.ground, one.total) / dot(one.total, one.total)
    most = max(one.share, other.share)
    return bool(share > most + 0.5 * (1 - most) * min(one.share, other.share))


def _region_of(color: Floats, paints: list[Paint]) -> int:
    """Return the name of a region of nearly this colour. If there is none, add its paint."""
    color = np.clip(color, 0, 1)
    off = [np.inf if one.is_shaded else np.abs(one.color - color).max() for one in paints]
    if min(off) > SAME_COLOR:
        off.append(0.0)
        paints.append(Paint(color))
    return int(np.argmin(off))


def _at_middle(path: Path, piece: Piece) -> Path:
    """Return the path of a line with one of its segments in the middle of the rows."""
    segments, across = path.segments.copy(), 1 - piece.axis
    count, k = len(segments), piece.segment
    segments[k, :, across] = piece.middle
    if path.closed or k + 1 < count:
        after = (k + 1) % count
        segments[after, : 1 if path.curved[after] else 2, across] = piece.middle
    if path.closed or k > 0:
        segments[k - 1, 3 if path.curved[k - 1] else 2 :, across] = piece.middle
    return path._replace(segments=segments)
