"""Elements of an editable file. svgwrite writes the document around them.

A Gaussian is the unit circle under matrix(a b c d e f). Any matrix M with M M^T = R^2 covariance,
R = cut_radius(beta), draws the same ellipse, because a circle has no direction. The lower
triangular matrix has c = 0 and is the shortest to write:

    a = R sx,  b = R rho sy,  c = 0,  d = R sqrt(1 - rho^2) sy.

The user unit is `precision` px, so that all these are whole numbers. Three shapes in units of 0.04
px, 25 to a pixel:

    mean (20, 15) px, sigma (4, 3) px, rho 0.5, orange, opacity 0.8; the exponent 1 has R = 3
        <circle fill="url(#a)" fill-opacity=".8" r="1" transform="matrix(300 112 0 195 500 375)"/>
    mean (10, 5), sigma 3, of the same colour and exponent, and so with the same gradient
        <circle fill="url(#a)" r="1" transform="matrix(225 0 0 225 250 125)"/>
    mean (40, 30), sigma (6, 5), green, of exponent 64, R = 1.43: large and crisp (see below)
        <circle fill="url(#b)" r="110" transform="matrix(2.15 0 0 1.79 1000 750)"/>

    <radialGradient cx="0" cy="0" fx=".001" gradientUnits="userSpaceOnUse" id="a" r="1">
      <stop offset=".066" stop-color="#f80" stop-opacity=".99"/> .. <stop offset=".94" ../>
    <radialGradient cx="0" cy="0" fx=".1" gradientUnits="userSpaceOnUse" id="b" r="100"> ..

Two kinds of shape have no gradient. A crisp shape is a plain ellipse of the same area if that looks
the same. In the form blur, a large soft shape is a disc under a filter, which shapes of the same
exponent share:

    <circle fill="#084" r="1" transform=".."/> <circle fill="#f80" filter="url(#c)" r="1" ../>

Crisp rims need two more things (docs/decisions/svg.md):

- The circle is a little larger than its gradient, because its antialiased edge would clip the rim.
- From the exponent LARGE_FROM on, the gradient has a radius of 100 and the matrix is a hundredth.
  Otherwise cairo would shift the rim of large shapes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES, RIM_WIDTH, cut_radius, nearest_class
from gauss2svg.svg import INKS, Document, SvgFormat, round_id
from gauss2svg.svg.element import Element, check_view, hex_color, number, short_id, unless, writable
from gauss2svg.svg.forms import BLURS, CLEAR, Blur, drawn_blurs, drawn_radius, is_plain, snapped
from gauss2svg.svg.stops import Floats, gradient_stops

_LARGE_RADIUS = 100  # radius of gradients whose exponent is at least LARGE_FROM
Round = tuple[int, list[Element]]  # index of the round, and the elements of its shapes
# fx of a gradient of radius 1. With fx = 0 resvg is less accurate (docs/decisions/svg.md).
_FOCUS = 0.001


# Circles and gradients of crisp rims (docs/decisions/svg.md).
LARGE_FROM = 16.0  # smallest exponent whose gradients have the radius _LARGE_RADIUS
SOFT_RIM = 1.0  # px, narrowest rim that a circle's antialiased edge hardly clips
CLEAR_OF_THE_RIM = 0.7  # px from the gradient's end to the circle's edge, for rims under SOFT_RIM
# Largest distance from a gradient's end to the circle's edge, in radii of the gradient. Shapes that
# need more are too thin to be drawn.
MOST_MARGIN = 20.0


class Drawing(NamedTuple):
    """Elements of a file, its style sheet, and attributes of its root.

    view         width and height in user units
    gaussians    number of shapes
    definitions  gradients and filters that are used
    body         background and groups of shapes, bottom first
    sheet        style sheet, "" for none
    root         further attributes of the root
    size         width with its unit, None for the size of the document
    """

    view: tuple[str, str]
    gaussians: int
    definitions: Sequence[Element]
    body: Sequence[Element]
    sheet: str = ""
    root: Mapping[str, str] = MappingProxyType({})
    size: str | None = None


def encode(scene: Scene, svg_format: SvgFormat, document: Document) -> Drawing:
    """Return the drawing of a scene. It depends only on the arguments.

    Gaussians whose opacity or extent is written as 0 are left out. So are Gaussians off the canvas
    whose numbers are too large for a file (gauss2svg.svg.element.writable). Raise SceneError for
    visible Gaussians with such numbers, and for a canvas that is too small or too large.
    """
    scene = snapped(scene, svg_format.form)
    # A shape is drawn as a plain ellipse, as a blurred disc or by a gradient.
    plain, blur = is_plain(scene), drawn_blurs(scene)
    blurred = ~plain & (blur >= 0)
    shaded = ~plain & ~blurred
    color = np.round(scene.color * 255).astype(np.uint8)
    # Shapes of one exponent and colour share a gradient. Shapes of one blur share a filter.
    kind = np.where(blurred, len(BETA_CLASSES) + blur, nearest_class(scene.beta))
    keys = np.column_stack([kind, np.where(blurred[:, None], 0, color)])[~plain]
    shared, entry, uses = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
    # The most used definitions get the shortest ids. argsort of argsort is the rank.
    ids = [short_id(k) for k in np.argsort(np.argsort(-uses, kind="stable")).tolist()]
    links = np.full(len(scene), None, dtype=object)
    links[~plain] = [f"url(#{ids[k]})" for k in entry.reshape(-1)]

    radius, opacity = drawn_radius(scene.beta, plain), scene.opacity.copy()
    radius[blurred] = [BLURS[k].radius for k in blur[blurred]]
    opacity[blurred] *= [BLURS[k].peak for k in blur[blurred]]
    unit = np.where((scene.beta >= LARGE_FROM) & shaded, _LARGE_RADIUS, 1)
    circle = unit * _widened(scene, shaded)
    shapes = []
    for i, matrix in enumerate(matrices_of(scene, radius, svg_format.precision, unit)):
        alpha = number(min(opacity[i], 1.0), svg_format.opacity_decimals)
        if matrix and alpha != "0":
            fill, link = (links[i], None) if shaded[i] else (hex_color(color[i]), links[i])
            more = {"fill_opacity": unless("1", alpha), "filter": link, "r": number(circle[i], 1)}
            shapes.append((i, Element("circle", fill=fill, **more, transform=matrix)))
    # Definitions that only omitted shapes use are omitted too.
    used = set(links[[i for i, _ in shapes]].tolist())
    definitions = [
        _definition(name, kind, shade, svg_format.stops)
        for name, (kind, *shade) in zip(ids, shared, strict=True)
        if f"url(#{name})" in used
    ]
    rounds = rounds_of(shapes, scene)
    layers = ink_layers(rounds) if svg_format.layers == INKS else round_layers(rounds)
    view, sheet = sides_of(scene, svg_format.precision, 6), document.style([k for k, _ in rounds])
    return Drawing(view, len(shapes), definitions, [*_background(scene), *layers], sheet)


def rounds_of(drawn: Sequence[tuple[int, Element]], scene: Scene) -> list[Round]:
    """Return elements by round, from pairs of a shape's index and its element."""
    runs = groupby(drawn, lambda one: int(scene.round_index[one[0]]))
    return [(index, [element for _, element in run]) for index, run in runs]


