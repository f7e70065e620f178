"""From a scene to the numbers and short strings of an SVG; nothing here knows about XML.

A Gaussian is the unit circle under matrix(a b c d e f). Any matrix M with
M M^T = R^2 covariance, R = cut_radius(beta), draws the same ellipse, for a circle has no
direction; the lower triangular one has c = 0 and is the shortest to write:

    a = R sx,  b = R rho sy,  c = 0,  d = R sqrt(1 - rho^2) sy.

A gradient is shared by all shapes of one colour of the palette and one exponent; exponents
are rounded to BETA_CLASSES, a shape's extent with them so that its half-way rim stays.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.checks import whole_number
from gauss2svg.errors import InputError, SceneError
from gauss2svg.falloff import cut_radius, in_classes, nearest_class
from gauss2svg.render.cpu import removal_cost, splats_of
from gauss2svg.scene import Scene
from gauss2svg.svg.palette import quantize
from gauss2svg.svg.stops import STOP_COUNTS, gradient_stops

_DIGITS = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ"
_SMALLEST_CANVAS = 0.01
# Renderers compute in float32, and resvg panics from about 1e9 on.
LARGEST_NUMBER = 1e7
# Colours are weighted by what shows of them, measured on a picture of this side.
_WEIGHING_SIDE = 768


@dataclass(frozen=True)
class SvgOptions:
    """How a scene is written.

    palette           most gradients, one for each colour and exponent that go together, but at
                      least one for each exponent; 0 writes every colour
    color_error       squared error, mean over pixels and channels, that using fewer colours
                      may add; 0: as many as the palette has
    stops             gradient stops, one of STOP_COUNTS
    decimals          of coordinates, 0..6; 1 costs 64 dB, 2 costs 84 dB
    opacity_decimals  of fill-opacity, 1..6; 2 costs 60 dB, 3 costs 80 dB
    title             text of the title element
    """

    palette: int = 1250
    color_error: float = 0.0
    stops: int = 6
    decimals: int = 1
    opacity_decimals: int = 2
    title: str = "Vectorised photo"

    def __post_init__(self) -> None:
        whole_number("palette", self.palette, 0, 2**24)
        if self.stops not in STOP_COUNTS:
            known = ", ".join(map(str, STOP_COUNTS))
            raise InputError(f"stops is {self.stops}; needed is one of {known}")
        if not 0 <= self.color_error < np.inf:
            raise InputError(f"color_error is {self.color_error}; needed is a number from 0 on")
        whole_number("decimals", self.decimals, 0, 6)
        whole_number("opacity_decimals", self.opacity_decimals, 1, 6)
        if any(not character.isprintable() for character in self.title):
            raise InputError(f"title is {self.title!r}; needed is text without control characters")

    @property
    def every_color(self) -> SvgOptions:
        """The same without a palette: for colours that are of one already."""
        return dataclasses.replace(self, palette=0, color_error=0.0)


@dataclass(frozen=True)
class Gradient:
    """One radial gradient: its id, its colour as #rrggbb, stops as (offset, opacity)."""

    id: str
    color: str
    stops: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Ellipse:
    """One Gaussian: its gradient's id, its matrix, its opacity ("" where it is 1)."""

    gradient: str
    matrix: str
    opacity: str


@dataclass(frozen=True)
class EncodedScene:
    """Everything that the writer puts into elements, as text."""

    width: str
    height: str
    background: str
    gradients: tuple[Gradient, ...]
    layers: tuple[tuple[int, tuple[Ellipse, ...]], ...]


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
    beta, widened = in_classes(scene.betas)
    scene = scene.replace(beta=beta, sigma=scene.sigma * widened[:, None])
    palette, entry = _palette(scene, options)
    ids = [short_id(k) for k in range(len(palette))]
    beta_of = np.ones(len(palette))
    beta_of[entry] = scene.betas
    factor = scene.factor * cut_radius(scene.betas)[:, None, None]
    layers: list[tuple[int, tuple[Ellipse, ...]]] = []
    used: set[int] = set()
    for layer in np.unique(scene.rounds).tolist():
        ellipses = []
        for i in np.flatnonzero(scene.rounds == layer).tolist():
            ellipse = _ellipse(ids[entry[i]], factor[i], scene.mean[i], scene.opacity[i], options)
            if ellipse is not None:
                ellipses.append(ellipse)
                used.add(int(entry[i]))
        if ellipses:
            layers.append((layer, tuple(ellipses)))
    gradients = tuple(
        Gradient(ids[k], _hex(palette[k]), _stops(options.stops, beta_of[k])) for k in sorted(used)
    )
    return EncodedScene(
        width=number(scene.width, 3),
        height=number(scene.height, 3),
        background=_hex(np.round(scene.background * 255).astype(np.uint8)),
        gradients=gradients,
        layers=tuple(layers),
    )


def _stops(count: int, beta: float) -> tuple[tuple[str, str], ...]:
    offsets, values = gradient_stops(count, beta)
    return tuple((number(o, 4), number(v, 3)) for o, v in zip(offsets, values, strict=True))


def _ellipse(
    gradient: str,
    factor: NDArray[np.float64],
    mean: NDArray[np.float64],
    opacity: float,
    options: SvgOptions,
) -> Ellipse | None:
    a, b, d = factor[0, 0], factor[1, 0], factor[1, 1]
    texts = [number(v, options.decimals) for v in (a, b, 0.0, d, mean[0], mean[1])]
    shown = number(opacity, options.opacity_decimals)
    if shown == "0" or texts[0] == "0" or texts[3] == "0":
        return None
    return Ellipse(gradient, f"matrix({' '.join(texts)})", "" if shown == "1" else shown)


def _palette(scene: Scene, options: SvgOptions) -> tuple[NDArray[np.uint8], NDArray[np.intp]]:
    count = options.palette if options.palette else max(1, len(scene))
    mass, pixels = visible_mass(scene)
    allowed = options.color_error * 3 * pixels
    return quantize(scene.color, mass, count, allowed, nearest_class(scene.betas))


def recolored(scene: Scene, options: SvgOptions) -> NDArray[np.float64]:
    """(n, 3) colours in 0..1 that the shapes have in a file: those of its palette."""
    palette, entry = _palette(scene, options)
    return palette[entry] / 255


def visible_mass(scene: Scene) -> tuple[NDArray[np.float64], int]:
    """(n,) sum over the canvas of (alpha transmittance)^2, in px: what shows of a Gaussian.

    Also the pixels of the canvas that it was measured on, reduced where that is large.
    A change d of a colour changes the summed squared error by visible_mass d^2.
    """
    shrunk = min(1.0, _WEIGHING_SIDE / max(scene.width, scene.height))
    width, height = (max(1, round(side * shrunk)) for side in (scene.width, scene.height))
    splats = splats_of(scene.scaled(width / scene.width, height / scene.height))
    blank = np.zeros((3, height, width), np.float32)
    return np.maximum(removal_cost(splats, blank)[1][:, 1], 0.0), width * height


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
