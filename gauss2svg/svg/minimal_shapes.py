"""The shapes of a minimal file as whole numbers, and the scene that these draw.

Plain ellipses are arcs of a path, many of one colour in one path:

    <path fill="#abc" d="M10 20a8 4 30 101 0m-2 9a3 3 0 100 1"/>

Each arc goes round its ellipse but for a chord of one unit, (1, 0) or (0, 1), which filling closes.
The radii and the tilt in degrees give the centre. All turn the same way, so that a path fills the
union of its ellipses.

Shapes of one colour are drawn after one another where the picture stays the same. Two shapes may
change places if they do not overlap, or if their colours are equal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import number_within, quoted, refusal
from gauss2svg.scene import ADD, LEAST_SIGMA, MOST_SIGMA, PLAIN, RHO_LIMIT, SOFT, Scene
from gauss2svg.scene.falloff import (
    BETA_CLASSES,
    MOST_BETA,
    RIM_WIDTH,
    cut_radius,
    nearest_class,
)
from gauss2svg.svg.blur import with_falloffs
from gauss2svg.svg.element import check_canvas, number, writable
from gauss2svg.svg.plain_ellipse import (
    LEAST_PLAIN_BETA,
    looks_plain,
    plain_beta,
    plain_radius,
)

HEX_DIGITS = (3, 6)
LEAST_UNIT, MOST_UNIT = 0.001, 1e6  # px
OPACITY_DECIMALS = 2


# Masks, gradients and plain ellipses of a minimal file (docs/decisions/minimal.md).
# Most soft shapes that are drawn under masks. More of them are slow.
MOST_MASKED = 500
# Shapes that leave the masks for each shape beyond MOST_MASKED, until none is left. If all left
# at once, the file would grow by a third at one shape more.
FADING = 2
# Px of rim across the major axis under which a shape is a plain ellipse, whose edge, of about a
# pixel, is no crisper.
CRISP_RIM = 1.0


@dataclass(frozen=True)
class Shapes:
    """The n shapes of a file, in painter's order.

    index    (n,) of the shape in its scene
    falloff  (n,) index into BETA_CLASSES, -1 for a plain ellipse
    numbers  (n, 5) whole a b d e f: matrix(a b 0 d e f) of the circle of radius 1; of a plain
             ellipse those of `arc_numbers`
    masked   (n,) whether a shape is soft and drawn under a mask, not by a gradient
    levels   (n, 3) of colour, in 0..255
    opacity  (n,) in 0..1
    """

    index: NDArray[np.intp]
    falloff: NDArray[np.intp]
    numbers: NDArray[np.float64]
    levels: NDArray[np.intp]
    opacity: NDArray[np.float64]
    masked: NDArray[np.bool_]


def shapes_of(
    scene: Scene, unit: float, digits: int, opacity_decimals: int, masked: bool | None = None
) -> Shapes:
    """Shapes of a scene in units of so many px; those written as nothing are left out.

    masked  whether soft shapes are drawn under masks; None: as many of them as masked_count says

    Raises InputError for a unit out of range, other digits than 3 or 6, and an additive scene;
    SceneError for shapes whose numbers do not fit into a file.
    """
    unit = number_within("unit", unit, LEAST_UNIT, MOST_UNIT)
    if digits not in HEX_DIGITS:
        raise refusal("digits", "3 or 6", quoted(digits))
    if scene.blend == ADD:
        advice = "--portable, or --markup editable"
        raise refusal("blend in minimal markup", "'over'", quoted(scene.blend), advice)
    check_canvas(scene)
    kind = nearest_class(scene.beta)
    classes = np.array(BETA_CLASSES)[kind]
    plain = (scene.drawn == PLAIN) | _is_arc(scene.ellipse_axes[0], scene.beta)
    opacity = np.round(scene.opacity, opacity_decimals)
    while True:
        snapped = with_falloffs(scene, np.where(plain, scene.beta, classes))
        radius = _radius(snapped.beta, plain)
        numbers = _matrix(snapped, radius, unit)
        numbers[plain] = arc_numbers(snapped.select(plain), radius[plain], unit)
        extent = np.where(plain, numbers[:, :2].min(axis=1), numbers[:, 0] * numbers[:, 2])
        drawn = writable(snapped, radius, unit) & (extent > 0) & (opacity > 0)
        # Shapes that are plain only as they are rounded, so that a rounded scene stays as it is.
        soft = np.flatnonzero(drawn & ~plain)
        placed = _placed(snapped.select(soft), numbers[soft], radius[soft], unit)
        more = soft[_is_arc(placed.ellipse_axes[0], placed.beta)]
        if not len(more):
            break
        plain[more] = True
    index = np.flatnonzero(drawn)
    levels = color_levels(scene.color[index], digits)
    falloff = np.where(plain, -1, kind)[index]
    order = np.arange(len(index))
    if not (falloff >= 0).all():
        mean, factor = _geometry(numbers[index], falloff < 0)
        keys = np.stack([mean[:, 0], mean[:, 1], falloff])
        order = colors_together(mean, factor, levels, keys, 1 / unit)
    index, falloff, levels = index[order], falloff[order], levels[order]
    soft = np.flatnonzero(falloff >= 0)
    count = masked_count(len(soft)) if masked is None else int(masked) * len(soft)
    under = np.zeros(len(index), bool)
    # The upper ones, which are smaller and quicker to paint.
    under[soft[len(soft) - count :]] = True
    return Shapes(index, falloff, numbers[index], levels, opacity[index], under)


def masked_count(soft: int) -> int:
    """Return how many of so many soft shapes are drawn under masks."""
    most = MOST_MASKED
    return soft if soft <= most else max(most - FADING * (soft - most), 0)


def rounded_scene(scene: Scene, shapes: Shapes, unit: float, digits: int) -> Scene:
    """The scene that a file with these shapes of a scene draws."""
    plain = shapes.falloff < 0
    beta = np.array([*BETA_CLASSES, 1.0])[shapes.falloff]
    beta[plain] = arc_beta(np.sort(unit * shapes.numbers[plain, :2], axis=1)[:, ::-1])
    # A minimal file has no layers, and its painter's order is not that of the rounds.
    one_round = scene.replace(round_index=np.zeros_like(scene.round_index))
    rounded = one_round.select(shapes.index).replace(
        color=shapes.levels / 255,
        opacity=shapes.opacity,
        background=color_levels(scene.background, digits) / 255,
        beta=beta,
        drawn=np.where(plain, PLAIN, SOFT),
    )
    return _placed(rounded, shapes.numbers, _radius(beta, plain), unit, plain)


def arc_beta(semi_axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) exponents of arcs round ellipses of semi_axes (n, 2) px, larger first.

    That which a plain ellipse draws best, or the crispest where a shape of the best one would be
    written as a soft shape: a thin one.
    """
    beta = plain_beta(semi_axes)
    axes = semi_axes / plain_radius(beta)[:, None]
    return np.where(_is_arc(axes, beta), beta, MOST_BETA)


