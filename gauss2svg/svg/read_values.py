"""Read the texts of elements: maps, colours, gradients, ellipses, path data and strokes.

An affine map of the plane is a tuple of six numbers, in the order of SVG's matrix(a b c d e f):

    x' = a x + c y + e,   y' = b x + d y + f

Maps are tuples, and not arrays, because thousands of them are read one by one. With numpy this
would take ten times as long.

The edge of a shape is the affine map of the unit circle onto a circle, an ellipse or a path of
arcs. If a
single circle is moved, Inkscape makes it an ellipse. "Object to Path" makes it a path of four arcs,
and each later transform keeps the arcs. Minimal markup writes many ellipses of the same colour as
open arcs of one path.

The exponent of a gradient is the one of BETA_CLASSES to which its stops belong. In minimal markup,
the opacities of the stops are in a style sheet, or the stops are the greys of a mask. The luminance
of such a grey is the falloff.

Path data of areas and lines have lines and curves, absolute or relative, as editors write them too.
Arcs and quadratic curves become cubic ones, and other elements become path data. Relative
coordinates are added up in user units. Write_svg writes these as whole numbers, so the sums are
exact.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache, reduce
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from PIL import ImageColor

from gauss2svg import portable
from gauss2svg.errors import quoted, refusal
from gauss2svg.scene import PLAIN
from gauss2svg.scene.areas import (
    MOST_COORDINATE,
    Cap,
    Color,
    LinearGradient,
    Outline,
    Paint,
    Point,
    RadialGradient,
)
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.svg import STOP_COUNTS
from gauss2svg.svg.element import Floats
from gauss2svg.svg.file import NUMBER, SVG, numbers
from gauss2svg.svg.forms import BLURS, Blur, gradient_stops, grey_stops
from gauss2svg.svg.minimal import MASK_STOPS, arc_geometry

Affine = tuple[float, float, float, float, float, float]
# Attributes of fills and strokes that elements inherit.
INHERITED = {"fill", "fill-opacity", "fill-rule", "paint-order", "stroke", "stroke-width"}
INHERITED |= {"stroke-opacity", "stroke-linecap", "stroke-linejoin", "stroke-miterlimit"}
INHERITED |= {"stroke-dasharray"}
# A gradient may be turned by this, and a stroke be stretched by this, as a share of its size,
# because editors round numbers.
_TOLERANCE = 1e-4
_FUNCTIONS = {
    "matrix": lambda a, b, c, d, e, f: (a, b, c, d, e, f),
    "translate": lambda x, y=0.0: (1.0, 0.0, 0.0, 1.0, x, y),
    "scale": lambda x, y=None: (x, 0.0, 0.0, x if y is None else y, 0.0, 0.0),
    "rotate": lambda degrees, *at: _rotation(math.radians(degrees), *(at or (0.0, 0.0))),
    "skewX": lambda degrees: (1.0, 0.0, _tangent(degrees), 1.0, 0.0, 0.0),
    "skewY": lambda degrees: (1.0, _tangent(degrees), 0.0, 1.0, 0.0, 0.0),
}
# How many numbers each command of path data has.
_COUNTS = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
_COMMAND = rf"[\s,]*+([{''.join(_COUNTS)}])((?:[\s,]*+{NUMBER})*+)[\s,]*+"


def compose(outer: Affine, inner: Affine) -> Affine:
    """Return the map that applies first `inner` and then `outer`."""
    a, b, c, d, e, f = outer
    p, q, r, s, t, u = inner
    return (
        a * p + c * q, b * p + d * q, a * r + c * s, b * r + d * s,
        a * t + c * u + e, b * t + d * u + f,
    )  # fmt: skip


def transform_of(text: str, name: str = "transform") -> Affine:
    """Return the affine map of a transform, which is a list of matrix, translate, scale and rotate.

    Raise InputError for anything else.
    """
    one = r"[\s,]*+(matrix|translate|scale|rotate|skewX|skewY)\s*+\(([^()]*+)\)[\s,]*+"
    # If the text gives a function such as rotate too many or too few values, TypeError is raised.
    with suppress(TypeError):
        maps = [_FUNCTIONS[call](*numbers(values, name)) for call, values in re.findall(one, text)]
        if re.fullmatch(rf"(?:{one})*+\s*+", text):
            return reduce(compose, maps, (1.0, 0.0, 0.0, 1.0, 0.0, 0.0))
    raise refusal(name, "a list of matrix, translate, scale, rotate and skew", quoted(text))


def _rotation(angle_rad: float, x: float, y: float) -> Affine:
    cos, sin = portable.cos(angle_rad), portable.sin(angle_rad)
    return cos, sin, -sin, cos, x - cos * x + sin * y, y - sin * x - cos * y


def _tangent(degrees: float) -> float:
    return portable.sin(math.radians(degrees)) / portable.cos(math.radians(degrees))


def share_of(text: str, name: str) -> float:
    """Return the number in a text, clamped to 0..1, as renderers clamp opacities and offsets."""
    return min(max(numbers(text, name, 1)[0], 0.0), 1.0)


@lru_cache(maxsize=4096)
def color_of(text: str, name: str) -> Color:
    """Return the sRGB colour, in 0..1, of a text such as #rgb, #rrggbb, rgb(..) or a name.

    Raise InputError for a text that is not an opaque colour. `name` is the name of the colour in
    the error message.
    """
    try:
        red, green, blue = map(int, ImageColor.getrgb(text.strip()[:40]))
    except ValueError:  # this is also raised for a colour with alpha, which has four numbers
        raise refusal(name, "an opaque colour, such as #1a2b3c", quoted(text)) from None
    return red / 255, green / 255, blue / 255


def reference_of(text: str) -> str | None:
    """Return the id in a text url(#id). Return None if it does not begin with such a reference."""
    match = re.match(r"""\s*url\(\s*['"]?#([^'")\s]+)['"]?\s*\)""", text)
    return match[1] if match else None


def styled(element: Any) -> dict[str, str]:
    """Return the attributes of an element, overridden by the properties in its style attribute.

    Raise InputError if the style has an escape or !important.
    """
    if "style" not in element.attrib:
        return element.attrib
    style = re.sub(r"/\*.*?(?:\*/|\Z)", " ", element.get("style"), flags=re.DOTALL)
    if "\\" in style or "!" in style:
        raise refusal("its style", "without escapes and !important", quoted(style.strip()))
    parts = (part.partition(":") for part in style.split(";"))
    own = {name.strip().lower(): value.strip() for name, colon, value in parts if colon}
    return {**element.attrib, **own}


class Fill(NamedTuple):
    """The fill of an outline.

    color   sRGB colour in 0..1
    drawn   how the shape is drawn, as a value of Scene.drawn
    peak    opacity at the centre of the shape, divided by the fill-opacity of the element
    beta    exponent. 0 for a plain ellipse
    radius  radius, in sigmas, of the circle that `disc` maps. 0 for a plain ellipse
    disc    map of the unit circle onto the edge of the gradient, in user space. None if there is
            no gradient. The edge of the fill is then the outline
    """

    color: Color
    drawn: int = PLAIN
    peak: float = 1.0
    beta: float = 0.0
    radius: float = 0.0
    disc: Affine | None = None


def target_of(by_id: Mapping[str, Any], key: str | None, *tags: str) -> Any:
    """Return the element whose id is `key`. Raise InputError unless its tag is one of `tags`."""
    element = by_id.get(key or "")
    if element is None or element.tag.removeprefix(SVG) not in tags:
        raise refusal("its reference", f"to a {tags[0]} in the file", quoted(key), "to remove it")
    return element


def link_of(element: Any) -> str:
    """Return the id to which the href of an element refers, or "" if it has no href."""
    names = "href", "{http://www.w3.org/1999/xlink}href"
    return next(filter(None, map(element.get, names)), "").removeprefix("#")


def disc_of(gradient: Mapping[str, str]) -> Affine:
    """Return the map of the unit circle onto the edge of a gradient that has these attributes.

    Raise InputError if write_svg does not write such a gradient, for example if it is not in user
    space, or if its focus is not at its centre.
    """
    center = {"fx": gradient.get("cx", ""), "fy": gradient.get("cy", "")}
    values = {"spreadMethod": "pad", "fr": "0", **center, **gradient}
    texts = (values.get(name, "") for name in ("cx", "cy", "r", "fx", "fy"))
    cx, cy, r, fx, fy = (numbers(text, "a number of its gradient", 1)[0] for text in texts)
    kind = values.get("gradientUnits"), values["spreadMethod"], values["fr"]
    # The focus may be off the centre by 0.01 of the radius, because that changes the image by less
    # than one level.
    off_center = 100 * portable.hypot(fx - cx, fy - cy)
    if kind != ("userSpaceOnUse", "pad", "0") or not r > 0 or off_center > r:
        raise refusal("its gradient", "in user space, with its focus at the centre", "another")
    onto = transform_of(values.get("gradientTransform", ""), "gradientTransform")
    return compose(onto, (r, 0.0, 0.0, r, cx, cy))


def beyond_px(edge: Floats, disc: Floats) -> Floats:
    """Return how far, in px, each of n gradients reaches beyond the ellipse that it fills.

    edge  (n, 2, 3) maps of the unit circle onto the ellipses
    disc  (n, 2, 3) maps of the unit circle onto the edges of the gradients
    """
    linear, abs_det = edge[:, :, :2], np.abs(determinants(edge[:, :, :2]))
    # The adjugate matrix maps each ellipse onto a circle of radius abs_det. It is used because the
    # inverse may not exist.
    adjugate = linear[:, ::-1, ::-1].swapaxes(1, 2) * [[1, -1], [-1, 1]]
    vectors = disc[:, :, 0], disc[:, :, 1], (disc - edge)[:, :, 2]
    across, down, (x, y) = ((adjugate * v[:, None]).sum(axis=2).T for v in vectors)
    size = larger_axis(np.stack([across, down]).T)
    return (size + portable.hypot(x, y) - abs_det) / larger_axis(linear)


def determinants(linear: Floats) -> Floats:
    """Return the determinants (n,) of matrices (n, 2, 2)."""
    (a, c), (b, d) = linear.transpose(1, 2, 0)
    return a * d - b * c


def larger_axis(linear: Floats) -> Floats:
    """Return the larger semi-axes (n,) of ellipses onto which matrices (n, 2, 2) map a circle."""
    (a, c), (b, d) = linear.transpose(1, 2, 0)
    return 0.5 * (portable.hypot(a + d, b - c) + portable.hypot(a - d, b + c))


def stops_of(owner: Any, sheet: Sequence[str], in_mask: bool) -> tuple[Color, float]:
    """Return the colour of the stops of a gradient, and the exponent that the stops draw.

    Raise InputError if the stops have several colours, or if they are not the stops of any exponent
    in BETA_CLASSES.

    owner    element that contains the stops
    sheet    opacities of the stops in a style sheet. Empty if the stops themselves have opacities
    in_mask  whether the stops are those of a mask. Their colour is then white
    """
    colors, stops = set[Color](), []
    for k, stop in enumerate(owner):
        own = styled(stop)
        shade, opacity = own.get("stop-color", "black"), own.get("stop-opacity", "1")
        if sheet:
            shade, opacity = owner.get("color", ""), sheet[min(k, len(sheet) - 1)]
        color, height = color_of(shade, "stop-color"), share_of(opacity, "stop-opacity")
        if in_mask:
            color, height = (1.0, 1.0, 1.0), height * sum(color) / 3
        colors.add(color)
        stops.append((share_of(own.get("offset", "0"), "offset"), height))
    if len(colors) != 1:
        raise refusal("stops of its gradient", "of one colour", f"{len(colors)} colours")
    known = [row for row in _known_stops(in_mask) if len(row[1]) == len(stops)]
    errors = [float(np.abs(np.subtract(stops, one)).max()) for _, one in known]
    # The offsets and opacities may differ by at most .02 from those that write_svg writes. The
    # stops of two exponents differ by at least .1, so only one exponent can match.
    if min(errors, default=1.0) > 0.02:
        raise refusal("stops of its gradient", "those that write_svg writes", "others")
    return colors.pop(), known[int(np.argmin(errors))][0]


@lru_cache(maxsize=2)
def _known_stops(in_mask: bool) -> list[tuple[float, Floats]]:
    """Return all lists of stops that write_svg may write, each with its exponent.

    in_mask  whether to return the stops of gradients in masks, or those of all other gradients

    Each entry has an exponent, and an array (k, 2) with the offsets and opacities of k stops. There
    are several entries for an exponent, which differ in the number of stops.
    """
    counts, stops = (MASK_STOPS, grey_stops) if in_mask else (STOP_COUNTS, gradient_stops)
    unit = np.array([1, 15 if in_mask else 1])  # greys have one hex digit
    rows = product(BETA_CLASSES, counts)
    return [(beta, np.column_stack(stops(count, beta)) / unit) for beta, count in rows]


def gradient_id(mask: Any, edge: Affine) -> str:
    """Return the id of the gradient in a mask.

    Raise InputError unless the mask is a circle with the outline `edge`.
    """
    inside = [child.attrib for child in mask if child.tag == SVG + "circle"]
    key = reference_of(inside[0].get("fill", "")) if len(inside) == len(mask) == 1 else None
    if key is None or edges_of("circle", inside[0]) != [edge] or "maskUnits" in mask.attrib:
        raise refusal("its mask", "the same circle, as write_svg writes it", "another")
    return key


def blur_of(element: Any, edge: Affine) -> Blur:
    """Return the blur of BLURS that a filter applies to a circle with the outline `edge`.

    Raise InputError if the filter applies no such blur.
    """
    steps = [step.attrib for step in element if step.tag == SVG + "feGaussianBlur"]
    if len(steps) == len(element) == 1 and set(steps[0]) <= {"in", "stdDeviation", "id"}:
        deviation = numbers(steps[0].get("stdDeviation", ""), "stdDeviation", 1)[0]
        for blur in BLURS if edge[0] == edge[3] and not edge[1] else ():
            # The deviation in the file may differ a little from that of the blur, because editors
            # round numbers.
            if abs(edge[0] * blur.deviation - deviation) < 0.005 * deviation:
                return blur
    raise refusal("its filter", "a blur of a circle that write_svg writes", "another", "to undo")


def edges_of(tag: str, attributes: Mapping[str, str]) -> list[Affine]:
    """Return the edge of a circle, an ellipse or a closed path of four quarters of an ellipse.

    Return [] for all others. Raise InputError if a radius is less than 0.
    """
    if tag not in ("circle", "ellipse"):
        return _edges_of_arcs(attributes.get("d", "")) if tag == "path" else []
    names = ("r", "r", "cx", "cy") if tag == "circle" else ("rx", "ry", "cx", "cy")
    rx, ry, cx, cy = (numbers(attributes.get(name, "0"), name, 1)[0] for name in names)
    if rx < 0 or ry < 0:
        raise refusal("radii", "0 or more", f"{rx:g} and {ry:g}")
    return [(rx, 0.0, 0.0, ry, cx, cy)]


def _edges_of_arcs(data: str) -> list[Affine]:
    commands = _commands(data) if "a" in data.lower() else []
    if [letter.upper() for letter, _ in commands] != list("MAAAAZ"):
        return []
    (_, start), *arcs, _ = commands
    ends, (rx, ry, tilt) = [complex(*start)], arcs[0][1][:3]
    for letter, values in arcs:
        ends.append(complex(*values[5:]) + (ends[-1] if letter == "a" else 0))
    turn, center = _turn(math.radians(tilt)), sum(ends[1:]) / 4
    # Each arc must be a quarter of the ellipse. To check this, the ellipse is mapped onto the unit
    # circle. There, the ends of each arc must be a quarter of a turn apart. Errors of .02 are
    # allowed, because editors write only 8 digits, which are too few to be exact for thin arcs.
    with np.errstate(all="ignore"):
        turned = (np.array(ends) - center) * turn.conjugate()
        at = turned.real / rx + 1j * turned.imag / ry
        quarter = 1j if (at[1] / at[0]).imag > 0 else -1j
        errors = np.abs([np.abs(at) - 1, at / quarter ** np.arange(5) - at[0]])
    if any(values[:4] != [rx, ry, tilt, 0] for _, values in arcs) or not errors.max() <= 0.02:
        return []
    co, si = turn.real, turn.imag
    return [(rx * co, rx * si, -ry * si, ry * co, center.real, center.imag)]


def open_arcs(paths: Iterable[str]) -> dict[str, list[Affine]]:
    """Return the ellipses of each path that consists of open arcs. Leave out all other paths.

    paths  the d of each path. The keys of the result are those d that consist of open arcs
    """
    # Minimal markup writes the coordinates and the radii of arcs as whole numbers.
    place, radius, tilt = r"(-?\d{1,9})", r"([1-9]\d{0,8})", r"(-?(?:\d{1,3}(?:\.\d)?|\.\d))"
    arc = rf"([Mm]){place}[\s,]*+{place}a{radius} {radius}[\s,]*+{tilt} 10(1 0|0 1)"
    texts, rows = [], []
    for data in filter(re.compile(rf"(?:{arc})++").fullmatch, set(paths)):
        x = y = 0.0
        for move, left, top, *form, chord in re.findall(arc, data):
            x, y = (x + float(left), y + float(top)) if move == "m" else (float(left), float(top))
            texts.append(data)
            rows.append((*map(float, form), x, y))
            x, y = (x + 1, y) if chord == "1 0" else (x, y + 1)
    means, factors = arc_geometry(np.array(rows).reshape(-1, 5))
    ellipses = defaultdict[str, list[Affine]](list)
    for data, (l11, l21, l22), (x, y) in zip(texts, factors.tolist(), means.tolist(), strict=True):
        ellipses[data].append((l11, l21, 0.0, l22, x, y))
    return ellipses


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
        arc, right, lower = (
            f"a{rx} {ry} 0 0 1 ",
            f"h{across}" * (across > 0),
            f"v{down}" * (down > 0),
        )
        left, upper = right.replace("h", "h-"), lower.replace("v", "v-")
        first = f"M{x + rx} {y}{right}{arc}{rx} {ry}{lower}{arc}{-rx} {ry}"
        return f"{first}{left}{arc}{-rx} {-ry}{upper}{arc}{rx} {-ry}z"
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
        if closed and portable.hypot(*np.subtract(points[0], points[-1])) > 1e-6:
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
        # S and T are C and Q whose first handle reflects that of the command before.
        curve = {"S": "C", "T": "Q"}.get(kind, kind)
        if curve != kind:
            ends.insert(0, handle if curve == before else here)
        if len(ends) > 1:
            (u, v), (x, y) = ends[-2:]
            handle = 2 * x - u, 2 * y - v
        before = curve
        if curve == "Q":  # a cubic curve draws the same
            (u, v), end = ends
            ends = [*(((x + 2 * u) / 3, (y + 2 * v) / 3) for x, y in (here, end)), end]
        if kind == "A":
            ends = _arc(here, values[:5], ends[0])
        points += ends
        curved += [True] * (len(ends) // 3) if len(ends) != 1 else [False]
    add(points, curved, is_filled)
    if not outlines:
        raise refusal("its d", "lines and curves", quoted(data), "to undo the edit of its nodes")
    return tuple(outlines)


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
    # The flags of an arc need no blanks around them.
    gap, flag = r"[\s,]*+", r"[\s,]*+([01])"
    arc = (
        rf"{gap}({NUMBER}){gap}({NUMBER}){gap}({NUMBER}){flag}{flag}{gap}({NUMBER}){gap}({NUMBER})"
    )
    commands = []
    is_path = re.fullmatch(rf"(?=\s*+M)(?:{_COMMAND})++", data, re.IGNORECASE)
    for letter, text in re.findall(_COMMAND, data, re.IGNORECASE) if is_path else ():
        count = _COUNTS[letter.upper()]
        texts = re.findall(NUMBER, text)
        if letter in "Aa":
            texts = [
                number for numbers_of_arc in re.findall(arc, text) for number in numbers_of_arc
            ]
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
    # The two fill rules are compared at 32 places along each axis. 1e8 places times pieces take
    # about a second.
    if (len(polygons) + 32**2) * sum(map(len, polygons)) > 1e8:
        raise refusal(
            "a path of the fill-rule evenodd", "of fewer nodes", f"{len(polygons)} outlines"
        )
    points = np.concatenate(polygons)
    axes = np.linspace(points.min(axis=0), points.max(axis=0), 34)[1:-1].T
    places = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    inside, run = map(np.array, zip(*map(_inside, polygons), strict=True))
    # How often each outline runs around a point inside of each other one, and around the places
    places = np.concatenate([inside, places])
    winding = np.array([windings(polygon, places).astype(np.int16) for polygon in polygons])
    around, count = winding[:, : len(run)] % 2 != 0, len(run)
    depth = around.sum(axis=0) - around.diagonal()
    forward = (run > 0) == (depth % 2 == 0)
    after = (winding[forward].sum(axis=0) - winding[~forward].sum(axis=0))[count:]
    if ((winding.sum(axis=0)[count:] % 2 != 0) != (after != 0)).any():
        raise refusal("its fill-rule", "nonzero where outlines cross", "'evenodd'", "to split it")
    return tuple(
        outline if is_forward
        else Outline.of_segments(outline.segments[::-1, ::-1].tolist(), outline.curved[::-1])
        for outline, is_forward in zip(outlines, forward, strict=True)
    )  # fmt: skip


def _polygon(outline: Outline) -> Floats:
    """Return points (m, 2) along a closed outline, whose curves become straight pieces."""
    t = np.arange(8)[:, None] / 8
    weights = np.concatenate([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=1)
    points = (weights[..., None] * outline.segments[:, None]).sum(axis=2)
    return points[np.array(outline.curved)[:, None] | (np.arange(8) == 0)]


def _inside(polygon: Floats) -> tuple[Floats, float]:
    """Return a point just inside of a polygon, and 1 if the polygon turns from x to y, or -1.

    The point is beside the middle of a longest edge.
    """
    (x, y), (u, v) = polygon.T, np.roll(polygon, -1, axis=0).T
    run = float(np.sign((x * v - u * y).sum()))
    k = int(np.argmax((u - x) ** 2 + (v - y) ** 2))
    normal = np.array([y[k] - v[k], u[k] - x[k]])
    return (polygon[k] + [u[k], v[k]]) / 2 + 1e-4 * run * normal, run


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


def stroke_of(
    style: Mapping[str, str], outlines: Iterable[Outline], onto: Affine, root: Affine
) -> tuple[float, Cap]:
    """Return the width in px and the ends of a stroke along outlines.

    onto, root  maps from user space to px, of the path and of the root

    Raise InputError if a line cannot have such a stroke, or if its width is not even. The map of
    the root is taken as even, because minimal markup rounds the sides of the canvas.
    """
    advice = "to convert the stroke to a path"
    cap, join = style.get("stroke-linecap", "butt"), style.get("stroke-linejoin", "miter")
    if all(outline.closed for outline in outlines):  # closed outlines have no ends
        cap = "round" if join == "round" else "butt"
    elif all(len(outline.curved) == 1 for outline in outlines):  # one segment has no corners
        join = "round" if cap == "round" else "miter"
    if (dashes := style.get("stroke-dasharray", "none")) != "none":
        raise refusal("its stroke-dasharray", "none", quoted(dashes), "to remove it")
    joins: dict[str, Cap] = {"butt miter": "butt", "round round": "round", "square miter": "square"}
    if (ends := f"{cap} {join}") not in joins:
        needed, got = f"one of {', '.join(joins)}", f"{cap} {join}"
        raise refusal("its stroke-linecap and stroke-linejoin", needed, got, advice)
    text = style.get("stroke-width", "1")
    width = numbers(text.removesuffix("px"), "stroke-width", 1)[0]
    if not width > 0:
        raise refusal("its stroke-width", "above 0", quoted(text), "to delete it")
    a, b, c, d = onto[0] / root[0], onto[1] / root[3], onto[2] / root[0], onto[3] / root[3]
    across, down = portable.hypot(a, b), portable.hypot(c, d)
    is_even = abs(across - down) <= _TOLERANCE * down
    if not is_even or abs(a * c + b * d) > _TOLERANCE * across * down:
        raise refusal("transforms of a stroke", "without stretching and skewing", "others", advice)
    return width * across * math.sqrt(abs(root[0] * root[3])), joins[ends]


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
            raise refusal("stops of the gradient of an area", "opaque", "others")
        offset = share_of(_share(own.get("offset", "0")), "offset")
        offsets.append(max([offset, *offsets[-1:]]))
        colors.append(color_of(own.get("stop-color", "black"), "stop-color"))
    if len(colors) == 1:
        return colors[0]
    ramp = {"offsets": tuple(offsets), "colors": tuple(colors)}
    if values.get("gradientUnits", "objectBoundingBox") == "objectBoundingBox":
        own = outlines_of(data, (1.0, 0.0, 0.0, 1.0, 0.0, 0.0), True)
        points = np.concatenate([_polygon(outline) for outline in own])
        (left, top), (right, bottom) = points.min(axis=0), points.max(axis=0)
        onto = compose(onto, (right - left, 0.0, 0.0, bottom - top, left, top))
        box = {"x1": "0", "y1": "0", "x2": "1", "y2": "0", "cx": ".5", "cy": ".5", "r": ".5"}
        shares = {n: _share(values.get(n, share)) for n, share in box.items()}
        values = {**values, **shares, "gradientUnits": "userSpaceOnUse"}
    if tag == "radialGradient":
        a, b, c, d, x, y = compose(onto, disc_of(values))
        radii = portable.hypot(a, c), portable.hypot(b, d)
        if abs(a * b + c * d) > _TOLERANCE * radii[0] * radii[1]:
            raise refusal("its gradient", "a circle or an upright ellipse", "another")
        return RadialGradient(**ramp, center=(x, y), radii=radii)
    if values.get("spreadMethod", "pad") != "pad":
        raise refusal("its gradient", "without repetition", "another")
    names = {"x1": "0", "y1": "0", "x2": "100%", "y2": "0"}
    x1, y1, x2, y2 = (numbers(values.get(n, v), n, 1)[0] for n, v in names.items())
    own = transform_of(values.get("gradientTransform", ""), "gradientTransform")
    a, b, c, d, e, f = compose(onto, own)
    # `slope` is the gradient of the position along the axis, in the user space of the gradient. A
    # map with the linear part A turns it into the inverse of A^T times it.
    across, down = x2 - x1, y2 - y1
    squared, det = across**2 + down**2, a * d - b * c
    if not squared * det:
        raise refusal("its gradient", "longer than 0", "another")
    u, v = (d * across - b * down) / det, (a * down - c * across) / det
    scale = squared / (u * u + v * v)
    start = a * x1 + c * y1 + e, b * x1 + d * y1 + f
    return LinearGradient(**ramp, start=start, end=(start[0] + scale * u, start[1] + scale * v))
