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

from collections import Counter
from itertools import groupby
from typing import NamedTuple
from xml.sax.saxutils import escape

import numpy as np

from gauss2svg import portable
from gauss2svg.errors import instance, quoted, refusal
from gauss2svg.scene import ABOVE, ADD, LEAST_SIGMA, MOST_SIGMA, PLAIN, RHO_LIMIT, SOFT, Area, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, drawn_radius, nearest_class
from gauss2svg.svg import DEFAULT_TITLE, STOP_COUNTS, Document, element, signed
from gauss2svg.svg.element import Element, Floats, hex_color, number, short_id, unless
from gauss2svg.svg.forms import Ints, gradient_stops, grey_stops, is_plain, with_falloffs

HEX_DIGITS = (3, 6)  # a colour may have either of these numbers of hex digits
OPACITY_DIGITS = 2  # default number of decimals of an opacity
# Numbers of stops of a mask. The larger one is worth its bytes in a picture that is close: one with
# areas, or with at least 60 soft shapes under masks (docs/decisions/minimal.md).
MASK_STOPS = (3, 5)
# If a file has at most this many soft shapes, all of these are drawn under masks. If it has more,
# some of them get gradients instead, because masks are slow. For each soft shape beyond
# MOST_MASKED, FADING fewer are drawn under masks. If all soft shapes got gradients at once, a
# single additional shape would make the file larger by a third (docs/decisions/markup.md).
MOST_MASKED = 500
FADING = 2

# Without userSpaceOnUse, librsvg 2.54 loses shapes that are rotated.
_UNIT_DISC = {"gradientUnits": "userSpaceOnUse", "cx": "0", "cy": "0", "r": "1"}


class Rounded(NamedTuple):
    """A scene as a file draws it, without the shapes and areas that the file leaves out.

    scene    the scene in px, whose n shapes are in the order in which they are drawn
    numbers  (n, 5) whole numbers of units. A soft shape is a circle of radius 1 with the transform
             matrix(a b 0 d e f), and has a b d e f. A plain ellipse has those of `arc_numbers`
    factor   (n, 3) Cholesky factors l11 l21 l22 of the ellipses that are drawn, in user units
    areas    areas in user units
    """

    scene: Scene
    numbers: Floats
    factor: Floats
    areas: list[Area]


def minimal_svg(
    scene: Scene,
    unit: float,
    digits: int = 3,
    document: Document | None = None,
    *,
    opacity_decimals: int = OPACITY_DIGITS,
    stops: int = STOP_COUNTS[0],
) -> str:
    """Return the shortest SVG text of a scene. Coordinates are whole numbers of units.

    unit    user unit in px of the canvas
    digits  number of hex digits of a colour, 3 or 6
    opacity_decimals  number of decimals of opacities
    stops   number of stops of a gradient, one of STOP_COUNTS

    The file draws rounded(scene, unit, digits, opacity_decimals).scene. Title, alt, size and aspect
    are written if the document has them. If the document has no size, the size of the canvas in px
    is written in two cases. The first case is that a unit is less than a pixel. The second case is
    that a side is not a whole number of units. In the second case, resvg would otherwise round the
    sides of the view box to get a size, and so change the proportions.

    Raise InputError for an additive scene, and for animation or fragments, which need layers.
    """
    document = instance(document, "document", Document)
    document.check_without_layers("minimal markup", "which has no layers", "--markup editable")
    drawn, numbers, factor, written_areas = rounded(scene, unit, digits, opacity_decimals)
    canvas = np.array([scene.width, scene.height]) / unit
    box = [number(side, 6) for side in canvas]
    sides = np.array(box, float)
    # A shape is drawn after this number of areas.
    level = np.where(drawn.level == ABOVE, len(written_areas), drawn.level)
    areas = element.area_elements(written_areas, opacity_decimals, True, set(level.tolist()))
    a, b, d = factor.T
    half, cover = np.stack([a, portable.hypot(b, d)], axis=1), list[Element]()
    boxes = [areas.boxes, element.boxes_of(drawn.mean / unit, half)]
    if not scene.transparent:
        across, down = whole = np.ceil(sides)
        fill = _fill(color_levels(scene.background, digits))
        cover = [Element("path", fill=fill, d=f"M0 0h{across:.0f}v{down:.0f}H0")]
        boxes.append(np.array([[0, 0, *whole]]))
    used = len(areas.definitions)
    definitions, shapes = _drawing(drawn, numbers, opacity_decimals, stops, used)
    definitions = areas.definitions + definitions
    # The number of areas below each element. It is larger by 0.5 for an area.
    below = [(level[i], one) for i, one in shapes]
    below += [(k + 0.5, path) for k, path in zip(areas.starts, areas.paths, strict=True)]
    inside = [one for _, one in sorted(below, key=lambda one: one[0])]
    body = element.clipped([*cover, *inside], np.vstack(boxes), sides)
    defs = [Element("defs", definitions)] if definitions else []
    # An alt without a title is the title, for the name of the picture.
    title, alt = "" if document.title == DEFAULT_TITLE else document.title, document.alt or ""
    texts = {"title": title or alt, "desc": alt if title else ""}
    named = [Element(tag, escape(text)) for tag, text in texts.items() if text]
    # If the root has no width and height, the picture has as many px as the view box has units, and
    # resvg rounds these numbers.
    is_exact = unit >= 1 and np.allclose(canvas, np.maximum(np.round(canvas), 1), 1e-9, 0)
    size = document.sides(scene.width, scene.height)
    if size is None and not is_exact and not document.is_responsive:
        size = number(scene.width, 3), number(scene.height, 3)
    width, height = size or (None, None)
    root = {"xmlns": "http://www.w3.org/2000/svg", "width": width, "height": height}
    root |= {"preserveAspectRatio": document.aspect, "role": "img" if named else None}
    root["viewBox"] = f"0 0 {' '.join(box)}"
    svg = Element("svg", [*named, *defs, *body], **root).text()
    svg = element.with_own_ids(svg) if areas.paths else svg
    return svg if cover else signed(svg)  # the path `cover` is a mark too (file.is_own)


