"""Write SVG files: write_svg and plate_svg.

gauss2svg.svg.encode makes editable files. Other elements could draw the same picture, but each of
them is drawn wrongly by at least one renderer (docs/decisions/svg.md). gauss2svg.svg.additive makes
additive files, which draw by differences, and gauss2svg.svg.minimal those of minimal markup.

The root of these files has role="img". Because of this role, Chromium tells screen readers the
title as the name of the picture, and the desc as its description. It does so both for an SVG in a
page and for a file that is opened by itself. aria-labelledby would add nothing.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Mapping
from html import escape

from gauss2svg.errors import instance, quoted, refusal, required
from gauss2svg.scene import ADD, Scene
from gauss2svg.svg import CURRENT_COLOR, INKS, MINIMAL, NAMESPACE, ROUNDS, Document, SvgFormat
from gauss2svg.svg.element import hex_color, number
from gauss2svg.svg.encode import PORTABLE, editable_svg
from gauss2svg.svg.forms import GRADIENT
from gauss2svg.svg.minimal import HEX_DIGITS, minimal_svg


def write_svg(
    scene: Scene, svg_format: SvgFormat | None = None, document: Document | None = None
) -> str:
    """Return the SVG text of a scene. It depends only on the scene, the format and the document.

    Exponents and colours are rounded to those that a file can have (forms.as_written). The fewer
    different exponents and colours a scene has, the smaller its file is. gauss2svg.quantize reduces
    their number. The file of a transparent scene has no <rect>.

    gauss2svg.svg.minimal explains minimal markup. gauss2svg.svg.additive explains the file of an
    additive scene, whose layers are phases. plates.grouped_by_ink makes layers by ink.

    Raise InputError in these cases:

    - The document has animation or fragments, but the scene is additive, the markup is minimal, or
      the layers are by ink.
    - The scene is additive, but the markup is minimal or the form is "blur".
    - The markup is minimal, but the form is "blur".
    - The layers are by ink, but the scene is not in inks (Scene.inks).
    - The size of the document depends on a photo.
    """
    scene = required(scene, "scene", Scene)
    svg_format = instance(svg_format, "svg_format", SvgFormat)
    document = instance(document, "document", Document)
    if svg_format.markup != MINIMAL:  # minimal_svg itself orders the shapes after it rounds them
        scene = in_file_order(scene, svg_format, document)
    return ordered_svg(scene, svg_format, document)


def in_file_order(scene: Scene, svg_format: SvgFormat, document: Document) -> Scene:
    """Return the scene with its shapes in the order of the file.

    The order changes only if there is a layer for each ink. Shapes of the same ink are then moved
    next to each other, as far as this does not change the picture. Each run of shapes of the same
    ink becomes a round.
    """
    if svg_format.layers != INKS:
        return scene
    document.check_without_layers(f"layers {INKS}", "which are no rounds", f"layers {ROUNDS}")
    from gauss2svg.svg.plates import grouped_by_ink  # imported here because few files need it

    return grouped_by_ink(scene)


def ordered_svg(scene: Scene, svg_format: SvgFormat, document: Document) -> str:
    """Return the text of write_svg for a scene that in_file_order has already ordered."""
    if svg_format.current_color:
        plain_format = dataclasses.replace(svg_format, current_color=False)
        return _in_current_color(scene, plain_format, document)
    is_minimal, is_additive = svg_format.markup == MINIMAL, scene.blend == ADD
    if svg_format.form != GRADIENT and (is_minimal or is_additive):
        why = "in minimal markup" if is_minimal else "for an additive scene, whose blurs do not add"
        raise refusal("form", f"{GRADIENT!r} {why}", quoted(svg_format.form))
    if is_minimal:
        return minimal_svg(
            scene, svg_format.precision, HEX_DIGITS[-1], document,
            opacity_decimals=svg_format.opacity_decimals, stops=svg_format.stops,
        )  # fmt: skip
    if not is_additive:
        return editable_svg(scene, svg_format, document)
    document.check_without_layers("additive blending", "whose layers are no rounds", PORTABLE)
    from gauss2svg.svg.additive import additive_svg  # imported here because few files need it

    return additive_svg(scene, svg_format, document)


def _in_current_color(scene: Scene, svg_format: SvgFormat, document: Document) -> str:
    """Return a file in which the only colour of a scene's areas is currentColor.

    A white page is left out, so that the icon shows on a dark page too. It stays if areas have its
    colour. The file of a scene with other colours or with Gaussians is the usual one.
    """
    paints = {area.paint for area in scene.areas}
    levels = {tuple(round(255 * v) for v in paint) for paint in paints if isinstance(paint, tuple)}
    is_clear = scene.transparent
    if not is_clear:
        page = tuple(round(255 * v) for v in scene.background)
        is_clear = min(page) >= 250 and page not in levels
        levels.discard(page)
    has_others = len(scene) or any(not isinstance(paint, tuple) for paint in paints)
    if has_others or len(levels) != 1:
        return ordered_svg(scene, svg_format, document)
    svg = ordered_svg(scene.replace(transparent=is_clear), svg_format, document)
    (level,) = levels
    color = hex_color(level)
    svg = re.sub(f'(fill|stroke)="{color}"', rf"\1{CURRENT_COLOR}", svg)
    # An icon that is black within 8 levels takes the colour of its page. Minimal markup has no
    # black fills, because black is the default.
    is_black = max(level) <= 8
    root = f"<svg fill{CURRENT_COLOR}" if is_black else f'<svg color="{color}"'
    return svg.replace("<svg", root, 1)


def plate_svg(
    scene: Scene, ink: str | Mapping[str, float], document: Document | None = None
) -> str:
    """Return the SVG text of the plate of an ink. It is black where the ink is visible.

    ink  colour #rrggbb of the ink. If it overprints, its strengths in the colours of the scene,
         such as {"#ff48b0": 1, "#002077": 0.5}. A strength of 0.5 is grey, and other colours are 0

    All plates of a scene have the same size, so that they can be printed over each other. Raise
    InputError if the scene is not in inks (Scene.inks), or if it does not have this ink.
    """
    from gauss2svg.svg.plates import plate_of  # imported here because few files need it

    tones = {ink: 1.0} if isinstance(ink, str) else ink
    plate = plate_of(required(scene, "scene", Scene), tones)
    return write_svg(plate, SvgFormat(layers=INKS), document)


def with_marks(plate: str, scene: Scene, document: Document | None, name: str) -> str:
    """Return a plate with a margin around it that has register marks and a name.

    plate     SVG text of the plate
    scene     the scene of which it is, with its document
    name      text in the margin, such as "1 of 2: #0078bf"

    The marks are crosses in circles, in the middle of each side. They are at the same places of all
    plates, so that sheets can be aligned. Lengths are in mm on paper.
    """
    each = instance(document, "document", Document).mm_each(scene.width)
    width, height = each * scene.width, each * scene.height
    margin, r = 12.0, 3.0  # mm around the plate, in which its marks and its name are; radius
    across, down = width + 2 * margin, height + 2 * margin
    middles = ((across / 2, margin / 2), (across / 2, down - margin / 2))
    middles += ((margin / 2, down / 2), (across - margin / 2, down / 2))
    d = "".join(
        f"M{x - r:.3f} {y:.3f}h{2 * r}m{-r} {-r}v{2 * r}"
        f"M{x + r / 2:.3f} {y:.3f}a{r / 2} {r / 2} 0 1 1 {-r} 0 {r / 2} {r / 2} 0 1 1 {r} 0"
        for x, y in middles
    )
    # What reaches beyond the picture lies below this frame, even in editors that do not clip.
    frame = (
        f"M0 0H{across:.3f}V{down:.3f}H0zM{margin} {margin}v{height:.3f}h{width:.3f}v{-height:.3f}z"
    )
    inner, outer = ((number(x, 3), number(y, 3)) for x, y in ((width, height), (across, down)))
    start = plate.index("<svg")
    end = plate.index(">", start)
    root = re.sub(r' (width|height)="[^"]*"', "", plate[start + 4 : end])
    return f"""<?xml version="1.0" encoding="utf-8"?>
<svg {NAMESPACE} width="{outer[0]}mm" height="{outer[1]}mm" viewBox="0 0 {outer[0]} {outer[1]}">\
<svg x="{margin}" y="{margin}" width="{inner[0]}" height="{inner[1]}"{root}{plate[end:].rstrip()}\
<path d="{frame}" fill="#fff"/>\
<path d="{d}" fill="none" stroke="#000" stroke-width="0.2" id="marks"/>\
<text font-family="sans-serif" id="name" x="{margin}" y="{number(down - 0.4 * margin, 3)}" \
font-size="{number(1.5 * r, 3)}">{escape(name)}</text></svg>
"""
