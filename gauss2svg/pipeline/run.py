"""A run: its callbacks, its threads, the sizes of its images, and its limits of memory and time.

The sizes and the memory are known before the fit. The memory is estimated as an upper bound of the
process's resident size. For a photo of P px that is measured at M px and fitted at F px, the three
stages of a run need these numbers of bytes:

    decoding    31 P, or d P + 12 M if decoding reduces the photo, where d depends on the format
    fitting     12 M + a F, where a depends on the loss
    measuring   57 M + 36 F

For a transparent photo, 70, 28 and 151 replace 31, 12 and 57. Inks need more.
The estimate is the sum of the largest stage, the interpreter with its libraries, and the shapes,
times a margin. docs/decisions/memory.md compares it with the memory that processes really take. The
estimate does not include other programs that rasterise the file, nor the first compilation of the
kernels, which takes 105 MB.
"""

import math
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from gauss2svg.errors import InputError, refusal
from gauss2svg.fit import FitProgress, has_ssim, schedule
from gauss2svg.options import Field
from gauss2svg.photo.load import ImageSource, header_of, load_image, rereadable
from gauss2svg.photo.pixels import Header, Photo, Size, SizeNeeded, elongation, reduced_size
from gauss2svg.pipeline.options import Progress, ProgressCallback, RunOptions
from gauss2svg.pipeline.plan import Plan
from gauss2svg.processes import MEMORY_SHARE, free_bytes, held_bytes
from gauss2svg.render import cpu
from gauss2svg.scene import ADD

# A file is measured at this many pixels or more, unless the photo itself has fewer
# (docs/decisions/photo.md).
MEASURED_PIXELS = 1_000_000
# Bytes of memory that a photo takes per pixel. A tuple has a number for the photo while it is held,
# one while it is decoded, and one while a file is measured against it. The first tuple is for an
# opaque photo, and the second for a photo with alpha (docs/decisions/memory.md).
_PIXEL_BYTES = (12, 31, 57), (28, 70, 151)


# Memory of a run, as it was measured (docs/decisions/memory.md).
BASE = 130e6  # bytes that a run takes even with a photo of a few pixels
SHAPE = 3000  # bytes per Gaussian
MARGIN = 1.2  # factor on the estimate, for memory that was not measured


def measured_size(photo: Size, fit: Size = (1, 1), least: float = MEASURED_PIXELS) -> Size:
    """Return the width and height in px at which a file is measured.

    It is the size of the fit if the fit has at least `least` pixels. Otherwise it is the size of
    the photo, reduced to about `least` pixels if the photo has more.
    """
    if fit[0] * fit[1] >= least or fit == photo:
        return fit
    scale = math.sqrt(least / (photo[0] * photo[1]))
    if scale >= 1:
        return photo
    # This makes the longest side a whole number of px.
    scale = math.ceil(scale * max(photo)) / max(photo)
    width, height = (max(1, round(scale * side)) for side in photo)
    return width, height


@dataclass(frozen=True)
class Load:
    """The sizes of the images in a run, and the memory that the run needs.

    plan   plan of the run
    photo  header of the photo
    fit    width and height in px of the image that the fit runs on
    """

    plan: Plan
    photo: Header
    fit: Size

    @property
    def measured(self) -> Size:
        """Width and height in px at which the file is measured.

        With a short time limit they are smaller, because measuring takes time.
        """
        if self.plan.options.run.full_size:
            return self.photo.size
        within = pixels_within(self.plan.goal.time_limit or math.inf)
        return measured_size(self.photo.size, self.fit, min(MEASURED_PIXELS, within))

    @property
    def most_gaussians(self) -> int:
        """Largest number of Gaussians that the run may use."""
        return max(self.plan.caps(math.prod(self.fit)))

    @property
    def bytes(self) -> int:
        """Estimated upper bound of the run's memory in bytes."""
        plan, options, target = self.plan, self.plan.options, self.plan.goal.target
        fit, kept = math.prod(self.fit), math.prod(self.measured)
        held, _, measured = _PIXEL_BYTES[self.photo.has_alpha]
        inked = 34 * plan.in_inks  # a fit in inks has a target besides the photo
        each = 330 if plan.in_areas else 130 if has_ssim(options.fit.loss) else 75
        fitting = held * kept + (each + inked) * fit
        measured = max(measured, held + (target.pixel_bytes if target is not None else 0))
        # After the fit, 36 bytes per pixel of it stay in memory.
        measuring = measured * kept + (36 + inked) * fit
        measuring += 110e6 * (options.fit.blend == ADD)
        most = max(_decoding(self.photo, kept), fitting, measuring)
        return math.ceil(MARGIN * (BASE + most + SHAPE * self.most_gaussians))