def _drawing(
    scene: Scene, numbers: Floats, opacity_decimals: int, stops: int, used: int
) -> tuple[list[Element], list[tuple[int, Element]]]:
    """Return the definitions of the shapes of a file, and the elements of these shapes.

    Each element comes with the index of its first shape.

    scene, numbers  as in Rounded
    stops   number of stops of a gradient
    used    number of ids that are already in use
    """
    plain, opacities = scene.drawn == PLAIN, [number(v, opacity_decimals) for v in scene.opacity]
    fills = [_fill(color) for color in np.round(255 * scene.color)]
    kinds, soft = nearest_class(scene.beta).tolist(), np.flatnonzero(~plain)
    most = max(MOST_MASKED + FADING * (MOST_MASKED - len(soft)), 0)
    # The upper shapes get the masks, because they are smaller, so their masks are drawn faster.
    split = max(len(soft) - most, 0)
    by_gradient, by_mask = soft[:split].tolist(), soft[split:].tolist()
    has_gradient = set(by_gradient)
    is_close = len(by_mask) >= 60 or bool(scene.areas)
    definitions, uses = _masked([kinds[i] for i in by_mask], used, MASK_STOPS[is_close])
    soft_elements = {i: uses[kinds[i]] for i in by_mask}
    if by_gradient:
        keys = [(kinds[i], fills[i] or "#000") for i in by_gradient]
        more, ids = _gradients(keys, stops, used + 3 * len(uses))
        definitions = more + definitions
        for i, key in zip(by_gradient, keys, strict=True):
            fills[i] = f"url(#{ids[key]})"
            soft_elements[i] = Element("circle", r=_circle(kinds[i]))
    # Opaque ellipses of the same colour and level that follow each other share a path. Each
    # translucent ellipse has its own path, because each must be blended separately.
    keys = zip(fills, scene.level.tolist(), strict=True)
    keys = [key if plain[i] and opacities[i] == "1" else i for i, key in enumerate(keys)]
    elements = list[tuple[int, Element]]()
    for _, run in groupby(range(len(fills)), lambda i: keys[i]):
        index = list(run)
        i = index[0]
        name = "fill-opacity" if i in has_gradient else "opacity"
        look = {"fill": fills[i], name: unless("1", opacities[i])}
        if plain[i]:
            elements.append((i, Element("path", **look, d=path_data(numbers[index]))))
        else:
            a, b, d, e, f = (number(v, 0) for v in numbers[i])
            matrix = f"matrix({a} {b} 0 {d} {e} {f})".replace(" -", "-")
            elements.append((i, soft_elements[i].replace(**look, transform=matrix)))
    return definitions, elements


def _fill(levels: Ints | Floats) -> str | None:
    """Return a colour (3,) in levels of 255 as #rrggbb or #rgb.

    Return None for black, which is the default and need not be written.
    """
    return unless("#000", hex_color(levels))


