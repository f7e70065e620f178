"""The raster of areas and lines, in NumPy over the kernels of exact coverage."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.core import Kernel
from gauss2svg.render.cpu import Real, render_planar, splats_of
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.scene.areas import CAPS, Area

_cover_pixels = Kernel("cover_pixels", "int int float float float64 int float64 bool int float int")


def coverage_of(
    area: Area,
    left: int,
    top: int,
    width: int,
    height: int,
    scale: tuple[float, float] = (1.0, 1.0),
) -> NDArray[np.float64]:
    """Return the share (height, width) that an area covers of each pixel of a box.

    left, top  the upper left corner of the box, in px of the scaled area
    scale      factors along x and y. The scaled area may leave the domain of scenes, which
               Area.scaled does not allow
    """
    sums = np.zeros((height, width + 2))
    line_width = area.width * float(np.sqrt(scale[0] * scale[1]))
    for outline in area.outlines:
        segments, curved = outline.segments * scale, np.array(outline.curved)
        is_closed = outline.closed
        if area.is_line:
            # A segment without extent has no direction. If there are no others, the line is a dot,
            # which has only its caps.
            has_extent = (segments != segments[:, :1]).any(axis=(1, 2))
            is_closed &= bool(has_extent.any())
            has_extent[0] |= not has_extent.any()
            segments, curved = segments[has_extent], curved[has_extent]
        _cover_pixels(
            height, width, left, top, sums, len(segments), segments, curved, is_closed, line_width,
            CAPS.index(area.cap),
        )  # fmt: skip
    covered = np.cumsum(sums, axis=1, out=sums)[:, :-2]
    return np.minimum(np.abs(covered, out=covered), 1.0, out=covered)


def ground_of(
    scene: Scene, height: int, width: int, dtype: type[Real], backdrop: float | None = None
) -> NDArray[Real]:
    """Return the areas of a scene, and the Gaussians that lie among them, (3, height, width).

    backdrop  grey level below the areas. If it is None, the scene's background is below them
    """
    image, scale = np.empty((height, width, 3), dtype), (width / scene.width, height / scene.height)
    image[:] = scene.background if backdrop is None else backdrop
    drawn = 0
    for level in np.unique(scene.level[scene.level != ABOVE]).tolist():
        draw_areas(scene.areas[drawn:level], image, scale)
        ground = np.ascontiguousarray(np.moveaxis(image, -1, 0))
        splats = splats_of(scene.select(scene.level == level), scale)
        splats = splats._replace(ground=ground)
        image[:] = np.moveaxis(render_planar(splats, height, width, dtype), 0, -1)
        drawn = level
    draw_areas(scene.areas[drawn:], image, scale)
    return np.ascontiguousarray(np.moveaxis(image, -1, 0))


def draw_areas(
    areas: Iterable[Area], image: NDArray[np.floating], scale: tuple[float, float] = (1.0, 1.0)
) -> None:
    """Draw areas over an image (h, w, 3), the bottom one first. A gradient is sampled at centres.

    scale  as in coverage_of
    """
    size = [image.shape[1], image.shape[0]]
    for area in areas:
        points = np.concatenate([outline.points for outline in area.outlines])
        # Mitres reach up to two widths beyond an outline, because 4 is SVG's default limit.
        low, high, reach = points.min(axis=0), points.max(axis=0), 2.0 * area.width
        left, top = np.floor(np.clip((low - reach) * scale, 0, size)).astype(int).tolist()
        right, bottom = np.ceil(np.clip((high + reach) * scale, 0, size)).astype(int).tolist()
        for y in range(top, bottom, 64):  # a few rows at once take less memory
            height, width = min(64, bottom - y), right - left
            if isinstance(area.paint, tuple):
                color = np.array([[area.paint]])
            else:
                across = (np.arange(left, right) + 0.5) / scale[0]
                down = (np.arange(y, y + height) + 0.5) / scale[1]
                color = area.paint.at(across, down[:, None])
            alpha = area.opacity * coverage_of(area, left, y, width, height, scale)[:, :, None]
            below = image[y : y + height, left:right]
            below += alpha * (color - below)
