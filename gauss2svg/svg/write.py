"""SVG documents: write_svg and outline_svg, the only module that knows svgwrite.

gauss2svg.svg.encode has the elements of an editable file; those that other encodings would need
fail in one renderer or another (docs/decisions/svg.md). An additive scene is written as differences
(gauss2svg.svg.additive).

The root has role="img", by which Chromium gives a screen reader the title as its name and the desc
as its description, both inline and as a file of its own; aria-labelledby would add nothing.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

import numpy as np
import svgwrite
from svgwrite.extensions import Inkscape

from gauss2svg.errors import (
    InputError,
    instance,
    number_within,
    quoted,
    required,
    whole_number,
)
from gauss2svg.scene import ADD, Scene
from gauss2svg.svg.additive import (
    cover,
    difference_sheet,
    encode_additive,
    key_of,
    transfer_filter,
)
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.document import INKS, MINIMAL, ROUNDS, Document, SvgFormat, round_id
from gauss2svg.svg.element import Element, number
from gauss2svg.svg.encode import Drawn, encode
from gauss2svg.svg.minimal import minimal_svg
from gauss2svg.svg.minimal_shapes import HEX_DIGITS
from gauss2svg.svg.outlines import (
    MOST_PENS,
    OUTLINE_WIDTH,
    STROKE_DECIMALS,
    STROKE_WIDTHS,
    outlines,
    pen_strokes,
)
from gauss2svg.svg.plates import grouped_by_ink, ink_name, plate_of
from gauss2svg.svg.reader.canvas import CANVAS
from gauss2svg.version import __version__


def write_svg(
    scene: Scene, svg_format: SvgFormat | None = None, document: Document | None = None
) -> str:
    """Return the SVG text of a scene. It depends only on the scene, the format and the document.

    The scene is written with the exponents and colours that a file can hold
    (gauss2svg.svg.blur.snapped); gauss2svg.quantize returns a scene with fewer of them, for a
    smaller file. A transparent scene has no <rect>.

    Minimal markup is that of gauss2svg.svg.minimal. Layers by ink are those of
    gauss2svg.svg.plates.grouped_by_ink.

    An additive scene is written as gauss2svg.svg.additive explains: its layers are phases.
    Raise InputError for an additive scene with animation or fragments, for these, such a scene and
    blurs in minimal markup, for a document whose size depends on a photo, and for layers by ink of
    a scene without (Scene.inks).
    """
    scene = required(scene, "scene", Scene)
    svg_format = instance(svg_format, "svg_format", SvgFormat)
    document = instance(document, "document", Document)
    if svg_format.markup != MINIMAL:  # whose painter's order is that of its rounded shapes
        scene = in_file_order(scene, svg_format, document)
    return ordered_svg(scene, svg_format, document)


def in_file_order(scene: Scene, svg_format: SvgFormat, document: Document) -> Scene:
    """Return the scene in the order of its file: with layers by ink, each ink's runs as rounds."""
    if svg_format.layers != INKS:
        return scene
    for name in document.layered:
        raise InputError(
            f"{name} must not be given with layers {INKS}, which are no rounds. Try layers {ROUNDS}"
        )
    return grouped_by_ink(scene)


def ordered_svg(scene: Scene, svg_format: SvgFormat, document: Document) -> str:
    """The text of write_svg for a scene that is in the order of its file already."""
    if svg_format.markup == MINIMAL:
        if svg_format.form != GRADIENT:
            raise InputError(
                f"form must be {GRADIENT} in minimal markup; got {quoted(svg_format.form)}"
            )
        return minimal_svg(
            scene, svg_format.precision, HEX_DIGITS[-1], document,
            opacity_decimals=svg_format.opacity_decimals, stops=svg_format.stops,
        )  # fmt: skip
    by_ink = svg_format.layers == INKS
    if scene.blend == ADD and not by_ink:
        return _write_additive(scene, svg_format, document)
    encoded = encode(scene, svg_format)
    drawing = _root(document, scene, encoded.view, len(encoded.shapes))
    _add_all(drawing.defs, encoded.definitions)
    _add_style(drawing, document, scene, encoded.shapes)
    if encoded.background:
        behind = {"fill": encoded.background, "height": "100%", "id": "background"}
        drawing.add(Element("rect", {**behind, "width": "100%", "x": "0", "y": "0"}))
    if by_ink:
        _add_inks(drawing, encoded.shapes, scene)
    else:
        _add_layers(drawing, encoded.shapes, scene)
    return _text(drawing)


def plate_svg(scene: Scene, ink: str, document: Document | None = None) -> str:
    """Return the SVG text of a plate, which is black where an ink #rrggbb of a scene is seen.

    All plates of a scene are of one size and lie over each other. Raises InputError for a scene
    that is not in inks (Scene.inks), and for another ink.
    """
    scene = required(scene, "scene", Scene)
    document = instance(document, "document", Document)
    return write_svg(plate_of(scene, ink), SvgFormat(layers=INKS), document)


