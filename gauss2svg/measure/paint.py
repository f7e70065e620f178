"""What a browser spends on painting a file."""

from __future__ import annotations

import numpy as np

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius

# Milliseconds of a shape and of a million drawn pixels, Chromium on one core of a server
# (docs/benchmarks/paint.md).
_PER_SHAPE, _PER_MILLION_PIXELS = 0.04, 6.0
# A page that takes longer until its picture is seen is felt to be slow.
HEAVY_MS = 200.0


def drawn_pixels(scene: Scene) -> float:
    """Pixels that a renderer blends at the scene's own size: the sum of all ellipses' areas.

    The area of an ellipse is pi/4 of the part of its bounding box that is on the canvas.
    """
    half = cut_radius(scene.betas)[:, None] * scene.sigma
    size = np.array([scene.width, scene.height])
    low, high = np.clip(scene.mean - half, 0, size), np.clip(scene.mean + half, 0, size)
    return float(np.pi / 4 * np.prod(high - low, axis=1).sum())


def paint_ms(scene: Scene) -> float:
    """Estimated milliseconds until a browser has painted the file at its own size.

    _PER_SHAPE n + _PER_MILLION_PIXELS drawn_pixels / 1e6: what it takes longer than a JPEG of the
    same size, and what each repaint takes. Other machines differ by a factor of a few.
    """
    return _PER_SHAPE * len(scene) + _PER_MILLION_PIXELS * drawn_pixels(scene) / 1e6
