"""What the elements of a file draw: the outlines of circles, ellipses and arcs, and their fills.

An affine map of the plane is a tuple of six numbers, in the order of SVG's matrix(a b c d e f):

    x' = a x + c y + e,   y' = b x + d y + f

Thousands are read one by one, where numpy is ten times slower than tuples.

An outline is the affine map of the unit circle onto a circle, an ellipse or a path of arcs.
Inkscape makes an ellipse of a circle that is moved by itself, and a path of four arcs of one that
is converted ("Object to Path"), whose arcs it keeps through every later transform. Minimal markup
writes many ellipses of one colour as open arcs of one path.

The exponent of a gradient is that of BETA_CLASSES whose profile the polygon of its stops is
nearest to,

    min over beta of  sqrt(integral (stops(x) - f(x R))^2 2 x dx),  R = cut_radius(beta), x in 0..1,

whatever the number of stops; tests/svg/test_stops.py has the margins. The stops of minimal markup
have their opacities in a style sheet, or are greys of a mask, whose luminance is the falloff.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import ImageColor

from gauss2svg.errors import InputError, quoted, refusal
from gauss2svg.scene import BLURRED, PLAIN, SOFT
from gauss2svg.scene.falloff import BETA_CLASSES, cut_radius, profile
from gauss2svg.svg.blur import BLURS, Blur
from gauss2svg.svg.canvas import NUMBER, numbers
from gauss2svg.svg.element import LARGEST_NUMBER
from gauss2svg.svg.minimal_shapes import arc_geometry
from gauss2svg.svg.source import SVG

Color = tuple[float, float, float]
Affine = tuple[float, float, float, float, float, float]
IDENTITY: Affine = (1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
_CALL = re.compile(r"[\s,]*([a-zA-Z]+)\s*\(([^()]*)\)[\s,]*")
_REFERENCE = re.compile(r"""\s*url\(\s*['"]?#([^'")\s]+)['"]?\s*\)""")
_COMMENT = re.compile(r"/\*.*?(?:\*/|\Z)", re.DOTALL)
FILTERS = "filter", "mask"
_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")
_LONGEST_CHAIN = 9  # of gradients: Inkscape makes chains of two
_RADII = (np.arange(512) + 0.5) / 512  # of the disc
_LARGEST_ERROR = 0.025  # three greys of a mask are .022 off, the next exponent .086
_TOLERANCE = 0.01  # share of the radius by which 8 digits move the ends of a thin arc
_GAP = r"[\s,]*"
_N = rf"({NUMBER}){_GAP}"
_ARC = re.compile(rf"{_GAP}([Aa]?){_GAP}{_N}{_N}{_N}([01]){_GAP}([01]){_GAP}{_N}{_N}")
_CLOSED = re.compile(rf"\s*[Mm]{_GAP}{_N}{_N}((?:{_ARC.pattern}){{4}})[Zz]\s*")
_OPEN_ARC = re.compile(
    rf"([Mm])({NUMBER}){_GAP}({NUMBER})a({NUMBER}){_GAP}({NUMBER}){_GAP}({NUMBER}) 10(1 0|0 1)"
)
_OPEN_ARCS = re.compile(rf"(?:{_OPEN_ARC.pattern})++")


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
        one = _call(call[1], numbers(call[2], name)) if call else None
        if call is None or one is None:
            raise InputError(
                f"{name} must be a list of matrix, translate, scale, rotate; got {quoted(text)}"
            )
        total = compose(total, one) if at else one
        at = call.end()
    return total


def _call(kind: str, values: list[float]) -> Affine | None:
    """Return the map of one transform function, or None for one that is not read."""
    match kind, values:
        case "matrix", [a, b, c, d, e, f]:
            return a, b, c, d, e, f
        case "translate", [x, *y] if len(y) < 2:
            return 1.0, 0.0, 0.0, 1.0, x, (*y, 0.0)[0]
        case "scale", [x, *y] if len(y) < 2:
            return x, 0.0, 0.0, (*y, x)[0], 0.0, 0.0
        case "rotate", [degrees, *center] if len(center) in (0, 2):
            cos, sin = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
            x, y = center or (0.0, 0.0)
            return cos, sin, -sin, cos, x - cos * x + sin * y, y - sin * x - cos * y
    return None


def share_of(text: str, name: str) -> float:
    """Return a number clamped to 0..1, as renderers do with opacities and offsets."""
    return min(max(numbers(text, name, 1)[0], 0.0), 1.0)


@lru_cache(maxsize=4096)
def color_of(text: str, name: str) -> Color:
    """Return an opaque sRGB colour in 0..1: #rgb, #rrggbb, rgb(..) or a name."""
    try:
        levels = ImageColor.getrgb(text.strip()[:40])
    except ValueError:
        levels = ()
    if len(levels) != 3:
        raise InputError(f"{name} must be an opaque colour, such as #1a2b3c; got {quoted(text)}")
    return levels[0] / 255, levels[1] / 255, levels[2] / 255


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
            raise InputError(
                f"its style must be without escapes and !important; got {quoted(part.strip())}"
            )
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