def _decoding(photo: Header, kept: int) -> int:
    """Return the bytes of memory that decoding a photo takes.

    kept  number of pixels that the photo has after it is read. If the photo's file has more pixels,
          and the format of the file allows it, the photo is reduced while it is decoded, which
          takes less memory
    """
    held, decoded, _ = _PIXEL_BYTES[photo.has_alpha]
    pixels = photo.width * photo.height
    if photo.reduced_bytes is not None and kept < pixels:
        return photo.reduced_bytes * pixels + held * kept
    return decoded * pixels


def memory_limit(max_memory: int | str | None) -> int:
    """Return the number of bytes of memory that a run may take.

    max_memory  value of the option max_memory in bytes. If the user gave a text such as "2G", the
                check of the option has already converted it. None means MEMORY_SHARE of the sum
                of the free memory and the memory that the process holds
    """
    return int(max_memory or MEMORY_SHARE * (free_bytes() + held_bytes()))


def check_decoding(header: Header, limit: int, is_reduced: bool) -> None:
    """Raise InputError if decoding a photo takes more than `limit` bytes of memory.

    is_reduced  whether the photo is reduced while it is decoded
    """
    kept = 0 if is_reduced else header.width * header.height
    needed = math.ceil(MARGIN * (BASE + _decoding(header, kept)))
    if needed > limit:
        photo = f"a photo of {_px(header.size)}"
        raise _too_little(needed, limit, photo, "a smaller photo")


