"""Areas that are moved until what a renderer draws of them is closest to the picture.

Renderers with few levels of antialiasing, and with strokes of few edges, draw areas and lines up to
.2 px beside where they are. If such a renderer made the picture, the raster of its own areas is
this picture, and their exact coverage is not.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.areas.find import channels_of, shown_areas
from gauss2svg.areas.refine import squared
from gauss2svg.areas.start import drawing_of
from gauss2svg.scene.areas import Area

# Function that returns the raster (h, w, 3), or (h, w, 4) with straight alpha, of areas
Rasterize = Callable[[tuple[Area, ...]], NDArray[np.float32]]
# Larger pictures take more memory and time, and .2 px of them are seen less.
MOST_PIXELS = 400 * 400
STEPS = 4  # number of steps of the refinement
# Ratios of the errors of the raster and of exact coverage: before the steps, so high that another
# renderer made the picture, and after them, at most that of a picture of this renderer
UNLIKE, LIKELY = 8.0, 1.6


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
    pixels = channels_of(picture)
    if pixels.shape[0] * pixels.shape[1] > MOST_PIXELS:
        return areas
    page = None if background is None else np.array(background)
    drawing = drawing_of(pixels, pixels, areas, page)
    changed = code or (lambda raster: raster)
    exact = squared(changed(drawing.draw()) - pixels)

    def raster() -> NDArray[np.float32]:
        image = rasterize(shown_areas(drawing)[0])
        if pixels.shape[2] == 3:
            return changed(image[..., :3])
        over_black = image[..., :3] * image[..., 3:]
        return np.concatenate([over_black, over_black + 1 - image[..., 3:]], axis=-1)

    drawing.rasterize = raster
    is_closer = squared(drawing.draw() - pixels) <= UNLIKE * exact
    if is_closer:
        drawing.refine(STEPS, colors=False)
        is_closer = squared(drawing.draw() - pixels) <= LIKELY * exact
    drawing.rasterize = None  # it would keep the memory of the drawing
    return shown_areas(drawing)[0] if is_closer else areas
