"""What the elements of a file draw: the outlines of circles, ellipses and arcs, and their fills.

An affine map of the plane is a tuple of six numbers, in the order of SVG's matrix(a b c d e f):

    x' = a x + c y + e,   y' = b x + d y + f

Thousands are read one by one, where numpy is ten times slower than tuples.

An outline is the affine map of the unit circle onto a circle, an ellipse or a path of arcs.
Inkscape makes an ellipse of a circle that is moved by itself, and a path of four arcs of one that
is converted ("Object to Path"), whose arcs it keeps through every later transform. Minimal markup
writes many ellipses of one colour as open arcs of one path.

The exponent of a gradient is the one of BETA_CLASSES for which files have such stops. The stops of
minimal markup have their opacities in a style sheet, or are greys of a mask, whose luminance is the
falloff.
"""

from __future__ import annotations

import math
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from gauss2svg.errors import quoted, refusal
from gauss2svg.scene import PLAIN
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.svg.blur import BLURS, Blur
from gauss2svg.svg.canvas import NUMBER, numbers
from gauss2svg.svg.document import STOP_COUNTS
from gauss2svg.svg.minimal import MASK_STOPS
from gauss2svg.svg.minimal_shapes import arc_geometry
from gauss2svg.svg.source import SVG
from gauss2svg.svg.stops import MOST_GREY, gradient_stops, grey_stops

Color = tuple[float, float, float]
Affine = tuple[float, float, float, float, float, float]
IDENTITY: Affine = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
_CALL = re.compile(r"[\s,]*([a-zA-Z]+)\s*\(([^()]*)\)[\s,]*")
_REFERENCE = re.compile(r"""\s*url\(\s*['"]?#([^'")\s]+)['"]?\s*\)""")
_COMMENT = re.compile(r"/\*.*?(?:\*/|\Z)", re.DOTALL)
_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
# Largest difference of a stop from that of a file. Those of two exponents are .1 apart.
_SAME_STOP = 0.02
_ROUNDING = 0.05  # px by which a gradient may reach beyond its ellipse
_TOLERANCE = 0.01  # share of the radius by which 8 digits move the ends of a thin arc
_GAP = r"[\s,]*"
_N = rf"({NUMBER}){_GAP}"
_ARC = re.compile(rf"{_GAP}([Aa]?){_GAP}{_N}{_N}{_N}([01]){_GAP}([01]){_GAP}{_N}{_N}")
_CLOSED = re.compile(rf"\s*[Mm]{_GAP}{_N}{_N}((?:{_ARC.pattern}){{4}})[Zz]\s*")
_PLACE, _RADIUS = r"(-?\d{1,9})", r"([1-9]\d{0,8})"  # whole numbers, as minimal markup has them
_TILT = r"(-?(?:\d{1,3}(?:\.\d)?|\.\d))"
_OPEN_ARC = re.compile(
    rf"([Mm]){_PLACE}{_GAP}{_PLACE}a{_RADIUS} {_RADIUS}{_GAP}{_TILT} 10(1 0|0 1)"
)
_OPEN_ARCS = re.compile(rf"(?:{_OPEN_ARC.pattern})++")
_FUNCTIONS = {
    "matrix": lambda a, b, c, d, e, f: (a, b, c, d, e, f),
    "translate": lambda x, y=0.0: (1.0, 0.0, 0.0, 1.0, x, y),
    "scale": lambda x, y=None: (x, 0.0, 0.0, x if y is None else y, 0.0, 0.0),
    "rotate": lambda degrees, *at: _rotation(math.radians(degrees), *(at or (0.0, 0.0))),
}


def compose(outer: Affine, inner: Affine) -> Affine:
    """Return the map that does `inner` first, then `outer`."""
    a, b, c, d, e, f = outer
    p, q, r, s, t, u = inner
    return (
        a * p + c * q, b * p + d * q, a * r + c * s, b * r + d * s,
        a * t + c * u + e, b * t + d * u + f,
    )  # fmt: skip


def transform_of(text: str, name: str = "transform") -> Affine:
    """Return the map of a list of matrix, translate, scale and rotate in degrees.

    Raise InputError for anything else.
    """
    total, at = IDENTITY, 0
    while at < len(text.rstrip()):
        call = _CALL.match(text, at)
        try:
            one = _FUNCTIONS[call[1]](*numbers(call[2], name)) if call else None
        except (KeyError, TypeError):  # of another function, or of another number of values
            one = None
        if call is None or one is None:
            needed = "a list of matrix, translate, scale, rotate"
            raise refusal(name, needed, quoted(text))
        total, at = compose(total, one), call.end()
    return total


def _rotation(angle_rad: float, x: float, y: float) -> Affine:
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return cos, sin, -sin, cos, x - cos * x + sin * y, y - sin * x - cos * y


def share_of(text: str, name: str) -> float:
    """Return a number clamped to 0..1, as renderers do with opacities and offsets."""
    return min(max(numbers(text, name, 1)[0], 0.0), 1.0)


