"""SVG text with nothing that does not draw: for files of half a kilobyte to twenty.

    <svg xmlns=".." viewBox="0 0 64 43"><defs>
    <radialGradient id="c" gradientUnits="userSpaceOnUse" cx="0" cy="0" r="1">stops</radialGradient>
    <mask id="b"><circle r="1" fill="url(#c)"/></mask><circle id="a" r="1" mask="url(#b)"/></defs>
    <path fill="#abc" d="M0 0h64v43H0"/>
    <use href="#a" fill="#abc" transform="matrix(12 3 0 8 30 20)"/> .. </svg>

All shapes of an exponent are one masked circle, so that a colour costs a few bytes instead of a
gradient; the mask's stops are greys, whose luminance is the falloff. Crisp shapes are plain
ellipses. Coordinates are whole numbers of user units (docs/decisions/minimal.md).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, instance, must_be, number_within
from gauss2svg.scene import ADD, LEAST_SIGMA, MOST_SIGMA, RHO_LIMIT, Scene
from gauss2svg.scene.falloff import BETA_CLASSES, MOST_BETA, RIM_WIDTH, cut_radius, nearest_class
from gauss2svg.svg.document import DEFAULT_TITLE, Document
from gauss2svg.svg.encode import check_canvas, hex_color, number, short_id, writable
from gauss2svg.svg.levels import grey_stops
from gauss2svg.svg.snap import with_exponents
from gauss2svg.svg.solid import is_solid, solid_beta, solid_radius

HEX_DIGITS = (3, 6)
LEAST_UNIT, MOST_UNIT = 0.001, 1e6  # px
# Stops of an exponent, and from how many shapes on the error of the fewer is worth two stops more
_FEW_STOPS, _STOPS, _MANY = 3, 5, 60
_OPACITY_DECIMALS = 2
_VIEW_ERROR = 0.02  # of a user unit
# px of rim: an ellipse's edge is at least as wide, where the scene's own is narrower
_CRISP = 1.0
_LEAST_BETA = 3.0  # as in gauss2svg.svg.solid


@dataclass(frozen=True)
class _Drawn:
    """The n shapes of a file, in painter's order.

    index    (n,) of the shape in its scene
    falloff  (n,) index into BETA_CLASSES, -1 for a plain ellipse
    matrix   (n, 5) whole numbers a b d e f: matrix(a b 0 d e f) of the circle of radius 1
    levels   (n, 3) in 0..255
    opacity  (n,) in 0..1
    """

    index: NDArray[np.intp]
    falloff: NDArray[np.intp]
    matrix: NDArray[np.float64]
    levels: NDArray[np.intp]
    opacity: NDArray[np.float64]


def minimal_svg(
    scene: Scene, unit: float, digits: int = 3, document: Document | None = None
) -> str:
    """The shortest SVG of a scene, of which coordinates are whole numbers of units.

    unit    px of the canvas, LEAST_UNIT..MOST_UNIT
    digits  of colours, 3 or 6
    What it draws is minimal_rounded(scene, unit, digits): shapes whose extent or opacity is written
    as 0 are left out. Title, alt, size and aspect of the document are written where they are given;
    otherwise the file has neither names nor a size. Raises InputError for an additive scene, and
    for layers (segments, animation, fragments).
    """
    document = instance(document, "document", Document)
    refuse_layers(document)
    drawn = _drawn(scene, unit, digits)
    width, height = (_view(side / unit) for side in (scene.width, scene.height))
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg"{_presented(document, scene)} ']
    parts.append(f'viewBox="0 0 {width} {height}">{_names(document)}')
    kinds, uses = np.unique(drawn.falloff[drawn.falloff >= 0], return_counts=True)
    kinds = kinds[np.argsort(-uses, kind="stable")].tolist()
    parts.append(_definitions(kinds, _STOPS if uses.sum() >= _MANY else _FEW_STOPS))
    if not scene.transparent:
        cover = [number(math.ceil(float(side)), 0) for side in (width, height)]
        fill = _fill(_levels(scene.background, digits))
        parts.append(f'<path{fill} d="M0 0h{cover[0]}v{cover[1]}H0"/>')
    ids = {kind: short_id(k) for k, kind in enumerate(kinds)}
    parts += [_shape(drawn, i, ids) for i in range(len(drawn.index))]
    parts.append("</svg>")
    return "".join(parts)


def minimal_rounded(scene: Scene, unit: float, digits: int = 3) -> Scene:
    """The scene as the file of minimal_svg has it, without the shapes that it leaves out.

    Means, extents, colours, opacities and exponents are those of the file; a plain ellipse has the
    exponent whose profile it draws best. Arguments and errors are those of minimal_svg.
    """
    drawn = _drawn(scene, unit, digits)
    solid = drawn.falloff < 0
    factor = np.zeros((len(solid), 2, 2))
    factor[:, 0, 0], factor[:, 1, 0], factor[:, 1, 1] = unit * drawn.matrix[:, :3].T
    beta = np.array([*BETA_CLASSES, 1.0])[drawn.falloff]
    beta[solid] = solid_beta(np.linalg.svd(factor[solid], compute_uv=False))
    rounded = scene.select(drawn.index).replace(
        color=drawn.levels / 255,
        opacity=drawn.opacity,
        background=_levels(scene.background, digits) / 255,
        beta=beta,
    )
    rounded = _with_matrix(rounded, drawn.matrix, _radius(beta, solid), unit)
    # The crispest exponent where the best would be written as a soft shape: thin ones.
    beta = np.where(solid & ~_is_solid(rounded), MOST_BETA, beta)
    rounded = rounded.replace(beta=beta)
    return _with_matrix(rounded, drawn.matrix, _radius(beta, solid), unit)


def refuse_layers(document: Document) -> None:
    """Raise InputError for a document whose layers a minimal file does not have."""
    for name, given in {
        "segments": document.segments is not None,
        "animate": document.animate is not None,
        "fragments": document.fragments,
    }.items():
        if given:
            raise InputError(
                f"{name} must not be given with minimal markup, which has no layers. Try --markup "
                "editable"
            )


def _drawn(scene: Scene, unit: float, digits: int) -> _Drawn:
    unit = number_within("unit", unit, LEAST_UNIT, MOST_UNIT)
    if digits not in HEX_DIGITS:
        raise InputError(must_be("digits", "3 or 6", digits))
    if scene.blend == ADD:
        raise InputError(must_be("blend of a scene in minimal markup", "'over'", scene.blend))
    check_canvas(scene)
    kind, solid = nearest_class(scene.betas), _is_solid(scene)
    classes = np.array(BETA_CLASSES)[kind]
    for _ in range(2):  # once more for soft shapes that are solid as they are rounded
        snapped = with_exponents(scene, np.where(solid, scene.betas, classes))
        radius = _radius(snapped.betas, solid)
        fits = writable(snapped, radius, unit)
        matrix = _matrix(snapped, radius, unit)
        fits &= (matrix[:, 0] > 0) & (matrix[:, 2] > 0)
        solid[fits] |= _is_solid(
            _with_matrix(snapped.select(fits), matrix[fits], radius[fits], unit)
        )
    opacity = np.round(scene.opacity, _OPACITY_DECIMALS)
    index = np.flatnonzero(fits & (opacity > 0))
    return _Drawn(
        index,
        np.where(solid, -1, kind)[index],
        matrix[index],
        _levels(scene.color[index], digits),
        opacity[index],
    )


def _matrix(scene: Scene, radius: NDArray[np.float64], unit: float) -> NDArray[np.float64]:
    """(n, 5) whole numbers of units a b d e f, for circles of radius (n,) sigmas."""
    factor = scene.factor * radius[:, None, None]
    entries = [factor[:, 0, 0], factor[:, 1, 0], factor[:, 1, 1], *scene.mean.T]
    return np.round(np.column_stack(entries) / unit) + 0.0  # no -0


def _with_matrix(
    scene: Scene, matrix: NDArray[np.float64], radius: NDArray[np.float64], unit: float
) -> Scene:
    """The scene with the geometry of such numbers."""
    a, b, d = unit * matrix[:, :3].T
    sigma = np.column_stack([a, np.hypot(b, d)]) / radius[:, None]
    return scene.replace(
        mean=unit * matrix[:, 3:],
        sigma=np.clip(sigma, LEAST_SIGMA, MOST_SIGMA),
        rho=np.clip(b / np.hypot(b, d), -RHO_LIMIT, RHO_LIMIT),
    )


def _is_solid(scene: Scene) -> NDArray[np.bool_]:
    """(n,) whether a plain ellipse draws a shape: nearly its rim, or a wider one."""
    across = RIM_WIDTH * scene.ellipse_axes[0][:, 0] / scene.betas
    crisp = (scene.betas >= _LEAST_BETA) & (across < _CRISP)
    return is_solid(scene) | crisp | (scene.betas == MOST_BETA)


def _radius(beta: NDArray[np.float64], solid: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(n,) radius in sigmas of the circle that is drawn."""
    radius = cut_radius(beta)
    radius[solid] = [solid_radius(b) for b in beta[solid]]
    return radius


