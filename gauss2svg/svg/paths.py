"""Affine maps, and path data that become outlines or ellipses.

Path data have lines and curves, absolute or relative, as editors write them. Arcs and quadratic
curves become cubic ones, and other elements become path data. Relative coordinates are added up in
user units. Files of write_svg have whole numbers of these units, so the sums are exact.

While path data are read, the point (x, y) is the complex number x + y i.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gauss2svg import portable
from gauss2svg.errors import quoted, refusal
from gauss2svg.scene.areas import MOST_COORDINATE, Outline, Point
from gauss2svg.svg.element import Floats
from gauss2svg.svg.file import NUMBER, numbers

_GAP = r"[\s,]*+"
# The numbers of each command. The flags of an arc need no blanks around them.
_COUNTS = {"M": 2, "L": 2, "T": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4}
_NUMBERS = {letter: (NUMBER,) * count for letter, count in _COUNTS.items()}
_NUMBERS |= {"A": (*(NUMBER,) * 3, "[01]", "[01]", NUMBER, NUMBER), "Z": ("(?!)",)}
_ROWS = {letter: "".join(f"{_GAP}({one})" for one in row) for letter, row in _NUMBERS.items()}
_PATTERNS = {letter: re.compile(row) for letter, row in _ROWS.items()}


class Affine(NamedTuple):
    """An affine map of the plane, by the numbers of matrix(a b c d e f) in SVG.

        x' = a x + c y + e,   y' = b x + d y + f

    Maps are tuples, because with arrays the maps of thousands of elements take ten times as long.
    """

    a: float = 1.0
    b: float = 0.0
    c: float = 0.0
    d: float = 1.0
    e: float = 0.0
    f: float = 0.0

    def __matmul__(self, inner: Affine) -> Affine:
        """Return the map that applies first `inner` and then this map."""
        a, b, c, d, e, f = self
        p, q, r, s, t, u = inner
        return Affine(
            a * p + c * q, b * p + d * q, a * r + c * s, b * r + d * s,
            a * t + c * u + e, b * t + d * u + f,
        )  # fmt: skip

    def at(self, x: float, y: float) -> Point:
        """Return the point onto which the map takes (x, y)."""
        return self.a * x + self.c * y + self.e, self.b * x + self.d * y + self.f

    def of(self, outline: Outline) -> Outline:
        """Return the outline onto which the map takes an outline."""
        return dataclasses.replace(outline, points=tuple(self.at(x, y) for x, y in outline.points))

    @property
    def determinant(self) -> float:
        """Factor by which the map changes areas. It is below 0 if the map mirrors."""
        return self.a * self.d - self.b * self.c

    @property
    def reach(self) -> float:
        """The larger semi-axis of the ellipse onto which the map takes the unit circle."""
        a, b, c, d = self[:4]
        return 0.5 * (length(complex(a + d, b - c)) + length(complex(a - d, b + c)))

    @classmethod
    def of_text(cls, text: str, name: str = "transform") -> Affine:
        """Return the map of a transform, which is a list of functions such as rotate(20 3 4).

        Raise InputError for anything else.
        """
        one, whole = rf"{_GAP}([a-zA-Z]+)\s*+\(([^()]*+)\){_GAP}", cls()
        # Texts that do not match as a whole would be searched from each of their characters.
        if re.fullmatch(rf"(?:{one})*+", stripped := text.strip()):
            # An unknown function raises KeyError, and a wrong number of values TypeError.
            with suppress(KeyError, TypeError):
                for function, values in re.findall(one, stripped):
                    whole @= _FUNCTIONS[function](*numbers(values, name))
                return whole
        raise refusal(name, "a list of matrix, translate, scale and rotate", quoted(text))


def _rotation(degrees: float, x: float, y: float) -> Affine:
    turn = _turn(math.radians(degrees))
    co, si = turn.real, turn.imag
    return Affine(co, si, -si, co, x - co * x + si * y, y - si * x - co * y)


_FUNCTIONS = {
    "matrix": lambda a, b, c, d, e, f: Affine(a, b, c, d, e, f),
    "translate": lambda x, y=0.0: Affine(e=x, f=y),
    "scale": lambda x, y=None: Affine(a=x, d=x if y is None else y),
    "rotate": lambda degrees, *at: _rotation(degrees, *(at or (0.0, 0.0))),
}


@lru_cache(maxsize=4096)
def _turn(angle_rad: float) -> complex:
    """Return the point at an angle on the unit circle."""
    return complex(portable.cos(angle_rad), portable.sin(angle_rad))


def length(vector: complex) -> float:
    """Return the absolute value of a complex number."""
    return math.sqrt(vector.real * vector.real + vector.imag * vector.imag)


def ellipses_of(tag: str, attributes: Mapping[str, str]) -> list[Affine]:
    """Return maps of the unit circle onto the ellipses that an element draws.

    They are a circle, an ellipse, or a path of four quarters of an ellipse, as Inkscape's "Object
    to Path" makes it, or a path of the open arcs of minimal markup. Return [] for all others. Raise
    InputError if a radius is less than 0.
    """
    if tag in ("circle", "ellipse"):
        cx, cy, rx, ry = _values(tag, attributes)
        if rx < 0 or ry < 0:
            raise refusal("radii", "0 or more", f"{rx:g} and {ry:g}")
        return [Affine(rx, 0.0, 0.0, ry, cx, cy)]
    commands = _commands(attributes.get("d", "")) if tag == "path" else []
    letters = "".join(letter for letter, _ in commands)
    is_closed = letters.upper() == "MAAAAZ"
    if not is_closed and not re.fullmatch("(?:[Mm]a)+", letters):
        return []
    ellipses, forms, here = list[Affine](), list[list[float]](), 0j
    for letter, values in commands[: -1 if is_closed else None]:
        start, here = here, complex(*values[-2:]) + (here if letter.islower() else 0)
        if letter in "Aa":
            forms.append(values[:5])
            arc = _on_circle(start, forms[-1], here)
            is_own = is_closed or (forms[-1][3:] == [1, 0] and here - start in (1, 1j))
            if arc is None or not is_own:
                return []
            ellipses.append(arc[0])
    if not is_closed:
        return ellipses
    # All four are the same ellipse. Its centre may differ by .02 of a radius, because editors
    # write only 8 digits, which are too few to be exact for thin arcs.
    centers = [complex(one.e, one.f) for one in ellipses]
    center, (rx, ry, _, is_large, _) = sum(centers) / 4, forms[0]
    most = 0.02 * min(rx, ry)
    if is_large or forms != 4 * forms[:1] or max(length(c - center) for c in centers) > most:
        return []
    return [ellipses[0]._replace(e=center.real, f=center.imag)]


def data_of(tag: str, attributes: Mapping[str, str]) -> str:
    """Return the path data of a path, or of another element that draws a path."""
    if tag == "path":
        return attributes.get("d", "")
    if tag in ("polygon", "polyline"):
        return f"M{attributes.get('points', '')}{'z' * (tag == 'polygon')}"
    if tag == "rect":
        x, y, width, height, rx, ry = _values(tag, attributes)
        width, height = max(width, 0.0), max(height, 0.0)
        rx, ry = (min(rx, width / 2), min(ry, height / 2)) if min(rx, ry) > 0 else (0.0, 0.0)
        left, top, form = x + rx, y + ry, f"A{rx} {ry} 0 0 1"
        right, bottom = left + (width - 2 * rx), top + (height - 2 * ry)
        return (
            f"M{x} {top}{form} {left} {y}H{right}{form} {x + width} {top}V{bottom}"
            f"{form} {right} {y + height}H{left}{form} {x} {bottom}z"
        )
    first, second, third, last = _values(tag, attributes)
    if tag == "line":
        return f"M{first} {second}L{third} {last}"
    halves = f"a{third} {last} 0 0 1 {2 * third} 0a{third} {last} 0 0 1 {-2 * third} 0z"
    return f"M{first - third} {second}{halves}"


def _values(tag: str, attributes: Mapping[str, str]) -> list[float]:
    """Return the numbers of the attributes that say where an element is, and how large."""
    names = {
        "line": "x1 y1 x2 y2", "circle": "cx cy r r", "ellipse": "cx cy rx ry",
        "rect": "x y width height rx ry",
    }  # fmt: skip
    if tag == "rect":  # each radius is the default of the other
        rx, ry = attributes.get("rx"), attributes.get("ry")
        attributes = {**attributes, "rx": rx or ry or "0", "ry": ry or rx or "0"}
    return [numbers(attributes.get(name, "0"), name, 1)[0] for name in names[tag].split()]


def outlines_of(data: str, is_filled: bool) -> tuple[Outline, ...]:
    """Return the outlines of path data, in user units. A filled outline is closed even without z.

    Raise InputError if the data are no path.
    """
    outlines, points, curved, handle, before = list[Outline](), [0j], list[bool](), 0j, ""

    def end(is_closed: bool) -> None:
        if is_closed and length(points[0] - points[-1]) > 1e-6:
            curved.append(False)
        elif is_closed:
            points.pop()
        places = tuple((point.real, point.imag) for point in points)
        outlines.append(Outline(places, tuple(curved), is_closed))

    for letter, values in _commands(data):
        here, kind = points[-1], letter.upper()
        origin = here if letter.islower() else 0j
        if kind == "H":
            ends = [complex(origin.real + values[0], here.imag)]
        elif kind == "V":
            ends = [complex(here.real, origin.imag + values[0])]
        else:
            pairs = values[-2:] if kind == "A" else values
            ends = [origin + complex(*pair) for pair in zip(pairs[::2], pairs[1::2], strict=True)]
        if kind in "MZ":
            first = ends or points[:1]
            if curved:
                end(kind == "Z" or is_filled)
            points, curved, before = first, [], kind
            continue
        if kind in "ST":  # the first handle reflects the last one of a curve before
            reflects = before in {"S": "CS", "T": "QT"}[kind]
            ends.insert(0, 2 * here - handle if reflects else here)
        before, handle = kind, ends[-2] if len(ends) > 1 else here
        if kind in "QT":  # a cubic curve draws the same
            ends = [(here + 2 * handle) / 3, (ends[1] + 2 * handle) / 3, ends[1]]
        elif kind == "A":
            ends = _arc(here, values[:5], ends[0])
        if ends == [here] and (curved or kind == "A"):
            continue
        points += ends
        curved += [len(ends) > 1] * math.ceil(len(ends) / 3)
    if curved:
        end(is_filled)
    if not outlines:
        raise refusal("its d", "lines and curves", quoted(data), "to undo the edit of its nodes")
    return tuple(outlines)


def _arc(start: complex, form: list[float], end: complex) -> list[complex]:
    """Return the handles and ends of cubic curves that draw an arc.

    form  radii, tilt in degrees, and the two flags
    """
    if (arc := _on_circle(start, form, end)) is None:
        return [end]
    onto, first, last = arc
    angle_rad, last_rad = (portable.arctan2(at.imag, at.real) for at in (first, last))
    whole = (last_rad - angle_rad) % math.tau - (0 if form[4] else math.tau)
    count = max(math.ceil(abs(whole) / (math.pi / 2) - 1e-9), 1)
    step = whole / count
    half = _turn(step / 4)
    reach, places = 4 / 3 * half.imag / half.real * 1j, list[complex]()
    for k in range(count):
        u, v = (_turn(angle_rad + (k + j) * step) for j in (0, 1))
        places += [u + reach * u, v - reach * v, v]
    return [*(complex(*onto.at(place.real, place.imag)) for place in places[:-1]), end]


def _on_circle(
    start: complex, form: list[float], end: complex
) -> tuple[Affine, complex, complex] | None:
    """Return the map of the unit circle onto the ellipse of an arc, and the arc's ends there.

    They follow from the middle of the chord (SVG 2, appendix B.2). Radii that are too small grow.
    Return None for a flat arc, which is a line, and for numbers that an outline cannot have.
    """
    values = start.real, start.imag, end.real, end.imag, *form[:3]
    is_held = all(abs(value) <= MOST_COORDINATE for value in values)
    if not is_held or min(length(end - start), *map(abs, form[:2])) < 1 / MOST_COORDINATE:
        return None
    (rx, ry), (tilt, is_large, is_sweep) = map(abs, form[:2]), form[2:]
    turn, middle = _turn(math.radians(tilt)), (start + end) / 2
    turned = (start - end) / 2 * turn.conjugate()
    chord = complex(turned.real / rx, turned.imag / ry)
    half_chord = length(chord)
    growth = max(half_chord, 1.0)
    rx, ry, chord = rx * growth, ry * growth, chord / growth
    side = 1j if is_large == is_sweep else -1j
    center = side * chord * math.sqrt(max(1 / half_chord**2 - 1, 0.0))
    co, si = turn.real, turn.imag
    onto = Affine(rx * co, rx * si, -ry * si, ry * co, middle.real, middle.imag)
    x, y = onto.at(center.real, center.imag)
    return onto._replace(e=x, f=y), chord - center, -chord - center


def _commands(data: str) -> list[tuple[str, list[float]]]:
    """Return the letter and the numbers of each command. Return [] if the data are no path.

    A command that is repeated without its letter is returned with it.
    """
    before, *parts = re.split(f"([{''.join(_PATTERNS)}])", data, flags=re.IGNORECASE)
    commands = list[tuple[str, list[float]]]()
    if before.strip() or parts[:1] not in (["M"], ["m"]):
        return []
    for letter, text in zip(parts[::2], parts[1::2], strict=True):
        row, found, end = _PATTERNS[letter.upper()], list[list[float]](), 0
        while match := row.match(text, end):
            found.append(list(map(float, match.groups())))
            end = match.end()
        if not re.fullmatch(_GAP, text[end:]) or bool(found) == (letter in "Zz"):
            return []
        commands.append((letter, found[0] if found else []))
        commands += [({"M": "L", "m": "l"}.get(letter, letter), values) for values in found[1:]]
    return commands


def flat(outline: Outline, tolerance: float) -> Floats:
    """Return the points (n, 2) of an outline as lines. Those of a closed one end at the start.

    tolerance  largest distance of the lines from a curve
    """
    pieces = [outline.segments[:1, 0]]
    for (a, b, c, d), is_curve in zip(outline.segments, outline.curved, strict=True):
        if not is_curve:
            pieces.append(d[None])
            continue
        # The second derivative of a cubic curve is at most 6 times this. Lines of a share of 1 / n
        # are then off by at most an eighth of it, divided by n squared.
        bend = max(portable.hypot(*(a - 2 * b + c)), portable.hypot(*(b - 2 * c + d)))
        count = max(1, math.ceil(math.sqrt(0.75 * float(bend) / tolerance)))
        t = np.arange(1, count + 1)[:, None] / count
        s = 1 - t
        pieces.append(s**3 * a + 3 * s**2 * t * b + 3 * s * t**2 * c + t**3 * d)
    return np.concatenate(pieces)


def polygons_of(outlines: tuple[Outline, ...]) -> list[Floats]:
    """Return the points (n, 2) of closed outlines as lines, to a thousandth of their extent."""
    points = np.concatenate([outline.points for outline in outlines])
    extent = float(np.ptp(points, axis=0).max())
    return [flat(outline, 1e-3 * (extent or 1.0))[:-1] for outline in outlines]


def nonzero(outlines: tuple[Outline, ...]) -> tuple[Outline, ...]:
    """Return outlines that the fill rule nonzero fills as the rule evenodd fills `outlines`.

    Each runs the other way than the outline around it. Raise InputError if that is not enough,
    because outlines cross.
    """
    polygons = polygons_of(outlines)
    # The two fill rules are compared at 32 places along each axis. 1e8 places times pieces take
    # about a second.
    if (len(polygons) + 32**2) * sum(map(len, polygons)) > 1e8:
        needed, got = "of fewer nodes", f"{len(polygons)} outlines"
        raise refusal("a path of the fill-rule evenodd", needed, got)
    points = np.concatenate(polygons)
    axes = np.linspace(points.min(axis=0), points.max(axis=0), 34)[1:-1].T
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    # How often each outline runs around the start of each other one, and around the places
    places, count = np.concatenate([[one[0] for one in polygons], places]), len(polygons)
    winding = np.array([windings(polygon, places) for polygon in polygons]).astype(int)
    around = winding[:, :count] % 2
    depth = around.sum(axis=0) - around.diagonal()
    runs = [(x * (np.roll(y, -1) - np.roll(y, 1))).sum() for x, y in map(np.transpose, polygons)]
    sign = np.where((np.array(runs) > 0) == (depth % 2 == 0), 1, -1)
    odd, after = winding.sum(axis=0) % 2, (sign[:, None] * winding).sum(axis=0)
    if ((odd != 0) != (after != 0))[count:].any():
        raise refusal("its fill-rule", "nonzero where outlines cross", "'evenodd'", "to split it")
    return tuple(
        one if s > 0 else Outline((one.points[0], *one.points[:0:-1]), one.curved[::-1])
        for one, s in zip(outlines, sign, strict=True)
    )


def windings(polygon: Floats, points: Floats) -> Floats:
    """Return how often a polygon runs around each of the points (n, 2)."""
    (x, y), (u, v) = polygon.T, np.roll(polygon, -1, axis=0).T
    turns = np.sign(v - y)
    with np.errstate(all="ignore"):  # edges along x have no slope, and are never crossed
        slope = (u - x) / (v - y)
        parts = []
        for part in np.array_split(points, 1 + points.size * len(polygon) // 10**6):
            across, down = part.T[:, :, None]
            crossed = (y <= down) != (v <= down)
            crossed &= x + (down - y) * slope > across
            parts.append(np.where(crossed, turns, 0).sum(axis=1))
    return np.concatenate(parts)
