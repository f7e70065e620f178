"""The time that a browser takes to paint a file, estimated from its shapes."""

from __future__ import annotations

import numpy as np

from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import cut_radius
from gauss2svg.scene.scene import narrowing_of
from gauss2svg.svg import Document
from gauss2svg.svg.file import pixels_of

# Paint time in ms from which a file counts as heavy. People perceive a response within a tenth of a
# second as immediate (Miller, "Response time in man-computer conversational transactions", 1968).
HEAVY_MS = 100.0
WIDEST_SHOWN = 1600.0  # px, about the largest width at which web pages show a picture


def drawn_pixels(scene: Scene) -> float:
    """Return the number of pixels that a renderer blends when it draws the scene at its own size.

    This is the sum of the areas of all ellipses in px^2. Each area is multiplied by the share of
    the ellipse's bounding box that is on the canvas.
    """
    half = cut_radius(scene.beta)[:, None] * scene.sigma
    size = np.array([scene.width, scene.height])
    low, high = np.clip(scene.mean - half, 0, size), np.clip(scene.mean + half, 0, size)
    return float(np.pi / 4 * (narrowing_of(scene.rho) * np.prod(high - low, axis=1)).sum())


def shown_width(document: Document, scene: Scene) -> float:
    """Return the width in px at which a web page probably shows a file.

    This is the width that --size gives. Without --size, it is the scene's width, but at most
    WIDEST_SHOWN.
    """
    sides = document.sides(scene.width, scene.height)
    return (pixels_of(sides[0]) or 0.0) if sides else min(scene.width, WIDEST_SHOWN)


def paint_ms(scene: Scene, svg: str, width: float) -> float | None:
    """Return an estimate of the CPU time in ms that a browser takes each time it paints the file.

    For n shapes the estimate is

        a n + b drawn_pixels (width / scene.width)^2 / 1e6,

    where `width` is the width in px at which the file is shown. a and b depend on how the file
    draws soft shapes. They were measured in Chromium without a GPU, and other machines may be
    several times faster or slower. Return None for a file with filters, whose time was not
    measured.
    """
    if "<filter" in svg:
        return None
    share = float("<mask" in svg)
    # A file with masks and a style sheet draws some soft shapes by masks, as <use>, and the others
    # by gradients, as <circle>.
    if share and "<style" in svg:
        masked = svg.count("<use ")
        share = masked / (masked + svg.count("<circle "))
    # ms for a shape and for a million pixels, by gradients and by masks (docs/benchmarks/paint.md)
    each, million = (1 - share) * np.array([0.03, 20.0]) + share * np.array([0.9, 52.0])
    pixels = (width / scene.width) ** 2 * drawn_pixels(scene)
    return float(each * len(scene) + million * pixels / 1e6)
