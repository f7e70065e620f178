"""One shape of a file: its colour, exponent and opacity, and the ellipse of a known radius of it.

Four forms are read, distinguished by what fills them: a gradient, a plain colour, a plain colour
under a blur, and one under a mask of minimal markup.

An outline is the affine map of the unit circle onto a circle, an ellipse or a path of arcs.
Inkscape makes an ellipse of a circle that is moved by itself, and a path of arcs of one that is
converted ("Object to Path"), whose arcs it keeps through every later transform. Minimal markup
writes many ellipses of one colour as open arcs of one path.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gauss2svg.errors import InputError, quoted
from gauss2svg.scene import BLURRED, PLAIN, SOFT
from gauss2svg.scene.falloff import cut_radius
from gauss2svg.svg.blur import BLURS, blur_of
from gauss2svg.svg.reader.gradient import Gradient, Gradients
from gauss2svg.svg.syntax.parse import SVG
from gauss2svg.svg.syntax.values import (
    NUMBER,
    Affine,
    Color,
    color,
    compose,
    length,
    numbers,
    reference,
)

_LEAST_RATIO = 1e-6  # of a radius to a deviation, and its inverse: write_svg writes none so extreme
# Standard deviations around a circle that its filter region must include: write_svg writes 3.5,
# of which Inkscape keeps 2.4, where two levels are left.
_REACH = 2.3
# Values that a blur's attributes may have: it filters the whole circle on a transparent ground.
_STEP = {"in": "SourceGraphic", "edgeMode": "none", "x": "", "y": "", "width": "", "height": ""}


@dataclass(frozen=True)
class Shape:
    """One shape: the circle of `radius` sigmas is `disc` of the unit circle, in canvas px.

    beta and radius are None for a plain ellipse, which any crisp enough exponent draws; peak is a
    factor of its opacity, drawn as in a scene.
    """

    color: Color
    disc: Affine
    beta: float | None
    radius: float | None
    peak: float = 1.0
    drawn: int = SOFT


def read_shape(
    edge: Affine,
    fill: str,
    onto: Affine,
    gradients: Gradients,
    blur: Any | None,
    mask: Any | None,
) -> Shape:
    """The shape of an ellipse, the map `edge` of the unit circle, that `onto` maps to canvas px.

    blur and mask are the elements that it refers to, or None.
    Raises InputError for a shape that write_svg would not write.
    """
    key = reference(fill)
    if blur is not None:
        if key is not None or not _is_circle(edge):
            raise InputError(
                "it must be a circle of one colour, as it is blurred; got another. Try to "
                "remove its filter"
            )
        deviation = _deviation(blur)
        beta, radius, peak = blurred_profile(edge[0], deviation)
        _check_region(blur, edge, deviation)
        return Shape(color(fill, "fill"), compose(onto, edge), beta, radius, peak, BLURRED)
    if mask is not None:
        gradient = _of_mask(mask, edge, gradients)
        check_cover(compose(onto, edge), compose(onto, gradient.disc))
        return _shaded(gradient, compose(onto, gradient.disc), color(fill, "fill"))
    if key is None:
        return Shape(color(fill, "fill"), compose(onto, edge), None, None, drawn=PLAIN)
    gradient = gradients.get(key)
    disc = in_user_space(gradient.disc, edge) if gradient.in_box else gradient.disc
    disc, edge = compose(onto, disc), compose(onto, edge)
    check_cover(edge, disc)
    return _shaded(gradient, disc, gradient.color)


def in_user_space(disc: Affine, edge: Affine) -> Affine:
    """A disc in the bounding box of an upright ellipse; raises InputError for a tilted one."""
    if edge[1] or edge[2]:
        raise InputError("units of its gradient must be userSpaceOnUse; got a tilted bounding box")
    rx, _, _, ry, cx, cy = edge
    return compose((2 * rx, 0.0, 0.0, 2 * ry, cx - rx, cy - ry), disc)


def _is_circle(edge: Affine) -> bool:
    return edge[0] == edge[3] and not edge[1] and not edge[2]


def _of_mask(mask: Any, edge: Affine, gradients: Gradients) -> Gradient:
    """The falloff of a mask that is one circle, the same as what is under it."""
    inside = list(mask)
    circle = inside[0].attrib if len(inside) == 1 and inside[0].tag == SVG + "circle" else {}
    key = reference(circle.get("fill", ""))
    same = set(circle) == {"r", "fill"} and set(mask.attrib) == {"id"}
    if key is None or not same or outline("circle", circle) != edge:
        raise InputError(
            "its mask must be the same circle, as write_svg writes it; got another mask"
        )
    gradient = gradients.get(key, in_mask=True)
    if gradient.in_box:
        raise InputError("units of its gradient must be userSpaceOnUse; got its box")
    return gradient


def _shaded(gradient: Gradient, disc: Affine, paint: Color) -> Shape:
    radius = float(cut_radius(gradient.beta))
    return Shape(paint, disc, gradient.beta, radius, gradient.peak)


def blurred_profile(radius: float, deviation: float) -> tuple[float, float, float]:
    """Exponent, radius in sigmas and centre opacity of a circle of `radius`, blurred.

    Both lengths are in user units of the circle. Raises InputError for other ratios.
    """
    ratio = radius / deviation
    if not _LEAST_RATIO < ratio < 1 / _LEAST_RATIO:
        raise InputError(
            f"its blur must be one of write_svg; got a radius of {radius:g} and a deviation of "
            f"{deviation:g}. Try to remove its filter"
        )
    blur = min(BLURS, key=lambda known: abs(math.log(ratio * known.deviation)))
    # Within half a percent a ratio is a known one, rounded by an editor.
    if abs(ratio * blur.deviation - 1) > 0.005:
        blur = blur_of(ratio)
    return blur.beta, blur.radius, 1 / blur.peak


def _deviation(blur: Any) -> float:
    """Standard deviation of a filter that is one Gaussian blur; raises InputError for others."""
    steps = list(blur)
    if len(steps) != 1 or steps[0].tag != SVG + "feGaussianBlur":
        raise InputError(
            f"its filter must be one feGaussianBlur; got {len(steps)} steps. Try to remove it"
        )
    units = blur.get("primitiveUnits", "userSpaceOnUse")
    if units != "userSpaceOnUse":
        raise InputError(
            f"primitiveUnits of its filter must be userSpaceOnUse; got {quoted(units)}. Try to "
            "remove it"
        )
    for name, needed in _STEP.items():
        if steps[0].get(name, needed) != needed:
            raise InputError(
                f"{name} of its blur must be {needed or 'absent'}; got "
                f"{quoted(steps[0].get(name))}. Try to remove its filter"
            )
    deviation = set(numbers(steps[0].get("stdDeviation", ""), "stdDeviation"))
    if len(deviation) != 1 or min(deviation) <= 0:
        raise InputError(
            "its stdDeviation must be one number above 0; got "
            f"{quoted(steps[0].get('stdDeviation'))}. Try to remove its filter"
        )
    return deviation.pop()


def _check_region(blur: Any, edge: Affine, deviation: float) -> None:
    """Raise InputError for a filter region that cuts the blur of a circle off."""
    radius, center = abs(edge[0]), edge[4:]
    units = blur.get("filterUnits", "objectBoundingBox")
    in_box = units == "objectBoundingBox"
    whole = 1.0 if in_box else None  # write_svg writes no percentage of the viewport
    for axis, (start, extent) in enumerate((("x", "width"), ("y", "height"))):
        low, size = (
            length(blur.get(name, usual), name, whole)
            for name, usual in ((start, "-10%"), (extent, "120%"))
        )
        if in_box:
            low, size = center[axis] + (2 * low - 1) * radius, 2 * radius * size
        beyond = min(center[axis] - low, low + size - center[axis]) - radius
        if beyond < _REACH * deviation:
            raise InputError(
                f"{start} and {extent} of its filter must be at least {_REACH:g} standard "
                f"deviations around the circle; got {beyond / deviation:.2g}. Try to enlarge "
                "them"
            )


def check_cover(edge: Affine, disc: Affine) -> None:
    """Raise InputError unless an ellipse shows all of its gradient, which ends inside of it."""
    a, b, c, d, e, f = edge
    determinant = a * d - b * c
    if determinant == 0 or not math.isfinite(determinant):
        return  # draws nothing; the reader refuses its extent
    # The larger axis and the centre of the gradient's disc, in units where the ellipse is a circle.
    p, q, r, s, t, u = disc
    back = d / determinant, -b / determinant, -c / determinant, a / determinant, 0.0, 0.0
    k, m, n, o, x, y = compose(back, (p, q, r, s, t - e, u - f))
    larger = 0.5 * (math.hypot(k + o, m - n) + math.hypot(k - o, m + n))
    beyond = larger + math.hypot(x, y) - 1
    minor = abs(0.5 * (math.hypot(a + d, b - c) - math.hypot(a - d, b + c)))
    # Rounding may cut off so many px of the canvas.
    if beyond * minor > 0.05:
        raise InputError(
            "the ellipse must show all of its gradient; got one that cuts off "
            f"{beyond * minor:.3g} px. Try to move both together (in Inkscape: switch on that "
            "gradients move along with objects), or to undo"
        )


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
    """The ellipses of a path of gauss2svg.svg.minimal_shapes; none for any other path.

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
