"""Gaussians below areas: glows and soft shadows on the page, whose upper parts areas hide.

An area hides crisply what lies below it. So these Gaussians are fitted to the page as it would be
without the areas, and errors count only as far as the page shows. If the areas add the light f to a
pixel p, and let through the share s of the page, the page there is (p - f) / s, and a squared error
of the page counts s^2 times.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.fit import GAUSSIAN, PSNR, FitConfig, FitOptions
from gauss2svg.fit.session import FitSession
from gauss2svg.fit.target import Target
from gauss2svg.photo.pixels import Focus, from_views, has_alpha, views
from gauss2svg.render.areas import coverage_of, draw_areas
from gauss2svg.scene import Scene

STEPS = 120  # steps of a fit
LEAST_SEEN = 0.05  # least share of the page in a pixel whose colour tells that of the page
STRENGTH = 1e6  # how much more an error counts where all of the page shows than where none does


def with_gaussians_below(
    scene: Scene,
    picture: NDArray[np.float32],
    count: int,
    stop: Callable[[], bool] = lambda: False,
) -> Scene:
    """Return a scene of areas with `count` Gaussians on its page, fitted to a picture.

    The page is the background, or the first area if that covers the canvas.

    picture  (h, w, 3) or (h, w, 4) float32 in 0..1
    stop     function that ends the fit if it returns True
    """
    height, width = picture.shape[:2]
    scale = width / scene.width, height / scene.height
    level = int(_covers_canvas(scene))
    light, seen = np.zeros((height, width, 3)), np.ones((height, width, 1))
    draw_areas(scene.areas[level:], light, scale)
    for area in scene.areas[level:]:
        seen *= 1 - area.opacity * coverage_of(area, 0, 0, width, height, scale)[..., None]
    shows = seen > LEAST_SEEN
    if not shows.any():
        return scene
    pages = [(view - light) / np.maximum(seen, LEAST_SEEN) for view in views(picture)]
    pages = [np.clip(np.where(shows, page, 0.5), 0, 1).astype(np.float32) for page in pages]
    page = from_views(*pages) if has_alpha(picture) else pages[0]
    weight = np.where(shows, seen * seen, 0).astype(np.float32)
    below = scene.replace(areas=scene.areas[:level])
    target = Target(page, PSNR, mask=Focus(weight, STRENGTH), ground=below)
    config = FitConfig(
        gaussians=count, iterations=STEPS, fit=FitOptions(tune=PSNR, falloff=GAUSSIAN)
    )
    session = FitSession(target, config, stop=stop)
    session.fit()
    new = session.scene()
    new = new.scaled(scene.width / width, scene.height / height)
    color, opacity = np.round(new.color * 255) / 255, np.round(new.opacity, 2)
    return new.replace(
        width=scene.width, height=scene.height, color=color, opacity=opacity,
        round_index=np.zeros_like(new.round_index), level=np.full_like(new.level, level),
        background=scene.background, transparent=scene.transparent, areas=scene.areas,
    )  # fmt: skip


def _covers_canvas(scene: Scene) -> bool:
    """Return whether the first area covers the canvas."""
    if not scene.areas or scene.areas[0].is_line or scene.areas[0].opacity < 1:
        return False
    (first, *others) = scene.areas[0].outlines
    corners = {(x, y) for x in (0.0, scene.width) for y in (0.0, scene.height)}
    return not (others or any(first.curved)) and {(x, y) for x, y in first.points} == corners
