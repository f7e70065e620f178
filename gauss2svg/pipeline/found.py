"""Changes to the areas that were found in a picture: equal colours, inks, and areas of a film.

Nearly equal colours become one.

In inks, the nearest ink of each pixel would be a third ink along many edges, because antialiased
pixels mix two colours. So the areas of a drawing get their nearest inks, gradients become bands of
inks, and the picture that is drawn so has crisp edges between inks. Areas are then found in that
picture:

    picture -> areas -> picture in inks -> areas in inks

In a film, the areas of each frame are found anew, because things move, turn, appear and hide each
other. An area of the frame before takes the place of the new one that it matches best, if the
picture then has hardly more error. So what does not move has the same numbers in each frame.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.areas.pixels import Sprite
from gauss2svg.render import render, render_rgba
from gauss2svg.scene import Scene
from gauss2svg.scene.areas import MOST_STOPS, Area, Color, LinearGradient, Paint, RadialGradient
from gauss2svg.scene.inks import ink_colors
from gauss2svg.without_scipy import nearest_entry

if TYPE_CHECKING:
    from gauss2svg.areas.find import FoundAreas

# Levels of 255 by which colours of areas may differ that become one. In a picture with noise, it is
# OFF divided by the root of the smaller one's px, within NEARLY_EQUAL (docs/decisions/areas.md).
EQUAL, NEARLY_EQUAL, OFF = 2.0, (3.0, 24.0), 128.0


def with_shared_colors(found: FoundAreas, is_noisy: bool) -> FoundAreas:
    """Return areas whose nearly equal flat colours are one, that of the larger areas.

    is_noisy  whether noise or JPEG has moved the colours of small areas
    """
    sizes: dict[Any, float] = {} if found.background is None else {found.background: math.inf}
    for area in found.areas:
        if isinstance(area.paint, tuple):
            sizes[area.paint] = sizes.get(area.paint, 0.0) + _size(area)
    shared: dict[Any, Any] = {}
    kept = np.zeros((0, 3))
    for color in sorted(sizes, key=lambda color: -sizes[color]):
        most = float(np.clip(OFF / math.sqrt(max(sizes[color], 1.0)), *NEARLY_EQUAL))
        difference = 255 * np.abs(kept - color).max(axis=1)
        if len(kept) and difference.min() <= (most if is_noisy else EQUAL):
            shared[color] = tuple(kept[difference.argmin()].tolist())
        else:
            shared[color], kept = color, np.vstack([kept, color])
    areas = tuple(
        dataclasses.replace(area, paint=shared.get(area.paint, area.paint)) for area in found.areas
    )
    return dataclasses.replace(found, areas=areas)


def _size(area: Area) -> float:
    """Return about how many px an area has, or a line."""
    total = 0.0
    for outline in area.outlines:
        x, y = outline.nodes.T
        if area.is_line:
            total += area.width * float(portable.hypot(np.diff(x), np.diff(y)).sum())
        else:
            total += 0.5 * float((x * np.roll(y, -1) - y * np.roll(x, -1)).sum())
    return abs(total)


OPAQUE = 0.5  # areas of at least this opacity are drawn, and are opaque


def nearest_inks(colors: Any, inks: str) -> NDArray[np.float64]:
    """Return for each colour (n, 3) the nearest one of the inks "#rrggbb,#rrggbb,..".

    The distance is that of levels of sRGB, as in fits.
    """
    table = ink_colors(inks)
    return table[nearest_entry(table, np.asarray(colors, np.float64))[1]]


def areas_in_inks(areas: Iterable[Area], inks: str, banded: bool = False) -> tuple[Area, ...]:
    """Return opaque areas in inks. Those that are nearly transparent are left out.

    banded  whether gradients become bands of inks. Otherwise they get the ink nearest to their mean
    """

    def ink(paint: Paint) -> Paint:
        if isinstance(paint, tuple):
            return _nearest(paint, inks)
        return _banded(paint, inks) if banded else _nearest(np.mean(paint.colors, axis=0), inks)

    return tuple(
        dataclasses.replace(area, paint=ink(area.paint), opacity=1.0)
        for area in areas
        if area.opacity >= OPAQUE
    )


def found_in_inks(found: FoundAreas, inks: str) -> FoundAreas:
    """Return areas and a background that each have the nearest ink."""
    background = None if found.background is None else _nearest(found.background, inks)
    areas = areas_in_inks(found.areas, inks)
    return dataclasses.replace(found, areas=areas, background=background)


def picture_in_inks(found: FoundAreas, inks: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the picture of areas in inks, with a band of each ink in place of gradients.

    It is (h, w, 3), or (h, w, 4) without a background. Only antialiased pixels mix inks.
    """
    scene = Scene(width, height, areas=areas_in_inks(found.areas, inks, banded=True))
    if found.background is None:
        return render_rgba(scene.replace(transparent=True), width, height).astype(np.float32)
    scene = scene.replace(background=np.array(_nearest(found.background, inks)))
    return render(scene, width, height).astype(np.float32)


