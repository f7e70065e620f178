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
room for them (gauss2svg.svg.additive): sums from .3 to .8, so that 1 / s is .5, and .51
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

The range is checked between the pixels as well (gauss2svg.svg.additive), so that a file can be
drawn at any size. Values that are clipped in the end may fold on the canvas, which allows a larger
scale (docs/decisions/svg.md).

    <style>#additive-1a2b3c4d circle,#additive-1a2b3c4d rect{mix-blend-mode:difference}</style>
    <g id="additive-1a2b3c4d" filter="url(#transfer-1a2b3c4d)"> <rect fill="#.."/>
      <g> <circle r="1" transform="matrix(..)" fill="url(#..)"/> ... </g> <rect fill="#f00"/> ...

Headroom decides the order in which Gaussians are added, because a canvas holds values from low to
high, at least those of the background and of the image. Say that at one place the background is .5
and the image .7, the sum with +.3, +.4 and -.5:

    total   room that +.3, +.4, -.5 lack    drawn
    .5      .1, .2, .5                      +.3: none has room, and it lacks least
    .8          .5, .2                      -.5
    .3          0                           +.4: .7 is the image, for which there is room

In that order the canvas must hold .3 to .8. In another it would have to hold .5 to 1.2, and all
that is drawn on it would be rounded more coarsely.

The room of a Gaussian is looked for at samples: pixels of a grid, and the means of all Gaussians,
because thin ones peak between pixels. They are sorted by the row of the grid that they lie in, and
by x within it. Kernels walk the samples of a Gaussian and store nothing per Gaussian, so that
memory is that of the samples.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import InputError, quoted
from gauss2svg.kernel_cache import cached
from gauss2svg.scene import Scene, narrowing_of, whitening_of
from gauss2svg.scene.falloff import cut_radius, profile
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
from gauss2svg.svg.encode import matrix_text, view_of
from gauss2svg.svg.stops import whole_stops

_kernel = cached()
# A smaller contribution to a colour channel of a sample needs no room there.
_LEAST_ADDED = 1e-3
# Equal values of a colour channel: the rounding of float32 is smaller.
_EQUAL = 1e-4
_RADIUS = float(cut_radius(1.0))
_TABLE = 4096  # steps of the falloff by squared radius
_STEPS_EACH = _TABLE / _RADIUS**2
_NOWHERE = -1


# Grid on which partial sums are sampled (docs/decisions/svg.md).
FINEST = 4.0  # most samples for each px, each way
SIDE = 1536  # most samples of a side
# Samples that all Gaussians together may touch, without means. A coarser grid is enough for wider
# Gaussians.
TOUCHED = 3e7


class Samples(NamedTuple):
    """Positions of samples, and the Gaussians in the same units, those of the grid.

    place    (m, 2) x, y
    start    (rows + 1,) of each row's samples
    shape    (n, 9) mean x, y, whitening w11, w21, w22, reach in x and y, d x / d y of the ridge on
             which rows peak, and the half width of a row through the mean
    color    (n, 3)
    falloff  by the squared radius, from 0 to the cut
    """

    place: NDArray[np.float32]
    start: NDArray[np.intp]
    shape: NDArray[np.float64]
    color: NDArray[np.float64]
    falloff: NDArray[np.float64]


