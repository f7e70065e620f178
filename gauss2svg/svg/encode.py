"""From a scene to the numbers and short strings of an SVG; nothing here knows about XML.

A Gaussian is the unit circle under matrix(a b c d e f). Any matrix M with
M M^T = R^2 covariance, R = cut_radius(beta), draws the same ellipse, for a circle has no
direction; the lower triangular one has c = 0 and is the shortest to write:

    a = R sx,  b = R rho sy,  c = 0,  d = R sqrt(1 - rho^2) sy.

The user unit is `precision` px, so that all these are whole numbers. A gradient is shared by
all shapes of one colour and one exponent. Shapes that a plain ellipse draws as well have none,
and the radius of plain_radius(beta). Crisp rims need two more things (examples/rims.py measures
both, dB near the rim against the model, mean of what resvg and CairoSVG draw at rims of 0.25 /
0.5 / 1 px: with neither 30 / 38 / 47, with both 55 / 55 / 50):

- a circle a little larger than its gradient, whose own antialiased edge would clip the rim;
- for exponents from _LARGE_FROM on a gradient of radius 100 under a matrix of a hundredth, for
  cairo shifts the rim of large shapes otherwise (45 levels at beta = 64, 5 with it).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import SceneError
from gauss2svg.falloff import BETA_CLASSES, RIM_WIDTH, cut_radius, nearest_class
from gauss2svg.scene import Scene
from gauss2svg.svg.options import SvgOptions
from gauss2svg.svg.plain import is_plain, plain_radius
from gauss2svg.svg.settle import settled
from gauss2svg.svg.stops import gradient_stops

_DIGITS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
_SMALLEST_CANVAS = 0.01
_LARGE_FROM, _LARGE = 16.0, 100  # exponent; radius of its gradients
_CLEAR_OF_THE_RIM = 0.7  # px from a gradient's end to the circle's edge
_MOST_MARGIN = 20.0  # times the gradient's radius: thinner shapes are not drawn anyway
# px of rim across the minor axis from which the edge does little harm; 5000 shapes, three Kodak
# photos, raster against model / gzipped bytes: 0 48.4 dB / 95.1 k, 1 49.0 / 97.2, 2 49.1 / 98.0
_SOFT = 1.0
# Renderers compute in float32, and resvg panics from about 1e9 on.
LARGEST_NUMBER = 1e7


@dataclass(frozen=True)
class Gradient:
    """One radial gradient: its id, radius, colour as #rrggbb, stops as (offset, opacity)."""

    id: str
    radius: int
    color: str
    stops: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Ellipse:
    """One shape: its fill, a gradient or a colour, the circle's radius, its matrix, its opacity.

    The opacity is "" where it is 1.
    """

    fill: str
    radius: str
    matrix: str
    opacity: str


@dataclass(frozen=True)
class EncodedScene:
    """Everything that the writer puts into elements, as text.

    width, height in px; view_width, view_height in user units
    drawn: index in the scene of each ellipse, in order
    """

    width: str
    height: str
    view_width: str
    view_height: str
    background: str
    gradients: tuple[Gradient, ...]
    layers: tuple[tuple[int, tuple[Ellipse, ...]], ...]
    drawn: tuple[int, ...]


