"""The SVG document; the only module that knows svgwrite.

    <radialGradient id=".." gradientUnits="userSpaceOnUse" cx="0" cy="0" r="1" fx=".001">
      <stop offset=".." stop-color="#.." stop-opacity=".."/> ...
    <circle r="1" transform="matrix(..)" fill="url(#..)" fill-opacity=".."/>

with radii as in gauss2svg.svg.encode, fill="#.." for a solid ellipse and filter="url(#..)" for a
blurred one, whose region is one of the bounding box, with the deviation in the circle's own units,
so that all shapes of an exponent share one filter. The focal offset moves resvg to its accurate
gradient. Other encodings fail in one renderer or another (docs/decisions/svg.md).

An additive scene is written as differences (gauss2svg.svg.additive):

    <g filter="url(#transfer)"> <rect fill="#.."/>
      <g> <circle r="1" transform="matrix(..)" fill="url(#..)"/> ... </g> <rect fill="#f00"/> ...

The root has role="img", by which Chromium gives a screen reader the title as its name and the desc
as its description, both inline and as a file of its own; aria-labelledby would add nothing.
"""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Any

import svgwrite
from svgwrite.extensions import Inkscape

from gauss2svg.errors import InputError, instance, must_be, number_within, required
from gauss2svg.scene import ADD, Scene
from gauss2svg.svg.additive import Ramp, encode_additive
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.document import Document, round_id
from gauss2svg.svg.encode import Ellipse, Filter, Gradient, encode, number
from gauss2svg.svg.format import MINIMAL, SvgFormat
from gauss2svg.svg.layers import Labels, grouped_by_segment, runs, segment_of
from gauss2svg.svg.minimal import minimal_svg
from gauss2svg.svg.minimal_shapes import HEX_DIGITS
from gauss2svg.svg.reader.canvas import CANVAS
from gauss2svg.svg.strokes import OUTLINE_WIDTH, STROKE_DECIMALS, STROKE_WIDTHS, Stroke, stroked
from gauss2svg.version import __version__

_ADDITIVE, _TRANSFER = (
    "additive",
    "transfer",
)  # ids, longer than those of gradients so that they cannot collide


def write_svg(
    scene: Scene, svg_format: SvgFormat | None = None, document: Document | None = None
) -> str:
    """The SVG text of a scene; it depends only on the scene, the format and the document.

    The scene is written with the exponents and colours that a file can hold
    (gauss2svg.svg.snap.snapped); gauss2svg.quantize returns a scene with fewer of them, for a
    smaller file. With segments shapes are in the order of gauss2svg.svg.layers.grouped_by_segment.
    A transparent scene has no <rect>.

    In minimal markup it is that of gauss2svg.svg.minimal.

    An additive scene is written as gauss2svg.svg.additive explains: its layers are phases.
    Raises InputError for an additive scene with segments, animation or fragments, for these, such a
    scene and blurs in minimal markup, and for a document whose segments or size depend on a photo.
    """
    scene = required(scene, "scene", Scene)
    svg_format = instance(svg_format, "svg_format", SvgFormat)
    document = instance(document, "document", Document)
    if svg_format.markup == MINIMAL:
        if svg_format.form != GRADIENT:
            raise InputError(must_be("form", f"{GRADIENT} in minimal markup", svg_format.form))
        return minimal_svg(
            scene, svg_format.precision, HEX_DIGITS[-1], document,
            opacity_decimals=svg_format.opacity_decimals, stops=svg_format.stops,
        )  # fmt: skip
    if scene.blend == ADD:
        return _write_additive(scene, svg_format, document)
    scene = grouped_by_segment(scene, document.labels)
    encoded = encode(scene, svg_format)
    ellipses = [ellipse for _, of_round in encoded.layers for ellipse in of_round]
    drawing = _root(document, scene, (encoded.view_width, encoded.view_height), len(ellipses))
    for gradient in encoded.gradients:
        drawing.defs.add(_gradient(drawing, gradient))
    for blur in encoded.filters:
        drawing.defs.add(_filter(drawing, blur))
    _add_style(drawing, document, [index for index, _ in encoded.layers])
    if encoded.background:
        background = drawing.rect(size=("100%", "100%"), fill=encoded.background, id="background")
        drawing.add(background)
    circles = [_circle(drawing, ellipse) for ellipse in ellipses]
    _add_layers(drawing, circles, scene, [ellipse.index for ellipse in ellipses], document.labels)
    return _text(drawing)


