"""Read how elements are painted: styles, colours, gradients, masks, filters and strokes.

The exponent of a gradient is the one of BETA_CLASSES to which its stops belong. In minimal markup,
the opacities of the stops are in a style sheet, or the stops are the greys of a mask. The luminance
of such a grey is the falloff.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from PIL import ImageColor

from gauss2svg import portable
from gauss2svg.errors import quoted, refusal
from gauss2svg.scene import PLAIN, SOFT
from gauss2svg.scene.areas import Cap, Color, LinearGradient, Outline, Paint, RadialGradient
from gauss2svg.scene.falloff import BETA_CLASSES, cut_radius
from gauss2svg.svg import STOP_COUNTS
from gauss2svg.svg.element import Floats
from gauss2svg.svg.file import SVG, numbers
from gauss2svg.svg.forms import BLURS, Blur, gradient_stops, grey_stops
from gauss2svg.svg.minimal import MASK_STOPS
from gauss2svg.svg.paths import Affine, ellipses_of, polygons_of

# A gradient may be turned by this, and a stroke be stretched by this, as a share of its size,
# because editors round numbers.
_TOLERANCE = 1e-4


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


class Fill(NamedTuple):
    """The fill of a shape.

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


class Gradient(NamedTuple):
    """A gradient of a file.

    tag        linearGradient or radialGradient
    values     attributes, those of the gradients to which it refers included
    stops      offset, colour and opacity of each stop
    is_falloff whether it is the falloff of a shape, and not the paint of an area
    """

    tag: str
    values: Mapping[str, str]
    stops: list[tuple[float, Color, float]]
    is_falloff: bool

    @classmethod
    def of(
        cls, by_id: Mapping[str, Any], key: str, rules: Mapping[tuple[str, int], dict[str, str]]
    ) -> Gradient:
        """Return the gradient with an id.

        rules  properties of stops in a style sheet, by the id to which their gradient refers and
               the index of the stop
        """
        chain, name = list[Any](), key
        while name and len(chain) < 9:  # Inkscape writes two
            chain.append(target_of(by_id, name, "radialGradient", "linearGradient"))
            name = link_of(chain[-1])
        values = {name: value for e in reversed(chain) for name, value in e.attrib.items()}
        owner = next((e for e in chain if len(e)), chain[-1])
        stops = list[tuple[float, Color, float]]()
        for k, stop in enumerate(owner):
            own = {**rules.get((link_of(owner), k), {}), **styled(stop)}
            shade = own.get("stop-color", "black")
            if shade == "currentColor":
                shade = styled(owner).get("color", shade)
            if stop.tag != SVG + "stop":
                raise refusal("stops of its gradient", "all that it has", "others")
            offset, color = _share(own.get("offset", "0")), color_of(shade, "stop-color")
            opacity = share_of(own.get("stop-opacity", "1"), "stop-opacity")
            stops.append((share_of(offset, "offset"), color, opacity))
        tag = chain[0].tag.removeprefix(SVG)
        has_falloff = any(opacity < 1 for *_, opacity in stops)
        return cls(tag, values, stops, has_falloff and tag == "radialGradient")

    def fill(self, in_mask: bool = False) -> Fill:
        """Return the fill that the gradient, or a mask with it, gives to a shape.

        Raise InputError if write_svg does not write such a gradient, for example if its stops have
        several colours, or belong to no exponent of BETA_CLASSES.
        """
        rows = [(at, opacity) for at, _, opacity in self.stops]
        colors = {color for _, color, _ in self.stops}
        if in_mask:
            rows = [(at, opacity * sum(color) / 3) for at, color, opacity in self.stops]
            colors = {(1.0, 1.0, 1.0)}
        if len(colors) != 1:
            raise refusal("stops of its gradient", "of one colour", f"{len(colors)} colours")
        known = [row for row in _known_stops(in_mask) if len(row[1]) == len(rows)]
        errors = [float(np.abs(np.subtract(rows, one)).max()) for _, one in known]
        # The offsets and opacities may differ by at most .02 from those that write_svg writes. The
        # stops of two exponents differ by at least .1, so only one exponent can match.
        if min(errors, default=1.0) > 0.02:
            raise refusal("stops of its gradient", "those that write_svg writes", "others")
        beta = known[int(np.argmin(errors))][0]
        return Fill(colors.pop(), SOFT, 1.0, beta, float(cut_radius(beta)), _disc(self.values))

    def paint(self, own: Iterable[Outline], onto: Affine) -> Paint:
        """Return the paint of an area in px, which is a colour if there is one stop.

        own   outlines of the area in user units
        onto  map from user space to px

        Raise InputError if an area cannot have such a gradient.
        """
        values, offsets = self.values, [at for at, *_ in self.stops]
        colors = tuple(color for _, color, _ in self.stops)
        if not colors or any(opacity < 1 for *_, opacity in self.stops):
            raise refusal("stops of the gradient of an area", "opaque", "others")
        if len(colors) == 1:
            return colors[0]
        ramp = {"offsets": tuple(np.maximum.accumulate(offsets).tolist()), "colors": colors}
        if values.get("gradientUnits", "objectBoundingBox") == "objectBoundingBox":
            points = np.concatenate(polygons_of(tuple(own)))
            (left, top), (right, bottom) = points.min(axis=0).tolist(), points.max(axis=0).tolist()
            onto @= Affine(right - left, 0.0, 0.0, bottom - top, left, top)
            box = {"x1": "0", "y1": "0", "x2": "1", "y2": "0", "cx": ".5", "cy": ".5", "r": ".5"}
            shares = {n: _share(values.get(n, share)) for n, share in box.items()}
            values = {**values, **shares, "gradientUnits": "userSpaceOnUse"}
        if self.tag == "radialGradient":
            a, b, c, d, x, y = onto @ _disc(values)
            radii = portable.hypot(a, c), portable.hypot(b, d)
            if abs(a * b + c * d) > _TOLERANCE * radii[0] * radii[1]:
                raise refusal("its gradient", "a circle or an upright ellipse", "another")
            return RadialGradient(**ramp, center=(x, y), radii=radii)
        if values.get("spreadMethod", "pad") != "pad":
            raise refusal("its gradient", "without repetition", "another")
        names = {"x1": "0", "y1": "0", "x2": "100%", "y2": "0"}
        x1, y1, x2, y2 = (numbers(values.get(n, v), n, 1)[0] for n, v in names.items())
        onto @= Affine.of_text(values.get("gradientTransform", ""), "gradientTransform")
        # (u, v) is the gradient of the position along the axis. A map with the linear part A turns
        # it into the inverse of A^T times it.
        across, down, det = x2 - x1, y2 - y1, onto.determinant
        squared = across**2 + down**2
        if not squared * det:
            raise refusal("its gradient", "longer than 0", "another")
        u = (onto.d * across - onto.b * down) / det
        v = (onto.a * down - onto.c * across) / det
        if not u * u + v * v:  # the map is too large for numbers
            raise refusal("its gradient", "of usual size", "another")
        scale, (x, y) = squared / (u * u + v * v), onto.at(x1, y1)
        return LinearGradient(**ramp, start=(x, y), end=(x + scale * u, y + scale * v))


