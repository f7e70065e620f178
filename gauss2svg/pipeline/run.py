"""A run: its progress, threads, memory, photo and kernels.

Kernels are compiled before the fit, so that progress reports it and timings exclude it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numba import get_num_threads, set_num_threads
from numba.core import config

from gauss2svg.errors import refusal
from gauss2svg.fit.options import FitProgress
from gauss2svg.fit.placement import components_of
from gauss2svg.options import Field
from gauss2svg.photo.load import ImageSource, header_of, load_image, rereadable
from gauss2svg.photo.photo import Photo
from gauss2svg.photo.reduce import SizeNeeded, reduced_size
from gauss2svg.pipeline.memory_budget import allowed, check_decoding
from gauss2svg.pipeline.options import RunOptions
from gauss2svg.pipeline.time_budget import TimeBudget
from gauss2svg.render.cpu import splats_of, squared_error
from gauss2svg.scene import ADD, OVER, Scene
from gauss2svg.svg.write import write_svg


@dataclass(frozen=True)
class Progress:
    """The phase of `vectorize`, and the state of the fit.

    phase  "read", "compile", "additive" (only with portable), "fit", "write" or "measure". With
           targets, "correct", "write" and "measure" may follow again
    fit    state of the fit during "additive", "fit" and "correct", otherwise None
    """

    phase: str
    fit: FitProgress | None = None


ProgressCallback = Callable[[Progress], None]


_DEFAULTS = RunOptions()


class Run:
    """A run that has begun: its clock, its resources and its callbacks.

    progress    function that is called with a Progress at every step
    stop        function that is polled at every step. True ends the run with the best so far
    started     start in s of time.perf_counter(). None: now
    threads     number of threads
    most_bytes  memory in bytes that the run may take
    compile_s   seconds spent on compiling or loading kernels so far
    budget      time budget
    reduced_bytes  field of the Header of the photo that has been opened
    ended       whether the run has been stopped
    Raise InputError for a callback that cannot be called, and for more threads than cores.
    """

    def __init__(
        self,
        options: RunOptions = _DEFAULTS,
        progress: ProgressCallback | None = None,
        stop: Callable[[], bool] | None = None,
        started: float | None = None,
    ) -> None:
        self.started = time.perf_counter() if started is None else started
        for name, function in (("progress", progress), ("stop", stop)):
            if function is not None and not callable(function):
                raise refusal(name, "a function", type(function).__name__)
        self.threads = thread_count(options.threads)
        self.most_bytes = allowed(options.max_memory)
        self.compile_s, self.ended, self.budget = 0.0, False, TimeBudget()
        self.reduced_bytes: int | None = None
        self._stop, self._progress, self._max_pixels = stop, progress, options.max_pixels

    def notify(self, phase: str, fit: FitProgress | None = None) -> None:
        """Report a phase, and the state of the fit."""
        if self._progress is not None:
            self._progress(Progress(phase, fit))

    def stop(self) -> bool:
        """Return whether the run must end with the best so far."""
        self.ended = self.ended or (self._stop is not None and self._stop())
        return self.ended

    def read(
        self, image: ImageSource, needed: SizeNeeded, matte: Sequence[float] | None = None
    ) -> Photo:
        """Return the photo. needed and matte are those of `load_image`.

        A photo too large for the memory is refused before it is decoded.
        """
        self.notify("read")
        image = rereadable(image)
        header = header_of(image, max_pixels=self._max_pixels)
        if header is not None:
            self.reduced_bytes = header.reduced_bytes
            reduced = reduced_size(needed, header.width, header.height) is not None
            check_decoding(header, self.most_bytes, reduced=reduced)
        return load_image(image, max_pixels=self._max_pixels, matte=matte, needed=needed)

    @contextmanager
    def compiled(self, blend: str = OVER) -> Iterator[None]:
        """Compile the kernels of this blend, and let numba use the run's threads inside."""
        before = get_num_threads()
        set_num_threads(self.threads)
        try:
            self.notify("compile")
            self.compile_s += compile_kernels(blend=blend)
            yield
        finally:
            set_num_threads(before)

    @property
    def first_s(self) -> float:
        """Seconds of a first compilation, which a time limit does not count, otherwise 0."""
        return self.compile_s if self.compile_s > COMPILED_S else 0.0

    @property
    def total_s(self) -> float:
        """Seconds since the run began."""
        return time.perf_counter() - self.started


def thread_count(count: int | None) -> int:
    """Return the number of threads, by default one for each core. Raise InputError for more."""
    most = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]
    return most if count is None else Field("threads", int, 1, most).checked(count)


_done: set[str] = set()
# Seconds of loading the kernels above which they were compiled. From the disk cache it takes a
# fraction of a second.
COMPILED_S = 2.0


def compile_kernels(blend: str = OVER) -> float:
    """Compile every kernel that a run with this blend needs, and return the seconds spent.

    numba caches kernels on disk. The first run on a machine takes a few seconds, later processes a
    quarter of a second, and later calls 0. Additive blending takes some more once.
    """
    if blend in _done:
        return 0.0
    begun = time.perf_counter()
    if blend != OVER:  # a portable file needs the kernels of both blends
        compile_kernels()
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
