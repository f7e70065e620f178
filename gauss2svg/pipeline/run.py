"""A run: its progress, threads, memory, photo and kernels.

Kernels are compiled before the fit, so that progress shows the compilation and timings exclude it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import cache

import numpy as np
from numba import get_num_threads, set_num_threads
from numba.core import config

from gauss2svg.errors import refusal
from gauss2svg.fit import FitProgress
from gauss2svg.fit.placement import components_of
from gauss2svg.options import Field
from gauss2svg.photo.load import ImageSource, header_of, load_image, rereadable
from gauss2svg.photo.pixels import Photo, SizeNeeded, reduced_size
from gauss2svg.pipeline.budgets import TimeBudget, check_decoding, memory_limit
from gauss2svg.pipeline.options import Progress, ProgressCallback, RunOptions
from gauss2svg.render.cpu import kernel_lock, splats_of, squared_error
from gauss2svg.scene import ADD, OVER, Scene


def watched(
    progress: ProgressCallback | bool | None,
) -> AbstractContextManager[ProgressCallback | None]:
    """Return a context with a run's callback: `progress`, or for True one that shows the run."""
    if progress is not True:
        return nullcontext(None if progress is False else progress)
    from gauss2svg.pipeline.progress_display import shown  # few calls ask for it

    return shown()


class Run:
    """A run that has begun: its clock, its resources and its callbacks.

    progress    function that is called with a Progress at every step
    stop        function that is polled at every step. True ends the run with the best so far
    started     start of the run in s of time.perf_counter(). None: now
    threads     number of threads
    most_bytes  memory in bytes that the run may take
    compile_s   seconds spent on compiling or loading kernels so far
    budget      time budget
    reduced_bytes  Header.reduced_bytes of the photo, None before it is read
    ended       whether the run has been stopped
    Raise InputError for a callback that cannot be called, and for more threads than cores.
    """

    def __init__(
        self,
        options: RunOptions = RunOptions(),
        progress: ProgressCallback | None = None,
        stop: Callable[[], bool] | None = None,
        started: float | None = None,
    ) -> None:
        self.started = time.perf_counter() if started is None else started
        for name, function in (("progress", progress), ("stop", stop)):
            if function is not None and not callable(function):
                raise refusal(name, "a function", type(function).__name__)
        self.threads = thread_count(options.threads)
        self.most_bytes = memory_limit(options.max_memory)
        self.compile_s, self.ended, self.budget = 0.0, False, TimeBudget()
        self.reduced_bytes: int | None = None
        self._stop, self._progress, self._max_pixels = stop, progress, options.max_pixels

    def notify(self, phase: str, fit: FitProgress | None = None) -> None:
        """Report a phase, and the state of the fit."""
        if self._progress is not None:
            self._progress(Progress(phase, fit))

    def stop(self) -> bool:
        """Poll `stop`, and return whether the run must end with the best so far."""
        self.ended = self.ended or (self._stop is not None and self._stop())
        return self.ended

    def read(
        self, image: ImageSource, needed: SizeNeeded, matte: Sequence[float] | None = None
    ) -> Photo:
        """Read the photo, and return it. needed and matte are those of `load_image`.

        A photo that is too large for the memory is refused before it is decoded.
        """
        self.notify("read")
        image = rereadable(image)
        header = header_of(image, max_pixels=self._max_pixels)
        if header is not None:
            self.reduced_bytes = header.reduced_bytes
            size = reduced_size(needed, header.width, header.height)
            check_decoding(header, self.most_bytes, is_reduced=size is not None)
        return load_image(image, max_pixels=self._max_pixels, matte=matte, needed=needed)

    @contextmanager
    def compiled(self, blend: str = OVER) -> Iterator[None]:
        """Compile the kernels of this blend, and let numba use the run's threads in the block.

        Runs in several threads of a process wait here for each other.
        """
        with kernel_lock:
            before = get_num_threads()
            set_num_threads(self.threads)
            try:
                self.notify("compile")
                begun = time.perf_counter()
                compile_kernels(blend)
                self.compile_s += time.perf_counter() - begun
                yield
            finally:
                set_num_threads(before)

    @property
    def first_s(self) -> float:
        """Seconds of a first compilation, which no time limit counts. 0 if nothing was compiled."""
        return self.compile_s if self.compile_s > COMPILED_S else 0.0


def thread_count(count: int | None) -> int:
    """Return `count`, or one thread for each core if None. Raise InputError for more threads."""
    most = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]
    return most if count is None else Field("threads", int, 1, most).checked(count)


# Kernels that took more seconds than this were compiled. Loading them from the disk cache takes a
# fraction of a second.
COMPILED_S = 2.0


@cache
def compile_kernels(blend: str = OVER) -> None:
    """Compile every kernel that a run with this blend needs.

    numba caches kernels on disk. This takes a few seconds in the first run on a machine, and a
    quarter of a second in later processes. The first additive run takes some seconds more.
    """
    if blend != OVER:  # a portable file needs the kernels of both blends
        compile_kernels(OVER)
    shape = np.full((1, 2), 2.0), np.ones((1, 2)), np.zeros(1), np.full((1, 3), 0.5), np.ones(1)
    scene = Scene(4, 4, *shape, blend=blend)
    squared_error(splats_of(scene), np.zeros((3, 4, 4), np.float32))
    components_of(np.zeros((4, 4), np.int32))
    if blend == ADD:  # writing an additive scene has kernels of its own
        from gauss2svg.svg.write import write_svg

        write_svg(scene)
