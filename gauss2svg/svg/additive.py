"""Elements of an additive file, which draws the sum of a scene's signed colours.

Under mix-blend-mode: difference a colour d over v gives |v - d|. The canvas holds s_c (P + o_c) for
a partial sum P. The scale s_c and the offset o_c of each channel keep all partial sums in 0..1. So
the difference subtracts a colour. To add a colour, the file first inverts the channel, by drawing
the channel at full intensity. A Gaussian is a circle with an opaque gradient from its absolute
colour to black. Black changes nothing. A filter on the whole group maps the canvas back,

    image = P = background + slope (v - v_0),   slope = +-1 / s_c,

where v_0 is the background as the file has it, so that its rounding shifts nothing. Values outside
0..1 are clipped, as in the scene.

An example: three grey Gaussians of +.3, +.4 and -.5 at one place, on a background of .5. In the
best order (gauss2svg.svg.headroom) the sums are .3 to .8, so 1 / s is .5, or .51 with a margin. The
canvas begins inverted, because the first Gaussian adds:

    drawn                      sum at the mean      canvas
    rect #999, the background  .5                   .6
    circle, .3 s = .588        .8                   .012   |.6 - .588|
    rect #fff                                       .988   inverted back
    circle, .5 s = .980        .3                   .008   |.988 - .980|
    rect #fff                                       .992   inverted again
    circle, .4 s = .784        .7                   .208   |.992 - .784|
    filter                     .7 = .807 - .51 * .208

Every layer rounds to 8 bits, so a larger s_c is more accurate. gauss2svg.svg.headroom finds an
order that allows a large s_c, and gauss2svg.svg.stops finds stops with little rounding. A focal
offset (fx of a gradient) would change nothing here (docs/decisions/svg.md).

Gaussians are drawn in phases. While a channel is inverted, colours can only be added to it, and
otherwise only subtracted. So Gaussians with the same signs form a phase. Patterns of signs follow
each other in the order of a Gray code, which inverts one channel at a time. Additive blending is
commutative, so a Gaussian can wait for a later tour through the patterns, until the canvas can hold
its sum. If no Gaussian fits, the one that exceeds the range least is drawn.

The range is checked between the pixels as well (gauss2svg.svg.headroom), so that a file can be
drawn at any size. Values that are clipped in the end may fold on the canvas
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
# Levels of 255 that the filter adds. resvg and Chromium truncate its result to whole levels, which
# needs 0.5 levels, and the other renderers round it, which needs none.
HALF_WAY = 0.25
# Range of partial sums on the canvas (docs/decisions/svg.md).
MARGIN = 0.01  # share of the span that is left at either end for the rounding of layers
# Least span of partial sums. A smaller span would only magnify the rounding of renderers.
LEAST_SPAN = 0.1


def encode_additive(scene: Scene, svg_format: SvgFormat) -> Drawing:
    """Return the drawing of an additive scene. It depends only on the two arguments.

    Gaussians are left out if their extent is written as 0 or their colour as black. So are
    Gaussians off the canvas whose numbers are too large for a file. Raise SceneError for visible
    Gaussians with such numbers (gauss2svg.svg.element.writable).
    """
    phases, low, high = phases_of(scene)
    largest = np.abs(scene.color).max(axis=0, initial=0.0)
    span = np.maximum((1 + 2 * MARGIN) * (high - low), np.maximum(largest, LEAST_SPAN))
    scale = WHITE / span  # levels of the canvas for a difference of 1 in the picture
    background_level = np.round(scale * (scene.background - 0.5 * (low + high) + 0.5 * span))

    ramps, reach = _ramps(scene, scale, svg_format.stops)
    matrices = matrices_of(scene, float(cut_radius(1.0)) * reach, svg_format.precision)
    # Indices of the written Gaussians, by phase. Empty phases are left out.
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
            # The inversion is outside the layers, so that it stays if a layer is hidden.
            groups.append(_cover(hex_color(np.where(inverts, WHITE, 0))))
        groups.append(layer(_label(index, len(discs), adds), discs, id=f"phase-{index}"))
        inverted = adds
    slope = np.where(inverted, -1, 1) * span
    level = np.where(inverted, WHITE - background_level, background_level) / WHITE
    intercept = scene.background - slope * level + HALF_WAY / WHITE
    transfer = tuple((number(s, 5), number(i, 5)) for s, i in zip(slope, intercept, strict=True))
    background = hex_color(np.where(first, WHITE - background_level, background_level).astype(int))
    # The key makes the ids of two additive drawings in one page differ. Ids with a key are longer
    # than ids of gradients, so the two kinds cannot collide.
    key = f"{zlib.crc32(repr((transfer, background)).encode()):08x}"
    group = f"additive-{key}"
    inside = [_cover(background, "background"), *groups]
    definitions = [_transfer_filter(transfer, f"transfer-{key}")]
    for ramp, name in ids.items():
        stops = [Element("stop", offset=at, stop_color=color) for at, color in ramp]
        definitions.append(radial_gradient(name, stops))
    body = [layer("Additive", inside, id=group, filter=f"url(#transfer-{key})")]
    # The group is transparent at first, so the difference draws its first rectangle unchanged.
    sheet = f"#{group} circle,#{group} rect{{mix-blend-mode:difference}}"
    view = sides_of(scene, svg_format.precision, 6)
    return Drawing(view, sum(map(len, shown)), definitions, body, sheet)


def _ramps(scene: Scene, scale: Floats, count: int) -> tuple[list[Ramp], Floats]:
    """Return each Gaussian's stops, () if it is black, and its radius (n,) as a share, 0..1.

    A gradient and its circle end at the first of the trailing black stops, at a share of the full
    radius. That saves a sixth of the area that 8000 Gaussians cover.
    """
    color, entry = np.unique(np.abs(scene.color), axis=0, return_inverse=True)
    offsets, levels = whole_stops(scale * color, count)
    # Number of stops before the trailing black ones.
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
    """Return a rectangle over the canvas and beyond, so that the filter maps opaque pixels only.

    Renderers extend the filter's region to whole pixels. A rectangle that ends within pixels would
    invert them in part, and the filter would make these pixels an opaque line along the edge.
    """
    return Element("rect", fill=fill, height="120%", id=key, width="120%", x="-10%", y="-10%")


def _transfer_filter(transfer: Iterable[tuple[str, str]], name: str) -> Element:
    """Return the filter that maps channels by slope and intercept, on the whole canvas."""
    functions = [
        Element(f"feFunc{channel}", intercept=intercept, slope=slope, type="linear")
        for channel, (slope, intercept) in zip("RGB", transfer, strict=True)
    ]
    step = Element("feComponentTransfer", functions, **{"in": "SourceGraphic"})
    kind = {"color-interpolation-filters": "sRGB", "filterUnits": "userSpaceOnUse"}
    region = {"height": "100%", "id": name, "width": "100%", "x": "0", "y": "0"}
    return Element("filter", [step], **kind, **region)