@lru_cache(maxsize=4096)
def color_of(text: str, name: str) -> Color:
    """Return an opaque sRGB colour in 0..1: #rgb, #rrggbb, rgb(..) or a name."""
    try:
        red, green, blue = map(int, ImageColor.getrgb(text.strip()[:40]))
    except ValueError:  # also where there is an alpha
        raise refusal(name, "an opaque colour, such as #1a2b3c", quoted(text)) from None
    return red / 255, green / 255, blue / 255


def reference_of(text: str) -> str | None:
    """Return the id in url(#id), or None where there is no such reference."""
    match = _REFERENCE.match(text)
    return match[1] if match else None


def styled(element: Any) -> dict[str, str]:
    """Return the attributes of an element, overridden by the properties of its style.

    Raise InputError for escapes in names and for what is !important.
    """
    attributes: dict[str, str] = element.attrib
    if "style" not in attributes:
        return attributes
    attributes = dict(attributes)
    for part in _COMMENT.sub(" ", attributes["style"]).split(";"):
        name, colon, value = part.partition(":")
        if "\\" in name or "!" in value:
            needed = "without escapes and !important"
            raise refusal("its style", needed, quoted(part.strip()))
        if colon:
            attributes[name.strip().lower()] = value.strip()
    return attributes


class Fill(NamedTuple):
    """What fills an outline.

    color   sRGB in 0..1
    drawn   of the shape in a scene
    peak    opacity at the centre
    beta    exponent, and radius in sigmas of the circle that `disc` is; 0 of a plain ellipse
    disc    the map of the unit circle onto a gradient's edge in user space; None: the outline
    """

    color: Color
    drawn: int = PLAIN
    peak: float = 1.0
    beta: float = 0.0
    radius: float = 0.0
    disc: Affine | None = None


def target_of(by_id: Mapping[str, Any], key: str | None, *tags: str) -> Any:
    """Return the element of an id; raise InputError unless it is one of these."""
    found = by_id.get(key or "")
    if found is None or found.tag.removeprefix(SVG) not in tags:
        raise refusal("its reference", f"to a {tags[0]} in the file", quoted(key), "to remove it")
    return found


def link_of(element: Any) -> str:
    """Return the id that an element's href refers to, "" for none."""
    return next((element.get(h) for h in _HREFS if element.get(h)), "").removeprefix("#")


def disc_of(gradient: Mapping[str, str]) -> Affine:
    """Return the map of the unit circle onto the edge of a gradient with these attributes."""
    focus = {"fx": gradient.get("cx", ""), "fy": gradient.get("cy", "")}
    said = {"spreadMethod": "pad", "fr": "0", **focus, **gradient}
    cx, cy, r, fx, fy = (
        numbers(said.get(name, ""), f"{name} of its gradient", 1)[0]
        for name in ("cx", "cy", "r", "fx", "fy")
    )
    kind = said.get("gradientUnits"), said["spreadMethod"], said["fr"]
    # Within a hundredth of the radius the focus changes the image by under a level.
    is_round = r > 0 and 100 * math.hypot(fx - cx, fy - cy) <= r
    if kind != ("userSpaceOnUse", "pad", "0") or not is_round:
        needed = "in user space, with its focus at the centre"
        raise refusal("its gradient", needed, "another", "to undo what changed it")
    onto = transform_of(said.get("gradientTransform", ""), "gradientTransform")
    return compose(onto, (r, 0.0, 0.0, r, cx, cy))


def shows(edge: Affine, disc: Affine, onto: Affine) -> bool:
    """Return whether an ellipse with an extent shows all of a gradient, but for a rounding.

    edge, disc  maps of the unit circle onto the ellipse and onto the gradient's edge
    onto        map onto the canvas in px
    """
    a, b, c, d, e, f = edge
    size = a * d - b * c
    if edge == disc or not size:
        return bool(size)
    onto_unit = d / size, -b / size, -c / size, a / size, 0.0, 0.0
    p, q, r, s, x, y = disc
    p, q, r, s, x, y = compose(onto_unit, (p, q, r, s, x - e, y - f))
    larger_axis = 0.5 * (math.hypot(p + s, q - r) + math.hypot(p - s, q + r))
    beyond = larger_axis + math.hypot(x, y) - 1  # in radii of the ellipse
    a, b, c, d, _, _ = compose(onto, edge)
    minor_axis = 0.5 * abs(math.hypot(a + d, b - c) - math.hypot(a - d, b + c))
    return beyond * minor_axis <= _ROUNDING


