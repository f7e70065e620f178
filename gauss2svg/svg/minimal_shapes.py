"""Shapes of a minimal file as whole numbers, and the scene that these numbers draw.

Plain ellipses are arcs of a path. One path may have many arcs of one colour:

    <path fill="#abc" d="M10 20a8 4 30 101 0m-2 9a3 3 0 100 1"/>

Each arc goes round its ellipse but for a gap: the arc's end lies one unit right of its start, or
one unit below. Filling closes the gap. The centre follows from the start, the radii and the tilt in
degrees. All arcs turn the same way, so that a path fills the union of its ellipses.

Shapes are reordered so that those of one colour follow each other, if the picture stays the same.
Two shapes may change places if they do not overlap, or if their colours are equal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import quoted, refusal
from gauss2svg.options import Field
from gauss2svg.scene import ADD, LEAST_SIGMA, MOST_SIGMA, PLAIN, RHO_LIMIT, SOFT, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, nearest_class
from gauss2svg.svg.element import check_view, number, writable
from gauss2svg.svg.forms import arc_beta, drawn_radius, is_arc, with_falloffs

Floats = NDArray[np.float64]
HEX_DIGITS = (3, 6)  # numbers of hex digits that a colour may have
OPACITY_DIGITS = 2  # default decimals of an opacity


# Masks and gradients of a minimal file (docs/decisions/minimal.md).
# Largest number of soft shapes that are drawn under masks, because masks are slow.
MOST_MASKED = 500
# Number of masks that give way to gradients for each soft shape beyond MOST_MASKED. If all did at
# once, one more shape would make the file a third larger.
FADING = 2


@dataclass(frozen=True)
class Shapes:
    """The n shapes of a file, in painter's order.

    index    (n,) index of the shape in its scene
    falloff  (n,) index into BETA_CLASSES, -1 for a plain ellipse
    numbers  (n, 5) whole numbers a b d e f, the matrix(a b 0 d e f) of a circle of radius 1. For a
             plain ellipse they are those of `arc_numbers`
    mean     (n, 2) centre of the ellipse that is drawn, in units
    factor   (n, 3) Cholesky factor l11 l21 l22 of that ellipse, in units
    masked   (n,) whether a shape is soft and drawn under a mask, not by a gradient
    levels   (n, 3) colour in levels, 0..255
    opacity  (n,) 0..1
    """

    index: NDArray[np.intp]
    falloff: NDArray[np.intp]
    numbers: Floats
    mean: Floats
    factor: Floats
    levels: NDArray[np.intp]
    opacity: Floats
    masked: NDArray[np.bool_]

    def rounded(self, scene: Scene, unit: float, digits: int) -> Scene:
        """Return `scene` as a file with these shapes draws it."""
        plain = self.falloff < 0
        beta = np.array([*BETA_CLASSES, 1.0])[self.falloff]
        beta[plain] = arc_beta(np.sort(unit * self.numbers[plain, :2], axis=1)[:, ::-1])
        # A minimal file has no layers, and its shapes are not in the order of rounds.
        one_round = scene.replace(round_index=np.zeros_like(scene.round_index))
        rounded = one_round.select(self.index).replace(
            color=self.levels / 255,
            opacity=self.opacity,
            background=color_levels(scene.background, digits) / 255,
            beta=beta,
            drawn=np.where(plain, PLAIN, SOFT),
        )
        return _placed(rounded, self.mean, self.factor, drawn_radius(beta, plain), unit)


def shapes_of(
    scene: Scene, unit: float, digits: int, opacity_decimals: int, masked: bool | None = None
) -> Shapes:
    """Return the shapes of a scene's file, without those whose extent or opacity is written as 0.

    unit    user unit in px
    digits  hex digits of a colour, 3 or 6
    masked  whether soft shapes are drawn under masks. None: all are, up to MOST_MASKED soft
            shapes, and FADING fewer for each soft shape beyond

    Raise InputError for a unit out of range, and for an additive scene. Raise SceneError
    for visible shapes whose numbers are too large for a file.
    """
    unit = Field("unit", float, 0.001, 1e6).checked(unit)
    if scene.blend == ADD:
        advice = "--portable, or --markup editable"
        raise refusal("blend in minimal markup", "'over'", quoted(scene.blend), advice)
    check_view(scene, unit)
    kind = nearest_class(scene.beta)
    plain = (scene.drawn == PLAIN) | is_arc(scene.ellipse_axes[0], scene.beta)
    opacity = np.round(scene.opacity, opacity_decimals)
    now_plain = np.zeros(0, np.intp)
    while True:
        plain[now_plain] = True
        snapped = with_falloffs(scene, np.where(plain, scene.beta, np.array(BETA_CLASSES)[kind]))
        radius = drawn_radius(snapped.beta, plain)
        factor = snapped.factor * radius[:, None, None]
        entries = [factor[:, 0, 0], factor[:, 1], snapped.mean]
        numbers = np.round(np.column_stack(entries) / unit) + 0.0  # turns -0 into 0
        numbers[plain] = arc_numbers(snapped.select(plain), radius[plain], unit)
        extent = np.where(plain, numbers[:, :2].min(axis=1), numbers[:, 0] * numbers[:, 2])
        drawn = writable(snapped, radius, unit) & (extent > 0) & (opacity > 0)
        # Soft shapes that look plain once they are rounded are made plain, so that rounding a scene
        # twice changes nothing.
        soft = np.flatnonzero(drawn & ~plain)
        mean, factor = numbers[:, 3:].copy(), numbers[:, :3].copy()
        placed = _placed(snapped.select(soft), mean[soft], factor[soft], radius[soft], unit)
        now_plain = soft[is_arc(placed.ellipse_axes[0], placed.beta)]
        if not len(now_plain):
            break
    arcs = drawn & plain
    mean[arcs], factor[arcs] = arc_geometry(numbers[arcs])
    levels, falloff = color_levels(scene.color, digits), np.where(plain, -1, kind)
    index = np.flatnonzero(drawn)
    if plain[index].any():
        keys = np.stack([mean[:, 0], mean[:, 1], falloff])[:, index]
        index = index[colors_together(mean[index], factor[index], levels[index], keys, 1 / unit)]
    soft = np.flatnonzero(~plain[index])
    most = max(MOST_MASKED + FADING * (MOST_MASKED - len(soft)), 0)
    count = {True: len(soft), False: 0, None: min(len(soft), most)}[masked]
    is_masked = np.zeros(len(index), bool)
    # Upper shapes get the masks, because they are smaller and quicker to paint.
    is_masked[soft[len(soft) - count :]] = True
    return Shapes(
        index, falloff[index], numbers[index], mean[index], factor[index], levels[index],
        opacity[index], is_masked,
    )  # fmt: skip


def color_levels(color: Floats, digits: int) -> NDArray[np.intp]:
    """Return colours, of any shape, in levels of 0..255 that `digits` hex digits can write."""
    most = 15 if digits == HEX_DIGITS[0] else 255
    return np.round(color * most).astype(np.intp) * (255 // most)


def _placed(scene: Scene, mean: Floats, factor: Floats, radius: Floats, unit: float) -> Scene:
    """Return the scene with other ellipses: centres (n, 2) and factors (n, 3) in user units."""
    a, b, d = unit * factor.T
    sigma = np.column_stack([a, np.hypot(b, d)]) / radius[:, None]
    rho = np.clip(b / np.hypot(b, d), -RHO_LIMIT, RHO_LIMIT)
    return scene.replace(mean=unit * mean, sigma=np.clip(sigma, LEAST_SIGMA, MOST_SIGMA), rho=rho)


_TILT_DECIMALS = 1  # decimals of the tilt of long ellipses. Others have none


def arc_numbers(scene: Scene, radius: Floats, unit: float) -> Floats:
    """Return the numbers (n, 5) of arcs: radii rx ry, tilt, and start x y.

    radius  (n,) radius of the ellipses in sigmas

    Radii and start are whole units. The tilt of the first radius is in (-45, 45] degrees. It is
    whole, or has one decimal for long ellipses, and is 0 for circles. No arc can draw a shape with
    a radius of 0.
    """
    axes, angle_rad = scene.ellipse_axes
    radii = np.round(axes * radius[:, None] / unit)
    tilt = np.degrees(angle_rad)
    # If the radii differ by 60 units, half a degree of tilt moves the far end by half a unit.
    decimals = np.where(radii[:, 0] - radii[:, 1] > 60.0, _TILT_DECIMALS, 0)
    tilt = np.round(tilt * 10.0**decimals) / 10.0**decimals
    steep = (tilt <= -45) | (tilt > 45)
    radii[steep] = radii[steep, ::-1]
    tilt[steep] -= np.where(tilt[steep] > 0, 90.0, -90.0)
    tilt[radii[:, 0] == radii[:, 1]] = 0.0
    offset, _ = _from_start(radii, tilt)
    start = np.round(scene.mean / unit - offset)
    return np.column_stack([radii, tilt, start]) + 0.0  # turns -0 into 0


def arc_geometry(numbers: Floats) -> tuple[Floats, Floats]:
    """Return centres (n, 2) and Cholesky factors (n, 3) l11 l21 l22 of arcs' ellipses, in units."""
    (rx, ry), tilt_rad = numbers[:, :2].T, np.radians(numbers[:, 2])
    co, si = np.cos(tilt_rad), np.sin(tilt_rad)
    l11 = np.hypot(rx * co, ry * si)
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
        to = "101 0" if chord[0] else "100 1"  # flags: large, counterclockwise; then the arc's end
        text += f"{move}a{number(rx, 0)} {number(ry, 0)} {number(tilt, _TILT_DECIMALS)} {to}"
        x, y = start_x + chord[0], start_y + chord[1]
    return text.replace(" -", "-")