def samples_of(scene: Scene) -> Samples:
    """Samples of an additive scene; they depend only on the scene."""
    canvas = np.array([scene.width, scene.height])
    sides = np.minimum(2 * _RADIUS * scene.sigma, canvas)
    touched = max(1.0, float(sides.prod(axis=1).sum()))
    coarse = float(np.sqrt(TOUCHED / touched))
    factor = min(FINEST, SIDE / canvas.max(), coarse)
    size = np.maximum(1, np.ceil(factor * canvas)).astype(int)
    mean, sigma = scene.mean * (size / canvas), scene.sigma * (size / canvas)
    y, x = np.mgrid[: size[1], : size[0]] + 0.5
    grid = np.stack([x, y], axis=-1).reshape(-1, 2)
    means = mean[((mean >= 0) & (mean < size)).all(axis=1)]
    # Two sorted runs, which a stable sort only merges.
    keys = [size[0] * np.floor(part[:, 1]) + part[:, 0] for part in (grid, means)]
    means, keys[1] = means[np.argsort(keys[1])], np.sort(keys[1])
    order = np.argsort(np.concatenate(keys), kind="stable")
    place = np.concatenate([grid, means])[order].astype(np.float32)
    start = np.searchsorted(np.concatenate(keys)[order], size[0] * np.arange(size[1] + 1))
    shape = np.column_stack(
        [
            mean, whitening_of(sigma, scene.rho), _RADIUS * sigma,
            scene.rho * sigma[:, 0] / sigma[:, 1],
            _RADIUS * narrowing_of(scene.rho) * sigma[:, 0],
        ]
    )  # fmt: skip
    falloff = profile(_RADIUS * np.sqrt(np.arange(_TABLE + 1) / _TABLE), 1.0)
    return Samples(
        place, start.astype(np.intp), shape, scene.color.copy(),
        np.ascontiguousarray(falloff, np.float64),
    )  # fmt: skip


def range_of(
    samples: Samples, background: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float64], NDArray[np.float64]]:
    """The image (m, 3), and the lowest and highest value (3,) that a canvas must hold to show it.

    Values outside fold: v above the highest h becomes 2 h - v. Values above 1 are clipped in the
    end, so that 2 h - v >= 1 is enough; likewise below 0.
    """
    picture = np.tile(background.astype(np.float32), (len(samples.place), 1))
    add_all(samples, np.arange(len(samples.color)), picture, picture, picture)
    least, most = picture.min(axis=0).astype(np.float64), picture.max(axis=0).astype(np.float64)
    low = np.minimum(background, np.where(least < 0, 0.5 * least, least))
    high = np.maximum(background, np.where(most > 1, 0.5 * (1 + most), most))
    return picture, low, high


@_kernel
def add_all(samples, order, total, lowest, highest):
    """Add Gaussians one by one to total (m, 3); lowest and highest (m, 3) follow it."""
    for i in order:
        _add(samples, i, total, lowest, highest)


@_kernel
def order_of(samples, picture, low, high, background, pattern, patterns, by_mass):
    """All Gaussians, each once, in the order in which to draw them on a canvas of low..high.

    A sample may also reach its own value of the image: wherever the canvas folds, the final error
    is then no larger than that of the image. Tours through the patterns draw what has room, in the
    order by_mass; where nothing has, the one that lacks least is drawn.
    """
    count = by_mass.size
    total = np.empty_like(picture)
    total[:] = background
    order = np.empty(count, np.intp)
    waiting = by_mass.copy()
    # Where each Gaussian lacked room last, and a lower bound of how much it lacks.
    seen, lacks = np.full(count, _NOWHERE), np.zeros(count)
    done = 0
    backwards = False
    while done < count:
        before = done
        for k in range(patterns.size):
            signs = patterns[patterns.size - 1 - k if backwards else k]
            left = 0
            for i in waiting:
                fits = False
                if pattern[i] == signs:
                    lacks[i], seen[i] = _lacking(
                        samples, i, total, picture, low, high, seen[i], True
                    )
                    fits = lacks[i] <= _EQUAL
                if fits:
                    _add(samples, i, total, total, total)
                    order[done] = i
                    done += 1
                else:
                    waiting[left] = i
                    left += 1
            waiting = waiting[:left]
        # Back through the patterns: the first of a tour is the last of the one before.
        backwards = not backwards
        if done == before:  # the canvas is as it was when each lack was found
            i = _least(samples, waiting, total, picture, low, high, seen, lacks)
            _add(samples, i, total, total, total)
            order[done] = i
            done += 1
            waiting = waiting[waiting != i]
    return order


