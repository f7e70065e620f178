"""Circles, ellipses and paths of arcs, as the affine map of the unit circle onto them.

Inkscape makes an ellipse of a circle that is moved by itself, and a path of arcs of one that is
converted ("Object to Path"), whose arcs it keeps through every later transform. Minimal markup
writes many ellipses of one colour as open arcs of one path.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from gauss2svg.errors import InputError, quoted
from gauss2svg.svg.syntax.affine import Affine
from gauss2svg.svg.syntax.values import NUMBER, length

SHAPES = ("circle", "ellipse", "path")
_SEPARATOR = r"[\s,]*"
_MOVE = re.compile(rf"\s*([Mm]){_SEPARATOR}({NUMBER}){_SEPARATOR}({NUMBER}){_SEPARATOR}")
_ARC = re.compile(
    rf"([Aa]?){_SEPARATOR}({NUMBER}){_SEPARATOR}({NUMBER}){_SEPARATOR}({NUMBER})"
    rf"{_SEPARATOR}([01]){_SEPARATOR}([01]){_SEPARATOR}({NUMBER}){_SEPARATOR}({NUMBER}){_SEPARATOR}"
)
_OPEN_ARC = re.compile(
    rf"([Mm])({NUMBER}){_SEPARATOR}({NUMBER})a({NUMBER}){_SEPARATOR}({NUMBER}){_SEPARATOR}({NUMBER})"
    r" 10(1 0|0 1)"
)
# Share of the radius by which the 8 digits that editors write move the ends of a thin arc.
_TOLERANCE = 0.01


def outline(tag: str, attributes: Mapping[str, str]) -> Affine:
    """The map of the unit circle onto a circle, an ellipse or a path that is an ellipse of arcs.

    Raises InputError for a radius under 0 and for any other path.
    """
    if tag == "path":
        return _of_arcs(attributes.get("d", ""))
    if tag == "circle":
        rx = ry = length(attributes.get("r", "0"), "r")
    else:
        rx, ry = (length(attributes.get(name, "0"), name) for name in ("rx", "ry"))
    if rx < 0 or ry < 0:
        raise InputError(f"radii must be 0 or more; got {rx:g} and {ry:g}")
    cx, cy = (length(attributes.get(name, "0"), name) for name in ("cx", "cy"))
    return rx, 0.0, 0.0, ry, cx, cy


def open_arcs(data: str) -> list[Affine]:
    """The ellipses of a path of gauss2svg.svg.minimal.arcs; none for any other path.

    Each arc goes round its ellipse but for a chord of one unit, to the right or down.
    """
    found, at, x, y = [], 0, 0.0, 0.0
    while arc := _OPEN_ARC.match(data, at):
        left, top, rx, ry, tilt = (float(arc[k]) for k in (2, 3, 4, 5, 6))
        x, y = (x + left, y + top) if arc[1] == "m" else (left, top)
        across, down = (1.0, 0.0) if arc[7] == "1 0" else (0.0, 1.0)
        ellipse = _round_chord((rx, ry), math.radians(tilt), (x, y), (across, down))
        if ellipse is None:
            return []
        found.append(ellipse)
        x, y, at = x + across, y + down, arc.end()
    return found if at == len(data) else []


def _round_chord(
    radii: tuple[float, float],
    tilt_rad: float,
    start: tuple[float, float],
    chord: tuple[float, float],
) -> Affine | None:
    """The ellipse of the large arc against the clock over a chord (SVG 2, B.2.4); None without."""
    (rx, ry), (across, down) = radii, chord
    if not (math.isfinite(rx + ry + tilt_rad + start[0] + start[1]) and min(rx, ry) > 0):
        return None
    cos, sin = math.cos(tilt_rad), math.sin(tilt_rad)
    # The chord where the ellipse is the unit circle, and the middle's distance from its centre.
    u, v = (cos * across + sin * down) / rx, (cos * down - sin * across) / ry
    size = math.hypot(u, v)
    if not 0 < size < 2:
        return None
    height = math.sqrt(1 - size * size / 4) / size
    p, q = -height * v * rx, height * u * ry
    x = start[0] + across / 2 + cos * p - sin * q
    y = start[1] + down / 2 + sin * p + cos * q
    return rx * cos, rx * sin, -ry * sin, ry * cos, x, y


def _of_arcs(data: str) -> Affine:
    """The map of a closed path whose arcs all lie on one ellipse and go round it once."""
    radii, corners, sweep = _arcs(data)
    rx, ry, tilt = radii
    # The two or four ends lie symmetrically, so that their mean is the centre. Computing the
    # centre from an arc that is half of the ellipse would lose half of the digits.
    cx, cy = (sum(corner[k] for corner in corners) / len(corners) for k in (0, 1))
    cos, sin = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
    turn, angles = 0.0, []
    for x, y in corners:
        u = (cos * (x - cx) + sin * (y - cy)) / rx
        v = (cos * (y - cy) - sin * (x - cx)) / ry
        if abs(math.hypot(u, v) - 1) > _TOLERANCE:
            raise _not_an_ellipse(data)
        angles.append(math.atan2(v, u))
    for start, end in zip(angles, angles[1:] + angles[:1], strict=True):
        turn += (end - start if sweep else start - end) % (2 * math.pi)
    if abs(turn - 2 * math.pi) > _TOLERANCE:
        raise _not_an_ellipse(data)
    return rx * cos, rx * sin, -ry * sin, ry * cos, cx, cy


def _arcs(data: str) -> tuple[tuple[float, float, float], list[tuple[float, float]], bool]:
    """Radii with the tilt in degrees, corners and direction that all arcs of a path share."""
    move = _MOVE.match(data)
    if move is None:
        raise _not_an_ellipse(data)
    first = x, y = float(move[2]), float(move[3])
    corners, kinds, at, letter = [first], set(), move.end(), ""
    while arc := _ARC.match(data, at):
        letter, at = arc[1] or letter, arc.end()
        relative = letter == "a"
        x, y = (
            float(end) + (start if relative else 0.0)
            for start, end in zip((x, y), arc.group(7, 8), strict=True)
        )
        corners.append((x, y))
        kinds.add((float(arc[2]), float(arc[3]), float(arc[4]), arc[5] == "1", arc[6] == "1"))
    if data[at:].strip().lower() != "z" or not letter or len(kinds) != 1:
        raise _not_an_ellipse(data)
    rx, ry, tilt, large, sweep = kinds.pop()
    if not (0 < rx < math.inf and 0 < ry < math.inf and math.isfinite(tilt)):
        raise _not_an_ellipse(data)
    last = corners[-1]
    if max(abs(last[0] - first[0]), abs(last[1] - first[1])) <= _TOLERANCE * min(rx, ry):
        corners.pop()
    if len(corners) != 2 and (len(corners) != 4 or large):  # halves are neither large nor small
        raise _not_an_ellipse(data)
    return (rx, ry, tilt), corners, sweep


def _not_an_ellipse(data: str) -> InputError:
    return InputError(
        f"its d must be an ellipse of two or four arcs; got {quoted(data)}. Try to undo the "
        "edit of its nodes, or to delete it"
    )
