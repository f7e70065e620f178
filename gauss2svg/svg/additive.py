"""From an additive scene to the numbers and short strings of an SVG.

Under mix-blend-mode: difference a colour s over v gives |v - s|. The canvas holds s_c (P + o_c) for
a partial sum P, with a scale s_c and an offset o_c of each channel that keep all partial sums in
0..1; there the difference subtracts, on an inverted channel it adds, and drawing full intensity
inverts a channel. A Gaussian is a circle with an opaque gradient from its absolute colour to black,
which changes nothing. A filter on the whole group maps the canvas back,

    image = P = background + slope (v - v_0),   slope = +-1 / s_c,

with v_0 the background as it is written, so that its rounding shifts nothing; values outside 0..1
are clipped, as those of the scene are.

Every layer rounds to 8 bits, so that a larger s_c is more accurate: gauss2svg.svg.phases finds the
order that allows it, gauss2svg.svg.levels stops with little rounding. A focal offset changes
nothing here (docs/decisions/svg.md).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, must_be
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.encode import check_canvas, hex_color, matrix_text, number, short_id, writable
from gauss2svg.svg.format import SvgFormat
from gauss2svg.svg.levels import whole_stops
from gauss2svg.svg.phases import Phase, canvas_of, partial_sums, phases_of

_WHITE = 255
_MARGIN = 0.01  # of the span of partial sums, at either end, for the rounding of layers
_LEAST_SPAN = 0.1  # less would only magnify the rounding of renderers
# Levels of 255 that are added in the end: resvg and Chromium truncate a filter's result to whole
# levels (bias -0.5 levels), the others round.
_HALF_WAY = 0.25
_CHANNELS = ("red", "green", "blue")
_TRANSFER_DECIMALS = 5


@dataclass(frozen=True)
class Ramp:
    """A radial gradient of radius 1: its id, stops as (offset, opaque colour)."""

    id: str
    stops: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Disc:
    """A circle of radius 1: the id of its gradient, its matrix."""

    ramp: str
    matrix: str


@dataclass(frozen=True)
class DrawnPhase:
    """Circles that add to some channels and subtract from the others, after inverting some.

    inverted  the colour that inverts channels, "" where none is
    label   what they do, in words
    """

    inverted: str
    label: str
    discs: tuple[Disc, ...]


@dataclass(frozen=True)
class EncodedAdditive:
    """Everything that the writer puts into elements, as text.

    view_width, view_height  in user units
    background               initial colour of the canvas
    transfer                 final slope and intercept of red, green and blue
    """

    view_width: str
    view_height: str
    background: str
    transfer: tuple[tuple[str, str], ...]
    ramps: tuple[Ramp, ...]
    phases: tuple[DrawnPhase, ...]


def encode_additive(scene: Scene, svg_format: SvgFormat) -> EncodedAdditive:
    """Numbers of the SVG of an additive scene; depends on nothing but the two arguments.

    Gaussians whose extent is written as 0 or whose colour as black are left out, as are those off
    the canvas whose numbers are too large (gauss2svg.svg.encode.writable, which raises SceneError
    for others). Raises InputError for a form other than gradients.
    """
    check_canvas(scene)
    if svg_format.form != GRADIENT:
        raise InputError(
            must_be(
                "form",
                f"{GRADIENT!r} for an additive scene, whose blurs cannot be added exactly",
                svg_format.form,
            )
        )
    canvas = canvas_of(scene)
    phases = phases_of(scene, canvas)
    low, high = partial_sums(scene, phases, canvas)
    largest = np.abs(scene.color).max(axis=0, initial=0.0)
    span = np.maximum((1 + 2 * _MARGIN) * (high - low), np.maximum(largest, _LEAST_SPAN))
    middle = 0.5 * (low + high)
    scale = _WHITE / span  # levels of the canvas for 1 of the picture
    begin = np.round(scale * (scene.background - middle + 0.5 * span))
    shapes = _Shapes(scene, scale, svg_format)

    drawn: list[DrawnPhase] = []
    first = inverted = np.zeros(3, bool)
    for phase in phases:
        discs = shapes.drawn(phase)
        if not discs:
            continue
        needed = ~np.array(phase.takes)
        if not drawn:
            first = inverted = needed
        turn = needed ^ inverted
        color = hex_color(np.where(turn, _WHITE, 0)) if turn.any() else ""
        drawn.append(DrawnPhase(color, _label(len(drawn), len(discs), phase), discs))
        inverted = needed

    slope = np.where(inverted, -1, 1) * span
    level = np.where(inverted, _WHITE - begin, begin) / _WHITE
    intercept = scene.background - slope * level + _HALF_WAY / _WHITE
    return EncodedAdditive(
        view_width=number(scene.width / svg_format.precision, 6),
        view_height=number(scene.height / svg_format.precision, 6),
        background=hex_color(np.where(first, _WHITE - begin, begin).astype(int)),
        transfer=tuple(
            (number(a, _TRANSFER_DECIMALS), number(b, _TRANSFER_DECIMALS))
            for a, b in zip(slope, intercept, strict=True)
        ),
        ramps=shapes.ramps(),
        phases=tuple(drawn),
    )


class _Shapes:
    """The Gaussians of a scene as circles, and their gradients, those with the same stops as one.

    A gradient and its circle end at the first of the trailing black stops, which saves a sixth of
    the area of 8000 Gaussians.
    """

    def __init__(self, scene: Scene, scale: NDArray[np.float64], svg_format: SvgFormat) -> None:
        color, entry = np.unique(np.abs(scene.color), axis=0, return_inverse=True)
        offsets, levels = whole_stops(scale * color, svg_format.stops)
        colored = levels.any(axis=2)
        # Number of stops before the trailing black ones.
        before = np.where(colored, np.arange(1, svg_format.stops + 1), 0).max(axis=1)
        reach = offsets[np.arange(len(color)), before]
        self._entry = entry.reshape(-1)
        self._stops = [
            _stops_text(offsets[k, : count + 1] / reach[k], levels[k]) if count else ()
            for k, count in enumerate(before.tolist())
        ]
        radius = float(cut_radius(1.0)) * reach[self._entry]
        fits = writable(scene, radius, svg_format.precision)
        discs = zip(fits, radius[:, None, None] * scene.factor, scene.mean, strict=True)
        self._matrices = [
            matrix_text(factor, mean, svg_format.precision) if fit else ""
            for fit, factor, mean in discs
        ]
        self._ids: dict[tuple[tuple[str, str], ...], str] = {}

    def drawn(self, phase: Phase) -> tuple[Disc, ...]:
        """Circles of a phase; Gaussians of no extent or colour are none."""
        shown = ((i, self._stops[self._entry[i]]) for i in phase.index.tolist())
        return tuple(
            Disc(self._ids.setdefault(stops, short_id(len(self._ids))), self._matrices[i])
            for i, stops in shown
            if stops and self._matrices[i]
        )

    def ramps(self) -> tuple[Ramp, ...]:
        """Gradients of all that was drawn."""
        return tuple(Ramp(name, stops) for stops, name in self._ids.items())


def _stops_text(
    offsets: NDArray[np.float64], levels: NDArray[np.intp]
) -> tuple[tuple[str, str], ...]:
    return tuple(
        (number(offset, 3), hex_color(level))
        for offset, level in zip(offsets, levels, strict=False)
    )


def _label(index: int, count: int, phase: Phase) -> str:
    """Such as "Phase 3: 120 Gaussians that add red, green and take blue"."""
    signs = tuple(zip(_CHANNELS, phase.takes, strict=True))
    adds = ", ".join(name for name, taken in signs if not taken)
    takes = ", ".join(name for name, taken in signs if taken)
    one = count == 1
    verbs = ("adds" if one else "add", adds), ("takes" if one else "take", takes)
    does = " and ".join(f"{verb} {names}" for verb, names in verbs if names)
    return f"Phase {index + 1}: {count} Gaussian{'' if one else 's'} that {does}"
