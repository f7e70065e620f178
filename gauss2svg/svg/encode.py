"""Editable files, and files of outlines. svgwrite writes the document around their elements.

A Gaussian is the unit circle under matrix(a b c d e f). With R = cut_radius(beta), any matrix M for
which M M^T = R^2 covariance draws the same ellipse, because a circle has no direction. Of these
matrices the lower triangular one is written, because it is the shortest. It has c = 0:

    a = R sx,  b = R rho sy,  c = 0,  d = R sqrt(1 - rho^2) sy.

The user unit is `precision` px, and all these are rounded to whole numbers of this unit. For
example, these are three shapes in a file whose user unit is 0.04 px, so that a pixel has 25 units:

    mean (20, 15) px, sigma (4, 3) px, rho 0.5, orange, opacity 0.8; the exponent 1 has R = 3
        <circle fill="url(#a)" fill-opacity=".8" r="1" transform="matrix(300 112 0 195 500 375)"/>
    mean (10, 5), sigma 3, of the same colour and exponent, and so with the same gradient
        <circle fill="url(#a)" r="1" transform="matrix(225 0 0 225 250 125)"/>
    mean (40, 30), sigma (6, 5), green, of exponent 64, R = 1.43: large and crisp (see below)
        <circle fill="url(#b)" r="110" transform="matrix(2.15 0 0 1.79 1000 750)"/>

    <radialGradient cx="0" cy="0" fx=".001" gradientUnits="userSpaceOnUse" id="a" r="1">
      <stop offset=".066" stop-color="#f80" stop-opacity=".99"/> .. <stop offset=".94" ../>
    <radialGradient cx="0" cy="0" fx=".1" gradientUnits="userSpaceOnUse" id="b" r="100"> ..

Two kinds of shape have no gradient. If a plain ellipse of the same area looks the same as a crisp
shape, it is written in place of the gradient. In the form "blur", a large soft shape is written as
a disc under a filter. Shapes of the same exponent share a filter. One shape of each kind:

    <circle fill="#084" r="1" transform=".."/> <circle fill="#f80" filter="url(#c)" r="1" ../>

Areas and lines have a layer of their own between the background and these shapes
(gauss2svg.svg.element). If some shapes lie below areas (Scene.level), these shapes have layers too,
and the layer of the areas is split:

    <g id="areas"> <path id="area-1" d=".."/> </g> <g id="below-area-2-round-1"> <circle ../> </g>
    <g id="areas-2"> <path id="area-2" d=".."/> .. </g> <g id="round-1"> <circle ../> .. </g>

Crisp rims need two more things (docs/decisions/svg.md):

- The circle is a little larger than its gradient. Otherwise the antialiased edge of the circle
  would clip the rim.
- If the exponent is at least LARGE_FROM, the gradient has a radius of 100, and a, b, c and d of the
  matrix are divided by 100. Otherwise cairo would shift the rim of large shapes.

A file of outlines has a stroke along the contour at which the falloff of each shape is 1/2.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from itertools import groupby
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg.errors import instance, refusal, required, several
from gauss2svg.options import hex_of
from gauss2svg.scene import ABOVE, ADD, BLURRED, PLAIN, SOFT, Scene
from gauss2svg.scene.areas import AreaCounts
from gauss2svg.scene.falloff import RIM_WIDTH, cut_radius, drawn_radius, half_radius
from gauss2svg.svg import (
    CANVAS,
    DEFAULT_TITLE,
    INKS,
    Document,
    SvgFormat,
    element,
    round_id,
    signed,
)
from gauss2svg.svg.element import Element, Floats, hex_color, number, short_id, unless
from gauss2svg.svg.forms import BLURS, CLEAR, Blur, as_written, gradient_stops, nearest_blurs
from gauss2svg.version import __version__

PORTABLE = "the alpha-composited form (--portable)"  # advice on an additive scene
# Smallest exponent at which a gradient has the radius 100 (docs/decisions/svg.md).
LARGE_FROM = 16.0


def document_svg(
    scene: Scene,
    document: Document,
    body: Sequence[Element],
    definitions: Sequence[Element] = (),
    sheet: str = "",
    *,
    gaussians: int = 0,
    areas: str = "",
    precision: float | None = None,
    root: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return the text of a file. Its root has a size, a title and a description.

    body         background, areas, and groups of shapes, from bottom to top
    definitions  the gradients and filters that the shapes use
    sheet        style sheet, or "" if there is none
    gaussians    number of shapes
    areas        numbers of areas and lines as text, "" if there are none
    precision    user unit in px. None for px with three decimals
    root         attributes of the root in addition to those that every file has
    """
    # Imported here because it is slow to import and minimal files do not need it.
    from svgwrite.container import SVG
    from svgwrite.extensions.inkscape import INKSCAPE_NAMESPACE

    inside = [Element("defs", definitions)] if definitions else []
    if sheet:
        inside.append(Element("style", f"<![CDATA[{sheet}]]>", type="text/css"))
    texts = [one.text() for one in (*inside, *body)]
    canvas, sides = _sides_of(scene), document.sides(scene.width, scene.height)
    view = " ".join(_sides_of(scene, precision, 6) if precision else canvas)
    # The checks of svgwrite are off. With debug=True, writing would take three times as long, and
    # the checks do not find NaN.
    svg = SVG(size=sides or canvas, viewBox=f"0 0 {view}", debug=False)
    svg["xmlns"] = "http://www.w3.org/2000/svg"
    if any("inkscape:" in text for text in texts):
        svg["xmlns:inkscape"] = INKSCAPE_NAMESPACE
    if document.aspect:
        svg["preserveAspectRatio"] = document.aspect
    if document.is_responsive:
        del svg.attribs["width"], svg.attribs["height"]
    if sides or document.is_responsive:
        svg[CANVAS] = " ".join(canvas)
    svg.update({"role": "img", **root})
    counts = [areas] * bool(areas) + [several(gaussians, "Gaussian")] * (gaussians > 0 or not areas)
    usual = f"{' and '.join(counts)}, fitted and written by gauss2svg {__version__}"
    is_drawing = areas and document.title == DEFAULT_TITLE
    title = "Vectorised drawing" if is_drawing else document.title
    svg.set_desc(title=title, desc=document.alt or usual)
    head, _, end = svg.tostring().partition("<defs />")
    if document.alt:  # then the description does not say by which program the file was written
        head = signed(head)
    text = "".join(['<?xml version="1.0" encoding="utf-8"?>\n', head, *texts, end, "\n"])
    return element.with_own_ids(text) if areas else text


