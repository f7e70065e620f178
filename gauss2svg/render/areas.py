"""The raster of areas and lines, in NumPy over the kernels of exact coverage."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.render.coverage import MITER_LIMIT, add_outline, add_stroke
from gauss2svg.render.tiles import kernel
from gauss2svg.scene.areas import CAPS, Area

_ROWS = 256  # number of rows that are drawn at once, which limits the memory of a large image


@kernel
def _add_fill(sums, segments, curved, x0, y0):
    """Call add_outline of gauss2svg.render.coverage."""
    add_outline(sums, segments, curved, x0, y0)


@kernel
def _add_line(sums, segments, curved, is_closed, width, cap, x0, y0):
    """Call add_stroke of gauss2svg.render.coverage."""
    add_stroke(sums, segments, curved, is_closed, width, cap, x0, y0)


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
    return np.minimum(np.abs(np.cumsum(sums, axis=1)[:, :-2]), 1.0)


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
        low, high = (points.min(axis=0), points.max(axis=0))
        reach = 0.5 * area.width * MITER_LIMIT
        left, top = np.floor(np.clip((low - reach) * scale, 0, size)).astype(int).tolist()
        right, bottom = np.ceil(np.clip((high + reach) * scale, 0, size)).astype(int).tolist()
        for y in range(top, bottom, _ROWS):
            part = image[y : min(y + _ROWS, bottom), left:right]
            height, width = part.shape[:2]
            alpha = area.opacity * coverage_of(area, left, y, width, height, scale)
            if isinstance(area.paint, tuple):
                color = np.array(area.paint)
            else:
                across = (np.arange(left, right) + 0.5) / scale[0]
                down = (np.arange(y, y + height) + 0.5) / scale[1]
                color = area.paint.at(across, down[:, None])
            part += alpha[:, :, None] * (color - part)
