"""A run: its progress, its threads, its memory, and the reading of its photo."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext

from gauss2svg.errors import refusal
from gauss2svg.fit import FitProgress
from gauss2svg.options import Field
from gauss2svg.photo.load import ImageSource, header_of, load_image, rereadable
from gauss2svg.photo.pixels import Photo, SizeNeeded, reduced_size
from gauss2svg.pipeline.budgets import TimeBudget, check_decoding, memory_limit
from gauss2svg.pipeline.options import Progress, ProgressCallback, RunOptions
from gauss2svg.render import tiles
from gauss2svg.render.cpu import kernel_lock


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
        self.ended, self.budget = False, TimeBudget()
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
    def threaded(self) -> Iterator[None]:
        """Let the kernels use the threads of the run in the block.

        Only one thread of a process can be in such a with block. If other threads have runs too,
        they wait here until it has left the block.
        """
        with kernel_lock:
            before, tiles.threads = tiles.threads, self.threads
            try:
                yield
            finally:
                tiles.threads = before


def thread_count(count: int | None) -> int:
    """Return `count`, or the number of cores if it is None.

    Raise InputError if `count` is larger than the number of cores.
    """
    return tiles.CORES if count is None else Field("threads", int, 1, tiles.CORES).checked(count)
