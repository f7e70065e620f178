"""From a scene to the numbers and short strings of an SVG; nothing here knows about XML.

A Gaussian is the unit circle under matrix(a b c d e f). Any matrix M with M M^T = R^2 covariance,
R = cut_radius(beta), draws the same ellipse, because a circle has no direction; the lower
triangular one has c = 0 and is the shortest to write:

    a = R sx,  b = R rho sy,  c = 0,  d = R sqrt(1 - rho^2) sy.

The user unit is `precision` px, so that all these are whole numbers. Shapes of one colour and one
exponent share a gradient. Solid ellipses have none, and the radius of solid_radius(beta); blurred
discs share filters by exponent. Crisp rims need two more things (docs/decisions/svg.md,
examples/rims.py):

- a circle a little larger than its gradient, whose own antialiased edge would clip the rim;
- from the exponent _LARGE_FROM on a gradient of radius 100 under a matrix of a hundredth, because
  cairo shifts the rim of large shapes otherwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gauss2svg.errors import SceneError, must_be, shown
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import BETA_CLASSES, RIM_WIDTH, cut_radius, nearest_class
from gauss2svg.svg.blur import BLURS, GRADIENT, drawn_blurs
from gauss2svg.svg.format import SvgFormat
from gauss2svg.svg.snap import snapped
from gauss2svg.svg.solid import is_solid, solid_radius
from gauss2svg.svg.stops import gradient_stops

_DIGITS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
_SMALLEST_CANVAS = 0.01
_LARGE_FROM, _LARGE = 16.0, 100  # exponent; radius of its gradients
_CLEAR_OF_THE_RIM = 0.7  # px from a gradient's end to the circle's edge
_MOST_MARGIN = 20.0  # times the gradient's radius: shapes that need more are too thin to be drawn
# px of rim across the minor axis above which the edge does little harm (docs/decisions/svg.md).
_SOFT = 1.0
# Renderers compute in float32, and resvg panics from about 1e9 on; all six draw numbers up to 1e8
# within 2.1 levels of 255 (docs/decisions/numbers.md).
LARGEST_NUMBER = 1e8
# px. Cairo has 23 bits for whole pixels, and is 47 levels off at 1e7.
_FARTHEST = 8e6
# Radii around a shape's mean within which all of it is drawn, because a blur fills up to 2.5 radii
# around its disc; and px for antialiasing.
_DRAWN_WITHIN, _EDGE = 4.0, 1.0


@dataclass(frozen=True)
class Gradient:
    """One radial gradient: its id, radius, colour as #rrggbb, stops as (offset, opacity)."""

    id: str
    radius: int
    color: str
    stops: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Filter:
    """One blur of a circle of radius 1: its id, standard deviation, and margin in diameters."""

    id: str
    deviation: str
    margin: str


@dataclass(frozen=True)
class Ellipse:
    """One shape: its fill, a gradient or a colour, the circle's radius, its matrix, its opacity.

    The opacity is "" where it is 1; filter the id of its blur, or ""; index its place in the scene.
    """

    index: int
    fill: str
    radius: str
    matrix: str
    opacity: str
    filter: str


@dataclass(frozen=True)
class EncodedScene:
    """Everything that the writer puts into elements, as text.

    width, height in px; view_width, view_height in user units; background "" where the scene is
    transparent
    """

    width: str
    height: str
    view_width: str
    view_height: str
    background: str
    gradients: tuple[Gradient, ...]
    filters: tuple[Filter, ...]
    layers: tuple[tuple[int, tuple[Ellipse, ...]], ...]


def number(value: float, decimals: int) -> str:
    """Shortest text of a value rounded to some decimals.

    Raises SceneError for NaN and infinity, which renderers draw wrongly or crash on, and for
    numbers above LARGEST_NUMBER.
    """
    if not abs(value) <= LARGEST_NUMBER:
        raise SceneError(
            must_be(
                "a number in an SVG",
                f"finite and at most {LARGEST_NUMBER:g}",
                shown(value),
                "to scale the scene, to drop shapes that lie so far off, or a coarser precision",
            )
        )
    text = f"{value:.{decimals}f}"
    if "." in text:
        text = text.rstrip("0").rstrip(".")
    if text in ("-0", ""):
        return "0"
    if text.startswith("0."):
        return text[1:]
    if text.startswith("-0."):
        return "-" + text[2:]
    return text


def check_canvas(scene: Scene) -> None:
    """Raise SceneError for a canvas that is too small to be written."""
    if min(scene.width, scene.height) < _SMALLEST_CANVAS:
        needed = f"at least {_SMALLEST_CANVAS} px a side in an SVG"
        got = shown(f"{scene.width:g}x{scene.height:g} px")
        raise SceneError(must_be("canvas", needed, got, "to scale the scene up"))