def editable_svg(scene: Scene, svg_format: SvgFormat, document: Document) -> str:
    """Return the editable file of a scene. Equal arguments always give the same text.

    A Gaussian is left out if its opacity or its extent is written as 0. Raise SceneError if a
    Gaussian or the canvas is too large for a file, or if the canvas is too small.
    """
    scene = as_written(scene, svg_format.form)
    precision, decimals = svg_format.precision, svg_format.opacity_decimals
    written, scene = element.in_units(scene, scene.areas, precision, decimals)
    plain, blurred, shaded = (scene.drawn == kind for kind in (PLAIN, BLURRED, SOFT))
    blurs = [BLURS[k] for k in nearest_blurs(scene)[blurred]]
    radius, opacity = drawn_radius(scene.beta, plain), scene.opacity.copy()
    radius[blurred] = [blur.radius for blur in blurs]
    opacity[blurred] = np.minimum(opacity[blurred] * [blur.peak for blur in blurs], 1)
    unit = np.where((scene.beta >= LARGE_FROM) & shaded, 100, 1)
    circle = unit * _widened(scene, shaded)
    matrices = matrices_of(scene, radius, precision, unit)
    alphas = [number(value, decimals) for value in opacity]
    kept = [i for i, alpha in enumerate(alphas) if matrices[i] and alpha != "0"]

    areas, filters, elements = element.area_elements(written, decimals), np.cumsum(blurred) - 1, []
    # Shapes that have the same exponent and colour share a gradient. Shapes that have the same blur
    # share a filter.
    ids, definitions, first = dict[Any, str](), [*areas.definitions], len(areas.definitions)
    for i in kept:
        fill, look = hex_color(np.round(scene.color[i] * 255)), {}
        if not plain[i]:
            key = blurs[filters[i]] if blurred[i] else (scene.beta[i], fill)
            if key not in ids:
                ids[key] = short_id(first + len(ids))
                is_blur = isinstance(key, Blur)
                definition = _filter(key) if is_blur else _gradient(*key, svg_format.stops)
                definitions.append(definition.replace(id=ids[key]))
            link = f"url(#{ids[key]})"
            fill, look = (fill, {"filter": link}) if blurred[i] else (link, {})
        look = {"fill_opacity": unless("1", alphas[i]), **look, "r": number(circle[i], 1)}
        elements.append(Element("circle", fill=fill, **look, transform=matrices[i]))
    radius[blurred] *= [1 + CLEAR * blur.deviation for blur in blurs]
    half = (radius[:, None] * scene.sigma)[kept]
    boxes = np.vstack([precision * areas.boxes, element.boxes_of(scene.mean[kept], half)])
    scene, by_ink = scene.select(kept), svg_format.layers == INKS
    look = {"definitions": definitions, "precision": precision}
    return _layered_svg(scene, document, areas.paths, elements, boxes, by_ink, **look)


