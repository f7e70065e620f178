"""Frames: small JPEGs of scenes, also during a fit."""

from __future__ import annotations

import io
import time
from collections.abc import Callable

import numpy as np
from PIL import Image

from gauss2svg.render import render
from gauss2svg.scene import Scene

MOST_SIDE = 768  # px of a frame's longer side
# Limits of the cost of frames (docs/decisions/studio.md).
_MOST_A_SECOND = 15  # frames a second
_SHARE = 0.06  # share of a fit's CPU time that its frames may take


class FrameMaker:
    """Maker of a fit's frames. The first is due at once, later ones when the limits allow it."""

    def __init__(self, most_a_second: float = _MOST_A_SECOND, most_side: int = MOST_SIDE) -> None:
        self._between_s, self._most_side = 1 / most_a_second, most_side
        self._due = self._cpu_due = 0.0

    def frame(self, scene: Callable[[], Scene]) -> bytes:
        """Return a JPEG of the scene, or b"" if no frame is due."""
        started, cpu_started = time.perf_counter(), time.process_time()
        if started < self._due or cpu_started < self._cpu_due:
            return b""
        data = as_jpeg(scene(), self._most_side)
        cpu_ended = time.process_time()
        self._due = started + self._between_s
        # By this process's CPU time, which other programs do not change.
        self._cpu_due = cpu_ended + (cpu_ended - cpu_started) / _SHARE
        return data


def as_jpeg(scene: Scene, most_side: int = MOST_SIDE) -> bytes:
    """Return a JPEG of a scene over its background, at most most_side px on the longer side."""
    share = min(1.0, most_side / max(scene.width, scene.height))
    width, height = (max(1, round(side * share)) for side in (scene.width, scene.height))
    levels = np.clip(render(scene, width, height) * 255 + 0.5, 0, 255).astype(np.uint8)
    stream = io.BytesIO()
    Image.fromarray(levels).save(stream, "JPEG", quality=80)
    return stream.getvalue()
