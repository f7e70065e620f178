"""Read the outline and the fill of each shape of a file: of circles, ellipses and paths of arcs.

An affine map of the plane is a tuple of six numbers, in the order of SVG's matrix(a b c d e f):

    x' = a x + c y + e,   y' = b x + d y + f

Maps are tuples, and not arrays, because thousands of them are read one by one. With numpy this
would take ten times as long.

An outline is the affine map of the unit circle onto a circle, an ellipse or a path of arcs. If a
single circle is moved, Inkscape makes it an ellipse. "Object to Path" makes it a path of four arcs,
and each later transform keeps the arcs. Minimal markup writes many ellipses of the same colour as
open arcs of one path.

The exponent of a gradient is the one of BETA_CLASSES to which its stops belong. In minimal markup,
the opacities of the stops are in a style sheet, or the stops are the greys of a mask. The luminance
of such a grey is the falloff.
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
from numpy.typing import NDArray
from PIL import ImageColor

from gauss2svg import portable
from gauss2svg.errors import quoted, refusal
from gauss2svg.scene import PLAIN
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.svg import STOP_COUNTS
from gauss2svg.svg.file import NUMBER, SVG, numbers
from gauss2svg.svg.forms import BLURS, Blur
from gauss2svg.svg.minimal import MASK_STOPS
from gauss2svg.svg.minimal_shapes import arc_geometry
from gauss2svg.svg.stops import MOST_GREY, gradient_stops, grey_stops

Color = tuple[float, float, float]
Affine = tuple[float, float, float, float, float, float]
_CALL = re.compile(r"[\s,]*+(matrix|translate|scale|rotate|skewX|skewY)\s*+\(([^()]*+)\)[\s,]*+")
_CALLS = re.compile(rf"(?:{_CALL.pattern})*+\s*+")
_REFERENCE = re.compile(r"""\s*url\(\s*['"]?#([^'")\s]+)['"]?\s*\)""")
_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
# When a file is read, a gradient gets the exponent for which write_svg writes such stops. The
# offsets and opacities may differ by at most this from those that write_svg writes. The stops of
# two exponents differ by at least 0.1, so only one exponent can match.
_SAME_STOP = 0.02
# A gradient may reach this far beyond the ellipse that it fills, in px, because editors round
# numbers.
MOST_BEYOND_PX = 0.05
# The end of an arc may be away from its exact place by at most this, as a multiple of the radius.
# Some error must be allowed, because editors write only 8 digits, which are too few to be exact for
# thin arcs.
_ARC_END_TOLERANCE = 0.02
_GAP = r"[\s,]*+"
_N = rf"({NUMBER}){_GAP}"
ARC = re.compile(rf"{_GAP}([Aa]?){_GAP}{_N}{_N}{_N}([01]){_GAP}([01]){_GAP}{_N}{_N}")
_CLOSED = re.compile(rf"\s*[Mm]{_GAP}{_N}{_N}((?:{ARC.pattern}){{4}})[Zz]\s*")
# Minimal markup writes the coordinates and the radii of arcs as whole numbers.
_PLACE, _RADIUS = r"(-?\d{1,9})", r"([1-9]\d{0,8})"
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
    "skewX": lambda degrees: (1.0, 0.0, _tangent(math.radians(degrees)), 1.0, 0.0, 0.0),
    "skewY": lambda degrees: (1.0, _tangent(math.radians(degrees)), 0.0, 1.0, 0.0, 0.0),
}


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
    # If the text gives a function such as rotate too many or too few values, TypeError is raised.
    with suppress(TypeError):
        maps = [_FUNCTIONS[call](*numbers(values, name)) for call, values in _CALL.findall(text)]
        if _CALLS.fullmatch(text):
            return reduce(compose, maps, (1.0, 0.0, 0.0, 1.0, 0.0, 0.0))
    raise refusal(name, "a list of matrix, translate, scale, rotate and skew", quoted(text))


def _rotation(angle_rad: float, x: float, y: float) -> Affine:
    cos, sin = portable.cos(angle_rad), portable.sin(angle_rad)
    return cos, sin, -sin, cos, x - cos * x + sin * y, y - sin * x - cos * y


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
    match = _REFERENCE.match(text)
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
    return next((element.get(h) for h in _HREFS if element.get(h)), "").removeprefix("#")


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
        needed = "in user space, with its focus at the centre"
        raise refusal("its gradient", needed, "another", "to undo what changed it")
    onto = transform_of(values.get("gradientTransform", ""), "gradientTransform")
    return compose(onto, (r, 0.0, 0.0, r, cx, cy))


def _tangent(angle_rad: float) -> float:
    return portable.sin(angle_rad) / portable.cos(angle_rad)


def beyond_px(edge: NDArray[np.float64], disc: NDArray[np.float64]) -> NDArray[np.float64]:
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


def determinants(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the determinants (n,) of matrices (n, 2, 2)."""
    (a, c), (b, d) = linear.transpose(1, 2, 0)
    return a * d - b * c


