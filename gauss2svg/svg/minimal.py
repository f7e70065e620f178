"""Minimal markup: short SVG text in which everything is needed to draw the picture.

    <svg xmlns=".." viewBox="0 0 64 43"><defs> falloffs </defs><svg>
    <path fill="#abc" d="M0 0h64v43H0"/>
    <use href="#a" fill="#abc" transform="matrix(12 3 0 8 30 20)"/> .. </svg></svg>

Areas and lines are paths between the background and the shapes (gauss2svg.svg.element), and shapes
of a lower level (Scene.level) lie among these paths. The inner <svg> clips shapes that reach beyond
the view box. Other files do without it.

Coordinates are whole numbers of user units. Crisp shapes are arcs of a path (see below). If there
are at most MOST_MASKED soft shapes, all soft shapes with the same exponent share one masked circle,
so that each colour needs only a few bytes. The stops of the mask are greys, whose luminance is the
falloff. The following example has two soft shapes that have the same colour and opacity, and a
crisp shape whose radii are 8 and 7 units. Its unit is a pixel:

    <radialGradient id="c" gradientUnits="userSpaceOnUse" cx="0" cy="0" r="1">
      <stop offset=".08" stop-color="#fff"/><stop offset=".63" stop-color="#222"/> ..
    <mask id="b"><circle r="1" fill="url(#c)"/></mask>  the falloff of the exponent 1
    <circle id="a" r="1" mask="url(#b)"/>               a shape of that exponent, of any colour
    <path fill="#084" d="M40 23a8 7 0 101 0"/>
    <use href="#a" fill="#f80" opacity=".5" transform="matrix(9 0 0 9 10 5)"/>
    <use href="#a" fill="#f80" opacity=".5" transform="matrix(12 4 0 8 20 15)"/>

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

Plain ellipses are arcs of a path. One path may have many arcs of the same colour:

    <path fill="#abc" d="M10 20a8 4 30 101 0m-2 9a3 3 0 100 1"/>

Each arc goes round its whole ellipse except for a gap. The end of the arc is one unit to the right
of its start, or one unit below it. When the path is filled, the gap is closed. The centre of the
ellipse follows from the start, the radii and the tilt (in degrees). All arcs have the same
direction of rotation, so that a path fills the union of its ellipses.

Shapes of the same colour are moved next to each other, so that one path can draw them. These moves
must not change the picture. So two shapes may exchange their places only if they do not overlap, or
if they have the same colour.

docs/decisions/minimal.md has the sizes and the accuracy of such files.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.errors import instance, quoted, refusal
from gauss2svg.options import Field
from gauss2svg.scene import ABOVE, ADD, LEAST_SIGMA, MOST_SIGMA, PLAIN, RHO_LIMIT, SOFT, Area, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, drawn_radius, nearest_class
from gauss2svg.svg import DEFAULT_TITLE, STOP_COUNTS, Document, signed
from gauss2svg.svg.element import (
    Element,
    Floats,
    area_elements,
    attributes_text,
    boxes_of,
    check_view,
    clipped,
    hex_color,
    in_units,
    number,
    short_id,
    unless,
    with_own_ids,
    writable,
)
from gauss2svg.svg.forms import (
    Ints,
    gradient_stops,
    grey_stops,
    is_plain,
    plain_beta,
    with_falloffs,
)

HEX_DIGITS = (3, 6)  # a colour may have either of these numbers of hex digits
OPACITY_DIGITS = 2  # default number of decimals of an opacity
# The first number is how many stops a mask has in a file with fewer than MANY soft shapes. The
# second number is how many stops it has in a file with MANY or more.
MASK_STOPS = (3, 5)

# The next numbers set the accuracy of a minimal file, and how many of its soft shapes are drawn
# under masks (docs/decisions/minimal.md). If a file has at least this many soft shapes, each mask
# gets two more stops (MASK_STOPS). These make the shapes more accurate, and in such a file this is
# worth the bytes that the stops take.
MANY = 60
VIEW_ERROR = 0.02  # largest rounding error of a side of the view box, in user units
VIEW_ERROR_PX = 0.25  # largest rounding error of a side of the view box, in px
# If a file has at most this many soft shapes, all of these are drawn under masks. If it has more,
# some of them get gradients instead, because masks are slow.
MOST_MASKED = 500
# For each soft shape beyond MOST_MASKED, the number of soft shapes under masks becomes smaller by
# this number. So masks are replaced by gradients gradually. If all soft shapes got gradients as
# soon as there are more than MOST_MASKED, a single additional shape would make the file larger by a
# third.
FADING = 2

# Without userSpaceOnUse, librsvg 2.54 loses shapes that are rotated.
_UNIT_DISC = {"gradientUnits": "userSpaceOnUse", "cx": "0", "cy": "0", "r": "1"}
_ROWS = 64  # number of neighbouring shapes that are compared with the others at a time
_CELLS = 1 << 18  # largest number of pairs that are compared at a time, if a shape has fewer
# If more shapes than this are over a shape and overlap it, they are not remembered but found again
# when they are needed. So the memory is proportional to the number of shapes.
_MOST_REMEMBERED = 256


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
            many are drawn under masks as MOST_MASKED and FADING allow, and the others by
            gradients

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
    # A shape is drawn after this number of areas.
    level = np.where(shapes.level == ABOVE, len(shapes.areas), shapes.level)
    areas = area_elements(shapes.areas, opacity_decimals, True, set(level.tolist()))
    a, b, d = shapes.factor.T
    half = np.stack([a, portable.hypot(b, d)], axis=1)
    boxes = [areas.boxes, boxes_of(shapes.mean, half)]
    if not scene.transparent:
        across, down = whole = np.ceil(sides)
        fill = _fill(color_levels(scene.background, digits))
        cover = [Element("path", fill=fill, d=f"M0 0h{across:.0f}v{down:.0f}H0")]
        boxes.append(np.array([[0, 0, *whole]]))
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
        # Names of attributes by which elements are put into groups, and then into groups in these.
        names = [("fill", "stroke-linecap", "stroke-linejoin"), ("stroke", "stroke-width")]
        inside += _grouped([one for _, one in run], *(names if is_area else [("fill",)]))
    defs = [Element("defs", definitions)] if definitions else []
    root = {"xmlns": "http://www.w3.org/2000/svg", **_size_and_aspect(document, scene, unit)}
    root |= {"role": "img" if named else None, "viewBox": f"0 0 {width} {height}"}
    body = clipped([*cover, *inside], np.vstack(boxes), sides)
    svg = Element("svg", [*named, *defs, *body], **root).text()
    svg = with_own_ids(svg) if areas.paths else svg
    return svg if cover else signed(svg)  # the path `cover` is a mark too (file.is_own)


def as_written(scene: Scene, unit: float, digits: int = 3) -> Scene:
    """Return the scene that the file of minimal_svg draws.

    The scene does not have the areas and shapes that the file leaves out. Numbers of areas, means,
    extents, colours, opacities and exponents are those of the file. A plain ellipse gets the
    exponent of the profile that is closest to it. Arguments and errors are those of minimal_svg.
    """
    shapes = shapes_of(scene, unit, digits, OPACITY_DIGITS)
    plain = shapes.falloff < 0
    beta = np.array([*BETA_CLASSES, 1.0])[shapes.falloff]
    beta[plain] = plain_beta(np.sort(unit * shapes.numbers[plain, :2], axis=1)[:, ::-1])
    # All shapes are in one round, because a minimal file has no layers, and because its shapes are
    # not in the order of rounds.
    written = (
        scene.replace(round_index=None, level=None)
        .select(shapes.index)
        .replace(
            areas=[area.scaled(unit, unit) for area in shapes.areas],
            level=shapes.level,
            color=shapes.color / 255,
            opacity=shapes.opacity,
            background=color_levels(scene.background, digits) / 255,
            beta=beta,
            drawn=np.where(plain, PLAIN, SOFT),
        )
    )
    return _placed(written, shapes.mean, shapes.factor, drawn_radius(beta, plain), unit)


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
            a, b, d, e, f = (number(v, 0) for v in shapes.numbers[i])
            matrix = f"matrix({a} {b} 0 {d} {e} {f})".replace(" -", "-")
            elements.append(soft.replace(**look, transform=matrix))
    return definitions, list(zip(firsts, elements, strict=True))


def _fill(levels: Ints) -> str | None:
    """Return a colour (3,) in levels of 255 as #rrggbb or #rgb.

    Return None for black, which is the default and need not be written.
    """
    return unless("#000", hex_color(levels))


def _most_used(falloff: Ints) -> list[int]:
    """Return the distinct values of `falloff` (n,), from the most to the least frequent one."""
    uses = Counter(falloff.tolist())
    return sorted(uses, key=lambda kind: (-uses[kind], kind))


def _masked(falloff: Ints, used: int, is_close: bool) -> tuple[list[Element], dict[int, Element]]:
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
        r, first = _circle(kind), f"#{short_id(used + 2 * len(kinds))}"
        disc = {"href": first} if k else _UNIT_DISC
        definitions += [
            Element("radialGradient", stops, id=ramp, **disc),
            Element("mask", [Element("circle", r=r, fill=f"url(#{ramp})")], id=mask),
            Element("circle", id=name, r=r, mask=f"url(#{mask})"),
        ]
    return definitions, uses


def _gradients(
    shapes: Shapes, index: Ints, fills: list[str | None], stops: int, used: int
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


@dataclass(frozen=True)
class Shapes:
    """The areas of a file, and its n shapes in the order in which they are drawn.

    index    (n,) index of the shape in its scene
    falloff  (n,) index of its exponent in BETA_CLASSES. -1 for a plain ellipse
    numbers  (n, 5) five numbers. A soft shape is a circle of radius 1 with the transform
             matrix(a b 0 d e f), and has the whole numbers a b d e f. A plain ellipse has the
             numbers that `arc_numbers` returns
    mean     (n, 2) centre of the ellipse that is drawn, in user units
    factor   (n, 3) Cholesky factor l11 l21 l22 of that ellipse, in user units
    masked   (n,) whether the shape is a soft one that is drawn under a mask, not by a gradient
    color    (n, 3) colour in levels, 0..255
    opacity  (n,) opacity, 0..1
    level    (n,) number of areas of the file that lie below the shape. ABOVE: all
    areas    areas of the file, in user units
    """

    index: Ints
    falloff: Ints
    numbers: Floats
    mean: Floats
    factor: Floats
    color: Ints
    opacity: Floats
    level: NDArray[np.int32]
    masked: NDArray[np.bool_]
    areas: list[Area]


def shapes_of(
    scene: Scene, unit: float, digits: int, opacity_decimals: int, masked: bool | None = None
) -> Shapes:
    """Return the areas and shapes that the file of a scene has.

    A shape is left out if its extent or opacity is written as 0. `in_units` says which areas are
    left out.

    unit    user unit in px
    digits  number of hex digits of a colour, 3 or 6
    masked  whether all soft shapes are drawn under masks (True), or none (False). If None, the
            number of soft shapes decides. If there are at most MOST_MASKED, all are drawn under
            masks. For each soft shape beyond MOST_MASKED, FADING fewer shapes are drawn under
            masks. The other soft shapes get gradients

    Raise InputError if the unit is out of range, and for an additive scene. Raise SceneError if the
    numbers of a visible shape are too large for a file.
    """
    unit = Field("unit", float, 0.001, 1e6).checked(unit)
    if scene.blend == ADD:
        advice = "--portable, or --markup editable"
        raise refusal("blend in minimal markup", "'over'", quoted(scene.blend), advice)
    check_view(scene, unit)
    areas, scene = in_units(scene, scene.areas, unit, opacity_decimals)
    kind = nearest_class(scene.beta)
    plain = is_plain(scene, minimal=True)
    opacity = np.round(scene.opacity, opacity_decimals)
    now_plain = np.zeros(0, np.intp)
    while True:
        plain[now_plain] = True
        written = with_falloffs(scene, np.where(plain, scene.beta, np.array(BETA_CLASSES)[kind]))
        radius = drawn_radius(written.beta, plain)
        factor = written.factor * radius[:, None, None]
        entries = [factor[:, 0, 0], factor[:, 1], written.mean]
        numbers = np.round(np.column_stack(entries) / unit) + 0.0  # adding 0.0 turns -0 into 0
        numbers[plain] = arc_numbers(written.select(plain), radius[plain], unit)
        extent = np.where(plain, numbers[:, :2].min(axis=1), numbers[:, 0] * numbers[:, 2])
        drawn = writable(written, radius, unit) & (extent > 0) & (opacity > 0)
        # After its numbers are rounded, a soft shape may look the same as a plain ellipse. Such a
        # shape is made a plain ellipse here, and all shapes are rounded again. Otherwise it would
        # become an arc when its file is read and written again.
        soft = np.flatnonzero(drawn & ~plain)
        mean, factor = numbers[:, 3:].copy(), numbers[:, :3].copy()
        placed = _placed(written.select(soft), mean[soft], factor[soft], radius[soft], unit)
        now_plain = soft[is_plain(placed, minimal=True)]
        if not len(now_plain):
            break
    arcs = drawn & plain
    mean[arcs], factor[arcs] = arc_geometry(numbers[arcs])
    color, falloff = color_levels(scene.color, digits), np.where(plain, -1, kind)
    index = np.flatnonzero(drawn)
    keys = np.stack([mean[:, 0], mean[:, 1], falloff])
    # Shapes are not moved over or under areas, so each level is ordered by itself.
    for level in np.unique(scene.level[index[plain[index]]]):
        at = scene.level[index] == level
        own = index[at]
        order = colors_together(mean[own], factor[own], color[own], keys[:, own], 1 / unit)
        index[at] = own[order]
    soft = np.flatnonzero(~plain[index])
    most = max(MOST_MASKED + FADING * (MOST_MASKED - len(soft)), 0)
    count = {True: len(soft), False: 0, None: min(len(soft), most)}[masked]
    is_masked = np.zeros(len(index), bool)
    # The upper shapes get the masks, because they are smaller, so their masks are drawn faster.
    is_masked[soft[len(soft) - count :]] = True
    return Shapes(
        index, falloff[index], numbers[index], mean[index], factor[index], color[index],
        opacity[index], scene.level[index], is_masked, areas,
    )  # fmt: skip


def color_levels(color: Floats, digits: int) -> Ints:
    """Return colours as levels in 0..255 that can be written with `digits` hex digits.

    The array `color` may have any shape.
    """
    most = 15 if digits == HEX_DIGITS[0] else 255
    return np.round(color * most).astype(np.intp) * (255 // most)


def _placed(scene: Scene, mean: Floats, factor: Floats, radius: Floats, unit: float) -> Scene:
    """Return the scene with each shape moved and resized so that it fills a given ellipse.

    mean    (n, 2) centres of the ellipses, in user units
    factor  (n, 3) their Cholesky factors l11 l21 l22, in user units
    radius  (n,) their radii in sigmas
    unit    user unit in px
    """
    a, b, d = unit * factor.T
    sigma = np.column_stack([a, portable.hypot(b, d)]) / radius[:, None]
    rho = np.clip(b / portable.hypot(b, d), -RHO_LIMIT, RHO_LIMIT)
    return scene.replace(mean=unit * mean, sigma=np.clip(sigma, LEAST_SIGMA, MOST_SIGMA), rho=rho)


def arc_numbers(scene: Scene, radius: Floats, unit: float) -> Floats:
    """Return the numbers (n, 5) of each arc: its radii rx and ry, its tilt, and its start x and y.

    radius  (n,) radius of the ellipses in sigmas
    unit    user unit in px

    The radii and the start are whole numbers of units. The tilt is the angle of the first radius,
    in (-45, 45] degrees. It is a whole number, or has one decimal if the ellipse is long. The tilt
    of a circle is 0. If a radius is 0, no arc can draw the shape.
    """
    axes, angle_rad = scene.ellipse_axes
    radii = np.round(axes * radius[:, None] / unit)
    tilt = np.degrees(angle_rad)
    # The tilt gets a decimal if the radii differ by more than 60 units. Without the decimal, the
    # tilt could be wrong by half a degree, which would move the ends of such an ellipse by more
    # than half a unit.
    factor = np.where(radii[:, 0] - radii[:, 1] > 60.0, 10.0, 1.0)
    tilt = np.round(tilt * factor) / factor
    steep = (tilt <= -45) | (tilt > 45)
    radii[steep] = radii[steep, ::-1]
    tilt[steep] -= np.where(tilt[steep] > 0, 90.0, -90.0)
    tilt[radii[:, 0] == radii[:, 1]] = 0.0
    offset, _ = _from_start(radii, tilt)
    start = np.round(scene.mean / unit - offset)
    return np.column_stack([radii, tilt, start]) + 0.0  # adding 0.0 turns -0 into 0


def arc_geometry(numbers: Floats) -> tuple[Floats, Floats]:
    """Return the ellipses of the arcs that have these `arc_numbers` (n, 5).

    Return their centres (n, 2), and their Cholesky factors l11 l21 l22 (n, 3), in user units.
    """
    (rx, ry), tilt_rad = numbers[:, :2].T, np.radians(numbers[:, 2])
    co, si = portable.cos(tilt_rad), portable.sin(tilt_rad)
    l11 = portable.hypot(rx * co, ry * si)
    factor = np.column_stack([l11, (rx * rx - ry * ry) * co * si / l11, rx * ry / l11])
    return numbers[:, 3:] + _from_start(numbers[:, :2], numbers[:, 2])[0], factor


def path_data(numbers: Floats) -> str:
    """Return the d of a path of arcs that have these `arc_numbers` (n, 5)."""
    text, (x, y) = "", (np.nan, np.nan)
    _, chords = _from_start(numbers[:, :2], numbers[:, 2])
    for (rx, ry, tilt, start_x, start_y), chord in zip(numbers, chords, strict=True):
        move = f"M{number(start_x, 0)} {number(start_y, 0)}"
        if text:
            move = min(f"m{number(start_x - x, 0)} {number(start_y - y, 0)}", move, key=len)
        # First come the two flags of a large arc that is drawn counterclockwise (1 and 0), and then
        # the end of the arc relative to its start.
        to = "101 0" if chord[0] else "100 1"
        text += f"{move}a{number(rx, 0)} {number(ry, 0)} {number(tilt, 1)} {to}"
        x, y = start_x + chord[0], start_y + chord[1]
    return text.replace(" -", "-")


def _from_start(radii: Floats, tilt: Floats) -> tuple[Floats, Floats]:
    """Return two vectors (n, 2) for each arc, in user units.

    The first vector leads from the start of the arc to the centre of its ellipse. The second vector
    is the chord, which leads from the start of the arc to its end. The chord is (1, 0) or (0, 1),
    whichever cuts off the smaller part of the ellipse.

    To compare these two chords, the ellipse is mapped onto the unit circle. There, the shorter
    chord cuts off the smaller part. The vector u is this chord of the circle. The centre of the
    circle lies beside the middle of u, in the direction at a right angle to u (SVG 2,
    implementation notes, B.2.4).
    """
    tilt_rad, radii = np.radians(tilt), np.maximum(radii, 1.0)
    co, si = portable.cos(tilt_rad), portable.sin(tilt_rad)
    onto = np.array([[co, -si], [si, co]]).transpose(2, 0, 1) * radii[:, None, :]
    across = portable.hypot(co / radii[:, 0], si / radii[:, 1])
    down = portable.hypot(si / radii[:, 0], co / radii[:, 1])
    # For a circle, `across` and `down` are equal except for rounding errors. 1e-9 is larger than
    # these errors, so all circles get the same chord.
    level = across <= down + 1e-9
    chord = np.column_stack([level, ~level]).astype(np.float64)
    u = (onto / np.square(radii)[:, None, :] * chord[:, :, None]).sum(axis=1)
    length = np.where(level, across, down)
    height = np.sqrt(np.maximum(1 - np.square(length) / 4, 0)) / length
    center = height[:, None] * np.column_stack([-u[:, 1], u[:, 0]])
    return chord / 2 + (onto * center[:, None, :]).sum(axis=2), chord


def projections(mean: Floats, factor: Floats) -> tuple[Floats, Floats]:
    """Return the projections of n ellipses onto twelve lines.

    Return two arrays (12, n): the centres of the projections, and half of their lengths. The first
    line is along x, and the seventh along y. Two ellipses count as apart if there is a line onto
    which their projections are apart. The arguments are those of `colors_together`.
    """
    angle_rad = (np.arange(12) * np.pi / 12)[:, None]
    x, y = portable.cos(angle_rad), portable.sin(angle_rad)
    l11, l21, l22 = factor.T
    return mean[:, 0] * x + mean[:, 1] * y, portable.hypot(l11 * x + l21 * y, l22 * y)


def overlaps(
    center: Floats,
    half: Floats,
    kind: NDArray[np.generic],
    margin: float,
    rows: Ints | None = None,
) -> Iterator[tuple[Ints, Ints]]:
    """Yield the pairs of shapes of different kinds that overlap, some at a time.

    Each time, yield two arrays: the lower shapes of the pairs, and the upper ones. All pairs of a
    lower shape come at once and next to each other. The memory that is needed is proportional to
    the number n of shapes, however many of them overlap.

    center, half  (12, n) what `projections` returns
    kind          (n,) kind of each shape
    margin        as in `colors_together`
    rows          indices of the lower shapes of the pairs. If it is None, they are all shapes
    """
    sides = [0, 6]  # the lines along x and y, which are tested first, as they rule out most pairs
    low, high = center[sides] - half[sides], center[sides] + half[sides]
    rows = np.arange(len(kind)) if rows is None else rows
    # In this order, most shapes that follow each other have similar sizes and are neighbours.
    longer = np.maximum((high - low)[:, rows].max(axis=0), 1.0)
    size = np.ldexp(1.0, np.ceil(portable.log2(longer)).astype(int))
    rows = rows[np.lexsort([low[0, rows], low[1, rows] // (4 * size), size])]
    # One more unit makes up for rounding errors. The exact test follows.
    least, most = low - margin - 1, high + margin + 1
    for begin in range(0, len(rows), _ROWS):
        block = rows[begin : begin + _ROWS]
        first, last = low[:, block].min(axis=1)[:, None], high[:, block].max(axis=1)[:, None]
        near_block = np.flatnonzero(((least < last) & (most > first)).all(axis=0))
        step = max(1, _CELLS // len(near_block))
        for part in np.split(block, range(step, len(block), step)):
            near = (kind[part, None] != kind[near_block]) & (part[:, None] < near_block)
            for k in sides:
                limit = half[k, part, None] + half[k, near_block] + margin
                near &= np.abs(center[k, part, None] - center[k, near_block]) < limit
            row, column = np.nonzero(near)
            row, column = part[row], near_block[column]
            for c, h in zip(center, half, strict=True):
                kept = np.abs(c[row] - c[column]) < h[row] + h[column] + margin
                row, column = row[kept], column[kept]
            yield row, column


def colors_together(mean: Floats, factor: Floats, color: Ints, key: Floats, margin: float) -> Ints:
    """Return an order (n,) of the shapes that draws the same picture with few changes of colour.

    The shapes may be passed in any order that draws this picture. All these orders give the same
    result.

    A shape must wait for all shapes of other colours that are below it and overlap it. When these
    have been drawn, the shape is ready. In each step, a share is computed for each colour: the
    number of its ready shapes, divided by the number of its shapes that are not drawn yet. The
    colour with the largest share comes next, and all its ready shapes are drawn.

    mean    (n, 2) centres of the ellipses that contain the shapes
    factor  (n, 3) Cholesky factors l11 l21 l22 of these ellipses
    color   (n, 3) colours of the shapes in whole levels
    key     (k, n) keys for sorting. Shapes of one colour that become ready at the same time are
            sorted by these keys. The primary key is the last
    margin  smallest distance at which two ellipses count as apart
    """
    kind = np.unique(color, axis=0, return_inverse=True)[1].reshape(-1)
    ellipses = (*projections(mean, factor), kind, margin)
    # For each shape, the number of shapes that must be drawn before it and are not drawn yet.
    waiting = np.zeros(len(mean), np.intp)
    # For each shape, the shapes that wait for it, or None if there are too many to remember them.
    above: list[NDArray[np.int32] | None] = [np.zeros(0, np.int32)] * len(mean)
    for row, column in overlaps(*ellipses):
        np.add.at(waiting, column, 1)
        begins = np.flatnonzero(np.diff(row, prepend=-1))
        for i, over in zip(row[begins].tolist(), np.split(column, begins[1:]), strict=False):
            above[i] = over.astype(np.int32) if len(over) <= _MOST_REMEMBERED else None
    kind_of, undrawn = kind.tolist(), np.bincount(kind)
    ready: list[list[int]] = [[] for _ in undrawn]
    ready_count, order = np.zeros(len(undrawn)), [np.zeros(0, np.intp)]
    now_ready = np.flatnonzero(waiting == 0).tolist()
    while undrawn.any():
        for i in now_ready:
            ready[kind_of[i]].append(i)
            ready_count[kind_of[i]] += 1
        k = int((ready_count / np.maximum(undrawn, 1)).argmax())
        chosen = np.sort(ready[k])
        order.append(chosen[np.lexsort(key[:, chosen])])
        undrawn[k] -= len(chosen)
        ready[k], ready_count[k], now_ready = [], 0, []
        for i in chosen.tolist():
            over = above[i]
            if over is None:
                over = next(overlaps(*ellipses, np.array([i])))[1]
            waiting[over] -= 1
            now_ready += over[waiting[over] == 0].tolist()
    return np.concatenate(order)
