"""What a browser spends on painting a file."""

from __future__ import annotations

import numpy as np

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius
from gauss2svg.scene.scene import narrowing_of
from gauss2svg.svg.document import Document
from gauss2svg.svg.syntax.values import length

# Milliseconds of a shape and of a million drawn pixels, by gradients and by masks
# (docs/benchmarks/paint.md).
_BY_GRADIENTS, _BY_MASKS = (0.03, 20.0), (0.9, 52.0)
# A tenth of a second is what people take for at once (Miller, "Response time in man-computer
# conversational transactions", 1968).
HEAVY_MS = 100.0
WIDEST_SHOWN = 1600.0  # px, about the widest that pages show a picture


def drawn_pixels(scene: Scene) -> float:
    """Pixels that a renderer blends at the scene's own size: the sum of all ellipses' areas.

    Of an ellipse counts the share that is on the canvas of its bounding box.
    """
    half = cut_radius(scene.beta)[:, None] * scene.sigma
    size = np.array([scene.width, scene.height])
    low, high = np.clip(scene.mean - half, 0, size), np.clip(scene.mean + half, 0, size)
    return float(np.pi / 4 * (narrowing_of(scene.rho) * np.prod(high - low, axis=1)).sum())


def shown_width(document: Document, scene: Scene) -> float:
    """Width in px at which a page probably shows a file: as --size says, or its own up to 1600."""
    sides = document.sides(scene.width, scene.height)
    return length(sides[0], "size") if sides else min(scene.width, WIDEST_SHOWN)


def paint_ms(scene: Scene, svg: str, width: float | None = None) -> float:
    """Estimated CPU milliseconds of a browser's first paint, and of each repaint.

    a n + b drawn_pixels (width / scene.width)^2 / 1e6, width in px, by default that of the scene;
    a and b are of the file's ways of drawing soft shapes, as measured in Chromium without a GPU.
    Other machines differ by a factor of a few.
    """
    share = float("<mask" in svg)
    if share and "<style" in svg:  # of which some soft shapes are under masks
        masked = svg.count("<use ")
        share = masked / (masked + svg.count("<circle "))
    each, million = (
        share * by_masks + (1 - share) * by_gradients
        for by_masks, by_gradients in zip(_BY_MASKS, _BY_GRADIENTS, strict=True)
    )
    scale = 1.0 if width is None else width / scene.width
    return each * len(scene) + million * scale**2 * drawn_pixels(scene) / 1e6