def outline_svg(
    scene: Scene,
    document: Document | None = None,
    stroke_width: float = OUTLINE_WIDTH,
    pens: int | None = None,
) -> str:
    """Return the SVG text of a scene's shapes as bare strokes, for plotters; without a background.

    Each is an <ellipse> along the contour on which the falloff is half of its height, in the
    shape's colour, opaque, in layers like those of write_svg. Shapes whose extent or opacity is
    written as 0 are left out.

    stroke_width  px, above 0
    pens          colours at most, each with the layer that its strokes form: "1 #c0322c: ..". Then
                  strokes end at the page, and the unit is a millimetre, of the document's size or
                  at 96 px an inch
    Raise InputError for a width out of range, for an additive scene, and for pens with
    animation or fragments, which need layers of rounds.
    """
    scene = required(scene, "scene", Scene)
    document = instance(document, "document", Document)
    if scene.blend == ADD:
        raise _not_for_additive(
            "outlines", "their colours are differences, which show nothing by themselves"
        )
    width = number(number_within("stroke_width", stroke_width, *STROKE_WIDTHS), STROKE_DECIMALS)
    if pens is not None:
        return _write_pens(scene, document, float(width), whole_number("pens", pens, 1, MOST_PENS))
    shapes = outlines(scene)
    size = number(scene.width, 3), number(scene.height, 3)
    drawing = _root(document, scene, size, len(shapes))
    _add_style(drawing, document, scene, shapes)
    drawing["fill"], drawing["stroke-width"] = "none", width
    _add_layers(drawing, shapes, scene)
    return _text(drawing)


def _write_pens(scene: Scene, document: Document, width: float, count: int) -> str:
    for name in document.layered:
        raise InputError(f"{name} must not be given with pens, whose layers are no rounds")
    each = document.mm_each(scene.width)
    on_paper = scene.scaled(each)
    pens = pen_strokes(on_paper, count)
    size = number(on_paper.width, 3), number(on_paper.height, 3)
    document = dataclasses.replace(document, size=f"{size[0]}mm")
    drawing = _root(document, scene, size, sum(len(pen.strokes) for pen in pens))
    drawing["fill"], drawing["stroke-width"] = "none", number(width * each, STROKE_DECIMALS + 1)
    inkscape = Inkscape(drawing)
    for at, pen in enumerate(pens, start=1):
        label = f"{at} {pen.color}: {len(pen.strokes)} strokes"
        layer = inkscape.layer(label=label, id=f"pen-{at}", stroke=pen.color)
        drawing.add(_add_all(layer, [stroke.element for stroke in pen.strokes]))
    return _text(drawing)


def _write_additive(scene: Scene, svg_format: SvgFormat, document: Document) -> str:
    if document.animate is not None:
        raise _not_for_additive("animation", "it shows no image until all is drawn")
    if document.fragments:
        raise _not_for_additive("fragments", "its layers are phases of drawing, not rounds")
    encoded = encode_additive(scene, svg_format)
    count = sum(len(phase.discs) for phase in encoded.phases)
    drawing = _root(document, scene, encoded.view, count)
    key = key_of(encoded.transfer, encoded.background)
    # Longer than the ids of gradients, so that they cannot collide.
    group_id, filter_id = f"additive-{key}", f"transfer-{key}"
    drawing.defs.add(transfer_filter(encoded.transfer, filter_id))
    _add_all(drawing.defs, encoded.ramps)
    drawing.add(drawing.style(difference_sheet(group_id)))
    inkscape = Inkscape(drawing)
    group = inkscape.layer(label="Additive", id=group_id, filter=f"url(#{filter_id})")
    group.add(cover(encoded.background, {"id": "background"}))
    for index, phase in enumerate(encoded.phases):
        if phase.inverted:  # beside the layers, so that one can be hidden without the other
            group.add(cover(phase.inverted))
        layer = inkscape.layer(label=phase.label, id=f"phase-{index + 1}")
        group.add(_add_all(layer, phase.discs))
    drawing.add(group)
    return _text(drawing)


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
    if document.is_responsive:
        del drawing.attribs["width"], drawing.attribs["height"]
    if sides or document.is_responsive:
        drawing[CANVAS] = " ".join(canvas)
    drawing["role"] = "img"
    usual = f"{count} Gaussians, fitted and written by gauss2svg {__version__}"
    drawing.set_desc(title=document.title, desc=document.alt or usual)
    return drawing


def _add_style(drawing: Any, document: Document, scene: Scene, shapes: Sequence[Drawn]) -> None:
    drawn = scene.round_index[[shape.index for shape in shapes]]
    sheet = document.style(np.unique(drawn).tolist())
    if sheet:
        drawing.add(drawing.style(sheet))


def _add_layers(drawing: Any, shapes: Sequence[Drawn], scene: Scene) -> None:
    """Add shapes in groups, each of one round, which Inkscape shows as layers."""
    inkscape = Inkscape(drawing)
    for index, inside in _rounds(shapes, scene):
        label = f"Round {index + 1}: {len(inside)} Gaussians"
        layer = inkscape.layer(label=label, id=round_id(index))
        drawing.add(_add_all(layer, [one.element for one in inside]))


def _add_inks(drawing: Any, shapes: Sequence[Drawn], scene: Scene) -> None:
    """Add shapes in groups, each of one ink, which has the fill."""
    inkscape = Inkscape(drawing)
    for index, inside in _rounds(shapes, scene):
        ink, fill = ink_name(scene.color[inside[0].index]), inside[0].element.attributes["fill"]
        layer = inkscape.layer(
            label=f"Ink {ink}: {len(inside)} ellipses", id=f"ink-{index + 1}", fill=fill
        )
        drawing.add(_add_all(layer, [one.element.without("fill") for one in inside]))


def _rounds(shapes: Sequence[Drawn], scene: Scene) -> Iterator[tuple[int, list[Drawn]]]:
    """Yield each round, as Scene.round_index has it, with its shapes."""
    rounds = scene.round_index.tolist()
    for index, inside in groupby(shapes, lambda shape: rounds[shape.index]):
        yield index, list(inside)


def _add_all(group: Any, elements: Sequence[Element]) -> Any:
    for element in elements:
        group.add(element)
    return group


def _text(drawing: Any) -> str:
    # ElementTree writes a space before "/>", which occurs only at the end of a tag.
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n' + drawing.tostring().replace(" />", "/>") + "\n"
    )
