"""Sizes of a run in px, and the memory that it takes and has, all known before the fit.

The estimate is an upper bound of the process's resident size in bytes, for a photo of P px, M px
that are measured and a fit on F px: the largest of three stages,

    decoding    31 P, or d P + 12 M by the photo's format where it is reduced to M meanwhile, from
                twice the side on
    fitting     12 M + a F,  a by the loss, and more in inks
    measuring   57 M + 36 F, and more in inks

(70, 28 and 151 for a transparent photo), plus that of the interpreter, the libraries and each
shape, times a margin. benchmarks/memory.py compares it with processes. Not counted are other
programs that rasterise, and the first compilation of the kernels (105 MB).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from gauss2svg.errors import InputError
from gauss2svg.fit.options import DEFAULT_LOSS, has_ssim
from gauss2svg.measure.memory import SHARE, free_bytes, held_bytes
from gauss2svg.options import byte_size
from gauss2svg.photo.photo import Header
from gauss2svg.photo.reduce import Size
from gauss2svg.pipeline.drawings import may_enlarge
from gauss2svg.pipeline.plan import Plan
from gauss2svg.pipeline.presets import CAP_FOR_TARGET
from gauss2svg.scene import ADD, OVER

# Pixels at which a file is measured at least, where the photo has them: docs/decisions/photo.md.
MEASURED_PIXELS = 1_000_000
# Measured bytes per pixel of the photo (benchmarks/memory.py), opaque and with alpha: held, while
# decoding, and while measuring.
_OPAQUE = (12, 31, 57)
_ALPHA = (28, 70, 151)


# Measured bytes of a run, and what they are counted for (docs/decisions/memory.md).
BASE = 205e6  # a run with a photo of a few pixels
SHAPE = 3000  # each Gaussian
FIT = 75  # each pixel of the fit
FIT_SSIM = 130  # the same where the loss has SSIM
INKS = 34  # added for each pixel of a fit in inks, whose target is not the photo
ENLARGED = 230  # each pixel of the enlarged picture of a drawing
LARGEST = 1024**2  # pixels of that picture at most
HELD = 36  # each pixel of the fit after it has ended
ADDITIVE = 110e6  # writing an additive scene
MARGIN = 1.2  # factor for what is not measured


def measured_size(photo: Size, fit: Size = (1, 1), least: float = MEASURED_PIXELS) -> Size:
    """Size of measuring: the fit's from `least` pixels on, else one of so many, or the photo's."""
    if fit[0] * fit[1] >= least or fit == photo:
        return fit
    scale = math.sqrt(least / (photo[0] * photo[1]))
    if scale >= 1:
        return photo
    scale = math.ceil(scale * max(photo)) / max(photo)  # such as a longest side alone asks for
    width, height = (max(1, round(scale * side)) for side in photo)
    return width, height


@dataclass(frozen=True)
class Load:
    """The properties of a run that determine its memory.

    width, height          of the photo in px
    fit_width, fit_height  of the image that the fit runs on, in px
    gaussians              largest number
    adapts                 whether there are at most as many as half the px of the fit
    scoring                bytes a pixel that the score of the target takes where it is measured
    least_measured         pixels at which the file is measured at least, where the photo and not
                           the fit has them; None: those of the photo
    reduced_bytes          per pixel while the photo is decoded and reduced, see Header
    in_inks                whether the fit aims at the photo in inks
    may_enlarge            whether the photo may be a drawing that is fitted enlarged
    """

    width: int
    height: int
    fit_width: int
    fit_height: int
    gaussians: int
    adapts: bool = False
    loss: str = DEFAULT_LOSS
    blend: str = OVER
    has_alpha: bool = False
    scoring: int = 0
    least_measured: int | None = None
    reduced_bytes: int | None = None
    in_inks: bool = False
    may_enlarge: bool = False

    @property
    def fit(self) -> Size:
        """Width and height in px of the image that the fit runs on."""
        return self.fit_width, self.fit_height

    @property
    def measured(self) -> Size:
        """Width and height in px at which the file is measured."""
        least = math.inf if self.least_measured is None else self.least_measured
        return measured_size((self.width, self.height), self.fit, least)

    @property
    def bytes(self) -> int:
        """Estimated bytes that the run takes at most."""
        photo, fit = self.width * self.height, self.fit_width * self.fit_height
        kept = math.prod(self.measured)
        inked = INKS * self.in_inks
        a_pixel = (FIT_SSIM if has_ssim(self.loss) else FIT) + inked
        held, decoded, measured = _ALPHA if self.has_alpha else _OPAQUE
        decoding = decoded * photo
        if self.reduced_bytes is not None and kept < photo:
            decoding = self.reduced_bytes * photo + held * kept
        enlarged = min(16 * fit, LARGEST) * self.may_enlarge
        fitting = held * kept + a_pixel * fit + ENLARGED * enlarged
        measured = max(measured, held + self.scoring)
        measuring = measured * kept + (HELD + inked) * fit
        measuring += ADDITIVE * (self.blend == ADD)
        most = max(decoding, fitting, measuring)
        shapes = min(self.gaussians, fit // 2) if self.adapts else self.gaussians
        return math.ceil(MARGIN * (BASE + most + SHAPE * shapes))


def allowed(max_memory: int | str | None) -> int:
    """Bytes that a run may take: those given, such as "2G", or SHARE of the free and its own.

    Raises InputError for an invalid size.
    """
    if max_memory is not None:
        return byte_size("max_memory", max_memory)
    return int(SHARE * (free_bytes() + held_bytes()))


def check_decoding(header: Header, limit: int, reduced: bool = False) -> None:
    """Raise InputError for a photo whose pixels alone take more than a limit of bytes.

    reduced  whether it is reduced while it is decoded
    """
    each = (_ALPHA if header.has_alpha else _OPAQUE)[1]
    if reduced and header.reduced_bytes is not None:
        each = header.reduced_bytes
    decoded = each * header.width * header.height
    needed = math.ceil(MARGIN * (BASE + decoded))
    if needed > limit:
        photo = f"a photo of {header.width}x{header.height} px"
        raise _too_little(needed, limit, photo, "a smaller photo")


def size_that_fits(load: Load, limit: int, asked: bool) -> tuple[Load, str | None]:
    """Return the load of the largest fit under a limit of bytes, and a note if it is reduced.

    asked  whether the size was given by the user and may not be reduced
    Raise InputError if a given size does not fit, and if none does.
    """
    if load.bytes <= limit:
        return load, None

    def scaled(share: float) -> Load:
        width, height = (max(1, int(share * side)) for side in load.fit)
        return replace(load, fit_width=width, fit_height=height)

    least = scaled(0.0)
    if least.bytes > limit:
        work = f"a photo of {load.width}x{load.height} px and up to {load.gaussians} Gaussians"
        raise _too_little(least.bytes, limit, work, "a smaller photo")
    if asked:
        work = f"a fit on {load.fit_width}x{load.fit_height} px"
        raise _too_little(load.bytes, limit, work, "a smaller --max-size")
    low, high = 0.0, 1.0
    while high - low > 1 / max(load.fit):
        middle = (low + high) / 2
        low, high = (middle, high) if scaled(middle).bytes <= limit else (low, middle)
    found = scaled(low)
    size = f"{found.fit_width}x{found.fit_height} px"
    return found, f"fitted at {size} to stay under {_megabytes(limit)} of memory"


def _too_little(needed: float, limit: int, work: str, advice: str) -> InputError:
    return InputError(
        f"memory must be at least {_megabytes(needed)} for {work}; got {_megabytes(limit)}. "
        f"Try {advice}, or a larger --max-memory"
    )


def _megabytes(size: float) -> str:
    return f"{size / 1e6:.0f} MB" if size >= 1e6 else f"{size:.0f} bytes"


# The size of a fit within a time limit (docs/decisions/time.md).
PIXELS_PER_SECOND = 150_000  # most pixels of the fit for each second of the limit
START_S = 0.5  # seconds of the limit that the start takes
LEAST_S = 0.25  # fewest seconds of the limit that are left


def load_of(plan: Plan, photo: Header) -> Load:
    """What determines the memory of a run on a photo, with the sizes that the preset asks for."""
    goal, run = plan.options.goal, plan.options.run
    width, height = photo.width, photo.height
    scale = min(1.0, plan.side / max(width, height))
    if goal.time_limit is not None and run.max_size is None:
        seconds = max(goal.time_limit - START_S, LEAST_S)
        pixels = PIXELS_PER_SECOND * seconds
        scale = min(scale, math.sqrt(pixels / (width * height)))
    fit_width, fit_height = (max(1, round(side * scale)) for side in (width, height))
    most = plan.preset.cap if plan.aim is None else CAP_FOR_TARGET
    return Load(
        width,
        height,
        fit_width,
        fit_height,
        gaussians=most if plan.goal.count is None else plan.goal.count,
        adapts=plan.goal.count is None,
        loss=plan.options.fit.loss,
        blend=plan.options.fit.blend,
        has_alpha=photo.has_alpha,
        scoring=0 if goal.target is None else goal.target.pixel_bytes,
        least_measured=None if run.full_size else MEASURED_PIXELS,
        reduced_bytes=photo.reduced_bytes,
        in_inks=plan.in_inks,
        may_enlarge=may_enlarge(width, height) and plan.may_enlarge,
    )
