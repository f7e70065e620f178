"""Elements of an SVG: Gaussians' shapes, areas and lines as whole numbers of the user unit.

Element.text writes all elements except the root of an editable file, which svgwrite writes
(gauss2svg.svg.encode). Areas and lines are paths:

    <path fill="#f80" d="m10 10h30v-5c9 4 9 11-2 15z"/>
    <path fill="none" stroke="#084" stroke-width="3" d="m0 4 9 5s8 2 7-3"/>

Path data begin with m and never with M, so that an area that is a rectangle over the whole canvas
is not the path that is the background of minimal markup. They have no arcs, which are ellipses.

The size of numbers in a file is limited, because renderers compute in float32, and some renderers
crash on large numbers.
"""

from __future__ import annotations

import dataclasses
import hashlib
import re
from collections.abc import Collection, Iterable, Sequence
from string import ascii_letters
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg.errors import SceneError
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.scene.areas import Area, LinearGradient, Outline, Paint, RadialGradient

Floats = NDArray[np.float64]
# The largest number in a file, in user units. From about 1e9 on, resvg panics. With numbers up to
# 1e8, the errors of all six renderers are at most 2.1 levels of 255 (docs/decisions/numbers.md).
LARGEST_NUMBER = 1e8
# The largest distance of a shape's edge from the origin, in px. Renderers that use cairo are wrong
# beyond it, because cairo has only 23 bits for whole pixels. At a distance of 1e7 px their errors
# are 47 levels of 255.
FARTHEST = 8e6
# Matches the place of a short id, at its definition and in references to it.
_SHORT_ID = re.compile(r'(?:(?<= id=")|(?<=href="#)|(?<=url\(#))(?=[a-zA-Z]{1,4}[")])')


class Element:
    """An element: its tag, its content, and its attributes in the order of the file.

    inside      elements, a text, or None for a tag that closes itself
    attributes  each _ in a name becomes -. Attributes whose value is None are left out

    Texts and attributes are not escaped here. Callers must escape texts that come from users.
    """

    __slots__ = "attributes", "inside", "tag"

    def __init__(
        self, tag: str, inside: Sequence[Element] | str | None = None, /, **attributes: str | None
    ) -> None:
        self.tag, self.inside = tag, inside
        self.attributes = {k.replace("_", "-"): v for k, v in attributes.items() if v is not None}

    def replace(self, **attributes: str | None) -> Element:
        """Return a copy of the element with other attributes. None removes an attribute."""
        return Element(self.tag, self.inside, **{**self.attributes, **attributes})

    def text(self) -> str:
        """Return the element as SVG text, without white space between tags."""
        attributes = "".join([f' {name}="{value}"' for name, value in self.attributes.items()])
        begin, inside = f"<{self.tag}{attributes}", self.inside
        if inside is None:
            return begin + "/>"
        if not isinstance(inside, str):
            inside = "".join([one.text() for one in inside])
        return f"{begin}>{inside}</{self.tag}>"


def clipped(
    body: Sequence[Element], boxes: Floats, canvas: ArrayLike, **attributes: str
) -> Sequence[Element]:
    """Return `body`, in an inner <svg> if a shape reaches beyond the canvas.

    If the box of a picture has other proportions than its view box, browsers also show what lies
    beside the view box. An inner <svg> covers the view box and clips what it contains
    (docs/decisions/clip.md).

    boxes       (n, 4) left, top, right and bottom of the boxes around the shapes
    canvas      width and height, in the same unit
    attributes  attributes of the inner <svg>
    """
    if not ((boxes[:, :2] < 0) | (boxes[:, 2:] > np.asarray(canvas))).any():
        return body
    return [Element("svg", body, **attributes)]


def boxes_of(mean: Floats, half: Floats) -> Floats:
    """Return boxes (n, 4) with these centres (n, 2) and halves (n, 2) of their sides."""
    return np.hstack([mean - half, mean + half])


def unless(default: str, value: str) -> str | None:
    """Return `value`, or None if it is the default of its attribute and need not be written."""
    return None if value == default else value