def round_layers(rounds: Sequence[Round]) -> list[Element]:
    """Return a group for each round, which Inkscape shows as a layer."""
    return [
        layer(f"Round {index + 1}: {len(inside)} Gaussians", inside, id=round_id(index))
        for index, inside in rounds
    ]


def ink_layers(rounds: Sequence[Round]) -> list[Element]:
    """Return a group for each round. The shapes of a round have one ink, the group's fill."""
    layers = []
    for index, inside in rounds:
        fill, bare = inside[0].attributes["fill"], [one.replace(fill=None) for one in inside]
        name = fill if len(fill) == 7 else "#" + "".join(2 * digit for digit in fill[1:])
        label, key = f"Ink {name}: {len(inside)} ellipses", f"ink-{index + 1}"
        layers.append(layer(label, bare, fill=fill, id=key))
    return layers


def layer(label: str, inside: Sequence[Element], **attributes: str) -> Element:
    """Return a group that Inkscape shows as a layer."""
    shown = {"inkscape:groupmode": "layer", "inkscape:label": label, **attributes}
    return Element("g", inside, **dict(sorted(shown.items())))


def sides_of(scene: Scene, unit: float = 1.0, decimals: int = 3) -> tuple[str, str]:
    """Return the width and height of a canvas as texts, in units of `unit` px."""
    return number(scene.width / unit, decimals), number(scene.height / unit, decimals)


