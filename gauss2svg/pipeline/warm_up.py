"""A first tiny run in a process, so that no import or code path of a measured one is the first."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from gauss2svg.pipeline.kernels import compile_kernels
from gauss2svg.pipeline.options import Options
from gauss2svg.pipeline.result import Result
from gauss2svg.pipeline.vectorize import vectorize_by

_SIDE = 32  # px


def warm_up(given: Mapping[str, Any]) -> Result:
    """Load the kernels and vectorise noise in two iterations, with these options by their names."""
    compile_kernels()
    noise = np.random.default_rng(0).random((_SIDE, _SIDE, 3))
    return vectorize_by(Options.from_flat({**given, "iterations": 2}), noise)
