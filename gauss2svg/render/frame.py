"""Frames: small JPEGs of scenes, also of one that is still being fitted."""

from __future__ import annotations

import io
import time
from collections.abc import Callable

import numpy as np
from PIL import Image

from gauss2svg.render import render
from gauss2svg.scene import Scene

MOST_SIDE = 768  # px, of a frame
# docs/decisions/studio.md has what a frame costs, and why it is a raster.
_MOST_A_SECOND = 15
_SHARE = 0.06  # of the CPU time of a fit that its frames may take


class FrameMaker:
    """Makes a frame where one is due: the first at once, then as the time for them allows."""

    def __init__(self, most_a_second: float = _MOST_A_SECOND, most_side: int = MOST_SIDE) -> None:
        self._between_s, self._most_side = 1 / most_a_second, most_side
        self._due = self._cpu_due = 0.0

    def frame(self, scene: Callable[[], Scene]) -> bytes:
        """JPEG of a scene; b"" where none is due."""
        begun, cpu_begun = time.perf_counter(), time.process_time()
        if begun < self._due or cpu_begun < self._cpu_due:
            return b""
        data = as_jpeg(scene(), self._most_side)
        cpu_ended = time.process_time()
        self._due = begun + self._between_s
        # Of the CPU's clock, which other programs do not move.
        self._cpu_due = cpu_ended + (cpu_ended - cpu_begun) / _SHARE
        return data


def as_jpeg(scene: Scene, most_side: int = MOST_SIDE) -> bytes:
    """JPEG of a scene, at most most_side px on its longer side; a transparent one over white."""
    share = min(1.0, most_side / max(scene.width, scene.height))
    width, height = (max(1, round(side * share)) for side in (scene.width, scene.height))
    levels = np.clip(render(scene, width, height) * 255 + 0.5, 0, 255).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(levels).save(stream, "JPEG", quality=80)
    return stream.getvalue()