def _levels(color: NDArray[np.float64], digits: int) -> NDArray[np.intp]:
    """Levels in 0..255 that so many hex digits can say."""
    most = 15 if digits == HEX_DIGITS[0] else 255
    return np.round(color * most).astype(np.intp) * (255 // most)


def _definitions(kinds: list[int], count: int) -> str:
    """A masked circle for each falloff, of the first ids; its gradient and mask have the next."""
    if not kinds:
        return ""
    texts = []
    for k, kind in enumerate(kinds):
        name, mask, ramp = (short_id(k + part * len(kinds)) for part in range(3))
        offsets, greys = grey_stops(count, BETA_CLASSES[kind])
        stops = "".join(
            f'<stop offset="{number(o, 3)}"{_fill(np.full(3, 17 * v), "stop-color")}/>'
            for o, v in zip(offsets, greys, strict=True)
        )
        # Without userSpaceOnUse librsvg 2.54 loses all under a rotation.
        texts.append(
            f'<radialGradient id="{ramp}" gradientUnits="userSpaceOnUse" cx="0" cy="0" r="1">'
            f'{stops}</radialGradient><mask id="{mask}"><circle r="1" fill="url(#{ramp})"/></mask>'
            f'<circle id="{name}" r="1" mask="url(#{mask})"/>'
        )
    return "<defs>" + "".join(texts) + "</defs>"


def _shape(drawn: _Drawn, i: int, ids: dict[int, str]) -> str:
    kind = int(drawn.falloff[i])
    a, b, d, e, f = (number(v, 0) for v in drawn.matrix[i])
    fill = _fill(drawn.levels[i])
    shown = number(drawn.opacity[i], _OPACITY_DECIMALS)
    opacity = "" if shown == "1" else f' opacity="{shown}"'
    if kind < 0 and b == "0":
        place = f' cx="{e}"' * (e != "0") + f' cy="{f}"' * (f != "0")
        if a == d:
            return f'<circle{place} r="{a}"{fill}{opacity}/>'
        return f'<ellipse{place} rx="{a}" ry="{d}"{fill}{opacity}/>'
    element = 'circle r="1"' if kind < 0 else f'use href="#{ids[kind]}"'
    matrix = f"{a} {b} 0 {d} {e} {f}".replace(" -", "-")
    return f'<{element}{fill}{opacity} transform="matrix({matrix})"/>'


def _fill(levels: NDArray[np.intp], name: str = "fill") -> str:
    """Black is the default."""
    return f' {name}="{hex_color(levels)}"' if levels.any() else ""


def _view(side: float) -> str:
    """A side of the view box with the fewest decimals."""
    return next(
        text
        for text in (number(side, decimals) for decimals in range(7))
        if abs(float(text) - side) <= _VIEW_ERROR * min(1.0, side)
    )


def _presented(document: Document, scene: Scene) -> str:
    sides = document.sides(scene.width, scene.height)
    text = "" if sides is None else f' width="{sides[0]}" height="{sides[1]}"'
    if document.aspect:
        text += f' preserveAspectRatio="{document.aspect}"'
    return text + ' role="img"' * bool(_names(document))


def _names(document: Document) -> str:
    title = "" if document.title == DEFAULT_TITLE else f"<title>{escape(document.title)}</title>"
    return title + (f"<desc>{escape(document.alt)}</desc>" if document.alt else "")