class Fills:
    """The fills that a document defines, each gradient read once.

    by_id      its elements
    opacities  of the stops of minimal markup, by the id that their gradient refers to
    """

    def __init__(self, by_id: Mapping[str, Any], opacities: Mapping[str, Sequence[str]]) -> None:
        self._by_id, self._opacities = by_id, opacities
        self._gradients: dict[tuple[str, bool], Fill] = {}

    def of(self, fill: str, attributes: Mapping[str, str], edge: Affine) -> Fill:
        """Return the fill of a shape with an outline; raise InputError for one of another file."""
        key, blur, mask = (
            reference_of(text) for text in (fill, *(attributes.get(n, "") for n in FILTERS))
        )
        if mask is not None:
            inside = _mask_key(target_of(self._by_id, mask, "mask"), edge)
            return self._gradient(inside, True)._replace(color=color_of(fill, "fill"))
        if key is not None and blur is None:
            return self._gradient(key, False)
        color = color_of(fill, "fill")
        if blur is None:
            return Fill(color)
        known = _blur(target_of(self._by_id, blur, "filter"), edge)
        return Fill(color, BLURRED, 1 / known.peak, known.beta, known.radius)

    def _gradient(self, key: str, in_mask: bool) -> Fill:
        if (key, in_mask) not in self._gradients:
            chain: list[Any] = []
            while (name := link_of(chain[-1]) if chain else key) and len(chain) < _LONGEST_CHAIN:
                chain.append(target_of(self._by_id, name, "radialGradient"))
            found = {name: value for e in reversed(chain) for name, value in e.attrib.items()}
            owner = next((e for e in chain if len(e)), chain[-1])
            color, heights = _stops(owner, self._opacities.get(link_of(owner), ()), in_mask)
            peak, beta = _exponent(heights)
            fill = Fill(color, SOFT, peak, beta, float(cut_radius(beta)), _disc(found))
            self._gradients[key, in_mask] = fill
        return self._gradients[key, in_mask]


def _disc(found: Mapping[str, str]) -> Affine:
    """Return the map of the unit circle onto the edge of a gradient with these attributes."""
    needed = {"gradientUnits": "userSpaceOnUse", "spreadMethod": "pad", "fr": "0"}
    for name, value in needed.items():
        if found.get(name, value if name in ("fr", "spreadMethod") else "") != value:
            raise refusal(f"{name} of its gradient", value, quoted(found.get(name)))
    cx, cy, r = (numbers(found.get(name, ""), name, 1)[0] for name in ("cx", "cy", "r"))
    fx, fy = (numbers(found[f], f, 1)[0] if f in found else c for f, c in (("fx", cx), ("fy", cy)))
    # Within a hundredth of the radius the focus changes the image by under a level.
    if not 100 * math.hypot(fx - cx, fy - cy) <= r > 0:
        raise refusal(
            "focus of its gradient", "the centre, and r above 0", f"{fx:g} {fy:g} and {r:g}"
        )
    onto = transform_of(found.get("gradientTransform", ""), "gradientTransform")
    return compose(onto, (r, 0.0, 0.0, r, cx, cy))


def _stops(
    owner: Any, sheet: Sequence[str], in_mask: bool
) -> tuple[Color, tuple[tuple[float, float], ...]]:
    """Return the colour of a gradient's stops, white in a mask, and their offsets and heights."""
    colors, heights = set[Color](), []
    for k, stop in enumerate(owner):
        own = styled(stop)
        if sheet:
            shade, opacity = owner.get("color", ""), sheet[min(k, len(sheet) - 1)]
        else:
            shade, opacity = own.get("stop-color", "black"), own.get("stop-opacity", "1")
        color, height = color_of(shade, "stop-color"), share_of(opacity, "stop-opacity")
        if in_mask:
            color, height = (1.0, 1.0, 1.0), height * sum(color) / 3
        colors.add(color)
        heights.append((share_of(own.get("offset", "0"), "offset"), height))
    if len(colors) != 1:
        raise refusal("stops of its gradient", "of one colour", f"{len(colors)} colours")
    return colors.pop(), tuple(heights)


