"""SVG documents: write_svg and outline_svg, the only module that knows svgwrite.

gauss2svg.svg.encode has the elements of an editable file; those that other encodings would need
fail in one renderer or another (docs/decisions/svg.md). An additive scene is written as differences
(gauss2svg.svg.additive).

The root has role="img", by which Chromium gives a screen reader the title as its name and the desc
as its description, both inline and as a file of its own; aria-labelledby would add nothing.
"""

from __future__ import annotations

import dataclasses

import svgwrite
from svgwrite.extensions import Inkscape

from gauss2svg.errors import (
    InputError,
    instance,
    number_within,
    quoted,
    refusal,
    required,
    whole_number,
)
from gauss2svg.scene import ADD, Scene
from gauss2svg.svg.additive import encode_additive
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.canvas import CANVAS
from gauss2svg.svg.document import INKS, MINIMAL, ROUNDS, Document, SvgFormat
from gauss2svg.svg.element import Element, number
from gauss2svg.svg.encode import Drawing, encode, layer, round_layers, sheet_of
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
from gauss2svg.svg.plates import grouped_by_ink, plate_of
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
    """Return the text of write_svg for a scene that is in the order of its file already."""
    if svg_format.markup == MINIMAL:
        if svg_format.form != GRADIENT:
            raise refusal("form", f"{GRADIENT} in minimal markup", quoted(svg_format.form))
        return minimal_svg(
            scene, svg_format.precision, HEX_DIGITS[-1], document,
            opacity_decimals=svg_format.opacity_decimals, stops=svg_format.stops,
        )  # fmt: skip
    if scene.blend != ADD or svg_format.layers == INKS:
        return _text(encode(scene, svg_format, document), scene, document)
    if document.animate is not None:
        raise _not_for_additive("animation", "it shows no image until all is drawn")
    if document.fragments:
        raise _not_for_additive("fragments", "its layers are phases of drawing, not rounds")
    return _text(encode_additive(scene, svg_format), scene, document)


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
    drawing = Drawing(
        view=(number(scene.width, 3), number(scene.height, 3)),
        gaussians=len(shapes),
        definitions=[],
        body=round_layers(shapes, scene),
        sheet=sheet_of(shapes, scene, document),
        root={"fill": "none", "stroke-width": width},
    )
    return _text(drawing, scene, document)


def _write_pens(scene: Scene, document: Document, width: float, count: int) -> str:
    for name in document.layered:
        raise InputError(f"{name} must not be given with pens, whose layers are no rounds")
    each = document.mm_each(scene.width)
    on_paper = scene.scaled(each)
    pens = pen_strokes(on_paper, count)
    view = number(on_paper.width, 3), number(on_paper.height, 3)
    layers = []
    for at, pen in enumerate(pens, start=1):
        label = f"{at} {pen.color}: {len(pen.strokes)} strokes"
        layers.append(layer(label, pen.strokes, id=f"pen-{at}", stroke=pen.color))
    root = {"fill": "none", "stroke-width": number(width * each, STROKE_DECIMALS + 1)}
    drawing = Drawing(view, sum(len(pen.strokes) for pen in pens), [], layers, root=root)
    return _text(drawing, scene, dataclasses.replace(document, size=f"{view[0]}mm"))


def _not_for_additive(what: str, why: str) -> InputError:
    return InputError(
        f"blend of a scene with {what} must be 'over'; got 'add': {why}. Try the alpha-composited "
        "form (--portable)"
    )


def _text(drawing: Drawing, scene: Scene, document: Document) -> str:
    """Return the file of a drawing: a root with size, title and description, and what is in it."""
    canvas = number(scene.width, 3), number(scene.height, 3)
    sides = document.sides(scene.width, scene.height)
    # debug=True, svgwrite's default, triples the time and still lets NaN through;
    # the numbers are checked by number().
    view = f"0 0 {drawing.view[0]} {drawing.view[1]}"
    root = svgwrite.Drawing(size=sides or canvas, viewBox=view, debug=False)
    Inkscape(root)  # which names its namespaces
    if document.aspect:
        root["preserveAspectRatio"] = document.aspect
    if document.is_responsive:
        del root.attribs["width"], root.attribs["height"]
    if sides or document.is_responsive:
        root[CANVAS] = " ".join(canvas)
    root.update({"role": "img", **drawing.root})
    usual = f"{drawing.gaussians} Gaussians, fitted and written by gauss2svg {__version__}"
    root.set_desc(title=document.title, desc=document.alt or usual)
    head, _, end = root.tostring().partition("<defs />")
    inside = [Element("defs", inside=drawing.definitions or None)]
    if drawing.sheet:
        inside.append(Element("style", {"type": "text/css"}, f"<![CDATA[{drawing.sheet}]]>"))
    texts = [element.text() for element in (*inside, *drawing.body)]
    return "".join(['<?xml version="1.0" encoding="utf-8"?>\n', head, *texts, end, "\n"])