def outline_svg(
    scene: Scene, document: Document | None = None, stroke_width: float = OUTLINE_WIDTH
) -> str:
    """The SVG text of a scene's shapes as bare strokes, for plotters; without a background.

    Each is an <ellipse> along the contour on which the falloff is half of its height, in the
    shape's colour, opaque, in layers like those of write_svg. Shapes whose extent or opacity is
    written as 0 are left out.

    stroke_width  px, above 0
    Raises InputError for a width out of range, and for an additive scene.
    """
    scene = required(scene, "scene", Scene)
    document = instance(document, "document", Document)
    if scene.blend == ADD:
        raise _not_for_additive(
            "outlines", "their colours are differences, which show nothing by themselves"
        )
    width = number(number_within("stroke_width", stroke_width, *STROKE_WIDTHS), STROKE_DECIMALS)
    scene = grouped_by_segment(scene, document.labels)
    strokes = stroked(scene)
    size = number(scene.width, 3), number(scene.height, 3)
    drawing = _root(document, scene, size, len(strokes))
    _add_style(drawing, document, [index for index, _ in runs([one.round for one in strokes])])
    drawing["fill"], drawing["stroke-width"] = "none", width
    ellipses = [_outline(drawing, one) for one in strokes]
    _add_layers(drawing, ellipses, scene, [one.index for one in strokes], document.labels)
    return _text(drawing)


def _write_additive(scene: Scene, svg_format: SvgFormat, document: Document) -> str:
    if document.segments is not None:
        raise _not_for_additive("segments", "its layers are phases of drawing")
    if document.animate is not None:
        raise _not_for_additive("animation", "it shows no image until all is drawn")
    if document.fragments:
        raise _not_for_additive("fragments", "its layers are phases of drawing, not rounds")
    encoded = encode_additive(scene, svg_format)
    count = sum(len(phase.discs) for phase in encoded.phases)
    drawing = _root(document, scene, (encoded.view_width, encoded.view_height), count)
    # Two additive drawings inline in one page keep their own transfer.
    key = f"{zlib.crc32(repr((encoded.transfer, encoded.background)).encode()):08x}"
    drawing.defs.add(_transfer(drawing, encoded.transfer, f"{_TRANSFER}-{key}"))
    for ramp in encoded.ramps:
        drawing.defs.add(_ramp(drawing, ramp))
    # Under the first rectangle the group is transparent, where a difference draws its source.
    drawing.add(
        drawing.style(
            f"#{_ADDITIVE}-{key} circle,#{_ADDITIVE}-{key} rect{{mix-blend-mode:difference}}"
        )
    )
    inkscape = Inkscape(drawing)
    group = inkscape.layer(
        label="Additive", id=f"{_ADDITIVE}-{key}", filter=f"url(#{_TRANSFER}-{key})"
    )
    group.add(_cover(drawing, encoded.background, id="background"))
    for index, phase in enumerate(encoded.phases):
        if phase.inverted:  # beside the layers, so that one can be hidden without the other
            group.add(_cover(drawing, phase.inverted))
        layer = inkscape.layer(label=phase.label, id=f"phase-{index + 1}")
        for disc in phase.discs:
            circle = drawing.circle(r="1", transform=disc.matrix, fill=f"url(#{disc.ramp})")
            del circle.attribs["cx"], circle.attribs["cy"]
            layer.add(circle)
        group.add(layer)
    drawing.add(group)
    return _text(drawing)


def _cover(drawing: Any, fill: str, **attributes: str) -> Any:
    """A rectangle over the canvas and beyond, so that the filter maps opaque pixels only.

    The filter region is extended to whole pixels; a rectangle that ends within a pixel would leave
    it half inverted, which the filter makes an opaque line along the edge.
    """
    return drawing.rect(("-10%", "-10%"), ("120%", "120%"), fill=fill, **attributes)


def _not_for_additive(what: str, why: str) -> InputError:
    return InputError(
        f"blend of a scene with {what} must be 'over'; got 'add': {why}. Try the alpha-composited "
        "form (--portable)"
    )


def _root(document: Document, scene: Scene, view: tuple[str, str], count: int) -> Any:
    """A drawing for `count` shapes, without them: size, title, description, attributes."""
    canvas = number(scene.width, 3), number(scene.height, 3)
    sides = document.sides(scene.width, scene.height)
    # debug=True, svgwrite's default, triples the time and still lets NaN through;
    # the numbers are checked by encode().
    drawing = svgwrite.Drawing(
        size=sides or canvas, viewBox=f"0 0 {view[0]} {view[1]}", debug=False
    )
    if document.aspect:
        drawing["preserveAspectRatio"] = document.aspect
    if sides:
        drawing[CANVAS] = " ".join(canvas)
    drawing["role"] = "img"
    usual = f"{count} Gaussians, fitted and written by gauss2svg {__version__}"
    drawing.set_desc(title=document.title, desc=document.alt or usual)
    return drawing


