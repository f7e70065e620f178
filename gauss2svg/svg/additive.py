"""The elements of an additive file, from a scene of signed colours.

Under mix-blend-mode: difference a colour s over v gives |v - s|. The canvas holds s_c (P + o_c) for
a partial sum P, with a scale s_c and an offset o_c of each channel that keep all partial sums in
0..1; there the difference subtracts, on an inverted channel it adds, and drawing full intensity
inverts a channel. A Gaussian is a circle with an opaque gradient from its absolute colour to black,
which changes nothing. A filter on the whole group maps the canvas back,

    image = P = background + slope (v - v_0),   slope = +-1 / s_c,

with v_0 the background as it is written, so that its rounding shifts nothing; values outside 0..1
are clipped, as those of the scene are.

Three grey Gaussians of +.3, +.4 and -.5 at one place, on .5, in the order in which there is most
room for them (gauss2svg.svg.headroom): sums from .3 to .8, so that 1 / s is .5, and .51
with a margin. The canvas begins inverted, as the first one adds:

    drawn                      sum at the mean      canvas
    rect #999, the background  .5                   .6
    circle, .3 s = .588        .8                   .012   |.6 - .588|
    rect #fff                                       .988   inverted back
    circle, .5 s = .980        .3                   .008   |.988 - .980|
    rect #fff                                       .992   inverted again
    circle, .4 s = .784        .7                   .208   |.992 - .784|
    filter                     .7 = .807 - .51 * .208

Every layer rounds to 8 bits, so that a larger s_c is more accurate: gauss2svg.svg.additive.encode
finds the order that allows it, gauss2svg.svg.stops stops with little rounding. A focal offset
changes nothing here (docs/decisions/svg.md).

Gaussians are drawn in phases, because a canvas holds a limited range of values. A Gaussian is added
to a channel or subtracted from it, until the channel is inverted. So Gaussians of one pattern of
signs form a phase, and patterns follow each other in the order of a Gray code, which inverts one
channel at a time. Additive blending is commutative: a Gaussian is drawn once the canvas can hold
its sum, and until then waits for a later tour through the patterns. If all wait for each other, the
one that exceeds the range least is drawn.

The range is checked between the pixels as well (gauss2svg.svg.headroom), so that a file can be
drawn at any size. Values that are clipped in the end may fold on the canvas, which allows a larger
scale (docs/decisions/svg.md).

    <style>#additive-1a2b3c4d circle,#additive-1a2b3c4d rect{mix-blend-mode:difference}</style>
    <g id="additive-1a2b3c4d" filter="url(#transfer-1a2b3c4d)"> <rect fill="#.."/>
      <g> <circle r="1" transform="matrix(..)" fill="url(#..)"/> ... </g> <rect fill="#f00"/> ...
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import quoted, refusal
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius
from gauss2svg.svg.blur import GRADIENT
from gauss2svg.svg.document import SvgFormat
from gauss2svg.svg.element import (
    Element,
    check_canvas,
    hex_color,
    number,
    radial_gradient,
    short_id,
    writable,
)
from gauss2svg.svg.encode import Drawing, layer, matrix_text, view_of
from gauss2svg.svg.headroom import add_all, order_of, range_of, samples_of
from gauss2svg.svg.stops import whole_stops

_TRANSFER_DECIMALS = 5


# Levels of the canvas for partial sums (docs/decisions/svg.md).
MARGIN = 0.01  # share of the span that is left at either end for the rounding of layers
# Least span of partial sums. A smaller one only magnifies the rounding of renderers.
LEAST_SPAN = 0.1


def encode_additive(scene: Scene, svg_format: SvgFormat) -> Drawing:
    """Return the drawing of an additive scene; it depends on nothing but the two arguments.

    Gaussians whose extent is written as 0 or whose colour as black are left out, as are those off
    the canvas whose numbers are too large (gauss2svg.svg.element.writable, which raises SceneError
    for others). Raise InputError for a form other than gradients.
    """
    check_canvas(scene)
    if svg_format.form != GRADIENT:
        needed = f"{GRADIENT!r} for an additive scene, whose blurs cannot be added exactly"
        raise refusal("form", needed, quoted(svg_format.form))
    phases, low, high = phases_of(scene)
    largest = np.abs(scene.color).max(axis=0, initial=0.0)
    span = np.maximum((1 + 2 * MARGIN) * (high - low), np.maximum(largest, LEAST_SPAN))
    scale = WHITE / span  # levels of the canvas for 1 of the picture
    begin = np.round(scale * (scene.background - 0.5 * (low + high) + 0.5 * span))
    circles = _Circles(scene, scale, svg_format)

    groups, count = list[Element](), 0
    first = inverted = np.zeros(3, bool)
    for phase in phases:
        discs = circles.of(phase)
        if not discs:
            continue
        needed = ~phase.takes
        if not count:
            first = inverted = needed
        turn = needed ^ inverted
        if turn.any():  # beside the layers, so that one can be hidden without the other
            groups.append(_cover(hex_color(np.where(turn, WHITE, 0))))
        number_of = 1 + sum(group.tag == "g" for group in groups)
        label = _label(number_of, len(discs), phase)
        groups.append(layer(label, discs, id=f"phase-{number_of}"))
        inverted, count = needed, count + len(discs)

    slope = np.where(inverted, -1, 1) * span
    level = np.where(inverted, WHITE - begin, begin) / WHITE
    intercept = scene.background - slope * level + HALF_WAY / WHITE
    transfer = tuple(
        (number(a, _TRANSFER_DECIMALS), number(b, _TRANSFER_DECIMALS))
        for a, b in zip(slope, intercept, strict=True)
    )
    background = hex_color(np.where(first, WHITE - begin, begin).astype(int))
    # Two additive drawings inline in one page keep their own filter. The ids are longer than those
    # of gradients, so that they cannot collide.
    key = f"{zlib.crc32(repr((transfer, background)).encode()):08x}"
    group = f"additive-{key}"
    inside = [_cover(background, {"id": "background"}), *groups]
    return Drawing(
        view=view_of(scene, svg_format.precision),
        gaussians=count,
        definitions=[_transfer_filter(transfer, f"transfer-{key}"), *circles.gradients()],
        body=[layer("Additive", inside, id=group, filter=f"url(#transfer-{key})")],
        # Under its first rectangle the group is transparent, where a difference draws its source.
        sheet=f"#{group} circle,#{group} rect{{mix-blend-mode:difference}}",
    )


class _Circles:
    """The Gaussians of a scene as circles, and their gradients, those with the same stops as one.

    A gradient and its circle end at the first of the trailing black stops, which saves a sixth of
    the area of 8000 Gaussians.
    """

    def __init__(self, scene: Scene, scale: NDArray[np.float64], svg_format: SvgFormat) -> None:
        color, entry = np.unique(np.abs(scene.color), axis=0, return_inverse=True)
        offsets, levels = whole_stops(scale * color, svg_format.stops)
        # Number of stops before the trailing black ones.
        count = np.arange(1, svg_format.stops + 1)
        before = np.where(levels.any(axis=2), count, 0).max(axis=1)
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

    def of(self, phase: Phase) -> list[Element]:
        """Return the circles of a phase; Gaussians of no extent or colour are none."""
        circles = []
        for i in phase.indices.tolist():
            stops, matrix = self._stops[self._entry[i]], self._matrices[i]
            if stops and matrix:
                name = self._ids.setdefault(stops, short_id(len(self._ids)))
                attributes = {"fill": f"url(#{name})", "r": "1", "transform": matrix}
                circles.append(Element("circle", attributes))
        return circles

    def gradients(self) -> list[Element]:
        """Return the gradients of all that was drawn."""
        gradients = []
        for stops, name in self._ids.items():
            inside = [Element("stop", {"offset": at, "stop-color": c}) for at, c in stops]
            gradients.append(radial_gradient(name, inside))
        return gradients


def _stops_text(
    offsets: NDArray[np.float64], levels: NDArray[np.intp]
) -> tuple[tuple[str, str], ...]:
    return tuple(
        (number(offset, 3), hex_color(level))
        for offset, level in zip(offsets, levels, strict=False)
    )


def _label(number: int, count: int, phase: Phase) -> str:
    """Label of a phase, such as "Phase 3: 120 Gaussians that add red, green and take blue"."""
    signs = tuple(zip(("red", "green", "blue"), phase.takes, strict=True))
    adds = ", ".join(name for name, taken in signs if not taken)
    takes = ", ".join(name for name, taken in signs if taken)
    one = count == 1
    verbs = ("adds" if one else "add", adds), ("takes" if one else "take", takes)
    does = " and ".join(f"{verb} {names}" for verb, names in verbs if names)
    return f"Phase {number}: {count} Gaussian{'' if one else 's'} that {does}"


_EQUAL = 1e-3
_GRAY = np.array([k ^ (k >> 1) for k in range(8)])


# The order of additive Gaussians (docs/decisions/svg.md).
# Share of a channel that is spared at either end, so that fewer Gaussians wait for each other.
SPARE = 0.02


class Phase(NamedTuple):
    """Gaussians drawn one after the other: the channels they subtract from, and their indices."""

    takes: NDArray[np.bool_]
    indices: NDArray[np.intp]


def phases_of(
    scene: Scene,
) -> tuple[tuple[Phase, ...], NDArray[np.float64], NDArray[np.float64]]:
    """Phases of an additive scene in drawing order, and lowest and highest value (3,) of a channel.

    Each Gaussian is in one phase. The canvas must hold these values: they include the image
    (gauss2svg.svg.headroom.range_of) and all partial sums between and within phases,
    except values of a sample that equal its image.
    """
    samples = samples_of(scene)
    picture, low, high = range_of(samples, scene.background)
    pattern = (scene.color < 0) @ [1, 2, 4]
    mass = np.abs(scene.color).max(axis=1) * scene.sigma.prod(axis=1)
    by_mass = np.argsort(-mass, kind="stable")
    order = order_of(
        samples, picture, low - SPARE, high + SPARE, scene.background.copy(),
        pattern, _GRAY, by_mass,
    )  # fmt: skip
    ends = np.flatnonzero(np.diff(pattern[order])) + 1
    runs = [run for run in np.split(order, ends) if run.size]
    phases = tuple(Phase(scene.color[run[0]] < 0, run) for run in runs)
    lowest = np.tile(scene.background.astype(np.float32), (len(samples.place), 1))
    total, highest = lowest.copy(), lowest.copy()
    for phase in phases:
        add_all(samples, phase.indices, total, lowest, highest)
    lowest[lowest > picture - _EQUAL] = np.inf
    highest[highest < picture + _EQUAL] = -np.inf
    low, high = np.minimum(low, lowest.min(axis=0)), np.maximum(high, highest.max(axis=0))
    return phases, low, high


WHITE = 255
# Levels of 255 that are added in the end: resvg and Chromium truncate a filter's result to whole
# levels (bias -0.5 levels), the others round.
HALF_WAY = 0.25


def _cover(fill: str, more: Mapping[str, str] | None = None) -> Element:
    """A rectangle over the canvas and beyond, so that the filter maps opaque pixels only.

    The filter region is extended to whole pixels; a rectangle that ends within a pixel would leave
    it half inverted, which the filter makes an opaque line along the edge.
    """
    size = {"width": "120%", "x": "-10%", "y": "-10%"}
    return Element("rect", {"fill": fill, "height": "120%", **(more or {}), **size})


def _transfer_filter(transfer: Iterable[tuple[str, str]], name: str) -> Element:
    """The filter that maps channels by slope and intercept, all over the canvas at any size."""
    functions = [
        Element(f"feFunc{channel}", {"intercept": intercept, "slope": slope, "type": "linear"})
        for channel, (slope, intercept) in zip("RGB", transfer, strict=True)
    ]
    region = {"height": "100%", "id": name, "width": "100%", "x": "0", "y": "0"}
    attributes = {"color-interpolation-filters": "sRGB", "filterUnits": "userSpaceOnUse", **region}
    step = Element("feComponentTransfer", {"in": "SourceGraphic"}, functions)
    return Element("filter", attributes, [step])
