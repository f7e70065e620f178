"""Image sizes of a run, and the memory that the run needs and may use.

All of these are known before the fit. The estimate is an upper bound of the process's resident size
in bytes. For a photo of P px that is measured at M px and fitted at F px, three stages need

    decoding    31 P, or d P + 12 M if decoding reduces the photo, where d depends on the format
    fitting     12 M + a F, where a depends on the loss
    measuring   57 M + 36 F

For a transparent photo, 70, 28 and 151 replace 31, 12 and 57. Inks and enlarged drawings need more.
The estimate is the sum of the largest stage, the interpreter, the libraries and the shapes, times a
margin, which benchmarks/memory.py compares with processes. The estimate leaves out other programs
that rasterise, and the first compilation of the kernels (105 MB).
"""

from __future__ import annotations

import math
import time
from bisect import bisect_right
from dataclasses import dataclass, replace

from gauss2svg.errors import InputError, refusal
from gauss2svg.fit import has_ssim
from gauss2svg.fit.schedule import GROWTH_SHARE
from gauss2svg.photo.pixels import Header, Size
from gauss2svg.pipeline.drawings import LARGEST_ENLARGED
from gauss2svg.pipeline.plan import CAP_FOR_TARGET, Plan
from gauss2svg.processes import MEMORY_SHARE, free_bytes, held_bytes
from gauss2svg.raster import DEFAULT_RENDERER
from gauss2svg.scene import ADD

# Fewest pixels at which a file is measured, if the photo has as many (docs/decisions/photo.md).
MEASURED_PIXELS = 1_000_000
# Bytes of a pixel while it is held, while it is decoded and while it is measured: first for an
# opaque photo, then for one with alpha (benchmarks/memory.py).
_PIXEL_BYTES = (12, 31, 57), (28, 70, 151)


# Measured bytes of a run (docs/decisions/memory.md).
BASE = 205e6  # bytes of a run with a photo of a few pixels
SHAPE = 3000  # bytes of each Gaussian
FIT = 75  # bytes of each pixel of the fit
FIT_SSIM = 130  # bytes of each pixel of a fit whose loss has SSIM
INKS = 34  # bytes added for each pixel of a fit in inks, because its target is not the photo
ENLARGED = 230  # bytes of each pixel of an enlarged drawing
LARGEST = 1024**2  # largest number of pixels of an enlarged drawing
HELD = 36  # bytes still held for each pixel of the fit after the fit has ended
ADDITIVE = 110e6  # bytes for writing an additive scene
MARGIN = 1.2  # factor for memory that was not measured


def measured_size(photo: Size, fit: Size = (1, 1), least: float = MEASURED_PIXELS) -> Size:
    """Return the size in px at which a file is measured.

    It is the fit's size if the fit has at least `least` pixels. Otherwise it is the photo's size,
    reduced to about `least` pixels if the photo has more.
    """
    if fit[0] * fit[1] >= least or fit == photo:
        return fit
    scale = math.sqrt(least / (photo[0] * photo[1]))
    if scale >= 1:
        return photo
    scale = math.ceil(scale * max(photo)) / max(photo)  # makes the longest side whole
    width, height = (max(1, round(scale * side)) for side in photo)
    return width, height


