"""Compiles the kernels ahead of a run, so that progress can report it and timings exclude it."""

import time

import numpy as np

from gauss2svg.fit.components import components_of
from gauss2svg.photo.entropy import lack, table_of
from gauss2svg.render.cpu import splats_of, squared_error
from gauss2svg.scene import ADD, OVER, Scene
from gauss2svg.svg.write import write_svg

_done: set[str] = set()
# Loading the kernels from the disk cache takes a fraction of a second; if it took longer than this,
# they were compiled.
COMPILED_S = 2.0


def compile_reading() -> float:
    """Compile what reading a JPEG needs; returns the seconds spent."""
    begun = time.perf_counter()
    table = table_of(b"", b"")
    lack([b""], 1, 1, [(table, table)], (0, 0), False, np.zeros(1, np.uint64))
    return time.perf_counter() - begun


def compile_kernels(blend: str = OVER) -> float:
    """Compile every kernel that a run with this blend needs; returns the seconds spent.

    numba caches them on disk: a few seconds for the first run on a machine, a quarter of a second
    in later processes, 0 afterwards. Additive blending takes some more, once.
    """
    if blend in _done:
        return 0.0
    begun = time.perf_counter()
    if blend != OVER:  # a portable file is alpha-composited
        compile_kernels()
    compile_reading()
    one = np.ones(1)
    scene = Scene(
        4, 4, np.full((1, 2), 2.0), np.ones((1, 2)), np.zeros(1), np.full((1, 3), 0.5), one,
        blend=blend,
    )  # fmt: skip
    squared_error(splats_of(scene), np.zeros((3, 4, 4), np.float32))
    components_of(np.zeros((4, 4), np.int32))
    if blend == ADD:  # writing an additive scene has kernels of its own
        write_svg(scene)
    _done.add(blend)
    return time.perf_counter() - begun
