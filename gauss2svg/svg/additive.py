"""Additive files. Such a file draws the sum of a scene's signed colours.

Under mix-blend-mode: difference, a colour d that is drawn over a value v gives |v - d|. While the
file is drawn, the canvas holds s_c (P + o_c), where P is the sum of the Gaussians drawn so far. The
scale s_c and the offset o_c of each channel keep all these partial sums in 0..1. So a colour that
is drawn is subtracted. To add a colour, the file first inverts the channel, by drawing the channel
at full intensity. A Gaussian is a circle with an opaque gradient from its absolute colour to black.
Black changes nothing. In the end, a filter on the whole group maps the canvas back to the image:

    image = P = background + slope (v - v_0),   slope = +-1 / s_c.

Here v is a value of the canvas, and v_0 is the value of the background as the file has it, so that
the rounding of the background shifts nothing. Values outside of 0..1 are clipped, as they are in
the scene.

An example: three grey Gaussians of +.3, +.4 and -.5 are at one place, on a background of .5. In the
best order the partial sums are .3 to .8. So 1 / s is .5, or .51 with a
margin. The canvas begins inverted, because the first Gaussian is added:

    drawn                      sum at the mean      canvas
    rect #999, the background  .5                   .6
    circle, .3 s = .588        .8                   .012   |.6 - .588|
    rect #fff                                       .988   inverted back
    circle, .5 s = .980        .3                   .008   |.988 - .980|
    rect #fff                                       .992   inverted again
    circle, .4 s = .784        .7                   .208   |.992 - .784|
    filter                     .7 = .807 - .51 * .208

The canvas is rounded to 8 bits after each layer, so a file with a larger s_c is more accurate.
`phases_of` finds an order of the Gaussians that allows a large s_c. `forms.whole_stops` finds stops
whose colours need little rounding. The gradients have no focal offset (fx), because it would change
nothing here (docs/decisions/svg.md).

Gaussians are drawn in phases. While a channel is inverted, colours can only be added to it. While
it is not inverted, they can only be subtracted. So the Gaussians of a phase have the same signs. In
a tour, the eight patterns of signs follow each other in the order of a Gray code, so only one
channel is inverted at a time. The order of the Gaussians does not change their sum. So a Gaussian
can wait for a later tour, until the canvas can hold its sum. If no Gaussian fits, the one that
exceeds the range least is drawn.

The range of the canvas includes at least the background and the image. In the example, the excess
of a Gaussian is how far the sum would be outside of the range .5 to .7 if it were drawn next:

    sum     excess of +.3, +.4, -.5    drawn next
    .5      .1, .2, .5                 +.3, because all exceed the range, and +.3 by the least
    .8          .5, .2                 -.5, because its excess is less than that of +.4
    .3          0                      +.4, and then the sum is the image

In another order the sums would be .5 to 1.2. On such a canvas all values would be rounded more
coarsely.

Sums are checked at samples, also between pixels, so that a file can be drawn at any size. These are
the centres of the cells of a grid, and the means of all Gaussians, because a thin Gaussian may peak
between two centres. Samples are sorted by the row of the grid in which they lie, and then by x.
Kernels visit the samples that a Gaussian reaches, and store nothing for each Gaussian. So the
memory depends only on the number of samples. If a value is clipped in the end, its sum may exceed
the range of the canvas and fold back (`phases_of`). This allows a larger scale
(docs/decisions/svg.md).

    <style>#additive-1a2b3c4d circle,#additive-1a2b3c4d rect{mix-blend-mode:difference}</style>
    <g id="additive-1a2b3c4d" filter="url(#transfer-1a2b3c4d)"> <rect fill="#.."/>
      <g> <circle r="1" transform="matrix(..)" fill="url(#..)"/> ... </g> <rect fill="#f00"/> ...
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from gauss2svg.core import Kernel
from gauss2svg.errors import several
from gauss2svg.scene import Scene, whitening_of
from gauss2svg.scene.falloff import RADIUS, profile
from gauss2svg.svg import Document, SvgFormat
from gauss2svg.svg.element import Element, Floats, hex_color, number, short_id
from gauss2svg.svg.encode import document_svg, layer, matrices_of, radial_gradient
from gauss2svg.svg.forms import Ints, whole_stops

Ramp = Sequence[tuple[str, str]]  # offset and colour of each stop of a gradient
_ANY = 1e300  # larger than the excess of any Gaussian
_draw_gaussians = Kernel(
    "draw_gaussians",
    "int float float32 int64 float64 float64 float64 float64 float64 float32 float64 float64 int"
    " int64 float bool float32 float32 float32",
)


def additive_svg(scene: Scene, svg_format: SvgFormat, document: Document) -> str:
    """Return the file of an additive scene. Equal arguments always give the same text.

    A Gaussian is left out if its extent is written as 0, or its colour as black. Raise SceneError
    if a Gaussian or the canvas is too large for a file.
    """
    phases, low, high = phases_of(scene)
    largest = np.abs(scene.color).max(axis=0, initial=0.0)
    # The range is extended at each end by a hundredth of its span, because the rounding of layers
    # may push a sum out of it. At a span of 0.1, an error of one level on the canvas is only a
    # tenth of a level in the picture.
    span = np.maximum(1.02 * (high - low), np.maximum(largest, 0.1))
    scale = 255 / span  # number of levels on the canvas that stand for 1 in the picture
    background_level = np.round(scale * (scene.background - 0.5 * (low + high) + 0.5 * span))

    ramps = _ramps(scene, scale, svg_format.stops)
    matrices = matrices_of(scene, np.full(len(scene), RADIUS), svg_format.precision)
    # For each phase, the indices of its Gaussians that are written. A phase in which no Gaussian is
    # written is left out.
    shown = ([i for i in phase.tolist() if ramps[i] and matrices[i]] for phase in phases)
    shown = list(filter(None, shown))
    inverted = first = scene.color[shown[0][0]] >= 0 if shown else np.zeros(3, bool)
    ids, groups = dict[Ramp, str](), list[Element]()
    for index, phase in enumerate(shown, 1):
        adds, discs = scene.color[phase[0]] >= 0, list[Element]()
        for i in phase:
            fill = f"url(#{ids.setdefault(ramps[i], short_id(len(ids)))})"
            discs.append(Element("circle", fill=fill, r="1", transform=matrices[i]))
        if (inverts := adds ^ inverted).any():
            # Between two phases, a rectangle inverts the channels whose sign changes. It is in no
            # layer of a phase, so that it stays visible if someone hides such a layer.
            groups.append(_cover(hex_color(np.where(inverts, 255, 0))))
        label = f"Phase {index}: {several(len(discs), 'Gaussian')}"
        groups.append(layer(label, discs, id=f"phase-{index}"))
        inverted = adds
    slope = np.where(inverted, -1, 1) * span
    level = np.where(inverted, 255 - background_level, background_level) / 255
    # A quarter of a level is halfway between what suits resvg and Chromium, which truncate the
    # result of the filter to whole levels, and the other renderers, which round it.
    intercept = scene.background - slope * level + 0.25 / 255
    transfer = tuple((number(s, 5), number(i, 5)) for s, i in zip(slope, intercept, strict=True))
    background = hex_color(np.where(first, 255 - background_level, background_level))
    # Because of the key, two additive drawings in one page have different ids. Ids with a key
    # are longer than the ids of gradients, so the two kinds of ids cannot be equal.
    key = f"{zlib.crc32(repr((transfer, background)).encode()):08x}"
    group = f"additive-{key}"
    inside = [_cover(background, "background"), *groups]
    definitions = [_transfer_filter(transfer, f"transfer-{key}")]
    for ramp, name in ids.items():
        stops = [Element("stop", offset=at, stop_color=color) for at, color in ramp]
        definitions.append(radial_gradient(name, stops))
    body = [layer("Additive", inside, id=group, filter=f"url(#transfer-{key})")]
    # The group is transparent at first. A colour that is drawn on a transparent canvas stays as it
    # is in spite of the blend mode. So the first rectangle, which is the background, appears in its
    # own colour.
    sheet = f"#{group} circle,#{group} rect{{mix-blend-mode:difference}}"
    count = {"gaussians": sum(map(len, shown)), "precision": svg_format.precision}
    return document_svg(scene, document, body, definitions, sheet, **count)


def _ramps(scene: Scene, scale: Floats, count: int) -> list[Ramp]:
    """Return the stops of each Gaussian, or () if all of them are black."""
    color, entry = np.unique(np.abs(scene.color), axis=0, return_inverse=True)
    offsets, levels = whole_stops(scale * color, count)
    ramps = [
        tuple((number(o, 3), hex_color(c)) for o, c in zip(at, shades, strict=True))
        for at, shades in zip(offsets, levels, strict=True)
    ]
    return [ramps[k] if levels[k].any() else () for k in entry.reshape(-1)]


def _cover(fill: str, key: str | None = None) -> Element:
    """Return a rectangle that extends beyond the canvas, so that it covers whole pixels.

    If the rectangle ended at the edge of the canvas, it could cover only a part of each pixel
    there. An additive file applies a filter (`_transfer_filter`) to what it has drawn. Renderers
    extend the region of this filter to whole pixels, so the filter would turn the pixels at the
    edge into an opaque line.
    """
    return Element("rect", fill=fill, height="120%", id=key, width="120%", x="-10%", y="-10%")


def _transfer_filter(transfer: Iterable[tuple[str, str]], name: str) -> Element:
    """Return a filter over the whole canvas that maps each channel by a linear function.

    transfer  slope and intercept of the function of each channel, as texts
    """
    functions = [
        Element(f"feFunc{channel}", intercept=intercept, slope=slope, type="linear")
        for channel, (slope, intercept) in zip("RGB", transfer, strict=True)
    ]
    step = Element("feComponentTransfer", functions, **{"in": "SourceGraphic"})
    kind = {"color-interpolation-filters": "sRGB", "filterUnits": "userSpaceOnUse"}
    region = {"height": "100%", "id": name, "width": "100%", "x": "0", "y": "0"}
    return Element("filter", [step], **kind, **region)


def phases_of(scene: Scene) -> tuple[list[Ints], Floats, Floats]:
    """Return the phases of an additive scene, and the range of values that its canvas must hold.

    A phase has the indices of Gaussians whose colours have the same signs. The phases are in the
    order in which they are drawn, and each Gaussian is in one phase.

    The range is given by the lowest values (3,) and the highest values (3,) of the channels. It
    contains the background, and all values of the image that are in 0..1. It also contains the
    partial sums, which are the sums after each Gaussian. A partial sum may be outside of the range
    only where the image is at least as far outside.

    If a value v of the image is above the highest value h, the canvas shows 2 h - v. This is called
    folding. Folding does no harm if 2 h - v is at least 1, because v and 2 h - v are then both
    clipped to 1 in the end. So h need only be halfway between 1 and the largest v of the image. In
    the same way, if the smallest v is below 0, the lowest value of the range need only be halfway
    between 0 and this v.
    """
    samples = _samples_of(scene)
    background, every = scene.background, np.arange(len(scene))
    total = np.tile(background.astype(np.float32), (len(samples[2]), 1))
    lowest, highest, picture = total.copy(), total.copy(), total.copy()
    is_drawn, free = np.zeros(len(scene), bool), np.full(3, np.inf)
    every_one = len(scene), every, _ANY, is_drawn
    _draw_gaussians(*samples, picture, -free, free, *every_one, picture, picture, picture)
    low, high = picture.min(axis=0).astype(np.float64), picture.max(axis=0).astype(np.float64)
    low = np.minimum(background, np.where(low < 0, 0.5 * low, low))
    high = np.maximum(background, np.where(high > 1, 0.5 * (1 + high), high))
    pattern = (scene.color < 0) @ [1, 2, 4]
    mass = np.abs(scene.color).max(axis=1) * scene.sigma.prod(axis=1)
    by_mass = np.argsort(-mass, kind="stable")
    is_drawn[:] = False
    # More Gaussians stay within a range that is a little larger, so fewer are put off until later.
    allowed = picture, low - 0.02, high + 0.02

    def draw(indices: Ints, enough: float) -> int:
        """Draw those whose excess is below `enough`, or return the one of least excess for inf."""
        chosen = len(indices), indices, enough, is_drawn
        return _draw_gaussians(*samples, *allowed, *chosen, total, lowest, highest)

    # A tour visits all patterns of signs, one after the other. At each pattern, it draws those
    # Gaussians with which the totals stay in the range. If a tour draws none, the Gaussian that
    # exceeds the range least is drawn. A smaller excess than `rounding` may be due to float32.
    rounding, parts, waiting = 1e-4, [by_mass[:0]], by_mass
    patterns = np.arange(8) ^ (np.arange(8) >> 1)  # a Gray code: each step changes only one sign
    while waiting.size:
        before = len(parts)
        for signs in patterns:
            tried = waiting[pattern[waiting] == signs]
            if draw(tried, rounding):
                parts.append(tried[is_drawn[tried]])
        if len(parts) == before:
            parts.append(np.array([draw(waiting, np.inf)]))
            draw(parts[-1], _ANY)
        waiting = waiting[~is_drawn[waiting]]
        # Each change of the pattern inverts channels of the canvas. The next tour visits the
        # patterns in reverse order, so nothing is inverted between the two tours.
        patterns = patterns[::-1]
    order = np.concatenate(parts)
    # A partial sum that exceeds the image at the same sample by less than this is not out of range.
    lowest[lowest > picture - 1e-3] = np.inf
    highest[highest < picture + 1e-3] = -np.inf
    low, high = np.minimum(low, lowest.min(axis=0)), np.maximum(high, highest.max(axis=0))
    return np.split(order, np.flatnonzero(np.diff(pattern[order])) + 1), low, high


def _samples_of(scene: Scene) -> tuple[Any, ...]:
    """Return the first arguments of the kernel: the samples, and the Gaussians of a scene.

    The unit of length is a cell of the grid. The arguments are the number of rows, the radius of a
    Gaussian in sigmas, x and y (m, 2) of the samples, and the index of the first sample of each row
    and of the end. Then come the falloff in steps of the squared radius, and the Gaussians' means
    (n, 2), whitening (n, 3), reaches in x and in y (n, 2) and colours (n, 3).
    """
    canvas = np.array([scene.width, scene.height])
    touched = float(np.minimum(2 * RADIUS * scene.sigma, canvas).prod(axis=1).sum())
    # There are at most 4 samples per px and 1536 along a side. Wide Gaussians reach many samples,
    # so their grid is coarser, which is exact enough for them (docs/decisions/svg.md).
    factor = min(4.0, 1536 / canvas.max(), np.sqrt(3e7 / max(1.0, touched)))
    size = np.maximum(1, np.ceil(factor * canvas)).astype(int)
    mean, sigma = scene.mean * (size / canvas), scene.sigma * (size / canvas)
    y, x = np.mgrid[: size[1], : size[0]] + 0.5
    within = ((mean >= 0) & (mean < size)).all(axis=1)
    place = np.concatenate([np.stack([x, y], axis=-1).reshape(-1, 2), mean[within]])
    key = size[0] * np.floor(place[:, 1]) + place[:, 0]
    order = np.argsort(key, kind="stable")
    start = np.searchsorted(key[order], size[0] * np.arange(size[1] + 1))
    falloff = profile(RADIUS * np.sqrt(np.arange(4097) / 4096), 1.0)  # STEPS of core/headroom.c
    gaussians = mean, whitening_of(sigma, scene.rho), RADIUS * sigma, scene.color.copy()
    place = place[order].astype(np.float32)
    return len(start) - 1, RADIUS, place, start, falloff, *gaussians