def _from_start(radii: Floats, tilt: Floats) -> tuple[Floats, Floats]:
    """Return offsets (n, 2) in units from each arc's start to its ellipse's centre, and to its end.

    Of the chords (1, 0) and (0, 1), the arc gets the one that cuts off less. That chord is shorter
    when the ellipse is mapped onto the unit circle. There the chord is the vector u, and the centre
    lies beside the middle of u (SVG 2, implementation notes, B.2.4).
    """
    tilt_rad, radii = np.radians(tilt), np.maximum(radii, 1.0)
    co, si = np.cos(tilt_rad), np.sin(tilt_rad)
    onto = np.array([[co, -si], [si, co]]).transpose(2, 0, 1) * radii[:, None, :]
    across = np.hypot(co / radii[:, 0], si / radii[:, 1])
    down = np.hypot(si / radii[:, 0], co / radii[:, 1])
    level = across <= down + 1e-9  # both are equal for circles
    chord = np.column_stack([level, ~level]).astype(np.float64)
    u = np.einsum("nji,nj->ni", onto / np.square(radii)[:, None, :], chord)
    length = np.where(level, across, down)
    height = np.sqrt(np.maximum(1 - np.square(length) / 4, 0)) / length
    center = height[:, None] * np.column_stack([-u[:, 1], u[:, 0]])
    return chord / 2 + np.einsum("nij,nj->ni", onto, center), chord


