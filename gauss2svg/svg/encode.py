"""The elements of an editable file, from a scene; svgwrite writes the document around them.

A Gaussian is the unit circle under matrix(a b c d e f). Any matrix M with M M^T = R^2 covariance,
R = cut_radius(beta), draws the same ellipse, because a circle has no direction; the lower
triangular one has c = 0 and is the shortest to write:

    a = R sx,  b = R rho sy,  c = 0,  d = R sqrt(1 - rho^2) sy.

The user unit is `precision` px, so that all these are whole numbers. Three shapes at 0.04 px, of
which 25 are a pixel:

    mean (20, 15) px, sigma (4, 3) px, rho 0.5, orange, opacity 0.8; the exponent 1 has R = 3
        <circle fill="url(#a)" fill-opacity=".8" r="1" transform="matrix(300 112 0 195 500 375)"/>
    mean (10, 5), sigma 3, of the same colour and exponent: it shares the gradient
        <circle fill="url(#a)" r="1" transform="matrix(225 0 0 225 250 125)"/>
    mean (40, 30), sigma (6, 5), green, of exponent 64, R = 1.43: large and crisp (see below)
        <circle fill="url(#b)" r="110" transform="matrix(2.15 0 0 1.79 1000 750)"/>

    <radialGradient cx="0" cy="0" fx=".001" gradientUnits="userSpaceOnUse" id="a" r="1">
      <stop offset=".066" stop-color="#f80" stop-opacity=".99"/> .. <stop offset=".94" ../>
    <radialGradient cx="0" cy="0" fx=".1" gradientUnits="userSpaceOnUse" id="b" r="100"> ..

Two forms have no gradient: a crisp shape that a plain ellipse draws as well, of the same area, and
in the form blur a large soft one, a disc under a filter that shapes of its exponent share:

    <circle fill="#084" r="1" transform=".."/> <circle fill="#f80" filter="url(#c)" r="1" ../>

Crisp rims need two more things (docs/decisions/svg.md, benchmarks/rims.py):

- a circle a little larger than its gradient, whose own antialiased edge would clip the rim;
- from the exponent large_from on a gradient of radius 100 under a matrix of a hundredth, because
  cairo shifts the rim of large shapes otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import groupby
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES, RIM_WIDTH, cut_radius, nearest_class
from gauss2svg.svg.blur import BLURS, GRADIENT, Blur, drawn_blurs, snapped
from gauss2svg.svg.document import INKS, Document, SvgFormat, round_id
from gauss2svg.svg.element import (
    Element,
    check_canvas,
    hex_color,
    number,
    radial_gradient,
    short_id,
    with_default,
    writable,
)
from gauss2svg.svg.plain_ellipse import is_plain, plain_radius
from gauss2svg.svg.stops import gradient_stops

_LARGE = 100  # radius of gradients of large exponents
# fx of a gradient of radius 1: resvg draws 0 less accurately (docs/decisions/svg.md).
_FOCUS = 0.001


# Position of crisp rims (docs/decisions/svg.md).
LARGE_FROM = 16.0  # exponent from which gradients have a large radius
SOFT_RIM = 1.0  # px of rim across the minor axis above which the circle's edge does little harm
CLEAR_OF_THE_RIM = 0.7  # px from a gradient's end to the circle's edge for crisper rims
# Multiple of the gradient's radius. Shapes that need more are too thin to be drawn.
MOST_MARGIN = 20.0


class Drawn(NamedTuple):
    """One element that is drawn, and the index of its shape in the scene."""

    shape: int
    element: Element


class Drawing(NamedTuple):
    """The elements of a file, and what its root and its style sheet say.

    view         width and height in user units
    gaussians    their number
    definitions  gradients and filters, those alone that are used
    body         the background and the groups of shapes, bottom first
    sheet        the style sheet, "" for none
    root         more attributes of the root
    """

    view: tuple[str, str]
    gaussians: int
    definitions: Sequence[Element]
    body: Sequence[Element]
    sheet: str = ""
    root: Mapping[str, str] = MappingProxyType({})


def encode(scene: Scene, svg_format: SvgFormat, document: Document) -> Drawing:
    """Return the drawing of a scene, which depends on nothing but the arguments.

    Gaussians whose opacity or extent is written as 0 draw nothing and are left out, as are those
    off the canvas whose numbers are too large for a file (gauss2svg.svg.element.writable). Raise
    SceneError for other Gaussians with such numbers, and for such a canvas.
    """
    check_canvas(scene)
    scene = snapped(scene, svg_format.form)
    # Each shape is one of three: a plain ellipse, a blurred disc, or shaded by a gradient.
    plain, blur = is_plain(scene), drawn_blurs(scene)
    blurred = ~plain & (blur >= 0) & (svg_format.form != GRADIENT)
    shaded = ~plain & ~blurred
    color = np.round(scene.color * 255).astype(np.uint8)
    keys = np.column_stack([nearest_class(scene.beta), color])
    shared, entry, uses = np.unique(keys[shaded], axis=0, return_inverse=True, return_counts=True)
    # The shortest ids go to those that are used most; argsort of argsort is the rank.
    uses = np.append(uses, np.bincount(blur[blurred], minlength=len(BLURS)))
    ids = [short_id(k) for k in np.argsort(np.argsort(-uses, kind="stable")).tolist()]

    fills = np.array([hex_color(c) for c in color], dtype=object)
    fills[shaded] = [f"url(#{ids[k]})" for k in entry.reshape(-1)]
    filters = np.full(len(scene), "", dtype=object)
    filters[blurred] = [f"url(#{ids[len(shared) + k]})" for k in blur[blurred]]
    radius, opacity = cut_radius(scene.beta), scene.opacity.copy()
    radius[plain] = plain_radius(scene.beta[plain])
    radius[blurred] = [BLURS[k].radius for k in blur[blurred]]
    opacity[blurred] *= [BLURS[k].peak for k in blur[blurred]]
    unit = np.where((scene.beta >= LARGE_FROM) & shaded, _LARGE, 1)
    circle, factor = unit * _widened(scene, shaded), scene.factor * radius[:, None, None]
    shapes = []
    for i in np.flatnonzero(writable(scene, radius, svg_format.precision, unit)).tolist():
        matrix = matrix_text(factor[i], scene.mean[i], svg_format.precision, int(unit[i]))
        shown = number(min(opacity[i], 1.0), svg_format.opacity_decimals)
        if shown != "0" and matrix:
            attributes = {"fill": fills[i], **with_default("fill-opacity", shown, "1")}
            attributes |= with_default("filter", filters[i], "")
            attributes |= {"r": number(circle[i], 1), "transform": matrix}
            shapes.append(Drawn(i, Element("circle", attributes)))
    definitions = [
        *(
            _gradient(k, BETA_CLASSES[v[0]], v[1:], svg_format.stops)
            for k, v in zip(ids, shared, strict=False)
        ),
        *(_filter(k, blur) for k, blur in zip(ids[len(shared) :], BLURS, strict=True)),
    ]
    # What only shapes without extent or opacity would refer to is not written.
    used = {one.element.attributes.get(name) for one in shapes for name in ("fill", "filter")}
    in_layers = ink_layers if svg_format.layers == INKS else round_layers
    return Drawing(
        view=view_of(scene, svg_format.precision),
        gaussians=len(shapes),
        definitions=[one for one in definitions if f"url(#{one.attributes['id']})" in used],
        body=[*_background(scene), *in_layers(shapes, scene)],
        sheet=sheet_of(shapes, scene, document),
    )


def round_layers(shapes: Sequence[Drawn], scene: Scene) -> list[Element]:
    """Return shapes in groups, each of one round, which Inkscape shows as layers."""
    return [
        layer(f"Round {index + 1}: {len(inside)} Gaussians", inside, id=round_id(index))
        for index, inside in _rounds(shapes, scene)
    ]


def ink_layers(shapes: Sequence[Drawn], scene: Scene) -> list[Element]:
    """Return shapes in groups, each of one ink, which has the fill."""
    layers = []
    for index, inside in _rounds(shapes, scene):
        fill = inside[0].attributes["fill"]
        name = fill if len(fill) == 7 else "#" + "".join(2 * digit for digit in fill[1:])
        plain = [one.without("fill") for one in inside]
        label = f"Ink {name}: {len(inside)} ellipses"
        layers.append(layer(label, plain, fill=fill, id=f"ink-{index + 1}"))
    return layers


def layer(label: str, inside: Sequence[Element], **attributes: str) -> Element:
    """Return a group that Inkscape shows as a layer."""
    shown = {"inkscape:groupmode": "layer", "inkscape:label": label, **attributes}
    return Element("g", dict(sorted(shown.items())), inside)


def sheet_of(shapes: Sequence[Drawn], scene: Scene, document: Document) -> str:
    """Return the style sheet of the rounds that are drawn, "" where they need none."""
    return document.style([index for index, _ in _rounds(shapes, scene)]) or ""


def _rounds(shapes: Sequence[Drawn], scene: Scene) -> list[tuple[int, list[Element]]]:
    """Return each round, as Scene.round_index has it, with its elements."""
    rounds = scene.round_index.tolist()
    runs = groupby(shapes, lambda one: rounds[one.shape])
    return [(index, [one.element for one in run]) for index, run in runs]


def view_of(scene: Scene, precision: float) -> tuple[str, str]:
    """Return the width and height of a canvas in user units."""
    return number(scene.width / precision, 6), number(scene.height / precision, 6)


def _background(scene: Scene) -> list[Element]:
    if scene.transparent:
        return []
    fill = hex_color(np.round(scene.background * 255).astype(np.uint8))
    size = {"width": "100%", "x": "0", "y": "0"}
    return [Element("rect", {"fill": fill, "height": "100%", "id": "background", **size})]


def matrix_text(
    factor: NDArray[np.float64], mean: NDArray[np.float64], precision: float, unit: int = 1
) -> str:
    """Transform of a circle of radius `unit`, a power of ten; "" where an extent is written as 0.

    factor  (2, 2) in px, of that circle; mean (2,) in px
    """
    decimals = round(math.log10(unit))
    a, b, c, d = (number(v / (unit * precision), decimals) for v in factor.T.ravel())
    e, f = (number(v / precision, 0) for v in mean)
    flat = float(a) * float(d) == float(b) * float(c)
    return "" if flat else f"matrix({a} {b} {c} {d} {e} {f})"


def _gradient(name: str, beta: float, color: NDArray[np.integer], count: int) -> Element:
    """Return the gradient of an exponent and a colour, with `count` stops."""
    shade, unit, stops = hex_color(color), _LARGE if beta >= LARGE_FROM else 1, []
    for offset, value in zip(*gradient_stops(count, beta), strict=True):
        opacity = with_default("stop-opacity", number(value, 3), "1")
        attributes = {"offset": number(offset, 4), "stop-color": shade, **opacity}
        stops.append(Element("stop", attributes))
    return radial_gradient(name, stops, str(unit), number(unit * _FOCUS, 3))


def _filter(name: str, blur: Blur) -> Element:
    """A blur of a circle of radius 1, in a region of the circle's box with a margin around it."""
    margin = number(blur.margin / 2, 2)  # in diameters
    start, size = f"-{margin}", number(1 + 2 * float(margin), 2)
    # The default, linearRGB, rounds colours once more.
    attributes = {"color-interpolation-filters": "sRGB", "height": size, "id": name}
    attributes |= {"width": size, "x": start, "y": start}
    deviation = {"in": "SourceGraphic", "stdDeviation": number(blur.deviation, 4)}
    return Element("filter", attributes, [Element("feGaussianBlur", deviation)])


def _widened(scene: Scene, shaded: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the radius of each circle (n,) as a multiple of its gradient's, rounded up to .1."""
    minor = scene.ellipse_axes[0][:, 1]
    crisp = shaded & (scene.beta > 1) & (RIM_WIDTH * minor < SOFT_RIM * scene.beta)
    end = minor * cut_radius(scene.beta)
    margin = np.where(crisp, CLEAR_OF_THE_RIM / end, 0.0)
    return 1 + np.minimum(np.ceil(10 * margin) / 10, MOST_MARGIN)
