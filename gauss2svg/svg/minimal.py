"""SVG text with nothing that does not draw: small files, and shorter large ones.

    <svg xmlns=".." viewBox="0 0 64 43"><defs> falloffs </defs><path fill="#abc" d="M0 0h64v43H0"/>
    <use href="#a" fill="#abc" transform="matrix(12 3 0 8 30 20)"/> .. </svg>

Coordinates are whole numbers of user units (gauss2svg.svg.minimal_shapes); the elements are those
of gauss2svg.svg.minimal_text, and docs/decisions/minimal.md has the figures.
"""

from __future__ import annotations

import math
from xml.sax.saxutils import escape

import numpy as np

from gauss2svg.errors import InputError, instance
from gauss2svg.scene import Scene
from gauss2svg.svg.document import DEFAULT_TITLE, Document
from gauss2svg.svg.encode import number
from gauss2svg.svg.format import STOP_COUNTS
from gauss2svg.svg.minimal_shapes import OPACITY_DECIMALS, color_levels, rounded_scene, shapes_of
from gauss2svg.svg.minimal_text import MOST_MASKED, drawing, fill_of

# Largest error of a side of the view box, in user units and in px, where the file has a size.
_VIEW_ERROR, _VIEW_ERROR_PX = 0.02, 0.25
_WHOLE = 1e-9  # relative error of a side that is a whole number of units


def minimal_svg(
    scene: Scene,
    unit: float,
    digits: int = 3,
    document: Document | None = None,
    *,
    opacity_decimals: int = OPACITY_DECIMALS,
    stops: int = STOP_COUNTS[0],
    masked: bool | None = None,
) -> str:
    """The shortest SVG of a scene, of which coordinates are whole numbers of units.

    unit    px of the canvas, LEAST_UNIT..MOST_UNIT
    digits  of colours, 3 or 6
    stops   of a gradient, one of STOP_COUNTS
    masked  whether soft shapes are drawn under masks, not by gradients; None: up to MOST_MASKED
    What it draws is minimal_rounded(scene, unit, digits): shapes whose extent or opacity is written
    as 0 are left out. Title, alt, size and aspect of the document are written where they are given;
    otherwise the file has no names, and a size only where a unit is less than a pixel or a side is
    no whole number of units: resvg rounds the sides of a view box for its size, and with them the
    proportions. Raises InputError for an additive scene, and for layers (segments, animation,
    fragments).
    """
    document = instance(document, "document", Document)
    refuse_layers(document)
    shapes = shapes_of(scene, unit, digits, opacity_decimals)
    width, height = (_view(side, unit) for side in (scene.width, scene.height))
    cover = ""
    if not scene.transparent:
        across, down = (number(math.ceil(float(side)), 0) for side in (width, height))
        fill = fill_of(color_levels(scene.background, digits))
        cover = f'<path{fill} d="M0 0h{across}v{down}H0"/>'
    if masked is None:
        masked = int(np.count_nonzero(shapes.falloff >= 0)) <= MOST_MASKED
    definitions, elements = drawing(shapes, opacity_decimals, None if masked else stops)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg"{_presented(document, scene, unit)} '
        f'viewBox="0 0 {width} {height}">{_names(document)}{definitions}{cover}{elements}</svg>'
    )


def minimal_rounded(
    scene: Scene, unit: float, digits: int = 3, *, opacity_decimals: int = OPACITY_DECIMALS
) -> Scene:
    """The scene as the file of minimal_svg has it, without the shapes that it leaves out.

    Means, extents, colours, opacities and exponents are those of the file; a plain ellipse has the
    exponent whose profile it draws best. Arguments and errors are those of minimal_svg.
    """
    return rounded_scene(scene, shapes_of(scene, unit, digits, opacity_decimals), unit, digits)


def refuse_layers(document: Document) -> None:
    """Raise InputError for a document whose layers a minimal file does not have."""
    for name in document.layered:
        raise InputError(
            f"{name} must not be given with minimal markup, which has no layers. Try --markup "
            "editable"
        )


def whole_unit(width: int, height: int, about: float = 0) -> float:
    """The unit in px of which both sides are whole numbers, about so many along the longer one.

    As few as there are for 0. The larger their common divisor, the nearer it gets.
    """
    longer = max(width, height)
    fewest = longer // math.gcd(width, height)
    return longer / (fewest * max(1, round(about / fewest)))


def _view(side: float, unit: float) -> str:
    """A side of the view box with the fewest decimals."""
    units = side / unit
    error = min(_VIEW_ERROR * min(1.0, units), _VIEW_ERROR_PX / unit)
    return next(
        text
        for text in (number(units, decimals) for decimals in range(11))
        if abs(float(text) - units) <= error
    )


def _is_whole(units: float) -> bool:
    return units >= 0.5 and abs(units - round(units)) <= _WHOLE * units


def _presented(document: Document, scene: Scene, unit: float) -> str:
    sides = document.sides(scene.width, scene.height)
    canvas = scene.width / unit, scene.height / unit
    # Without them the file's size would be that of its numbers, and these rounded.
    if sides is None and (unit < 1 or not all(map(_is_whole, canvas))):
        sides = number(scene.width, 3), number(scene.height, 3)
    text = "" if sides is None else f' width="{sides[0]}" height="{sides[1]}"'
    if document.aspect:
        text += f' preserveAspectRatio="{document.aspect}"'
    return text + ' role="img"' * bool(_names(document))


def _names(document: Document) -> str:
    title = "" if document.title == DEFAULT_TITLE else f"<title>{escape(document.title)}</title>"
    return title + (f"<desc>{escape(document.alt)}</desc>" if document.alt else "")
