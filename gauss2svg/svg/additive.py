"""Elements of an additive file, which draws the sum of a scene's signed colours.

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
best order (gauss2svg.svg.headroom) the partial sums are .3 to .8. So 1 / s is .5, or .51 with a
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
gauss2svg.svg.headroom finds an order of the Gaussians that allows a large s_c. gauss2svg.svg.stops
finds stops whose colours need little rounding. The gradients have no focal offset (fx), because it
would change nothing here (docs/decisions/svg.md).

Gaussians are drawn in phases. While a channel is inverted, colours can only be added to it. While
it is not inverted, they can only be subtracted. So the Gaussians of a phase have the same signs. In
a tour, the eight patterns of signs follow each other in the order of a Gray code, so only one
channel is inverted at a time. The order of the Gaussians does not change their sum. So a Gaussian
can wait for a later tour, until the canvas can hold its sum. If no Gaussian fits, the one that
exceeds the range least is drawn.

The range is also checked between pixels (gauss2svg.svg.headroom), so that a file can be drawn at
any size. If a value is clipped in the end, its sum may exceed the range of the canvas and fold back
(gauss2svg.svg.headroom.phases_of). This allows a larger scale (docs/decisions/svg.md).

    <style>#additive-1a2b3c4d circle,#additive-1a2b3c4d rect{mix-blend-mode:difference}</style>
    <g id="additive-1a2b3c4d" filter="url(#transfer-1a2b3c4d)"> <rect fill="#.."/>
      <g> <circle r="1" transform="matrix(..)" fill="url(#..)"/> ... </g> <rect fill="#f00"/> ...
"""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius
from gauss2svg.svg import SvgFormat
from gauss2svg.svg.element import Element, hex_color, number, short_id
from gauss2svg.svg.encode import Drawing, layer, matrices_of, radial_gradient, sides_of
from gauss2svg.svg.headroom import phases_of
from gauss2svg.svg.stops import Floats, whole_stops

Ramp = Sequence[tuple[str, str]]  # offset and colour of each stop of a gradient
WHITE = 255
# The filter adds this number of levels of 255 to its result. resvg and Chromium truncate the result
# to whole levels, so 0.5 would be best for them. The other renderers round it, so 0 would be best
# for them. This number is halfway between those two.
HALF_WAY = 0.25
# The canvas must hold the range of the partial sums (docs/decisions/svg.md). The range is extended
# at each end by this share of its span, because the rounding of layers may push a sum out of it.
MARGIN = 0.01
# The smallest span of the range. At this span, an error of one level on the canvas is only a tenth
# of a level in the picture, so a smaller span would not make the picture better.
LEAST_SPAN = 0.1


def encode_additive(scene: Scene, svg_format: SvgFormat) -> Drawing:
    """Return the drawing of an additive scene. Equal arguments always give the same drawing.

    A Gaussian is left out if its extent is written as 0, or its colour as black. It is also left
    out if it is off the canvas and its numbers are too large for a file. Raise SceneError if a
    visible Gaussian has such numbers (gauss2svg.svg.element.writable).
    """
    phases, low, high = phases_of(scene)
    largest = np.abs(scene.color).max(axis=0, initial=0.0)
    span = np.maximum((1 + 2 * MARGIN) * (high - low), np.maximum(largest, LEAST_SPAN))
    scale = WHITE / span  # number of levels on the canvas that stand for 1 in the picture
    background_level = np.round(scale * (scene.background - 0.5 * (low + high) + 0.5 * span))

    ramps, reach = _ramps(scene, scale, svg_format.stops)
    matrices = matrices_of(scene, float(cut_radius(1.0)) * reach, svg_format.precision)
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
            groups.append(_cover(hex_color(np.where(inverts, WHITE, 0))))
        groups.append(layer(_label(index, len(discs), adds), discs, id=f"phase-{index}"))
        inverted = adds
    slope = np.where(inverted, -1, 1) * span
    level = np.where(inverted, WHITE - background_level, background_level) / WHITE
    intercept = scene.background - slope * level + HALF_WAY / WHITE
    transfer = tuple((number(s, 5), number(i, 5)) for s, i in zip(slope, intercept, strict=True))
    background = hex_color(np.where(first, WHITE - background_level, background_level).astype(int))
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
    view = sides_of(scene, svg_format.precision, 6)
    return Drawing(view, sum(map(len, shown)), definitions, body, sheet)


def _ramps(scene: Scene, scale: Floats, count: int) -> tuple[list[Ramp], Floats]:
    """Return the stops of each Gaussian, and its radius (n,) as a share 0..1 of the full radius.

    If several stops at the end of a gradient are black, the gradient and its circle end at the
    first of these stops. In a scene of 8000 Gaussians this reduces the area that they cover by a
    sixth. A Gaussian whose stops are all black has the stops ().
    """
    color, entry = np.unique(np.abs(scene.color), axis=0, return_inverse=True)
    offsets, levels = whole_stops(scale * color, count)
    # For each gradient, the number of its stops up to the last one that is not black.
    before = np.where(levels.any(axis=2), np.arange(1, count + 1), 0).max(axis=1)
    reach = offsets[np.arange(len(color)), before]
    ramps = []
    for at, shades, last, end in zip(offsets, levels, before, reach, strict=True):
        stops = zip(at[: last + 1] / end, shades, strict=False)
        ramps.append(tuple((number(o, 3), hex_color(c)) for o, c in stops) if last else ())
    entry = entry.reshape(-1)
    return [ramps[k] for k in entry], reach[entry]


def _label(index: int, count: int, adds: NDArray[np.bool_]) -> str:
    """Return a label such as "Phase 3: 120 Gaussians that add red, green and take blue"."""
    verbs = ("adds", "takes") if count == 1 else ("add", "take")
    channels = [np.array(["red", "green", "blue"])[which] for which in (adds, ~adds)]
    does = [f"{verb} {', '.join(c)}" for verb, c in zip(verbs, channels, strict=True) if len(c)]
    return f"Phase {index}: {count} Gaussian{'s' * (count > 1)} that {' and '.join(does)}"


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