def larger_axis(linear: NDArray[np.float64]) -> NDArray[np.float64]:
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
    if min(errors, default=1.0) > _SAME_STOP:
        needed = f"those of one of the exponents {', '.join(f'{b:g}' for b in BETA_CLASSES)}"
        raise refusal("stops of its gradient", needed, "others", "to undo what changed them")
    return colors.pop(), known[int(np.argmin(errors))][0]


@lru_cache(maxsize=2)
def _known_stops(in_mask: bool) -> list[tuple[float, NDArray[np.float64]]]:
    """Return all lists of stops that write_svg may write, each with its exponent.

    in_mask  whether to return the stops of gradients in masks, or those of all other gradients

    Each entry has an exponent, and an array (k, 2) with the offsets and opacities of k stops. There
    are several entries for an exponent, which differ in the number of stops.
    """
    counts, stops = (MASK_STOPS, grey_stops) if in_mask else (STOP_COUNTS, gradient_stops)
    unit = np.array([1, MOST_GREY if in_mask else 1])
    rows = product(BETA_CLASSES, counts)
    return [(beta, np.column_stack(stops(count, beta)) / unit) for beta, count in rows]


def gradient_id(mask: Any, edge: Affine) -> str:
    """Return the id of the gradient in a mask.

    Raise InputError unless the mask is a circle with the outline `edge`.
    """
    inside = [child.attrib for child in mask if child.tag == SVG + "circle"]
    key = reference_of(inside[0].get("fill", "")) if len(inside) == len(mask) == 1 else None
    if key is None or outline_of("circle", inside[0]) != edge or "maskUnits" in mask.attrib:
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


def outline_of(tag: str, attributes: Mapping[str, str]) -> Affine:
    """Return the outline of a circle, an ellipse or a closed path of four arcs.

    Raise InputError if a radius is less than 0, or if a path is not a closed path of four arcs.
    """
    if tag == "path":
        return _closed(attributes.get("d", ""))
    names = ("r", "r", "cx", "cy") if tag == "circle" else ("rx", "ry", "cx", "cy")
    rx, ry, cx, cy = (numbers(attributes.get(name, "0"), name, 1)[0] for name in names)
    if rx < 0 or ry < 0:
        raise refusal("radii", "0 or more", f"{rx:g} and {ry:g}")
    return rx, 0.0, 0.0, ry, cx, cy


def open_arcs(paths: Iterable[str]) -> dict[str, list[Affine]]:
    """Return the ellipses of each path that consists of open arcs. Leave out all other paths.

    paths  the d of each path. The keys of the result are those d that consist of open arcs
    """
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


def is_ellipse(data: str) -> bool:
    """Return whether path data are those of a closed path of four arcs."""
    return _CLOSED.fullmatch(data) is not None


def _closed(data: str) -> Affine:
    """Return the outline of a closed path of four arcs.

    Raise InputError unless each arc is a quarter of the same ellipse.
    """
    if path := _CLOSED.fullmatch(data):
        ends, letter = [complex(float(path[1]), float(path[2]))], ""
        arcs = ARC.findall(path[3])
        for kind, *_, x, y in arcs:
            letter = kind or letter
            ends.append(complex(float(x), float(y)) + (ends[-1] if letter == "a" else 0))
        rx, ry, tilt_rad = float(arcs[0][1]), float(arcs[0][2]), math.radians(float(arcs[0][3]))
        center = sum(ends[1:]) / 4
        # Each arc must be a quarter of the ellipse. To check this, the ellipse is mapped onto the
        # unit circle. There, the ends of each arc must be a quarter of a turn apart.
        with np.errstate(all="ignore"):
            turned = (np.array(ends) - center) * complex(
                portable.cos(tilt_rad), -portable.sin(tilt_rad)
            )
            at = turned.real / rx + 1j * turned.imag / ry
            quarter = 1j if (at[1] / at[0]).imag > 0 else -1j
            errors = np.abs([np.abs(at) - 1, at / quarter ** np.arange(5) - at[0]])
        if {arc[1:4] for arc in arcs} == {arcs[0][1:4]} and errors.max() <= _ARC_END_TOLERANCE:
            a, b, c, d, _, _ = _rotation(tilt_rad, 0.0, 0.0)
            return rx * a, rx * b, ry * c, ry * d, center.real, center.imag
    raise refusal("its d", "an ellipse of four arcs", quoted(data), "to undo the edit of its nodes")
