"""Minimal markup: short SVG text in which everything is needed to draw the picture.

    <svg xmlns=".." viewBox="0 0 64 43"><defs> falloffs </defs><svg>
    <path fill="#abc" d="M0 0h64v43H0"/>
    <use href="#a" fill="#abc" transform="matrix(12 3 0 8 30 20)"/> .. </svg></svg>

Areas and lines are paths between the background and the shapes (gauss2svg.svg.areas), and shapes of
a lower level (Scene.level) lie among these paths. The inner <svg> clips shapes that reach beyond
the view box. Other files do without it.
Coordinates are whole numbers of user units (gauss2svg.svg.minimal_shapes). Crisp shapes are arcs of
a path. If there are at most MOST_MASKED soft shapes, all soft shapes with the same exponent share
one masked circle, so that each colour needs only a few bytes. The stops of the mask are greys,
whose luminance is the falloff. The following example has two soft shapes that have the same colour
and opacity, and a crisp shape whose radii are 8 and 7 units. Its unit is a pixel:

    <radialGradient id="c" gradientUnits="userSpaceOnUse" cx="0" cy="0" r="1">
      <stop offset=".08" stop-color="#fff"/><stop offset=".63" stop-color="#222"/> ..
    <mask id="b"><circle r="1" fill="url(#c)"/></mask>  the falloff of the exponent 1
    <circle id="a" r="1" mask="url(#b)"/>               a shape of that exponent, of any colour
    <use id="d" href="#a" fill="#f80" opacity=".5"/>    common attributes, if that is shorter
    <path fill="#084" d="M40 23a8 7 0 101 0"/>
    <use href="#d" transform="matrix(9 0 0 9 10 5)"/>
    <use href="#d" transform="matrix(12 4 0 8 20 15)"/>

Renderers draw masks slowly, and round each mask to 8 bits. So if there are more than MOST_MASKED
soft shapes, the lowest of them have gradients in place of masks. There is one gradient for each
exponent, which has only the geometry. There is another gradient for each colour of that exponent,
which refers to the first gradient and has the stops. The opacities of the stops are in a style
sheet. Each rule of the sheet applies to one stop and to all later stops, until the next rule
overrides it:

    <style>[href="#a"] stop{stop-color:currentColor;stop-opacity:.99}[href="#a"] stop+stop{..}..
    <radialGradient id="a" gradientUnits="userSpaceOnUse" cx="0" cy="0" r="1" fx=".001"/>
    <radialGradient id="b" href="#a" color="#f80"><stop offset=".066"/><stop offset=".18"/> ..
    <circle r="1" fill="url(#b)" fill-opacity=".5" transform="matrix(12 4 0 8 20 15)"/>

docs/decisions/minimal.md has the sizes and the accuracy of such files.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.errors import instance
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.svg import DEFAULT_TITLE, STOP_COUNTS, Document, signed
from gauss2svg.svg.areas import area_elements, box_centers
from gauss2svg.svg.element import (
    Element,
    attributes_text,
    clipped,
    hex_color,
    number,
    short_id,
    unless,
)
from gauss2svg.svg.minimal_shapes import OPACITY_DIGITS, Shapes, color_levels, path_data, shapes_of
from gauss2svg.svg.stops import gradient_stops, grey_stops

# The first number is how many stops a mask has in a file with fewer than MANY soft shapes. The
# second number is how many stops it has in a file with MANY or more.
MASK_STOPS = (3, 5)

# Attributes by which the paths of areas are put into groups, and then into groups in these.
_LOOKS = ("fill", "stroke-linecap", "stroke-linejoin"), ("stroke", "stroke-width")


# The next three numbers set the accuracy of a minimal file (docs/decisions/minimal.md).
# If a file has at least this many soft shapes, each mask gets two more stops (MASK_STOPS). These
# make the shapes more accurate, and in such a file this is worth the bytes that the stops take.
MANY = 60
VIEW_ERROR = 0.02  # largest rounding error of a side of the view box, in user units
VIEW_ERROR_PX = 0.25  # largest rounding error of a side of the view box, in px
# Without userSpaceOnUse, librsvg 2.54 loses shapes that are rotated.
_UNIT_DISC = {"gradientUnits": "userSpaceOnUse", "cx": "0", "cy": "0", "r": "1"}


def minimal_svg(
    scene: Scene,
    unit: float,
    digits: int = 3,
    document: Document | None = None,
    *,
    opacity_decimals: int = OPACITY_DIGITS,
    stops: int = STOP_COUNTS[0],
    masked: bool | None = None,
) -> str:
    """Return the shortest SVG text of a scene. Coordinates are whole numbers of units.

    unit    user unit in px of the canvas, 0.001..1e6
    digits  number of hex digits of a colour, 3 or 6
    opacity_decimals  number of decimals of opacities
    stops   number of stops of a gradient, one of STOP_COUNTS
    masked  whether soft shapes are drawn under masks (True) or by gradients (False). If None, as
            many are drawn under masks as MOST_MASKED and FADING of gauss2svg.svg.minimal_shapes
            allow, and the others by gradients

    If opacity_decimals has its default, the file draws as_written(scene, unit, digits). Shapes
    whose extent or opacity is written as 0 are left out. Title, alt, size and aspect are written if
    the document has them. If the document has no size, the size of the canvas in px is written in
    two cases. The first case is that a unit is less than a pixel. The second case is that a side is
    not a whole number of units. In the second case, resvg would otherwise round the sides of the
    view box to get a size, and so change the proportions.

    Raise InputError for an additive scene, and for animation or fragments, which need layers.
    """
    document = instance(document, "document", Document)
    document.check_without_layers("minimal markup", "which has no layers", "--markup editable")
    shapes = shapes_of(scene, unit, digits, opacity_decimals, masked)
    width, height = (_view_side(side, unit) for side in (scene.width, scene.height))
    named, cover, sides = _title_and_desc(document), [], np.array([float(width), float(height)])
    a, b, d = shapes.factor.T
    # A shape is drawn after this number of areas.
    level = np.where(shapes.level == ABOVE, len(shapes.areas), shapes.level)
    areas = area_elements(shapes.areas, opacity_decimals, True, set(level.tolist()))
    centers, reach = box_centers(areas.boxes)
    mean = np.vstack([centers, shapes.mean])
    half = np.vstack([reach, np.stack([a, portable.hypot(b, d)], axis=1)])
    if not scene.transparent:
        whole = np.ceil(sides)
        across, down = (number(side, 0) for side in whole)
        fill = _fill(color_levels(scene.background, digits))
        cover = [Element("path", fill=fill, d=f"M0 0h{across}v{down}H0")]
        mean, half = np.vstack([mean, 0.5 * whole]), np.vstack([half, 0.5 * whole])
    definitions, drawn = _drawing(
        shapes, opacity_decimals, stops, len(areas.definitions), is_close=bool(scene.areas)
    )
    definitions = areas.definitions + definitions
    # The number of areas below each element. It is larger by 0.5 for an area.
    below = [(level[i], one) for i, one in drawn]
    below += [(k + 0.5, path) for k, path in zip(areas.starts, areas.paths, strict=True)]
    below.sort(key=lambda one: one[0])
    inside = list[Element]()
    for is_area, run in groupby(below, key=lambda one: one[0] % 1 > 0):
        inside += _grouped([element for _, element in run], *(_LOOKS if is_area else [("fill",)]))
    defs = [Element("defs", definitions)] if definitions else []
    root = {"xmlns": "http://www.w3.org/2000/svg", **_size_and_aspect(document, scene, unit)}
    root |= {"role": "img" if named else None, "viewBox": f"0 0 {width} {height}"}
    body = clipped([*cover, *inside], mean, half, sides)
    svg = Element("svg", [*named, *defs, *body], **root).text()
    return svg if cover else signed(svg)  # the path `cover` is a mark too (file.is_own)


def as_written(scene: Scene, unit: float, digits: int = 3) -> Scene:
    """Return the scene that the file of minimal_svg draws.

    The scene does not have the areas and shapes that the file leaves out. Numbers of areas, means,
    extents, colours, opacities and exponents are those of the file. A plain ellipse gets the
    exponent of the profile that is closest to it. Arguments and errors are those of minimal_svg.
    """
    return shapes_of(scene, unit, digits, OPACITY_DIGITS).as_written(scene, unit, digits)


def whole_unit(width: int, height: int, about: float = 0) -> float:
    """Return the size of a unit, in px. Both sides are whole numbers of such units.

    about  wanted number of units of the longer side. 0 for as few as possible

    The longer side may have m, 2 m, 3 m, .. units, where m is its length in px divided by the
    greatest common divisor of width and height. The one of these numbers that is nearest to `about`
    is taken. If the divisor is small, m is large, so this number may be far from `about`.
    """
    longer = max(width, height)
    fewest = longer // math.gcd(width, height)
    return longer / (fewest * max(1, round(about / fewest)))


def _view_side(side: float, unit: float) -> str:
    """Return a side of the view box in units, as a text.

    The text has the smallest number of decimals at which its error is within VIEW_ERROR and
    VIEW_ERROR_PX.
    """
    units = side / unit
    error = min(VIEW_ERROR * min(1.0, units), VIEW_ERROR_PX / unit)
    texts = (number(units, decimals) for decimals in range(11))
    return next(text for text in texts if abs(float(text) - units) <= error)


def _size_and_aspect(document: Document, scene: Scene, unit: float) -> dict[str, str | None]:
    """Return the width, height and preserveAspectRatio of the root.

    An attribute that need not be written has the value None.
    """
    sides = document.sides(scene.width, scene.height)
    canvas = scene.width / unit, scene.height / unit
    # If the root has no width and height, the picture has as many px as the view box has units, and
    # resvg rounds these numbers. So width and height are written if a side of the view box is not a
    # whole number. They are also written if a unit is less than a pixel, because the picture would
    # be larger than the canvas without them.
    is_exact = unit >= 1 and all(u >= 0.5 and abs(u - round(u)) <= 1e-9 * u for u in canvas)
    if sides is None and not is_exact and not document.is_responsive:
        sides = number(scene.width, 3), number(scene.height, 3)
    width, height = sides or (None, None)
    return {"width": width, "height": height, "preserveAspectRatio": document.aspect}


def _title_and_desc(document: Document) -> list[Element]:
    """Return the title and the description. An alt without a title is the title, for its name."""
    title, alt = "" if document.title == DEFAULT_TITLE else document.title, document.alt or ""
    named = {"title": title or alt, "desc": alt if title else ""}
    return [Element(tag, escape(text)) for tag, text in named.items() if text]


def _drawing(
    shapes: Shapes, opacity_decimals: int, stops: int, used: int, is_close: bool
) -> tuple[list[Element], list[tuple[int, Element]]]:
    """Return the definitions of the shapes of a file, and the elements of these shapes.

    Each element comes with the index of its first shape.

    stops  number of stops of a gradient
    used   number of ids that are already in use
    is_close  as in _masked
    """
    by_gradient = np.flatnonzero((shapes.falloff >= 0) & ~shapes.masked)
    fills = [_fill(color) for color in shapes.color]
    definitions, uses = _masked(shapes.falloff[shapes.masked], used, is_close)
    circles: dict[int, Element] = {}
    if len(by_gradient):
        more, circles = _gradients(shapes, by_gradient, fills, stops, used + 3 * len(uses))
        definitions = more + definitions
    used += sum("id" in definition.attributes for definition in definitions)
    # Opaque ellipses of the same colour and level that follow each other share a path. Each
    # translucent ellipse has its own path, because each must be blended separately.
    opaque = (shapes.falloff < 0) & (np.round(shapes.opacity, opacity_decimals) == 1)
    elements, firsts = list[Element](), list[int]()
    keys = zip(fills, shapes.level.tolist(), strict=True)
    keys = [key if opaque[i] else i for i, key in enumerate(keys)]
    for _, run in groupby(range(len(fills)), lambda i: keys[i]):
        index = list(run)
        firsts.append(index[0])
        i, kind = index[0], int(shapes.falloff[index[0]])
        name = "opacity" if shapes.masked[i] or not circles else "fill-opacity"
        look = {"fill": fills[i], name: unless("1", number(shapes.opacity[i], opacity_decimals))}
        if kind < 0:
            elements.append(Element("path", **look, d=path_data(shapes.numbers[index])))
        else:
            soft = (uses if shapes.masked[i] else circles)[kind]
            elements.append(soft.replace(**look, transform=_matrix(shapes.numbers[i])))
    if uses:
        templates, elements = _shared(elements, used)
        definitions += templates
    return definitions, list(zip(firsts, elements, strict=True))


def _fill(levels: NDArray[np.intp]) -> str | None:
    """Return a colour (3,) in levels of 255 as #rrggbb or #rgb.

    Return None for black, which is the default and need not be written.
    """
    return unless("#000", hex_color(levels))


def _most_used(falloff: NDArray[np.intp]) -> list[int]:
    """Return the distinct values of `falloff` (n,), from the most to the least frequent one."""
    uses = Counter(falloff.tolist())
    return sorted(uses, key=lambda kind: (-uses[kind], kind))


def _masked(
    falloff: NDArray[np.intp], used: int, is_close: bool
) -> tuple[list[Element], dict[int, Element]]:
    """Return definitions of circles under masks, and elements that refer to these circles.

    For each class in `falloff` (n,) there are three definitions: a circle, its mask, and the
    gradient in the mask. The second result maps each class to a <use> that refers to the circle of
    the class.

    used  number of ids that are already in use
    is_close  whether the picture is close enough for masks of more stops
    """
    kinds = _most_used(falloff)
    count = MASK_STOPS[int(len(falloff) >= MANY or is_close)]
    uses, definitions = {}, []
    for k, kind in enumerate(kinds):
        name, mask, ramp = (short_id(used + k + part * len(kinds)) for part in range(3))
        uses[kind] = Element("use", href=f"#{name}")
        stops = [
            Element("stop", offset=number(at, 3), stop_color=_fill(np.full(3, 17 * grey)))
            for at, grey in zip(*grey_stops(count, BETA_CLASSES[kind]), strict=True)
        ]
        r, disc = (
            _circle(kind),
            {"href": f"#{short_id(used + 2 * len(kinds))}"} if k else _UNIT_DISC,
        )
        definitions += [
            Element("radialGradient", stops, id=ramp, **disc),
            Element("mask", [Element("circle", r=r, fill=f"url(#{ramp})")], id=mask),
            Element("circle", id=name, r=r, mask=f"url(#{mask})"),
        ]
    return definitions, uses


def _gradients(
    shapes: Shapes, index: NDArray[np.intp], fills: list[str | None], stops: int, used: int
) -> tuple[list[Element], dict[int, Element]]:
    """Return the definitions of gradients, and a circle for each exponent.

    The definitions are a style sheet, a gradient for each exponent, and a gradient for each pair of
    an exponent and a colour, which refers to the gradient of the exponent.

    index  indices of the shapes that are drawn by gradients
    fills  fills of all shapes. The fills of the shapes at `index` are replaced by references to the
           gradients
    stops  number of stops of a gradient
    used   number of ids that are already in use
    """
    kinds = _most_used(shapes.falloff[index])
    rules, definitions, first, ramps = "", [], {}, {}
    for k, kind in enumerate(kinds, used):
        name = first[kind] = short_id(k)
        offsets, values = gradient_stops(stops, BETA_CLASSES[kind])
        for at, value in enumerate(values):
            look = ("" if at else "stop-color:currentColor;") + f"stop-opacity:{number(value, 3)}"
            rules += f'[href="#{name}"] stop{"+stop" * at}{{{look}}}'
        # Because of the fx, resvg draws the gradient by a more accurate algorithm.
        definitions.append(Element("radialGradient", id=name, **_UNIT_DISC, fx=".001"))
        ramps[kind] = [Element("stop", offset=number(at, 4)) for at in offsets]
    keys = {i: (int(shapes.falloff[i]), fills[i] or "#000") for i in index.tolist()}
    ids = {}
    for k, (key, _) in enumerate(Counter(keys.values()).most_common(), used + len(kinds)):
        kind, color = key
        ids[key] = name = short_id(k)
        href = f"#{first[kind]}"
        definitions.append(Element("radialGradient", ramps[kind], id=name, href=href, color=color))
    for i, key in keys.items():
        fills[i] = f"url(#{ids[key]})"
    circles = {kind: Element("circle", r=_circle(kind)) for kind in kinds}
    return [Element("style", rules), *definitions], circles


def _circle(kind: int) -> str:
    # A circle of radius 1 ends where its gradient ends. If the rim is crisp, the antialiased edge
    # of such a circle would clip it, so the circle is made larger (gauss2svg.svg.encode).
    return "1.1" if BETA_CLASSES[kind] >= 6 else "1"


def _matrix(numbers: NDArray[np.float64]) -> str:
    a, b, d, e, f = (number(v, 0) for v in numbers)
    return f"matrix({a} {b} 0 {d} {e} {f})".replace(" -", "-")


def _shared(elements: list[Element], used: int) -> tuple[list[Element], list[Element]]:
    """Move attributes that several elements have in common into definitions.

    Return the definitions and all elements. An element whose attributes were moved refers to the
    definition instead. A definition is made only if it makes the file shorter.

    used  number of ids that are already in use
    """
    definitions = []
    # First look for common pairs of fill and opacity. Then look for common opacities of the
    # elements that have no common pair.
    for names in (("fill", "opacity"), ("opacity",)):
        ids = {}
        keys = [tuple(map(one.attributes.get, ("href", *names))) for one in elements]
        for key, uses in Counter(key for key in keys if key[0]).most_common():
            href, common = key[0], dict(zip(names, key[1:], strict=True))
            name = short_id(used + len(definitions))
            definition = Element("use", id=name, href=href, **common)
            # An element with this key may refer to the definition. It then needs neither its own
            # href nor the common attributes, but only the href of the definition. `saved` is the
            # number of bytes by which this makes the element shorter.
            saved = len(definition.text()) - len(Element("use", id=name, href=f"#{name}").text())
            if uses * saved > len(definition.text()):
                ids[key] = name
                definitions.append(definition)
        elements = [
            one.replace(href=f"#{ids[key]}", **dict.fromkeys(names)) if key in ids else one
            for one, key in zip(elements, keys, strict=True)
        ]
    return definitions, elements


def _grouped(
    elements: Sequence[Element], names: Sequence[str], *inner: Sequence[str]
) -> list[Element]:
    """Return the elements, with each run of elements whose attributes `names` are equal in a group.

    A run is left without a group if the group would not make the file shorter.

    inner  names of attributes by which the elements of each run are then put into groups
    """
    grouped = []
    for _, run in groupby(elements, key=lambda one: [one.attributes.get(name) for name in names]):
        inside = list(run)
        shared = {name: inside[0].attributes.get(name) for name in names}
        group = Element("g", **shared)
        saved = len(attributes_text(group.attributes)) * (len(inside) - 1)
        is_shorter = saved > len("<g></g>")
        if is_shorter:
            inside = [one.replace(**dict.fromkeys(names)) for one in inside]
        if inner:
            inside = _grouped(inside, *inner)
        grouped += [Element("g", inside, **shared)] if is_shorter else inside
    return grouped