def _masked(kinds: list[int], used: int, count: int) -> tuple[list[Element], dict[int, Element]]:
    """Return definitions of circles under masks, and elements that refer to these circles.

    For each distinct class in `kinds` there are three definitions: a circle, its mask, and the
    gradient in the mask. The second result maps each class to a <use> that refers to the circle of
    the class. The commonest class has the first id.

    used   number of ids that are already in use
    count  number of stops of a gradient
    """
    uses, definitions = dict[int, Element](), list[Element]()
    for kind, _ in Counter(sorted(kinds)).most_common():
        name, mask, ramp = (short_id(used + 3 * len(uses) + part) for part in range(3))
        stops = [
            Element("stop", offset=number(at, 3), stop_color=_fill(np.full(3, 17 * grey)))
            for at, grey in zip(*grey_stops(count, BETA_CLASSES[kind]), strict=True)
        ]
        r, disc = _circle(kind), {"href": f"#{short_id(used + 2)}"} if uses else _UNIT_DISC
        definitions += [
            Element("radialGradient", stops, id=ramp, **disc),
            Element("mask", [Element("circle", r=r, fill=f"url(#{ramp})")], id=mask),
            Element("circle", id=name, r=r, mask=f"url(#{mask})"),
        ]
        uses[kind] = Element("use", href=f"#{name}")
    return definitions, uses


def _gradients(
    keys: list[tuple[int, str]], stops: int, used: int
) -> tuple[list[Element], dict[tuple[int, str], str]]:
    """Return the definitions of gradients, and the id of the gradient of each key.

    The definitions are a style sheet, a gradient for each exponent, and a gradient for each pair of
    an exponent and a colour, which refers to the gradient of the exponent.

    keys   class of the exponent, and the colour, of each shape
    stops  number of stops of a gradient
    used   number of ids that are already in use
    """
    rules, definitions, first = "", list[Element](), dict[int, str]()
    for kind in sorted({kind for kind, _ in keys}):
        first[kind] = name = short_id(used + len(first))
        for at, value in enumerate(gradient_stops(stops, BETA_CLASSES[kind])[1]):
            look = ("" if at else "stop-color:currentColor;") + f"stop-opacity:{number(value, 3)}"
            rules += f'[href="#{name}"] stop{"+stop" * at}{{{look}}}'
        # Because of the fx, resvg draws the gradient by a more accurate algorithm.
        definitions.append(Element("radialGradient", id=name, **_UNIT_DISC, fx=".001"))
    ids = dict[tuple[int, str], str]()
    for key, _ in Counter(keys).most_common():
        kind, color = key
        ids[key] = name = short_id(used + len(first) + len(ids))
        offsets = gradient_stops(stops, BETA_CLASSES[kind])[0]
        ramp = [Element("stop", offset=number(at, 4)) for at in offsets]
        href = f"#{first[kind]}"
        definitions.append(Element("radialGradient", ramp, id=name, href=href, color=color))
    return [Element("style", rules), *definitions], ids


def _circle(kind: int) -> str:
    # A circle of radius 1 ends where its gradient ends. If the rim is crisp, the antialiased edge
    # of such a circle would clip it, so the circle is made larger (gauss2svg.svg.encode).
    return "1.1" if BETA_CLASSES[kind] >= 6 else "1"


