"""Writing of SVG files: write_svg, outline_svg and plate_svg. Only this module imports svgwrite.

gauss2svg.svg.encode makes the elements of an editable file. Other encodings need elements that fail
in one renderer or another (docs/decisions/svg.md). gauss2svg.svg.additive writes an additive scene
as differences.

The root of these files has role="img". With this role Chromium gives screen readers the title as
the name and the desc as the description, for an SVG in a page and for a file. aria-labelledby would
add nothing.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

from gauss2svg.errors import instance, quoted, refusal, required
from gauss2svg.scene import ADD, Scene
from gauss2svg.svg import CANVAS, INKS, MINIMAL, ROUNDS, Document, SvgFormat
from gauss2svg.svg.element import Element
from gauss2svg.svg.forms import GRADIENT
from gauss2svg.version import __version__

if TYPE_CHECKING:
    from gauss2svg.svg.encode import Drawing

OUTLINE_WIDTH = 0.5  # default width of strokes in px
_PORTABLE = "the alpha-composited form (--portable)"


def write_svg(
    scene: Scene, svg_format: SvgFormat | None = None, document: Document | None = None
) -> str:
    """Return the SVG text of a scene. It depends only on the scene, the format and the document.

    Exponents and colours become those that a file can hold (gauss2svg.svg.forms.snapped). With
    fewer exponents and colours, as gauss2svg.quantize makes them, the file is smaller. The file of
    a transparent scene has no <rect>.

    gauss2svg.svg.minimal explains minimal markup. gauss2svg.svg.additive explains the file of an
    additive scene, which has phases as layers. plates_and_pens.grouped_by_ink makes layers by ink.

    Raise InputError for

    - animation or fragments with an additive scene, with minimal markup or with layers by ink;
    - an additive scene or blurs in minimal markup, and blurs of an additive scene;
    - layers by ink of a scene that is not in inks (Scene.inks);
    - a document whose size depends on a photo.
    """
    scene = required(scene, "scene", Scene)
    svg_format = instance(svg_format, "svg_format", SvgFormat)
    document = instance(document, "document", Document)
    if svg_format.markup != MINIMAL:  # minimal_svg orders shapes itself, after rounding
        scene = in_file_order(scene, svg_format, document)
    return ordered_svg(scene, svg_format, document)


def in_file_order(scene: Scene, svg_format: SvgFormat, document: Document) -> Scene:
    """Return the scene in the order of its file. Layers by ink make each run of one ink a round."""
    if svg_format.layers != INKS:
        return scene
    document.check_without_layers(f"layers {INKS}", "which are no rounds", f"layers {ROUNDS}")
    from gauss2svg.svg.plates_and_pens import grouped_by_ink  # few files need this module

    return grouped_by_ink(scene)


def ordered_svg(
    scene: Scene, svg_format: SvgFormat, document: Document, masked: bool | None = None
) -> str:
    """Return the text of write_svg for a scene that in_file_order returned.

    masked  as in gauss2svg.svg.minimal.minimal_svg
    """
    is_minimal, is_additive = svg_format.markup == MINIMAL, scene.blend == ADD
    if svg_format.form != GRADIENT and (is_minimal or is_additive):
        why = "in minimal markup" if is_minimal else "for an additive scene, whose blurs do not add"
        raise refusal("form", f"{GRADIENT!r} {why}", quoted(svg_format.form))
    if is_minimal:
        from gauss2svg.svg.minimal import minimal_svg  # few files are minimal
        from gauss2svg.svg.minimal_shapes import HEX_DIGITS

        return minimal_svg(
            scene, svg_format.precision, HEX_DIGITS[-1], document,
            opacity_decimals=svg_format.opacity_decimals, stops=svg_format.stops, masked=masked,
        )  # fmt: skip
    if not is_additive:
        from gauss2svg.svg.encode import encode  # minimal files do not need this module

        return _text(encode(scene, svg_format, document), scene, document)
    document.check_without_layers("additive blending", "whose layers are no rounds", _PORTABLE)
    from gauss2svg.svg.additive import encode_additive  # few files need its kernels

    return _text(encode_additive(scene, svg_format), scene, document)


def plate_svg(scene: Scene, ink: str, document: Document | None = None) -> str:
    """Return the SVG text of an ink's plate, which is black where the ink #rrggbb is visible.

    All plates of a scene have the same size, so that they can be printed over each other. Raise
    InputError for a scene that is not in inks (Scene.inks), and for an ink that the scene lacks.
    """
    from gauss2svg.svg.plates_and_pens import plate_of  # few files need this module

    plate = plate_of(required(scene, "scene", Scene), ink)
    return write_svg(plate, SvgFormat(layers=INKS), document)


def outline_svg(
    scene: Scene,
    document: Document | None = None,
    stroke_width: float = OUTLINE_WIDTH,
    pens: int | None = None,
) -> str:
    """Return the SVG text of a scene's shapes as bare strokes, for plotters.

    Each shape is an <ellipse> along the contour on which the falloff is half of its height. Its
    stroke has the shape's colour and is opaque. Layers are those of write_svg, and there is no
    background. Shapes whose extent or opacity is written as 0 are left out.

    stroke_width  width in px, 0.01..100
    pens          largest number of colours. Each has a layer of its strokes, such as "1 #c0322c:
                  ..". Strokes are then cut at the page's edges, and written in mm on paper. The
                  page has the document's size, or without one 96 px an inch

    Raise InputError for a width or a number of pens out of range, for an additive scene, and for
    pens with animation or fragments, which need layers of rounds.
    """
    scene = required(scene, "scene", Scene)
    document = instance(document, "document", Document)
    if scene.blend == ADD:
        got = "'add', whose colours are differences and show nothing by themselves"
        raise refusal("blend of a scene with outlines", "'over'", got, _PORTABLE)
    from gauss2svg.svg.plates_and_pens import encode_outlines  # few files need this module

    return _text(encode_outlines(scene, document, stroke_width, pens), scene, document)


def _text(drawing: Drawing, scene: Scene, document: Document) -> str:
    """Return the text of a file: a root with size, title and description, around the drawing."""
    import svgwrite  # slow to import, and minimal files do not need it
    from svgwrite.extensions import Inkscape

    from gauss2svg.svg.encode import sides_of

    canvas = sides_of(scene)
    document = dataclasses.replace(document, size=drawing.size or document.size)
    sides = document.sides(scene.width, scene.height)
    view = f"0 0 {drawing.view[0]} {drawing.view[1]}"
    # svgwrite's checks (debug=True) triple the time, and let NaN pass.
    root = svgwrite.Drawing(size=sides or canvas, viewBox=view, debug=False)
    Inkscape(root)  # adds Inkscape's namespaces
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
    inside = [Element("defs", drawing.definitions or None)]
    if drawing.sheet:
        inside.append(Element("style", f"<![CDATA[{drawing.sheet}]]>", type="text/css"))
    texts = [element.text() for element in (*inside, *drawing.body)]
    return "".join(['<?xml version="1.0" encoding="utf-8"?>\n', head, *texts, end, "\n"])