def writable(
    scene: Scene, radius: ArrayLike, precision: float, unit: ArrayLike = 1
) -> NDArray[np.bool_]:
    """(n,) whether each shape's numbers, in user units of `precision` px, fit into a file.

    radius  in sigmas, of the drawn discs, whose matrices are for circles of radius `unit`
    A shape whose numbers do not fit, or that reaches too far for renderers, can be left out where
    it lies entirely off the canvas. Raises SceneError for one that may be visible.
    """
    extent = np.asarray(radius)[..., None] * scene.sigma
    offset = np.abs(scene.mean)
    number = np.maximum(offset, extent / np.asarray(unit)[..., None]).max(axis=1) / precision
    farthest = (offset + extent).max(axis=1)
    canvas = np.array([scene.width, scene.height])
    beyond = np.maximum(-scene.mean, scene.mean - canvas)
    off = (beyond > _DRAWN_WITHIN * extent + _EDGE).any(axis=1)
    fits = (number <= LARGEST_NUMBER) & (farthest <= _FARTHEST)
    lost = ~fits & ~off
    if lost.any():
        i = int(lost.argmax())
        raise SceneError(
            f"Gaussian {i} must reach at most {_FARTHEST:g} px, with numbers up to "
            f"{LARGEST_NUMBER:g}; got {farthest[i]:.3g} px and {number[i]:.3g} at a precision of "
            f"{precision:g} px, for mean {scene.mean[i].tolist()} and sigma "
            f"{scene.sigma[i].tolist()} px. Try to clip its sigma, to scale the scene down, to "
            "drop the Gaussian, or a coarser precision"
        )
    return fits


def encode(scene: Scene, svg_format: SvgFormat) -> EncodedScene:
    """Numbers of the SVG of a scene; depends on nothing but the two arguments.

    Gaussians whose opacity or extent is written as 0 draw nothing and are left out, as are those
    off the canvas whose numbers are too large for a file (writable). Raises SceneError for other
    Gaussians with such numbers, and for such a canvas.
    """
    check_canvas(scene)
    scene = snapped(scene, svg_format.form)
    solid, blur = is_solid(scene), drawn_blurs(scene)
    blurred = ~solid & (blur >= 0) & (svg_format.form != GRADIENT)
    shaded = ~solid & ~blurred
    color = np.round(scene.color * 255).astype(np.uint8)
    keys = np.column_stack([nearest_class(scene.beta), color])
    shared, entry, uses = np.unique(keys[shaded], axis=0, return_inverse=True, return_counts=True)
    # The shortest ids go to those that are used most.
    uses = np.append(uses, np.bincount(blur[blurred], minlength=len(BLURS)))
    names = [short_id(k) for k in np.argsort(np.argsort(-uses, kind="stable")).tolist()]
    ids, filter_ids = names[: len(shared)], names[len(shared) :]

    fills = np.array([hex_color(c) for c in color], dtype=object)
    fills[shaded] = [f"url(#{ids[k]})" for k in entry.reshape(-1)]
    filters = np.full(len(scene), "", dtype=object)
    filters[blurred] = [filter_ids[k] for k in blur[blurred]]
    radius, opacity = cut_radius(scene.beta), scene.opacity.copy()
    radius[solid] = solid_radius(scene.beta[solid])
    radius[blurred] = [BLURS[k].radius for k in blur[blurred]]
    opacity[blurred] *= [BLURS[k].peak for k in blur[blurred]]
    unit = np.where((scene.beta >= _LARGE_FROM) & shaded, _LARGE, 1)
    discs = _Discs(
        fills, filters, unit, unit * _widened(scene, shaded), np.minimum(opacity, 1.0),
        scene.factor * radius[:, None, None], scene.mean,
    )  # fmt: skip
    fits = writable(scene, radius, svg_format.precision, unit)
    layers = _layers(discs, fits, scene.round_index, svg_format)
    drawn = [ellipse for _, ellipses in layers for ellipse in ellipses]
    fills_used, filters_used = {e.fill for e in drawn}, {e.filter for e in drawn}
    return EncodedScene(
        width=number(scene.width, 3),
        height=number(scene.height, 3),
        view_width=number(scene.width / svg_format.precision, 6),
        view_height=number(scene.height / svg_format.precision, 6),
        background=_background(scene),
        gradients=tuple(
            _gradient(name, BETA_CLASSES[key[0]], key[1:], svg_format.stops)
            for name, key in zip(ids, shared, strict=True)
            if f"url(#{name})" in fills_used
        ),
        filters=tuple(
            Filter(name, number(blur.deviation, 4), number(blur.margin / 2, 2))
            for name, blur in zip(filter_ids, BLURS, strict=True)
            if name in filters_used
        ),
        layers=layers,
    )


