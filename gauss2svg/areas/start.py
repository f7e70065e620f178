"""Areas of a scene as a drawing, which is refined to another picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gauss2svg.areas.find import (
    LEAST_OPACITY,
    RATE,
    UNIT,
    FoundAreas,
    Progress,
    channels_of,
    refined,
    transparent_paint,
)
from gauss2svg.areas.outlines import Path
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.areas.shades import without_shading
from gauss2svg.errors import refusal
from gauss2svg.scene.areas import CAPS, Area

Floats = NDArray[np.float64]


def refined_areas(
    picture: NDArray[np.float32],
    areas: Sequence[Area],
    background: Floats,
    rate: float = RATE,
    unit: float = UNIT,
    progress: Progress | None = None,
    shaded: bool = False,
) -> FoundAreas:
    """Return areas that are refined until they draw a picture, as `find_areas` refines its own.

    areas, background  areas in px of the picture, and the colour (3,) below them, which a picture
                       with alpha leaves out
    shaded  whether Gaussians draw the shading that has no crisp edges
    Raise InputError if a part is partly transparent, but the picture is opaque.
    """
    whole = channels_of(picture)
    pixels = without_shading(whole) if shaded else whole
    return refined(drawing_of(pixels, whole, areas, background), rate, unit, progress)


def drawing_of(
    pixels: Floats, whole: Floats, areas: Sequence[Area], background: Floats | None
) -> Drawing:
    """Return the drawing of areas over a background.

    pixels, whole  (h, w, c) channels of the picture to which they are fitted, and of all of it
    """
    channels = pixels.shape[2]
    paints: dict[object, int] = {}
    table, layers = list[Paint](), list[Layer]()
    for area in areas:
        if area.opacity < 1 and channels == 3:
            got = f"an area of opacity {area.opacity:g} on an opaque photo"
            raise refusal("start", "opaque, as the photo is", got, "without --start")
        key = area.paint, area.opacity
        if key not in paints:
            paints[key] = len(table)
            table.append(_paint(area, channels))
        paths = [
            Path(outline.segments, np.array(outline.curved), outline.closed)
            for outline in area.outlines
        ]
        cap = CAPS.index(area.cap)
        layers.append(Layer(paints[key], paths, area.width, cap))
    ground = Paint(np.array(background)) if channels == 3 else transparent_paint()
    return Drawing(pixels, ground, table, layers, picture=whole)


def _paint(area: Area, channels: int) -> Paint:
    """Return the paint of an area, whose colour is multiplied by its opacity."""
    if not isinstance(area.paint, tuple):
        color = np.mean(area.paint.colors, axis=0)
        return Paint(np.tile(color, channels // 3), area.paint)
    opacity = max(area.opacity, LEAST_OPACITY)
    return Paint(np.tile(opacity * np.array(area.paint), channels // 3), opacity=opacity)