@lru_cache(maxsize=64)
def _exponent(polygon: tuple[tuple[float, float], ...]) -> tuple[float, float]:
    """Return the height at the centre and the exponent of the profile that is nearest."""
    # An offset below the one before counts as that one, in every renderer.
    offsets = np.maximum.accumulate([offset for offset, _ in polygon])
    heights = np.array([height for _, height in polygon])
    drawn, area = np.interp(_RADII, offsets, heights), 2 * _RADII
    peaks = (area * drawn * _profiles()).sum(axis=1) / (area * _profiles() ** 2).sum(axis=1)
    shapes = drawn / np.maximum(peaks, 1e-6)[:, None]
    error = np.sqrt(np.mean(area * np.square(shapes - _profiles()), axis=1))
    best = int(error.argmin())
    peak = float(peaks[best])
    if error[best] > _LARGEST_ERROR or heights[-1] > 0.005 * peak:
        known = ", ".join(f"{beta:g}" for beta in BETA_CLASSES)
        got = f"others, {error[best]:.3f} off {BETA_CLASSES[best]:g}, the nearest"
        raise refusal("stops of its gradient", f"those of one of the exponents {known}", got)
    # Piecewise linear profiles differ from 1 by as much in their scale.
    return 1.0 if abs(peak - 1) < 0.01 else peak, BETA_CLASSES[best]


@lru_cache(maxsize=1)
def _profiles() -> NDArray[np.floating]:
    """(classes, samples) each exponent's profile over the disc."""
    return np.stack([profile(_RADII * cut_radius(beta), beta) for beta in BETA_CLASSES])


def _mask_key(mask: Any, edge: Affine) -> str:
    """Return the id of the gradient of a mask that is one circle, the same as what is under it."""
    inside = [child.attrib for child in mask if child.tag == SVG + "circle"]
    key = reference_of(inside[0].get("fill", "")) if len(inside) == len(mask) == 1 else None
    if key is None or outline_of("circle", inside[0]) != edge or "maskUnits" in mask.attrib:
        raise refusal("its mask", "the same circle, as write_svg writes it", "another")
    return key


def _blur(element: Any, edge: Affine) -> Blur:
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
        return _closed(attributes.get("d", ""))
    names = ("r", "r", "cx", "cy") if tag == "circle" else ("rx", "ry", "cx", "cy")
    rx, ry, cx, cy = (numbers(attributes.get(name, "0"), name, 1)[0] for name in names)
    if rx < 0 or ry < 0:
        raise refusal("radii", "0 or more", f"{rx:g} and {ry:g}")
    return rx, 0.0, 0.0, ry, cx, cy


def open_arcs(paths: Iterable[str]) -> dict[str, list[Affine]]:
    """Return the ellipses of those paths that minimal markup writes, by their text."""
    rows, counts = [], {}
    for data in filter(_OPEN_ARCS.fullmatch, set(paths)):
        own, x, y = [], 0.0, 0.0
        for move, left, top, rx, ry, tilt, chord in _OPEN_ARC.findall(data):
            x, y = (x + float(left), y + float(top)) if move == "m" else (float(left), float(top))
            own.append((float(rx), float(ry), float(tilt), x, y))
            x, y = (x + 1, y) if chord == "1 0" else (x, y + 1)
        if all(min(row[:2]) >= 1 and max(map(abs, row)) <= LARGEST_NUMBER for row in own):
            rows += own
            counts[data] = len(own)
    means, factors = arc_geometry(np.array(rows).reshape(-1, 5))
    columns = [factors[:, :2], 0 * factors[:, 0], factors[:, 2], means]
    maps = map(tuple, np.column_stack(columns).tolist())
    return {data: list(islice(maps, count)) for data, count in counts.items()}


def _closed(data: str) -> Affine:
    """Return the outline of a closed path of four arcs that go round one ellipse."""
    path = _CLOSED.fullmatch(data)
    if path is None:
        raise _not_ellipses(data)
    ends, shapes, letter = [(float(path[1]), float(path[2]))], set(), ""
    for kind, rx, ry, tilt, _, _, x, y in _ARC.findall(path[3]):
        letter = kind or letter
        left, top = ends[-1] if letter == "a" else (0.0, 0.0)
        ends.append((float(x) + left, float(y) + top))
        shapes.add((float(rx), float(ry), float(tilt)))
    (rx, ry, tilt) = shapes.pop()
    cos, sin = math.cos(math.radians(tilt)), math.sin(math.radians(tilt))
    # The ends lie symmetrically, so that their mean is the centre; where the ellipse is the unit
    # circle they are a quarter of a turn apart.
    with np.errstate(all="ignore"):
        center = np.mean(ends[1:], axis=0)
        at = (ends - center) @ [[cos, -sin], [sin, cos]] / (rx, ry) @ (1, 1j)
        turns = at[1:] / at[:-1]
        quarter = 1j if turns[0].imag > 0 else -1j
        is_round = np.allclose(np.abs(at), 1, atol=_TOLERANCE)
        if shapes or not is_round or not np.allclose(turns, quarter, atol=2 * _TOLERANCE):
            raise _not_ellipses(data)
    return rx * cos, rx * sin, -ry * sin, ry * cos, *center.tolist()


def _not_ellipses(data: str) -> InputError:
    return refusal(
        "its d", "an ellipse of four arcs", quoted(data), "to undo the edit of its nodes"
    )