def stops_of(owner: Any, sheet: Sequence[str], in_mask: bool) -> tuple[Color, float]:
    """Return the colour of a gradient's stops, white in a mask, and their exponent.

    owner  the element that has them
    sheet  their opacities, where these are in a style sheet
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
    if min(errors, default=1.0) > _SAME_STOP:
        needed = f"those of one of the exponents {', '.join(f'{b:g}' for b in BETA_CLASSES)}"
        raise refusal("stops of its gradient", needed, "others", "to undo what changed them")
    return colors.pop(), known[int(np.argmin(errors))][0]


@lru_cache(maxsize=2)
def _known_stops(in_mask: bool) -> list[tuple[float, NDArray[np.float64]]]:
    """Return the exponents of files, each with the offsets and heights (k, 2) of its stops."""
    known = []
    for beta in BETA_CLASSES:
        for count in MASK_STOPS if in_mask else STOP_COUNTS:
            offsets, heights = (grey_stops if in_mask else gradient_stops)(count, beta)
            scale = MOST_GREY if in_mask else 1
            known.append((beta, np.column_stack([offsets, np.divide(heights, scale)])))
    return known


def mask_key(mask: Any, edge: Affine) -> str:
    """Return the id of the gradient of a mask that is one circle, the same as what is under it."""
    inside = [child.attrib for child in mask if child.tag == SVG + "circle"]
    key = reference_of(inside[0].get("fill", "")) if len(inside) == len(mask) == 1 else None
    if key is None or outline_of("circle", inside[0]) != edge or "maskUnits" in mask.attrib:
        raise refusal("its mask", "the same circle, as write_svg writes it", "another")
    return key


def blur_of(element: Any, edge: Affine) -> Blur:
    """Return the blur of a circle by a filter; raise InputError for one that is not written."""
    steps = [step.attrib for step in element if step.tag == SVG + "feGaussianBlur"]
    if len(steps) == len(element) == 1 and set(steps[0]) <= {"in", "stdDeviation", "id"}:
        deviation = numbers(steps[0].get("stdDeviation", ""), "stdDeviation", 1)[0]
        # An editor rounds.
        known = [b for b in BLURS if abs(edge[0] * b.deviation - deviation) < 0.005 * deviation]
        if known and edge[0] == edge[3] and not edge[1]:
            return known[0]
    raise refusal("its filter", "a blur of a circle that write_svg writes", "another", "to undo")


def outline_of(tag: str, attributes: Mapping[str, str]) -> Affine:
    """Return the outline of a circle, an ellipse or a closed path of four arcs.

    Raise InputError for a radius under 0 and for any other path.
    """
    if tag == "path":
        outline = _closed(attributes.get("d", ""))
        if outline is None:
            needed, got = "an ellipse of four arcs", quoted(attributes.get("d", ""))
            raise refusal("its d", needed, got, "to undo the edit of its nodes")
        return outline
    names = ("r", "r", "cx", "cy") if tag == "circle" else ("rx", "ry", "cx", "cy")
    rx, ry, cx, cy = (numbers(attributes.get(name, "0"), name, 1)[0] for name in names)
    if rx < 0 or ry < 0:
        raise refusal("radii", "0 or more", f"{rx:g} and {ry:g}")
    return rx, 0.0, 0.0, ry, cx, cy


def open_arcs(paths: Iterable[str]) -> dict[str, list[Affine]]:
    """Return the ellipses of those paths that minimal markup writes, by their text."""
    texts, rows = [], []
    for data in filter(_OPEN_ARCS.fullmatch, set(paths)):
        x = y = 0.0
        for move, left, top, rx, ry, tilt, chord in _OPEN_ARC.findall(data):
            x, y = (x + float(left), y + float(top)) if move == "m" else (float(left), float(top))
            texts.append(data)
            rows.append((float(rx), float(ry), float(tilt), x, y))
            x, y = (x + 1, y) if chord == "1 0" else (x, y + 1)
    means, factors = arc_geometry(np.array(rows).reshape(-1, 5))
    ellipses = defaultdict[str, list[Affine]](list)
    for data, (l11, l21, l22), (x, y) in zip(texts, factors.tolist(), means.tolist(), strict=True):
        ellipses[data].append((l11, l21, 0.0, l22, x, y))
    return ellipses


def _closed(data: str) -> Affine | None:
    """Return the outline of a closed path of four arcs that go round one ellipse, or None."""
    path = _CLOSED.fullmatch(data)
    if path is None:
        return None
    ends, ellipses, letter = [complex(float(path[1]), float(path[2]))], set(), ""
    for kind, rx, ry, tilt, _, _, x, y in _ARC.findall(path[3]):
        letter = kind or letter
        ends.append(complex(float(x), float(y)) + (ends[-1] if letter == "a" else 0))
        ellipses.add((float(rx), float(ry), math.radians(float(tilt))))
    rx, ry, tilt_rad = ellipses.pop()
    # The ends lie symmetrically, so that their mean is the centre; where the ellipse is the unit
    # circle they are a quarter of a turn apart.
    with np.errstate(all="ignore"):
        center = complex(np.mean(ends[1:]))
        turned = (np.array(ends) - center) * np.exp(-1j * tilt_rad)
        at = turned.real / rx + 1j * turned.imag / ry
        turns = at[1:] / at[:-1]
        is_round = np.allclose(np.abs(at), 1, atol=_TOLERANCE)
        quarter = 1j if turns[0].imag > 0 else -1j
        if ellipses or not is_round or not np.allclose(turns, quarter, atol=2 * _TOLERANCE):
            return None
    a, b, c, d, _, _ = _rotation(tilt_rad, 0.0, 0.0)
    return rx * a, rx * b, ry * c, ry * d, center.real, center.imag
