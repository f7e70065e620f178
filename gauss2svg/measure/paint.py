"""The time that a browser takes to paint a file, estimated from its shapes."""

from __future__ import annotations

import numpy as np

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius
from gauss2svg.scene.scene import narrowing_of
from gauss2svg.svg import Document
from gauss2svg.svg.file import pixels_of

# Milliseconds that a browser takes for each shape, and for each million pixels: if soft shapes are
# drawn by gradients, and by masks (docs/benchmarks/paint.md).
_BY_GRADIENTS, _BY_MASKS = np.array([0.03, 20.0]), np.array([0.9, 52.0])
# ms, least paint time of a heavy file. A tenth of a second seems immediate to people
# (Miller, "Response time in man-computer conversational transactions", 1968).
HEAVY_MS = 100.0
WIDEST_SHOWN = 1600.0  # px, about the greatest width at which pages show a picture


def drawn_pixels(scene: Scene) -> float:
    """Return the number of pixels that a renderer blends at the scene's size.

    It is the sum of all ellipses' areas in px^2, each times the share of the ellipse's bounding box
    that is on the canvas.
    """
    half = cut_radius(scene.beta)[:, None] * scene.sigma
    size = np.array([scene.width, scene.height])
    low, high = np.clip(scene.mean - half, 0, size), np.clip(scene.mean + half, 0, size)
    return float(np.pi / 4 * (narrowing_of(scene.rho) * np.prod(high - low, axis=1)).sum())


def shown_width(document: Document, scene: Scene) -> float:
    """Return a file's probable width in px on a page: by --size, or its own width up to 1600."""
    sides = document.sides(scene.width, scene.height)
    return (pixels_of(sides[0]) or 0.0) if sides else min(scene.width, WIDEST_SHOWN)


def paint_ms(scene: Scene, svg: str, width: float) -> float | None:
    """Return the estimated CPU milliseconds of a browser's first paint and of each repaint.

    The time of n shapes is a n + b drawn_pixels (width / scene.width)^2 / 1e6. `width` is in px. a
    and b depend on how the file draws soft shapes, and were measured in Chromium without a GPU.
    Other machines may be several times faster or slower. Return None for a file with filters, which
    were not measured.
    """
    if "<filter" in svg:
        return None
    share = float("<mask" in svg)
    if share and "<style" in svg:  # only some of the soft shapes are under masks
        masked = svg.count("<use ")
        share = masked / (masked + svg.count("<circle "))
    each, million = share * _BY_MASKS + (1 - share) * _BY_GRADIENTS
    pixels = (width / scene.width) ** 2 * drawn_pixels(scene)
    return float(each * len(scene) + million * pixels / 1e6)
