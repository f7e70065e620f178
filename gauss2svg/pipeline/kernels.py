"""Compiling the kernels once, so that progress can say so and timings leave it out."""

import time

import numpy as np

from gauss2svg.fit import adam
from gauss2svg.fit.options import DEFAULT_DTYPE
from gauss2svg.fit.state import State
from gauss2svg.render.cpu import removal_cost, squared_error
from gauss2svg.scene import ADD, OVER, Scene
from gauss2svg.svg.write import write_svg

_done: set[tuple[str, str]] = set()
# Kernels from the disk cache take a fraction of a second; longer means that they were compiled.
COMPILED_S = 2.0


def compile_kernels(dtype: str = DEFAULT_DTYPE, blend: str = OVER) -> float:
    """Seconds spent until every kernel is ready; numba keeps them on disk for later runs.

    About 10 s the first time ever, a tenth of a second from the disk cache, 0 after that.
    float64 and sums take some more, once.
    """
    if (dtype, blend) in _done:
        return 0.0
    begun = time.perf_counter()
    if dtype != DEFAULT_DTYPE:  # measuring is done in the default one
        compile_kernels(blend=blend)
    if blend != OVER:  # a portable form goes on in that one
        compile_kernels(dtype)
    one = np.ones(1)
    state = State.empty().append(
        np.full((1, 2), 2.0), np.array([[1.0, 0.0, 1.0]]), 0 * one, np.ones((1, 3)), one, 0
    )
    target = np.zeros((3, 4, 4), dtype)
    splats = state.splats(np.zeros(3), blend)
    removal_cost(splats, target)
    moments = squared_error(splats, target)[2]
    gradient = adam.gradients(moments, splats.paint[:, 0], splats.shape[:, 5])
    adam.step(state, gradient, adam.Rates(), adam.Limits(0.35, 4.0), 1.0)
    if blend == ADD:  # the file of a sum has kernels of its own
        center, color = np.full((1, 2), 2.0), np.full((1, 3), 0.5)
        write_svg(Scene(4, 4, center, np.ones((1, 2)), np.zeros(1), color, one, blend=blend))
    _done.add((dtype, blend))
    return time.perf_counter() - begun