def sprite_in_inks(sprite: Sprite, inks: str) -> Sprite:
    """Return a sprite whose cells have their nearest inks, or are transparent."""
    colors = nearest_inks(sprite.levels[:, :3] / 255, inks)
    opaque = np.rint(255 * np.pad(colors, ((0, 0), (0, 1)), constant_values=1)).astype(np.int64)
    levels = np.where(sprite.levels[:, 3:] < 255 * OPAQUE, 0, opaque)
    levels, entry = np.unique(levels, axis=0, return_inverse=True)
    return sprite._replace(cells=entry.ravel()[sprite.cells], levels=levels)


def _nearest(color: Any, inks: str) -> Color:
    red, green, blue = nearest_inks([color], inks)[0].tolist()
    return red, green, blue


def _banded(paint: LinearGradient | RadialGradient, inks: str) -> LinearGradient | RadialGradient:
    """Return a gradient in the nearest ink at each place. Bands meet within about a pixel."""
    is_linear = isinstance(paint, LinearGradient)
    across = np.subtract(paint.end, paint.start) if is_linear else paint.radii
    half = 0.5 / max(portable.hypot(*across), 1.0)
    place = np.linspace(0, 1, 1024)
    ink = nearest_inks(paint.colors_at(place), inks)
    changes = np.flatnonzero((np.diff(ink, axis=0) != 0).any(axis=1))
    changes = changes[:: 1 + len(changes) // (MOST_STOPS // 2 - 1)]  # a band takes two stops
    middle = 0.5 * (place[changes] + place[changes + 1])
    ends = np.stack([middle - half, middle + half], axis=1).ravel()
    offsets = sorted([0.0, *np.clip(ends, 0, 1).tolist(), 1.0])
    colors = [ink[0], *(ink[k + j] for k in changes for j in (0, 1)), ink[-1]]
    return dataclasses.replace(paint, offsets=tuple(offsets), colors=tuple(map(tuple, colors)))


def kept(
    areas: tuple[Area, ...],
    before: tuple[Area, ...],
    error_of: Callable[[tuple[Area, ...]], float],
) -> tuple[Area, ...]:
    """Return areas of which those that have not changed are areas of the frame before.

    error_of  function that returns the squared error of areas
    """
    most = 1.1 * error_of(areas) + 0.15  # such a rise of the squared error is seen nowhere
    left = list(before)
    for k, area in enumerate(areas):
        old = next((one for one in left if _is_alike(one, area)), area)
        tried = (*areas[:k], old, *areas[k + 1 :])
        if old is not area and error_of(tried) <= most:
            areas = tried
            left.remove(old)
    return areas


def _is_alike(one: Area, other: Area) -> bool:
    """Return whether two areas have the same kind, and about the same box and paint."""
    if one.is_line != other.is_line or type(one.paint) is not type(other.paint):
        return False

    def features(area: Area) -> NDArray[np.float64]:
        colors = area.paint if isinstance(area.paint, tuple) else area.paint.colors
        nodes = np.concatenate([outline.nodes for outline in area.outlines])
        # A difference of 1 px counts as much as one of .06 in a colour.
        mean = np.atleast_2d(colors).mean(axis=0) / 0.06
        return np.concatenate([nodes.min(axis=0), nodes.max(axis=0), mean])

    return bool(np.abs(features(one) - features(other)).max() <= 1)
