"""Scenes read back from SVG files of write_svg, also after an editor; additive ones are refused.

Editable files are groups of circles. Minimal ones are uses of masked circles, circles whose stops
have their opacities in a style sheet, and paths of arcs. One walk reads them all, by what their
elements are.

What Inkscape 1.2 changes when it saves a file (tests/data has one, before and after):

- opening and saving alone adds ids and a namedview; the numbers stay as they were;
- a shape that is moved, rotated or scaled by itself becomes an ellipse whose transform has unit
  columns, with cx, cy, rx, ry on 8 digits; its gradient is moved along by a gradientTransform,
  under a new id that refers to the old one for its stops where others use that too;
- "Object to Path" makes a path of four arcs, also in later transforms;
- a moved group or layer gets a transform, its children none; ungrouping hands it down to them;
- colours, opacities and display go into style=, which wins over the attributes;
- resizing the page changes width, height and viewBox and moves layers and background;
- as plain SVG it drops labels and layers, and keeps ids.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg.errors import InputError, brief, quoted
from gauss2svg.scene import LEAST_SIGMA, MOST_MEAN, MOST_SIGMA, RHO_LIMIT
from gauss2svg.svg.file import Scene
from gauss2svg.svg.minimal_shapes import arc_beta
from gauss2svg.svg.plain_ellipse import plain_beta, plain_radius
from gauss2svg.svg.reader.canvas import misplaced, read_canvas
from gauss2svg.svg.reader.gradient import (
    Gradients,
    check_animation,
    check_sheet,
    check_smil,
    stop_opacities,
)
from gauss2svg.svg.reader.shape import SHAPES, Shape, open_arcs, outline, read_shape
from gauss2svg.svg.syntax.parse import ANIMATIONS, HREFS, INKSCAPE, SVG
from gauss2svg.svg.syntax.source import MOST_BYTES, MOST_ELEMENTS, parse_document
from gauss2svg.svg.syntax.values import (
    Affine,
    color,
    compose,
    length,
    parse_transform,
    properties,
    reference,
    share,
)

_LABEL = INKSCAPE + "label"
_ROUND_LABEL, _ROUND_ID = re.compile(r"Round (\d{1,9})\b"), re.compile(r"round-(\d{1,9})")
# Elements that draw nothing themselves; check_smil makes sure that animation ends as written.
_SILENT = {"title", "desc", "metadata", "defs", "linearGradient", "radialGradient", "filter"}
_SILENT |= {"mask", "style", *ANIMATIONS}  # the last two are checked before anything else
_EVERYWHERE = {SVG + tag for tag in (*ANIMATIONS, "style")}
_INHERITED = {"fill": "fill", "fill-opacity": "fill_opacity", "visibility": "visibility"}
_ADVICE = {
    "use": ", or to unlink the clone",
    "a": ", or to ungroup the link",
    "text": ", or to draw it as part of the photo",
    "image": ", or to vectorise it with the photo",
}
# Properties that are not read, and the value under which they have no effect.
_EFFECTS = {"stroke": "none", "mask": "none", "clip-path": "none", "mix-blend-mode": "normal"}
# Attributes and properties that move, hide or change a shape; files with them are refused.
_UNREAD = ("transform-origin", "transform-box", "translate", "rotate", "scale", "offset-path")
_UNREAD += ("zoom", "all", "systemLanguage")
_COVER = re.compile(r"M0 0h(\d+)v(\d+)H0")  # the background of gauss2svg.svg.minimal
_DEEPEST = 100
_MOST_USES = 3  # of one another: minimal markup writes two


def read_svg(
    source: str | bytes | os.PathLike[str],
    *,
    background: ArrayLike | None = None,
    skip_hidden: bool = False,
    max_bytes: int = MOST_BYTES,
    max_elements: int = MOST_ELEMENTS,
) -> Scene:
    """The scene of an SVG that write_svg wrote, also after Inkscape edited and saved it.

    A shape's covariance is (M / R)(M / R)^T, M being the linear part of all transforms down to
    the unit circle of its gradient and R = cut_radius(beta); its exponent is the one of
    BETA_CLASSES that has such stops. A plain ellipse gets the exponent that it draws best
    (gauss2svg.svg.plain_ellipse.plain_beta). Rounds come from the labels and ids of groups ("Round
    3: ..", "round-3"), never decreasing: a round under an earlier one is counted as that one, a
    group at the top level without either as a round of its own. Numbers are as exact as the file.

    source       a path (.svg, .svgz), text, or bytes
    background   sRGB colour in 0..1 for a file without a background, which is a transparent scene
                 if it is not given, or with a translucent one
    skip_hidden  skip hidden shapes and layers instead of refusing the file
    max_bytes, max_elements  limits of the gunzipped file; raise them for a file that you trust

    A minimal file has one round, and a scene in its own units where it has no size in px.

    Animation and the rule for fragments are skipped. Raises InputError with the element's name for
    everything else: additive files, texts, images, other paths, strokes, other masks, clips,
    several shapes under one group opacity.
    """
    root = parse_document(source, max_bytes, max_elements)
    if root.tag != SVG + "svg":
        raise InputError(
            f"the document must be an <svg> in the namespace of SVG; got <{_bare(root.tag)[:40]}>"
        )
    reader = _Reader(root, background, skip_hidden, max_elements)
    reader.walk_root()
    return reader.scene()


@dataclass(frozen=True, slots=True)
class _State:
    """State that an element inherits from its ancestors."""

    onto: Affine
    fill: str = "black"
    fill_opacity: str = "1"
    visibility: str = "visible"
    opacity: float = 1.0
    round: int = 0
    depth: int = 0
    uses: int = 0


class _Reader:
    def __init__(
        self, root: Any, background: ArrayLike | None, skip_hidden: bool, most_shapes: int
    ) -> None:
        self._root, self._skip_hidden, self._most_shapes = root, skip_hidden, most_shapes
        self._by_id: dict[str, Any] = {}
        opacities: dict[str, list[str]] = {}
        for element in root.iter():
            key = element.get("id")
            if key is not None:
                self._by_id.setdefault(key, element)
            if isinstance(element.tag, str) and element.tag in _EVERYWHERE:
                with _naming(element):
                    _read_rules(element, opacities)
        self._gradients = Gradients(self._by_id, opacities)
        with _naming(root):
            self._width, self._height, onto, self._user_size = read_canvas(root.attrib)
        self._state = _State(onto)
        self._background = None if background is None else np.asarray(background, np.float64)
        self._shapes: list[tuple[Shape, float, int]] = []
        self._arcs: list[bool] = []  # whether a plain ellipse is one of a path of arcs
        self._backgrounds = 0
        self._elements: list[Any] = []

    def walk_root(self) -> None:
        with _naming(self._root):
            state, attributes = self._inherit(self._root.attrib, self._state)
            if _is_undisplayed(attributes):
                raise InputError("the drawing must be visible; got display none. Try to show it")
        self._group(self._root, attributes, state)

    def _visit(self, element: Any, parent: _State) -> None:
        tag = element.tag
        if not isinstance(tag, str) or not tag.startswith(SVG):
            return  # comments and editors' own elements, which no renderer draws
        tag = tag[len(SVG) :]
        if tag in _SILENT:
            return
        with _naming(element):
            if tag not in SHAPES and tag not in ("g", "rect", "use"):
                raise InputError(
                    f"elements must be ellipses alone; got {brief(tag)}. Try to delete it"
                    f"{_ADVICE.get(tag, '')}"
                )
            state, attributes = self._inherit(element.attrib, parent, may_mask=tag == "circle")
            hidden = tag not in ("g", "use") and state.visibility != "visible"
            if hidden or _is_undisplayed(attributes):
                if self._skip_hidden:
                    return
                raise InputError(
                    "shapes must be visible; got a hidden one. Try to show it, to delete it, or "
                    "read_svg(.., skip_hidden=True), which leaves it out"
                )
            inside = state
            if tag == "rect":
                self._rectangle(attributes, state)
            elif tag == "path" and (cover := _COVER.fullmatch(attributes.get("d", ""))):
                sides = {"width": cover[1], "height": cover[2]}
                self._rectangle({**attributes, "x": "0", "y": "0", **sides}, state, is_path=True)
            elif tag == "use":
                element, inside = self._used(attributes, state)
            elif tag != "g":
                self._ellipses(element, tag, attributes, state)
        if tag == "g":
            self._group(element, attributes, state)
        elif tag == "use":
            self._visit(element, inside)

    def _used(self, attributes: dict[str, str], state: _State) -> tuple[Any, _State]:
        """The circle that a use of minimal markup draws, or another use, and its state."""
        key = next((attributes[h] for h in HREFS if h in attributes), "")
        target = self._by_id.get(key.removeprefix("#"))
        if target is None or target.tag not in (SVG + "circle", SVG + "use"):
            raise InputError(
                f"its reference must be to a circle; got {quoted(key)}. Try to delete it"
                f"{_ADVICE['use']}"
            )
        if state.uses == _MOST_USES:
            raise InputError(
                f"a circle must be used through at most {_MOST_USES} others; got more. Try to "
                "unlink the clone"
            )
        if attributes.get("filter", "none") != "none":
            raise InputError(
                f"filter of a use must be none; got {quoted(attributes['filter'])}. Try to "
                "remove it"
            )
        x, y = (length(attributes.get(name, "0"), name) for name in ("x", "y"))
        onto = compose(state.onto, (1.0, 0.0, 0.0, 1.0, x, y))
        return target, replace(state, onto=onto, uses=state.uses + 1)

    def _inherit(
        self, own: dict[str, str], parent: _State, may_mask: bool = False
    ) -> tuple[_State, dict[str, str]]:
        """The state under an element, and its attributes overridden by those of its style.

        Raises InputError for effects that a scene cannot hold.
        """
        attributes = own
        if "style" in own:
            style = properties(own["style"])
            if "transform" in style:
                raise InputError("its transform must be an attribute; got a style")
            attributes = {**own, **style}
            for name, value in style.items():
                if "animation" in name:
                    check_animation(name, value, "to remove it")
        for name in _UNREAD:
            if name in attributes:
                raise InputError(
                    f"its {name} must be absent; got {quoted(attributes[name])}. Try to remove it"
                )
        for name, harmless in _EFFECTS.items():
            if name == "mask" and may_mask:
                continue
            if attributes.get(name, harmless).lower() not in (harmless, "inherit"):
                raise InputError(
                    f"its {name} must be {harmless}; got {quoted(attributes[name])}. Try to "
                    "remove it"
                )
        changes: dict[str, Any] = {
            field: attributes[name]
            for name, field in _INHERITED.items()
            if attributes.get(name, "inherit") != "inherit"
        }
        if "transform" in attributes:
            changes["onto"] = compose(parent.onto, parse_transform(attributes["transform"]))
        if "opacity" in attributes:
            changes["opacity"] = parent.opacity * share(attributes["opacity"], "opacity")
        return (replace(parent, **changes) if changes else parent), attributes

    def _group(self, element: Any, attributes: dict[str, str], state: _State) -> None:
        with _naming(element):
            if state.depth > _DEEPEST:
                raise InputError(
                    f"groups must be nested at most {_DEEPEST} deep; got more. Try to ungroup them"
                )
            if attributes.get("filter", "none") != "none":
                raise InputError(
                    f"filter of a group must be none; got {quoted(attributes['filter'])}. Try to "
                    "remove it"
                )
            number = _round_of(element)
            # A group of nothing but a fill is minimal markup's, which has no rounds.
            if number is None and state.depth == 1 and set(element.attrib) != {"fill"}:
                number = self._shapes[-1][2] + 1 if self._shapes else 0
            inside = replace(state, depth=state.depth + 1)
            if number is not None:
                inside = replace(inside, round=number)
        before, beneath = len(self._shapes), self._backgrounds
        for child in element:
            self._visit(child, inside)
        over, beneath = len(self._shapes) - before, self._backgrounds - beneath
        with _naming(element):
            if over + beneath > 1 and share(attributes.get("opacity", "1"), "opacity") < 1:
                shapes = f"{over} shape{'s' * (over != 1)}" + " and the background" * bool(beneath)
                raise InputError(
                    f"opacity of a group of {shapes} must be 1, as shapes are composited one by "
                    f"one; got {quoted(attributes['opacity'])}. Try to set it to 1, or to set "
                    "that of each shape"
                )

    def _rectangle(self, attributes: dict[str, str], state: _State, is_path: bool = False) -> None:
        """Use a rectangle that covers the canvas under all shapes as the background."""
        if self._shapes:
            raise InputError(
                "a rectangle must be the background; got one over shapes. Try to delete it"
            )
        sides = {
            name: length(attributes.get(name, "0"), name, self._user_size[name in ("y", "height")])
            for name in ("x", "y", "width", "height")
        }
        covered = misplaced(sides, state.onto, (self._width, self._height), in_units=is_path)
        round_corners = any(length(attributes.get(name, "0"), name) for name in ("rx", "ry"))
        if covered or round_corners or attributes.get("filter", "none") != "none":
            raise InputError(
                "the background must be upright over all of the canvas, "
                f"{self._width:g}x{self._height:g} px; got "
                f"{brief(covered or 'rounded corners or a filter')}. Try to resize it"
            )
        if state.fill == "none":
            return
        self._backgrounds += 1
        paint = np.array(color(state.fill, "fill"))
        alpha = state.opacity * share(state.fill_opacity, "fill-opacity")
        if alpha < 1 and self._background is None:
            raise InputError(
                f"opacity of the background must be 1; got {quoted(alpha)}. Try to delete it, "
                "or read_svg(.., background=(1, 1, 1)) for what is under it"
            )
        under = 0.0 if self._background is None else self._background
        self._background = alpha * paint + (1 - alpha) * under

    def _ellipses(self, element: Any, tag: str, attributes: dict[str, str], state: _State) -> None:
        """Add the shapes of an element: several where it is a path of minimal markup."""
        blur, mask = (self._referred(attributes, name) for name in ("filter", "mask"))
        if blur is not None and mask is not None:
            raise InputError(
                f"its mask must be none under a filter; got {quoted(attributes['mask'])}"
            )
        arcs = open_arcs(attributes.get("d", "")) if tag == "path" else []
        edges = arcs or [outline(tag, attributes)]
        alpha = state.opacity * share(state.fill_opacity, "fill-opacity")
        if len(edges) > 1 and (alpha < 1 or blur is not None or reference(state.fill) is not None):
            raise InputError(
                "ellipses of one path must be opaque and of one colour; got another fill"
            )
        if len(self._shapes) + len(edges) > self._most_shapes:
            raise InputError(
                f"the SVG must be of at most {self._most_shapes} shapes; got more. Try a "
                "larger max_elements if you trust it"
            )
        last = self._shapes[-1][2] if self._shapes else 0
        for edge in edges:
            shape = read_shape(edge, state.fill, state.onto, self._gradients, blur, mask)
            # A blurred disc may be slightly less opaque than its profile, never more.
            opacity = min(1.0, alpha * shape.peak)
            self._shapes.append((shape, opacity, max(last, state.round)))
            self._arcs.append(bool(arcs) and shape.beta is None)
            self._elements.append(element)

    def _referred(self, attributes: dict[str, str], name: str) -> Any | None:
        """The filter or mask that an element refers to; raises InputError where it is missing."""
        if attributes.get(name, "none").lower() in ("none", "inherit"):
            return None
        found = self._by_id.get(reference(attributes[name]) or "")
        if found is None or found.tag != SVG + name:
            raise InputError(
                f"its {name} must be in the file; got {quoted(attributes[name])}. Try to remove it"
            )
        return found

    def scene(self) -> Scene:
        shapes = [shape for shape, _, _ in self._shapes]
        disc = np.array([shape.disc for shape in shapes]).reshape(-1, 3, 2)
        rows = np.swapaxes(disc[:, :2], 1, 2)  # (n, 2, 2): M
        with np.errstate(all="ignore"):
            extent = np.hypot(rows[:, :, 0], rows[:, :, 1])
            unit = rows / extent[:, :, None]
            rho = np.clip((unit[:, 0] * unit[:, 1]).sum(axis=1), -RHO_LIMIT, RHO_LIMIT)
            drawn = np.isfinite(extent).all(axis=1) & (np.linalg.det(rows) != 0)
        drawn &= np.isfinite(rho) & np.isfinite(disc).all(axis=(1, 2))
        self._refuse(~drawn, "its extent must be above 0 and finite")
        beta = np.array([shape.beta or 0.0 for shape in shapes])
        radius = np.array([shape.radius or 0.0 for shape in shapes])
        plain, arcs = (
            np.array([shape.beta is None for shape in shapes], bool),
            np.array(self._arcs, bool),
        )
        for which, best in ((plain & ~arcs, plain_beta), (plain & arcs, arc_beta)):
            beta[which] = best(np.linalg.svd(rows[which], compute_uv=False))
        radius[plain] = plain_radius(beta[plain])
        sigma = extent / radius[:, None]
        thin, wide = sigma.min(axis=1) < LEAST_SIGMA, sigma.max(axis=1) > MOST_SIGMA
        far = np.abs(disc[:, 2]).max(axis=1) > MOST_MEAN
        self._refuse(thin, f"its sigma must be at least {LEAST_SIGMA:g} px")
        self._refuse(wide, f"its sigma must be at most {MOST_SIGMA:g} px")
        self._refuse(far, f"its centre must be within {MOST_MEAN:g} px of the origin")
        return Scene(
            self._width,
            self._height,
            mean=disc[:, 2],
            sigma=sigma,
            rho=rho,
            color=np.array([shape.color for shape in shapes]).reshape(-1, 3),
            opacity=np.array([opacity for _, opacity, _ in self._shapes]),
            background=np.ones(3) if self._background is None else self._background,
            round_index=np.array([number for _, _, number in self._shapes], np.int32),
            beta=beta,
            drawn=np.array([shape.drawn for shape in shapes], np.int8),
            transparent=self._background is None,
        )

    def _refuse(self, bad: NDArray[np.bool_], why: str) -> None:
        """Raise InputError about the first of the shapes that are bad."""
        if bad.any():
            with _naming(self._elements[int(bad.argmax())]):
                raise InputError(f"{why}. Try to delete it")


def _round_of(group: Any) -> int | None:
    """The round, from 0, of a group's label or id; the label is first, because users edit it.

    Raises InputError for round 0.
    """
    label = _ROUND_LABEL.match(group.get(_LABEL, ""))
    match = label or _ROUND_ID.fullmatch(group.get("id", ""))
    if match is None:
        return None
    if int(match[1]) < 1:
        raise InputError(
            f"its round must be 1 or more; got {quoted(int(match[1]))}. Try to rename it"
        )
    return int(match[1]) - 1


def _read_rules(element: Any, opacities: dict[str, list[str]]) -> None:
    """Add the opacities of stops that the style sheet of a minimal file says.

    Raises InputError for other sheets, and for an animation, that changes what is read.
    """
    tag = element.tag[len(SVG) :]
    if tag != "style":
        check_smil(tag, element.attrib)
        return
    sheet = "".join(element.itertext())
    found = stop_opacities(sheet)
    opacities.update(found)
    if not found:
        check_sheet(sheet)


def _is_undisplayed(attributes: dict[str, str]) -> bool:
    return attributes.get("display", "").strip().lower() == "none"


@contextmanager
def _naming(element: Any) -> Iterator[None]:
    """Put the element before the message of an InputError."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{_name(element)}: {error}") from None


def _name(element: Any) -> str:
    """An element as it can be found in the file: by its id, or else by its first attributes."""
    named = [(key, element.get(key)) for key in ("id", _LABEL) if element.get(key)]
    shown = " ".join(f'{_bare(k)}="{v}"' for k, v in named or list(element.attrib.items())[:3])
    return f"<{_bare(element.tag)[:40]} {' '.join(shown.split())[:120]}>".replace(" >", ">")


def _bare(tag: str) -> str:
    return tag.rpartition("}")[2]
