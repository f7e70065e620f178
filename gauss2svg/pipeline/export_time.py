"""Estimate of the time that writing, rasterising and measuring take, from a sample of each."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gauss2svg.measure.roundtrip import measure_pixels
from gauss2svg.raster import rasterize_like
from gauss2svg.scene import Scene
from gauss2svg.svg.write import write_svg

_SAMPLE = 8  # one of so many Gaussians is written and rasterised
_STRIPS = 4  # one of so many strips of the image is measured


def estimate_export_seconds(
    scene: Scene, write: Callable[[Scene], str], image: NDArray[np.float32], renderer: str
) -> float:
    """Seconds that writing, rasterising and measuring a scene will take."""
    height = image.shape[0]
    part = scene.select(np.arange(0, len(scene), _SAMPLE))
    write(part)  # stops are computed once, for all
    begun = time.perf_counter()
    svg = write(part)
    written = time.perf_counter()
    rasterize_like(svg, image, renderer)
    rasterized = time.perf_counter()
    rasterize_like(write_svg(scene.select(np.arange(0))), image, renderer)
    blank = time.perf_counter()
    strip = image[: max(height // _STRIPS, 1)]
    measure_pixels(strip, strip)
    measured = time.perf_counter()
    rasterize_all = (blank - rasterized) + _SAMPLE * max(
        (rasterized - written) - (blank - rasterized), 0.0
    )
    write_all = _SAMPLE * (written - begun)
    slack = 0.1  # for the report, saving, and the end of the process
    return write_all + rasterize_all + _STRIPS * (measured - blank) + slack