@_kernel
def _least(samples, waiting, total, picture, low, high, seen, lacks):
    """The waiting Gaussian that lacks least; lower bounds in lacks are made exact on the way.

    All samples of a Gaussian are walked for the few whose bound is below the least exact lack.
    """
    exact = np.zeros(lacks.size, np.bool_)
    while True:
        i = waiting[np.argmin(lacks[waiting])]
        if exact[i]:
            return i
        lacks[i], seen[i] = _lacking(samples, i, total, picture, low, high, seen[i], False)
        exact[i] = True


@_kernel
def _lacking(samples, i, total, picture, low, high, seen, any_will_do):
    """How far beyond low..high the i-th Gaussian would lead, and at which sample.

    With any_will_do it is that of the first sample found to lack room, beginning with `seen`.
    """
    if any_will_do and seen != _NOWHERE:
        lack = _beyond(samples, i, seen, total, picture, low, high)
        if lack > _EQUAL:
            return lack, seen
    most, worst = 0.0, seen
    for row in range(*_rows(samples, i)):
        first, last = _interval(samples, i, row)
        for at in range(first, last):
            lack = _beyond(samples, i, at, total, picture, low, high)
            if lack > most:
                most, worst = lack, at
        if any_will_do and most > _EQUAL:
            break
    return most, worst


@_kernel
def _beyond(samples, i, at, total, picture, low, high):
    """How far beyond low..high the i-th Gaussian would lead a sample; at most 0 where not."""
    alpha = _alpha(samples, i, at)
    most = 0.0
    for c in range(3):
        added = alpha * samples.color[i, c]
        if added > _LEAST_ADDED:
            most = max(most, total[at, c] + added - max(high[c], picture[at, c]))
        elif added < -_LEAST_ADDED:
            most = max(most, min(low[c], picture[at, c]) - total[at, c] - added)
    return most


@_kernel
def _add(samples, i, total, lowest, highest):
    for row in range(*_rows(samples, i)):
        first, last = _interval(samples, i, row)
        for at in range(first, last):
            alpha = _alpha(samples, i, at)
            for c in range(3):
                after = np.float32(total[at, c] + alpha * samples.color[i, c])
                total[at, c] = after
                lowest[at, c] = min(lowest[at, c], after)
                highest[at, c] = max(highest[at, c], after)


@_kernel
def _rows(samples, i):
    shape = samples.shape
    rows = samples.start.size - 1
    first = np.floor(min(max(shape[i, 1] - shape[i, 6], 0.0), float(rows)))
    last = np.ceil(min(max(shape[i, 1] + shape[i, 6], 0.0), float(rows)))
    return int(first), int(last)


@_kernel
def _interval(samples, i, row):
    """First and last of a row's samples that the i-th Gaussian may reach."""
    shape = samples.shape
    # Samples lie anywhere in their row: the interval is that of its edge nearest to the mean, and
    # as much wider as the ridge moves within half a row.
    v = row + 0.5 - shape[i, 1]
    near = min(1.0, max(0.0, abs(v) - 0.5) / shape[i, 6])
    middle = shape[i, 0] + shape[i, 7] * v
    half = shape[i, 8] * np.sqrt(1 - near * near) + 0.5 * abs(shape[i, 7])
    left = max(middle - half, shape[i, 0] - shape[i, 5])
    right = min(middle + half, shape[i, 0] + shape[i, 5])
    first = _left_of(samples, row, left)
    return first, max(first, _left_of(samples, row, right))


@_kernel
def _left_of(samples, row, x):
    """The first of a row's samples, all sorted, that does not lie left of x."""
    low, high = samples.start[row], samples.start[row + 1]
    while low < high:
        between = (low + high) // 2
        if samples.place[between, 0] < x:
            low = between + 1
        else:
            high = between
    return low


@_kernel
def _alpha(samples, i, at):
    """The falloff of the i-th Gaussian at a sample, by linear interpolation."""
    shape, falloff = samples.shape, samples.falloff
    u, v = samples.place[at, 0] - shape[i, 0], samples.place[at, 1] - shape[i, 1]
    across, along = shape[i, 2] * u, shape[i, 3] * u + shape[i, 4] * v
    step = (across * across + along * along) * _STEPS_EACH
    if step >= _TABLE:
        return 0.0
    k = int(step)
    return falloff[k] + (step - k) * (falloff[k + 1] - falloff[k])