def number(value: float, decimals: int) -> str:
    """Return the shortest text of a finite value that is rounded to `decimals` decimals."""
    text = f"{value:.{decimals}f}"
    text = text.rstrip("0").rstrip(".") if decimals else text
    if text.startswith(("0.", "-0.")):
        return text.replace("0.", ".", 1)
    return "0" if text == "-0" else text


def hex_color(color: Iterable[float]) -> str:
    """Return three levels in 0..255 as #rgb, or as #rrggbb if #rgb cannot be exact."""
    text = "#" + "".join(f"{int(v):02x}" for v in color)
    return "#" + text[1::2] if text[1::2] == text[2::2] else text


def short_id(index: int) -> str:
    """Return the id with this index, counted from 0, in the list a, b, ..., Z, aa, ab, ..."""
    before, last = divmod(index, len(ascii_letters))
    return (short_id(before - 1) if before else "") + ascii_letters[last]


def with_own_ids(svg: str) -> str:
    """Return the text of a file whose short ids begin with four letters of a hash of its elements.

    Two such files can be inline in one page, where each id must be unique. Ids of layers and
    areas, which people read, remain.
    """
    # User texts, which may look like ids, come before the definitions.
    head, begin, rest = svg.partition("<defs>")
    hashed = hashlib.sha256(rest.encode()).digest()
    own = "".join(ascii_letters[byte % len(ascii_letters)] for byte in hashed[:4])
    return head + begin + _SHORT_ID.sub(own, rest)


def check_scene(scene: Scene, radius: Floats, unit: float) -> None:
    """Raise SceneError if a canvas is too small or too large, or a shape too large or far away.

    radius  (n,) radius, in sigmas, of the discs that are drawn
    unit    user unit of the file in px
    """
    low, high = sorted((scene.width, scene.height))
    most = LARGEST_NUMBER * unit
    if low < 0.01 or high > most:
        raise SceneError(
            f"canvas of an SVG must be 0.01..{most:g} px a side at a precision of {unit:g} px; got "
            f"{scene.width:g}x{scene.height:g} px. Try to scale the scene"
        )
    farthest = (np.abs(scene.mean) + radius[:, None] * scene.sigma).max(axis=1)
    if len(scene):
        _check_reach(f"Gaussian {farthest.argmax()}", farthest.max(), unit)


def _check_reach(name: str, farthest: float, unit: float) -> None:
    most = min(LARGEST_NUMBER * unit, FARTHEST)
    if farthest > most:
        raise SceneError(
            f"{name} must reach at most {most:g} px at a precision of {unit:g} px; got "
            f"{farthest:g} px. Try to scale the scene down, to drop what lies so far off, or a "
            "coarser precision"
        )


def path_data(outline: Outline, current: tuple[int, int] = (0, 0)) -> str:
    """Return the relative path data of an outline with whole coordinates.

    current  point at which the path data before it end

    Segments whose ends are equal are left out, and the last line of a closed outline is left to z.
    Return "" if nothing of a closed outline is left. An open outline of which nothing is left
    becomes a dot.
    """
    points = [(round(x), round(y)) for x, y in outline.points]
    x, y = handle = points[0]
    text, at, last = _command("m", (x - current[0], y - current[1])), 0, len(outline.curved) - 1
    start, before = text, "l"
    if outline.closed:
        points.append(points[0])
    for k, is_curve in enumerate(outline.curved):
        a, b = c, d = e, f = points[at + 1]
        if is_curve:
            (c, d), (e, f) = points[at + 2], points[at + 3]
        at += 3 if is_curve else 1
        if not is_curve or ((a, b) == (x, y) and (c, d) == (e, f)):
            if (e, f) == (x, y) or (k == last and outline.closed):
                continue
            letter, numbers, handle = "l", (e - x, f - y), (e, f)
            if 0 in numbers:
                letter, numbers = ("h", numbers[:1]) if f == y else ("v", numbers[1:])
        else:
            letter, numbers = "s", (c - x, d - y, e - x, f - y)
            if (a, b) != handle:
                letter, numbers = "c", (a - x, b - y, *numbers)
            handle = 2 * e - c, 2 * f - d
        piece = _command(letter, numbers)
        # The letter may be left out after the same one, and l after m.
        piece = piece if letter != before else piece[1:] if piece[1] == "-" else " " + piece[1:]
        text, before, x, y = text + piece, letter, e, f
    if text == start:
        return "" if outline.closed else text + "h0"
    return text + "z" if outline.closed else text


