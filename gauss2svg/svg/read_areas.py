"""Read the path data, the stroke and the gradient of an area or a line.

Path data have lines and cubic curves, absolute or relative, as editors write them too. Relative
coordinates are added up in user units. Write_svg writes these as whole numbers, so the sums are
exact.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from gauss2svg.errors import quoted, refusal
from gauss2svg.scene.areas import (
    Cap,
    LinearGradient,
    Outline,
    Paint,
    Point,
    RadialGradient,
)
from gauss2svg.svg.file import NUMBER, SVG, numbers
from gauss2svg.svg.read_shapes import (
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
INHERITED |= {"stroke-miterlimit", "stroke-dasharray", "fill-rule"}
_COMMAND = re.compile(rf"[\s,]*+([MmLlHhVvCcSsZz])((?:[\s,]*+{NUMBER})*+)[\s,]*+")
_COMMANDS = re.compile(rf"(?=\s*+[Mm])(?:{_COMMAND.pattern})++")
_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Z": 0}  # how many numbers a command has
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


def outlines_of(data: str, onto: Affine, is_filled: bool) -> tuple[Outline, ...]:
    """Return the outlines of path data, in px. A filled outline is closed even without z.

    onto  map from user space to px

    Raise InputError if the data have anything but lines and cubic curves.
    """
    outlines = list[Outline]()
    a, b, c, d, e, f = onto

    def add(points: list[Point], curved: list[bool], closed: bool) -> None:
        if not curved:
            return
        if closed and math.dist(points[0], points[-1]) > _SAME_POINT:
            curved = [*curved, False]
        elif closed:
            points = points[:-1]
        places = tuple((a * x + c * y + e, b * x + d * y + f) for x, y in points)
        outlines.append(Outline(places, tuple(curved), closed))

    points, curved, handle = [(0.0, 0.0)], list[bool](), (0.0, 0.0)
    for letter, values in _commands(data):
        x, y = points[-1]
        left, top = (x, y) if letter.islower() else (0.0, 0.0)
        if letter in "Zz":
            add(points, curved, True)
            points, curved, handle = points[:1], [], points[0]
            continue
        if letter in "Hh":
            ends = [(left + values[0], y)]
        elif letter in "Vv":
            ends = [(x, top + values[0])]
        else:
            pairs = zip(values[::2], values[1::2], strict=True)
            ends = [(left + across, top + down) for across, down in pairs]
        if letter in "Mm":
            add(points, curved, is_filled)
            points, curved, handle = ends, [], ends[0]
            continue
        if letter in "Ss":
            ends.insert(0, handle)
        points += ends
        curved.append(len(ends) == 3)
        (u, v), (x, y) = ends[-2:] if curved[-1] else 2 * ends
        handle = 2 * x - u, 2 * y - v
    add(points, curved, is_filled)
    if not outlines:
        needed = "an ellipse of four arcs, or lines and cubic curves"
        raise refusal("its d", needed, quoted(data), "to undo the edit of its nodes")
    return tuple(outlines)


def _commands(data: str) -> list[tuple[str, list[float]]]:
    """Return the letter and the numbers of each command. Return [] if the data are no known path.

    A command that is repeated without its letter is returned with it.
    """
    commands = []
    for letter, text in _COMMAND.findall(data) if _COMMANDS.fullmatch(data) else ():
        values, count = list(map(float, re.findall(NUMBER, text))), _COUNTS[letter.upper()]
        if bool(values) != bool(count) or len(values) % (count or 1):
            return []
        for k in range(0, len(values) or 1, count or 1):
            name = {"M": "L", "m": "l"}.get(letter, letter) if k else letter
            commands.append((name, values[k : k + count]))
    return commands


def stroke_of(style: Mapping[str, str], onto: Affine, root: Affine) -> tuple[float, Cap]:
    """Return the width in px and the ends of a stroke.

    onto, root  maps from user space to px, of the path and of the root

    Raise InputError if a line cannot have such a stroke, or if its width is not even. The map of
    the root is taken as even, because minimal markup rounds the sides of the canvas.
    """
    for name, needed in (("stroke-dasharray", "none"), ("stroke-miterlimit", "4")):
        if (value := style.get(name, needed)) != needed:
            raise refusal(f"its {name}", needed, quoted(value), "to remove it")
    ends = style.get("stroke-linecap", "butt"), style.get("stroke-linejoin", "miter")
    if ends not in _ENDS:
        needed = "butt and miter, round and round, or square and miter"
        raise refusal("its stroke-linecap and stroke-linejoin", needed, " and ".join(ends))
    text = style.get("stroke-width", "1")
    width = numbers(text.removesuffix("px"), "stroke-width", 1)[0]
    if not width > 0:
        raise refusal("its stroke-width", "above 0", quoted(text), "to delete it")
    a, b, c, d = onto[0] / root[0], onto[1] / root[3], onto[2] / root[0], onto[3] / root[3]
    across, down = math.hypot(a, b), math.hypot(c, d)
    is_even = abs(across - down) <= _TOLERANCE * down
    if not is_even or abs(a * c + b * d) > _TOLERANCE * across * down:
        advice = "to convert the stroke to a path"
        raise refusal("transforms of a stroke", "without stretching and skewing", "others", advice)
    return width * across * math.sqrt(abs(root[0] * root[3])), _ENDS[ends]


def gradient_of(tag: str, values: Mapping[str, str], stops: Iterable[Any], onto: Affine) -> Paint:
    """Return the gradient of an area, in px. A gradient of one stop is its colour.

    tag     linearGradient or radialGradient
    values  its attributes, those of the gradients to which it refers included
    stops   elements in it
    onto    map from user space to px

    Raise InputError if an area cannot have such a gradient.
    """
    offsets, colors = list[float](), []
    for stop in stops:
        own = styled(stop)
        if stop.tag != SVG + "stop" or share_of(own.get("stop-opacity", "1"), "stop-opacity") < 1:
            needed = "opaque, and nothing else in it"
            raise refusal("stops of the gradient of an area", needed, "others")
        offset = share_of(own.get("offset", "0"), "offset")
        offsets.append(max([offset, *offsets[-1:]]))
        colors.append(color_of(own.get("stop-color", "black"), "stop-color"))
    if len(colors) == 1:
        return colors[0]
    ramp = {"offsets": tuple(offsets), "colors": tuple(colors)}
    if tag == "radialGradient":
        a, b, c, d, x, y = compose(onto, disc_of(values))
        radii = math.hypot(a, c), math.hypot(b, d)
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
