"""The elements of a minimal file: soft shapes under masks or gradients, plain ellipses as arcs.

Up to MOST_MASKED soft shapes share one masked circle for each exponent, so that a colour costs a
few bytes; the stops of its mask are greys, whose luminance is the falloff:

    <radialGradient id="c" gradientUnits="userSpaceOnUse" cx="0" cy="0" r="1"> <stop .../> ..
    <mask id="b"><circle r="1" fill="url(#c)"/></mask><circle id="a" r="1" mask="url(#b)"/>

Of more, renderers round every mask to 8 bits and take long, so that each colour has a gradient. It
takes its geometry from one of its exponent, and the opacities of stops from a style sheet:

    <style>[href="#a"] stop{stop-color:currentColor;stop-opacity:.99}[href="#a"] stop+stop{..}..
    <radialGradient id="b" href="#a" color="#abc"><stop offset=".066"/> ..
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from gauss2svg.scene.falloff import BETA_CLASSES
from gauss2svg.svg.arcs import path_data
from gauss2svg.svg.encode import hex_color, number, short_id
from gauss2svg.svg.levels import grey_stops
from gauss2svg.svg.minimal_shapes import Shapes
from gauss2svg.svg.stops import gradient_stops

# docs/decisions/minimal.md has what more masks cost, and what two stops more are worth.
MOST_MASKED = 500
_FEW_STOPS, _STOPS, _MANY = 3, 5, 60
# Without userSpaceOnUse librsvg 2.54 loses shapes under a rotation.
_UNIT_DISC = ' gradientUnits="userSpaceOnUse" cx="0" cy="0" r="1"'
# The circle of an exponent from this one on is larger than its gradient, whose rim its own edge
# would clip (gauss2svg.svg.encode).
_CLIPPED_FROM, _CLEAR = 6.0, "1.1"


@dataclass(frozen=True)
class _Element:
    """One shape: the start of its tag, its fill and opacity, and its place, all as text.

    fill, opacity are attributes, or ""
    """

    tag: str
    fill: str
    opacity: str
    place: str

    def text(self, fill: str) -> str:
        return f"<{self.tag}{fill}{self.opacity}{self.place}/>"


def drawing(shapes: Shapes, opacity_decimals: int, stops: int | None) -> tuple[str, str]:
    """Definitions, and all shapes; stops is None for masks, or the number of a gradient's."""
    name = "opacity" if stops is None else "fill-opacity"
    opacity = [_attribute(name, number(o, opacity_decimals), "1") for o in shapes.opacity]
    fills = [fill_of(levels) for levels in shapes.levels]
    if stops is None:
        definitions, tags = _masked(shapes)
    else:
        definitions, tags, fills = _gradients(shapes, fills, stops)
    elements = []
    plain = zip(shapes.falloff < 0, fills, opacity, strict=True)
    # Opaque ellipses of one colour are one path; of others each is blended by itself.
    for _, run in groupby(enumerate(plain), lambda at: at if at[1][2] or not at[1][0] else at[1]):
        index = [i for i, _ in run]
        i = index[0]
        if shapes.falloff[i] < 0:
            place = f' d="{path_data(shapes.numbers[index])}"'
            elements.append(_Element("path", fills[i], opacity[i], place))
        else:
            tag = tags[int(shapes.falloff[i])]
            elements.append(_Element(tag, fills[i], opacity[i], _transform(shapes.numbers[i])))
    if stops is None:
        templates, elements = _shared(elements, len(tags) * 3)
        definitions += templates
    return f"<defs>{definitions}</defs>" if definitions else "", _grouped(elements)


def fill_of(levels: NDArray[np.intp], name: str = "fill") -> str:
    """The attribute of a colour in levels (3,) of 255; black is the default."""
    return _attribute(name, hex_color(levels), "#000")


def _attribute(name: str, value: str, default: str) -> str:
    return "" if value == default else f' {name}="{value}"'


def _kinds(shapes: Shapes) -> list[int]:
    """Exponents of the soft shapes, those that are used most first."""
    kinds, uses = np.unique(shapes.falloff[shapes.falloff >= 0], return_counts=True)
    return kinds[np.argsort(-uses, kind="stable")].tolist()