def color_levels(color: NDArray[np.float64], digits: int) -> NDArray[np.intp]:
    """Levels in 0..255 of colours that so many hex digits can say; any shape."""
    most = 15 if digits == HEX_DIGITS[0] else 255
    return np.round(color * most).astype(np.intp) * (255 // most)


def _is_arc(axes: NDArray[np.float64], beta: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(n,) whether an arc draws shapes of such one-sigma axes: nearly their rim, or a wider one."""
    across = RIM_WIDTH * axes[:, 0] / beta
    crisp = (beta >= LEAST_PLAIN_BETA) & (across < CRISP_RIM)
    return looks_plain(axes, beta) | crisp


def _radius(beta: NDArray[np.float64], plain: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(n,) radius in sigmas of the circle that is drawn."""
    radius = cut_radius(beta)
    radius[plain] = plain_radius(beta[plain])
    return radius


def _matrix(scene: Scene, radius: NDArray[np.float64], unit: float) -> NDArray[np.float64]:
    """(n, 5) whole numbers of units a b d e f, for circles of radius (n,) sigmas."""
    factor = scene.factor * radius[:, None, None]
    entries = [factor[:, 0, 0], factor[:, 1, 0], factor[:, 1, 1], *scene.mean.T]
    return np.round(np.column_stack(entries) / unit) + 0.0  # no -0


def _geometry(
    numbers: NDArray[np.float64], plain: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres (n, 2) and factors (n, 3) of what is drawn, in units."""
    mean, factor = numbers[:, 3:].copy(), numbers[:, :3].copy()
    mean[plain], factor[plain] = arc_geometry(numbers[plain])
    return mean, factor


def _placed(
    scene: Scene,
    numbers: NDArray[np.float64],
    radius: NDArray[np.float64],
    unit: float,
    plain: NDArray[np.bool_] | None = None,
) -> Scene:
    """The scene with the geometry of such numbers; plain is where they are of arcs."""
    mean, factor = _geometry(numbers, np.zeros(len(scene), bool) if plain is None else plain)
    a, b, d = unit * factor.T
    sigma = np.column_stack([a, np.hypot(b, d)]) / radius[:, None]
    return scene.replace(
        mean=unit * mean,
        sigma=np.clip(sigma, LEAST_SIGMA, MOST_SIGMA),
        rho=np.clip(b / np.hypot(b, d), -RHO_LIMIT, RHO_LIMIT),
    )


_TILT_DECIMALS = 1  # of long ellipses; of the others none


def arc_numbers(scene: Scene, radius: NDArray[np.float64], unit: float) -> NDArray[np.float64]:
    """(n, 5) radii and start in whole units and the tilt between: rx ry tilt x y.

    radius  (n,) of the ellipses in sigmas
    The tilt of the first radius is in (-45, 45] degrees, whole or for long ellipses with a decimal;
    0 for circles. A radius of 0 is a shape that no arc can draw.
    """
    axes, angle_rad = scene.ellipse_axes
    radii = np.round(axes * radius[:, None] / unit)
    tilt = np.degrees(angle_rad)
    # From 60 units between radii on half a degree of tilt moves the far end by half a unit.
    decimals = np.where(radii[:, 0] - radii[:, 1] > 60.0, _TILT_DECIMALS, 0)
    tilt = np.round(tilt * 10.0**decimals) / 10.0**decimals
    steep = (tilt <= -45) | (tilt > 45)
    radii[steep] = radii[steep, ::-1]
    tilt[steep] -= np.where(tilt[steep] > 0, 90.0, -90.0)
    tilt[radii[:, 0] == radii[:, 1]] = 0.0
    offset, _ = _from_start(radii, tilt)
    start = np.round(scene.mean / unit - offset)
    return np.column_stack([radii, tilt, start]) + 0.0  # no -0


def arc_geometry(numbers: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres (n, 2) and Cholesky factors (n, 3) l11 l21 l22 of ellipses, in units."""
    (rx, ry), tilt_rad = numbers[:, :2].T, np.radians(numbers[:, 2])
    co, si = np.cos(tilt_rad), np.sin(tilt_rad)
    l11 = np.hypot(rx * co, ry * si)
    factor = np.column_stack([l11, (rx * rx - ry * ry) * co * si / l11, rx * ry / l11])
    return numbers[:, 3:] + _from_start(numbers[:, :2], numbers[:, 2])[0], factor


def path_data(numbers: NDArray[np.float64]) -> str:
    """The d of a path of arcs."""
    text, (x, y) = "", (np.nan, np.nan)
    _, chords = _from_start(numbers[:, :2], numbers[:, 2])
    for (rx, ry, tilt, start_x, start_y), chord in zip(numbers, chords, strict=True):
        move = f"M{number(start_x, 0)} {number(start_y, 0)}"
        if text:
            move = min(f"m{number(start_x - x, 0)} {number(start_y - y, 0)}", move, key=len)
        flags_and_end = "101 0" if chord[0] else "100 1"  # the large arc, against the clock
        text += f"{move}a{number(rx, 0)} {number(ry, 0)} {number(tilt, _TILT_DECIMALS)}"
        text += " " + flags_and_end
        x, y = start_x + chord[0], start_y + chord[1]
    return text.replace(" -", "-")


def _from_start(
    radii: NDArray[np.float64], tilt: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Offsets (n, 2) in units from each arc's start to the centre of its ellipse, and to its end.

    The chord that is shorter where the ellipse is mapped onto the unit circle cuts off less; u is
    that chord there, and the centre lies beside its middle (SVG 2, implementation notes, B.2.4).
    """
    tilt_rad, radii = np.radians(tilt), np.maximum(radii, 1.0)
    co, si = np.cos(tilt_rad), np.sin(tilt_rad)
    onto = np.array([[co, -si], [si, co]]).transpose(2, 0, 1) * radii[:, None, :]
    across, down = (
        np.hypot(co / radii[:, 0], si / radii[:, 1]),
        np.hypot(si / radii[:, 0], co / radii[:, 1]),
    )
    level = across <= down + 1e-9  # alike for circles
    chord = np.column_stack([level, ~level]).astype(np.float64)
    u = np.einsum("nji,nj->ni", onto / np.square(radii)[:, None, :], chord)
    length = np.where(level, across, down)
    height = np.sqrt(np.maximum(1 - np.square(length) / 4, 0)) / length
    center = height[:, None] * np.column_stack([-u[:, 1], u[:, 0]])
    return chord / 2 + np.einsum("nij,nj->ni", onto, center), chord


_DIRECTIONS = 12  # along which the projections of two ellipses are compared
_ROWS = 256  # of all pairs at a time, which else take eight bytes each


def overlaps(
    mean: NDArray[np.float64], factor: NDArray[np.float64], margin: float
) -> NDArray[np.bool_]:
    """(n, n) whether the shape of a row lies below that of a column and is not apart from it.

    Arguments are those of `colors_together`.
    """
    count = len(mean)
    below = np.triu(np.ones((count, count), bool), 1)
    # First the two along the sides of a picture, after which few pairs are left.
    steps = sorted(range(_DIRECTIONS), key=lambda k: k % (_DIRECTIONS // 2))
    at, reach = [], []
    for angle_rad in np.array(steps) * np.pi / _DIRECTIONS:
        x, y = np.cos(angle_rad), np.sin(angle_rad)
        at.append(mean @ [x, y])
        reach.append(np.hypot(factor[:, 0] * x + factor[:, 1] * y, factor[:, 2] * y))
    for begin in range(0, count, _ROWS):
        rows = slice(begin, begin + _ROWS)
        block = below[rows, begin:]
        for a, r in zip(at[:2], reach[:2], strict=True):
            block &= np.abs(a[rows, None] - a[begin:]) < r[rows, None] + r[begin:] + margin
        row, column = np.nonzero(block)
        for a, r in zip(at[2:], reach[2:], strict=True):
            a, r = a[begin:], r[begin:]
            near = np.abs(a[row] - a[column]) < r[row] + r[column] + margin
            row, column = row[near], column[near]
        block[:] = False
        block[row, column] = True
    return below


def colors_together(
    mean: NDArray[np.float64],
    factor: NDArray[np.float64],
    color: NDArray[np.intp],
    key: NDArray[np.float64],
    margin: float,
) -> NDArray[np.intp]:
    """(n,) order of n shapes with few changes of colour; it does not depend on equivalent orders.

    mean    (n, 2); factor (n, 3) l11 l21 l22 of the ellipses that the shapes stay in
    color   (n, 3) whole levels
    key     (k, n) by which those of a run are sorted, the last row first
    margin  of lengths, from which two ellipses count as apart
    From below: a colour all of whose shapes can be drawn, else the one of the largest share.
    """
    kind = np.unique(color, axis=0, return_inverse=True)[1].reshape(-1)
    below = overlaps(mean, factor, margin) & (kind[:, None] != kind)
    waiting, left = below.sum(axis=0), np.ones(len(mean), bool)
    order = []
    while left.any():
        ready = np.bincount(kind[left & (waiting == 0)], minlength=kind.max() + 1)
        share = ready / np.maximum(np.bincount(kind[left], minlength=len(ready)), 1)
        chosen = np.flatnonzero(left & (waiting == 0) & (kind == share.argmax()))
        order.append(chosen[np.lexsort(key[:, chosen])])
        left[chosen] = False
        waiting -= below[chosen].sum(axis=0)
    return np.concatenate(order) if order else np.zeros(0, np.intp)
