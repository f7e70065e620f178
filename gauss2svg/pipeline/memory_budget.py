"""Image sizes of a run, the memory that it needs and the memory that it may use.

All are known before the fit. The estimate is an upper bound of the process's resident size in
bytes. For a photo of P px that is measured at M px and fitted at F px, three stages need

    decoding    31 P, or d P + 12 M with d by the format if the photo is reduced while it is decoded
    fitting     12 M + a F, with a by the loss
    measuring   57 M + 36 F

A transparent photo has 70, 28 and 151 instead of 31, 12 and 57, and inks and enlarged drawings add
to these. The largest stage, the interpreter, the libraries and the shapes are added up and
multiplied by a margin. benchmarks/memory.py compares the estimate with processes. It leaves out
other programs that rasterise, and the first compilation of the kernels (105 MB).
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass, replace

from gauss2svg.errors import InputError, refusal
from gauss2svg.fit.options import has_ssim
from gauss2svg.measure.memory import SHARE, free_bytes, held_bytes
from gauss2svg.options import byte_size
from gauss2svg.photo.photo import Header
from gauss2svg.photo.reduce import Size
from gauss2svg.pipeline.drawings import LARGEST_ENLARGED
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.presets import CAP_FOR_TARGET
from gauss2svg.scene import ADD

# Fewest pixels at which a file is measured, if the photo has as many (docs/decisions/photo.md).
MEASURED_PIXELS = 1_000_000
# Bytes of each pixel while it is held, decoded and measured, of an opaque photo and of a photo with
# alpha (benchmarks/memory.py).
_BYTES = (12, 31, 57), (28, 70, 151)


# Measured bytes of a run (docs/decisions/memory.md).
BASE = 205e6  # bytes of a run with a photo of a few pixels
SHAPE = 3000  # bytes of each Gaussian
FIT = 75  # bytes of each pixel of the fit
FIT_SSIM = 130  # bytes of each pixel of a fit whose loss has SSIM
INKS = 34  # bytes added for each pixel of a fit in inks, whose target is not the photo
ENLARGED = 230  # bytes of each pixel of an enlarged drawing
LARGEST = 1024**2  # largest number of pixels of an enlarged drawing
HELD = 36  # bytes of each pixel of the fit after it has ended
ADDITIVE = 110e6  # bytes for writing an additive scene
MARGIN = 1.2  # factor for memory that was not measured


def measured_size(photo: Size, fit: Size = (1, 1), least: float = MEASURED_PIXELS) -> Size:
    """Return the size in px at which a file is measured.

    It is the fit's size if that has at least `least` pixels. Otherwise it is the photo's size,
    reduced to about `least` pixels if it has more.
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
    def size(self) -> Size:
        """Width and height in px of the photo."""
        return self.photo.width, self.photo.height

    @property
    def measured(self) -> Size:
        """Width and height in px at which the file is measured. A time limit may reduce them."""
        limit, least = self.plan.goal.time_limit, MEASURED_PIXELS
        if self.plan.options.run.full_size:
            return self.size
        if limit is not None:
            least = min(least, pixels_within(limit))
        return measured_size(self.size, self.fit, least)

    @property
    def most_gaussians(self) -> int:
        """Largest number of Gaussians that the run may have."""
        if self.plan.goal.count is not None:
            return self.plan.goal.count
        caps = [
            search.preset.cap if search.aim is None else CAP_FOR_TARGET
            for search in self.plan.searches()
        ]
        return min(max(caps), math.prod(self.fit) // 2)

    @property
    def bytes(self) -> int:
        """Estimated upper bound of the run's memory in bytes."""
        plan, options, target = self.plan, self.plan.options, self.plan.goal.target
        fit, kept = math.prod(self.fit), math.prod(self.measured)
        held, _, measured = _BYTES[self.photo.has_alpha]
        inked = INKS * plan.in_inks
        fitting = held * kept + ((FIT_SSIM if has_ssim(options.fit.loss) else FIT) + inked) * fit
        if plan.goal.byte_limit is not None and max(self.size) <= LARGEST_ENLARGED:
            fitting += ENLARGED * min(16 * fit, LARGEST)
        measured = max(measured, held + (target.pixel_bytes if target is not None else 0))
        measuring = measured * kept + (HELD + inked) * fit
        measuring += ADDITIVE * (options.fit.blend == ADD)
        most = max(_decoding(self.photo, kept), fitting, measuring)
        return math.ceil(MARGIN * (BASE + most + SHAPE * self.most_gaussians))


def _decoding(photo: Header, kept: int) -> int:
    """Return the bytes that decoding takes if `kept` pixels are kept."""
    held, decoded, _ = _BYTES[photo.has_alpha]
    pixels = photo.width * photo.height
    if photo.reduced_bytes is not None and kept < pixels:
        return photo.reduced_bytes * pixels + held * kept
    return decoded * pixels


def allowed(max_memory: int | str | None) -> int:
    """Return the bytes of memory that a run may take.

    They are `max_memory`, such as "2G", or SHARE of the free memory and the process's own if it is
    None. Raise InputError for an invalid size.
    """
    if max_memory is not None:
        return byte_size("max_memory", max_memory)
    return int(SHARE * (free_bytes() + held_bytes()))


def check_decoding(header: Header, limit: int, reduced: bool = False) -> None:
    """Raise InputError if decoding a photo takes more memory than `limit` bytes.

    reduced  whether the photo is reduced while it is decoded
    """
    decoding = _decoding(header, 0 if reduced else header.width * header.height)
    needed = math.ceil(MARGIN * (BASE + decoding))
    if needed > limit:
        photo = f"a photo of {header.width}x{header.height} px"
        raise _too_little(needed, limit, photo, "a smaller photo")


def size_that_fits(load: Load, limit: int, asked: bool) -> tuple[Load, str | None]:
    """Return the load of the largest fit within `limit` bytes, and a note if that is reduced.

    asked  whether the size is required and may not be reduced
    Raise InputError if a required size does not fit, or if no size does.
    """
    if load.bytes <= limit:
        return load, None

    def with_side(longest: int) -> Load:
        width, height = (max(1, longest * side // max(load.fit)) for side in load.fit)
        return replace(load, fit=(width, height))

    (width, height), (fit_width, fit_height) = load.size, load.fit
    if with_side(1).bytes > limit:
        work = f"a photo of {width}x{height} px and up to {load.most_gaussians} Gaussians"
        raise _too_little(with_side(1).bytes, limit, work, "a smaller photo")
    if asked:
        work = f"a fit on {fit_width}x{fit_height} px"
        raise _too_little(load.bytes, limit, work, "a smaller --max-size")
    longer = bisect_right(range(max(load.fit)), limit, lo=1, key=lambda side: with_side(side).bytes)
    largest = with_side(longer - 1)
    width, height = largest.fit
    return largest, f"fitted at {width}x{height} px to stay under {_megabytes(limit)} of memory"


def _too_little(needed: float, limit: int, work: str, advice: str) -> InputError:
    least, advice = f"at least {_megabytes(needed)} for {work}", f"{advice}, or a larger"
    return refusal("memory", least, _megabytes(limit), f"{advice} --max-memory")


def _megabytes(size: float) -> str:
    return f"{size / 1e6:.0f} MB" if size >= 1e6 else f"{size:.0f} bytes"


# Size of a fit within a time limit (docs/decisions/time.md).
PIXELS_PER_SECOND = 150_000  # most pixels of the fit for each second of the limit
START_S = 0.5  # seconds of the limit that the start takes
LEAST_S = 0.25  # fewest seconds that are assumed to be left after the start


def pixels_within(time_limit: float) -> float:
    """Return the largest number of pixels that a fit may have within a time limit in s."""
    return PIXELS_PER_SECOND * max(time_limit - START_S, LEAST_S)


def load_of(plan: Plan, photo: Header) -> Load:
    """Return the load of a run on a photo, by its options, presets and time limit."""
    given, limit = plan.options.run.max_size, plan.goal.time_limit
    width, height = photo.width, photo.height
    longest = given or max(search.preset.max_size for search in plan.searches())
    scale = min(1.0, longest / max(width, height))
    if limit is not None and given is None:
        scale = min(scale, math.sqrt(pixels_within(limit) / (width * height)))
    return Load(plan, photo, (max(1, round(width * scale)), max(1, round(height * scale))))