def _masked(shapes: Shapes) -> tuple[str, dict[int, str]]:
    """A masked circle for each exponent, of the first ids, and tags by exponent."""
    kinds = _kinds(shapes)
    count = _STOPS if np.count_nonzero(shapes.falloff >= 0) >= _MANY else _FEW_STOPS
    tags, texts = {}, []
    for k, kind in enumerate(kinds):
        name, mask, ramp = (short_id(k + part * len(kinds)) for part in range(3))
        tags[kind] = f'use href="#{name}"'
        stops = "".join(
            f'<stop offset="{number(o, 3)}"{fill_of(np.full(3, 17 * grey), "stop-color")}/>'
            for o, grey in zip(*grey_stops(count, BETA_CLASSES[kind]), strict=True)
        )
        circle = f' r="{_circle(kind)}"'
        disc = f' href="#{short_id(2 * len(kinds))}"' if k else _UNIT_DISC  # of the first
        texts.append(
            f'<radialGradient id="{ramp}"{disc}>{stops}</radialGradient>'
            f'<mask id="{mask}"><circle{circle} fill="url(#{ramp})"/></mask>'
            f'<circle id="{name}"{circle} mask="url(#{mask})"/>'
        )
    return "".join(texts), tags


def _gradients(
    shapes: Shapes, fills: list[str], stops: int
) -> tuple[str, dict[int, str], list[str]]:
    """A gradient for each exponent and colour; tags by exponent, fills of all shapes."""
    kinds = _kinds(shapes)
    tags = {kind: f'circle r="{_circle(kind)}"' for kind in kinds}
    rules, texts, first, ramps = [], [], {}, {}
    for k, kind in enumerate(kinds):
        name = first[kind] = short_id(k)
        offsets, values = gradient_stops(stops, BETA_CLASSES[kind])
        for at, value in enumerate(values):
            color = "" if at else "stop-color:currentColor;"
            stop = "+".join(["stop"] * (at + 1))
            rules.append(f'[href="#{name}"] {stop}{{{color}stop-opacity:{number(value, 3)}}}')
        # fx moves resvg to its accurate gradient.
        texts.append(f'<radialGradient id="{name}"{_UNIT_DISC} fx=".001"/>')
        ramps[kind] = "".join(f'<stop offset="{number(o, 4)}"/>' for o in offsets)
    pairs = zip(shapes.falloff.tolist(), fills, strict=True)
    keys = [pair if pair[0] >= 0 else None for pair in pairs]
    uses = Counter(key for key in keys if key is not None)
    ids = {}
    for k, ((kind, fill), _) in enumerate(uses.most_common()):
        ids[kind, fill] = name = short_id(len(kinds) + k)
        color = fill.replace(" fill=", " color=") or ' color="#000"'
        texts.append(f'<radialGradient id="{name}" href="#{first[kind]}"{color}>')
        texts.append(ramps[kind] + "</radialGradient>")
    drawn = [
        fill if key is None else f' fill="url(#{ids[key]})"'
        for key, fill in zip(keys, fills, strict=True)
    ]
    return f"<style>{''.join(rules)}</style>" + "".join(texts), tags, drawn


def _circle(kind: int) -> str:
    return _CLEAR if BETA_CLASSES[kind] >= _CLIPPED_FROM else "1"


def _transform(matrix: NDArray[np.float64]) -> str:
    a, b, d, e, f = (number(v, 0) for v in matrix)
    return f' transform="matrix({a} {b} 0 {d} {e} {f})"'.replace(" -", "-")


def _shared(elements: list[_Element], used: int) -> tuple[str, list[_Element]]:
    """Definitions of common fills and opacities where these make the file shorter.

    used  how many ids there are already
    """
    texts = []
    for attributes in (lambda e: e.fill + e.opacity, lambda e: e.opacity):
        keys = [(e.tag, attributes(e)) for e in elements]
        ids = {}
        for (tag, shared), uses in Counter(keys).most_common():
            name = short_id(used + len(texts))
            kind, _, rest = tag.partition(" ")
            definition = f'<{kind} id="{name}" {rest}{shared}/>'
            # The tag that takes the definition's place.
            longer = len(f'use href="#{name}"') - len(tag)
            if rest and shared and uses * (len(shared) - longer) > len(definition):
                ids[tag, shared] = name
                texts.append(definition)
        elements = [
            replace(
                e, tag=f'use href="#{ids[key]}"', opacity="", fill=e.fill * (key[1] == e.opacity)
            )
            if key in ids
            else e
            for e, key in zip(elements, keys, strict=True)
        ]
    return "".join(texts), elements


def _grouped(elements: list[_Element]) -> str:
    """All elements, consecutive ones of one fill in a group where that is shorter."""
    texts = []
    for fill, run in groupby(elements, key=lambda e: e.fill):
        inside = list(run)
        if len(fill) * (len(inside) - 1) > len("<g></g>"):
            texts += [f"<g{fill}>", *(e.text("") for e in inside), "</g>"]
        else:
            texts += [e.text(fill) for e in inside]
    return "".join(texts)