_DIRECTIONS = np.arange(12) * np.pi / 12  # angles of the lines onto which ellipses are projected
_ALONG_SIDES = 0, 6  # indices of the directions along x and y, which rule out most pairs first
_ROWS = 64  # rows compared at a time, a multiple of the 8 bits of a byte


def overlaps(
    mean: Floats, factor: Floats, kind: NDArray[np.generic], margin: float
) -> NDArray[np.uint8]:
    """Return n x n bits, packed to (n, n / 8): whether shape i lies below shape j and overlaps it.

    kind  (n,) kind of each shape. The bit of two shapes of one kind is 0

    The other arguments are those of `colors_together`. np.unpackbits(row, count=n) unpacks row i.
    The bits of 20000 shapes take 50 MB, however many overlap.
    """
    x, y = np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)
    at = mean[:, :1] * x + mean[:, 1:] * y
    reach = np.hypot(factor[:, :1] * x + factor[:, 1:2] * y, factor[:, 2:] * y)
    below = np.zeros((len(mean), -(-len(mean) // 8)), np.uint8)
    for begin in range(0, len(mean), _ROWS):
        rows = slice(begin, begin + _ROWS)
        near = np.triu(kind[rows, None] != kind[begin:], 1)
        for k in _ALONG_SIDES:
            limit = reach[rows, None, k] + reach[begin:, k] + margin
            near &= np.abs(at[rows, None, k] - at[begin:, k]) < limit
        row, column = np.nonzero(near)
        near[:] = False
        for a, r in zip(at[begin:].T, reach[begin:].T, strict=True):
            kept = np.abs(a[row] - a[column]) < r[row] + r[column] + margin
            row, column = row[kept], column[kept]
        near[row, column] = True
        below[rows, begin // 8 :] = np.packbits(near, axis=1)
    return below


def colors_together(
    mean: Floats, factor: Floats, color: NDArray[np.intp], key: Floats, margin: float
) -> NDArray[np.intp]:
    """Return an order (n,) of shapes that looks the same and has few changes of colour.

    All orders of the shapes that look the same lead to one result. A shape is ready once all
    overlapping shapes of other colours below it are drawn. The next colour is the one with the
    largest share of ready shapes. All ready shapes of that colour are then drawn.

    mean    (n, 2) centres of the ellipses that contain the shapes
    factor  (n, 3) l11 l21 l22 of these ellipses
    color   (n, 3) whole levels
    key     (k, n) sort keys within a run of one colour, primary key last
    margin  smallest distance at which two ellipses count as apart
    """
    kind = np.unique(color, axis=0, return_inverse=True)[1].reshape(-1)
    below, undrawn = overlaps(mean, factor, kind, margin), np.ones(len(mean), bool)
    waiting = np.zeros(len(mean), np.intp)  # number of undrawn shapes that each shape waits for
    for row in below:
        waiting += np.unpackbits(row, count=len(mean))
    order = [np.zeros(0, np.intp)]
    while undrawn.any():
        ready = np.bincount(kind[undrawn & (waiting == 0)], minlength=kind.max() + 1)
        share = ready / np.maximum(np.bincount(kind[undrawn], minlength=len(ready)), 1)
        chosen = np.flatnonzero(undrawn & (waiting == 0) & (kind == share.argmax()))
        order.append(chosen[np.lexsort(key[:, chosen])])
        undrawn[chosen] = False
        for row in below[chosen]:
            waiting -= np.unpackbits(row, count=len(mean))
    return np.concatenate(order)
