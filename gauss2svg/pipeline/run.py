"""A run: its progress, its threads, its memory, and the reading of its photo.

The kernels are compiled before the fit, so that the progress shows the compilation as a phase of
its own, and the time of the fit does not include it.
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
from gauss2svg.fit import FitOptions, FitProgress
from gauss2svg.fit.adam import blending_of, step
from gauss2svg.fit.placement import components_of
from gauss2svg.fit.state import State
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
    """Return a context manager that yields the callback of a run, or None.

    If `progress` is a function, this function is the callback. If `progress` is True, the callback
    shows the run in a terminal or in a notebook.
    """
    if progress is not True:
        return nullcontext(None if progress is False else progress)
    # This is imported here, because only few calls show the progress.
    from gauss2svg.pipeline.progress_display import shown

    return shown()


class Run:
    """A run that has begun: its clock, its resources and its callbacks.

    progress    function that is called with a Progress at every step
    stop        function that is called at every step. If it returns True, the run ends with the
                best result so far
    started     value of time.perf_counter() when the run began. None: now
    threads     number of threads
    most_bytes  largest memory in bytes that the run may take
    compile_s   seconds that the run has spent on compiling or loading kernels
    budget      time budget of the run
    reduced_bytes  Header.reduced_bytes of the photo, None before the photo is read
    ended       whether `stop` has ended the run
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
        """Report the phase of the run and the state of the fit to `progress`."""
        if self._progress is not None:
            self._progress(Progress(phase, fit))

    def stop(self) -> bool:
        """Call the function `stop`. Return whether the run must end with its best result so far."""
        self.ended = self.ended or (self._stop is not None and self._stop())
        return self.ended

    def end_reason(self, otherwise: str, is_late: bool = False) -> str:
        """Return the stop_reason of a search: it was stopped, its time is over, or `otherwise`."""
        reason = "time_limit" if is_late else otherwise
        return "interrupted" if self.ended else reason

    def read(
        self, image: ImageSource, needed: SizeNeeded, matte: Sequence[float] | None = None
    ) -> Photo:
        """Read the photo and return it. The arguments `needed` and `matte` are as in `load_image`.

        Raise InputError for a photo that is too large for the memory, before it is decoded.
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
    def compiled(self, blend: str = OVER, areas: bool = False) -> Iterator[None]:
        """Compile the kernels of the run, and let numba use its threads in the block.

        blend  blend mode of the Gaussians
        areas  whether the run finds areas
        Only one thread of a process can be in such a with block. If other threads have runs too,
        they wait here until it has left the block.
        """
        with kernel_lock:
            before = get_num_threads()
            set_num_threads(self.threads)
            try:
                self.notify("compile")
                begun = time.perf_counter()
                compile_kernels(blend)
                if areas:
                    compile_areas()
                self.compile_s += time.perf_counter() - begun
                yield
            finally:
                set_num_threads(before)

    @property
    def first_s(self) -> float:
        """Seconds that the first compilation of the kernels took, 0 if they were only loaded.

        These seconds do not count for a time limit.
        """
        return self.compile_s if self.compile_s > COMPILED_S else 0.0


def thread_count(count: int | None) -> int:
    """Return `count`, or the number of cores if it is None.

    Raise InputError if `count` is larger than the number of cores.
    """
    most = config.NUMBA_NUM_THREADS  # pyright: ignore[reportAttributeAccessIssue]
    return most if count is None else Field("threads", int, 1, most).checked(count)


# If a run spends more seconds than this on getting the kernels, it is assumed to compile them.
# Loading them from the cache on disk takes only a fraction of a second.
COMPILED_S = 2.0


@cache
def compile_kernels(blend: str = OVER) -> None:
    """Compile every kernel that a run with this blend needs.

    This takes a few seconds in the first run on a machine, and some seconds more in the first
    additive run. numba caches the kernels on disk, so that later processes load them in a quarter
    of a second.
    """
    if blend != OVER:  # an additive run may write a portable file, which needs both blends
        compile_kernels(OVER)
    shape = np.full((1, 2), 2.0), np.ones((1, 2)), np.zeros(1), np.full((1, 3), 0.5), np.ones(1)
    scene = Scene(4, 4, *shape, blend=blend)
    splats = splats_of(scene)
    moments = squared_error(splats, np.zeros((3, 4, 4), np.float32))[2]
    step(State.of_scene(scene), moments, splats, blending_of(FitOptions()), 4.0)
    components_of(np.zeros((4, 4), np.int32))
    # Writing an additive scene needs more kernels, so one is written to compile them.
    if blend == ADD:
        from gauss2svg.svg.write import write_svg

        write_svg(scene)


@cache
def compile_areas() -> None:
    """Compile every kernel that a run needs to find and to draw areas and lines."""
    # These are imported here because few runs have areas.
    from gauss2svg.areas.clean import LEAST_NOISE, cleaned
    from gauss2svg.areas.find import find_areas
    from gauss2svg.render import render

    # A disc and a line that leaves the picture, with antialiased edges and in colours that mix.
    y, x = np.mgrid[:24, :24] + 0.5
    disc = np.clip(6.5 - np.hypot(x - 9, y - 9), 0, 1)
    line = np.clip(1.5 - np.abs(x - y - 9), 0, 1)
    picture = np.ones((24, 24, 3)) - disc[..., None] * [0.9, 0.2, 0.1] - 0.8 * line[..., None]
    picture = np.clip(picture, 0, 1).astype(np.float32)
    cleaned(picture, LEAST_NOISE)
    render(Scene(24, 24, areas=find_areas(picture).areas))
