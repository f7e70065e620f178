"""Shapes of a minimal file as whole numbers, and the scene that these numbers draw.

Plain ellipses are arcs of a path. One path may have many arcs of the same colour:

    <path fill="#abc" d="M10 20a8 4 30 101 0m-2 9a3 3 0 100 1"/>

Each arc goes round its whole ellipse except for a gap. The end of the arc is one unit to the right
of its start, or one unit below it. When the path is filled, the gap is closed. The centre of the
ellipse follows from the start, the radii and the tilt (in degrees). All arcs have the same
direction of rotation, so that a path fills the union of its ellipses.

Shapes of the same colour are moved next to each other, so that one path can draw them. These moves
must not change the picture. So two shapes may exchange their places only if they do not overlap, or
if they have the same colour.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.errors import quoted, refusal
from gauss2svg.options import Field
from gauss2svg.scene import ADD, LEAST_SIGMA, MOST_SIGMA, PLAIN, RHO_LIMIT, SOFT, Area, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, drawn_radius, nearest_class
from gauss2svg.svg.areas import in_units, with_areas
from gauss2svg.svg.element import check_view, number, writable
from gauss2svg.svg.forms import is_plain, plain_beta, with_falloffs

Floats = NDArray[np.float64]
HEX_DIGITS = (3, 6)  # a colour may have either of these numbers of hex digits
OPACITY_DIGITS = 2  # default number of decimals of an opacity


# The next two numbers set how many soft shapes of a minimal file are drawn under masks
# (docs/decisions/minimal.md). If a file has at most this many soft shapes, all of these are drawn
# under masks. If it has more, some of them get gradients instead, because masks are slow.
MOST_MASKED = 500
# For each soft shape beyond MOST_MASKED, the number of soft shapes under masks becomes smaller by
# this number. So masks are replaced by gradients gradually. If all soft shapes got gradients as
# soon as there are more than MOST_MASKED, a single additional shape would make the file larger by a
# third.
FADING = 2


@dataclass(frozen=True)
class Shapes:
    """The areas of a file, and its n shapes in the order in which they are drawn.

    index    (n,) index of the shape in its scene
    falloff  (n,) index of its exponent in BETA_CLASSES. -1 for a plain ellipse
    numbers  (n, 5) five numbers. A soft shape is a circle of radius 1 with the transform
             matrix(a b 0 d e f), and has the whole numbers a b d e f. A plain ellipse has the
             numbers that `arc_numbers` returns
    mean     (n, 2) centre of the ellipse that is drawn, in user units
    factor   (n, 3) Cholesky factor l11 l21 l22 of that ellipse, in user units
    masked   (n,) whether the shape is a soft one that is drawn under a mask, not by a gradient
    color    (n, 3) colour in levels, 0..255
    opacity  (n,) opacity, 0..1
    level    (n,) number of areas of the file that lie below the shape. ABOVE: all
    areas    areas of the file, in user units
    """

    index: NDArray[np.intp]
    falloff: NDArray[np.intp]
    numbers: Floats
    mean: Floats
    factor: Floats
    color: NDArray[np.intp]
    opacity: Floats
    level: NDArray[np.int32]
    masked: NDArray[np.bool_]
    areas: list[Area]

    def as_written(self, scene: Scene, unit: float, digits: int) -> Scene:
        """Return the scene that a file with these shapes draws.

        scene         scene from which the shapes were made
        unit, digits  as in `shapes_of`
        """
        plain = self.falloff < 0
        beta = np.array([*BETA_CLASSES, 1.0])[self.falloff]
        beta[plain] = plain_beta(np.sort(unit * self.numbers[plain, :2], axis=1)[:, ::-1])
        # All shapes are in one round, because a minimal file has no layers, and because its shapes
        # are not in the order of rounds.
        one_round = scene.replace(round_index=None, level=None)
        written = one_round.select(self.index).replace(
            areas=[area.scaled(unit, unit) for area in self.areas],
            level=self.level,
            color=self.color / 255,
            opacity=self.opacity,
            background=color_levels(scene.background, digits) / 255,
            beta=beta,
            drawn=np.where(plain, PLAIN, SOFT),
        )
        return _placed(written, self.mean, self.factor, drawn_radius(beta, plain), unit)


def shapes_of(
    scene: Scene, unit: float, digits: int, opacity_decimals: int, masked: bool | None = None
) -> Shapes:
    """Return the areas and shapes that the file of a scene has.

    A shape is left out if its extent or opacity is written as 0. `in_units` says which areas are
    left out.

    unit    user unit in px
    digits  number of hex digits of a colour, 3 or 6
    masked  whether all soft shapes are drawn under masks (True), or none (False). If None, the
            number of soft shapes decides. If there are at most MOST_MASKED, all are drawn under
            masks. For each soft shape beyond MOST_MASKED, FADING fewer shapes are drawn under
            masks. The other soft shapes get gradients

    Raise InputError if the unit is out of range, and for an additive scene. Raise SceneError if the
    numbers of a visible shape are too large for a file.
    """
    unit = Field("unit", float, 0.001, 1e6).checked(unit)
    if scene.blend == ADD:
        advice = "--portable, or --markup editable"
        raise refusal("blend in minimal markup", "'over'", quoted(scene.blend), advice)
    check_view(scene, unit)
    areas, kept = in_units(scene.areas, unit, opacity_decimals)
    scene = with_areas(scene, kept)
    kind = nearest_class(scene.beta)
    plain = is_plain(scene, minimal=True)
    opacity = np.round(scene.opacity, opacity_decimals)
    now_plain = np.zeros(0, np.intp)
    while True:
        plain[now_plain] = True
        written = with_falloffs(scene, np.where(plain, scene.beta, np.array(BETA_CLASSES)[kind]))
        radius = drawn_radius(written.beta, plain)
        factor = written.factor * radius[:, None, None]
        entries = [factor[:, 0, 0], factor[:, 1], written.mean]
        numbers = np.round(np.column_stack(entries) / unit) + 0.0  # adding 0.0 turns -0 into 0
        numbers[plain] = arc_numbers(written.select(plain), radius[plain], unit)
        extent = np.where(plain, numbers[:, :2].min(axis=1), numbers[:, 0] * numbers[:, 2])
        drawn = writable(written, radius, unit) & (extent > 0) & (opacity > 0)
        # After its numbers are rounded, a soft shape may look the same as a plain ellipse. Such a
        # shape is made a plain ellipse here, and all shapes are rounded again. Otherwise it would
        # become an arc when its file is read and written again.
        soft = np.flatnonzero(drawn & ~plain)
        mean, factor = numbers[:, 3:].copy(), numbers[:, :3].copy()
        placed = _placed(written.select(soft), mean[soft], factor[soft], radius[soft], unit)
        now_plain = soft[is_plain(placed, minimal=True)]
        if not len(now_plain):
            break
    arcs = drawn & plain
    mean[arcs], factor[arcs] = arc_geometry(numbers[arcs])
    color, falloff = color_levels(scene.color, digits), np.where(plain, -1, kind)
    index = np.flatnonzero(drawn)
    keys = np.stack([mean[:, 0], mean[:, 1], falloff])
    # Shapes are not moved over or under areas, so each level is ordered by itself.
    for level in np.unique(scene.level[index[plain[index]]]):
        at = scene.level[index] == level
        own = index[at]
        order = colors_together(mean[own], factor[own], color[own], keys[:, own], 1 / unit)
        index[at] = own[order]
    soft = np.flatnonzero(~plain[index])
    most = max(MOST_MASKED + FADING * (MOST_MASKED - len(soft)), 0)
    count = {True: len(soft), False: 0, None: min(len(soft), most)}[masked]
    is_masked = np.zeros(len(index), bool)
    # The upper shapes get the masks, because they are smaller, so their masks are drawn faster.
    is_masked[soft[len(soft) - count :]] = True
    return Shapes(
        index, falloff[index], numbers[index], mean[index], factor[index], color[index],
        opacity[index], scene.level[index], is_masked, areas,
    )  # fmt: skip


def color_levels(color: Floats, digits: int) -> NDArray[np.intp]:
    """Return colours as levels in 0..255 that can be written with `digits` hex digits.

    The array `color` may have any shape.
    """
    most = 15 if digits == HEX_DIGITS[0] else 255
    return np.round(color * most).astype(np.intp) * (255 // most)


def _placed(scene: Scene, mean: Floats, factor: Floats, radius: Floats, unit: float) -> Scene:
    """Return the scene with each shape moved and resized so that it fills a given ellipse.

    mean    (n, 2) centres of the ellipses, in user units
    factor  (n, 3) their Cholesky factors l11 l21 l22, in user units
    radius  (n,) their radii in sigmas
    unit    user unit in px
    """
    a, b, d = unit * factor.T
    sigma = np.column_stack([a, portable.hypot(b, d)]) / radius[:, None]
    rho = np.clip(b / portable.hypot(b, d), -RHO_LIMIT, RHO_LIMIT)
    return scene.replace(mean=unit * mean, sigma=np.clip(sigma, LEAST_SIGMA, MOST_SIGMA), rho=rho)


# The tilt of a long ellipse is written with this number of decimals. The tilts of other ellipses
# are written as whole degrees.
_TILT_DECIMALS = 1


def arc_numbers(scene: Scene, radius: Floats, unit: float) -> Floats:
    """Return the numbers (n, 5) of each arc: its radii rx and ry, its tilt, and its start x and y.

    radius  (n,) radius of the ellipses in sigmas
    unit    user unit in px

    The radii and the start are whole numbers of units. The tilt is the angle of the first radius,
    in (-45, 45] degrees. It is a whole number, or has one decimal if the ellipse is long. The tilt
    of a circle is 0. If a radius is 0, no arc can draw the shape.
    """
    axes, angle_rad = scene.ellipse_axes
    radii = np.round(axes * radius[:, None] / unit)
    tilt = np.degrees(angle_rad)
    # The tilt gets a decimal if the radii differ by more than 60 units. Without the decimal, the
    # tilt could be wrong by half a degree, which would move the ends of such an ellipse by more
    # than half a unit.
    decimals = np.where(radii[:, 0] - radii[:, 1] > 60.0, _TILT_DECIMALS, 0)
    factor = np.array([1.0, 10.0])[decimals]
    tilt = np.round(tilt * factor) / factor
    steep = (tilt <= -45) | (tilt > 45)
    radii[steep] = radii[steep, ::-1]
    tilt[steep] -= np.where(tilt[steep] > 0, 90.0, -90.0)
    tilt[radii[:, 0] == radii[:, 1]] = 0.0
    offset, _ = _from_start(radii, tilt)
    start = np.round(scene.mean / unit - offset)
    return np.column_stack([radii, tilt, start]) + 0.0  # adding 0.0 turns -0 into 0


def arc_geometry(numbers: Floats) -> tuple[Floats, Floats]:
    """Return the ellipses of the arcs that have these `arc_numbers` (n, 5).

    Return their centres (n, 2), and their Cholesky factors l11 l21 l22 (n, 3), in user units.
    """
    (rx, ry), tilt_rad = numbers[:, :2].T, np.radians(numbers[:, 2])
    co, si = portable.cos(tilt_rad), portable.sin(tilt_rad)
    l11 = portable.hypot(rx * co, ry * si)
    factor = np.column_stack([l11, (rx * rx - ry * ry) * co * si / l11, rx * ry / l11])
    return numbers[:, 3:] + _from_start(numbers[:, :2], numbers[:, 2])[0], factor


def path_data(numbers: Floats) -> str:
    """Return the d of a path of arcs that have these `arc_numbers` (n, 5)."""
    text, (x, y) = "", (np.nan, np.nan)
    _, chords = _from_start(numbers[:, :2], numbers[:, 2])
    for (rx, ry, tilt, start_x, start_y), chord in zip(numbers, chords, strict=True):
        move = f"M{number(start_x, 0)} {number(start_y, 0)}"
        if text:
            move = min(f"m{number(start_x - x, 0)} {number(start_y - y, 0)}", move, key=len)
        # First come the two flags of a large arc that is drawn counterclockwise (1 and 0), and then
        # the end of the arc relative to its start.
        to = "101 0" if chord[0] else "100 1"
        text += f"{move}a{number(rx, 0)} {number(ry, 0)} {number(tilt, _TILT_DECIMALS)} {to}"
        x, y = start_x + chord[0], start_y + chord[1]
    return text.replace(" -", "-")


def _from_start(radii: Floats, tilt: Floats) -> tuple[Floats, Floats]:
    """Return two vectors (n, 2) for each arc, in user units.

    The first vector leads from the start of the arc to the centre of its ellipse. The second vector
    is the chord, which leads from the start of the arc to its end. The chord is (1, 0) or (0, 1),
    whichever cuts off the smaller part of the ellipse.

    To compare these two chords, the ellipse is mapped onto the unit circle. There, the shorter
    chord cuts off the smaller part. The vector u is this chord of the circle. The centre of the
    circle lies beside the middle of u, in the direction at a right angle to u (SVG 2,
    implementation notes, B.2.4).
    """
    tilt_rad, radii = np.radians(tilt), np.maximum(radii, 1.0)
    co, si = portable.cos(tilt_rad), portable.sin(tilt_rad)
    onto = np.array([[co, -si], [si, co]]).transpose(2, 0, 1) * radii[:, None, :]
    across = portable.hypot(co / radii[:, 0], si / radii[:, 1])
    down = portable.hypot(si / radii[:, 0], co / radii[:, 1])
    # For a circle, `across` and `down` are equal except for rounding errors. 1e-9 is larger than
    # these errors, so all circles get the same chord.
    level = across <= down + 1e-9
    chord = np.column_stack([level, ~level]).astype(np.float64)
    u = (onto / np.square(radii)[:, None, :] * chord[:, :, None]).sum(axis=1)
    length = np.where(level, across, down)
    height = np.sqrt(np.maximum(1 - np.square(length) / 4, 0)) / length
    center = height[:, None] * np.column_stack([-u[:, 1], u[:, 0]])
    return chord / 2 + (onto * center[:, None, :]).sum(axis=2), chord


# Two ellipses count as apart if there is a line onto which their projections are apart. These are
# the angles of the lines that are tried.
_DIRECTIONS = np.arange(12) * np.pi / 12
# The indices of the lines along x and y. These two lines are tested first, because they rule out
# most pairs.
_ALONG_SIDES = [0, 6]
_ROWS = 64  # number of neighbouring shapes that are compared with the others at a time
_CELLS = 1 << 18  # largest number of pairs that are compared at a time, if a shape has fewer


def projections(mean: Floats, factor: Floats) -> tuple[Floats, Floats]:
    """Return the projections of n ellipses onto the lines of _DIRECTIONS.

    Return two arrays (12, n): the centres of the projections, and half of their lengths. The
    arguments are those of `colors_together`.
    """
    x, y = portable.cos(_DIRECTIONS)[:, None], portable.sin(_DIRECTIONS)[:, None]
    l11, l21, l22 = factor.T
    return mean[:, 0] * x + mean[:, 1] * y, portable.hypot(l11 * x + l21 * y, l22 * y)


def overlaps(
    center: Floats,
    half: Floats,
    kind: NDArray[np.generic],
    margin: float,
    rows: NDArray[np.intp] | None = None,
) -> Iterator[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Yield the pairs of shapes of different kinds that overlap, some at a time.

    Each time, yield two arrays: the lower shapes of the pairs, and the upper ones. All pairs of a
    lower shape come at once and next to each other. The memory that is needed is proportional to
    the number n of shapes, however many of them overlap.

    center, half  (12, n) what `projections` returns
    kind          (n,) kind of each shape
    margin        as in `colors_together`
    rows          indices of the lower shapes of the pairs. If it is None, they are all shapes
    """
    low, high = center[_ALONG_SIDES] - half[_ALONG_SIDES], center[_ALONG_SIDES] + half[_ALONG_SIDES]
    rows = np.arange(len(kind)) if rows is None else rows
    # In this order, most shapes that follow each other have similar sizes and are neighbours.
    size = np.ldexp(
        1.0, np.ceil(portable.log2(np.maximum((high - low)[:, rows].max(axis=0), 1.0))).astype(int)
    )
    rows = rows[np.lexsort([low[0, rows], low[1, rows] // (4 * size), size])]
    # One more unit makes up for rounding errors. The exact test follows.
    least, most = low - margin - 1, high + margin + 1
    for begin in range(0, len(rows), _ROWS):
        block = rows[begin : begin + _ROWS]
        first, last = low[:, block].min(axis=1)[:, None], high[:, block].max(axis=1)[:, None]
        near_block = np.flatnonzero(((least < last) & (most > first)).all(axis=0))
        step = max(1, _CELLS // len(near_block))
        for part in np.split(block, range(step, len(block), step)):
            near = (kind[part, None] != kind[near_block]) & (part[:, None] < near_block)
            for k in _ALONG_SIDES:
                limit = half[k, part, None] + half[k, near_block] + margin
                near &= np.abs(center[k, part, None] - center[k, near_block]) < limit
            row, column = np.nonzero(near)
            row, column = part[row], near_block[column]
            for c, h in zip(center, half, strict=True):
                kept = np.abs(c[row] - c[column]) < h[row] + h[column] + margin
                row, column = row[kept], column[kept]
            yield row, column


# If more shapes than this are over a shape and overlap it, they are not remembered but found again
# when they are needed. So the memory is proportional to the number of shapes.
_MOST_REMEMBERED = 256


def colors_together(
    mean: Floats, factor: Floats, color: NDArray[np.intp], key: Floats, margin: float
) -> NDArray[np.intp]:
    """Return an order (n,) of the shapes that draws the same picture with few changes of colour.

    The shapes may be passed in any order that draws this picture. All these orders give the same
    result.

    A shape must wait for all shapes of other colours that are below it and overlap it. When these
    have been drawn, the shape is ready. In each step, a share is computed for each colour: the
    number of its ready shapes, divided by the number of its shapes that are not drawn yet. The
    colour with the largest share comes next, and all its ready shapes are drawn.

    mean    (n, 2) centres of the ellipses that contain the shapes
    factor  (n, 3) Cholesky factors l11 l21 l22 of these ellipses
    color   (n, 3) colours of the shapes in whole levels
    key     (k, n) keys for sorting. Shapes of one colour that become ready at the same time are
            sorted by these keys. The primary key is the last
    margin  smallest distance at which two ellipses count as apart
    """
    kind = np.unique(color, axis=0, return_inverse=True)[1].reshape(-1)
    ellipses = (*projections(mean, factor), kind, margin)
    # For each shape, the number of shapes that must be drawn before it and are not drawn yet.
    waiting = np.zeros(len(mean), np.intp)
    # For each shape, the shapes that wait for it, or None if there are too many to remember them.
    above: list[NDArray[np.int32] | None] = [np.zeros(0, np.int32)] * len(mean)
    for row, column in overlaps(*ellipses):
        np.add.at(waiting, column, 1)
        begins = np.flatnonzero(np.diff(row, prepend=-1))
        for i, over in zip(row[begins].tolist(), np.split(column, begins[1:]), strict=False):
            above[i] = over.astype(np.int32) if len(over) <= _MOST_REMEMBERED else None
    kind_of, undrawn = kind.tolist(), np.bincount(kind).tolist()
    ready: list[list[int]] = [[] for _ in undrawn]
    # A heap of pairs: the share of a colour, with a minus, and the colour. Some are out of date.
    shares: list[tuple[float, int]] = []
    order, now_ready = [np.zeros(0, np.intp)], np.flatnonzero(waiting == 0).tolist()
    while now_ready or shares:
        for i in now_ready:
            ready[kind_of[i]].append(i)
        for k in {kind_of[i] for i in now_ready}:
            heappush(shares, (-len(ready[k]) / undrawn[k], k))
        share, k = heappop(shares)
        now_ready = []
        if ready[k] and -share == len(ready[k]) / undrawn[k]:
            chosen = np.sort(ready[k])
            order.append(chosen[np.lexsort(key[:, chosen])])
            undrawn[k] -= len(chosen)
            ready[k] = []
            for i in chosen.tolist():
                over = above[i]
                if over is None:
                    over = next(overlaps(*ellipses, np.array([i])))[1]
                waiting[over] -= 1
                now_ready += over[waiting[over] == 0].tolist()
    return np.concatenate(order)
