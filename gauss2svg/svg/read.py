"""Read scenes from SVG files that write_svg wrote, even if an editor has saved them since.

Additive files are refused. Editable files have groups of circles. Minimal files have <use>
elements that refer to masked circles, circles with gradients whose opacities are in a style sheet,
and paths of arcs. Other paths are areas and lines. The same code reads both kinds of file, because
it decides for each element how to read it.

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
from array import array
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gauss2svg.errors import InputError, SceneError, brief, quoted, refusal
from gauss2svg.scene import ABOVE, BLURRED, PLAIN, RHO_LIMIT, SOFT, Area
from gauss2svg.scene.falloff import covered_radius, cut_radius
from gauss2svg.svg import CANVAS, read_areas, read_shapes
from gauss2svg.svg.file import (
    INKSCAPE,
    MOST_BYTES,
    NUMBER,
    SVG,
    Scene,
    frame_of,
    from_root,
    numbers,
    parse,
    read_source,
)
from gauss2svg.svg.forms import plain_beta
from gauss2svg.svg.read_shapes import Affine, Fill, color_of, compose, share_of, styled, target_of

# The default limit on the number of elements in a file. The tree of a file with this many elements
# takes about 3 GB of memory.
MOST_ELEMENTS = 4_000_000
_DEEPEST = 100  # largest depth of nested groups
# A gradient may refer to another gradient, which may refer to a third one, and so on. This is the
# largest number of gradients in such a chain. In files of Inkscape there are two.
_LONGEST_CHAIN = 9
_LABEL = INKSCAPE + "label"
_ROUND_LABEL = re.compile(r"Round ([1-9]\d{0,8})\b")
_ROUND_ID = re.compile(r"(?:below-area-\d+-)?round-([1-9]\d{0,8})")
_GROUPS = {"svg", "g", "use"}
_DRAWN = {*_GROUPS, "circle", "ellipse", "path", "rect"}
# Elements that draw nothing themselves.
_GRADIENTS = "linearGradient", "radialGradient"
_SILENT = {"title", "desc", "metadata", "defs", *_GRADIENTS, "filter", "mask", "style"}
# Attributes and properties that change how a shape looks. An element with one of them is refused,
# unless its value is in _OFF, or the pair of the element's tag and the attribute is in _READ.
_EFFECTS = {
    "vector-effect",
    "filter",
    "mask",
    "clip-path",
    "mix-blend-mode",
    "visibility",
    "animation",
}
_EFFECTS |= {"translate", "rotate", "scale", "transform-origin", "transform-box", "offset-path"}
_EFFECTS |= {"zoom", "systemLanguage", "all", "vector-effect"}
_EFFECTS |= {"marker", "marker-start", "marker-mid", "marker-end"}
_READ = {("circle", "mask"), *((tag, "filter") for tag in ("circle", "ellipse", "path"))}
_OFF = {"none", "normal", "inherit", "visible"}
# Attributes of an inner <svg> that clips the picture. With these values it covers the view box.
_INNER = {"x": "0", "y": "0", "width": "100%", "height": "100%", "viewBox": "none"}
# Matches the path that is the background in minimal markup.
_COVER = re.compile(r"M0 0h(?P<width>\d+)v(?P<height>\d+)H0")
# Once the blanks of a style sheet are removed, this matches each rule that write_svg writes into
# it. Only the rules for stops are read.
_RULE = re.compile(
    rf'\[href="#([A-Za-z]+)"\]stop(?:\+stop)*+\{{(?:stop-color:currentColor;)?'
    rf"stop-opacity:({NUMBER})\}}|svg>g:target~g\{{display:none;?\}}"
    r"|@media\(prefers-reduced-motion:no-preference\)\{@keyframesfade-in\{from\{opacity:0;?\}\}"
    rf"(?:#round-\d+\{{animation:fade-in{NUMBER}s{NUMBER}sbackwards;?\}})*+\}}"
)


def read_svg(
    source: str | bytes | os.PathLike[str],
    *,
    background: ArrayLike | None = None,
    skip_hidden: bool = False,
    max_bytes: int = MOST_BYTES,
    max_elements: int = MOST_ELEMENTS,
) -> Scene:
    """Return the scene of an SVG that write_svg wrote, even if Inkscape has edited and saved it.

    The covariance of a shape is (M / R)(M / R)^T. M is the linear part of all transforms down to
    the unit circle of its gradient, and R = cut_radius(beta). The exponent of a shape is the one of
    BETA_CLASSES to which the stops of its gradient belong. A plain ellipse gets the exponent of the
    profile that it draws best (forms.plain_beta). Numbers are as exact as in the file.

    The round of a shape comes from the label or the id of its group ("Round 3: ..", "round-3"). It
    is at least the round of the shapes below it. If a group at the top level has no such label or
    id, the group is a round of its own. A minimal file has one round. If a minimal file has no
    size, the scene is in user units.

    source       a path (.svg or .svgz), a text, or bytes
    background   sRGB colour in 0..1 that the scene gets if the file has no background. If it is
                 None, the scene of such a file is transparent
    skip_hidden  skip hidden shapes and layers instead of refusing the file
    max_bytes, max_elements  limits of the gunzipped file. Raise them for a file that you trust

    Raise InputError if the file has anything that write_svg does not write. The message names the
    element. Such things are additive files, texts, images, paths with arcs, masks, clips and style
    sheets, and a group with an opacity (docs/reference/svg.md).
    """
    text = from_root(read_source(source, max_bytes, "source", "max_bytes")[1])
    if text.count("<") - text.count("</") > max_elements:
        needed = f"of at most {max_elements} elements"
        raise refusal("the SVG", needed, "more", "a larger max_elements if you trust it")
    return _Reader(parse(text), background, skip_hidden).scene()


class _State(NamedTuple):
    """The state that an element inherits from its ancestors.

    onto    map from the user space of the element to px
    style   attributes of read_areas.INHERITED
    in_svg  whether the parent is an <svg>: the root, or the inner one that clips the picture
    """

    onto: Affine
    style: Mapping[str, str] = MappingProxyType({})
    fill: str = "black"
    fill_opacity: str = "1"
    opacity: float = 1.0
    round: int = 0
    depth: int = 0
    in_svg: bool = False


class _Shape(NamedTuple):
    """A shape without its two maps of the unit circle.

    The maps of all shapes are in one array, because that takes only a third of the memory.
    """

    element: Any
    fill: Fill
    opacity: float
    round: int
    level: int


class _Reader:
    """Reads one document: visits the elements and collects their shapes."""

    def __init__(self, root: Any, background: ArrayLike | None, skip_hidden: bool) -> None:
        self._skip_hidden = skip_hidden
        self._by_id = {e.get("id"): e for e in root.iter() if e.get("id")}
        # The opacities of the stops in the style sheet. The keys are ids of gradients.
        self._opacities = defaultdict[str, list[str]](list)
        self._gradient = cache(self._read_gradient)
        self._arcs = read_shapes.open_arcs(path.get("d", "") for path in root.iter(SVG + "path"))
        self._areas: list[Area] = []
        self._shapes: list[_Shape] = []
        # There are two maps for each shape. The first maps the unit circle onto the outline of the
        # shape in px, and the second maps it onto the edge of the shape's fill.
        self._maps = array("d")
        self._background = None if background is None else np.asarray(background, np.float64)
        for sheet in root.iter(SVG + "style"):
            with _naming(sheet):
                self._read_sheet(sheet)
        with _naming(root):
            if root.tag != SVG + "svg":
                raise refusal("the root", "an <svg> in the namespace of SVG", root.tag[:80])
            self._size, self._user_size, self._onto = _canvas(root.attrib)
        self._visit(root, _State(self._onto))

    def _read_sheet(self, sheet: Any) -> None:
        """Store the opacities that a style sheet gives to stops.

        Raise InputError if the sheet has rules that write_svg does not write.
        """
        text = re.sub(r"\s+|/\*.*?(?:\*/|\Z)", "", sheet.text or "", flags=re.DOTALL)
        if len(sheet) or _RULE.sub("", text):
            needed = "one that write_svg writes for a scene whose blend is 'over'"
            advice = "to write what it sets into the elements, or the scene of --save-scene"
            raise refusal("the style sheet", needed, quoted((sheet.text or "").strip()), advice)
        for key, opacity in _RULE.findall(text):
            if key:
                self._opacities[key].append(opacity)

    def _visit(self, element: Any, parent: _State) -> None:
        """Add the shapes of an element and of its children."""
        space, _, tag = element.tag.rpartition("}")
        if space + "}" != SVG or tag in _SILENT:
            return  # an element of another namespace or with a tag in _SILENT draws nothing
        with _naming(element):
            if tag not in _DRAWN or parent.depth > _DEEPEST:
                needed = f"ellipses alone, in groups of at most {_DEEPEST}"
                advice = "to delete it, or to vectorise it with the photo"
                raise refusal("elements", needed, brief(tag), advice)
            attributes = styled(element)
            state = _inherited(attributes, parent, tag)
            if attributes.get("display", "").lower() == "none":
                if self._skip_hidden and parent.depth:
                    return
                advice = "to show it, to delete it, or read_svg(.., skip_hidden=True)"
                raise refusal("shapes", "visible", "a hidden one", advice)
            if tag not in _GROUPS:
                self._add(element, tag, attributes, state)
                # A shape cannot have children that are shapes. Because of this depth, `_visit`
                # refuses each child that would draw something.
                state = state._replace(depth=_DEEPEST)
            children = list(element)
            if tag == "use":
                x, y = (numbers(attributes.get(name, "0"), name, 1)[0] for name in ("x", "y"))
                state = state._replace(onto=compose(state.onto, (1.0, 0.0, 0.0, 1.0, x, y)))
                children = [target_of(self._by_id, read_shapes.link_of(element), "circle", "use")]
            elif tag in ("svg", "g"):
                for name, whole in _INNER.items() if tag == "svg" and parent.depth else ():
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

    def _add(self, element: Any, tag: str, attributes: dict[str, str], state: _State) -> None:
        """Add the shape of an element. A path of minimal markup may have several shapes."""
        alpha = state.opacity * share_of(state.fill_opacity, "fill-opacity")
        data = attributes.get("d", "") if tag == "path" else ""
        cover, arcs = _COVER.fullmatch(data), self._arcs.get(data)
        if tag == "path" and not (cover or arcs or read_shapes.is_ellipse(data)):
            return self._add_area(data, attributes, state)
        if (stroke := state.style.get("stroke", "none")).lower() != "none":
            raise refusal("its stroke", "none", quoted(stroke), "to remove it")
        if cover or tag == "rect":
            return self._cover(cover.groupdict() if cover else attributes, state, alpha)
        number = max(self._shapes[-1].round if self._shapes else 0, state.round)
        for edge in arcs or [read_shapes.outline_of(tag, attributes)]:
            fill = self._fill_of(state.fill, attributes, edge)
            if len(arcs or ()) > 1 and (alpha < 1 or fill.drawn != PLAIN):
                raise refusal("ellipses of one path", "opaque and of one colour", "another fill")
            outline, opacity = compose(state.onto, edge), min(1.0, alpha * fill.peak)
            disc = compose(state.onto, fill.disc) if fill.disc else outline
            self._maps.extend((*outline, *disc))
            self._shapes.append(_Shape(element, fill, opacity, number, len(self._areas)))
        return None

    def _add_area(self, data: str, attributes: Mapping[str, str], state: _State) -> None:
        """Add an area or a line."""
        style, stroke = state.style, state.style.get("stroke", "none")
        is_line, width, cap = stroke.lower() != "none", 0.0, "butt"
        blur, rule = attributes.get("filter", "none"), style.get("fill-rule", "nonzero")
        if blur != "none":
            raise refusal("its filter", "none", quoted(blur), "to remove it")
        if is_line and state.fill.lower() != "none":
            raise refusal("its fill", "none, because it has a stroke", quoted(state.fill))
        if not is_line and rule != "nonzero":
            raise refusal("its fill-rule", "nonzero", quoted(rule), "to split the path")
        alpha, text = (state.fill_opacity, state.fill)
        if is_line:
            alpha, text = style.get("stroke-opacity", "1"), stroke
            width, cap = read_areas.stroke_of(style, state.onto, self._onto)
        if (key := read_shapes.reference_of(text)) is None:
            paint = color_of(text, "stroke" if is_line else "fill")
        else:
            first, owner, values = self._chain(key, *_GRADIENTS)
            tag = first.tag.removeprefix(SVG)
            paint = read_areas.gradient_of(tag, values, owner, state.onto)
        outlines = read_areas.outlines_of(data, state.onto, not is_line)
        opacity = state.opacity * share_of(alpha, "opacity")
        self._areas.append(Area(outlines, paint, opacity, width, cap))

    def _fill_of(self, fill: str, attributes: Mapping[str, str], edge: Affine) -> Fill:
        """Return the fill of a shape. Raise InputError if write_svg does not write such a fill."""
        texts = fill, attributes.get("filter", ""), attributes.get("mask", "")
        gradient_id, blur_id, mask_id = map(read_shapes.reference_of, texts)
        if gradient_id is not None and blur_id is None and mask_id is None:
            return self._gradient(gradient_id, False)
        color = color_of(fill, "fill")
        if mask_id is not None:
            inside = read_shapes.gradient_id(target_of(self._by_id, mask_id, "mask"), edge)
            return self._gradient(inside, True)._replace(color=color)
        if blur_id is None:
            return Fill(color)
        blur = read_shapes.blur_of(target_of(self._by_id, blur_id, "filter"), edge)
        # write_svg multiplies the opacity of a shape by blur.peak to get the fill-opacity of its
        # blurred disc. 1 / blur.peak undoes this.
        return Fill(color, BLURRED, 1 / blur.peak, blur.beta, blur.radius)

    def _chain(self, key: str, *tags: str) -> tuple[Any, Any, dict[str, str]]:
        """Return the gradient with an id, the gradient that has its stops, and its attributes.

        The attributes include those of the gradients to which it refers.
        """
        chain, name = list[Any](), key
        while name and len(chain) < _LONGEST_CHAIN:
            chain.append(target_of(self._by_id, name, *tags))
            name = read_shapes.link_of(chain[-1])
        values = {name: value for e in reversed(chain) for name, value in e.attrib.items()}
        return chain[0], next((e for e in chain if len(e)), chain[-1]), values

    def _read_gradient(self, key: str, in_mask: bool) -> Fill:
        _, owner, values = self._chain(key, "radialGradient")
        sheet = self._opacities[read_shapes.link_of(owner)]
        color, beta = read_shapes.stops_of(owner, sheet, in_mask)
        return Fill(color, SOFT, 1.0, beta, float(cut_radius(beta)), read_shapes.disc_of(values))

    def _cover(self, sides: Mapping[str, str], state: _State, alpha: float) -> None:
        """Store the fill of a rectangle as the background.

        Raise InputError unless the rectangle is opaque, upright and below all shapes, and covers
        the canvas. Minimal markup rounds the sides of the canvas. So the rectangle may leave a
        strip uncovered at each side of the canvas. The strip may be 0.01 px or 0.05 user units
        wide, whichever is more.
        """
        whole = dict(zip(("x", "y", "width", "height"), 2 * self._user_size, strict=True))
        x, y, across, down = (_side(sides.get(name, "0"), name, whole[name]) for name in whole)
        a, b, c, d, left, top = compose(state.onto, (across, 0.0, 0.0, down, x, y))
        right, bottom, (width, height) = left + a, top + d, self._size
        missed = max(left, top, width - right, height - bottom)
        # The strip that may stay uncovered at a side has at most this width, in px.
        most = max(0.01, 0.05 * abs(state.onto[0]), 0.05 * abs(state.onto[3]))
        is_whole = missed <= most and not (b or c or {"rx", "ry"} & sides.keys())
        if self._shapes or self._areas or not is_whole or (alpha < 1 and state.fill != "none"):
            needed = f"the background, over all {width:g}x{height:g} px, upright and opaque"
            count = len(self._shapes) + len(self._areas)
            got = f"x {left:g}..{right:g}, y {top:g}..{bottom:g} px over {count} shapes"
            advice = "to resize or to delete it"
            raise refusal("a rectangle", needed, f"{got}, of opacity {alpha:g}", advice)
        if state.fill != "none":
            self._background = np.array(color_of(state.fill, "fill"))

    def scene(self) -> Scene:
        """Return the scene of all shapes. Raise InputError if a scene cannot hold one of them."""
        shapes = self._shapes
        maps = np.array(self._maps).reshape(-1, 2, 3, 2)
        edge, disc = maps.transpose(1, 0, 3, 2)
        rows = disc[:, :, :2]  # the linear parts (n, 2, 2) of the maps
        with np.errstate(all="ignore"):
            extent = np.hypot(rows[:, :, 0], rows[:, :, 1])
            unit = rows / extent[:, :, None]
            rho = np.clip((unit[:, 0] * unit[:, 1]).sum(axis=1), -RHO_LIMIT, RHO_LIMIT)
            good = np.isfinite(rho) & (np.linalg.det(maps[:, :, :2]) != 0).all(axis=1)
            good &= read_shapes.beyond_px(edge, disc) <= read_shapes.MOST_BEYOND_PX
        if not good.all():
            with _naming(shapes[int(good.argmin())].element):
                needed = "an ellipse with an extent that shows all of its gradient"
                raise refusal("it", needed, "another", "to undo what changed it, or to delete it")
        level = np.array([shape.level for shape in shapes], np.int32)
        level[level == len(self._areas)] = ABOVE
        fills = np.array([(shape.fill.beta, shape.fill.radius) for shape in shapes])
        beta, radius = fills.reshape(-1, 2).T
        plain = beta == 0
        beta[plain] = plain_beta(np.linalg.svd(rows[plain], compute_uv=False))
        radius[plain] = covered_radius(beta[plain])
        try:
            return Scene(
                *self._size,
                mean=disc[:, :, 2],
                sigma=extent / radius[:, None],
                rho=rho,
                color=np.array([shape.fill.color for shape in shapes]).reshape(-1, 3),
                opacity=np.array([shape.opacity for shape in shapes]),
                background=np.ones(3) if self._background is None else self._background,
                round_index=np.array([shape.round for shape in shapes], np.int32),
                beta=beta,
                drawn=np.array([shape.fill.drawn for shape in shapes], np.int8),
                transparent=self._background is None,
                areas=tuple(self._areas),
                level=level,
            )
        except SceneError as error:
            raise InputError(f"the SVG must be one of write_svg; {error}") from error


def _canvas(root: Mapping[str, str]) -> tuple[tuple[float, ...], tuple[float, ...], Affine]:
    """Return the size of the canvas in px and in user units, and the map from user units to px.

    The viewBox fills the canvas. The attribute data-canvas of the root states the size of the
    canvas in px. If the root does not have this attribute, the canvas has the size of the root.
    """
    frame = frame_of(root)
    width, height = numbers(root[CANVAS], CANVAS, 2) if CANVAS in root else frame[:2]
    x, y, across, down = frame.view_box
    scale_x, scale_y = width / across, height / down
    # The scales along x and y may differ a little, because minimal markup rounds the sides of its
    # viewBox.
    if not abs(scale_x - scale_y) <= (1e-3 + 0.05 / min(across, down)) * scale_y:
        needed = f"of the proportions of the viewBox, {across:g}x{down:g}"
        advice = f"to write its size in px into {CANVAS}, or to remove that"
        raise refusal("the canvas", needed, f"{width:g}x{height:g} px", advice)
    return (width, height), (across, down), (scale_x, 0.0, 0.0, scale_y, -scale_x * x, -scale_y * y)


def _inherited(attributes: dict[str, str], parent: _State, tag: str) -> _State:
    """Return the state in which an element and its children are drawn.

    This is the state of its parent, changed by the attributes of the element. Raise InputError if
    the element has an effect that a scene cannot represent.
    """
    changes: dict[str, Any] = {}
    for name, value in attributes.items():
        if name in ("fill", "fill-opacity") and value != "inherit":
            changes[name.replace("-", "_")] = value
        elif name in read_areas.INHERITED and value != "inherit":
            changes["style"] = {**changes.get("style", parent.style), name: value}
        elif name == "transform":
            changes["onto"] = compose(parent.onto, read_shapes.transform_of(value))
        elif name == "opacity":
            changes["opacity"] = parent.opacity * share_of(value, "opacity")
            if tag in ("svg", "g") and changes["opacity"] < 1:
                # A scene composites each shape by itself, so a group cannot have an opacity.
                advice = "to set that of each shape"
                raise refusal("opacity of a group", "1", quoted(value), advice)
        elif name in _EFFECTS and (tag, name) not in _READ and value.lower() not in _OFF:
            raise refusal(f"its {name}", "none", quoted(value), "to remove it")
    return parent._replace(**changes) if changes else parent


def _side(text: str, name: str, whole: float) -> float:
    """Return the number in a text. If the text is a percentage, return that share of `whole`."""
    scale = whole / 100 if text.endswith("%") else 1.0
    return scale * numbers(text.removesuffix("%"), name, 1)[0]


def _round_of(group: Any) -> int | None:
    """Return the number of the round that a group contains, counted from 0.

    The number is read from the label of the group. If the label has none, it is read from the id.
    Return None if neither has a number.
    """
    label = _ROUND_LABEL.match(group.get(_LABEL, ""))
    match = label or _ROUND_ID.fullmatch(group.get("id", ""))
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
    named = [(key, element.get(key)) for key in ("id", _LABEL) if element.get(key)]
    shown = " ".join(f'{_bare(k)}="{v}"' for k, v in named or list(element.attrib.items())[:3])
    return f"<{_bare(element.tag)[:40]} {' '.join(shown.split())[:120]}>".replace(" >", ">")


def _bare(tag: str) -> str:
    return tag.rpartition("}")[2]