def outline_svg(scene: Scene, document: Document | None = None) -> str:
    """Return the SVG text of a scene whose shapes are drawn as strokes alone.

    Each shape is an <ellipse> along the contour at which the falloff is half of its height. Its
    stroke is opaque, 0.5 px wide and of the colour of the shape. The outlines of areas and the
    lines of a scene are such strokes too. The layers are those of write_svg. There is no
    background. Shapes whose extent or opacity is written as 0 are left out. Result.plot has the
    strokes of a pen plotter.

    Raise InputError for an additive scene.
    """
    document = instance(document, "document", Document)
    if required(scene, "scene", Scene).blend == ADD:
        got = "'add', whose colours are differences and show nothing by themselves"
        raise refusal("blend of a scene with outlines", "'over'", got, PORTABLE)
    # Lengths in px, opacities and degrees have two decimals.
    width, strokes = 0.5, []  # areas and lines, in the first colour of their paint
    for area in scene.areas:
        color = area.paint if isinstance(area.paint, tuple) else area.paint.colors[0]
        look = {"paint": color, "opacity": float(area.opacity >= 0.005), "width": width}
        strokes.append(dataclasses.replace(area, **look, cap="butt"))
    lines, scene = element.in_units(scene.replace(transparent=True), strokes, 0.01, 2)
    scene = scene.select(scene.opacity >= 0.005)
    radius, (axes, angle_rad) = half_radius(scene.beta), scene.ellipse_axes
    element.check_scene(scene, radius, 1.0)
    numbers = np.column_stack([axes * radius[:, None], scene.mean, np.degrees(angle_rad)])
    texts = [[number(v, 2) for v in row] for row in numbers]
    kept, ellipses = [i for i, (rx, ry, *_) in enumerate(texts) if "0" not in (rx, ry)], []
    for i in kept:
        rx, ry, x, y, angle = texts[i]
        turn = None if angle == "0" or rx == ry else f"rotate({angle} {x} {y})"
        stroke = hex_color(np.round(scene.color[i] * 255))
        place = {"cx": x, "cy": y, "rx": rx, "ry": ry}
        ellipses.append(Element("ellipse", **place, stroke=stroke, transform=turn))
    root = {"fill": "none", "stroke-width": number(width, 2)}
    half = (radius[:, None] * scene.sigma + 0.5 * width)[kept]
    scene, areas = scene.select(kept), element.area_elements(lines, 2)
    boxes = np.vstack([0.01 * areas.boxes, element.boxes_of(scene.mean, half)])
    scale = "scale(.01)"
    return _layered_svg(scene, document, areas.paths, ellipses, boxes, transform=scale, root=root)


def _layered_svg(
    scene: Scene,
    document: Document,
    paths: Sequence[Element],
    shapes: Sequence[Element],
    boxes: Floats,
    by_ink: bool = False,
    transform: str | None = None,
    **others: Any,
) -> str:
    """Return the file of areas and shapes in layers, above the background of the scene.

    paths   element of each area of the scene
    shapes  elements of the shapes of the scene
    boxes   (n, 4) boxes around all of them, in px
    by_ink  whether the shapes of a round share one ink, which the layer sets
    transform  transform of the layers of areas
    others  further arguments of document_svg
    """
    body, first, parts = list[Element](), 0, 0
    if not scene.transparent:
        rect = {"height": "100%", "id": "background", "width": "100%", "x": "0", "y": "0"}
        body.append(Element("rect", fill=hex_color(np.round(scene.background * 255)), **rect))
    rows = zip(scene.level.tolist(), scene.round_index.tolist(), shapes, strict=True)
    groups = [(key, [row[2] for row in run]) for key, run in groupby(rows, lambda row: row[:2])]
    for (level, index), inside in [*groups, ((ABOVE, 0), [])]:
        above, area = len(paths) if level == ABOVE else level, f"area-{level + 1}"
        if above > first:
            parts += 1
            label = f"Areas: {AreaCounts.of(scene.areas[first:above]).without_nodes}"
            key = f"areas-{parts}" if parts > 1 else "areas"
            body.append(layer(label, paths[first:above], id=key, transform=transform))
            first = above
        count = several(len(inside), "Gaussian")
        label, key = f"Round {index + 1}: {count}", round_id(index)
        if level != ABOVE:
            label = f"Round {index + 1}, below {area}: {count}"
            body.append(layer(label, inside, id=f"below-{area}-{key}"))
        elif by_ink and inside:
            fill, bare = inside[0].attributes["fill"], [one.replace(fill=None) for one in inside]
            label = f"Ink {hex_of(fill)}: {several(len(inside), 'ellipse')}"
            body.append(layer(label, bare, fill=fill, id=f"ink-{index + 1}"))
        elif inside:
            body.append(layer(label, inside, id=key))
    # The inner <svg> is a layer, because otherwise a click in Inkscape would select all of it.
    as_layer = {"inkscape:groupmode": "layer"}
    body = element.clipped(body, boxes, (scene.width, scene.height), **as_layer)
    sheet = document.style([index for (level, index), _ in groups if level == ABOVE])
    counts = {"gaussians": len(shapes), "areas": AreaCounts.of(scene.areas).without_nodes}
    return document_svg(scene, document, body, sheet=sheet, **counts, **others)