def _background(scene: Scene) -> str:
    if scene.transparent:
        return ""
    return hex_color(np.round(scene.background * 255).astype(np.uint8))


@dataclass(frozen=True)
class _Discs:
    """The circles of n shapes, before they are text.

    fill, filter  (n,) text, "" without a filter
    unit     (n,) radius of its gradient; circle (n,) radius of the circle that shows it
    opacity  (n,) in 0..1
    factor   (n, 2, 2) in px, of the circle of radius `unit`; mean (n, 2) in px
    """

    fill: NDArray[np.object_]
    filter: NDArray[np.object_]
    unit: NDArray[np.intp]
    circle: NDArray[np.float64]
    opacity: NDArray[np.float64]
    factor: NDArray[np.float64]
    mean: NDArray[np.float64]


def _layers(
    discs: _Discs, fits: NDArray[np.bool_], rounds: NDArray[np.int32], svg_format: SvgFormat
) -> tuple[tuple[int, tuple[Ellipse, ...]], ...]:
    """Rounds that draw something, with their ellipses."""
    layers = []
    for layer in np.unique(rounds).tolist():
        members = np.flatnonzero((rounds == layer) & fits).tolist()
        ellipses = (_ellipse(discs, i, svg_format) for i in members)
        drawn = tuple(ellipse for ellipse in ellipses if ellipse is not None)
        if drawn:
            layers.append((layer, drawn))
    return tuple(layers)


def _ellipse(discs: _Discs, i: int, svg_format: SvgFormat) -> Ellipse | None:
    matrix = matrix_text(discs.factor[i], discs.mean[i], svg_format.precision, int(discs.unit[i]))
    shown = number(discs.opacity[i], svg_format.opacity_decimals)
    if shown == "0" or not matrix:
        return None
    return Ellipse(
        i, discs.fill[i], number(discs.circle[i], 1), matrix,
        "" if shown == "1" else shown, discs.filter[i],
    )  # fmt: skip


def matrix_text(
    factor: NDArray[np.float64], mean: NDArray[np.float64], precision: float, unit: int = 1
) -> str:
    """Transform of a circle of radius `unit`, a power of ten; "" where an extent is written as 0.

    factor  (2, 2) in px, of that circle, lower triangular; mean (2,) in px
    """
    decimals = round(math.log10(unit))
    a, b, d = (
        number(v / (unit * precision), decimals) for v in (factor[0, 0], factor[1, 0], factor[1, 1])
    )
    e, f = (number(v / precision, 0) for v in mean)
    return "" if "0" in (a, d) else f"matrix({a} {b} 0 {d} {e} {f})"


def _gradient(name: str, beta: float, color: NDArray[np.integer], count: int) -> Gradient:
    offsets, values = gradient_stops(count, beta)
    stops = tuple((number(o, 4), number(v, 3)) for o, v in zip(offsets, values, strict=True))
    return Gradient(name, _LARGE if beta >= _LARGE_FROM else 1, hex_color(color), stops)


def _widened(scene: Scene, shaded: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(n,) radius of each shape's circle, as a multiple of its gradient's, on one decimal."""
    minor = scene.ellipse_axes[0][:, 1]
    crisp = (scene.beta > 1) & (RIM_WIDTH * minor < _SOFT * scene.beta) & shaded
    margin = np.where(crisp, _CLEAR_OF_THE_RIM / (minor * cut_radius(scene.beta)), 0.0)
    return 1 + np.minimum(np.ceil(10 * margin) / 10, _MOST_MARGIN)


def short_id(index: int) -> str:
    """The index-th shortest id of letters: a, b, ..., Z, aa, ab, ..."""
    text = _DIGITS[index % len(_DIGITS)]
    while index >= len(_DIGITS):
        index = index // len(_DIGITS) - 1
        text = _DIGITS[index % len(_DIGITS)] + text
    return text


def hex_color(color: NDArray[np.integer]) -> str:
    """#rrggbb of three levels 0..255, or #rgb where that is the same."""
    text = "#" + "".join(f"{int(v):02x}" for v in color)
    if text[1] == text[2] and text[3] == text[4] and text[5] == text[6]:
        return "#" + text[1] + text[3] + text[5]
    return text