def rounded(
    scene: Scene, unit: float, digits: int = 3, opacity_decimals: int = OPACITY_DIGITS
) -> Rounded:
    """Return what the file of a scene draws.

    A shape is left out if its extent or opacity is written as 0. `in_units` says which areas are
    left out. Numbers of areas, means, extents, colours, opacities and exponents are those of the
    file. All shapes are in one round, because a minimal file has no layers.

    unit    user unit in px
    digits  number of hex digits of a colour, 3 or 6

    Raise InputError for an additive scene. Raise SceneError if the numbers of a shape are too large
    for a file.
    """
    if scene.blend == ADD:
        advice = "--portable, or --markup editable"
        raise refusal("blend in minimal markup", "'over'", quoted(scene.blend), advice)
    areas, scene = element.in_units(scene, scene.areas, unit, opacity_decimals)
    soft = with_falloffs(scene, np.array(BETA_CLASSES)[nearest_class(scene.beta)])
    radius = drawn_radius(soft.beta, np.zeros(len(soft), bool))
    element.check_scene(soft, radius, unit)
    a, b, d = soft.cholesky.T * radius
    numbers = np.round(np.column_stack([a, b, d, soft.mean]) / unit) + 0.0  # turns -0 into 0
    # After its numbers are rounded, a soft shape may look the same as a plain ellipse. It would
    # become an arc when its file is read and written again, so it is one from the start.
    kept = (numbers[:, 0] * numbers[:, 2] > 0) & (scene.drawn != PLAIN)
    placed = _placed(soft.select(kept), numbers[kept, 3:], numbers[kept, :3], radius[kept], unit)
    plain = is_plain(scene)
    plain[kept] |= is_plain(placed)
    ellipses = scene.select(plain)
    numbers[plain] = arc_numbers(ellipses, drawn_radius(ellipses.beta, plain[plain]), unit)
    extent = np.where(plain, numbers[:, :2].min(axis=1), numbers[:, 0] * numbers[:, 2])
    opacity = np.round(scene.opacity, opacity_decimals)
    index = np.flatnonzero((extent > 0) & (opacity > 0))
    mean, factor = numbers[:, 3:].copy(), numbers[:, :3].copy()
    arcs = index[plain[index]]
    mean[arcs], factor[arcs] = arc_geometry(numbers[arcs])
    color, beta = color_levels(scene.color, digits), np.where(plain, BETA_CLASSES[-1], soft.beta)
    keys = np.stack([mean[:, 0], mean[:, 1], np.where(plain, -1, beta)])
    # Shapes are not moved over or under areas, so each level is ordered by itself.
    for level in np.unique(scene.level[arcs]):
        at = scene.level[index] == level
        own = index[at]
        index[at] = own[colors_together(mean[own], factor[own], color[own], keys[:, own], 1 / unit)]
    written = scene.replace(
        areas=[area.scaled(unit, unit) for area in areas],
        color=color / 255,
        opacity=opacity,
        background=color_levels(scene.background, digits) / 255,
        beta=beta,
        drawn=np.where(plain, PLAIN, SOFT),
        round_index=None,
    ).select(index)
    mean, factor, radius = mean[index], factor[index], drawn_radius(beta, plain)[index]
    return Rounded(_placed(written, mean, factor, radius, unit), numbers[index], factor, areas)


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

    Return two arrays (12, n): the centres of the projections, and half of their lengths. The
    arguments are those of `colors_together`.
    """
    # Lines that follow each other differ much, so that the first ones rule out most pairs.
    angle_rad = (5 * np.arange(12) % 12 * np.pi / 12)[:, None]
    x, y = portable.cos(angle_rad), portable.sin(angle_rad)
    l11, l21, l22 = factor.T
    return mean[:, 0] * x + mean[:, 1] * y, portable.hypot(l11 * x + l21 * y, l22 * y)


def overlapping(ellipses: tuple[Floats, Floats], i: int, others: Ints, margin: float) -> Ints:
    """Return those of the ellipses `others` that overlap the ellipse `i`.

    ellipses  what `projections` returns. Two ellipses count as apart if there is a line onto which
              their projections are apart
    margin    smallest distance at which two projections count as apart
    """
    for center, half in zip(*ellipses, strict=True):
        others = others[np.abs(center[others] - center[i]) < half[others] + half[i] + margin]
    return others


def colors_together(mean: Floats, factor: Floats, color: Ints, key: Floats, margin: float) -> Ints:
    """Return an order (n,) of the shapes that draws the same picture with few changes of colour.

    Each shape, from bottom to top, joins the lowest run of its colour that is above all runs with
    shapes of other colours that it overlaps. If there is none, it begins a run.

    mean    (n, 2) centres of the ellipses that contain the shapes
    factor  (n, 3) Cholesky factors l11 l21 l22 of these ellipses
    color   (n, 3) colours of the shapes in whole levels
    key     (k, n) keys for sorting the shapes of a run. The primary key is the last
    margin  as in `overlapping`
    """
    kind = np.unique(color, axis=0, return_inverse=True)[1].reshape(-1)
    ellipses, run, kinds = projections(mean, factor), np.zeros(len(mean), np.intp), list[int]()
    for i, own in enumerate(kind.tolist()):
        below = overlapping(ellipses, i, np.flatnonzero(kind[:i] != own), margin)
        least = run[below].max(initial=-1) + 1
        run[i] = next((k for k in range(least, len(kinds)) if kinds[k] == own), len(kinds))
        kinds[run[i] :] = kinds[run[i] :] or [own]
    return np.lexsort([*key, run])
