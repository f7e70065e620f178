"""Read the path data, the stroke and the gradient of an area or a line.

Path data have lines and curves, absolute or relative, as editors write them too. Arcs and quadratic
curves become cubic ones, and other elements become path data. Relative coordinates are added up in
user units. Write_svg writes these as whole numbers, so the sums are exact.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.errors import quoted, refusal
from gauss2svg.scene.areas import (
    MOST_COORDINATE,
    Cap,
    LinearGradient,
    Outline,
    Paint,
    Point,
    RadialGradient,
)
from gauss2svg.svg.file import NUMBER, SVG, numbers
from gauss2svg.svg.read_shapes import (
    ARC,
    Affine,
    color_of,
    compose,
    disc_of,
    share_of,
    styled,
    transform_of,
)

# Attributes of areas and lines that elements inherit, those of the fill apart.
INHERITED = {"stroke", "stroke-width", "stroke-opacity", "stroke-linecap", "stroke-linejoin"}
INHERITED |= {"stroke-miterlimit", "stroke-dasharray", "fill-rule", "paint-order"}
_COMMAND = re.compile(rf"[\s,]*+([MmLlHhVvCcSsQqTtAaZz])((?:[\s,]*+{NUMBER})*+)[\s,]*+")
_COMMANDS = re.compile(rf"(?=\s*+[Mm])(?:{_COMMAND.pattern})++")
_ARCS = re.compile(rf"(?:{ARC.pattern})++")
# How many numbers a command has
_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
_SMOOTH = {"S": "C", "T": "Q"}  # commands whose first handle reflects that of the one before
_BOX = {"x1": "0", "y1": "0", "x2": "1", "y2": "0", "cx": ".5", "cy": ".5", "r": ".5"}
_STEPS = 8  # number of straight pieces that stand for a curve where exactness does not matter
_SAMPLES = 32  # places along each axis at which two fill rules are compared
# Largest number of places times pieces that are compared, in about a second, and at once
_MOST_PIECES, _MOST_AT_ONCE = 10**8, 10**6
_ENDS: dict[tuple[str, str], Cap] = {
    ("butt", "miter"): "butt",
    ("round", "round"): "round",
    ("square", "miter"): "square",
}
# A gradient may be turned by this, and a stroke be stretched by this, as a share of its size,
# because editors round numbers.
_TOLERANCE = 1e-4
# If the last point of an outline is as near to the first, in user units, the outline ends there.
_SAME_POINT = 1e-6
_SAME: Affine = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)  # the map that moves no point


def data_of(tag: str, attributes: Mapping[str, str]) -> str:
    """Return the path data of a path, or of another element that draws a path."""
    if tag == "path":
        return attributes.get("d", "")
    if tag in ("polygon", "polyline"):
        return f"M{attributes.get('points', '')}{'z' * (tag == 'polygon')}"

    def number(name: str, default: str = "0") -> float:
        return numbers(attributes.get(name, default), name, 1)[0]

    if tag == "line":
        return f"M{number('x1')} {number('y1')}L{number('x2')} {number('y2')}"
    if tag == "rect":
        width, height = max(number("width"), 0.0), max(number("height"), 0.0)
        rx = number("rx", attributes.get("ry", "0"))
        rx, ry = min(rx, width / 2), min(number("ry", str(rx)), height / 2)
        x, y, across, down = number("x"), number("y"), width - 2 * rx, height - 2 * ry
        if rx <= 0 or ry <= 0:
            return f"M{x} {y}h{width}v{height}h{-width}z"
        sides = (f"h{across}", f"v{down}", f"h{-across}", f"v{-down}")
        corners = ((rx, ry), (-rx, ry), (-rx, -ry), (rx, -ry))
        parts = (
            side * (float(side[1:]) != 0) + f"a{rx} {ry} 0 0 1 {u} {v}"
            for side, (u, v) in zip(sides, corners, strict=True)
        )
        return f"M{x + rx} {y}{''.join(parts)}z"
    rx, ry = (number("r"),) * 2 if tag == "circle" else (number("rx"), number("ry"))
    halves = f"a{rx} {ry} 0 0 1 {2 * rx} 0a{rx} {ry} 0 0 1 {-2 * rx} 0z"
    return f"M{number('cx') - rx} {number('cy')}{halves}"


def outlines_of(data: str, onto: Affine, is_filled: bool) -> tuple[Outline, ...]:
    """Return the outlines of path data, in px. A filled outline is closed even without z.

    onto  map from user space to px

    Raise InputError if the data are no path.
    """
    outlines = list[Outline]()
    a, b, c, d, e, f = onto

    def add(points: list[Point], curved: list[bool], closed: bool) -> None:
        if not curved:
            return
        if closed and portable.hypot(*np.subtract(points[0], points[-1])) > _SAME_POINT:
            curved = [*curved, False]
        elif closed:
            points = points[:-1]
        places = tuple((a * x + c * y + e, b * x + d * y + f) for x, y in points)
        outlines.append(Outline(places, tuple(curved), closed))

    points, curved, handle, before = [(0.0, 0.0)], list[bool](), (0.0, 0.0), ""
    for letter, values in _commands(data):
        here, kind = points[-1], letter.upper()
        left, top = here if letter.islower() else (0.0, 0.0)
        if kind == "Z":
            add(points, curved, True)
            points, curved, before = points[:1], [], kind
            continue
        if kind == "H":
            ends = [(left + values[0], here[1])]
        elif kind == "V":
            ends = [(here[0], top + values[0])]
        else:
            pairs = values[5:] if kind == "A" else values
            ends = [(left + x, top + y) for x, y in zip(pairs[::2], pairs[1::2], strict=True)]
        if kind == "M":
            add(points, curved, is_filled)
            points, curved, before = ends, [], kind
            continue
        if kind in _SMOOTH:
            ends.insert(0, handle if _SMOOTH[kind] == before else here)
        if len(ends) > 1:
            (u, v), (x, y) = ends[-2:]
            handle = 2 * x - u, 2 * y - v
        before = _SMOOTH.get(kind, kind)
        if before == "Q":
            control, end = ends
            ends = [*(_between(side, control) for side in (here, end)), end]
        if kind == "A":
            ends = _arc(here, values[:5], ends[0])
        points += ends
        curved += [True] * (len(ends) // 3) if len(ends) != 1 else [False]
    add(points, curved, is_filled)
    if not outlines:
        needed = "an ellipse of four arcs, or lines and curves"
        raise refusal("its d", needed, quoted(data), "to undo the edit of its nodes")
    return tuple(outlines)


def _between(end: Point, control: Point) -> Point:
    """Return the handle of a cubic curve that draws a quadratic one, on the side of `end`."""
    return (end[0] + 2 * control[0]) / 3, (end[1] + 2 * control[1]) / 3


def _arc(start: Point, form: list[float], end: Point) -> list[Point]:
    """Return the handles and ends of cubic curves that draw an arc (SVG 2, appendix B.2).

    form  radii, tilt in degrees, and the two flags
    """
    (rx, ry), (tilt, is_large, is_sweep) = map(abs, form[:2]), form[2:]
    if start == end:
        return []
    # A flat arc is a line. An outline with larger coordinates is refused.
    is_held = all(abs(value) <= MOST_COORDINATE for value in (*start, *end, rx, ry))
    if not is_held or min(rx, ry) < 1 / MOST_COORDINATE:
        return [end]
    turn, half = _turn(math.radians(tilt)), (complex(*start) - complex(*end)) / 2
    turned = half / turn
    # On the unit circle, whose origin is the middle of the chord here, the chord begins at `chord`.
    chord = complex(turned.real / rx, turned.imag / ry)
    length = float(portable.hypot(chord.real, chord.imag))
    growth = max(length, 1.0)  # radii that are too small grow
    rx, ry, chord = rx * growth, ry * growth, chord / growth
    side = 1j if is_large == is_sweep else -1j
    center = side * chord * math.sqrt(max(1 / length**2 - 1, 0.0))
    first, last = (
        portable.arctan2(place.imag, place.real) for place in (chord - center, -chord - center)
    )
    angle = (last - first) % math.tau - (0 if is_sweep else math.tau)
    count = max(math.ceil(abs(angle) / (math.pi / 2) - 1e-9), 1)
    step = angle / count
    half = _turn(step / 4)
    reach, places = 4 / 3 * half.imag / half.real * 1j, list[complex]()
    for k in range(count):
        u, v = (_turn(first + (k + j) * step) for j in (0, 1))
        places += [u + reach * u, v - reach * v, v]
    middle = (complex(*start) + complex(*end)) / 2
    drawn = [center + place for place in places]
    drawn = [middle + turn * complex(rx * place.real, ry * place.imag) for place in drawn]
    return [*((place.real, place.imag) for place in drawn[:-1]), end]


def _turn(angle_rad: float) -> complex:
    return complex(portable.cos(angle_rad), portable.sin(angle_rad))


def _commands(data: str) -> list[tuple[str, list[float]]]:
    """Return the letter and the numbers of each command. Return [] if the data are no known path.

    A command that is repeated without its letter is returned with it.
    """
    commands = []
    for letter, text in _COMMAND.findall(data) if _COMMANDS.fullmatch(data) else ():
        texts, count = re.findall(NUMBER, text), _COUNTS[letter.upper()]
        if letter in "Aa":  # the flags of an arc need no blanks around them
            texts = [n for arc in ARC.findall(text) for n in arc[1:]] if _ARCS.match(text) else []
        values = list(map(float, texts))
        if bool(values) != bool(count) or len(values) % (count or 1):
            return []
        for k in range(0, len(values) or 1, count or 1):
            name = {"M": "L", "m": "l"}.get(letter, letter) if k else letter
            commands.append((name, values[k : k + count]))
    return commands


def nonzero(outlines: tuple[Outline, ...]) -> tuple[Outline, ...]:
    """Return outlines that the fill rule nonzero fills as the rule evenodd fills `outlines`.

    Each runs the other way than the outline around it. Raise InputError if that is not enough,
    because outlines cross.
    """
    polygons = [_polygon(outline) for outline in outlines]
    if (len(polygons) + _SAMPLES**2) * sum(map(len, polygons)) > _MOST_PIECES:
        got = f"{len(polygons)} outlines"
        raise refusal("a path of the fill-rule evenodd", "of fewer outlines", got, "to split it")
    points = np.concatenate(polygons)
    axes = np.linspace(points.min(axis=0), points.max(axis=0), _SAMPLES + 2)[1:-1].T
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    run = np.array([_area(polygon) for polygon in polygons])
    inside = np.array([_inside(polygon, sign) for polygon, sign in zip(polygons, run, strict=True)])
    depth, before, after = np.zeros(len(run), int), np.zeros(len(places)), np.zeros(len(places))
    for k, polygon in enumerate(polygons):
        depth += (_windings(polygon, inside) % 2 != 0) & (np.arange(len(run)) != k)
    forward = (run > 0) == (depth % 2 == 0)
    for polygon, is_forward in zip(polygons, forward, strict=True):
        winding = _windings(polygon, places)
        before, after = before + winding, after + (winding if is_forward else -winding)
    if ((before % 2 != 0) != (after != 0)).any():
        raise refusal("its fill-rule", "nonzero where outlines cross", "'evenodd'", "to split it")
    return tuple(
        outline if is_forward
        else Outline.of_segments(outline.segments[::-1, ::-1].tolist(), outline.curved[::-1])
        for outline, is_forward in zip(outlines, forward, strict=True)
    )  # fmt: skip


def _polygon(outline: Outline) -> NDArray[np.float64]:
    """Return points (m, 2) along a closed outline, whose curves become straight pieces."""
    t = np.arange(_STEPS)[:, None] / _STEPS
    weights = np.concatenate([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=1)
    points = (weights[..., None] * outline.segments[:, None]).sum(axis=2)
    return points[np.array(outline.curved)[:, None] | (np.arange(_STEPS) == 0)]


def _area(polygon: NDArray[np.float64]) -> float:
    """Return the area of a polygon, above 0 if it turns from x to y."""
    (x, y), (u, v) = polygon.T, np.roll(polygon, -1, axis=0).T
    return float((x * v - u * y).sum()) / 2


def _inside(polygon: NDArray[np.float64], area: float) -> NDArray[np.float64]:
    """Return a point (2,) that is just inside of a polygon, beside the middle of a longest edge."""
    edges = np.roll(polygon, -1, axis=0) - polygon
    k = int(np.argmax(np.square(edges).sum(axis=1)))
    normal = np.array([-edges[k, 1], edges[k, 0]])
    return polygon[k] + edges[k] / 2 + 1e-4 * np.sign(area) * normal


def _windings(polygon: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return how often a polygon runs around each of the points (n, 2)."""
    (x, y), (u, v) = polygon.T, np.roll(polygon, -1, axis=0).T
    turns = np.sign(v - y)
    with np.errstate(all="ignore"):  # edges along x have no slope, and are never crossed
        slope = (u - x) / (v - y)
        parts = []
        for part in np.array_split(points, 1 + points.size * len(polygon) // _MOST_AT_ONCE):
            across, down = part.T[:, :, None]
            crossed = (y <= down) != (v <= down)
            parts.append(
                np.where(crossed & (x + (down - y) * slope > across), turns, 0).sum(axis=1)
            )
    return np.concatenate(parts)


def stroke_of(
    style: Mapping[str, str], outlines: Iterable[Outline], onto: Affine, root: Affine
) -> tuple[float, Cap]:
    """Return the width in px and the ends of a stroke along outlines.

    onto, root  maps from user space to px, of the path and of the root

    Raise InputError if a line cannot have such a stroke, or if its width is not even. The map of
    the root is taken as even, because minimal markup rounds the sides of the canvas.
    """
    cap, join = style.get("stroke-linecap", "butt"), style.get("stroke-linejoin", "miter")
    if all(outline.closed for outline in outlines):  # closed outlines have no ends
        cap = "round" if join == "round" else "butt"
    elif all(len(outline.curved) == 1 for outline in outlines):  # one segment has no corners
        join = "round" if cap == "round" else "miter"
    usual = {"stroke-dasharray": "none"} | ({"stroke-miterlimit": "4"} if join == "miter" else {})
    for name, needed in usual.items():
        if (value := style.get(name, needed)) != needed:
            raise refusal(f"its {name}", needed, quoted(value), "to remove it")
    ends = cap, join
    if ends not in _ENDS:
        needed = "butt and miter, round and round, or square and miter"
        advice = "to convert the stroke to a path"
        raise refusal("its stroke-linecap and stroke-linejoin", needed, " and ".join(ends), advice)
    text = style.get("stroke-width", "1")
    width = numbers(text.removesuffix("px"), "stroke-width", 1)[0]
    if not width > 0:
        raise refusal("its stroke-width", "above 0", quoted(text), "to delete it")
    a, b, c, d = onto[0] / root[0], onto[1] / root[3], onto[2] / root[0], onto[3] / root[3]
    across, down = portable.hypot(a, b), portable.hypot(c, d)
    is_even = abs(across - down) <= _TOLERANCE * down
    if not is_even or abs(a * c + b * d) > _TOLERANCE * across * down:
        advice = "to convert the stroke to a path"
        raise refusal("transforms of a stroke", "without stretching and skewing", "others", advice)
    return width * across * math.sqrt(abs(root[0] * root[3])), _ENDS[ends]


def _share(text: str) -> str:
    """Return a percentage as the text of a number, and any other text unchanged."""
    return f"{numbers(text[:-1], 'a gradient', 1)[0] / 100}" if text.endswith("%") else text


def gradient_of(
    tag: str, values: Mapping[str, str], stops: Iterable[Any], data: str, onto: Affine
) -> Paint:
    """Return the gradient of an area, in px. A gradient of one stop is its colour.

    tag     linearGradient or radialGradient
    values  its attributes, those of the gradients to which it refers included
    stops   elements in it
    data    path data of the area
    onto    map from user space to px

    Raise InputError if an area cannot have such a gradient.
    """
    offsets, colors = list[float](), []
    for stop in stops:
        own = styled(stop)
        if stop.tag != SVG + "stop" or share_of(own.get("stop-opacity", "1"), "stop-opacity") < 1:
            needed = "opaque, and nothing else in it"
            raise refusal("stops of the gradient of an area", needed, "others")
        offset = share_of(_share(own.get("offset", "0")), "offset")
        offsets.append(max([offset, *offsets[-1:]]))
        colors.append(color_of(own.get("stop-color", "black"), "stop-color"))
    if len(colors) == 1:
        return colors[0]
    ramp = {"offsets": tuple(offsets), "colors": tuple(colors)}
    if values.get("gradientUnits", "objectBoundingBox") == "objectBoundingBox":
        points = [_polygon(outline) for outline in outlines_of(data, _SAME, True)]
        (left, top), (right, bottom) = (f(np.concatenate(points), axis=0) for f in (np.min, np.max))
        onto = compose(onto, (right - left, 0.0, 0.0, bottom - top, left, top))
        shares = {n: _share(values.get(n, share)) for n, share in _BOX.items()}
        values = {**values, **shares, "gradientUnits": "userSpaceOnUse"}
    if tag == "radialGradient":
        a, b, c, d, x, y = compose(onto, disc_of(values))
        radii = portable.hypot(a, c), portable.hypot(b, d)
        if abs(a * b + c * d) > _TOLERANCE * radii[0] * radii[1]:
            raise refusal("its gradient", "a circle or an upright ellipse", "another")
        return RadialGradient(**ramp, center=(x, y), radii=radii)
    kind = values.get("gradientUnits"), values.get("spreadMethod", "pad")
    if kind != ("userSpaceOnUse", "pad"):
        needed = "in user space, without repetition"
        raise refusal("its gradient", needed, "another", "to undo what changed it")
    names = {"x1": "0", "y1": "0", "x2": "100%", "y2": "0"}
    x1, y1, x2, y2 = (numbers(values.get(n, v), n, 1)[0] for n, v in names.items())
    own = transform_of(values.get("gradientTransform", ""), "gradientTransform")
    a, b, c, d, e, f = compose(onto, own)
    # `slope` is the gradient of the position along the axis, in the user space of the gradient. A
    # map with the linear part A turns it into the inverse of A^T times it.
    across, down = x2 - x1, y2 - y1
    squared, det = across**2 + down**2, a * d - b * c
    if not squared * det:
        raise refusal("its gradient", "longer than 0", "another", "to undo what changed it")
    u, v = (d * across - b * down) / det, (a * down - c * across) / det
    scale = squared / (u * u + v * v)
    start = a * x1 + c * y1 + e, b * x1 + d * y1 + f
    return LinearGradient(**ramp, start=start, end=(start[0] + scale * u, start[1] + scale * v))