def size_that_fits(load: Load, limit: int, asked: bool) -> tuple[Load, str | None]:
    """Reduce the size of the fit until the run's memory is at most `limit` bytes.

    Return the load with this size, and a note for the user if the fit had to be reduced.

    asked  whether the user asked for the size of the fit, so that it must not be reduced
    Raise InputError if the size must not be reduced but takes too much memory, or if a run takes
    too much memory even with a fit at one pixel.
    """
    if load.bytes <= limit:
        return load, None

    def with_side(longest: int) -> Load:
        width, height = (max(1, longest * side // max(load.fit)) for side in load.fit)
        return replace(load, fit=(width, height))

    if with_side(1).bytes > limit:
        work = f"a photo of {_px(load.photo.size)} and up to {load.most_gaussians} Gaussians"
        raise _too_little(with_side(1).bytes, limit, work, "a smaller photo")
    if asked:
        raise _too_little(load.bytes, limit, f"a fit on {_px(load.fit)}", "a smaller --max-size")
    longer = bisect_right(range(max(load.fit)), limit, lo=1, key=lambda side: with_side(side).bytes)
    largest = with_side(longer - 1)
    return largest, f"fitted at {_px(largest.fit)} to stay under {_megabytes(limit)} of memory"


def _too_little(needed: float, limit: int, work: str, advice: str) -> InputError:
    least, advice = f"at least {_megabytes(needed)} for {work}", f"{advice}, or a larger"
    return refusal("memory", least, _megabytes(limit), f"{advice} --max-memory")


def _px(size: Size) -> str:
    return f"{size[0]}x{size[1]} px"


def _megabytes(size: float) -> str:
    return f"{size / 1e6:.0f} MB" if size >= 1e6 else f"{size:.0f} bytes"


def pixels_within(time_limit: float) -> float:
    """Return the largest number of pixels that a fit may have with this time limit in s.

    Half a second of the limit is set aside for start-up (docs/decisions/time.md).
    """
    return 150_000 * max(time_limit - 0.5, 0.25)


def load_of(plan: Plan, photo: Header) -> Load:
    """Return the load of a run.

    The option max_size decides the size of the fit. If it is not given, the preset and the time
    limit decide.
    """
    given, limit = plan.options.run.max_size, plan.goal.time_limit
    width, height = photo.width, photo.height
    longest = given or plan.preset.max_size * elongation(width, height)
    scale = min(1.0, longest / max(width, height))
    if limit is not None and given is None:
        scale = min(scale, math.sqrt(pixels_within(limit) / (width * height)))
    return Load(plan, photo, (max(1, round(width * scale)), max(1, round(height * scale))))


STEP_GAUSSIAN = 8e-7  # seconds that a step of the fit takes for each Gaussian
EXPORT_GAUSSIAN = 5e-5  # seconds for each Gaussian to write, rasterise and measure a file
# The search for the file's colours takes this many seconds for each Gaussian.
COLORS_GAUSSIAN = 7e-5
# With a time limit, a fit should have this number of steps. If there is time for more steps, the
# fit has more Gaussians instead. For a photo, doubling the number of Gaussians improves the picture
# more than doubling the number of steps does.
STEPS = 100
# A fit has at least this number of Gaussians. If the time is too short for them, the fit has fewer
# steps instead.
FEWEST = 150


@dataclass
class TimeBudget:
    """The time that is left of a time limit, and how much of it the fit may use.

    deadline  value of time.perf_counter() at which the run must end, infinite without a limit
    pixels    number of pixels of the image that the fit runs on
    measured  number of pixels at which the file is measured
    threads   number of threads of the fit
    steps     number of steps that the fit should have
    """

    deadline: float = math.inf
    pixels: int = 1
    measured: int = 1
    threads: int = 1
    steps: int = STEPS

    def __post_init__(self) -> None:
        # Seconds of an export, to which each Gaussian adds EXPORT_GAUSSIAN.
        self._export_s = 0.06 + 1.3e-6 * self.measured
        # The sums do not begin with 0, so that the first steps change their ratio only a little.
        self._predicted = self._taken = 0.03
        # The time at which the last step ended, and the number of Gaussians in that step.
        self._last_step = 0.0, -1
        self.begin_fit(0)

    @property
    def _slowness(self) -> float:
        """Seconds that all steps so far took, divided by those that were predicted for them."""
        return self._taken / self._predicted

    def begin_fit(self, count: int, share: float = 1.0) -> None:
        """Note that a fit of about `count` Gaussians begins.

        share  share of the time for fitting that this fit may take
        """
        self._begun, self._share, self._reserved_for = time.perf_counter(), share, count

    def note_step(self, pixels: int, count: int, done: float) -> None:
        """Note the end of a step of the fit, and learn from its time.

        pixels  number of pixels of the image in this step
        count   number of Gaussians in this step
        done    progress of the fit in 0..1
        The time of the first step with a new count, or after a call of `most_gaussians`, is
        ignored, because it includes other work.
        """
        now, growing = time.perf_counter(), done <= schedule.GROWTH_SHARE
        if count == self._last_step[1]:
            step_s = self._step_s(pixels) + STEP_GAUSSIAN * count
            self._taken += now - self._last_step[0]
            # A step of growth takes half of the time that is predicted for other steps.
            self._predicted += (0.5 if growing else 1.0) * step_s
        self._last_step = now, count
        if not growing:
            self._reserved_for = count

    def most_gaussians(self, done: float, colors: bool = False) -> float:
        """Return how many Gaussians can be fitted and exported in the time that is left.

        The number is at least FEWEST.

        done    progress of the fit in 0..1. It tells how many steps must still be done in that time
        colors  whether the search for the file's colours will take time too
        """
        # The caller does other work before the next step. So the time from now to the end of that
        # step must not count as the time of a step.
        self._last_step = 0.0, -1
        steps = self.steps * (1 - done)
        left = self._left_s() / self._slowness
        each = STEP_GAUSSIAN * steps + EXPORT_GAUSSIAN + colors * COLORS_GAUSSIAN
        return max(FEWEST, (left - self._step_s(self.pixels) * steps - self._export_s) / each)

    @property
    def must_export(self) -> bool:
        """Whether a file must be written now, because there is no time for anything else."""
        return self._left_s() < self._reserved_s(max(self._reserved_for, FEWEST))

    def fit_ends(self) -> float:
        """Return the value of time.perf_counter() at which the fit must end.

        It is infinite without a time limit. The time from then to the deadline is reserved for the
        export and for the search for the file's colours. This search interrupts the fit, but its
        time does not count as time of the fit.
        """
        whole = self.deadline - self._begun
        # If the export needs more than .6 of the time, Gaussians are removed. A fit of less than
        # .15 s could hardly be recognised.
        fitting = whole - min(self._reserved_s(self._reserved_for), 0.6 * whole)
        return self._begun + max(self._share * fitting, 0.15)

    def _step_s(self, pixels: int) -> float:
        """Return the predicted seconds of a step, without the time that each Gaussian adds.

        All threads work on the pixels. Each one after the first adds .8 of the first one's speed.
        """
        return 5e-4 + 3.3e-8 * pixels / (1 + 0.8 * (self.threads - 1))

    def _left_s(self) -> float:
        return max(self.deadline - time.perf_counter(), 0.0)

    def _reserved_s(self, count: int) -> float:
        each = EXPORT_GAUSSIAN + COLORS_GAUSSIAN
        return self._slowness * (self._export_s + each * count)


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

    def read(self, image: ImageSource, needed: SizeNeeded, matte: str | None = None) -> Photo:
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
        with cpu.kernel_lock:
            before, cpu.threads = cpu.threads, self.threads
            try:
                yield
            finally:
                cpu.threads = before


def thread_count(count: int | None) -> int:
    """Return `count`, or the number of cores if it is None.

    Raise InputError if `count` is larger than the number of cores.
    """
    return cpu.CORES if count is None else Field("threads", int, 1, cpu.CORES).checked(count)