@dataclass(frozen=True)
class Load:
    """The sizes and the memory of a run.

    plan   plan of the run
    photo  header of the photo
    fit    width and height in px of the image that the fit runs on
    """

    plan: Plan
    photo: Header
    fit: Size

    @property
    def measured(self) -> Size:
        """Width and height in px at which the file is measured, smaller with a short time limit."""
        if self.plan.options.run.full_size:
            return self.photo.size
        within = pixels_within(self.plan.goal.time_limit or math.inf)
        return measured_size(self.photo.size, self.fit, min(MEASURED_PIXELS, within))

    @property
    def most_gaussians(self) -> int:
        """Largest number of Gaussians that the run may use."""
        if self.plan.goal.count is not None:
            return self.plan.goal.count
        caps = [CAP_FOR_TARGET if one.aim else one.preset.cap for one in self.plan.searches()]
        return min(max(caps), math.prod(self.fit) // 2)

    @property
    def bytes(self) -> int:
        """Estimated upper bound of the run's memory in bytes."""
        plan, options, target = self.plan, self.plan.options, self.plan.goal.target
        fit, kept = math.prod(self.fit), math.prod(self.measured)
        held, _, measured = _PIXEL_BYTES[self.photo.has_alpha]
        inked = INKS * plan.in_inks
        fitting = held * kept + ((FIT_SSIM if has_ssim(options.fit.loss) else FIT) + inked) * fit
        if plan.goal.byte_limit is not None and max(self.photo.size) <= LARGEST_ENLARGED:
            fitting += ENLARGED * min(16 * fit, LARGEST)
        measured = max(measured, held + (target.pixel_bytes if target is not None else 0))
        measuring = measured * kept + (HELD + inked) * fit
        measuring += ADDITIVE * (options.fit.blend == ADD)
        most = max(_decoding(self.photo, kept), fitting, measuring)
        return math.ceil(MARGIN * (BASE + most + SHAPE * self.most_gaussians))


def _decoding(photo: Header, kept: int) -> int:
    """Return the bytes that decoding takes if it reduces the photo to `kept` pixels."""
    held, decoded, _ = _PIXEL_BYTES[photo.has_alpha]
    pixels = photo.width * photo.height
    if photo.reduced_bytes is not None and kept < pixels:
        return photo.reduced_bytes * pixels + held * kept
    return decoded * pixels


def memory_limit(max_memory: int | str | None) -> int:
    """Return the bytes of memory that a run may take.

    This is `max_memory`, which the option's check has made a number. If None, it is MEMORY_SHARE of
    the sum of the free memory and the memory that the process holds.
    """
    return int(max_memory or MEMORY_SHARE * (free_bytes() + held_bytes()))


def check_decoding(header: Header, limit: int, is_reduced: bool) -> None:
    """Raise InputError if decoding a photo takes more memory than `limit` bytes.

    is_reduced  whether the photo is reduced while it is decoded
    """
    kept = 0 if is_reduced else header.width * header.height
    needed = math.ceil(MARGIN * (BASE + _decoding(header, kept)))
    if needed > limit:
        photo = f"a photo of {_px(header.size)}"
        raise _too_little(needed, limit, photo, "a smaller photo")


def size_that_fits(load: Load, limit: int, asked: bool) -> tuple[Load, str | None]:
    """Return the load of the largest fit within `limit` bytes, and a note if the fit is reduced.

    asked  whether the user asked for the fit's size, so that it may not be reduced
    Raise InputError if this size does not fit, or if no size does.
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


# Size of a fit within a time limit (docs/decisions/time.md).
PIXELS_PER_SECOND = 150_000  # largest number of pixels of the fit per second of the limit
START_S = 0.5  # seconds of the limit that start-up may take
LEAST_S = 0.25  # least number of seconds that are assumed to remain after start-up


def pixels_within(time_limit: float) -> float:
    """Return the largest number of pixels that a fit may have within a time limit in s."""
    return PIXELS_PER_SECOND * max(time_limit - START_S, LEAST_S)


def load_of(plan: Plan, photo: Header) -> Load:
    """Return the load of a run. max_size, the presets and the time limit decide the fit's size."""
    given, limit = plan.options.run.max_size, plan.goal.time_limit
    width, height = photo.width, photo.height
    longest = given or max(search.preset.max_size for search in plan.searches())
    scale = min(1.0, longest / max(width, height))
    if limit is not None and given is None:
        scale = min(scale, math.sqrt(pixels_within(limit) / (width * height)))
    return Load(plan, photo, (max(1, round(width * scale)), max(1, round(height * scale))))


STEP = 5e-4  # s that each step of the fit takes
STEP_PIXEL = 3.3e-8  # s that a step takes for each pixel
STEP_GAUSSIAN = 8e-7  # s that a step takes for each Gaussian
GROWING = 0.5  # factor on the seconds of a step during growth
SECOND_THREAD = 0.8  # share of the first thread's speed on pixels that each further thread adds
PRIOR_S = 0.03  # s that count as both predicted and taken before the first step
EXPORT = 0.06  # s that each export (writing, rasterising and measuring) takes
EXPORT_PIXEL = 1.3e-6  # s that an export takes for each measured pixel
EXPORT_GAUSSIAN = 5e-5  # s that an export takes for each Gaussian
COLORS_GAUSSIAN = 5e-5  # s that finding the colours of the file takes for each Gaussian
STARTS = {"chromium": 2.0, "firefox": 2.0, "inkscape": 2.0}  # s that these programs take to start
# Number of steps that a fit should have. Gaussians are added while time for these steps is left,
# because a photo gains more from twice the Gaussians than from twice the steps.
STEPS = 100
STEPS_OF_DRAWING = 180  # number of steps that a fit to a drawing should have
# Largest share of the time for the export. If the export needs more, Gaussians are removed.
MOST_RESERVED = 0.6
LEAST_FIT_S = 0.15  # least seconds of a fit. A shorter fit hardly makes a picture
FEWEST = 150  # least number of Gaussians. If the time is too short, the fit has fewer steps instead


@dataclass
class TimeBudget:
    """The time that is left, and the share of it that the fit may use.

    deadline  end of the run in s of time.perf_counter(), infinite without a limit
    pixels    number of pixels of the image that the fit runs on
    measured  number of pixels at which the file is measured
    threads   number of threads of the fit
    steps     number of steps that the fit should have
    renderer  the renderer that rasterises the file
    """

    deadline: float = math.inf
    pixels: int = 1
    measured: int = 1
    threads: int = 1
    steps: int = STEPS
    renderer: str = DEFAULT_RENDERER

    def __post_init__(self) -> None:
        self._export_s = EXPORT + EXPORT_PIXEL * self.measured
        self._start_s = STARTS.get(self.renderer, 0.0)
        self._predicted = self._taken = PRIOR_S
        # Ratio of actual to predicted seconds. The first steps change it little.
        self._slowness = 1.0
        self._last_step = 0.0, -1  # time at which the last step ended, and its count
        self.begin_fit(0)

    def begin_fit(self, count: int, share: float = 1.0) -> None:
        """Note that a fit of about `count` Gaussians begins, which may take `share` of the time."""
        self._begun, self._share, self._reserved_for = time.perf_counter(), share, count

    def note_step(self, pixels: int, count: int, done: float) -> None:
        """Note the end of a step with `count` Gaussians on `pixels` pixels, at progress `done`.

        The first step with a new count, or after `most_gaussians`, is ignored, because its time
        includes other work.
        """
        now, growing = time.perf_counter(), done <= GROWTH_SHARE
        if count == self._last_step[1]:
            step_s = self._step_s(pixels) + STEP_GAUSSIAN * count
            self._taken += now - self._last_step[0]
            self._predicted += (GROWING if growing else 1.0) * step_s
            self._slowness = self._taken / self._predicted
        self._last_step = now, count
        if not growing:
            self._reserved_for = count

    def most_gaussians(self, done: float, colors: bool = False) -> float:
        """Return the largest count, at least FEWEST, for which there is time.

        Time is needed for the steps after progress `done`, and for the export.
        colors  whether time is also needed for finding the colours of the file
        """
        self._last_step = 0.0, -1  # the caller's next work is not part of a step
        steps = self.steps * (1 - done)
        left = (self._left_s() - self._start_s) / self._slowness
        each = STEP_GAUSSIAN * steps + EXPORT_GAUSSIAN + colors * COLORS_GAUSSIAN
        return max(FEWEST, (left - self._step_s(self.pixels) * steps - self._export_s) / each)

    @property
    def must_export(self) -> bool:
        """Whether writing and measuring a file need all the time that is left."""
        return self._left_s() < self._reserved_s(max(self._reserved_for, FEWEST))

    def fit_ends(self) -> float:
        """Return the end of the fit in s of time.perf_counter(), infinite without a limit.

        The time that is reserved after the fit includes finding the colours, which pauses the fit.
        """
        whole = self.deadline - self._begun
        fitting = whole - min(self._reserved_s(self._reserved_for), MOST_RESERVED * whole)
        return self._begun + max(self._share * fitting, LEAST_FIT_S)

    def _step_s(self, pixels: int) -> float:
        """Return the predicted seconds of a step, without those that each Gaussian adds."""
        return STEP + STEP_PIXEL * pixels / (1 + SECOND_THREAD * (self.threads - 1))

    def _left_s(self) -> float:
        return max(self.deadline - time.perf_counter(), 0.0)

    def _reserved_s(self, count: int) -> float:
        each = EXPORT_GAUSSIAN + COLORS_GAUSSIAN
        return self._start_s + self._slowness * (self._export_s + each * count)