def _gradient(drawing: Any, gradient: Gradient) -> Any:
    element = drawing.radialGradient(
        center=("0", "0"), r=str(gradient.radius), gradientUnits="userSpaceOnUse",
        id=gradient.id, debug=False,
    )  # fmt: skip
    element["fx"] = ".1" if gradient.radius > 1 else ".001"
    for offset, opacity in gradient.stops:
        shown = None if opacity == "1" else opacity
        element.add_stop_color(offset=offset, color=gradient.color, opacity=shown)
    return element


def _ramp(drawing: Any, ramp: Ramp) -> Any:
    element = drawing.radialGradient(
        center=("0", "0"), r="1", gradientUnits="userSpaceOnUse", id=ramp.id, debug=False
    )
    for offset, color in ramp.stops:
        element.add_stop_color(offset=offset, color=color)
    return element


def _transfer(drawing: Any, transfer: Sequence[tuple[str, str]], name: str) -> Any:
    """The filter that maps channels by slope and intercept, all over the canvas at any size."""
    element = drawing.filter(
        start=("0", "0"), size=("100%", "100%"), filterUnits="userSpaceOnUse",
        id=name, debug=False,
    )  # fmt: skip
    element["color-interpolation-filters"] = "sRGB"
    mapped = element.feComponentTransfer()
    for channel, (slope, intercept) in zip("RGB", transfer, strict=True):
        getattr(mapped, f"feFunc{channel}")("linear", slope=slope, intercept=intercept)
    return element


def _filter(drawing: Any, blur: Filter) -> Any:
    element = drawing.filter(
        start=(f"-{blur.margin}",) * 2,
        size=(number(1 + 2 * float(blur.margin), 2),) * 2,
        id=blur.id,
        debug=False,
    )
    # The default, linearRGB, rounds colours once more.
    element["color-interpolation-filters"] = "sRGB"
    element.feGaussianBlur(stdDeviation=blur.deviation)
    return element


def _circle(drawing: Any, ellipse: Ellipse) -> Any:
    circle = drawing.circle(r=ellipse.radius, transform=ellipse.matrix, fill=ellipse.fill)
    if ellipse.opacity:
        circle["fill-opacity"] = ellipse.opacity
    if ellipse.filter:
        circle["filter"] = f"url(#{ellipse.filter})"
    # Centred on the origin by default; cx and cy would only repeat it.
    del circle.attribs["cx"], circle.attribs["cy"]
    return circle


def _outline(drawing: Any, one: Stroke) -> Any:
    element = drawing.ellipse(center=one.center, r=one.radii, stroke=one.color)
    if one.rotation:
        element["transform"] = one.rotation
    return element


def _add_style(drawing: Any, document: Document, rounds: Sequence[int]) -> None:
    sheet = document.style(rounds)
    if sheet:
        drawing.add(drawing.style(sheet))


def _add_layers(
    drawing: Any, elements: Sequence[Any], scene: Scene, indices: Sequence[int], labels: Labels
) -> None:
    """Add elements in groups, which Inkscape shows as layers; indices are those of their shapes."""
    inkscape = Inkscape(drawing)
    rounds = scene.round_index[indices].tolist()
    segments = None if labels is None else segment_of(scene, labels)[indices].tolist()
    for index, of_round in runs(rounds):
        key, inside = round_id(index), elements[of_round]
        layer = inkscape.layer(label=f"Round {index + 1}: {len(inside)} Gaussians", id=key)
        if segments is None:
            _add_all(layer, inside)
        else:
            for segment, of_segment in runs(segments[of_round]):
                parts = inside[of_segment]
                label = f"Segment {segment}: {len(parts)} Gaussians"
                group = inkscape.layer(label=label, id=f"{key}-segment-{segment}")
                layer.add(_add_all(group, parts))
        drawing.add(layer)


def _add_all(group: Any, elements: Sequence[Any]) -> Any:
    for element in elements:
        group.add(element)
    return group


def _text(drawing: Any) -> str:
    # ElementTree writes a space before "/>", which occurs only at the end of a tag.
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n' + drawing.tostring().replace(" />", "/>") + "\n"
    )
