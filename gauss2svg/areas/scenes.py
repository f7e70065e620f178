"""Areas of a scene as a drawing, which is refined to a picture, or to a renderer's raster of it.

Renderers with few levels of antialiasing, and with strokes of few edges, draw areas and lines up to
.2 px beside where they are. If such a renderer made the picture, the raster of its own areas is
this picture, and their exact coverage is not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.areas import find
from gauss2svg.areas.arrays import Floats, squared
from gauss2svg.areas.clean import without_shading
from gauss2svg.areas.outlines import Path
from gauss2svg.areas.paint import Paint
from gauss2svg.areas.refine import Drawing, Layer
from gauss2svg.errors import refusal
from gauss2svg.scene import ABOVE, PLAIN, Scene
from gauss2svg.scene.areas import CAPS, Area, Outline
from gauss2svg.scene.falloff import covered_radius

# Function that returns the raster (h, w, 3), or (h, w, 4) with straight alpha, of areas
Rasterize = Callable[[tuple[Area, ...]], NDArray[np.float32]]
MOST_IN_BOXES = 100_000_000  # px of all areas' boxes, which take 16 bytes each, or 28 with alpha


def refined_areas(
    picture: NDArray[np.float32],
    areas: Sequence[Area],
    background: Floats,
    rate: float = find.RATE,
    unit: float = find.UNIT,
    progress: find.Progress | None = None,
    shaded: bool = False,
) -> find.FoundAreas:
    """Return areas that are refined until they draw a picture, as `find_areas` refines its own.

    areas, background  areas in px of the picture, and the colour (3,) below them, which a picture
                       with alpha leaves out
    shaded  whether Gaussians draw the shading that has no crisp edges
    Raise InputError if a part is partly transparent, but the picture is opaque, or if the areas
    would take too much memory.
    """
    whole = find.channels_of(picture)
    pixels = without_shading(whole) if shaded else whole
    drawing = drawing_of(pixels, whole, areas, background)
    if (count := int(drawing.boxes()[:, 2:].prod(axis=1).sum())) > MOST_IN_BOXES:
        needed = f"areas whose boxes have at most {MOST_IN_BOXES / 1e6:g} million px in all"
        raise refusal("start", f"of {needed}", f"{count / 1e6:.0f} million", "a lower --max-size")
    # Outlines would move away from parts that have another colour now.
    error = drawing.draw() - pixels
    drawing.weigh()
    drawing.solve_colors(error)
    return find.refined(drawing, rate, unit, progress)


def with_ellipses_as_areas(scene: Scene) -> Scene:
    """Return a scene with areas in place of its ellipses, if it has areas and no other Gaussians.

    Other programs draw circles among paths, and a refinement moves areas alone.
    """
    if not scene.areas or not len(scene) or (scene.drawn != PLAIN).any():
        return scene
    # The outline of a circle of radius 1, as four cubic curves
    turns: Any = np.array([1, 1j, -1, -1j])[:, None] * [1, 1 + 0.5523j, 0.5523 + 1j]
    circle = np.stack([turns.real.ravel(), turns.imag.ravel()], axis=1)
    factor = scene.factor * covered_radius(scene.beta)[:, None, None]
    points = (circle[:, None] * factor[:, None]).sum(axis=3) + scene.mean[:, None]
    ellipses = [
        Area((Outline(own, (True,) * 4),), color, opacity)
        for own, color, opacity in zip(
            points.tolist(), scene.color.tolist(), scene.opacity.tolist(), strict=True
        )
    ]
    level = np.where(scene.level == ABOVE, len(scene.areas), scene.level)
    areas = [*ellipses, *scene.areas]
    order = np.concatenate([level, np.arange(len(scene.areas)) + 0.5])
    ranked = tuple(areas[k] for k in np.argsort(order, kind="stable"))
    return scene.select([]).replace(areas=ranked)


def drawing_of(
    pixels: Floats, whole: Floats, areas: Sequence[Area], background: Floats | None
) -> Drawing:
    """Return the drawing of areas over a background.

    pixels, whole  (h, w, c) channels of the picture to which they are fitted, and of all of it
    """
    channels = pixels.shape[2]
    for area in areas:
        if area.opacity < 1 and channels == 3:
            got = f"an area of opacity {area.opacity:g} on an opaque photo"
            raise refusal("start", "opaque, as the photo is", got, "without --start")
        if area.opacity < 1 and not isinstance(area.paint, tuple):
            got = f"a gradient of opacity {area.opacity:g}"
            raise refusal("start", "without transparent gradients", got, "without --start")
    # Areas of the same colour share a paint.
    paints = {(area.paint, area.opacity): _paint(area, channels) for area in areas}
    number = {key: k for k, key in enumerate(paints)}
    layers = []
    for area in areas:
        paths = [Path(one.segments, np.array(one.curved), one.closed) for one in area.outlines]
        cap = CAPS.index(area.cap)
        layers.append(Layer(number[area.paint, area.opacity], paths, area.width, cap))
    ground = Paint(np.array(background)) if channels == 3 else find.transparent_paint()
    return Drawing(pixels, ground, list(paints.values()), layers, picture=whole)


def _paint(area: Area, channels: int) -> Paint:
    """Return the paint of an area, whose colour is multiplied by its opacity."""
    if not isinstance(area.paint, tuple):
        color = np.mean(area.paint.colors, axis=0)
        return Paint(np.tile(color, channels // 3), area.paint)
    opacity = max(area.opacity, find.LEAST_OPACITY)
    return Paint(np.tile(opacity * np.array(area.paint), channels // 3), opacity=opacity)


def as_rasterized(
    picture: NDArray[np.float32], areas: tuple[Area, ...],
    background: tuple[float, float, float] | None, rasterize: Rasterize,
    code: Callable[[NDArray[np.float32]], NDArray[np.float32]] | None = None,
) -> tuple[Area, ...]:  # fmt: skip
    """Return areas of the same colours, whose raster is closest to a picture.

    If exact coverage explains the picture better, another renderer made it. Then the areas stay as
    they are.

    background  colour below the areas, or None if the picture is transparent there
    code  function that changes a raster as JPEG has changed the picture. None: nothing has
    """
    pixels = find.channels_of(picture)
    if pixels.shape[0] * pixels.shape[1] > 400 * 400:  # .2 px are seen less in larger ones
        return areas
    page = None if background is None else np.array(background)
    drawing = drawing_of(pixels, pixels, areas, page)
    changed = code or (lambda raster: raster)
    exact = squared(changed(drawing.draw()) - pixels)

    def raster() -> NDArray[np.float32]:
        image = rasterize(find.shown_areas(drawing)[0])
        return changed(image[..., :3]) if pixels.shape[2] == 3 else find.both_views(image)

    drawing.rasterize = raster
    # If another renderer made the picture, the raster has many times the error of exact coverage.
    is_closer = squared(drawing.draw() - pixels) <= 8 * exact
    if is_closer:
        drawing.refine(8, colors=False)
        is_closer = squared(drawing.draw() - pixels) <= 1.6 * exact
    drawing.rasterize = None  # it would keep the memory of the drawing
    return find.shown_areas(drawing)[0] if is_closer else areas