def number(value: float, decimals: int) -> str:
    """Shortest text of a value rounded to some decimals: no zeros that say nothing.

    Raises SceneError for NaN and infinity, which renderers draw wrongly or crash on, and
    beyond LARGEST_NUMBER.
    """
    if not abs(value) <= LARGEST_NUMBER:
        raise SceneError(
            f"cannot write {value} into an SVG; needed are finite numbers up to "
            f"{LARGEST_NUMBER:g}: scale the scene, or drop what lies so far off"
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


def encode(scene: Scene, options: SvgOptions) -> EncodedScene:
    """Numbers of the SVG of a scene; depends on nothing but the two arguments.

    Gaussians whose opacity or whose extent is written as 0 draw nothing and are left out.
    """
    if min(scene.width, scene.height) < _SMALLEST_CANVAS:
        raise SceneError(
            f"canvas is {scene.width:g}x{scene.height:g} px; an SVG needs at least "
            f"{_SMALLEST_CANVAS} px a side: scale the scene up"
        )
    scene = settled(scene, options)
    plain = is_plain(scene)
    color = np.round(scene.color * 255).astype(np.uint8)
    keys = np.column_stack([nearest_class(scene.betas), color])
    shared, entry, uses = np.unique(keys[~plain], axis=0, return_inverse=True, return_counts=True)
    # The shortest to those that are used most.
    order = np.argsort(np.argsort(-uses, kind="stable"), kind="stable")
    ids = [short_id(k) for k in order.tolist()]
    fills = np.array([_hex(c) for c in color], dtype=object)
    fills[~plain] = [f"url(#{ids[k]})" for k in entry.reshape(-1)]
    radius = cut_radius(scene.betas)
    radius[plain] = [plain_radius(beta) for beta in scene.betas[plain]]
    factor = scene.factor * radius[:, None, None]
    unit = np.where((scene.betas >= _LARGE_FROM) & ~plain, _LARGE, 1)
    circle = unit * _widened(scene, plain)
    layers: list[tuple[int, tuple[Ellipse, ...]]] = []
    indices: list[int] = []
    for layer in np.unique(scene.rounds).tolist():
        of_layer = np.flatnonzero(scene.rounds == layer).tolist()
        ellipses = (
            _ellipse(
                fills[i], unit[i], circle[i], factor[i], scene.mean[i], scene.opacity[i], options
            )
            for i in of_layer
        )
        shown = [(i, one) for i, one in zip(of_layer, ellipses, strict=True) if one is not None]
        if shown:
            layers.append((layer, tuple(one for _, one in shown)))
            indices += [i for i, _ in shown]
    used = {ellipse.fill for _, ellipses in layers for ellipse in ellipses}
    gradients = tuple(
        Gradient(
            ids[k], _LARGE if beta >= _LARGE_FROM else 1, _hex(key[1:]), _stops(options.stops, beta)
        )
        for k, (key, beta) in enumerate((key, BETA_CLASSES[key[0]]) for key in shared)
        if f"url(#{ids[k]})" in used
    )

    return EncodedScene(
        width=number(scene.width, 3),
        height=number(scene.height, 3),
        view_width=number(scene.width / options.precision, 3),
        view_height=number(scene.height / options.precision, 3),
        background=_hex(np.round(scene.background * 255).astype(np.uint8)),
        gradients=gradients,
        layers=tuple(layers),
        drawn=tuple(indices),
    )


def _stops(count: int, beta: float) -> tuple[tuple[str, str], ...]:
    offsets, values = gradient_stops(count, beta)
    return tuple((number(o, 4), number(v, 3)) for o, v in zip(offsets, values, strict=True))


def _widened(scene: Scene, plain: NDArray[np.bool_]) -> NDArray[np.float64]:
    """(n,) radius of each shape's circle, as a multiple of its gradient's, on one decimal."""
    minor = scene.ellipse_axes[0][:, 1]
    crisp = (scene.betas > 1) & (RIM_WIDTH * minor < _SOFT * scene.betas) & ~plain
    margin = np.where(crisp, _CLEAR_OF_THE_RIM / (minor * cut_radius(scene.betas)), 0.0)
    return 1 + np.minimum(np.ceil(10 * margin) / 10, _MOST_MARGIN)


def _ellipse(
    fill: str,
    unit: int,
    circle: float,
    factor: NDArray[np.float64],
    mean: NDArray[np.float64],
    opacity: float,
    options: SvgOptions,
) -> Ellipse | None:
    decimals = round(math.log10(unit))
    a, b, d = (
        number(v / (unit * options.precision), decimals)
        for v in (factor[0, 0], factor[1, 0], factor[1, 1])
    )
    texts = [a, b, "0", d, *(number(v / options.precision, 0) for v in mean)]
    shown = number(opacity, options.opacity_decimals)
    if shown == "0" or texts[0] == "0" or texts[3] == "0":
        return None
    return Ellipse(
        fill, number(circle, 1), f"matrix({' '.join(texts)})", "" if shown == "1" else shown
    )


def short_id(index: int) -> str:
    """The index-th shortest id of letters: a, b, ..., Z, aa, ab, ..."""
    text = _DIGITS[index % len(_DIGITS)]
    while index >= len(_DIGITS):
        index = index // len(_DIGITS) - 1
        text = _DIGITS[index % len(_DIGITS)] + text
    return text


def _hex(color: NDArray[np.uint8]) -> str:
    text = "#" + "".join(f"{int(v):02x}" for v in color)
    if text[1] == text[2] and text[3] == text[4] and text[5] == text[6]:
        return "#" + text[1] + text[3] + text[5]
    return text
