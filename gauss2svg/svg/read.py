"""Read scenes from SVG files of write_svg, even if an editor saved them, and of other programs.

Additive files are refused. Editable files have groups of circles. Minimal files have <use>
elements that refer to masked circles, circles with gradients whose opacities are in a style sheet,
and paths of arcs. Other paths are areas and lines, and so are rectangles, polygons, and circles
with a stroke or a gradient of opaque colours, as other programs draw them. The same code reads all
kinds of files, because it decides for each element how to read it.

Inkscape 1.2 changes a file in these ways when it saves it. tests/data has such a file, before and
after.

- If the file is only opened and saved, ids and a namedview are added. Numbers stay as they were.
- If a single shape is moved, rotated or scaled, it becomes an ellipse whose cx, cy, rx and ry have
  8 digits. Its transform has columns of length 1. Its gradient gets a gradientTransform. If other
  shapes use the same gradient, a new gradient gets the gradientTransform, and refers to the old
  gradient for its stops.
- "Object to Path" turns a shape into a path of four arcs. Later transforms keep the arcs.
- If a group or layer is moved, it gets a transform. If it is ungrouped, its children get this
  transform.
- Colours, opacities and display are written into style=, which overrides the attributes.
- If the page is resized, width, height and viewBox change, and layers and background are moved.
- If the file is saved as plain SVG, labels and layers are dropped, and ids are kept.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from gauss2svg import portable
from gauss2svg.errors import InputError, SceneError, brief, quoted, refusal
from gauss2svg.scene import ABOVE, BLURRED, PLAIN, RHO_LIMIT, Area, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, covered_radius
from gauss2svg.svg import CANVAS, file, paints
from gauss2svg.svg.file import INKSCAPE, MOST_BYTES, NUMBER, SVG, numbers
from gauss2svg.svg.paints import Fill, Gradient, color_of, reference_of, share_of, styled
from gauss2svg.svg.paths import Affine, data_of, ellipses_of, length, nonzero, outlines_of

# The default limit on the number of elements in a file. The tree of a file with this many elements
# takes about 3 GB of memory.
MOST_ELEMENTS = 4_000_000
_DEEPEST = 100  # largest depth of nested groups
_GROUPS = {"svg", "g", "use"}
_SHAPES = {"path", "rect", "polygon", "polyline", "line", "circle", "ellipse"}
# Attributes of fills and strokes that elements inherit, and their values at the root.
_INHERITED = {"fill", "fill-opacity", "fill-rule", "paint-order", "stroke", "stroke-width"}
_INHERITED |= {"stroke-opacity", "stroke-linecap", "stroke-linejoin", "stroke-miterlimit"}
_INHERITED |= {"stroke-dasharray", "color"}
_USUAL = MappingProxyType({"color": "black", "fill": "black", "stroke": "none"})
# Elements that draw nothing themselves.
_SILENT = {"title", "desc", "metadata", "defs", "radialGradient", "linearGradient"}
_SILENT |= {"filter", "mask", "style", "clipPath"}
# Attributes and properties that change how a shape looks. An element with one of them is refused,
# unless its value is none, normal, inherit or visible.
_EFFECTS = {"vector-effect", "filter", "mask", "mix-blend-mode", "visibility", "animation"}
_EFFECTS |= {"translate", "rotate", "scale", "transform-origin", "transform-box", "offset-path"}
_EFFECTS |= {"zoom", "systemLanguage", "all"}
_EFFECTS |= {"marker", "marker-start", "marker-mid", "marker-end"}


def read_svg(
    source: str | bytes | os.PathLike[str],
    *,
    max_bytes: int = MOST_BYTES,
    max_elements: int = MOST_ELEMENTS,
) -> Scene:
    """Return the scene of an SVG that write_svg wrote, even if Inkscape has edited and saved it.

    Paths of other programs are areas and lines of the scene, and so are rectangles and polygons. A
    circle or an ellipse of one colour is a Gaussian that is drawn crisply.

    The covariance of a shape is (M / R)(M / R)^T. M is the linear part of all transforms down to
    the unit circle of its gradient, and R = cut_radius(beta). The exponent of a shape is the one of
    BETA_CLASSES to which the stops of its gradient belong. A plain ellipse gets the largest of
    them. Numbers are as exact as in the file.

    The round of a shape comes from the label or the id of its group ("Round 3: ..", "round-3"). It
    is at least the round of the shapes below it. If a group at the top level has no such label or
    id, the group is a round of its own. A minimal file has one round. If a minimal file has no
    size, the scene is in user units. The scene of a file without a background is transparent.

    source       a path (.svg or .svgz), a text, or bytes
    max_bytes, max_elements  limits of the gunzipped file. Raise them for a file that you trust

    Raise InputError if the file has anything that a scene cannot hold. The message names the
    element. Such things are additive files, texts, images, masks, filters, dashes, style sheets,
    clips to a part of the canvas, and a group with an opacity (docs/reference/svg.md).
    """
    text = file.from_root(file.read_source(source, max_bytes, "source", "max_bytes")[1])
    if text.count("<") - text.count("</") > max_elements:
        needed = f"of at most {max_elements} elements"
        raise refusal("the SVG", needed, "more", "a larger max_elements if you trust it")
    return _Reader(file.parse(text)).scene()


class _State(NamedTuple):
    """The state that an element inherits from its ancestors.

    onto    map from the user space of the element to px
    style   attributes of _INHERITED
    in_svg  whether the parent is an <svg>: the root, or the inner one that clips the picture
    """

    onto: Affine
    style: Mapping[str, str] = _USUAL
    opacity: float = 1.0
    round: int = 0
    depth: int = 0
    in_svg: bool = False

    @property
    def has_stroke(self) -> bool:
        """Whether the element has a stroke."""
        return self.style["stroke"].lower() != "none"

    def paint(self, name: str) -> str:
        """Return the fill or the stroke, with the colour for which currentColor stands."""
        value = self.style[name]
        return self.style["color"] if value == "currentColor" else value

    def share(self, name: str) -> float:
        """Return fill-opacity or stroke-opacity."""
        return share_of(self.style.get(name, "1"), name)


class _Shape(NamedTuple):
    """A shape. `disc` maps the unit circle onto the edge of its fill, in px."""

    disc: Affine
    fill: Fill
    opacity: float
    round: int
    level: int


class _Reader:
    """Reads one document: visits the elements and collects their shapes."""

    def __init__(self, root: Any) -> None:
        self._by_id = {e.get("id"): e for e in root.iter() if e.get("id")}
        rules = dict[tuple[str, int], dict[str, str]]()
        self._gradient = cache(lambda key: Gradient.of(self._by_id, key, rules))
        self._falloff = cache(lambda key, in_mask: self._gradient(key).fill(in_mask))
        self._areas: list[Area] = []
        self._shapes: list[_Shape] = []
        self._background: Any = None  # colour of the background
        for sheet in root.iter(SVG + "style"):
            with _naming(sheet):
                rules.update(_rules_of(sheet))
        with _naming(root):
            if root.tag != SVG + "svg":
                raise refusal("the root", "an <svg> in the namespace of SVG", root.tag[:80])
            self._size, self._user_size, self._onto = _canvas(root.attrib)
        self._visit(root, _State(self._onto))

    def _visit(self, element: Any, parent: _State) -> None:
        """Add the shapes of an element and of its children."""
        space, _, tag = element.tag.rpartition("}")
        if space + "}" != SVG or tag in _SILENT:
            return  # an element of another namespace or with a tag in _SILENT draws nothing
        with _naming(element):
            is_drawn = tag in _GROUPS | _SHAPES
            if not is_drawn or parent.depth > _DEEPEST:
                deep = f"in at most {_DEEPEST} groups, and in no other shape"
                needed = deep if is_drawn else "paths and plain shapes alone"
                advice = "to delete it, or to convert it to paths"
                raise refusal("elements", needed, brief(tag), advice)
            attributes = styled(element)
            state = _inherited(attributes, parent, tag)
            clip = attributes.get("clip-path", "none")
            if clip.lower() != "none" and not self._is_page(clip, state.onto):
                needed = "none, or an upright rectangle over the whole canvas"
                raise refusal("its clip-path", needed, quoted(clip), "to remove it")
            if attributes.get("display", "").lower() == "none":
                raise refusal("shapes", "visible", "a hidden one", "to show it, or to delete it")
            if tag not in _GROUPS:
                self._add(tag, attributes, state)
                # A shape cannot have children that are shapes. Because of this depth, `_visit`
                # refuses each child that would draw something.
                state = state._replace(depth=_DEEPEST)
            children = list(element)
            if tag == "use":
                x, y = (numbers(attributes.get(name, "0"), name, 1)[0] for name in ("x", "y"))
                state = state._replace(onto=state.onto @ Affine(e=x, f=y))
                children = [paints.target_of(self._by_id, paints.link_of(element), "circle", "use")]
            elif tag in ("svg", "g"):
                # An inner <svg> clips the picture. It covers the view box with these values.
                inner = {"x": "0", "y": "0", "width": "100%", "height": "100%", "viewBox": "none"}
                for name, whole in inner.items() if tag == "svg" and parent.depth else ():
                    if (value := attributes.get(name, whole)) != whole:
                        raise refusal(f"its {name}", whole, quoted(value), "to undo what set it")
                number = _round_of(element)
                is_top = tag == "g" and state.in_svg
                # If fill is the only attribute of a group, the group is from minimal markup, which
                # has no rounds.
                if number is None and is_top and set(element.attrib) != {"fill"}:
                    number = self._shapes[-1].round + 1 if self._shapes else 0
                state = state if number is None else state._replace(round=number)
        state = state._replace(depth=state.depth + 1, in_svg=tag == "svg")
        for child in children:
            self._visit(child, state)

    def _add(self, tag: str, attributes: Mapping[str, str], state: _State) -> None:
        """Add what an element draws: the background, an area, or shapes.

        A path of minimal markup may have several shapes.
        """
        alpha, fill = state.opacity * state.share("fill-opacity"), state.paint("fill")
        data = attributes.get("d", "") if tag == "path" else ""
        key = reference_of(fill)
        # The path that is the background in minimal markup
        cover = re.fullmatch(r"M0 0h(?P<width>\d+)v(?P<height>\d+)H0", data)
        if cover or tag == "rect":
            sides = self._sides({**attributes, **cover.groupdict()} if cover else attributes)
            is_lowest = not (self._shapes or self._areas or state.has_stroke)
            is_plain = key is None and fill != "none" and not {"rx", "ry"} & attributes.keys()
            if is_lowest and is_plain and alpha == 1 and self._covers(sides, state.onto):
                self._background = color_of(fill, "fill")
                return
            texts = {name: str(side) for name, side in sides.items()}
            tag, attributes = "rect", {**attributes, **texts}
        is_area = tag == "rect" or state.has_stroke
        is_area = is_area or (key is not None and not self._gradient(key).is_falloff)
        ellipses = [] if is_area else ellipses_of(tag, attributes)
        if not ellipses:
            self._add_area(data_of(tag, attributes), attributes, state)
        number = max(self._shapes[-1].round if self._shapes else 0, state.round)
        for edge in ellipses:
            own = self._fill_of(fill, attributes, edge)
            if len(ellipses) > 1 and (alpha < 1 or own.drawn != PLAIN):
                raise refusal("ellipses of one path", "opaque and of one colour", "another fill")
            outline, disc = state.onto @ edge, state.onto @ (own.disc or edge)
            if not _shows_all(outline, disc):
                needed = "an ellipse with an extent that shows all of its gradient"
                raise refusal("it", needed, "another", "to undo what changed it, or to delete it")
            opacity = min(1.0, alpha * own.peak)
            self._shapes.append(_Shape(disc, own, opacity, number, len(self._areas)))

    def _add_area(self, data: str, attributes: Mapping[str, str], state: _State) -> None:
        """Add the fill of a path as an area, and its stroke as a line."""
        style, opacity = state.style, state.opacity
        for name in ("filter", "mask"):
            if (value := attributes.get(name, "none")) != "none":
                raise refusal(f"its {name}", "none", quoted(value), "to remove it")
        looks = [name for name in ("fill", "stroke") if style[name].lower() != "none"]
        if len(looks) > 1 and opacity < 1:
            needed, advice = "1 with both a fill and a stroke", "to remove one of these"
            raise refusal("its opacity", needed, f"{opacity:g}", advice)
        if re.match("(?!.*fill.*stroke).*stroke", style.get("paint-order", "normal")):
            looks.reverse()  # the stroke is below the fill
        for look in looks:
            width, cap = 0.0, "butt"
            own = outlines_of(data, look == "fill")
            if look == "fill" and style.get("fill-rule", "nonzero") == "evenodd":
                own = nonzero(own)
            outlines = tuple(map(state.onto.of, own))
            if look == "stroke":
                width, cap = paints.stroke_of(style, outlines, state.onto, self._onto)
            elif len(looks) > 1 and max(len(outline.points) for outline in outlines) < 3:
                continue  # straight lines have no inside, but the fill that is the default
            if (key := reference_of(state.paint(look))) is None:
                paint = color_of(state.paint(look), look)
            else:
                paint = self._gradient(key).paint(own, state.onto)
            alpha = opacity * state.share(f"{look}-opacity")
            self._areas.append(Area(outlines, paint, alpha, width, cap))

    def _fill_of(self, fill: str, attributes: Mapping[str, str], edge: Affine) -> Fill:
        """Return the fill of a shape. Raise InputError if write_svg does not write such a fill."""
        texts = fill, attributes.get("filter", ""), attributes.get("mask", "")
        key, blur_id, mask_id = map(reference_of, texts)
        if key is not None and blur_id is None and mask_id is None:
            return self._falloff(key, False)
        color = color_of(fill, "fill")
        if mask_id is not None:
            inside = paints.gradient_id(paints.target_of(self._by_id, mask_id, "mask"), edge)
            return self._falloff(inside, True)._replace(color=color)
        if blur_id is None:
            return Fill(color)
        blur = paints.blur_of(paints.target_of(self._by_id, blur_id, "filter"), edge)
        # write_svg multiplies the opacity of a shape by blur.peak to get the fill-opacity of its
        # blurred disc. 1 / blur.peak undoes this.
        return Fill(color, BLURRED, 1 / blur.peak, blur.beta, blur.radius)

    def _sides(self, attributes: Mapping[str, str]) -> dict[str, float]:
        """Return x, y, width and height of a rectangle, in user units."""
        sides = dict[str, float]()
        for name, whole in zip(("x", "y", "width", "height"), 2 * self._user_size, strict=True):
            text = attributes.get(name, "0")
            side = numbers(text.removesuffix("%"), name, 1)[0]
            sides[name] = side * whole / 100 if text.endswith("%") else side
        return sides

    def _covers(self, sides: Mapping[str, float], onto: Affine) -> bool:
        """Return whether a rectangle covers the canvas.

        Minimal markup rounds the sides of the canvas. So the rectangle may leave a strip uncovered
        at each side of the canvas. The strip may be 0.01 px or 0.05 user units wide, whichever is
        more.
        """
        x, y, across, down = sides.values()
        a, b, c, d, left, top = onto @ Affine(across, 0.0, 0.0, down, x, y)
        width, height = self._size
        missed = max(left, top, width - left - a, height - top - d)
        return missed <= max(0.01, 0.05 * abs(onto.a), 0.05 * abs(onto.d)) and not (b or c)

    def _is_page(self, clip: str, onto: Affine) -> bool:
        """Return whether a clip-path shows the whole canvas, as in files of Figma."""
        owner = self._by_id.get(reference_of(clip) or "")
        if owner is None or owner.tag != SVG + "clipPath" or len(owner) != 1:
            return False
        own = owner[0].attrib
        is_plain = owner[0].tag == SVG + "rect" and "clipPathUnits" not in owner.attrib
        is_plain &= own.keys() <= {"x", "y", "width", "height", "fill", "transform", "id"}
        onto @= Affine.of_text(own.get("transform", ""))
        return is_plain and self._covers(self._sides(own), onto)

    def scene(self) -> Scene:
        """Return the scene of all shapes. Raise InputError if a scene cannot hold one of them."""
        shapes, areas = self._shapes, tuple(self._areas)
        a, b, c, d, x, y = np.array([shape.disc for shape in shapes]).reshape(-1, 6).T
        sx, sy = portable.hypot(a, c), portable.hypot(b, d)
        rho = np.clip(a / sx * (b / sy) + c / sx * (d / sy), -RHO_LIMIT, RHO_LIMIT)
        level = np.array([shape.level for shape in shapes], np.int32)
        fills = np.array([(shape.fill.beta, shape.fill.radius) for shape in shapes])
        beta, radius = fills.reshape(-1, 2).T
        plain = beta == 0
        beta[plain] = BETA_CLASSES[-1]
        radius[plain] = covered_radius(beta[plain])
        try:
            return Scene(
                *self._size,
                mean=np.stack([x, y], axis=1),
                sigma=np.stack([sx, sy], axis=1) / radius[:, None],
                rho=rho,
                color=np.array([shape.fill.color for shape in shapes]).reshape(-1, 3),
                opacity=np.array([shape.opacity for shape in shapes]),
                background=self._background,
                round_index=np.array([shape.round for shape in shapes], np.int32),
                beta=beta,
                drawn=np.array([shape.fill.drawn for shape in shapes], np.int8),
                transparent=self._background is None,
                areas=areas,
                level=np.where(level == len(areas), ABOVE, level),
            )
        except SceneError as error:
            raise InputError(f"the SVG must be one of write_svg; {error}") from error


def _rules_of(sheet: Any) -> Iterator[tuple[tuple[str, int], dict[str, str]]]:
    """Yield the properties that a style sheet gives to stops.

    The key of a stop is the id to which its gradient refers, and its index in the gradient. Raise
    InputError if the sheet has a rule that write_svg does not write.
    """
    # The opacities of stops, fragments and animations, once the blanks are removed.
    rule = (
        r'\[href="#([A-Za-z]+)"\]stop(?:\{stop-color:currentColor;|((?:\+stop)+)\{)'
        rf"stop-opacity:({NUMBER});?\}}|svg>g:target~g\{{display:none;?\}}"
        r"|@media\(prefers-reduced-motion:no-preference\)\{@keyframesfade-in\{from\{opacity:0;?\}\}"
        rf"(?:#round-\d+\{{animation:fade-in{NUMBER}s{NUMBER}sbackwards;?\}})*\}}"
    )
    text = re.sub(r"\s+|/\*.*?(?:\*/|\Z)", "", sheet.text or "", flags=re.DOTALL)
    if len(sheet) or re.sub(rule, "", text):
        needed = "one that write_svg writes for a scene whose blend is 'over'"
        advice = "to write what it sets into the elements, or the scene of --save-scene"
        raise refusal("the style sheet", needed, quoted((sheet.text or "").strip()), advice)
    for key, others, opacity in re.findall(rule, text):
        if key:
            look = {"stop-color": "currentColor", "stop-opacity": opacity}
            yield (key, others.count("+")), look


def _shows_all(outline: Affine, disc: Affine) -> bool:
    """Return whether an ellipse that has an extent shows all of its gradient.

    outline, disc  maps of the unit circle onto the ellipse, and onto the edge of the gradient

    The gradient may reach beyond the ellipse by 0.05 px, because editors round numbers.
    """
    a, b, c, d, x, y = outline
    size, area = outline.reach, abs(outline.determinant)
    # The adjugate matrix maps the ellipse onto a circle of the radius `area`.
    inner = Affine(d, -b, -c, a) @ disc._replace(e=disc.e - x, f=disc.f - y)
    beyond = inner.reach + length(complex(inner.e, inner.f)) - area
    return disc.determinant != 0 < area and beyond <= 0.05 * size


def _canvas(root: Mapping[str, str]) -> tuple[tuple[float, ...], tuple[float, ...], Affine]:
    """Return the size of the canvas in px and in user units, and the map from user units to px.

    The viewBox fills the canvas. The attribute data-canvas of the root states the size of the
    canvas in px. If the root does not have this attribute, the canvas has the size of the root.
    """
    frame = file.frame_of(root)
    width, height = numbers(root[CANVAS], CANVAS, 2) if CANVAS in root else frame[:2]
    x, y, across, down = frame.view_box
    scale_x, scale_y = width / across, height / down
    # The scales along x and y may differ a little, because minimal markup rounds the sides of its
    # viewBox.
    if not abs(scale_x - scale_y) <= (1e-3 + 0.05 / min(across, down)) * scale_y:
        needed = f"of the proportions of the viewBox, {across:g}x{down:g}"
        advice = f"to write its size in px into {CANVAS}, or to remove that"
        raise refusal("the canvas", needed, f"{width:g}x{height:g} px", advice)
    onto = Affine(scale_x, 0.0, 0.0, scale_y, -scale_x * x, -scale_y * y)
    return (width, height), (across, down), onto


def _inherited(attributes: dict[str, str], parent: _State, tag: str) -> _State:
    """Return the state in which an element and its children are drawn.

    This is the state of its parent, changed by the attributes of the element. Raise InputError if
    the element has an effect that a scene cannot represent.
    """
    changes: dict[str, Any] = {}
    off = {"none", "normal", "inherit", "visible"}
    for name, value in attributes.items():
        if name in _INHERITED and (name, value) != ("color", "currentColor") and value != "inherit":
            changes["style"] = {**changes.get("style", parent.style), name: value}
        elif name == "transform":
            changes["onto"] = parent.onto @ Affine.of_text(value)
        elif name == "opacity":
            changes["opacity"] = parent.opacity * share_of(value, "opacity")
            if tag in ("svg", "g") and changes["opacity"] < 1:
                # A scene composites each shape by itself, so a group cannot have an opacity.
                advice = "to set that of each shape"
                raise refusal("opacity of a group", "1", quoted(value), advice)
        elif name in _EFFECTS and value.lower() not in off:
            if name in ("filter", "mask") and tag in ("circle", "ellipse", "path"):
                continue  # `_add` reads these
            raise refusal(f"its {name}", "none", quoted(value), "to remove it")
    return parent._replace(**changes) if changes else parent


def _round_of(group: Any) -> int | None:
    """Return the number of the round that a group contains, counted from 0.

    The number is read from the label of the group. If the label has none, it is read from the id.
    Return None if neither has a number.
    """
    label = re.match(r"Round ([1-9]\d{0,8})\b", group.get(INKSCAPE + "label", ""))
    own_id = r"(?:below-area-\d+-)?round-([1-9]\d{0,8})"
    match = label or re.fullmatch(own_id, group.get("id", ""))
    return int(match[1]) - 1 if match else None


@contextmanager
def _naming(element: Any) -> Iterator[None]:
    """Put the name of the element before the message of an error that the block raises."""
    try:
        yield
    except (InputError, SceneError) as error:
        raise InputError(f"{_name(element)}: {error}") from None


def _name(element: Any) -> str:
    """Return the tag of an element with its id and label, for error messages.

    If the element has neither an id nor a label, return the tag with its first three attributes.
    """
    own = element.attrib
    names = [name for name in ("id", INKSCAPE + "label") if name in own] or list(own)[:3]
    shown = [f'{name.rpartition("}")[2]}="{own[name]}"' for name in names]
    words = " ".join(" ".join(shown).split())[:120]
    return f"<{element.tag.rpartition('}')[2][:40]} {words}>".replace(" >", ">")