def _share(text: str) -> str:
    """Return a percentage as the text of a number, and any other text unchanged."""
    return f"{numbers(text[:-1], 'a gradient', 1)[0] / 100}" if text.endswith("%") else text


def _disc(gradient: Mapping[str, str]) -> Affine:
    """Return the map of the unit circle onto the edge of a gradient that has these attributes.

    Raise InputError if it is not in user space, or if its focus is not at its centre.
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
    onto = Affine.of_text(values.get("gradientTransform", ""), "gradientTransform")
    return onto @ Affine(r, 0.0, 0.0, r, cx, cy)


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
    if key is None or ellipses_of("circle", inside[0]) != [edge] or "maskUnits" in mask.attrib:
        raise refusal("its mask", "the same circle, as write_svg writes it", "another")
    return key


def blur_of(element: Any, edge: Affine) -> Blur:
    """Return the blur of BLURS that a filter applies to a circle with the outline `edge`.

    Raise InputError if the filter applies no such blur.
    """
    steps = [step.attrib for step in element if step.tag == SVG + "feGaussianBlur"]
    if len(steps) == len(element) == 1 and set(steps[0]) <= {"in", "stdDeviation", "id"}:
        deviation = numbers(steps[0].get("stdDeviation", ""), "stdDeviation", 1)[0]
        for blur in BLURS if edge.a == edge.d and not edge.b else ():
            # The deviation in the file may differ a little from that of the blur, because editors
            # round numbers.
            if abs(edge.a * blur.deviation - deviation) < 0.005 * deviation:
                return blur
    raise refusal("its filter", "a blur of a circle that write_svg writes", "another", "to undo")


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
        needed = f"one of {', '.join(joins)}"
        raise refusal("its stroke-linecap and stroke-linejoin", needed, ends, advice)
    text = style.get("stroke-width", "1")
    width = numbers(text.removesuffix("px"), "stroke-width", 1)[0]
    if not width > 0:
        raise refusal("its stroke-width", "above 0", quoted(text), "to delete it")
    a, b, c, d = onto.a / root.a, onto.b / root.d, onto.c / root.a, onto.d / root.d
    across, down = portable.hypot(a, b), portable.hypot(c, d)
    is_even = abs(across - down) <= _TOLERANCE * down
    if not is_even or abs(a * c + b * d) > _TOLERANCE * across * down:
        raise refusal("transforms of a stroke", "without stretching and skewing", "others", advice)
    return width * across * math.sqrt(abs(root.a * root.d)), joins[ends]