def _command(letter: str, numbers: Iterable[int]) -> str:
    return letter + " ".join(map(str, numbers)).replace(" -", "-")


def in_units(
    scene: Scene, areas: Iterable[Area], unit: float, opacity_decimals: int
) -> tuple[list[Area], Scene]:
    """Return areas as a file has them, in user units, and the scene without the others.

    scene  scene that has the areas, or whose areas have the same places

    Coordinates and widths are whole numbers. An area is left out if its outlines, its width or its
    opacity is written as 0. Levels count the areas that are kept. A Gaussian with none of them
    above it gets the level ABOVE. Raise SceneError if a number is too large for a file.
    """
    written, kept = list[Area](), list[int]()
    for k, one in enumerate(areas):
        places = [point for outline in one.outlines for point in outline.points]
        places += () if isinstance(one.paint, tuple) else one.paint.place
        _check_reach("an area", max(one.width, np.abs(places).max()), unit)
        area = one.scaled(1 / unit, 1 / unit)
        whole = [
            dataclasses.replace(o, points=tuple((round(x), round(y)) for x, y in o.points))
            for o in area.outlines
        ]
        outlines = tuple(outline for outline in whole if path_data(outline))
        opacity, width = round(area.opacity, opacity_decimals), round(area.width)
        if outlines and opacity and (width or not area.is_line):
            look = {"paint": _whole_paint(area.paint), "opacity": opacity, "width": width}
            # Closed lines have no ends, and readers find butt ones.
            if area.cap == "square" and all(outline.closed for outline in outlines):
                look["cap"] = "butt"
            written.append(dataclasses.replace(area, outlines=outlines, **look))
            kept.append(k)
    level = np.searchsorted(kept, scene.level)
    level = np.where((scene.level == ABOVE) | (level == len(kept)), ABOVE, level)
    return written, scene.replace(areas=[scene.areas[k] for k in kept], level=level)


def _whole_paint(paint: Paint) -> Paint:
    """Return a paint with whole coordinates and colours of 8 bits."""
    if isinstance(paint, tuple):
        return tuple(np.round(np.array(paint) * 255) / 255)
    colors = np.round(np.array(paint.colors) * 255) / 255
    changes = {"offsets": np.round(paint.offsets, 3), "colors": colors}
    if isinstance(paint, RadialGradient):
        radii = np.maximum(np.round(paint.radii), 1)
        return dataclasses.replace(paint, center=np.round(paint.center), radii=radii, **changes)
    start, end = np.round(paint.start), np.round(paint.end)
    if (start == end).all():  # renderers draw such a gradient in its last colour
        return tuple(colors[-1])
    return dataclasses.replace(paint, start=start, end=end, **changes)


class AreaElements(NamedTuple):
    """The elements of the areas and lines of a file.

    definitions  their gradients, which have the first ids of the file
    paths        one element for each area, from bottom to top. In minimal markup, consecutive areas
                 that look the same and whose boxes are apart share one, which draws the same
    starts       for each path, the number of areas below it
    boxes        (n, 4) left, top, right and bottom of the areas, in user units. They are smaller
                 by a thousandth at each side, so that areas that end at a side of the canvas do not
                 reach beyond it by a rounding error
    """

    definitions: list[Element]
    paths: list[Element]
    starts: list[int]
    boxes: Floats


