"""Drawings in a few inks: their areas, and pictures that have these inks alone.

The nearest ink of each pixel would be a third ink along many edges, because antialiased pixels mix
two colours. So the areas of a drawing get their nearest inks, gradients become bands of inks, and
the picture that is drawn so has crisp edges between inks. Areas are then found in that picture:

    picture -> areas -> picture in inks -> areas in inks
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg import portable
from gauss2svg.areas.pixels import Sprite
from gauss2svg.photo.pixels import over
from gauss2svg.render import render, render_rgba
from gauss2svg.scene import Scene
from gauss2svg.scene.areas import MOST_STOPS, Area, Color, LinearGradient, Paint, RadialGradient
from gauss2svg.scene.inks import ink_colors, ink_name, oklab
from gauss2svg.without_scipy import nearest_entry

if TYPE_CHECKING:
    from gauss2svg.areas.find import FoundAreas

PLACES = 1024  # places along a gradient at which its nearest ink is looked up
MOST_BANDS = MOST_STOPS // 2 - 1  # bands of a gradient. Each takes two stops
OPAQUE = 0.5  # areas of at least this opacity are drawn, and are opaque
# A drawing is far from its picture where blocks of it differ by FAR in Oklab. It has BLOCKS of them
# along its longer side. A FAR_SHARE of the blocks is worth a note (docs/decisions/inks.md).
FAR, BLOCKS, FAR_SHARE = 0.15, 24, 0.2
LEAST_EXPLAINED = 0.9  # share of a drawing that its areas must draw. A photo in it has bands else


def nearest_inks(colors: Any, inks: str) -> NDArray[np.float64]:
    """Return for each colour (n, 3) the nearest one of the inks "#rrggbb,#rrggbb,..".

    The distance is that of levels of sRGB, as in fits.
    """
    table = ink_colors(inks)
    return table[nearest_entry(table, np.asarray(colors, np.float64))[1]]


def areas_in_inks(areas: Iterable[Area], inks: str) -> tuple[Area, ...]:
    """Return areas of one ink each. Those that are nearly transparent are left out."""

    def ink(paint: Paint) -> Color:
        color = paint if isinstance(paint, tuple) else np.mean(paint.colors, axis=0)
        return _nearest(color, inks)

    return _painted(areas, ink)


def found_in_inks(found: FoundAreas, inks: str) -> FoundAreas:
    """Return areas and a background that each have the nearest ink."""
    background = None if found.background is None else _nearest(found.background, inks)
    areas = areas_in_inks(found.areas, inks)
    return dataclasses.replace(found, areas=areas, background=background)


def picture_in_inks(found: FoundAreas, inks: str, width: int, height: int) -> NDArray[np.float32]:
    """Return the picture of areas in inks, with a band of each ink in place of gradients.

    It is (h, w, 3), or (h, w, 4) without a background. Only antialiased pixels mix inks.
    """

    def ink(paint: Paint) -> Paint:
        return _nearest(paint, inks) if isinstance(paint, tuple) else _banded(paint, inks)

    scene = Scene(width, height, areas=_painted(found.areas, ink))
    if found.background is None:
        return render_rgba(scene.replace(transparent=True), width, height).astype(np.float32)
    scene = scene.replace(background=np.array(_nearest(found.background, inks)))
    return render(scene, width, height).astype(np.float32)


def far_colors(raster: NDArray[np.float32], photo: NDArray[np.float32]) -> str:
    """Return a sentence on how much of a photo its inks are far from, or "" if it is little.

    raster, photo  (h, w, 3), or (h, w, 4) with alpha, in 0..1
    """
    height, width = photo.shape[:2]
    side = max(1, round(max(height, width) / BLOCKS))
    rows, columns = max(1, height // side), max(1, width // side)

    def blocks(pixels: NDArray[np.float32]) -> NDArray[np.float64]:
        cut = over(pixels)[: rows * side, : columns * side].astype(np.float64)
        return cut.reshape(rows, len(cut) // rows, columns, -1, 3).mean(axis=(1, 3))

    drawn, wanted = blocks(raster), blocks(photo)
    is_far = np.square(oklab(drawn) - oklab(wanted)).sum(axis=2) > FAR**2
    if (share := is_far.mean()) < FAR_SHARE:
        return ""
    drawn, wanted = drawn[is_far], wanted[is_far]
    usual = np.square(wanted - wanted.mean(axis=0)).sum(axis=1).argmin()
    example = f"{ink_name(wanted[usual])} of the photo is {ink_name(drawn[usual])}"
    return f"the inks are far from {100 * share:.0f} % of the photo. For example, {example}"


def sprite_in_inks(sprite: Sprite, inks: str) -> Sprite:
    """Return a sprite whose cells have their nearest inks, or are transparent."""
    colors = nearest_inks(sprite.levels[:, :3] / 255, inks)
    opaque = np.rint(255 * np.pad(colors, ((0, 0), (0, 1)), constant_values=1)).astype(np.int64)
    levels = np.where(sprite.levels[:, 3:] < 255 * OPAQUE, 0, opaque)
    levels, entry = np.unique(levels, axis=0, return_inverse=True)
    return sprite._replace(cells=entry.ravel()[sprite.cells], levels=levels)


def _painted(areas: Iterable[Area], ink: Callable[[Paint], Paint]) -> tuple[Area, ...]:
    """Return opaque areas with another paint in place of each paint."""
    return tuple(
        dataclasses.replace(area, paint=ink(area.paint), opacity=1.0)
        for area in areas
        if area.opacity >= OPAQUE
    )


def _nearest(color: Any, inks: str) -> Color:
    red, green, blue = nearest_inks([color], inks)[0].tolist()
    return red, green, blue


def _banded(paint: LinearGradient | RadialGradient, inks: str) -> LinearGradient | RadialGradient:
    """Return a gradient in the nearest ink at each place. Bands meet within about a pixel."""
    across = (
        np.subtract(paint.end, paint.start) if isinstance(paint, LinearGradient) else paint.radii
    )
    half = 0.5 / max(portable.hypot(*across), 1.0)
    place = np.linspace(0, 1, PLACES)
    ink = nearest_inks(paint.colors_at(place), inks)
    changes = np.flatnonzero((np.diff(ink, axis=0) != 0).any(axis=1))
    changes = changes[:: 1 + len(changes) // MOST_BANDS]
    middle = 0.5 * (place[changes] + place[changes + 1])
    ends = np.stack([middle - half, middle + half], axis=1).ravel()
    offsets = sorted([0.0, *np.clip(ends, 0, 1).tolist(), 1.0])
    colors = [ink[0], *(ink[k + j] for k in changes for j in (0, 1)), ink[-1]]
    return dataclasses.replace(paint, offsets=tuple(offsets), colors=tuple(map(tuple, colors)))
