"""Affine maps of the plane as six numbers, in the order of SVG's matrix(a b c d e f).

    x' = a x + c y + e,   y' = b x + d y + f

They are tuples, because thousands are read one by one, where numpy is ten times slower.
"""

from __future__ import annotations

import math
import re

from gauss2svg.errors import InputError, quoted
from gauss2svg.svg.syntax.values import numbers

Affine = tuple[float, float, float, float, float, float]

IDENTITY: Affine = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
_CALL = re.compile(r"[\s,]*([a-zA-Z]+)\s*\(([^()]*)\)[\s,]*")
# How many numbers each transform function may have.
COUNTS: dict[str, tuple[int, ...]] = {
    "matrix": (6,),
    "translate": (1, 2),
    "scale": (1, 2),
    "rotate": (1, 3),
}
COUNTS |= {"skewX": (1,), "skewY": (1,)}


def compose(outer: Affine, inner: Affine) -> Affine:
    """The map that does `inner` first, then `outer`."""
    a, b, c, d, e, f = outer
    p, q, r, s, t, u = inner
    return (
        a * p + c * q, b * p + d * q, a * r + c * s, b * r + d * s,
        a * t + c * u + e, b * t + d * u + f,
    )  # fmt: skip


def parse_transform(text: str, name: str = "transform") -> Affine:
    """The map of a transform list: matrix, translate, scale, rotate, skewX and skewY, in degrees.

    Raises InputError for anything else.
    """
    total, at = IDENTITY, 0
    text = text.strip()
    if text == "none":
        return total
    while at < len(text):
        call = _CALL.match(text, at)
        values = numbers(call[2], name) if call else []
        if call is None or len(values) not in COUNTS.get(call[1], ()):
            raise InputError(
                f"{name} must be a list of matrix, translate, scale, rotate, skewX, skewY; got "
                f"{quoted(text)}"
            )
        total = compose(total, affine_of(call[1], values)) if at else affine_of(call[1], values)
        at = call.end()
    return total


def affine_of(kind: str, values: list[float]) -> Affine:
    """The map of one transform function, with as many values as one of its COUNTS."""
    first, second = values[0], values[1] if len(values) > 1 else None
    if kind == "matrix":
        a, b, c, d, e, f = values
        return a, b, c, d, e, f
    if kind == "translate":
        return 1.0, 0.0, 0.0, 1.0, first, second or 0.0
    if kind == "scale":
        return first, 0.0, 0.0, first if second is None else second, 0.0, 0.0
    angle_rad = math.radians(first)
    if kind == "skewX":
        return 1.0, 0.0, math.tan(angle_rad), 1.0, 0.0, 0.0
    if kind == "skewY":
        return 1.0, math.tan(angle_rad), 0.0, 1.0, 0.0, 0.0
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    x, y = values[1:] or (0.0, 0.0)
    return cos, sin, -sin, cos, x - cos * x + sin * y, y - sin * x - cos * y
