"""Plain ellipses as arcs of a path, many of one colour in one path.

    <path fill="#abc" d="M10 20a8 4 30 101 0m-2 9a3 3 0 100 1"/>

Each arc goes round its ellipse but for a chord of one unit, (1, 0) or (0, 1), which filling
closes; the radii and the tilt in degrees give the centre. All turn the same way, so that a path
fills the union of its ellipses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import Scene
from gauss2svg.svg.element import number

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