def area_elements(
    areas: Iterable[Area],
    opacity_decimals: int,
    is_minimal: bool = False,
    levels: Collection[int] = (),
) -> AreaElements:
    """Return the elements of areas that `in_units` returned.

    levels  levels of the Gaussians among the areas. Areas below and above such a Gaussian never
            share an element
    """
    ids, definitions, paths = dict[str, str](), list[Element](), list[Element]()
    boxes, starts, before = list[tuple[float, ...]](), list[int](), dict[str, str | None]()
    current = (0, 0)
    for k, area in enumerate(areas):
        paint = _paint(area.paint, is_minimal)
        if isinstance(paint, Element):
            key = paint.text()
            if key not in ids:
                ids[key] = short_id(len(ids))
                definitions.append(paint.replace(id=ids[key]))
            paint = f"url(#{ids[key]})"
        look, box = _look(area, paint, opacity_decimals, is_minimal), _box(area)
        shares = is_minimal and look == before and k not in levels
        if not (shares and _is_apart(box, boxes[starts[-1] :])):
            key = None if is_minimal else f"area-{k + 1}"
            paths.append(Element("path", **look, id=key, d=""))
            starts.append(k)
            current = (0, 0)
        for outline in area.outlines:
            paths[-1].attributes["d"] += path_data(outline, current)
            x, y = outline.points[0 if outline.closed else -1]
            current = round(x), round(y)
        before = look
        boxes.append(box)
    inner = np.array(boxes).reshape(-1, 4) + np.array([1e-3, 1e-3, -1e-3, -1e-3])
    return AreaElements(definitions, paths, starts, inner)


def _look(area: Area, paint: str, opacity_decimals: int, is_minimal: bool) -> dict[str, str | None]:
    """Return all attributes of the path of an area but its data and its id."""
    opacity = unless("1", number(area.opacity, opacity_decimals))
    kind = "" if is_minimal else "stroke-" if area.is_line else "fill-"
    if not area.is_line:
        return {"fill": unless("#000", paint) if is_minimal else paint, f"{kind}opacity": opacity}
    return {
        "fill": "none",
        "stroke": paint,
        "stroke-width": unless("1" if is_minimal else "", number(area.width, 0)),
        f"{kind}opacity": opacity,
        "stroke-linecap": unless("butt", area.cap),
        "stroke-linejoin": "round" if area.cap == "round" else None,
    }


def _box(area: Area) -> tuple[float, ...]:
    """Return left, top, right and bottom of the box around an area, its strokes included."""
    points = np.array([point for outline in area.outlines for point in outline.points])
    # Mitred corners and square ends reach up to two widths beyond an outline, because four is the
    # default of stroke-miterlimit, and half of the width is on each side.
    margin = area.width * (0.5 if area.cap == "round" else 2.0)
    return *(points.min(axis=0) - margin).tolist(), *(points.max(axis=0) + margin).tolist()


def _is_apart(box: tuple[float, ...], others: Iterable[tuple[float, ...]]) -> bool:
    left, top, right, bottom = box
    return all(right <= a or c <= left or bottom <= b or d <= top for a, b, c, d in others)


def _paint(paint: Paint, is_minimal: bool) -> str | Element:
    """Return a colour as text, or a gradient as an element without an id."""
    if isinstance(paint, tuple):
        return hex_color(np.round(np.array(paint) * 255))
    zero, black = ("0", "#000") if is_minimal else ("", "")
    stops = []
    for at, color in zip(paint.offsets, np.round(np.array(paint.colors) * 255), strict=True):
        look = {"stop_color": unless(black, hex_color(color))}
        stops.append(Element("stop", offset=unless(zero, number(at, 3)), **look))
    place: dict[str, str | None] = {"gradientUnits": "userSpaceOnUse"}
    if isinstance(paint, LinearGradient):
        (x1, y1), (x2, y2) = ([number(v, 0) for v in p] for p in (paint.start, paint.end))
        place |= {"x1": unless("0", x1), "y1": unless("0", y1), "x2": x2, "y2": unless("0", y2)}
        return Element("linearGradient", stops, **place)
    (cx, cy), (rx, ry) = ([number(v, 0) for v in p] for p in (paint.center, paint.radii))
    if rx == ry:
        return Element("radialGradient", stops, **place, cx=cx, cy=cy, r=rx)
    # If the radii differ, the gradient is a circle of radius 100 under a matrix with two decimals.
    # With a radius of 1, cairo would round the inverse of the matrix to 1 %
    # (docs/decisions/svg.md).
    a, d = (number(v / 100, 2) for v in paint.radii)
    onto = f"matrix({a} 0 0 {d} {cx} {cy})"
    place |= {"cx": "0", "cy": "0", "r": "100", "gradientTransform": onto}
    return Element("radialGradient", stops, **place)