def _background(scene: Scene) -> list[Element]:
    if scene.transparent:
        return []
    fill, whole = hex_color(np.round(scene.background * 255).astype(np.uint8)), "100%"
    return [Element("rect", fill=fill, height=whole, id="background", width=whole, x="0", y="0")]


def matrices_of(scene: Scene, radius: Floats, precision: float, unit: ArrayLike = 1) -> list[str]:
    """Return the transform of each shape's circle, or "" if the shape is not drawn.

    radius     (n,) radius in sigmas of the ellipse that is drawn
    precision  user unit in px
    unit       (n,) radius of the circle, a power of ten

    A shape is not drawn if its extent is written as 0, or if it is off the canvas and its numbers
    are too large. Raise SceneError for a visible shape with such numbers
    (gauss2svg.svg.element.writable), and for a canvas that is too small or too large.
    """
    check_view(scene, precision)
    unit = np.broadcast_to(unit, len(scene))
    factor, mean = scene.factor * radius[:, None, None], scene.mean / precision
    factor = factor.transpose(0, 2, 1).reshape(-1, 4) / (unit * precision)[:, None]
    decimals = np.round(np.log10(unit)).astype(int).tolist()
    texts = [""] * len(scene)
    for i in np.flatnonzero(writable(scene, radius, precision, unit)).tolist():
        a, b, c, d = (number(v, decimals[i]) for v in factor[i])
        if float(a) * float(d) != float(b) * float(c):
            texts[i] = f"matrix({a} {b} {c} {d} {number(mean[i, 0], 0)} {number(mean[i, 1], 0)})"
    return texts


def _definition(name: str, kind: int, color: Sequence[int], count: int) -> Element:
    """Return the gradient for one exponent and colour, or the filter of a blur.

    kind  index into BETA_CLASSES, or len(BETA_CLASSES) plus an index into BLURS
    """
    if kind >= len(BETA_CLASSES):
        return _filter(name, BLURS[kind - len(BETA_CLASSES)])
    beta, shade = BETA_CLASSES[kind], hex_color(color)
    unit, stops = _LARGE_RADIUS if beta >= LARGE_FROM else 1, []
    for at, value in zip(*gradient_stops(count, beta), strict=True):
        look = {"stop_color": shade, "stop_opacity": unless("1", number(value, 3))}
        stops.append(Element("stop", offset=number(at, 4), **look))
    return radial_gradient(name, stops, str(unit), number(unit * _FOCUS, 3))


def radial_gradient(key: str, stops: list[Element], r: str = "1", fx: str | None = None) -> Element:
    """Return a radial gradient of radius r around the origin of user space.

    With fx, resvg uses its more accurate algorithm (docs/decisions/svg.md).
    """
    units = "userSpaceOnUse"
    return Element("radialGradient", stops, cx="0", cy="0", fx=fx, gradientUnits=units, id=key, r=r)


def _filter(name: str, blur: Blur) -> Element:
    """Return the filter of a blur. Its region is the circle's box with a margin."""
    margin = number(CLEAR * blur.deviation / 2, 2)  # margin as a share of the diameter
    size, start = number(1 + 2 * float(margin), 2), f"-{margin}"
    region = {"height": size, "id": name, "width": size, "x": start, "y": start}
    source = {"in": "SourceGraphic", "stdDeviation": number(blur.deviation, 4)}
    step = Element("feGaussianBlur", **source)
    # By default filters work in linearRGB, which would round colours once more.
    return Element("filter", [step], color_interpolation_filters="sRGB", **region)


def _widened(scene: Scene, shaded: NDArray[np.bool_]) -> Floats:
    """Return the radius of each circle (n,) in radii of its gradient, rounded up to 0.1."""
    minor = scene.ellipse_axes[0][:, 1]
    crisp = shaded & (scene.beta > 1) & (RIM_WIDTH * minor < SOFT_RIM * scene.beta)
    end = minor * cut_radius(scene.beta)
    margin = np.where(crisp, CLEAR_OF_THE_RIM / end, 0.0)
    return 1 + np.minimum(np.ceil(10 * margin) / 10, MOST_MARGIN)
