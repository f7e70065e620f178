"""The raster of areas and lines, in NumPy over the kernels of exact coverage."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.render.coverage import MITER_LIMIT, add_outline, add_stroke
from gauss2svg.render.cpu import Real, render_planar, splats_of
from gauss2svg.render.tiles import kernel
from gauss2svg.scene import ABOVE, Scene
from gauss2svg.scene.areas import CAPS, Area

_ROWS = 64  # number of rows that are drawn at once, which limits the memory of a large image


@kernel
def _add_fill(sums, segments, curved, x0, y0):
    """Call add_outline of gauss2svg.render.coverage."""
    add_outline(sums, segments, curved, x0, y0)


@kernel
def _add_line(sums, segments, curved, is_closed, width, cap, x0, y0):
    """Call add_stroke of gauss2svg.render.coverage."""
    add_stroke(sums, segments, curved, is_closed, width, cap, x0, y0)


@kernel
def _blend(coverage, opacity, color, image, left, top):
    """Draw a colour over the box of an image (h, w, 3) whose upper left corner is (left, top).

    coverage  (height, width) share that is covered of each pixel of the box
    color     (height, width, 3), or (1, 1, 3) if the colour is the same in all of the box
    """
    height, width = coverage.shape
    for y in range(height):
        row = min(y, color.shape[0] - 1)
        for x in range(width):
            column = min(x, color.shape[1] - 1)
            alpha = opacity * coverage[y, x]
            if alpha > 0.0:
                for channel in range(3):
                    below = image[top + y, left + x, channel]
                    change = alpha * (color[row, column, channel] - below)
                    image[top + y, left + x, channel] = below + change


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
    x0, y0 = float(left), float(top)
    line_width = area.width * float(np.sqrt(scale[0] * scale[1]))
    for outline in area.outlines:
        segments, curved = outline.segments * scale, np.array(outline.curved)
        if not area.is_line:
            _add_fill(sums, segments, curved, x0, y0)
            continue
        # A segment without extent has no direction. If there are no others, the line is a dot,
        # which has only its caps.
        has_extent = (segments != segments[:, :1]).any(axis=(1, 2))
        is_closed = outline.closed and bool(has_extent.any())
        has_extent[0] |= not has_extent.any()
        _add_line(
            sums, segments[has_extent], curved[has_extent], is_closed, line_width,
            CAPS.index(area.cap), x0, y0,
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
        # Corners and square caps reach further than half of the width.
        low, high = points.min(axis=0), points.max(axis=0)
        reach = 0.5 * area.width * MITER_LIMIT
        left, top = np.floor(np.clip((low - reach) * scale, 0, size)).astype(int).tolist()
        right, bottom = np.ceil(np.clip((high + reach) * scale, 0, size)).astype(int).tolist()
        for y in range(top, bottom, _ROWS):
            height, width = min(_ROWS, bottom - y), right - left
            if isinstance(area.paint, tuple):
                color = np.array([[area.paint]])
            else:
                across = (np.arange(left, right) + 0.5) / scale[0]
                down = (np.arange(y, y + height) + 0.5) / scale[1]
                color = area.paint.at(across, down[:, None])
            coverage = coverage_of(area, left, y, width, height, scale)
            _blend(coverage, area.opacity, color, image, left, y)