_TRANSFER_DECIMALS = 5


# Levels of the canvas for partial sums (docs/decisions/svg.md).
MARGIN = 0.01  # share of the span that is left at either end for the rounding of layers
# Least span of partial sums. A smaller one only magnifies the rounding of renderers.
LEAST_SPAN = 0.1


@dataclass(frozen=True)
class DrawnPhase:
    """Circles that add to some channels and subtract from the others, after inverting some.

    inverted  the colour that inverts channels, "" where none is
    label     what they do, in words
    """

    inverted: str
    label: str
    discs: tuple[Element, ...]


@dataclass(frozen=True)
class EncodedAdditive:
    """The elements of an additive file, and the text of its root, rectangles and filter.

    view        width and height in user units
    background  initial colour of the canvas
    transfer    final slope and intercept of red, green and blue
    """

    view: tuple[str, str]
    background: str
    transfer: Transfer
    ramps: tuple[Element, ...]
    phases: tuple[DrawnPhase, ...]


def encode_additive(scene: Scene, svg_format: SvgFormat) -> EncodedAdditive:
    """Elements of the SVG of an additive scene; they depend on nothing but the two arguments.

    Gaussians whose extent is written as 0 or whose colour as black are left out, as are those off
    the canvas whose numbers are too large (gauss2svg.svg.element.writable, which raises SceneError
    for others). Raises InputError for a form other than gradients.
    """
    check_canvas(scene)
    if svg_format.form != GRADIENT:
        raise InputError(
            f"form must be {GRADIENT!r} for an additive scene, whose blurs cannot be added "
            f"exactly; got {quoted(svg_format.form)}"
        )
    phases, low, high = phases_of(scene)
    largest = np.abs(scene.color).max(axis=0, initial=0.0)
    least = np.maximum(largest, LEAST_SPAN)
    span = np.maximum((1 + 2 * MARGIN) * (high - low), least)
    middle = 0.5 * (low + high)
    scale = WHITE / span  # levels of the canvas for 1 of the picture
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
        color = hex_color(np.where(turn, WHITE, 0)) if turn.any() else ""
        drawn.append(DrawnPhase(color, _label(len(drawn), len(discs), phase), discs))
        inverted = needed

    slope = np.where(inverted, -1, 1) * span
    level = np.where(inverted, WHITE - begin, begin) / WHITE
    intercept = scene.background - slope * level + HALF_WAY / WHITE
    return EncodedAdditive(
        view=view_of(scene, svg_format.precision),
        background=hex_color(np.where(first, WHITE - begin, begin).astype(int)),
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

    def drawn(self, phase: Phase) -> tuple[Element, ...]:
        """Circles of a phase; Gaussians of no extent or colour are none."""
        shown = ((i, self._stops[self._entry[i]]) for i in phase.index.tolist())
        return tuple(
            _circle(self._ids.setdefault(stops, short_id(len(self._ids))), self._matrices[i])
            for i, stops in shown
            if stops and self._matrices[i]
        )

    def ramps(self) -> tuple[Element, ...]:
        """Gradients of all that was drawn."""
        return tuple(
            radial_gradient(
                name,
                [Element("stop", {"offset": at, "stop-color": shade}) for at, shade in stops],
            )
            for stops, name in self._ids.items()
        )


def _circle(ramp: str, matrix: str) -> Element:
    return Element("circle", {"fill": f"url(#{ramp})", "r": "1", "transform": matrix})


def _stops_text(
    offsets: NDArray[np.float64], levels: NDArray[np.intp]
) -> tuple[tuple[str, str], ...]:
    return tuple(
        (number(offset, 3), hex_color(level))
        for offset, level in zip(offsets, levels, strict=False)
    )


def _label(index: int, count: int, phase: Phase) -> str:
    """Label of a phase, such as "Phase 3: 120 Gaussians that add red, green and take blue"."""
    signs = tuple(zip(("red", "green", "blue"), phase.takes, strict=True))
    adds = ", ".join(name for name, taken in signs if not taken)
    takes = ", ".join(name for name, taken in signs if taken)
    one = count == 1
    verbs = ("adds" if one else "add", adds), ("takes" if one else "take", takes)
    does = " and ".join(f"{verb} {names}" for verb, names in verbs if names)
    return f"Phase {index + 1}: {count} Gaussian{'' if one else 's'} that {does}"


_EQUAL = 1e-3
_GRAY = np.array([k ^ (k >> 1) for k in range(8)])


# The order of additive Gaussians (docs/decisions/svg.md).
# Share of a channel that is spared at either end, so that fewer Gaussians wait for each other.
SPARE = 0.02


@dataclass(frozen=True)
class Phase:
    """Gaussians drawn one after the other: the channels they subtract from, and their indices."""

    takes: tuple[bool, bool, bool]
    index: NDArray[np.intp]


def phases_of(
    scene: Scene,
) -> tuple[tuple[Phase, ...], NDArray[np.float64], NDArray[np.float64]]:
    """Phases of an additive scene in drawing order, and lowest and highest value (3,) of a channel.

    Each Gaussian is in one phase. The canvas must hold these values: they include the image
    (gauss2svg.svg.additive.range_of) and all partial sums between and within phases,
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
    phases = tuple(
        _phase(int(pattern[index[0]]), index) for index in np.split(order, ends) if index.size
    )
    lowest = np.tile(scene.background.astype(np.float32), (len(samples.place), 1))
    total, highest = lowest.copy(), lowest.copy()
    for phase in phases:
        add_all(samples, phase.index, total, lowest, highest)
    lowest[lowest > picture - _EQUAL] = np.inf
    highest[highest < picture + _EQUAL] = -np.inf
    low, high = np.minimum(low, lowest.min(axis=0)), np.maximum(high, highest.max(axis=0))
    return phases, low, high


def _phase(signs: int, index: NDArray[np.intp]) -> Phase:
    return Phase((bool(signs & 1), bool(signs & 2), bool(signs & 4)), index)


WHITE = 255
# Levels of 255 that are added in the end: resvg and Chromium truncate a filter's result to whole
# levels (bias -0.5 levels), the others round.
HALF_WAY = 0.25

Transfer = tuple[tuple[str, str], ...]  # slope and intercept of red, green and blue


def key_of(transfer: Transfer, background: str) -> str:
    """End of both ids, so that two additive drawings inline in one page keep their own filter."""
    return f"{zlib.crc32(repr((transfer, background)).encode()):08x}"


def difference_sheet(group: str) -> str:
    """Style sheet by which all within the group of this id is drawn as a difference.

    Under its first rectangle the group is transparent, where a difference draws its source.
    """
    return f"#{group} circle,#{group} rect{{mix-blend-mode:difference}}"


def cover(fill: str, more: Mapping[str, str] | None = None) -> Element:
    """A rectangle over the canvas and beyond, so that the filter maps opaque pixels only.

    The filter region is extended to whole pixels; a rectangle that ends within a pixel would leave
    it half inverted, which the filter makes an opaque line along the edge.
    """
    size = {"width": "120%", "x": "-10%", "y": "-10%"}
    return Element("rect", {"fill": fill, "height": "120%", **(more or {}), **size})


def transfer_filter(transfer: Transfer, name: str) -> Element:
    """The filter that maps channels by slope and intercept, all over the canvas at any size."""
    functions = [
        Element(f"feFunc{channel}", {"intercept": intercept, "slope": slope, "type": "linear"})
        for channel, (slope, intercept) in zip("RGB", transfer, strict=True)
    ]
    region = {"height": "100%", "id": name, "width": "100%", "x": "0", "y": "0"}
    attributes = {"color-interpolation-filters": "sRGB", "filterUnits": "userSpaceOnUse", **region}
    return Element(
        "filter", attributes, [Element("feComponentTransfer", {"in": "SourceGraphic"}, functions)]
    )