def layer(label: str, inside: Sequence[Element], **attributes: str | None) -> Element:
    """Return a group that Inkscape shows as a layer."""
    shown = {"inkscape:groupmode": "layer", "inkscape:label": label, **attributes}
    return Element("g", inside, **dict(sorted(shown.items())))


def _sides_of(scene: Scene, unit: float = 1.0, decimals: int = 3) -> tuple[str, str]:
    """Return the width and height of the canvas as texts, in units of `unit` px."""
    return number(scene.width / unit, decimals), number(scene.height / unit, decimals)


def matrices_of(scene: Scene, radius: Floats, precision: float, unit: ArrayLike = 1) -> list[str]:
    """Return the transform of the circle of each shape, or "" if the shape is left out.

    radius     (n,) radius, in sigmas, of the ellipse that is drawn
    precision  user unit in px
    unit       (n,) radius of the circle, 1 or 100

    A shape is left out if its extent is written as 0. Raise SceneError if a shape or the canvas is
    too large, or if the canvas is too small.
    """
    element.check_scene(scene, radius, precision)
    unit = np.broadcast_to(unit, len(scene))
    factor, mean = scene.factor * radius[:, None, None], scene.mean / precision
    factor = factor.transpose(0, 2, 1).reshape(-1, 4) / (unit * precision)[:, None]
    texts = []
    for row, (x, y), radius_in_units in zip(factor, mean, unit.tolist(), strict=True):
        a, b, c, d = (number(v, 2 if radius_in_units == 100 else 0) for v in row)
        has_extent = float(a) * float(d) != float(b) * float(c)
        texts.append(f"matrix({a} {b} {c} {d} {number(x, 0)} {number(y, 0)})" * has_extent)
    return texts


def _filter(blur: Blur) -> Element:
    # The region of the filter is the box around the disc, with a margin of CLEAR * deviation times
    # the radius of the disc. It is written in shares of the box, whose sides are two radii long.
    margin = number(CLEAR * blur.deviation / 2, 2)
    size, start = number(1 + 2 * float(margin), 2), f"-{margin}"
    region = {"height": size, "width": size, "x": start, "y": start}
    source = {"in": "SourceGraphic", "stdDeviation": number(blur.deviation, 4)}
    step = Element("feGaussianBlur", **source)
    # By default a filter works in linearRGB, so colours would be rounded once more.
    return Element("filter", [step], color_interpolation_filters="sRGB", **region)


def _gradient(beta: float, color: str, count: int) -> Element:
    unit, stops = 100 if beta >= LARGE_FROM else 1, []
    for at, value in zip(*gradient_stops(count, beta), strict=True):
        look = {"stop_color": color, "stop_opacity": unless("1", number(value, 3))}
        stops.append(Element("stop", offset=number(at, 4), **look))
    # With a focus of 0, resvg would be less accurate (docs/decisions/svg.md).
    return radial_gradient("", stops, str(unit), number(unit * 0.001, 3))


def radial_gradient(key: str, stops: list[Element], r: str = "1", fx: str | None = None) -> Element:
    """Return a radial gradient of radius r around the origin of user space.

    If fx is given and is not 0, resvg draws the gradient by a more accurate algorithm
    (docs/decisions/svg.md).
    """
    units = "userSpaceOnUse"
    return Element("radialGradient", stops, cx="0", cy="0", fx=fx, gradientUnits=units, id=key, r=r)


def _widened(scene: Scene, shaded: NDArray[np.bool_]) -> Floats:
    """Return for each shape (n,) the radius of its circle, divided by the radius of its gradient.

    This ratio is larger than 1 only if the rim of the shape is crisp. It is rounded up to one
    decimal.
    """
    minor = scene.ellipse_axes[0][:, 1]
    # If a rim is at least 1 px wide, the antialiased edge of the circle hardly clips it. Otherwise
    # the edge must be at least 0.7 px from the end of the gradient (docs/decisions/svg.md). Shapes
    # that need a circle of over 20 radii are too thin to be visible.
    crisp = shaded & (scene.beta > 1) & (RIM_WIDTH * minor < scene.beta)
    margin = np.where(crisp, 0.7 / (minor * cut_radius(scene.beta)), 0.0)
    return 1 + np.minimum(np.ceil(10 * margin) / 10, 20.0)
